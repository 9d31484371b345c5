"""A road on which lanes begin and end as ASAM OpenDRIVE 1.7, and the places of a case in its world.

Slot k is lane k - slots in all sections, so ids of lanes that go on stay: -1 is the leftmost slot. A slot without a
lane keeps its place as a lane of type `none`. Where lanes begin, end or get another marking, a section begins.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.ext.interchange.openscenario_elements import quoted
from cornerforge.ext.interchange.site_lanes import within_a_turn
from cornerforge.library.out_case import safe_name
from cornerforge.report.surface import MARKS, lane_on, marks_between
from cornerforge.road.lanes import lanes_of
from cornerforge.road.network import Lane, Road
from cornerforge.types import Odd

__all__ = ["InWorld", "in_world", "is_plain", "is_straight", "road_file", "road_text"]

_TYPES = {"through": "driving", "acceleration": "entry", "deceleration": "exit", "closed": "restricted"}
_WIDTHS = (2.5, 6.0)
"""Widths of lanes that readers take for lanes [m]."""
_STEP = 1000.0


class InWorld(NamedTuple):
    """Places of a case in the world, arrays of one shape.

    Attributes:
        x, y: [m].
        heading: Of the vehicle [rad].
        road: Direction of the road there [rad].
        bend: Curvature of the vehicle's way along the road, to the left positive [1/m].
        stretch: Metres of the world for one along the reference line: 1 on it, less at the inside of a curve.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    road: NDArray[np.float64]
    bend: NDArray[np.float64]
    stretch: NDArray[np.float64]


def in_world(odd: Odd, x: NDArray[np.float64], y: NDArray[np.float64], heading: NDArray[np.float64]) -> InWorld:
    """Give places of the simulator in the world of the ODD's road; without one the world is the simulator's.

    At a site `road` is the direction of each one's own way.
    """
    if odd.site is not None:
        return InWorld(x, y, within_a_turn(heading), heading, _bend(x, y, heading), np.ones_like(x))
    if odd.road is None:
        return InWorld(x, y, heading, np.zeros_like(x), np.zeros_like(x), np.ones_like(x))
    pose = odd.road.pose_at(x + odd.road_at, y)
    stretch = 1.0 / (1.0 + pose.curvature * odd.road.aside(y))
    return InWorld(pose.x, pose.y, pose.heading + heading, pose.heading, pose.curvature, stretch)


