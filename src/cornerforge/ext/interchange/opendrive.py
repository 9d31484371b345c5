"""The road of a case as ASAM OpenDRIVE."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from cornerforge._checks import check_number
from cornerforge._files import writing
from cornerforge.errors import OutputError
from cornerforge.ext.interchange.opendrive_lanes import road_file, road_text
from cornerforge.ext.interchange.opendrive_site import site_file
from cornerforge.road.lanes import lanes_of
from cornerforge.road.network import Road
from cornerforge.road.reference import Piece
from cornerforge.types import Odd

__all__ = ["FIRST_METRE", "LAST_METRE", "lane_id", "road_name", "write_road_once"]

FIRST_METRE, LAST_METRE = -1000.0, 5000.0
"""Ends of the road of a case [m], if that is enough."""
_STEP = 1000.0
_SPEED_OF_NAME = 40.0
"""Speed limit of the built-in ODDs [m/s]; a road with this limit does not name it."""


def lane_id(lane: int, lanes: int) -> int:
    """Number of a lane in OpenDRIVE: -1 is the leftmost, -`lanes` the rightmost, which is lane 0 here.

    >>> [lane_id(lane, 3) for lane in range(3)]
    [-3, -2, -1]
    """
    return lane - lanes


def road_reach(first: float, last: float) -> tuple[float, float]:
    """Say from where to where a road goes [m] on which vehicles are from `first` to `last`: few roads serve all cases.

    >>> road_reach(12.0, 900.0), road_reach(12.0, 5432.1)
    ((-1000.0, 5000.0), (-1000.0, 6000.0))
    """
    return (
        min(FIRST_METRE, _STEP * math.floor(first / _STEP)),
        max(LAST_METRE, _STEP * math.ceil(last / _STEP)),
    )


def road_name(odd: Odd, first: float = FIRST_METRE, last: float = LAST_METRE) -> str:
    """Name of a road's file: two roads of one name are the same road.

    >>> road_name(Odd()), road_name(Odd(n_lanes=2, lane_width=3.75, max_speed=50.0), -1000.0, 6000.0)
    ('road-3x3.66.xodr', 'road-2x3.75-50mps_-1000_6000.xodr')
    """
    width = float(odd.lane_width)
    named = f"{width:.2f}" if round(width, 2) == width else repr(width)
    speed = "" if odd.max_speed == _SPEED_OF_NAME else f"-{_short(odd.max_speed)}mps"
    reach = "" if (first, last) == (FIRST_METRE, LAST_METRE) else f"_{_short(first)}_{_short(last)}"
    return f"road-{odd.n_lanes}x{named}{speed}{reach}.xodr"


def write_road_once(odd: Odd, folder: Path, first: float, last: float) -> str:
    """Write the road of a case into the folder of the cases as OpenDRIVE 1.7, unless it is there; return its name.

        Several processes may do so at the same time. Without a road of its own an ODD has a straight, level one: x
    and y in     the file are ours, its reference line is the left edge, and each lane has the ODD's highest speed as
    its limit.     A site is written by `opendrive_site`, in its own plane. Lanes lie to the right of the reference
    line: -1 is the leftmost, -n the rightmost, our lane 0 (`lane_id`).

    Args:
        odd: The road.
        folder: Folder of the cases.
        first, last: From which x to which x there are vehicles [m].

    Raises:
        InputError: OpenDRIVE cannot hold it, or vehicles are too far off.
        OutputError: It cannot be written.
    """
    if odd.site is not None:
        name, text = site_file(odd.site)
    elif odd.road is None:
        first, last = road_reach(first, last)
        name, text = road_name(odd, first, last), _road(odd, first, last)
    else:
        name, text = road_file(odd, odd.road, first, last)
    path, wanted = folder / name, text.encode()
    for tries_left in (2, 1, 0):
        if path.is_file() and path.read_bytes() == wanted:
            break
        try:
            with writing(path, "the road") as part:
                part.write_text(text, encoding="utf-8")
        except OutputError:  # or another process has just put it there: both write under one name before they rename it
            if tries_left == 0:
                raise
    return name


def _short(number: float) -> str:
    return str(int(number)) if number == int(number) else repr(float(number))


def _road(odd: Odd, first: float, last: float) -> str:
    check_number("first metre of the road", first, low=-1e6, high=1e6, unit="m")
    check_number("last metre of the road", last, low=first + 1.0, high=1e7, unit="m")
    width, length = float(odd.lane_width), last - first
    begin = Piece(0.0, first, odd.n_lanes * width, 0.0)
    lanes = [replace(lane, limit=float(odd.max_speed)) for lane in lanes_of(odd)]
    middles = tuple(lane_id(slot, odd.n_lanes) * width + 0.5 * width for slot in range(odd.n_lanes))
    name = f"{odd.n_lanes} lanes of {width:g} m"
    return road_text(Road(name, (begin,), length, width, middles, tuple(lanes)), lanes, 0.0, length)
