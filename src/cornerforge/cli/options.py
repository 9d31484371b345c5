"""Options that several commands share: the same name, type and help everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "AV_TIMEOUT", "Acting", "Av", "AvTimeout", "Bounded", "Budget", "DataFormat", "Debug", "IdleSeed", "IdleThreads",
    "Json", "JsonFile", "Lanes", "Library", "Model", "OddName", "Quiet", "Resume", "Seed", "Threads", "flag",
]  # fmt: skip


def flag(name: str, text: str) -> Any:
    """An option without a value; help would else show one for it."""
    return typer.Option(name, help=text, metavar="")


def _check_idle_seed(value: int) -> int:
    from cornerforge._checks import check_integer

    return check_integer("seed", value, low=0, high=2**63 - 1)


def _check_idle_threads(value: int | None) -> int | None:
    from cornerforge._checks import check_integer

    return None if value is None else check_integer("threads", value, low=1, high=1024)


Seed = Annotated[int, typer.Option(help="Names the random numbers; same seed, same results.")]
Threads = Annotated[
    int | None, typer.Option(help="Threads; all cores by default. Does not change results.", show_default=False)
]
# Every command takes --seed and --threads, so that scripts need not know which ones draw or compute.
IdleSeed = Annotated[int, typer.Option("--seed", help="No effect here: nothing is drawn.", callback=_check_idle_seed)]
IdleThreads = Annotated[
    int | None,
    typer.Option(
        "--threads", help="No effect here: one thread does it.", show_default=False, callback=_check_idle_threads
    ),
]
Quiet = Annotated[bool, flag("--quiet", "No text and no progress bars.")]
Json = Annotated[bool, flag("--json", "Print exactly one JSON object on standard output.")]
Debug = Annotated[bool, flag("--debug", "Show the traceback of an error.")]
JsonFile = Annotated[
    Path | None, typer.Option("--out", help="New file for the object that --json prints.", show_default=False)
]
Av = Annotated[
    str,
    typer.Option(
        help="AV under test: a name (`cornerforge avs` lists them), module:Class, or an .onnx or SB3 .zip file."
    ),
]
AvTimeout = Annotated[float, typer.Option(help="Seconds that an AV which is not built in may take for an answer.")]
AV_TIMEOUT = 5.0
Lanes = Annotated[int | None, typer.Option(help="Lanes, 2 to 6; 3 by default.", show_default=False)]
OddName = Annotated[str, typer.Option("--odd", help="default (4 s lane change), swift (2.5 s) or paper (1 s).")]
Model = Annotated[Path | None, typer.Option(help="Naturalistic model; the shipped one by default.", show_default=False)]
Bounded = Annotated[bool, flag("--bounded", "Only actions that the naturalistic model calls possible.")]
Budget = Annotated[
    float | None,
    typer.Option(
        help="Likelihood budget of a test in nats, such as 5: how far the actions may fall short of the likeliest "
        "ones. Implies --bounded.",
        show_default=False,
    ),
]
Acting = Annotated[str, typer.Option(help="How a policy acts: greedy, or softmax:T to draw by exp(Q / T).")]
DataFormat = Annotated[
    str | None,
    typer.Option(
        "--format", help="ngsim, pairs, tracks, tgsim or highd; told from the columns by default.", show_default=False
    ),
]
Resume = Annotated[bool, flag("--resume", "Go on with what is there.")]
Library = Annotated[Path, typer.Argument(metavar="LIB", help="A case library.", show_default=False)]
