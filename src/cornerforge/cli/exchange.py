"""Cases out to other people's tools, and in from them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cornerforge
from cornerforge.cli.options import (
    Debug,
    IdleSeed,
    IdleThreads,
    Json,
    Library,
    Quiet,
    Resume,
    completing,
)
from cornerforge.cli.output import run_command
from cornerforge.cli.program import command

__all__ = ["export"]

_FORMATS = ("openscenario", "commonroad", "csv", "parquet", "rerun", "json")


@command(
    "cornerforge export out/demo/library 0:0 --to openscenario --out out/xosc",
    "cornerforge export out/demo/library all --to commonroad --out out/commonroad",
)
def export(
    library: Library,
    cases: Annotated[list[str], typer.Argument(metavar="CASE...", help='Case ids, or "all".', show_default=False)],
    to: Annotated[
        str,
        typer.Option(
            metavar="FORMAT", help=f"One of {', '.join(_FORMATS)}.", show_default=False,
            autocompletion=completing(*_FORMATS),
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the files, new or empty.", show_default=False)],
    version: Annotated[
        str, typer.Option(help="Of OpenSCENARIO: 1.0 to 1.3.", autocompletion=completing("1.0", "1.1", "1.2", "1.3"))
    ] = "1.2",
    mode: Annotated[
        str,
        typer.Option(
            metavar="recorded|controller|relative",
            help="Of OpenSCENARIO. recorded: all move as recorded; controller: a controller of yours drives the AV, "
            "the others as recorded; relative: the partner's manoeuvre begins at the recorded time gap to the AV.",
            autocompletion=completing("recorded", "controller", "relative"),
        ),
    ] = "recorded",
    resume: Resume = False,
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:  # fmt: skip
    """Write cases for other tools: OpenSCENARIO with OpenDRIVE, CommonRoad, tables, rerun."""
    run_command(
        lambda bars: cornerforge.export(
            library, cases, to=to, out=out, version=version, mode=mode, resume=resume, progress=bars
        ),
        lambda r: f"{r.cases:,} cases as {len(r.files):,} files ({r.to}) in {r.out}",
        as_json=as_json, quiet=quiet,
    )  # fmt: skip
