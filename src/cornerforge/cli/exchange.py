"""Cases out to other people's tools, and in from them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cornerforge
from cornerforge.cli.options import (
    Debug,
    Json,
    Library,
    Quiet,
    Resume,
    Seed,
    World,
    completing,
    takes_world,
)
from cornerforge.cli.output import run_command
from cornerforge.cli.program import cases, command
from cornerforge.world_options import AV_ASKED

__all__ = ["cases_from_data", "export", "import_cases"]

_FORMATS = ("openscenario", "commonroad", "csv", "parquet", "rerun", "json")


@command(
    "cornerforge export out/demo/library 0:0 --to openscenario --out out/xosc",
    "cornerforge export out/demo/library all --to commonroad --out out/commonroad",
)
def export(
    library: Library,
    case: Annotated[list[str], typer.Argument(metavar="CASE...", help='Case ids, or "all".', show_default=False)],
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
            help="recorded: all move as recorded; controller: yours drives the AV (in CommonRoad a planning problem), "
            "the others as recorded; relative (OpenSCENARIO): the partner's manoeuvre begins at the recorded time gap.",
            autocompletion=completing("recorded", "controller", "relative"),
        ),
    ] = "recorded",
    resume: Resume = False,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:  # fmt: skip
    """Write cases for other tools: OpenSCENARIO with OpenDRIVE, CommonRoad, tables, rerun."""
    run_command(
        lambda bars: cornerforge.export(
            library, case, to=to, out=out, version=version, mode=mode, resume=resume, progress=bars
        ),
        lambda r: f"{r.cases:,} cases as {len(r.files):,} files ({r.to}) in {r.out}",
        as_json=as_json, quiet=quiet,
    )  # fmt: skip


_RECORDED = "recorded"
_CASES_OUT = Annotated[Path, typer.Option(help="Folder for case files and library, new or empty.", show_default=False)]
_IN_SEAT = Annotated[
    str,
    typer.Option(
        metavar="AV",
        help="The AV in the seat: recorded (whatever was in it), a built-in AV, or your own as for run.",
        autocompletion=completing(_RECORDED),
    ),
]


@command(
    "cornerforge import cut_in.xosc --out out/imported",
    "cornerforge import USA_US101-*.xml --av my_av.py:MyAv --out out/us101",
    name="import",
)
@takes_world(*AV_ASKED)
def import_cases(
    file: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="OpenSCENARIO (.xosc), CommonRoad (.xml), tables (.csv, .parquet).",
            show_default=False,
        ),
    ],
    out: _CASES_OUT,
    av: _IN_SEAT = _RECORDED,
    ego: Annotated[
        str | None,
        typer.Option(
            help="Vehicle in the AV's seat: its name, in CommonRoad its number. By default Ego, the one with a "
            "controller, or the planning problem's.",
            show_default=False,
        ),
    ] = None,
    world: World = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:  # fmt: skip
    """Read scenarios of other tools as cases, and drive an AV through them."""
    from cornerforge.ext.interchange.import_cases import import_text

    run_command(
        lambda bars: cornerforge.import_cases(file, out=out, ego=ego, av=av, seed=seed, progress=bars, **world),
        import_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@command("cornerforge cases from-data trajectories.csv --out out/moments", name="from-data", of=cases)
@takes_world(*AV_ASKED)
def cases_from_data(
    file: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="Trajectories of all vehicles: highD, NGSIM, TGSIM, or tracks with lanes.",
            show_default=False,
        ),
    ],
    out: _CASES_OUT,
    av: _IN_SEAT = _RECORDED,
    most: Annotated[int, typer.Option("--cases", help="How many cases at most.")] = 50,
    measure: Annotated[
        str,
        typer.Option(
            metavar="drac|ttc|thw|contact",
            help="What is critical: deceleration needed, time to collision, time headway, time to a contact.",
            autocompletion=completing("drac", "ttc", "thw", "contact"),
        ),
    ] = "drac",
    before: Annotated[float, typer.Option(help="Seconds before the moment.")] = 5.0,
    after: Annotated[float, typer.Option(help="Seconds after it.")] = 3.0,
    data_format: Annotated[
        str | None,
        typer.Option("--format", help="Format of the files; by default their columns tell.", show_default=False),
    ] = None,
    world: World = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:  # fmt: skip
    """Make cases of the most critical moments of recorded traffic, and drive an AV through them."""
    from cornerforge.ext.interchange.from_data import from_data_text

    run_command(
        lambda bars: cornerforge.cases_from_data(
            file, out=out, av=av, cases=most, measure=measure, before=before, after=after, data_format=data_format,
            seed=seed, progress=bars, **world,
        ),
        from_data_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
