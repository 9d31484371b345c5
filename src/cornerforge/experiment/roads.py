"""Roads by their names, and road files."""

from __future__ import annotations

from pathlib import Path

from cornerforge.errors import FileFormatError, InputError, UnknownNameError
from cornerforge.results.stating import as_json, from_file
from cornerforge.road.network import Road, faults_of
from cornerforge.road.shipped import SHIPPED
from cornerforge.work.files import write_json

__all__ = ["read_road", "road_named", "write_road_file"]


def read_road(name: str | Path) -> Road:
    """Give a road by its name, or read it from a file that `road import` has written, whatever is wrong with it.

    Raises:
        UnknownNameError: No road and no file has this name.
        FileFormatError: The file is damaged.
    """
    if str(name) in SHIPPED:
        return SHIPPED[str(name)]()
    if not Path(name).is_file():
        raise UnknownNameError("road", str(name), SHIPPED)
    road = from_file(Road, Path(name), "cornerforge road import")
    try:
        road.line  # noqa: B018
    except InputError as error:
        raise FileFormatError(f"{name}: {error} Write it again with: cornerforge road import") from error
    return road


def road_named(name: str | Path) -> Road:
    """Give a road that can be driven, as `read_road`.

    Raises:
        UnknownNameError, FileFormatError: As there.
        InputError: The road cannot be driven.
    """
    road = read_road(name)
    if faults := faults_of(road):
        raise InputError(f"{name}: {'; '.join(faults)}.")
    return road


def write_road_file(road: Road, path: Path) -> None:
    """Write a road as JSON with a checksum.

    Raises:
        OutputError: It cannot be written.
    """
    write_json(path, as_json(road))
