"""Files of a case to take away, by format."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cornerforge.analysis.avoidability import WayOut
from cornerforge.errors import InputError, MissingExtraError
from cornerforge.ext.pictures.film import check_film, film
from cornerforge.types import Scenario

__all__ = ["Shown", "formats", "made", "packed"]


@dataclass(frozen=True)
class Shown:
    """A case as the page shows it.

    Attributes:
        scenario, way_out: Its motion.
        data: What the page got of it, as JSON values.
    """

    scenario: Scenario
    way_out: WayOut | None
    data: Mapping[str, Any]


_FORMATS = {
    "mp4": ("video (MP4)", "video/mp4"),
    "webm": ("video (WebM)", "video/webm"),
    "gif": ("moving picture (GIF)", "image/gif"),
    "numbers": ("what this page shows (JSON)", "application/json"),
}
"""Format -> what people read, and media type."""
_MEDIA = {".json": "application/json", ".csv": "text/csv", ".xml": "application/xml"}


def formats() -> dict[str, str]:
    """Formats that can be made here, each with what people read; videos need the extra `video`, most an ffmpeg."""

    def here(name: str) -> bool:
        try:
            check_film(Path(f"case.{name}"))
        except (InputError, MissingExtraError):
            return False
        return True

    return {name: label for name, (label, _) in _FORMATS.items() if name == "numbers" or here(name)}


def made(shown: Shown, name: str, going: Callable[[], None]) -> tuple[str, bytes]:
    """Make a file of a case.

    Args:
        shown: The case.
        name: One of `formats()`.
        going: Called for each picture of a video; what it raises ends the work.

    Returns:
        Media type and content.

    Raises:
        OutputError: The program that writes videos failed.
    """
    media = _FORMATS[name][1]
    if name == "numbers":
        return media, json.dumps(shown.data, separators=(",", ":"), allow_nan=False).encode()
    with tempfile.TemporaryDirectory() as folder:
        path = film(
            shown.scenario, Path(folder) / f"case.{name}", title=f"Case {shown.data['key']}",
            sentence=shown.data["title"], way_out=shown.way_out, progress=lambda _, __: going(),
        )  # fmt: skip
        return media, path.read_bytes()


def packed(stem: str, files: Mapping[str, bytes]) -> tuple[str, str, bytes]:
    """Make one file to take away of the files of a case in a format for other tools: the file itself, or an archive.

    Args:
        stem: Begins its name.
        files: Files by their names, at least one.

    Returns:
        Media type, file name, and content.
    """
    if len(files) == 1:
        ((name, content),) = files.items()
        return _MEDIA.get(Path(name).suffix, "application/octet-stream"), f"{stem}{Path(name).suffix}", content
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as pack:
        for name, content in files.items():
            pack.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return "application/zip", f"{stem}.zip", archive.getvalue()
