"""Measures of drivers and people in recordings of tests at a site: encounters, gaps, kerbs, walking, crashes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cornerforge._philox import PURPOSE_INITIAL, block, uniform
from cornerforge.errors import InputError
from cornerforge.site.network import Site
from cornerforge.site.tables import CROSS, MERGE, longer
from cornerforge.types import FRAME_S, PERSON, Scenario

__all__ = ["CRASH_KINDS", "Kerb", "Measured", "Meeting", "Turn", "crash_kinds", "measures"]

Floats = NDArray[np.float64]

_SLOW_WALK, _CHANGE_TIME, _SLOWEST = 1.07, 4.0, 0.8
_PLACE = 0.25
"""Places along a route are looked for so far apart [m]."""
_LONGEST = 10.5
"""Encounters are those in which the second comes at most so long after the first [s]."""
_NEAR, _QUEUED, _CREEPS = 6.0, 10.0, 3.0
"""A turn that has so far to the oncoming way is first in its lane [m]; the next one is queued behind it if it has no
farther to there [m], and is no faster [m/s], when that one enters."""
_GAP_ENDS = 15.0
"""A gap before which none comes any more counts as so long [s]; a red light between two is longer."""
CRASH_KINDS = (
    "rear-end", "angle", "left turn across", "side-swipe", "pedestrian, right turn", "pedestrian, left turn",
    "pedestrian, straight",
)  # fmt: skip
_TOUCH = 12.0


@dataclass(frozen=True)
class Meeting:
    """A right-turning vehicle and the person that came nearest in time to it.

    Attributes:
        seconds: From when the first has left the place where their ways cross until the second comes; negative: the
            vehicle went first; 0: both were there.
        light: Of the person's signal when it comes there: 2 walk, 1 flashing, 0 don't walk; -1 without a signal.
    """

    seconds: float
    light: int


@dataclass(frozen=True)
class Turn:
    """A left turn that let at least one oncoming vehicle pass: the largest gap let pass, the gap taken [s]."""

    missed: float
    taken: float


@dataclass(frozen=True)
class Kerb:
    """A person that came to the kerb on don't walk: did it leave on it; vehicles that passed in the next 10 s."""

    left: bool
    vehicles: int


@dataclass
class Measured:
    """Measurements of drivers and people; `add` puts another recording to it.

    Attributes:
        meetings, turns, kerbs: As their classes say.
        follow_up: Times between two left turns that go in one gap [s].
        walks: Speeds of people from kerb to kerb [m/s].
    """

    meetings: list[Meeting] = field(default_factory=list)
    turns: list[Turn] = field(default_factory=list)
    kerbs: list[Kerb] = field(default_factory=list)
    follow_up: list[float] = field(default_factory=list)
    walks: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class _Track:
    route: int
    person: bool
    length: float
    begin: int
    s: Floats
    speed: Floats

    def when(self, place: float) -> float:
        """Time at which its middle is at a place along its route [s]; NaN if it never is, or was beyond it at first."""
        if self.s[0] > place or self.s[-1] < place:
            return np.nan
        return (self.begin + int(np.searchsorted(self.s, place))) * FRAME_S

    def at(self, time: float) -> tuple[float, float]:
        """Place [m] and speed [m/s] at a time [s]; NaN when it is not there."""
        k = round(time / FRAME_S) - self.begin
        return (float(self.s[k]), float(self.speed[k])) if 0 <= k < self.s.size else (np.nan, np.nan)


@dataclass(frozen=True)
class _Seen:
    """A recording with its site: tracks of all but the AV, and of the AV; zones of pairs; time of the signals."""

    site: Site
    zones: NDArray[np.void]
    tracks: list[_Track]
    av: list[_Track]
    clock: float
    seconds: float

    def light(self, route: int, time: float) -> int:
        """Letter of a route's signal at a time of the test, 2 green, 1 amber, 0 red; -1 without one."""
        signal = self.site.routes[route].signal
        if signal < 0 or not self.site.programme:
            return -1
        ends = np.cumsum([phase.seconds for phase in self.site.programme])
        phase = int(np.searchsorted(ends, (self.clock + time) % ends[-1], side="right"))
        return {"r": 0, "y": 1}.get(self.site.programme[min(phase, len(ends) - 1)].states[signal], 2)

    def walk(self, route: int, time: float) -> int:
        """Light of people on a crosswalk: 2 walk, 1 flashing, 0 don't walk; -1 without one."""
        now = self.light(route, time)
        needed = self.site.routes[route].length / _SLOW_WALK - _CHANGE_TIME
        return (
            1
            if now == 2 and needed > 0.0 and self.light(route, time + needed) < 2
            else now // 2 * 2
            if now > 0
            else now
        )


