"""The road of a case as ASAM OpenDRIVE."""

from __future__ import annotations

import math
from pathlib import Path

from cornerforge._checks import check_number
from cornerforge._files import writing
from cornerforge.errors import OutputError
from cornerforge.ext.interchange.opendrive_lanes import road_file
from cornerforge.types import Odd

__all__ = ["FIRST_METRE", "LAST_METRE", "lane_id", "road_name", "write_road", "write_road_once"]

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


def write_road(odd: Odd, path: Path, *, first: float = FIRST_METRE, last: float = LAST_METRE) -> None:
    """Write the road of an ODD as OpenDRIVE 1.7.

    One straight, level road in the direction of travel. Its reference line is the left edge, at y = lanes x lane width,
    so x and y in the file are ours: x along the road, y = 0 at its right edge, to the left. All lanes lie to the right
    of that line and have negative numbers: -1 is the leftmost, -n the rightmost, which is our lane 0 (`lane_id`). Each
    lane has the ODD's highest speed as its speed limit [m/s].

    Args:
        odd: Number of lanes, their width, and the highest speed.
        path: Where to write it.
        first, last: From which x to which x it goes [m].

    Raises:
        InputError: It is no road: `first` is not left of `last`, or not finite.
        OutputError: It cannot be written.
    """
    _write(path, _road(odd, first, last))


def _write(path: Path, text: str) -> None:
    with writing(path, "the road") as part:
        part.write_text(text, encoding="utf-8")


def write_road_once(odd: Odd, folder: Path, first: float, last: float) -> str:
    """Write the road of a case into the folder of the cases, unless it is there; return its name.

    Several processes may do so at the same time.

    Args:
        odd: The road.
        folder: Folder of the cases.
        first, last: From which x to which x there are vehicles [m].

    Raises:
        InputError: OpenDRIVE cannot hold it.
        OutputError: It cannot be written.
    """
    if odd.road is None:
        first, last = road_reach(first, last)
        name, text = road_name(odd, first, last), _road(odd, first, last)
    else:
        name, text = road_file(odd, odd.road, first, last)
    path, wanted = folder / name, text.encode()
    for tries_left in (2, 1, 0):
        if path.is_file() and path.read_bytes() == wanted:
            break
        try:
            _write(path, text)
        except OutputError:  # or another process has just put it there: both write under one name before they rename it
            if tries_left == 0:
                raise
    return name


def _short(number: float) -> str:
    return str(int(number)) if number == int(number) else repr(float(number))


def _road(odd: Odd, first: float, last: float) -> str:
    check_number("first metre of the road", first, low=-1e6, high=1e6, unit="m")
    check_number("last metre of the road", last, low=first + 1.0, high=1e7, unit="m")
    width, speed = float(odd.lane_width), float(odd.max_speed)
    left = odd.n_lanes * width
    lanes = "".join(_lane(-number, width, speed, outer=number == odd.n_lanes) for number in range(1, odd.n_lanes + 1))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="7" name="{odd.n_lanes} lanes of {width:g} m" version="1.00" \
north="{left!r}" south="0" east="{last!r}" west="{first!r}" vendor="cornerforge"/>
  <road name="straight" length="{last - first!r}" id="1" junction="-1" rule="RHT">
    <type s="0" type="motorway"/>
    <planView>
      <geometry s="0" x="{first!r}" y="{left!r}" hdg="0" length="{last - first!r}"><line/></geometry>
    </planView>
    <elevationProfile><elevation s="0" a="0" b="0" c="0" d="0"/></elevationProfile>
    <lateralProfile/>
    <lanes>
      <laneSection s="0">
        <center><lane id="0" type="none" level="false">{_mark("solid")}</lane></center>
        <right>
{lanes}        </right>
      </laneSection>
    </lanes>
  </road>
</OpenDRIVE>
"""


def _lane(number: int, width: float, speed: float, *, outer: bool) -> str:
    return (
        f'          <lane id="{number}" type="driving" level="false">'
        f'<width sOffset="0" a="{width!r}" b="0" c="0" d="0"/>{_mark("solid" if outer else "broken")}'
        f'<speed sOffset="0" max="{speed!r}" unit="m/s"/></lane>\n'
    )


def _mark(kind: str) -> str:
    return f'<roadMark sOffset="0" type="{kind}" weight="standard" color="standard" width="0.15"/>'
