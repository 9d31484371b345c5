"""Reads recorded CommonRoad scenarios, 2020a XML, of motorways.

The road is the one that the AV starts on: its lanelet with what goes before and after it, and the lanelets beside that
which go the same way. It must be straight or a gentle curve (`straightening`). Lanes get one width, the mean. Vehicles
are the obstacles with exact states and a rectangle of a vehicle's size, parked ones included; all else stands in the
notes, with its line and how near it comes, or is refused if it is in the AV's way (`left_out`). Kinds of lanelets, line
markings and permitted users of a lane have no effect here and are not listed.

Coordinates: x along the road from the foot of the file's origin, or from the AV's start where the origin is more than
10 km off; y from the right edge of the rightmost lane. The first frame is the AV's first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError
from cornerforge.ext.interchange.commonroad import facts_of_source
from cornerforge.ext.interchange.differences import jumps, rates
from cornerforge.ext.interchange.left_out import gaps, in_lanes, nearest, within
from cornerforge.ext.interchange.straightening import Course, course_along
from cornerforge.ext.interchange.xml_input import Element, read_xml
from cornerforge.library.out_case import ONE_LANE, Fact, MovingCase, safe_name, straight_road
from cornerforge.types import CAR, FRAME_S, MOTORCYCLE, TRUCK, Odd

__all__ = ["read_commonroad"]

_VERSION = "2020a"
_KINDS = {
    "car": CAR, "taxi": CAR, "priorityVehicle": CAR, "unknown": CAR, "truck": TRUCK, "bus": TRUCK,
    "motorcycle": MOTORCYCLE, "parkedVehicle": CAR,
}  # fmt: skip
_AS_THEY_ARE = ("car", "truck", "motorcycle")
_SIZE = (5.0, 2.0)
"""Length and width [m] of our cars, for an AV of which the file gives only the start."""
_SIZES = {"length": (0.5, 30.0), "width": (0.3, 4.0)}
"""Sizes of vehicles that are read [m]."""
_SAME_PLACE = 0.1
"""An obstacle that starts this near to the planning problem [m] is the AV, recorded."""
_FARTHEST = 1e7
_FAR_OFF = 1e4
_LONGEST_S = 600.0
_MOST_OBSTACLES = 1_000
"""Many may be on other roads; how many can be driven, `straight_road` says."""
_ON_LANE = 3.0
"""How far the AV may start from the middle of its lanelet [m]."""
_ALIGNED = 0.5
_DRIFT = 1.0
"""A lanelet with a middle that moves sideways by more, along the road, is not one of its lanes [m]."""
_UNEVEN = 0.3
_SHORT = 10.0
_SWAYS = 0.25
"""Slower sideways is no lane change [m/s]."""
_OBSTACLES = ("dynamicObstacle", "staticObstacle")
_ACROSS = 0.5
_ASTRAY = "it is not where its velocity takes it (jumps, or other units)"
_PLACED = ("lanelet", *_OBSTACLES, "planningProblem", "location", "scenarioTags")


@dataclass(frozen=True)
class _Lanelet:
    """A lanelet: its bounds (P, 2), the same number of points each [m]."""

    element: Element
    name: int
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    @property
    def middle(self) -> NDArray[np.float64]:
        """Centre line (P, 2) [m]."""
        return 0.5 * (self.left + self.right)


@dataclass(frozen=True)
class _Track:
    """A vehicle of the file.

    Attributes:
        element, name: Where it stands, and its id.
        kind: Its class.
        length, width: [m].
        states: Time step, x, y, orientation, velocity, acceleration, (S, 6), steps ascending; NaN where not given.
        recorded: False: only where it starts is known.
        why_not: Why it cannot be carried over; empty: it can. If it cannot, it may have no states.
    """

    element: Element
    name: int
    kind: int
    length: float
    width: float
    states: NDArray[np.float64]
    recorded: bool = True
    why_not: str = ""

    @property
    def stands(self) -> bool:
        """Whether it is static: where it is in its only state it always is."""
        return self.element.tag == "staticObstacle"


@dataclass(frozen=True)
class _Road:
    """The road that the AV is on.

    Attributes:
        course: Its line.
        lanes: How many.
        right: Where its right edge is, to the left of the line [m].
        width: Width of a lane [m].
    """

    course: Course
    lanes: int
    right: float
    width: float


@dataclass
class _Notes:
    """Elements that are not carried over, in the order of the lines."""

    lines: list[tuple[int, str]] = field(default_factory=list)

    def say(self, element: Element, what: str) -> None:
        """Note something about an element."""
        self.lines.append((element.line, what))

    def all(self) -> tuple[str, ...]:
        """Give all notes."""
        return tuple(f"line {line}: {what}" for line, what in sorted(self.lines, key=lambda note: note[0]))


def read_commonroad(path: Path, *, ego: int | None = None) -> MovingCase:
    """Read a scenario.

    Args:
        path: The file.
        ego: Id of the obstacle, or of the planning problem, that is the AV. None: the first planning problem; if an
            obstacle starts in the same place, that obstacle, so that what the AV did is known.

    Raises:
        InputError: The file is missing, no AV has that id, nothing says which vehicle is the AV, or the road and its
            vehicles are beyond what can be driven (`straight_road`).
        FileFormatError: It is no whole XML file, no CommonRoad scenario, or one of another version.
        DataError: A number is missing, none, or impossible; the road is neither straight nor a gentle curve.
    """
    root = read_xml(path, root="commonRoad", what="a CommonRoad scenario")
    version = root.string("commonRoadVersion", "none")
    if version != _VERSION:
        raise FileFormatError(
            f'{root.place}: this scenario is of version "{version[:40]}"; {_VERSION} is read. Have commonroad-io read '
            "it and write it again as XML."
        )
    step_s = root.number("timeStepSize", low=0.01, high=1.0, unit="s")
    notes = _Notes()
    _note_the_rest(root, notes)
    tracks = _read_tracks(root, _LONGEST_S / step_s, notes)
    av = _choose_av(root, [t for t in tracks if not (t.why_not or t.stands)], ego, notes)
    road = _find_road([_read_lanelet(element) for element in root.all("lanelet")], av, root, notes)
    others = [track for track in tracks if track is not av]
    return _make_case(root, road, av, others, step_s, notes)


def _note_the_rest(root: Element, notes: _Notes) -> None:
    """Note elements that are never carried over."""
    for element in root.children:
        if element.tag not in _PLACED:
            notes.say(element, f"{_named(element)} is not carried over.")
        for signals in element.all("initialSignalState", "signalSeries", "stopLine"):
            notes.say(signals, f"{signals.tag} of {_named(element)} is not carried over.")
        if element.tag == "planningProblem" and element.child("goalState") is not None:
            notes.say(element.need("goalState"), f"The goal of {_named(element)} is not carried over.")


def _named(element: Element) -> str:
    name = element.attributes.get("id", "")
    return f"{element.tag} {name[:20]}" if name else element.tag


# Vehicles


def _read_tracks(root: Element, most_steps: float, notes: _Notes) -> list[_Track]:
    """Read all obstacles, those included that cannot be carried over."""
    found = list(root.all(*_OBSTACLES))
    if len(found) > _MOST_OBSTACLES:
        raise InputError(
            f"{root.file}: there are {len(found):,} obstacles; up to {_MOST_OBSTACLES:,} are read. Keep those near."
        )
    tracks = [track for element in found for track in _tracks_of(element, int(most_steps), notes)]
    seen: set[int] = set()
    for track in tracks:
        if track.name in seen and not track.why_not:
            track.element.fault(f"there are several obstacles of id {track.name}; give each its own")
        seen.add(track.name)
    return tracks


def _unusable(element: Element) -> str:
    """Say why an obstacle cannot be carried over; empty: it can."""
    kind, shape = element.need("type").text, element.need("shape")
    if kind not in _KINDS or (kind == "unknown" and element.tag == "staticObstacle"):
        return f'"{kind[:20]}" is no vehicle that can be driven here'
    if [part.tag for part in shape.children] != ["rectangle"]:
        return "its shape is not one rectangle"
    for name, (low, high) in _SIZES.items():
        meters = shape.need("rectangle", name).number(None)
        if not low <= meters <= high:
            return f"its {name} is {meters:g} m; {low:g} to {high:g} m can be driven"
    if element.child("occupancySet") is not None:
        return "where it may be is a set of places, not a trajectory"
    for state in _states_of(element):
        for name in ("position", "orientation", "time", "velocity", "acceleration"):
            value = state.child(name)
            if value is not None and value.child("point" if name == "position" else "exact") is None:
                return f"its {name} is not exact"
    return ""


def _states_of(element: Element) -> list[Element]:
    trajectory = element.child("trajectory")
    later = [] if trajectory is None else list(trajectory.all("state"))
    return [element.need("initialState"), *later]


def _tracks_of(element: Element, most_steps: int, notes: _Notes) -> list[_Track]:
    """Read an obstacle: one track, or, if it cannot be carried over, one for each part of its shape."""
    why_not, kind = _unusable(element), element.need("type")
    if not why_not and kind.text not in _AS_THEY_ARE:
        like = {CAR: "car", TRUCK: "truck", MOTORCYCLE: "motorcycle"}[_KINDS[kind.text]]
        notes.say(kind, f'{_named(element)} is "{kind.text}"; it is taken as a {like} of its size.')
    try:
        boxes = [_box(part) for part in element.need("shape").children]
        states = np.array([_read_state(state, most_steps) for state in _states_of(element)])
    except CornerForgeError:
        if not why_not:
            raise
        boxes, states = [], np.empty((0, 6))
    states = states[np.argsort(states[:, 0], kind="stable")]
    again = np.concatenate([[False], np.diff(states[:, 0]) == 0])
    if again.any():
        before, after = np.nan_to_num(states[:-1][again[1:]]), np.nan_to_num(states[again])
        if not np.array_equal(before, after):
            why_not = "it has two different states at one time step"
        else:
            notes.say(element, f"{_named(element)} has {again.sum()} state(s) twice; each counts once.")
        states = states[~again]
    name = 0 if why_not else element.integer("id", low=1, high=2**62)
    return [
        _Track(element, name, _KINDS.get(kind.text, CAR), length, width, _placed(states, *where), True, why_not)
        for length, width, *where in boxes or [(0.0,) * 5]
    ]


def _box(part: Element) -> tuple[float, ...]:
    """Give length and width of a part of a shape, how far ahead and to the left of its place it is, and its turn."""
    center, turn = part.child("center"), part.child("orientation")
    x, y = (0.0, 0.0) if center is None else _point(center)
    if part.tag == "polygon":
        points = np.array([_point(point) for point in (part.need("point"), *part.all("point"))])
        (length, width), (x, y) = np.ptp(points, axis=0), 0.5 * (points.min(axis=0) + points.max(axis=0))
    elif part.tag == "circle":
        length = width = 2.0 * part.need("radius").number(None, low=0.0)
    else:
        length, width = (part.need(name).number(None) for name in _SIZES)
    return length, width, x, y, 0.0 if turn is None else _angle(turn)


def _placed(states: NDArray[np.float64], ahead: float, left: float, turn: float) -> NDArray[np.float64]:
    """Move states (S, 6) to the middle of a box."""
    cos, sin, zero = np.cos(states[:, 3]), np.sin(states[:, 3]), np.zeros(len(states))
    off = zero, ahead * cos - left * sin, ahead * sin + left * cos, zero + turn, zero, zero
    return np.asarray(states + np.stack(off, axis=1))


def _read_state(state: Element, most_steps: int) -> list[float]:
    """Read time step, x, y, orientation, velocity and acceleration; NaN: not given."""
    x, y = _point(state.need("position", "point"))
    time = state.need("time", "exact").integer(None, low=0, high=most_steps)
    moving = [state.child(name, "exact") for name in ("velocity", "acceleration")]
    numbers = [math.nan if value is None else value.number(None, low=-1e3, high=1e3) for value in moving]
    return [float(time), x, y, _angle(state.need("orientation", "exact")), *numbers]


def _angle(element: Element) -> float:
    return element.number(None, low=-100.0, high=100.0, unit="rad")


def _point(element: Element) -> tuple[float, float]:
    x, y = (element.need(name).number(None, low=-_FARTHEST, high=_FARTHEST, unit="m") for name in ("x", "y"))
    return x, y


def _choose_av(root: Element, tracks: list[_Track], ego: int | None, notes: _Notes) -> _Track:
    """Find the AV among planning problems and obstacles."""
    problems = list(root.all("planningProblem"))
    named = {str(track.name): track for track in tracks}
    if ego is not None and str(ego) in named:
        chosen = named[str(ego)]
        for problem in problems:
            notes.say(problem, f"{_named(problem)} is not carried over: the AV is obstacle {ego}.")
        return chosen
    if ego is not None:
        problems.sort(key=lambda problem: problem.attributes.get("id") != str(ego))
    if not problems or (ego is not None and problems[0].attributes.get("id") != str(ego)):
        ids = ", ".join(list(named)[:10]) or "none"
        asked = "No planning problem says who is the AV" if ego is None else f"No vehicle of id {ego} can be the AV"
        raise InputError(f"{root.file}: {asked}. Name an obstacle; ids: {ids}{', ...' if len(named) > 10 else ''}.")
    for problem in problems[1:]:
        notes.say(problem, f"{_named(problem)} is not carried over: one AV drives, that of {_named(problems[0])}.")
    return _track_of_problem(root, problems[0], tracks, notes)


def _track_of_problem(root: Element, problem: Element, tracks: list[_Track], notes: _Notes) -> _Track:
    """Make the AV of a planning problem, or find the obstacle that starts in its place."""
    start = _read_state(problem.need("initialState"), 0)
    for track in tracks:
        first = track.states[0]
        if first[0] == start[0] and math.hypot(first[1] - start[1], first[2] - start[2]) <= _SAME_PLACE:
            return track
    facts = facts_of_source(root.attributes.get("source", ""))
    given = facts.get("av_length_m"), facts.get("av_width_m")
    if isinstance(given[0], (int, float)) and isinstance(given[1], (int, float)):
        length, width = float(given[0]), float(given[1])
    else:
        length, width = _SIZE
        notes.say(problem, f"The AV has no size in the file; it is {length:g} m x {width:g} m here.")
    name = problem.integer("id", low=1, high=2**62)
    return _Track(problem, name, CAR, length, width, np.array([start]), recorded=False)


# The road


def _read_lanelet(element: Element) -> _Lanelet:
    bounds = []
    for name in ("leftBound", "rightBound"):
        points = np.array([_point(point) for point in element.need(name).all("point")])
        if len(points) < 2:
            element.need(name).fault(f"{name} of {_named(element)} has fewer than two points")
        bounds.append(points)
    if len(bounds[0]) != len(bounds[1]):
        most = max(len(bound) for bound in bounds)
        bounds = [_spread(bound, most) for bound in bounds]
    return _Lanelet(element, element.integer("id", low=-(2**62), high=2**62), *bounds)


def _spread(line: NDArray[np.float64], points: int) -> NDArray[np.float64]:
    """Spread that many points evenly over a line (P, 2)."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, way[-1], points)
    return np.stack([np.interp(at, way, line[:, axis]) for axis in range(2)], axis=1)