def _bend(x: NDArray[np.float64], y: NDArray[np.float64], heading: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the curvature of ways from frame to frame, (F, N) [1/m]; 0 where one stands, comes or goes."""
    if len(x) < 2:
        return np.zeros_like(x)
    way = np.hypot(np.gradient(x, axis=0), np.gradient(y, axis=0))
    turn = np.gradient(heading, axis=0)
    moves = np.isfinite(turn) & (way > 0.05)
    return np.where(moves, turn / np.where(moves, way, 1.0), 0.0)


def is_straight(road: Road) -> bool:
    """Say whether distances in the simulator are those in the world: no curves, and slots as far apart as there."""
    even = np.allclose(np.diff(road.centres), road.lane_width, rtol=0.0, atol=1e-6)
    return bool(even) and road.line.tightest == float("inf") and not (road.line.gaps > 1e-6).any()


def is_plain(road: Road) -> bool:
    """Say whether a road is as the simulator's without one: straight, its lanes go on and may be left all along."""
    inner = [(one.left, one.slot + 1) for one in road.lanes] + [(one.right, one.slot) for one in road.lanes]
    free = all(mark.may_cross for marks, border in inner if 0 < border < road.slots for mark in marks)
    whole = all((one.begin, one.end, one.kind) == (0.0, road.length, "through") for one in road.lanes)
    return is_straight(road) and whole and free


def road_file(odd: Odd, road: Road, first: float, last: float) -> tuple[str, str]:
    """Make the file of an ODD's road as OpenDRIVE: its name and its text.

    Its world is that of the road. Where vehicles drive before its begin or after its end, it goes on straight there, by
    whole kilometres. Two files of one name are the same.

    Args:
        odd: The ODD on that road.
        road: Its road.
        first, last: From which x to which x of the simulator there are vehicles [m].

    Raises:
        InputError: No lanes of 2.5 to 6 m have their middles where the slots have theirs.
    """
    first, last = first + odd.road_at, last + odd.road_at
    first = 0.0 if first >= 0.0 else _STEP * math.floor(first / _STEP)
    last = road.length if last <= road.length else _STEP * math.ceil(last / _STEP)
    text = road_text(road, lanes_of(replace(odd, road_at=0.0)), first, last)
    return f"road-{safe_name(road.name)}-{hashlib.sha256(text.encode()).hexdigest()[:8]}.xodr", text


def road_text(road: Road, lanes: Sequence[Lane], first: float, last: float) -> str:
    """Write the lanes of a road from one s to another [m]; `first` is s = 0 of the file. Raises as `road_file`."""
    widths = _widths(road)
    cuts = {first}
    for lane in lanes:
        places = (lane.begin, lane.end, *(mark.s for marks in (lane.left, lane.right) for mark in marks[1:]))
        cuts |= {place for place in places if first < place < last}
    begins = sorted(cuts)
    rows = [[lane_on([one for one in lanes if one.slot == slot], s) for slot in range(road.slots)] for s in begins]
    around: list[list[Lane | None]] = [[], *rows, []]
    sections = "".join(_section(road, widths, s, s - first, *around[k : k + 3]) for k, s in enumerate(begins))
    left = road.centres[-1] + 0.5 * widths[-1]
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="7" name={quoted(road.name)} version="1.00" vendor="cornerforge"/>
  <road name={quoted(road.name)} length="{last - first!r}" id="1" junction="-1" rule="RHT">
    <type s="0" type="motorway"/>
    <planView>
{_plan(road, first, last)}    </planView>
    <elevationProfile><elevation s="0" a="0" b="0" c="0" d="0"/></elevationProfile>
    <lateralProfile/>
    <lanes>
      <laneOffset s="0" a="{left!r}" b="0" c="0" d="0"/>
{sections}    </lanes>
  </road>
</OpenDRIVE>
"""


def _widths(road: Road) -> list[float]:
    """Find widths of the slots, as even as can be, with which their middles lie where the road has them [m]."""
    rest, signs = [0.0], [1.0]
    for apart in np.diff(road.centres).tolist():
        rest.append(2.0 * apart - rest[-1])
        signs.append(-signs[-1])
    even = np.array(signs) * (road.lane_width - np.array(rest))
    widths = np.round(np.array(rest) + np.array(signs) * even.mean(), 9)
    if widths.min() < _WIDTHS[0] or widths.max() > _WIDTHS[1]:
        raise InputError(
            f"The road {road.name} has slots so uneven that no lanes of {_WIDTHS[0]:g} to {_WIDTHS[1]:g} m fill them; "
            "OpenDRIVE cannot hold it."
        )
    return [float(width) for width in widths]


def _plan(road: Road, first: float, last: float) -> str:
    """Write the reference line, prolonged to where the file's road begins and ends."""
    text = ""
    begins = [piece.s for piece in road.pieces]
    starts_straight, ends_straight = (one.curvature == 0.0 == one.change for one in (road.pieces[0], road.pieces[-1]))
    if first < 0.0:
        begins = [first, *begins[starts_straight:]]
    if last > road.length and not ends_straight:
        begins.append(road.length)
    for s, end in itertools.pairwise([*begins, last]):
        piece = next((one for one in road.pieces if one.s == s), None)
        x, y, heading, *_ = (float(part) for part in road.line.at(s)) if piece is None else piece[1:]
        bend, change = (0.0, 0.0) if piece is None else piece[4:]
        shape = f'spiral curvStart="{bend!r}" curvEnd="{bend + change * (end - s)!r}"'
        if change == 0.0:
            shape = f'arc curvature="{bend!r}"' if bend else "line"
        text += (
            f'      <geometry s="{s - first!r}" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{end - s!r}">'
            f"<{shape}/></geometry>\n"
        )
    return text


def _section(road: Road, widths: Sequence[float], s: float, place: float, *rows: Sequence[Lane | None]) -> str:
    """Write the lanes from s on; `rows`: the lanes by slot before, there and after."""
    before, here, after = rows
    lanes = ""
    for slot in reversed(range(road.slots)):
        lane, ident = here[slot], slot - road.slots
        links = "".join(
            f'<{name} id="{ident}"/>'
            for name, row in (("predecessor", before), ("successor", after))
            if row and (row[slot] is None) == (lane is None)
        )
        speed = "" if lane is None or lane.limit is None else f'<speed sOffset="0" max="{lane.limit!r}" unit="m/s"/>'
        lanes += (
            f'          <lane id="{ident}" type="{_type(road, lane)}" level="false"><link>{links}</link>'
            f'<width sOffset="0" a="{widths[slot]!r}" b="0" c="0" d="0"/>'
            f"{_mark(here[slot - 1] if slot else None, lane, s)}{speed}</lane>\n"
        )
    return f"""      <laneSection s="{place!r}">
        <center><lane id="0" type="none" level="false">{_mark(here[-1], None, s)}</lane></center>
        <right>
{lanes}        </right>
      </laneSection>
"""


def _type(road: Road, lane: Lane | None) -> str:
    """Say what OpenDRIVE calls a lane: a ramp from which another lane goes on leads onto the road."""
    if lane is None:
        return "none"
    if lane.kind == "ramp":
        return "offRamp" if road.open_after(lane) is None else "onRamp"
    return _TYPES[lane.kind]


def _mark(right: Lane | None, left: Lane | None, s: float) -> str:
    """Write the line between two lanes; ids of lanes grow to the left."""
    marks = [mark for _, mark in marks_between(right, left, s)]
    may = [mark in ("broken", "wide") for mark in marks]
    names = ["broken" if one else "solid" for one in may]
    change = {(True,): "both", (True, False): "increase", (False, True): "decrease"}.get(tuple(may), "none")
    width = max((MARKS[mark][0] for mark in marks), default=0.0)
    kind = " ".join(reversed(names)) or "none"
    return (
        f'<roadMark sOffset="0" type="{kind}" weight="standard" color="standard" width="{width:g}" '
        f'laneChange="{change}"/>'
    )