def measures(scenarios: Iterable[Scenario], zones: NDArray[np.void]) -> Measured:
    """Measure what drivers and people did in recordings of tests at a site; the AV is no one of them.

    Args:
        scenarios: Recordings, as of `Experiment.recorder`; all frames are needed.
        zones: Field `zone` of the site's record, (routes, routes, meetings) of `site.tables.SITE`.

    Raises:
        InputError: A recording is none of a site.
    """
    out = Measured()
    for scenario in scenarios:
        seen = _seen(scenario, zones)
        out.meetings += _meetings(seen)
        turns, follow_up = _turns(seen)
        out.turns += turns
        out.follow_up += follow_up
        out.kerbs += _kerbs(seen)
        out.walks += _walks(seen)
    return out


def _seen(scenario: Scenario, zones: NDArray[np.void]) -> _Seen:
    site = scenario.odd.site
    if site is None:
        raise InputError("These are measures of sites; the recording is of a road.")
    words = block(scenario.seed, scenario.test, 0, 0, PURPOSE_INITIAL)
    cycle = sum(phase.seconds for phase in site.programme)
    tracks: list[list[_Track]] = [[], []]
    for k in range(scenario.slot.size):
        there = np.flatnonzero(scenario.present[:, k])
        if there.size < 2:
            continue
        route = int(scenario.target_lane[there[0], k])
        s = _along(site, route, scenario.x[there, k], scenario.y[there, k])
        tracks[int(scenario.slot[k] == 0)].append(
            _Track(
                route, scenario.kind[k] == PERSON, float(scenario.length[k]), int(there[0]),
                np.maximum.accumulate(s), scenario.speed[there, k],
            )
        )  # fmt: skip
    clock = cycle * float(uniform(words[2]))
    return _Seen(site, zones, tracks[0], tracks[1], clock, (len(scenario.x) - 1) * FRAME_S)


def _along(site: Site, route: int, x: Floats, y: Floats) -> Floats:
    """Find the places along a route [m] that are nearest to places in the plane, shape (n,)."""
    one = site.routes[route]
    at = np.arange(0.0, one.length + _PLACE, _PLACE)
    line = np.stack([np.interp(at, one.along, values) for values in one.line.T])
    nearest = np.hypot(x[:, None] - line[0], y[:, None] - line[1]).argmin(axis=1)
    heading = np.stack([np.gradient(values, at) for values in line])
    ahead = (x - line[0, nearest]) * heading[0, nearest] + (y - line[1, nearest]) * heading[1, nearest]
    return np.asarray(at[nearest] + ahead)


def _meetings(seen: _Seen) -> list[Meeting]:
    """Find for each right turn over a crosswalk the person nearest in time."""
    found = []
    for vehicle in seen.tracks:
        if vehicle.person or seen.site.routes[vehicle.route].turn != "right":
            continue
        nearest: Meeting | None = None
        for person in seen.tracks:
            zone = seen.zones[vehicle.route, person.route, 0]
            if not person.person or zone["kind"] != CROSS:
                continue
            here, there = 0.5 * (zone["begin"] + zone["end"]), 0.5 * (zone["other_begin"] + zone["other_end"])
            times = [
                one.when(place + side * 0.5 * one.length)
                for one, place in ((vehicle, here), (person, there)) for side in (-1, 1)
            ]  # fmt: skip
            if np.isnan(times).any():
                continue
            apart = times[0] - times[3] if times[3] <= times[0] else min(times[1] - times[2], 0.0)
            if abs(apart) < _LONGEST and (nearest is None or abs(apart) < abs(nearest.seconds)):
                nearest = Meeting(apart, seen.walk(person.route, times[2]))
        if nearest is not None:
            found.append(nearest)
    return found