def _find_road(lanelets: list[_Lanelet], av: _Track, root: Element, notes: _Notes) -> _Road:
    """Find the road that the AV starts on: its line, and the lanes beside one another."""
    own = _lanelet_below(lanelets, av, root)
    course = course_along(_line_through(lanelets, own), own.element.place)
    if not course.is_straight:
        notes.say(
            own.element,
            f"The road is a curve with a radius of {course.radius:,.0f} m; it is straightened, so lengths change by "
            f"{100.0 / course.radius:.2g} % for each metre beside the middle of {_named(own.element)}.",
        )
    sides = {
        lanelet.name: _sides_on(course, lanelet)
        for lanelet in lanelets
        if _is_lane_of(course, lanelet) or lanelet is own
    }
    edges, used = _edges(sides, own.name)
    for lanelet in lanelets:
        if lanelet.name not in used:
            notes.say(
                lanelet.element, f"{_named(lanelet.element)} is not carried over: it is no lane of the AV's road."
            )
    lanes = len(edges) - 1
    width = (edges[-1] - edges[0]) / lanes
    if not 2.5 <= width <= 6.0:
        raise DataError(
            f"{own.element.place}: lanes are {width:.3g} m wide; 2.5 to 6 m can be driven. Is the file in metres?"
        )
    uneven = float(np.abs(edges - np.linspace(edges[0], edges[-1], lanes + 1)).max())
    if uneven > _UNEVEN:
        widths = np.diff(edges)
        notes.say(
            own.element,
            f"Lanes are {widths.min():.2f} to {widths.max():.2f} m wide; each is {width:.2f} m here, so markings are "
            f"up to {uneven:.2f} m off.",
        )
    _note_short_lanes([lanelet for lanelet in lanelets if lanelet.name in used], course, own, edges, notes)
    return _Road(course, lanes, float(edges[0]), float(width))


