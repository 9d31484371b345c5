"""docs/commands.md: all commands of the program with their options, made from what `--help` is made from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer.main

from cornerforge.cli import app

HEAD = """# Commands

All commands, with what `cornerforge COMMAND --help` says and the options that not all of them have. This page is made
from the code (`make golden`).

- After `make demo`, P in what follows can be `out/demo/policy.safetensors` and LIB `out/demo/library`. cornerforge does
  not expand `~` in paths; your shell does. `cornerforge --install-completion` lets your shell complete commands,
  options and names.
- The same seed gives the same results for any number of threads. `--config FILE` reads options from a TOML file;
  `provenance.json` in each output keeps the options used.
- `--json` prints one object ([its keys](results-json.md)) on standard output and nothing else; on standard error long
  commands show bars, or a line for each stage where there is no terminal, unless `--quiet` is given.
- Exit status: 0 done, 1 a check failed, 2 wrong usage or input (one plain line says what to do), 130 interrupted with
  everything finished so far kept, 141 the reader of the output is gone (as in `| head`).
- Long runs can use [many machines](many-machines.md): `--engine ray` of `simulate`, `generate`, `rate`, `plausibility`
  and `analyse`.
"""
COMMON = ("--debug", "--json", "--quiet", "--seed", "--threads")


def commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """All commands with their full names; those of a group follow it."""
    for name in group.list_commands(None):
        command = group.commands[name]
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
