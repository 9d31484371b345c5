"""The most critical moments of recorded traffic, as moving cases with the recorded driver in the AV's seat.

For each vehicle (the ego) and each other one ahead of it that is in its way, a measure says at every tenth of a second
how critical it is. A vehicle is in the way if both would meet when they go straight on: their boxes share more than 0.3
m across the road. So a vehicle that cuts in counts from the moment at which its body comes before the ego's. The
measures:

| name | what | why (not) |
| --- | --- | --- |
| `drac` | deceleration that just avoids contact if the other keeps its speed [m/s2] | the default: it says what is asked of the ego, and calls neither crawling nose to tail nor close following at equal speeds critical |
| `ttc` | time to collision along the lane [s] | a queue that creeps at 0.5 m/s from 1 m behind has a TTC of 2 s |
| `thw` | time headway [s] | finds egos that follow closely, whether or not anything happens |
| `contact` | time to contact in the plane [s] | needs no vehicle in the way: it sees vehicles that come closer sideways, and the noise of positions across the road, too |

Egos are cars, as an AV is. One event of an ego gives one moment, the one with the worst value: within half a window no
moment is worse. Vehicles with overlapping recorded boxes (smoothing, wrong lengths, a tracking error) make no case.

**The others do not react.** They are on rails: the driver in the ego's place starts with its recorded place and speed,
and all others go where they went. An AV that brakes where the recorded driver did not can be struck from behind by a
vehicle that would have braked; that crash says little about the AV. The column `striker` tells them apart. In the last
frame the ego is alone: what the others did after the window is not known, so no vehicle is struck there.

How much is noise: of the 50 moments of NGSIM's US-101 clips with the largest `drac`, smoothed over 2.1 s, 35 are among
the 50 smoothed over 1.1 s, and 33 among those smoothed over 3.1 s.
"""  # noqa: E501

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in, check_integer, check_number
from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import DataError
from cornerforge.ext.interchange.recorded_traffic import Traffic
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.library.out_case import MOST_VEHICLES, Fact, MovingCase, safe_name, straight_road
from cornerforge.metrics import bbd, drac, thw, ttc
from cornerforge.metrics.risk import contact_time
from cornerforge.road.straight import along
from cornerforge.types import CAR, FRAME_S

