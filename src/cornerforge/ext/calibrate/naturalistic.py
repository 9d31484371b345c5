"""`ndd fit` and `ndd import` make a naturalistic model from trajectories or from published arrays, with a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from cornerforge._arguments import checked
from cornerforge._checks import check_integer
from cornerforge._locks import claims
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.output import check_new_file, write_json
from cornerforge.experiment.setting import check_threads
from cornerforge.ext.calibrate.traffic_crashes import traffic_crashes
from cornerforge.ndd.model import default_model_path, load_model, model_hash, save_model
from cornerforge.results import NddFitted, NddImported, from_json

__all__ = ["fit_text", "import_text", "ndd_fit", "ndd_import"]


@checked
@claims()
def ndd_fit(
    files: Sequence[Path | str],
    *,
    data_format: str | None = None,
    out: Path | str,
    prior_strength: float = 200.0,
    lane_changes: str = "fit",
    study: bool = False,
    study_tests: int = 1_000_000,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> NddFitted:
    """Fit a naturalistic model from trajectories and write it with a fit report beside it.

    Args:
        files: Trajectory files, all of one format.
        data_format: "ngsim", "pairs", "tracks", "tgsim" or "highd"; None to tell it from the columns.
        out: Model file, `.npz`; an existing one is replaced (the fit of the same data gives the same bytes).
        prior_strength: Pseudo-counts per state with which the prior enters.
        lane_changes: "fit": fit the lane changes too, where the files tell enough of them; "prior": keep the shipped
            ones.
        study: Fit again with other prior strengths and smoothing windows, drive the traffic of each fit, and report
            what changes (six fits, eight drives).
        study_tests: Tests of each drive, 0 to 1e12; 0 drives none.
        seed: Seed of the tests of the study.
        threads: Pool size for these tests; None for all cores. Does not change the result.
        progress: Told how far it is.

    Returns:
        What `cornerforge ndd fit --json` prints.

    Raises:
        CornerForgeError: A file cannot be used, or the place cannot be written.
    """
    from cornerforge.ext.calibrate.readers import guess_format
    from cornerforge.ndd import fit_model, write_fit_report

    path = _model_place(out)
    check_integer("study_tests", study_tests, low=0, high=10**12)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    drive = None
    if study and study_tests:
        drive = partial(
            traffic_crashes, tests=study_tests, seed=seed, threads=check_threads(threads), progress=progress
        )

    def say(stage: str) -> None:
        progress(f"fit: {stage}", 0, 1)

    paths = [Path(file) for file in files]
    data_format = guess_format(paths) if data_format is None else data_format
    model, report = fit_model(
        paths, data_format, prior_strength=prior_strength, lane_changes=lane_changes, progress=say
    )
    save_model(model, path)
    page = path.with_suffix(".report.html")
    write_fit_report(report, model, page)  # before the study, so that a stop loses no fit
    if study:
        from cornerforge.ext.calibrate.sensitivity import fit_sensitivity

        rows = fit_sensitivity(
            paths, data_format, prior_strength=prior_strength, lane_changes=lane_changes, progress=say, drive=drive
        )
        report = replace(report, sensitivity=rows)
        write_fit_report(report, model, page)
    about = {"format": data_format, "model_hash": model_hash(model), "report": str(page), "out": str(path)}
    return from_json(NddFitted, report.to_json() | about)


def fit_text(result: NddFitted) -> str:
    """Tell the result of `ndd_fit` in text: rows, what was left out and where, parts of the model, notes."""
    lines = [f"{result.rows_used:,} of {result.rows_read:,} rows used, {result.states:,} states"]
    lines += [
        f"Left out of {name}: {reason}, {entry.rows:,} row(s), first at line {entry.first_line}"
        for name, reasons in result.bad_rows.items()
        for reason, entry in reasons.items()
    ]
    lines += [f"{part.name:<26}{part.source:<16}{part.why}" for part in result.parts]
    lines += [f"Note: {note}" for note in result.notes]
    return "\n".join([*lines, f"Model: {result.out}, report: {result.report}"])


@checked
@claims()
def ndd_import(
    folder: Path | str,
    *,
    out: Path | str,
    model: Path | str | None = None,
    progress: Progress = NO_PROGRESS,
) -> NddImported:
    """Make a naturalistic model of the published IVBSS arrays and write it with a report (JSON) beside it.

    Args:
        folder: `NDD_DATA` of the released data, or one above it (see docs/ivbss-arrays.md).
        out: Model file, `.npz`; an existing one is replaced (the same arrays give the same bytes).
        model: Model that fills what is missing; the shipped one by default.
        progress: Told how far it is.

    Returns:
        What `cornerforge ndd import --json` prints.

    Raises:
        CornerForgeError: An array cannot be used, or the place cannot be written.
    """
    from cornerforge.ext.calibrate.ivbss import import_arrays

    path = _model_place(out)
    base = load_model(default_model_path() if model is None else Path(model))

    def say(stage: str) -> None:
        progress(f"import: {stage}", 0, 1)

    made, report = import_arrays(Path(folder), base, say)
    save_model(made, path)
    page = path.with_suffix(".report.json")
    result = {**report.to_json(), "model_hash": model_hash(made)}
    write_json(page, result)
    return from_json(NddImported, {**result, "report": str(page), "out": str(path)})


def import_text(result: NddImported) -> str:
    """Tell the result of `ndd_import` in text."""
    lines = []
    for role, entry in result.files.items():
        numbers = ", ".join(
            f"{key} {value:,}" if isinstance(value, int) else f"{key} {value:.3g}"
            for key, value in entry.items()
            if key not in ("name", "sha256")
        )
        lines.append(f"{role:<14}{entry['name']}: {numbers}")
    lines += [f"ours          {what}" for what in result.filled]
    lines += [f"not used      {name}" for name in result.unused]
    lines += [f"Note: {note}" for note in result.notes]
    return "\n".join([*lines, f"Model {result.model_hash}: {result.out}, report: {result.report}"])


def _model_place(out: Path | str) -> Path:
    """Check the file that a model is to be written to; only a model is replaced, never another file of that name.

    Raises:
        CornerForgeError: The file cannot be written, or holds something else than a model.
    """
    path = Path(out)
    check_new_file(path, overwrite=True)
    if path.exists():
        load_model(path)
    return path