def _lanelet_below(lanelets: Sequence[_Lanelet], av: _Track, root: Element) -> _Lanelet:
    """Find the lanelet that the AV starts on: the nearest that goes its way."""
    at, way = av.states[0, 1:3], av.states[0, 3]
    best, least = None, _ON_LANE
    for lanelet in lanelets:
        line = lanelet.middle
        steps = np.diff(line, axis=0)
        lengths = np.maximum(np.hypot(*steps.T), 1e-9)
        share = np.clip(((at - line[:-1]) * steps).sum(axis=1) / lengths**2, 0.0, 1.0)
        off = np.hypot(*(at - line[:-1] - share[:, None] * steps).T)
        nearest = int(off.argmin())
        turned = way - math.atan2(steps[nearest, 1], steps[nearest, 0])
        if off[nearest] < least and math.cos(turned) > math.cos(_ALIGNED):
            best, least = lanelet, float(off[nearest])
    if best is None:
        raise DataError(
            f"{av.element.place}: the AV, {_named(av.element)}, starts on no lanelet that goes its way: none has its "
            f"middle within {_ON_LANE:g} m. {len(list(root.all('lanelet'))):,} lanelets were looked at."
        )
    return best


def _line_through(lanelets: Sequence[_Lanelet], own: _Lanelet) -> NDArray[np.float64]:
    """Join the middle of a lanelet with what goes before and after it, (P, 2), where that is the only way."""
    named = {str(lanelet.name): lanelet for lanelet in lanelets}
    chain, seen = [own], {own.name}
    for tag, end in (("successor", -1), ("predecessor", 0)):
        while True:
            refs = [element.attributes.get("ref", "") for element in chain[end].element.all(tag)]
            following = [named[ref] for ref in refs if ref in named and named[ref].name not in seen]
            if len(following) != 1:
                break
            seen.add(following[0].name)
            chain.insert(len(chain) if end else 0, following[0])
    return np.concatenate([lanelet.middle for lanelet in chain])