__all__ = ["MEASURES", "Moments", "critical_moments"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MEASURES = ("drac", "ttc", "thw", "contact")
_UNITS = {"drac": "mps2", "ttc": "s", "thw": "s", "contact": "s"}
_IN_THE_WAY = 0.3
"""Least overlap of two boxes across the road when one is in the other's way [m]: recorded widths and places across the
road are no better than that, and a vehicle that passes in the next lane is not in the way."""
_AHEAD = 100.0
"""How far ahead an ego is looked for others [m]."""
_BESIDE = 8.0
"""How far across the road [m]."""
_KEPT_BEHIND, _KEPT_AHEAD = 150.0, 250.0
"""Others that come so near to the ego within the window are in the case [m]."""
_LONGEST, _NARROWEST = 30.0, 0.3
"""Limits of the simulator on rails: length and width of each vehicle [m]."""
_LEAST_BEFORE, _LEAST_AFTER = 2.0, 1.0
"""Shortest part of a window before and after the moment, where a track begins late or ends early [s]."""
_SIDEWAYS = 0.2
"""A vehicle slower sideways keeps its lane: it has no lateral speed and no heading in a case [m/s]. An AV sees any
lateral speed as a lane change, and the wandering and the noise of recorded vehicles are as fast as this. Its place
stays the recorded one."""
_SAME = 0.2
"""Places and speeds of two moments that differ by less are the same, smoothed with other neighbours [m, m/s]."""
_AV_LENGTHS, _AV_WIDTHS = (2.0, 20.0), (1.0, 2.6)


class Moments(NamedTuple):
    """Moments that were found.

    Attributes:
        cases: The most critical moments, the worst first.
        found: Events in all the traffic, whether or not they became cases.
        left_out: Events worse than the last case that made none: reason -> how many.
    """

    cases: list[MovingCase]
    found: int
    left_out: Mapping[str, int]


class _Pairs(NamedTuple):
    """Pairs of rows of a `Traffic`, an ego's and a vehicle's ahead, and the measure: larger is worse."""

    ego: Ints
    other: Ints
    badness: Floats


class _Event(NamedTuple):
    """The worst moment of an event."""

    badness: float
    traffic: int
    ego: int
    other: int


class _Window(NamedTuple):
    """Material of a case: vehicles, the ego first, and their poses (F, N, POSE_NUMBERS)."""

    traffic: Traffic
    ego_row: int
    other_row: int
    first: int
    vehicles: Ints
    poses: Floats


def critical_moments(
    traffic: Sequence[Traffic], *, most: int = 50, before_s: float = 5.0, after_s: float = 3.0, measure: str = "drac"
) -> Moments:
    """Find the most critical moments and make cases of them.

    Args:
        traffic: As `read_traffic` gives it.
        most: How many cases at most.
        before_s, after_s: The window around a moment [s]; at least 2 s and 1 s of it must be recorded.
        measure: One of `MEASURES`.

    Returns:
        Cases with vehicle 0 the ego, as recorded, at x = 0 in the first frame. Equally critical moments stand in the
        order of the traffic, then of the ego's name and time.

    Raises:
        InputError, UnknownNameError: A number is out of range, or the measure is unknown.
        DataError: No vehicle drives behind another.
    """
    check_integer("cases", most, low=1, high=100_000)
    check_number("before", before_s, low=_LEAST_BEFORE, high=60.0, unit="s")
    check_number("after", after_s, low=_LEAST_AFTER, high=60.0, unit="s")
    check_in("measure", measure, MEASURES)
    apart = max(1, round(0.5 * (before_s + after_s) / FRAME_S))
    events = [event for k, one in enumerate(traffic) for event in _events(k, one, measure, apart)]
    if not events:
        names = ", ".join(dict.fromkeys(one.file.name for one in traffic))
        raise DataError(
            f"{names}: no car comes near another vehicle ahead of it in its way (within {_AHEAD:g} m), so there is no "
            "critical moment."
        )
    events.sort(key=lambda e: (-e.badness, e.traffic, _label(traffic[e.traffic], e.ego), e.ego))
    windows: list[_Window] = []
    seen: dict[tuple[str, ...], list[_Window]] = {}
    left_out: Counter[str] = Counter()
    for event in events:
        if len(windows) == most:
            break
        window = _window(traffic[event.traffic], event, before_s, after_s)
        if isinstance(window, str):
            left_out[window] += 1
            continue
        of_pair = seen.setdefault(_pair_of(window), [])
        if any(_is_same(window, one) for one in of_pair):
            left_out["the same moment stands in another clip of the file"] += 1
            continue
        of_pair.append(window)
        windows.append(window)
    return Moments(_cases(windows, measure), len(events), dict(left_out))


def _label(traffic: Traffic, row: int) -> str:
    return traffic.names[int(traffic.vehicle[row])]


def _events(number: int, traffic: Traffic, measure: str, apart: int) -> Iterator[_Event]:
    """Find the worst moment of each event, ego by ego: no moment of this ego nearer than `apart` frames is worse."""
    pairs = _all_pairs(traffic, measure)
    frame = traffic.frame[pairs.ego]
    # Of the others at one frame the worst stands first; of two that are equally bad, the first in the traffic's order.
    order = np.lexsort((pairs.other, -pairs.badness, frame, traffic.vehicle[pairs.ego]))
    same = (np.diff(pairs.ego[order]) == 0) if order.size else np.zeros(0, dtype=np.bool_)
    worst = order[np.concatenate([[True], ~same])[: order.size]]
    for first, end in pairwise(
        np.flatnonzero(np.diff(traffic.vehicle[pairs.ego[worst]], prepend=-1, append=-1)).tolist()
    ):
        of_ego = worst[first:end]
        for k in _peaks(frame[of_ego], pairs.badness[of_ego], apart):
            row = of_ego[k]
            yield _Event(float(pairs.badness[row]), number, int(pairs.ego[row]), int(pairs.other[row]))


def _peaks(frame: Ints, badness: Floats, apart: int) -> list[int]:
    """Find where a value is the largest of all nearer than `apart` frames; the first of equal ones."""
    from scipy.ndimage import maximum_filter1d

    series = np.full(int(frame[-1] - frame[0]) + 1, -np.inf)
    series[frame - frame[0]] = badness
    highest = maximum_filter1d(series, 2 * apart - 1, mode="constant", cval=-np.inf)
    kept: list[int] = []
    for k in np.flatnonzero(badness == highest[frame - frame[0]]).tolist():
        if not kept or frame[k] - frame[kept[-1]] >= apart:
            kept.append(k)
    return kept


def _all_pairs(traffic: Traffic, measure: str) -> _Pairs:
    """Measure all pairs of a car and one ahead of it that is in its way."""
    order = np.lexsort((traffic.x, traffic.frame))
    steady = _is_steady(traffic)
    found = [_NO_PAIRS]
    for step in range(1, order.size):
        behind, ahead = order[:-step], order[step:]
        near = traffic.frame[behind] == traffic.frame[ahead]
        near &= along(traffic.x[behind], traffic.x[ahead]) <= _AHEAD
        if not near.any():
            break
        near &= np.abs(traffic.y[ahead] - traffic.y[behind]) <= _BESIDE
        near &= (traffic.kind[traffic.vehicle[behind]] == CAR) & steady[behind] & steady[ahead]
        ego, other = behind[near], ahead[near]
        if measure != "contact":
            in_the_way = _shared(traffic, ego, other) > _IN_THE_WAY
            ego, other = ego[in_the_way], other[in_the_way]
        badness = _badness(traffic, ego, other, measure)
        worth = np.isfinite(badness)
        found.append(_Pairs(ego[worth], other[worth], badness[worth]))
    return _Pairs(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


_NO_PAIRS = _Pairs(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))


def _is_steady(traffic: Traffic) -> Bools:
    """Tell which rows are of stretches at least as long as the smoothing window: speeds of shorter ones are noise."""
    breaks = (np.diff(traffic.vehicle) != 0) | (np.diff(traffic.frame) != 1)
    stretch = np.concatenate([[0], np.cumsum(breaks)])[: traffic.frame.size]
    return np.asarray(FRAME_S * np.bincount(stretch)[stretch] >= traffic.file.window)


def _shared(traffic: Traffic, ego: Ints, other: Ints) -> Floats:
    """Overlap of boxes across the road [m], (n,); negative: they are apart."""
    widths = traffic.width[traffic.vehicle[ego]] + traffic.width[traffic.vehicle[other]]
    return np.asarray(0.5 * widths - np.abs(traffic.y[other] - traffic.y[ego]))


def _gap(traffic: Traffic, ego: Ints, other: Ints) -> Floats:
    """Distance between bumpers [m], (n,)."""
    lengths = traffic.length[traffic.vehicle[ego]], traffic.length[traffic.vehicle[other]]
    return bbd(traffic.x[ego], traffic.x[other], *lengths)


def _badness(traffic: Traffic, ego: Ints, other: Ints, measure: str) -> Floats:
    """Return how bad the measure is, (n,); -inf where it does not apply, inf never."""
    value = _value(traffic, ego, other, measure)
    applies = (_gap(traffic, ego, other) > 0.0) & (value > 0.0) & np.isfinite(value)
    return np.where(applies, value if measure == "drac" else -value, -np.inf)


def _value(traffic: Traffic, ego: Ints, other: Ints, measure: str) -> Floats:
    """Compute a measure of pairs of rows, (n,)."""
    rate = traffic.speed[other] - traffic.speed[ego]
    if measure == "contact":
        mine, theirs = traffic.vehicle[ego], traffic.vehicle[other]
        return contact_time(
            np.stack([along(traffic.x[ego], traffic.x[other]), traffic.y[other] - traffic.y[ego]], axis=1),
            np.stack([rate, traffic.lateral_speed[other] - traffic.lateral_speed[ego]], axis=1),
            traffic.heading[ego],
            traffic.heading[other],
            (traffic.length[mine], traffic.length[theirs]),
            (traffic.width[mine], traffic.width[theirs]),
        )
    gap = _gap(traffic, ego, other)
    if measure == "thw":
        return thw(gap, traffic.speed[ego])
    return drac(gap, rate) if measure == "drac" else ttc(gap, rate)


def _window(traffic: Traffic, event: _Event, before_s: float, after_s: float) -> _Window | str:
    """Cut the window of an event out of the traffic; the reason where that makes no case."""
    ego = int(traffic.vehicle[event.ego])
    moment = int(traffic.frame[event.ego])
    size = traffic.length[ego], traffic.width[ego]
    if not (_AV_LENGTHS[0] <= size[0] <= _AV_LENGTHS[1] and _AV_WIDTHS[0] <= size[1] <= _AV_WIDTHS[1]):
        return "the car has a size that no AV has"
    own = _stretch(traffic, event.ego)
    first = max(moment - round(before_s / FRAME_S), int(traffic.frame[own[0]]))
    last = min(moment + round(after_s / FRAME_S), int(traffic.frame[own[-1]]))
    if moment - first < round(_LEAST_BEFORE / FRAME_S) or last - moment < round(_LEAST_AFTER / FRAME_S):
        return f"the car was seen for less than {_LEAST_BEFORE:g} s before or {_LEAST_AFTER:g} s after it"
    own = own[(traffic.frame[own] >= first) & (traffic.frame[own] <= last)]
    inside = np.flatnonzero((traffic.frame >= first) & (traffic.frame <= last))
    away = along(traffic.x[own][traffic.frame[inside] - first], traffic.x[inside])
    near = np.unique(traffic.vehicle[inside[(away >= -_KEPT_BEHIND) & (away <= _KEPT_AHEAD)]])
    vehicles = np.concatenate([[ego], near[near != ego]])
    if vehicles.size > MOST_VEHICLES:
        return f"more than {MOST_VEHICLES} vehicles are near"
    if (traffic.length[vehicles] > _LONGEST).any() or (traffic.width[vehicles] < _NARROWEST).any():
        return f"a vehicle near is longer than {_LONGEST:g} m or narrower than {_NARROWEST:g} m"
    poses = np.full((last - first + 1, vehicles.size, POSE_NUMBERS), np.nan)
    column = np.full(len(traffic.names), -1, dtype=np.int64)
    column[vehicles] = np.arange(vehicles.size)
    rows = inside[column[traffic.vehicle[inside]] >= 0]
    place = traffic.frame[rows] - first, column[traffic.vehicle[rows]]
    for number, values in (
        (X, along(traffic.x[own[0]], traffic.x)), (Y, traffic.y), (SPEED, traffic.speed), (HEADING, traffic.heading),
        (LATERAL_SPEED, traffic.lateral_speed), (ACCELERATION, traffic.acceleration), (LANE, traffic.lane),
    ):  # fmt: skip
        poses[(*place, number)] = values[rows]
    straight = np.abs(poses[..., LATERAL_SPEED]) < _SIDEWAYS
    poses[straight, LATERAL_SPEED] = poses[straight, HEADING] = 0.0
    poses[-1, 1:] = np.nan
    if _overlaps(poses, traffic.length[vehicles], traffic.width[vehicles]):
        return "the recorded car overlaps another vehicle (smoothing, wrong sizes or a tracking error)"
    return _Window(traffic, event.ego, event.other, first, vehicles, poses)


def _pair_of(window: _Window) -> tuple[str, ...]:
    """Name the two vehicles of a moment, for any recording."""
    traffic = window.traffic
    return traffic.file.sha256, _label(traffic, window.ego_row), _label(traffic, window.other_row)


def _is_same(a: _Window, b: _Window) -> bool:
    """Is it one moment of the same two vehicles, in two recordings of a file that overlap in time?"""

    def seen(window: _Window) -> Floats:
        traffic, rows = window.traffic, [window.ego_row, window.other_row]
        return np.concatenate([np.diff(traffic.x[rows]), traffic.y[rows], traffic.speed[rows]])

    return a.traffic.recording != b.traffic.recording and bool((np.abs(seen(a) - seen(b)) < _SAME).all())


def _stretch(traffic: Traffic, row: int) -> Ints:
    """Rows of the same vehicle around a row, without a gap."""
    same = np.flatnonzero(traffic.vehicle == traffic.vehicle[row])
    stretch = traffic.frame[same] - np.arange(same.size)
    return np.asarray(same[stretch == stretch[np.searchsorted(same, row)]])


def _overlaps(poses: Floats, length: Floats, width: Floats) -> bool:
    """Does the ego's box overlap another's in any frame?"""
    mine, others = poses[:, :1], poses[:, 1:]
    reach = 0.5 * (np.hypot(length[0], width[0]) + np.hypot(length[1:], width[1:]))
    with np.errstate(invalid="ignore"):
        near = np.abs(along(mine[..., X], others[..., X])) < reach
        near &= np.abs(others[..., Y] - mine[..., Y]) < reach

    def box(frame: int, slot: int) -> Box:
        x, y, heading = (float(poses[frame, slot, number]) for number in (X, Y, HEADING))
        return Box(x, y, heading, float(length[slot]), float(width[slot]))

    return any(boxes_overlap(box(frame, 0), box(frame, slot + 1)) for frame, slot in np.argwhere(near).tolist())


def _cases(windows: Sequence[_Window], measure: str) -> list[MovingCase]:
    """Make cases of windows; cases of one road share one ODD, so that one library can hold them."""
    roads: dict[tuple[int, float], list[_Window]] = {}
    for window in windows:
        roads.setdefault((window.traffic.lanes, window.traffic.lane_width), []).append(window)
    odds = {}
    for number, ((lanes, lane_width), of_road) in enumerate(roads.items(), 1):
        seconds = FRAME_S * max(len(window.poses) - 1 for window in of_road)
        fastest = max(float(np.nanmax(window.poses[..., SPEED])) for window in of_road)
        egos = [(window.traffic, int(window.vehicles[0])) for window in of_road]
        odds[lanes, lane_width] = straight_road(
            lanes=lanes,
            lane_width=lane_width,
            vehicles=max(window.vehicles.size for window in of_road),
            seconds=seconds,
            start=max(float(window.poses[0, 0, X]) for window in of_road),
            fastest=fastest,
            av_size=(
                max(float(traffic.length[ego]) for traffic, ego in egos),
                max(float(traffic.width[ego]) for traffic, ego in egos),
            ),
            name="recorded" if len(roads) == 1 else f"recorded-{number}",
        )
    return [
        MovingCase(
            name=safe_name(f"{rank:0{len(str(len(windows)))}d}-{_plain(window)}"),
            odd=odds[window.traffic.lanes, window.traffic.lane_width],
            kind=window.traffic.kind[window.vehicles],
            length=window.traffic.length[window.vehicles],
            width=window.traffic.width[window.vehicles],
            poses=window.poses,
            facts=_facts(window, measure),
            notes=(*window.traffic.file.notes, *_cut(window)),
            called=tuple(f"vehicle {window.traffic.names[k]}" for k in window.vehicles.tolist()),
        )
        for rank, window in enumerate(windows, 1)
    ]


def _plain(window: _Window) -> str:
    """Name a moment: recording, ego and time."""
    traffic = window.traffic
    when = traffic.began + FRAME_S * int(traffic.frame[window.ego_row])
    stem = traffic.recording or traffic.file.name.split(".")[0]
    return f"{stem}-{_label(traffic, window.ego_row)}-{round(10.0 * when)}"


def _facts(window: _Window, measure: str) -> dict[str, Fact]:
    traffic, file = window.traffic, window.traffic.file
    ego, other = np.array([window.ego_row]), np.array([window.other_row])
    values = {name: float(_value(traffic, ego, other, name)[0]) for name in MEASURES}
    known = {name: value if np.isfinite(value) else None for name, value in values.items()}
    moment = int(traffic.frame[window.ego_row])
    return {
        "source": file.name,
        "source_sha256": file.sha256,
        "source_layout": file.layout,
        "source_credit": file.credit,
        "recording": traffic.recording or None,
        "direction": traffic.direction,
        "ego_vehicle": _label(traffic, window.ego_row),
        "other_vehicle": _label(traffic, window.other_row),
        "other_column": int(np.flatnonzero(window.vehicles == traffic.vehicle[window.other_row])[0]),
        "recording_time_s": round(traffic.began + FRAME_S * moment, 3),
        "moment_s": round(FRAME_S * (moment - window.first), 3),
        "measure": measure,
        f"measure_{_UNITS[measure]}": known[measure],
        "gap_m": float(_gap(traffic, ego, other)[0]),
        "drac_mps2": known["drac"],
        "ttc_s": known["ttc"],
        "thw_s": known["thw"],
        "contact_s": known["contact"],
        "ego_speed_mps": float(traffic.speed[window.ego_row]),
        "other_speed_mps": float(traffic.speed[window.other_row]),
        "smoothing_s": file.window,
        "others_react": False,
    }


def _cut(window: _Window) -> tuple[str, ...]:
    """Say how many vehicles are not there for the whole window."""
    partly = int(np.isnan(window.poses[:-1, 1:, X]).any(axis=0).sum())
    if partly == 0:
        return ()
    return (f"{partly} of {window.vehicles.size - 1} other vehicles are there for a part of the window only",)