def _oncoming(seen: _Seen, route: int) -> list[int]:
    """Give the routes of vehicles, straight on or to the right, to which a left turn yields on the same green."""
    rows = seen.zones[route, :, 0]
    return [
        k for k in seen.site.vehicles
        if rows[k]["kind"] in (CROSS, MERGE) and rows[k]["yields"] and not rows[k]["goes_first"]
        and any(_green(phase.states, route, seen) and _green(phase.states, k, seen) for phase in seen.site.programme)
    ]  # fmt: skip


def _green(states: str, route: int, seen: _Seen) -> bool:
    return states[seen.site.routes[route].signal] in "gG"


def _turns(seen: _Seen) -> tuple[list[Turn], list[float]]:
    """Find left turns that let an oncoming vehicle pass, and the times between two that go in one gap.

    Gaps are headways of oncoming vehicles where each comes into its zone with the turn: of one lane to two, a driver
    may pass before one and wait for the next. Before one that turns right it has gone if it crosses the oncoming way
    first. One that goes on amber, or has not gone yet, took no gap that ended.
    """
    turns, follow_up = [], []
    routes = {t.route for t in seen.tracks if seen.site.routes[t.route].turn == "left" and not t.person}
    for route in routes:
        oncoming = _oncoming(seen, route)
        rows = seen.zones[route, :, 0]
        crossing = [k for k in oncoming if rows[k]["kind"] == CROSS]
        if not crossing:
            continue
        first, last = (float(end) for end in (rows["begin"][crossing].min(), rows["begin"][crossing].max()))
        begins = np.where(rows["kind"] == CROSS, rows["begin"], first)
        comes = [(t.when(seen.zones[route, t.route, 0]["other_begin"]), t.route) for t in seen.tracks + seen.av]
        comes = sorted(one for one in comes if one[1] in oncoming and not np.isnan(one[0]))
        ours = [(t.when(first), t) for t in seen.tracks if t.route == route and t.s[-1] >= first > t.s[0]]
        ours.sort(key=lambda pair: pair[0])
        for n, (entered, one) in enumerate(ours):
            ready = one.when(first - _NEAR)
            later = [(at, not at > one.when(begins[other])) for at, other in comes if at > ready]
            passed = np.array([at for at, before in later if before])
            if passed.size == 0 or seen.light(route, passed[0]) < 2:
                continue
            ends = min((at for at, before in later if not before), default=np.inf)
            missed = np.diff(passed[[seen.light(route, at) == 2 for at in passed]])
            goes = [one.when(place) for place in (first, last)]
            in_gap = seen.light(route, max(goes[0], passed[-1])) == 2 and not np.isnan(goes[1])
            taken = min(ends - passed[-1], _GAP_ENDS) if in_gap else _GAP_ENDS
            turns.append(Turn(float(missed[missed < _GAP_ENDS].max(initial=0.0)), float(taken)))
            for then, follower in ours[n + 1 : n + 2] if in_gap else ():
                place, speed = follower.at(entered)
                if then < ends and then - entered < _GAP_ENDS and first - place < _QUEUED and speed < _CREEPS:
                    follow_up.append(then - entered)
    return turns, follow_up


def _kerbs(seen: _Seen) -> list[Kerb]:
    """Find people that came on don't walk, so early that walk came before the recording ended, whenever they did.

    Were all taken that saw walk, those would be too many that waited a short time.
    """
    found = []
    longest = _longest_wait(seen.site)
    for person in seen.tracks:
        came = person.begin * FRAME_S
        late = came + longest > seen.seconds
        if not person.person or person.begin == 0 or late or seen.walk(person.route, came) != 0:
            continue
        left = person.when(0.1)
        vehicles = 0
        for other in seen.tracks + seen.av:
            zone = seen.zones[person.route, other.route, 0]
            if not other.person and zone["kind"] == CROSS:
                vehicles += bool(came <= other.when(zone["other_begin"] - longer(other.length, False)) < came + 10.0)
        first = np.isfinite(left) and not any(seen.walk(person.route, t) > 0 for t in np.arange(came, left, FRAME_S))
        found.append(Kerb(bool(first) and seen.walk(person.route, left) == 0, vehicles))
    return found