def _is_lane_of(course: Course, lanelet: _Lanelet) -> bool:
    """Does a lanelet go along the road, the same way?"""
    placed = course.place(lanelet.middle)
    return bool(placed.along[-1] > placed.along[0] and np.ptp(placed.across) <= _DRIFT)


def _sides_on(course: Course, lanelet: _Lanelet) -> tuple[float, float]:
    """Say where a lanelet's right and left side are beside the road's line [m]."""
    right, left = (float(np.median(course.place(side).across)) for side in (lanelet.right, lanelet.left))
    return right, left


def _edges(sides: dict[int, tuple[float, float]], own: int) -> tuple[NDArray[np.float64], set[int]]:
    """Find all lanes side by side: their edges from right to left [m], and the lanelets that make them."""
    right, left = sides[own]
    lanes = [(right, left)]
    used: set[int] = set()
    for to_left in (True, False):
        near, far = lanes[-1 if to_left else 0]
        while True:
            width = far - near
            used |= {name for name, (a, b) in sides.items() if abs(0.5 * (a + b - near - far)) < 0.4 * width}
            beside = [
                side
                for side in sides.values()
                if abs((side[0] - far) if to_left else (side[1] - near)) < 0.4 * width and side[1] > side[0]
            ]
            if not beside:
                break
            near, far = (float(number) for number in np.mean(beside, axis=0))
            lanes.insert(len(lanes) if to_left else 0, (near, far))
    inner = [0.5 * (lanes[i][1] + lanes[i + 1][0]) for i in range(len(lanes) - 1)]
    return np.array([lanes[0][0], *inner, lanes[-1][1]]), used


