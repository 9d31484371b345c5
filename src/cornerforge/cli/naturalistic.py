"""The naturalistic driving model: `ndd fit`, `validate`, `show`, `import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cornerforge
from cornerforge.cli.options import Config, DataFormat, Debug, Json, Quiet, Seed, Threads, flag
from cornerforge.cli.output import EXIT_GATE, run_command
from cornerforge.cli.program import command, ndd

__all__ = ["ndd_fit", "ndd_import", "ndd_show", "ndd_validate"]


@command("cornerforge ndd fit mine/*_tracks.csv --out mine.npz", name="fit", of=ndd)
def ndd_fit(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Trajectory files.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Model file to write, .npz.", show_default=False)],
    data_format: DataFormat = None,
    prior_strength: Annotated[float, typer.Option(help="Pseudo-counts per state with which the prior enters.")] = 200.0,
    lane_changes: Annotated[
        str, typer.Option(help="Lane changes: `fit` to these files, if they tell enough, or the shipped `prior`.")
    ] = "fit",
    study: Annotated[
        bool, flag("--study", "Report what other choices of the fit change, crash rates too (6 fits).")
    ] = False,
    study_tests: Annotated[int, typer.Option(help="Tests that the study drives for each choice; 0: none.")] = 1_000_000,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Fit a naturalistic model from trajectories; its report is written beside it.

    On one machine the same files give the same bytes; on another processor a law's fourth digit may differ.
    """
    from cornerforge.ext.calibrate.naturalistic import fit_text

    run_command(
        lambda bars: cornerforge.ndd_fit(
            files, data_format=data_format, out=out, prior_strength=prior_strength,
            lane_changes=lane_changes, study=study, study_tests=study_tests, seed=seed, threads=threads, progress=bars,
        ),
        fit_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@command("cornerforge ndd validate mine.npz --against unseen/*_tracks.csv --out checked", name="validate", of=ndd)
def ndd_validate(
    model: Annotated[Path, typer.Argument(metavar="M.npz", help="The model.", show_default=False)],
    against: Annotated[
        list[Path], typer.Option(metavar="FILE...", help="Trajectory files, such as held-out ones.", show_default=False)
    ],
    data_format: DataFormat = None,
    # An option takes one value: what follows `--against A` in `--against A B C` arrives here.
    more: Annotated[list[Path] | None, typer.Argument(metavar="FILE", hidden=True)] = None,
    miles: Annotated[float, typer.Option(help="Vehicle-miles of traffic; 2e5 for a quick look.")] = 4e6,
    out: Annotated[
        Path | None, typer.Option(help="Folder for validation.json, the page and its figures.", show_default=False)
    ] = None,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Compare a model with held-out trajectories and published facts; exit status 1 if it does not pass."""
    from cornerforge.ext.calibrate.validating import validation_text

    result = run_command(
        lambda bars: cornerforge.ndd_validate(
            model, against=[*against, *(more or [])], data_format=data_format, miles=miles, out=out, seed=seed,
            threads=threads, progress=bars,
        ),
        validation_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
    if not result.passed:
        raise typer.Exit(EXIT_GATE)


@command("cornerforge ndd show --out out/model", name="show", of=ndd)
def ndd_show(
    model: Annotated[
        Path | None, typer.Argument(metavar="M.npz", help="The model; the shipped one by default.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).", show_default=False)] = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Show a naturalistic model: its key numbers beside published facts; figures with --out."""
    from cornerforge.ext.calibrate.show import show_text

    run_command(
        lambda bars: cornerforge.ndd_show(model, out=out, progress=bars), show_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@command("cornerforge ndd import NDD_DATA --out ivbss.npz", name="import", of=ndd)
def ndd_import(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with the arrays.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Model file to write, .npz.", show_default=False)],
    model: Annotated[
        Path | None, typer.Option(help="Fills what is missing; the shipped model by default.", show_default=False)
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Make a model of the published IVBSS arrays; what is missing is filled from ours and named."""
    from cornerforge.ext.calibrate.naturalistic import import_text

    run_command(
        lambda bars: cornerforge.ndd_import(folder, out=out, model=model, progress=bars),
        import_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
