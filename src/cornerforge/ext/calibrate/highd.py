"""The files beside highD's `XX_tracks.csv`: `XX_recordingMeta.csv` (frame rate, lane markings), `XX_tracksMeta.csv`.

Source: Krajewski et al. (2018), and the format description on highD's site. Decisions need the frame rate only; lane
markings are looked at for a file in feet, and make the road of recorded traffic, as classes make its vehicles.
"""

from __future__ import annotations

import csv
import gzip
import io
import os
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cornerforge._files import check_regular
from cornerforge.errors import DataError
from cornerforge.ext.calibrate.dialects import dialect_of

__all__ = ["RecordingMeta", "is_companion", "read_classes", "read_recording_meta"]

_COMPANIONS = re.compile(r".*_(recordingmeta|tracksmeta)\.csv(\.gz)?", re.IGNORECASE)
_TRACKS = re.compile(r"(.*)_tracks\.csv(\.gz)?", re.IGNORECASE)
_WIDEST_LANE = 7.0


@dataclass(frozen=True)
class RecordingMeta:
    """The contents of a recording's meta file.

    Attributes:
        frames_per_second: Frame rate.
        upper, lower: Lane markings of the two directions, as `y` in the tracks, rising [m]; empty: not given. Traffic
            of the upper ones drives towards falling `x`.
    """

    frames_per_second: float = field(metadata={"unit": "1/s"})
    upper: tuple[float, ...] = field(default=(), metadata={"unit": "m"})
    lower: tuple[float, ...] = field(default=(), metadata={"unit": "m"})

    def notes(self, file: str) -> list[str]:
        """Return a note if lanes are too wide to be in metres: 3.5 to 4 m are 11 to 13 ft."""
        widths = np.concatenate([np.diff(self.upper), np.diff(self.lower)])
        if not widths.size or np.median(widths) <= _WIDEST_LANE:
            return []
        return [
            f"{file}: lanes are {np.median(widths):.1f} m wide, where 3.5 to 4 m are usual: is the recording in feet? "
            "Convert it to metres first (1 ft = 0.3048 m)."
        ]


def is_companion(path: Path) -> bool:
    """Tell whether a file accompanies a tracks file and holds no tracks itself."""
    return _COMPANIONS.fullmatch(path.name) is not None


def read_recording_meta(tracks: Path) -> RecordingMeta | None:
    """Read the meta file beside a tracks file (`01_tracks.csv`: `01_recordingMeta.csv`); None if it does not exist.

    Each of the two may be packed (`.csv.gz`).

    Raises:
        DataError: The meta file holds no usable frame rate, or there are two.
    """
    path = _beside(tracks, "recordingMeta")
    if path is None:
        return None
    row = next(iter(_read_rows(path)), {})
    text = row.get("frameRate") or ""
    try:
        rate = float(text.replace(",", "."))
    except ValueError:
        rate = 0.0
    if not 1.0 <= rate <= 1000.0:
        raise DataError(
            f'Recording meta file {path} has frameRate "{text}", line 2; a number from 1 to 1000 is needed.'
        )
    return RecordingMeta(rate, _markings(row.get("upperLaneMarkings")), _markings(row.get("lowerLaneMarkings")))


def read_classes(tracks: Path) -> dict[str, str]:
    """Read the class of each vehicle, in small letters, from `XX_tracksMeta.csv` beside a tracks file; {} without it.

    Raises:
        DataError: The file cannot be read, names no vehicle, or not the class of one, or there are two.
    """
    path = _beside(tracks, "tracksMeta")
    if path is None:
        return {}
    rows = _read_rows(path)
    if not rows:
        raise DataError(f"Tracks meta file {path} names no vehicle; a row with id and class is needed for each.")
    for line, row in enumerate(rows, 2):
        for name in ("id", "class"):
            if not (row.get(name) or "").strip():
                raise DataError(f"Tracks meta file {path} has no {name}, line {line}; remove the file to read without.")
    return {row["id"].strip(): row["class"].strip().lower() for row in rows}


def _beside(tracks: Path, what: str) -> Path | None:
    """Find the file of a kind that belongs to a tracks file."""
    named = _TRACKS.fullmatch(tracks.name)
    if named is None:
        return None
    plain = tracks.with_name(f"{named.group(1)}_{what}.csv")
    # A broken link counts as existing: reading it reports the error.
    found = [path for path in (plain, plain.with_name(f"{plain.name}.gz")) if os.path.lexists(path)]
    if len(found) == 2:
        raise DataError(f"{found[0]} stands there twice, plain and packed; remove one of them.")
    return found[0] if found else None


def _read_rows(path: Path) -> list[dict[str, str]]:
    opened = gzip.open if path.suffix == ".gz" else open
    try:
        check_regular(path)
        with opened(path, "rb") as file:
            content = file.read()
        dialect = dialect_of(content[:65536])[0]
        encoding = "utf-8" if dialect.encoding == "latin1" else dialect.encoding
        text = io.StringIO(content.decode(encoding).lstrip("\ufeff"), newline="")
        return list(csv.DictReader(text, delimiter=dialect.delimiter))
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"Meta file {path} cannot be read ({error}).") from error


def _markings(text: str | None) -> tuple[float, ...]:
    """Positions across the road, split by ";"; none where one is no number: tracks can be read without."""
    try:
        return tuple(sorted(float(one.replace(",", ".")) for one in (text or "").split(";") if one.strip()))
    except ValueError:
        return ()