def _note_short_lanes(
    used: Sequence[_Lanelet], course: Course, own: _Lanelet, edges: NDArray[np.float64], notes: _Notes
) -> None:
    """Note lanes that begin or end on the way: here all are as long as the road."""
    reach: dict[int, list[float]] = {}
    for lanelet in used:
        placed = course.place(lanelet.middle)
        lane = int(np.searchsorted(edges, np.median(placed.across)))
        reach.setdefault(lane, []).extend([float(placed.along.min()), float(placed.along.max())])
    begin = min(min(ends) for ends in reach.values())
    end = max(max(ends) for ends in reach.values())
    for lane, ends in sorted(reach.items()):
        if min(ends) - begin > _SHORT or end - max(ends) > _SHORT:
            notes.say(
                own.element,
                f"Lane {lane - 1} (0 is the rightmost) is there from {min(ends):.0f} m to {max(ends):.0f} m only; the "
                f"road goes from {begin:.0f} m to {end:.0f} m, and so does the lane here.",
            )


# The case


def _make_case(
    root: Element, road: _Road, av: _Track, others: list[_Track], step_s: float, notes: _Notes
) -> MovingCase:
    """Resample the AV, and all vehicles on its road between its first and last frame, to tenths of seconds."""
    first = float(av.states[0, 0])
    moving = [other for other in others if not (other.why_not or other.stands)]
    last = float(av.states[-1, 0]) if av.recorded else max([first, *(float(o.states[-1, 0]) for o in moving)])
    frames = math.floor((last - first) * step_s / FRAME_S + 1e-6) + 1
    if abs(step_s - FRAME_S) > 1e-9:
        notes.say(root, f"Time steps are {step_s:g} s; what is between them is interpolated in a straight line.")
    own = _motion(av, road, first, frames, step_s, notes)
    there = []
    for track in others:
        motion = _motion(track, road, first, frames, step_s, _Notes() if track.why_not else notes)
        why_not = track.why_not or _not_there(motion, road)
        if why_not:
            _leave_out(replace(track, why_not=why_not), motion, av, own, road, notes)
        else:
            there.append((track, motion))
    if av.recorded and any(o.states[0, 0] < first or o.states[-1, 0] > last for o, _ in there if not o.stands):
        notes.say(av.element, f"Only steps {first:g} to {last:g} are read, in which the AV, {_named(av.element)}, is.")
    if av.recorded and jumps(own).any():
        av.element.fault(f"the AV, {_named(av.element)}, cannot drive as recorded: {_ASTRAY}")
    everybody = [(av, own), *there]
    poses = np.stack([motion for _, motion in everybody], axis=1)
    if abs(poses[0, 0, X]) > _FAR_OFF:
        poses[:, :, X] -= poses[0, 0, X]
    if road.lanes == 1:
        notes.say(root, f"{ONE_LANE[0].upper()}{ONE_LANE[1:]}.")
    odd = straight_road(
        lanes=road.lanes, lane_width=road.width, vehicles=len(everybody), seconds=FRAME_S * (frames - 1),
        fastest=float(np.nanmax(poses[:, :, SPEED])), av_size=(av.length, av.width), start=float(poses[0, 0, X]),
    )  # fmt: skip
    _head_for_lanes(poses, odd)
    return MovingCase(
        _name_of(root), odd, np.array([track.kind for track, _ in everybody], np.int8),
        np.array([track.length for track, _ in everybody]), np.array([track.width for track, _ in everybody]), poses,
        _facts(root, av), notes.all(), tuple(f"obstacle {track.name}" for track, _ in everybody),
    )  # fmt: skip


