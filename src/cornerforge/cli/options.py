"""Options that several commands share: the same name, type and help everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "AV_TIMEOUT", "Acting", "Av", "AvTimeout", "Bounded", "Budget", "DataFormat", "Debug", "IdleSeed", "IdleThreads",
    "Json", "Lanes", "Library", "Model", "OddName", "Quiet", "Resume", "Seed", "Threads",
]  # fmt: skip

Seed = Annotated[int, typer.Option(help="Names the random numbers; same seed, same results.")]
Threads = Annotated[
    int | None, typer.Option(help="Threads; all cores by default. Does not change results.", show_default=False)
]
# Every command takes --seed and --threads, so that scripts need not know which ones draw or compute.
IdleSeed = Annotated[int, typer.Option("--seed", help="No effect here: nothing is drawn.")]
IdleThreads = Annotated[
    int | None, typer.Option("--threads", help="No effect here: one thread does it.", show_default=False)
]
Quiet = Annotated[bool, typer.Option("--quiet", help="No text and no progress bars.")]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
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
Bounded = Annotated[bool, typer.Option("--bounded", help="Only actions that the naturalistic model calls possible.")]
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
Resume = Annotated[bool, typer.Option("--resume", help="Go on with what is there.")]
Library = Annotated[Path, typer.Argument(metavar="LIB", help="A case library.", show_default=False)]
