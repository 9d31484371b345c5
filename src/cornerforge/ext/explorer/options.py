"""Options of the explorer: `serve`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cornerforge._options import Command, Threaded
from cornerforge._schema import meant

__all__ = ["COMMANDS", "Serve"]

if TYPE_CHECKING:
    from cornerforge.results import Served
else:  # the option is checked to be a function, whatever it takes
    Served = object


def _silent(_: Served) -> None:
    pass


class Serve(Threaded):
    """Show all cases in the browser: a map of them, each to watch and to compare; Ctrl-C ends it."""

    place: Annotated[Path | str, meant("A library, or a folder of run or rate.", metavar="LIB|RUN")] = field(
        kw_only=False
    )
    port: Annotated[int | None, meant("Port; 0 for any free one.", default="8157, or the next free one")] = None
    host: Annotated[str, meant("Where it listens. Others than this machine need the token in the printed address.")] = (
        "127.0.0.1"
    )
    avs: Annotated[
        Sequence[str],
        meant("AV to compare with, besides the built-in ones; may be given again.", name="--with", near=("av",)),
    ] = ()
    open_browser: Annotated[bool, meant("Open it in the browser.", name="--open")] = False
    up: Annotated[Callable[[Served], None], meant("Told once when the page can be opened.", hidden=True)] = _silent


COMMANDS = (
    Command(
        Serve, "ext.explorer.serve:serve", "ext.explorer.serve:serve_text",
        ("cornerforge serve out/demo", "cornerforge serve out/demo/library --with rss-cautious --open"), early=True,
    ),
)  # fmt: skip