def _motion(track: _Track, road: _Road, first: float, frames: int, step_s: float, notes: _Notes) -> NDArray[np.float64]:
    """Make the poses (F, POSE_NUMBERS) of a vehicle, NaN where it is absent; lanes are not yet told."""
    steps, points = track.states[:, 0], track.states[:, 1:3]
    placed = road.course.place(points)
    heading = np.mod(track.states[:, 3] - placed.turned + math.pi, math.tau) - math.pi
    speed = track.states[:, 4] * np.cos(heading) * placed.stretched
    given = np.stack([placed.along, placed.across - road.right, speed, np.unwrap(heading), track.states[:, 5]])
    at = first + np.arange(frames) * FRAME_S / step_s
    poses = np.full((frames, POSE_NUMBERS), np.nan)
    if not steps.size:
        return poses
    inside = track.stands | ((at >= steps[0] - 1e-6) & (at <= steps[-1] + 1e-6))
    for gap in np.flatnonzero(np.diff(steps) > 1.0):
        notes.say(track.element, f"{_named(track.element)} has no state between steps {steps[gap]:g} and "
                  f"{steps[gap + 1]:g}; it is absent there.")  # fmt: skip
        inside &= (at <= steps[gap] + 1e-6) | (at >= steps[gap + 1] - 1e-6)
    for number, values in zip((X, Y, SPEED, HEADING, ACCELERATION), given, strict=True):
        poses[inside, number] = np.interp(at[inside], steps, values)
    if not track.recorded:
        poses[0, LATERAL_SPEED] = poses[0, SPEED] * math.tan(poses[0, HEADING])
        poses[0, ACCELERATION] = np.nan_to_num(poses[0, ACCELERATION])
        return poses
    _fill_in(poses, track, notes)
    return poses


