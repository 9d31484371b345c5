"""The first page, `cornerforge --help`, and `--version`, written without Typer and Rich, which take 0.3 s.

Typer would write the same page; `front_page.json` holds what is on it (`make golden`). Where its look would depend on
more than a width and on whether there are colours, Typer writes it.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator

from cornerforge import __version__

__all__ = ["front_page"]

_NARROWEST = 60
"""In narrower terminals the columns of the page shrink."""
_OTHER_LOOKS = (
    "_CORNERFORGE_COMPLETE", "_TYPER_FORCE_DISABLE_TERMINAL", "FORCE_COLOR", "GITHUB_ACTIONS", "JPY_PARENT_PID",
    "NO_COLOR", "PY_COLORS", "TERMINAL_WIDTH", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "TYPER_USE_RICH",
)  # fmt: skip
"""Variables with which Typer may write something else."""
_SHORT = 12
"""Width of the columns between an option's long name and what it does: its short name, and types that no option has."""
_BOLD, _DIM, _CYAN, _GREEN, _YELLOW = "1", "2", "1;36", "1;32", "1;33"
_OPTIONS = re.compile(r"(?<!\w)--[\w-]+(?![A-Za-z0-9])|(?<![\w-])-\w+(?![A-Za-z0-9])")


def front_page(given: list[str]) -> str | None:
    """Write what `--version` and `--help` alone print; None: let Typer see to these words."""
    if given == ["--version"]:
        return f"cornerforge {__version__}\n"
    if given not in (["--help"], ["-h"]) or not _usual():
        return None
    width, colours = _width(), sys.stdout.isatty()
    return _page(width, colours) if width >= _NARROWEST else None


def _usual() -> bool:
    """Tell whether nothing speaks for another look: variables, a terminal that can less, letters that it lacks."""
    if sys.platform == "win32" or any(name in os.environ for name in _OTHER_LOOKS):
        return False
    if os.environ.get("TERM", "").lower() in ("dumb", "unknown"):
        return False
    return (getattr(sys.stdout, "encoding", None) or "").lower().startswith("utf")


def _width() -> int:
    """Find the width of the terminal, 80 without one; COLUMNS sets it."""
    columns = os.environ.get("COLUMNS", "")
    if columns.isdigit():
        return int(columns) or 80
    for stream in range(3):
        try:
            return os.get_terminal_size(stream).columns or 80
        except OSError:
            continue
    return 80


def _page(width: int, colours: bool) -> str:
    import json
    import textwrap
    from pathlib import Path

    content = json.loads(Path(__file__).with_name("front_page.json").read_text(encoding="utf-8"))

    def wrapped(text: str, width: int) -> list[str]:
        return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False) or [""]

    def styled(text: str, style: str) -> str:
        return f"\x1b[{style}m{text}\x1b[0m" if colours and text else text

    def with_options(text: str) -> str:
        return _OPTIONS.sub(lambda found: styled(found[0], _CYAN if found[0].startswith("--") else _GREEN), text)

    def paragraph(text: str) -> Iterator[str]:
        for given in text.split("\n"):
            for line in wrapped(given, width - 2):
                yield f" {with_options(line)}{' ' * (width - 1 - len(line))}"

    def panel(title: str, rows: list[tuple[str, str, str]], indent: int) -> Iterator[str]:
        yield styled(f"╭─ {title} {'─' * (width - len(title) - 5)}╮", _DIM)
        side = styled("│", _DIM)
        for plain, shown, text in rows:
            for number, line in enumerate(wrapped(text, width - indent - 4)):
                first = shown + " " * (indent - len(plain)) if number == 0 else " " * indent
                yield f"{side} {first}{with_options(line)}{' ' * (width - indent - 4 - len(line))} {side}"
        yield styled(f"╰{'─' * (width - 2)}╯", _DIM)

    empty, usage = " " * width, content["usage"]
    long = max(len(option[0]) for option in content["options"])
    named = [
        (f"{name:<{long}}  {short}", f"{with_options(name)}{' ' * (long - len(name))}  {with_options(short)}", text)
        for name, short, text in content["options"]
    ]
    panels = content["commands"]
    indent = max(len(name) for rows in panels.values() for name, _ in rows) + 2
    lines = [
        empty,
        f" {styled('Usage: ', _YELLOW)}{styled(usage, _BOLD)}{' ' * (width - 8 - len(usage))}",
        empty,
        *paragraph(content["about"]),
        empty,
        *panel("Options", named, long + _SHORT),
        *(
            line
            for title, rows in panels.items()
            for line in panel(title, [(name, styled(name, _CYAN), text) for name, text in rows], indent)
        ),
        empty,
        *paragraph(content["end"]),
        empty,
    ]
    return "\n".join(lines) + "\n\n"
