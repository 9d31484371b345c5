"""`ndd fit`: a naturalistic model from trajectories, with its report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cornerforge.errors import OutputError
from cornerforge.ndd.model import load_model, model_hash, save_model
from cornerforge.pipeline.output import check_new_file
from cornerforge.pipeline.progress import NO_PROGRESS, Progress

__all__ = ["ndd_fit"]


def ndd_fit(
    files: Sequence[Path | str],
    *,
    data_format: str | None = None,
    out: Path | str,
    prior_strength: float = 200.0,
    progress: Progress = NO_PROGRESS,
) -> dict[str, Any]:
    """Fit a naturalistic model from trajectories and write it with a fit report beside it.

    Args:
        files: Trajectory files, all of one format.
        data_format: "ngsim", "pairs", "tracks", "tgsim" or "highd"; None to tell it from the columns.
        out: Model file, `.npz`; an existing one is replaced (the fit of the same data gives the same bytes).
        prior_strength: Pseudo-counts per state with which the prior enters.
        progress: Told how far it is.

    Returns:
        The object that `cornerforge ndd fit --json` prints; `format` is the one taken.

    Raises:
        CornerForgeError: A file cannot be used, or the place cannot be written.
    """
    from cornerforge.ndd import fit_model, write_fit_report
    from cornerforge.ndd.readers import guess_format

    path = Path(out)
    check_new_file(path, overwrite=True)
    if path.exists():
        load_model(path)  # only a model is replaced, never something else that bears the name by mistake

    def say(stage: str) -> None:
        progress(f"fit: {stage}", 0, 1)

    paths = [Path(file) for file in files]
    data_format = guess_format(paths) if data_format is None else data_format
    model, report = fit_model(paths, data_format, prior_strength=prior_strength, progress=say)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        save_model(model, path)
    except OSError as error:
        raise OutputError(f"Cannot write {path}: {error.strerror}; make room, or choose another place.") from error
    page = path.with_suffix(".report.html")
    write_fit_report(report, model, page)
    return {
        **report.to_json(),
        "format": data_format,
        "model_hash": model_hash(model),
        "report": str(page),
        "out": str(path),
    }