def _fill_in(poses: NDArray[np.float64], track: _Track, notes: _Notes) -> None:
    """Take lateral speeds, and speeds and accelerations that are not given, from differences."""
    poses[:, LATERAL_SPEED] = rates(poses[:, Y])
    for number, of in ((SPEED, X), (ACCELERATION, SPEED)):
        unknown = np.isnan(poses[:, number])
        poses[unknown, number] = rates(poses[:, of])[unknown]
    backwards = (poses[:, SPEED] < 0.0) & (np.abs(poses[:, HEADING]) < 0.5 * math.pi)
    if (poses[backwards, SPEED] < -_SWAYS).any():
        notes.say(track.element, f"{_named(track.element)} drives backwards at times; its speed is 0 there.")
    poses[backwards, SPEED] = 0.0


def _not_there(motion: NDArray[np.float64], road: _Road) -> str:
    """Say why a vehicle is no part of the case; empty: it is."""
    there = np.isfinite(motion[:, X])
    if not there.any():
        return "it is not there while the AV is"
    if math.cos(float(np.median(motion[there, HEADING]))) <= _ACROSS:
        return "it is across the road, or drives the other way"
    on = (motion[there, Y] > 0.0) & (motion[there, Y] < road.lanes * road.width)
    return (_ASTRAY if jumps(motion).any() else "") if on.any() else "it is never on the AV's road"


def _leave_out(
    track: _Track, motion: NDArray[np.float64], av: _Track, own: NDArray[np.float64], road: _Road, notes: _Notes
) -> None:
    """Name what is left out, and how near it comes to the AV; of an unknown AV, to one that keeps its speed.

    Raises:
        DataError: It is in the AV's way.
    """
    said = track.why_not
    if not av.recorded:
        own = np.repeat(own[:1], len(own), axis=0)
        own[:, X] += own[0, SPEED] * FRAME_S * np.arange(len(own))
    size = track.length, track.width
    gap = gaps(own, (av.length, av.width), motion, size)
    if np.isfinite(gap).any():
        at, near = nearest(gap, in_lanes(motion, size, road.lanes * road.width), stands=track.stands)
        said += f"; {within(gap, at)}"
        if near:
            said = f"{_named(track.element)} cannot be carried over and is in the AV's way: {said}"
            track.element.fault(f"{said}. Cut the scenario, or take another AV")
    elif not track.states.size:
        said += "; how near it comes is not known"
    notes.say(track.element, f"{_named(track.element)} is left out: {said}.")


def _head_for_lanes(poses: NDArray[np.float64], odd: Odd) -> None:
    """Fill in the lane that each vehicle keeps, or, as long as it moves sideways, where that ends."""
    with np.errstate(invalid="ignore"):
        lane = np.clip(np.floor(poses[:, :, Y] / odd.lane_width), 0, odd.n_lanes - 1)
    sideways = poses[:, :, LATERAL_SPEED]
    for frame in range(len(poses) - 2, -1, -1):
        here, after = sideways[frame], sideways[frame + 1]
        goes_on = (np.abs(here) > _SWAYS) & (here * after > 0.0)
        lane[frame] = np.where(goes_on, lane[frame + 1], lane[frame])
    poses[:, :, LANE] = lane


def _facts(root: Element, av: _Track) -> dict[str, Fact]:
    given = {name: root.attributes.get(name) for name in ("benchmarkID", "author", "affiliation", "date")}
    facts: dict[str, Fact] = {
        "benchmark_id": given["benchmarkID"], "author": given["author"], "affiliation": given["affiliation"],
        "date": given["date"], "av_id": av.name,
    }  # fmt: skip
    return {name: value for name, value in facts.items() if value} | facts_of_source(root.attributes.get("source", ""))


def _name_of(root: Element) -> str:
    given = root.attributes.get("benchmarkID", "") or Path(root.file).stem
    return safe_name(given, "commonroad")
