"""Drawing a crash and its way out into a picture file, or making a film of it."""

from __future__ import annotations

from pathlib import Path

from cornerforge.analysis.avoidability import Avoidability
from cornerforge.analysis.in_words import avoidance_in_words, case_in_words
from cornerforge.errors import InputError
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.output import check_new_file, writing
from cornerforge.ext.pictures.avoidance_figure import avoidance_figure
from cornerforge.ext.pictures.film import check_film, film
from cornerforge.report.drawing import check_matplotlib, png_of, svg_of
from cornerforge.types import Scenario

__all__ = ["check_picture", "check_video", "write_picture", "write_video"]

_FORMATS = {".png": png_of, ".svg": svg_of}


def check_picture(path: Path) -> None:
    """Check, before long work, that a picture can be drawn and written there.

    Raises:
        InputError: The name ends neither in .png nor in .svg.
        OutputError: Something is there already, or its folder cannot be written.
        MissingExtraError: matplotlib is not installed.
    """
    if path.suffix.lower() not in _FORMATS:
        raise InputError(f"{path} ends neither in .png nor in .svg; name the picture with one of them.")
    check_new_file(path)
    check_matplotlib()


def check_video(path: Path) -> None:
    """Check, before long work, that a film can be made and written there.

    Raises:
        InputError: The name ends neither in .mp4 nor in .gif nor in .webm.
        OutputError: Something is there already, or its folder cannot be written.
        MissingExtraError: What makes it is not installed.
    """
    check_film(path)
    check_new_file(path)


def write_picture(scenario: Scenario, path: Path, answer: Avoidability) -> None:
    """Draw a crash of the AV: the road from above, speeds over time, and the latest way out, if there was one.

    Args:
        scenario: The crash.
        path: The new file.
        answer: Result of `way_out_of`.

    Raises:
        InputError: The scenario holds no crash of the AV.
        OutputError: The file cannot be written.
    """
    content = _FORMATS[path.suffix.lower()](avoidance_figure(scenario, answer))
    with writing(path) as part:
        part.write_bytes(content)


def write_video(
    scenario: Scenario, path: Path, answer: Avoidability | None, *, title: str, progress: Progress = NO_PROGRESS
) -> None:
    """Make a film of a case, with the latest way out, if there was one.

    Args:
        scenario: The case.
        path: The new file.
        answer: Result of `way_out_of`; None where the AV does not crash.
        title: The case's name.
        progress: Called with the progress.

    Raises:
        OutputError: The file cannot be written.
    """
    if answer is None or scenario.partner is None:
        sentence, way_out = "The AV does not crash.", None
    else:
        sentence = case_in_words(scenario, avoidance_in_words(answer.label, answer.latest_s))
        way_out = answer.witness
    film(
        scenario, path, title=title, sentence=sentence, way_out=way_out,
        progress=lambda done, total: progress("film", done, total),
    )  # fmt: skip
