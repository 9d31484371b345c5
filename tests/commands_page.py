"""docs/commands.md: all commands of the program with their options, made from what `--help` is made from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer.main

from cornerforge.cli import app

HEAD = """# Commands

All commands, with what `cornerforge COMMAND --help` says. The [start page](../README.md#commands) has one line on
each command, and the meaning of exit statuses; another page tells [what `--json` prints](results-json.md). This page
is made from the code (`make golden`).
"""
COMMON = ("--debug", "--json", "--quiet", "--seed", "--threads")


def commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """All commands with their full names; those of a group follow it."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def is_argument(one: Any) -> bool:
    return not any(name.startswith("-") for name in one.opts)


def default_of(option: Any) -> str:
    """The value that holds without the option; empty where there is none, or where the text says so."""
    has_none = (
        option.is_flag or not option.show_default or option.default in (None, "", (), []) or callable(option.default)
    )
    return "" if has_none else f"`{option.default}`"


def row(one: Any) -> str:
    required = " Required." if one.required else ""
    if is_argument(one):
        return f"| {cell((one.metavar or one.name).upper())} | {cell(one.help or '')}{required} |  |"
    names = "`, `".join([*one.opts, *one.secondary_opts])
    return f"| `{names}` | {cell(one.help or '')}{required} | {default_of(one)} |"


def section(name: str, command: Any) -> str:
    own = [one for one in command.params if not set(one.opts) & set(COMMON) and not one.hidden]
    lines = [f"## {name}", "", str(command.help).strip()]
    if own:
        rows = [row(one) for one in sorted(own, key=is_argument, reverse=True)]
        lines += ["", "| argument or option | meaning | default |", "| --- | --- | --- |", *rows]
    return "\n".join(lines)


def commands_markdown() -> str:
    parts = dict(commands(typer.main.get_command(app)))
    shared = {one.opts[0]: one for one in parts["simulate"].params if set(one.opts) & set(COMMON)}
    rows = "\n".join(
        [*(row(shared[name]) for name in COMMON), "| `--help`, `-h` | Say what the command does and takes. |  |"]
    )
    about = "## What all commands take\n\n| option | meaning | default |\n| --- | --- | --- |\n" + rows
    return HEAD + "\n" + "\n\n".join([about, *(section(*part) for part in parts.items())]) + "\n"
