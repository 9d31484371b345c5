"""Drawing a crash and its way out into a picture file."""

from __future__ import annotations

from pathlib import Path

from cornerforge.analysis.avoidability import AvoidParams, avoidability
from cornerforge.errors import InputError
from cornerforge.ndd.drawing import check_matplotlib, png_of, svg_of
from cornerforge.pipeline.output import check_new_file, writing
from cornerforge.report.avoidance_figure import avoidance_figure
from cornerforge.types import Scenario

__all__ = ["check_picture", "write_picture"]

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


def write_picture(scenario: Scenario, path: Path, *, steers: bool = False) -> None:
    """Draw a crash of the AV: the road from above, speeds over time, and the latest way out, if there was one.

    Args:
        scenario: The crash.
        path: The new file.
        steers: The AV steers, so it may also get out between two lanes (`AvoidParams.steers`).

    Raises:
        InputError: The scenario holds no crash of the AV.
        OutputError: The file cannot be written.
    """
    content = _FORMATS[path.suffix.lower()](
        avoidance_figure(scenario, avoidability(scenario, AvoidParams(steers=steers)))
    )
    with writing(path) as part:
        part.write_bytes(content)
