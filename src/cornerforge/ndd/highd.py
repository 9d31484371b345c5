"""The files that stand beside highD's `XX_tracks.csv`: `XX_recordingMeta.csv` holds the frame rate and lane markings.

Source: Krajewski et al. (2018), and the format description on highD's site. Only the frame rate is used; lane markings
are looked at for a file in feet.
"""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cornerforge.errors import DataError

__all__ = ["FRAMES_PER_SECOND", "RecordingMeta", "is_companion", "read_recording_meta"]

FRAMES_PER_SECOND = 25.0
"""Frame rate of every published highD recording; used without a meta file."""
_COMPANIONS = re.compile(r".*_(recordingmeta|tracksmeta)\.csv(\.gz)?", re.IGNORECASE)
_TRACKS = re.compile(r"(.*)_tracks\.csv(\.gz)?", re.IGNORECASE)
_WIDEST_LANE = 7.0


@dataclass(frozen=True)
class RecordingMeta:
    """The contents of a recording's meta file.

    Attributes:
        frames_per_second: Frame rate.
        lane_width: Median over all lanes [m]; NaN where no markings are given.
    """

    frames_per_second: float = field(metadata={"unit": "1/s"})
    lane_width: float = field(metadata={"unit": "m"})

    def notes(self, file: str) -> list[str]:
        """Return a note if lanes are too wide to be in metres: 3.5 to 4 m are 11 to 13 ft."""
        if not self.lane_width > _WIDEST_LANE:
            return []
        return [
            f"{file}: lanes are {self.lane_width:.1f} m wide, where 3.5 to 4 m are usual: is the recording in feet? "
            "Convert it to metres first (1 ft = 0.3048 m)."
        ]


def is_companion(path: Path) -> bool:
    """Tell whether a file accompanies a tracks file and holds no tracks itself."""
    return _COMPANIONS.fullmatch(path.name) is not None


def read_recording_meta(tracks: Path) -> RecordingMeta | None:
    """Read the meta file beside a tracks file (`01_tracks.csv`: `01_recordingMeta.csv`); None if there is none.

    Each of the two may be packed (`.csv.gz`).

    Raises:
        DataError: The meta file holds no usable frame rate, or there are two.
    """
    named = _TRACKS.fullmatch(tracks.name)
    if named is None:
        return None
    plain = tracks.with_name(f"{named.group(1)}_recordingMeta.csv")
    found = [path for path in (plain, plain.with_name(f"{plain.name}.gz")) if path.is_file()]
    if not found:
        return None
    if len(found) == 2:
        raise DataError(f"{found[0]} stands there twice, plain and packed; remove one of them.")
    path = found[0]
    opened = gzip.open if path.suffix == ".gz" else open
    try:
        with opened(path, "rt", encoding="utf-8-sig", newline="") as file:
            row = next(csv.DictReader(file), {})
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"Recording meta file {path} cannot be read ({error}).") from error
    text = row.get("frameRate") or ""
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 1.0 <= rate <= 1000.0:
        raise DataError(
            f'Recording meta file {path} has frameRate "{text}", line 2; a number from 1 to 1000 is needed.'
        )
    return RecordingMeta(rate, _lane_width([row.get("upperLaneMarkings"), row.get("lowerLaneMarkings")]))


def _lane_width(markings: list[str | None]) -> float:
    """Return the median distance of neighbouring markings; each text lists positions across the road, split by ";"."""
    widths: list[float] = []
    for text in markings:
        try:
            widths += np.diff([float(part) for part in (text or "").split(";") if part.strip()]).tolist()
        except ValueError:  # the width only serves to check the units
            continue
    return float(np.median(np.abs(widths))) if widths else float("nan")
