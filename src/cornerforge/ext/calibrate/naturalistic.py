"""`ndd fit` and `ndd import` make a naturalistic model from trajectories or from published arrays, with a report."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from cornerforge._options import verb
from cornerforge.experiment.experiments import check_threads
from cornerforge.experiment.output import check_new_file, write_json
from cornerforge.ext.calibrate.options import NddFit, NddImport
from cornerforge.ndd.model import default_model_path, load_model, model_hash, save_model
from cornerforge.results import NddFitted, NddImported, as_json

__all__ = ["fit_text", "import_text", "ndd_fit", "ndd_import"]


@verb(NddFit)
def ndd_fit(options: NddFit) -> NddFitted:
    """Fit a naturalistic model from trajectories and write it with a fit report beside it.

    Returns:
        What `cornerforge ndd fit --json` prints.

    Raises:
        CornerForgeError: A file cannot be used, or the place cannot be written.
    """
    from cornerforge.ext.calibrate.readers import guess_format
    from cornerforge.ndd import fit_model, write_fit_report

    path, threads = _model_place(options.out), check_threads(options.threads)

    def say(stage: str) -> None:
        options.progress(f"fit: {stage}", 0, 1)

    paths = [Path(file) for file in options.files]
    data_format = options.data_format or guess_format(paths)
    model, report = fit_model(
        paths, data_format, prior_strength=options.prior_strength, lane_changes=options.lane_changes, progress=say
    )
    save_model(model, path)
    page = path.with_suffix(".report.html")
    write_fit_report(report, model, page)  # before the options.study, so that a stop loses no fit
    if options.study:
        from cornerforge.ext.calibrate.sensitivity import fit_sensitivity, traffic_crashes

        drive = partial(
            traffic_crashes, tests=options.study_tests, seed=options.seed, threads=threads, progress=options.progress
        )
        rows = fit_sensitivity(
            paths, data_format, prior_strength=options.prior_strength, lane_changes=options.lane_changes, progress=say,
            drive=drive if options.study_tests else None,
        )  # fmt: skip
        report = replace(report, sensitivity=rows)
        write_fit_report(report, model, page)
    return NddFitted(
        **vars(report), format=data_format, model_hash=model_hash(model), report=str(page), out=str(path)
    )  # fmt: skip


def fit_text(result: NddFitted) -> str:
    """Tell the result of `ndd_fit` in text: rows, left-out rows and their places, parts of the model, notes."""
    lines = [f"{result.rows_used:,} of {result.rows_read:,} rows used, {result.states:,} states"]
    lines += [
        f"Left out of {name}: {reason}, {entry.rows:,} row(s), first at line {entry.first_line}"
        for name, reasons in result.bad_rows.items()
        for reason, entry in reasons.items()
    ]
    lines += [f"{part.name:<26}{part.source:<16}{part.why}" for part in result.parts]
    lines += [f"Note: {note}" for note in result.notes]
    return "\n".join([*lines, f"Model: {result.out}, report: {result.report}"])


@verb(NddImport)
def ndd_import(options: NddImport) -> NddImported:
    """Make a naturalistic model of the published IVBSS arrays and write it with a report (JSON) beside it.

    Returns:
        What `cornerforge ndd import --json` prints.

    Raises:
        CornerForgeError: An array cannot be used, or the place cannot be written.
    """
    from cornerforge.ext.calibrate.ivbss import import_arrays

    path = _model_place(options.out)
    base = load_model(default_model_path() if options.model is None else Path(options.model))

    def say(stage: str) -> None:
        options.progress(f"import: {stage}", 0, 1)

    made, report = import_arrays(Path(options.folder), base, say)
    save_model(made, path)
    page = path.with_suffix(".report.json")
    write_json(page, as_json(report))
    return NddImported(**vars(report), report=str(page), out=str(path))


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