def _longest_wait(site: Site) -> float:
    """Find the longest time without a green light for people [s]."""
    ends = np.concatenate([[0.0], np.cumsum([phase.seconds for phase in site.programme])])
    longest = 0.0
    for signal in {route.signal for route in site.routes if route.turn == "walk" and route.signal >= 0}:
        greens = [n for n, phase in enumerate(site.programme) if phase.states[signal] in "gG"]
        for n, then in zip(greens, greens[1:] + greens[:1], strict=True):
            longest = max(longest, (ends[then] - ends[n + 1]) % ends[-1])
    return longest


def _walks(seen: _Seen) -> list[float]:
    """Speeds of people that walked from kerb to kerb [m/s]."""
    found = []
    for person in seen.tracks:
        length = seen.site.routes[person.route].length
        # who sets out later is seen at the other kerb only if it is quick
        if person.person and person.s[0] < 0.1 and person.when(0.1) < seen.seconds - length / _SLOWEST:
            begin, end = person.when(0.1), person.when(length - 2.0)
            if end > begin:
                found.append((length - 2.1) / (end - begin))
    return found


def crash_kinds(scenario: Scenario) -> list[str]:
    """Say of each crash between others than the AV in a recording of which kind it is (`CRASH_KINDS`).

    Two that are near and gone a tenth of a second later, and not at the ends of their routes, have crashed.

    Raises:
        InputError: The recording is none of a site.
    """
    if scenario.odd.site is None:
        raise InputError("These are crashes at sites; the recording is of a road.")
    found = []
    there = scenario.present
    for frame in range(len(there) - 1):
        gone = [
            k for k in np.flatnonzero(there[frame] & ~there[frame + 1])
            if scenario.slot[k] != 0 and not _at_end(scenario, frame, int(k))
        ]  # fmt: skip
        x, y = scenario.x[frame, gone], scenario.y[frame, gone]
        while len(gone) > 1:
            away = np.hypot(x - x[0], y - y[0])
            other = 1 + int(away[1:].argmin())
            if away[other] < _TOUCH:
                found.append(_kind(scenario, frame, int(gone[0]), int(gone[other])))
            left = [n for n in range(1, len(gone)) if n != other or away[other] >= _TOUCH]
            gone, x, y = [gone[n] for n in left], x[left], y[left]
    return found


def _at_end(scenario: Scenario, frame: int, k: int) -> bool:
    site = scenario.odd.site
    assert site is not None
    x, y = site.routes[scenario.target_lane[frame, k]].line[-1]
    away = np.hypot(scenario.x[frame, k] - x, scenario.y[frame, k] - y)
    return bool(away <= scenario.speed[frame, k] * FRAME_S + 0.5)


def _kind(scenario: Scenario, frame: int, a: int, b: int) -> str:
    site = scenario.odd.site
    assert site is not None
    turns = [site.routes[scenario.target_lane[frame, k]].turn for k in (a, b)]
    for person, vehicle in ((a, 1), (b, 0)):
        if scenario.kind[person] == PERSON:
            return (
                f"pedestrian, {turns[vehicle]} turn" if turns[vehicle] in ("left", "right") else "pedestrian, straight"
            )
    heading = scenario.heading[frame]
    apart = abs((heading[a] - heading[b] + np.pi) % (2.0 * np.pi) - np.pi)
    if apart < np.pi / 6.0:
        dx, dy = scenario.x[frame, b] - scenario.x[frame, a], scenario.y[frame, b] - scenario.y[frame, a]
        aside = abs(-dx * np.sin(heading[a]) + dy * np.cos(heading[a]))
        return "rear-end" if aside < 0.5 * (scenario.width[a] + scenario.width[b]) * 0.75 else "side-swipe"
    return "left turn across" if "left" in turns and apart > np.pi / 2.0 else "angle"
