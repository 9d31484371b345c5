"""One crash at a site as the judges look at it: each agent along its route, the light, the zone in which the two met.

The other agent is the one that the AV touched. Which kind of crash it was is told by routes, not by faces alone:

- a person: by the turn of the AV's route (`person-right-turn`, `person-left-turn`, `person-straight`);
- the front of one met the rear of the other, headings less than 40 degrees apart, and their routes do not merely cross:
  `rear-end-by-av`, `rear-end-by-bv`;
- the routes cross, one turns left, and the two faced each other, more than 135 degrees apart on the approach and more
  than 90 at the contact: `left-across-by-av`, `left-across-by-bv`;
- the routes cross otherwise: `angle`;
- they share a lane before or behind, or cross with less than 40 degrees: `sideswipe`; never meet: `other-at-site`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.contact import FRONT, REAR, find_contact
from cornerforge.counterfactual import places_along, rooms_to
from cornerforge.recordings import Recordings, recordings_of
from cornerforge.road.straight import RoadNumbers, road_numbers
from cornerforge.sim import NO_VEHICLE, hidden_by
from cornerforge.site.network import TURNS, Route, Site
from cornerforge.site.signals import clock_in, clock_of
from cornerforge.site.tables import (
    CROSS,
    MEETINGS,
    NO_ZONE,
    RED,
    letter_at,
    longer,
    walk_letter,
)  # fmt: skip
from cornerforge.types import FRAME_S, PERSON, Odd, Scenario

__all__ = ["KINDS_AT_SITES", "SiteCase", "case_of", "in_av_frame", "kind_at_site", "site_case"]

KINDS_AT_SITES: dict[str, str] = {
    "person-right-turn": "AV on a way to the right and a person on a crosswalk",
    "person-left-turn": "AV on a way to the left, or back, and a person on a crosswalk",
    "person-straight": "AV on a way straight on and a person on a crosswalk",
    "rear-end-by-av": "AV runs into the rear of a vehicle ahead on its way",
    "rear-end-by-bv": "a vehicle behind on its way runs into the rear of the AV",
    "left-across-by-av": "AV turns left across the way of an oncoming vehicle",
    "left-across-by-bv": "an oncoming vehicle turns left across the way of the AV",
    "angle": "the ways of AV and the other cross, from one side",
    "sideswipe": "the ways of AV and the other lead into one lane, or part, and they touch side by side",
    "other-at-site": "none of these, at a site",
}
"""Name and meaning of the kinds of crash at a site."""

_LEFT, _RIGHT, _BACK = (TURNS.index(turn) for turn in ("left", "right", "back"))
_SAME, _FACING, _ONCOMING = (math.radians(limit) for limit in (40.0, 90.0, 135.0))
_IN_LINE = 0.5
_KERB = 0.05
"""A person within so much of its route's begin has not left the kerb [m], as in `sim.site.people`."""
_CAME_OUT_S, _HIDDEN_S = 3.0, 0.5
"""One that was hidden until so short before the contact, for so long at least, came out from behind a vehicle [s]."""
_PAST_LINE = 0.5
"""A front so far behind a stop line has passed it [m]."""
_STANDS = 0.5
_ROLLS = 3.0
"""A driver that turns right on red passes the line no faster [m/s]: it had stopped there."""


@dataclass(frozen=True)
class SiteCase:
    """One recorded crash of the AV at a site; N agents, the AV first, T frames, the contact last.

    Attributes:
        odd, road: Of the case; `road.site` is the site for kernels.
        partner: Column of the agent that the AV touched.
        x, y, speed, heading, acceleration, s: (T, N); NaN where absent. `s`: along the own route [m].
        route: Index of the route of each agent, int64 (N,).
        kind: Class of each agent, (N,).
        sizes: Length and width of each [m], (N, 2).
        clock: Time of the signals' programme at the first frame [s].
    """

    odd: Odd
    road: RoadNumbers
    partner: int
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    speed: NDArray[np.float64]
    heading: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    s: NDArray[np.float64]
    route: NDArray[np.int64]
    kind: NDArray[np.int64]
    sizes: NDArray[np.float64]
    clock: float

    @property
    def last(self) -> int:
        """Frame of the contact."""
        return len(self.x) - 1

    @property
    def site(self) -> Site:
        """The site."""
        assert self.odd.site is not None
        return self.odd.site

    def way(self, i: int) -> Route:
        """Look up the route of agent i."""
        return self.site.routes[int(self.route[i])]

    def is_person(self, i: int) -> bool:
        """Is agent i a person?"""
        return bool(self.kind[i] == PERSON)

    @property
    def first(self) -> int:
        """First frame in which AV and partner are both there."""
        there = np.isfinite(self.s[:, [0, self.partner]]).all(axis=1)
        return int(np.flatnonzero(there)[0])

    @cached_property
    def zone(self) -> Any:
        """Row of `site.tables.SITE` of the zone of AV and partner that lies nearest to where they touched; None: none.

        Its `begin` and `end` are along the AV's route, `other_begin` and `other_end` along the partner's.
        """
        rows = self.road.site[0]["zone"][self.route[0], self.route[self.partner]]
        known = [row for row in rows[:MEETINGS] if row["kind"] != NO_ZONE]
        here = self.s[-1, 0], self.s[-1, self.partner]

        def away(row: Any) -> float:
            apart: float = max(row["begin"] - here[0], here[0] - row["end"], 0.0) + max(
                row["other_begin"] - here[1], here[1] - row["other_end"], 0.0
            )
            return apart

        return min(known, key=away) if known else None

    def zone_of(self, i: int) -> tuple[float, float]:
        """Compute from where to where agent i, AV or partner, is in the zone, its own length counted in [m]."""
        more = longer(self.sizes[i, 0], self.is_person(i))
        names = ("begin", "end") if i == 0 else ("other_begin", "other_end")
        return float(self.zone[names[0]]) - more, float(self.zone[names[1]]) + more

    @cached_property
    def rooms(self) -> NDArray[np.float64]:
        """How far AV (0) and partner (1) are in each frame from touching the other where that is then [m], (2, T).

        +inf where the other is not in its way.
        """
        out = np.empty((2, self.last + 1))
        for row, (i, j) in enumerate(((self.partner, 0), (0, self.partner))):
            rooms_to(self.road.site, self.route, self.sizes, self.s, i, j, out[row])
        return out

    def room(self, i: int, frame: int) -> float:
        """Look up `rooms` of agent i, AV or partner."""
        return float(self.rooms[int(i != 0), frame])

    def enters(self, i: int) -> int:
        """First frame from which on agent i, AV or partner, is in the other's way, until they touch."""
        free = np.flatnonzero(np.isinf(self.rooms[int(i == 0)]))
        return min(int(free[-1]) + 1, self.last) if free.size else 0

    def comes_into_zone(self, i: int) -> int:
        """First frame from which on agent i, AV or partner, is in the zone, or behind it."""
        before = np.flatnonzero(self.s[:, i] < self.zone_of(i)[0])
        return max(self.first, min(int(before[-1]) + 1, self.last)) if before.size else self.first

    @cached_property
    def hidden_by(self) -> NDArray[np.int64]:
        """Column of the vehicle that hid the partner from the AV's middle in each frame; NO_VEHICLE: in sight, (T,)."""
        pose = np.stack([self.x, self.y, self.heading], axis=-1)
        return hidden_by(self.road, pose, self.sizes, self.kind, self.partner)

    def in_sight(self, frame: int) -> int:
        """First frame from a frame on in which no vehicle hides the partner from the AV; at most the contact's."""
        seen = np.flatnonzero(self.hidden_by[frame:] == NO_VEHICLE)
        return frame + int(seen[0]) if seen.size else self.last

    @cached_property
    def came_out(self) -> tuple[int, int]:
        """Vehicle behind which the partner was hidden until shortly before, and its last frame there.

        Until within `_CAME_OUT_S` of the contact, for `_HIDDEN_S` at least; (NO_VEHICLE, -1) else.
        """
        hidden = self.hidden_by != NO_VEHICLE
        recent = hidden[-round((_CAME_OUT_S + _HIDDEN_S) / FRAME_S) - 1 :]
        frames = np.flatnonzero(hidden)
        if recent.sum() * FRAME_S < _HIDDEN_S or (self.last - frames[-1]) * FRAME_S > _CAME_OUT_S:
            return NO_VEHICLE, -1
        return int(self.hidden_by[frames[-1]]), int(frames[-1])

    @property
    def hider_stood(self) -> bool:
        """Did the vehicle behind which the partner came out stand then, or crawl with less than 0.5 m/s?"""
        hider, frame = self.came_out
        return hider != NO_VEHICLE and bool(self.speed[frame, hider] < _STANDS)

    def passes_line(self, i: int) -> int:
        """First frame in which the front of vehicle i is past its stop line; -1: it was from the start, or never is."""
        front = self.s[:, i] + 0.5 * self.sizes[i, 0] - self.way(i).stop
        before = front < _PAST_LINE
        if not before.any() or before[-1]:
            return -1
        return int(np.flatnonzero(before)[-1]) + 1

    def leaves_kerb(self, i: int) -> int:
        """Last frame in which person i stood at the kerb; 0 or less: before the recording, by its speed."""
        waits = self.s[:, i] <= _KERB
        if waits.any():
            return int(np.flatnonzero(waits)[-1])
        first = int(np.flatnonzero(np.isfinite(self.s[:, i]))[0])
        return first - math.ceil(float(self.s[first, i]) / max(float(self.speed[first, i]), _STANDS) / FRAME_S)

    def letter(self, i: int, frame: int) -> int:
        """Look up the light of vehicle i in a frame."""
        return int(letter_at(self.road.site, self.route[i], self.clock + frame * FRAME_S))

    def walk(self, i: int, frame: int) -> int:
        """Look up the light of person i in a frame: GREEN on Walk, YELLOW while Don't Walk flashes, else RED."""
        return int(walk_letter(self.road.site, self.route[i], self.clock + frame * FRAME_S))

    def on_red(self, i: int) -> tuple[bool, int]:
        """Say whether vehicle i passed its line on red, and when; a right turn after a stop, -2 for when, is none."""
        frame = self.passes_line(i)
        if self.way(i).signal < 0 or frame < 0 or self.letter(i, frame) != RED:
            return False, -1
        if TURNS.index(self.way(i).turn) == _RIGHT and self.speed[frame, i] < _ROLLS:
            return False, -2
        return True, frame

    @property
    def is_behind_partner(self) -> bool:
        """Is the AV behind its partner at the contact, along its own heading?"""
        dx, dy = (float(v[-1, self.partner] - v[-1, 0]) for v in (self.x, self.y))
        return dx * math.cos(self.heading[-1, 0]) + dy * math.sin(self.heading[-1, 0]) > 0.0

    @cached_property
    def in_line(self) -> NDArray[np.float64]:
        """Places along the AV's route of agents on it or in a lane of it, NaN of the others, (T, N) [m]."""
        out = np.full_like(self.s, np.nan)
        table = self.road.site[0]["zone"][self.route[0]]
        for j in range(self.route.size):
            if self.route[j] == self.route[0]:
                out[:, j] = self.s[:, j]
                continue
            if self.is_person(j):
                continue
            for row in table[self.route[j]]:
                if row["kind"] in (NO_ZONE, CROSS):
                    continue
                there = row["begin"] + (self.s[:, j] - row["other_begin"])
                inside = (self.s[:, j] >= row["other_begin"]) & (self.s[:, j] <= row["other_end"])
                beside = np.abs(np.sin(self.heading[:, j] - self.heading[:, 0])) < _IN_LINE
                out[:, j] = np.where(inside & beside & self._near_route(j, there), there, out[:, j])
        return out

    def _near_route(self, j: int, there: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mark the frames in which agent j overlaps the lane of the AV's box at `there` of the AV's route."""
        line, along = self.way(0).line, self.way(0).along
        x, y = (np.interp(np.nan_to_num(there), along, values) for values in line.T)
        near: NDArray[np.bool_] = np.hypot(self.x[:, j] - x, self.y[:, j] - y) < 0.5 * (
            self.sizes[0, 1] + self.sizes[j, 1]
        )
        return near


def case_of(scenario: Scenario) -> SiteCase:
    """Make the case of a crash at a site, with the signals as the scenario has them.

    Raises:
        InputError: There is no crash of the AV, or the recording does not hold its contact.
    """
    return site_case(recordings_of(scenario), scenario.odd, clock_in(scenario))


def site_case(recordings: Recordings, odd: Odd, clock: float | None = None) -> SiteCase:
    """Make the case of recordings that hold one, at a site.

    `clock`: time of the signals' programme at the first frame [s]; None: as the name of the test has it.
    """
    frames, n, last = int(recordings.frames[0]), int(recordings.vehicles[0]), int(recordings.last[0])
    present = recordings.present.reshape(n, frames).T[: last + 1]

    def series(name: str) -> NDArray[np.float64]:
        values = np.asarray(getattr(recordings, name), np.float64).reshape(n, frames).T[: last + 1]
        return np.where(present, values, np.nan)

    road = road_numbers(odd)
    lanes = recordings.target_lane.reshape(n, frames).T[: last + 1]
    there = present.argmax(axis=0)
    route = np.maximum(lanes[there, np.arange(n)], 0).astype(np.int64)
    if clock is None:
        assert odd.site is not None  # callers have asked
        clock = clock_of(odd.site, int(recordings.seed[0]), int(recordings.test[0]))
    x, y = series("x"), series("y")
    s = np.empty((last + 1, n))
    for j in range(n):
        out = np.empty(last + 1)
        places_along(road.site, int(route[j]), np.ascontiguousarray(x[:, j]), np.ascontiguousarray(y[:, j]), out)
        s[:, j] = out
    return SiteCase(
        odd, road, int(recordings.partner[0]), x, y, series("speed"), series("heading"), series("acceleration"), s,
        route, recordings.kind.astype(np.int64), np.stack([recordings.length, recordings.width], axis=1),
        clock,
    )  # fmt: skip


def in_av_frame(pose: NDArray[np.floating]) -> NDArray[np.float64]:
    """Turn poses at a site into the AV's frame, in the form that poses along a road have.

    Args:
        pose: [x m, y m, speed along the own way m/s, heading rad] of the AV (0) and the other (1), (*d, 2, 4).

    Returns:
        The same with the AV at 0, 0, headed along x; headings in [-pi, pi); the speed of one whose heading is less than
        60 degrees from the AV's is that along x.
    """
    given = np.asarray(pose, np.float64)
    heading = given[..., :1, 3]
    dx, dy = (given[..., k] - given[..., :1, k] for k in (0, 1))
    turned = (given[..., 3] - heading + np.pi) % (2.0 * np.pi) - np.pi
    cos, sin = np.cos(heading), np.sin(heading)
    share = np.cos(turned)
    speed = given[..., 2] * np.where(share > _IN_LINE, share, 1.0)
    return np.stack([dx * cos + dy * sin, dy * cos - dx * sin, speed, turned], axis=-1)


def kind_at_site(case: SiteCase) -> str:
    """Name the kind of crash, a key of `KINDS_AT_SITES`; the module's text states the rules."""
    other = case.partner
    turns = TURNS.index(case.way(0).turn), TURNS.index(case.way(other).turn)
    if case.is_person(other):
        return {_RIGHT: "person-right-turn", _LEFT: "person-left-turn", _BACK: "person-left-turn"}.get(
            turns[0], "person-straight"
        )
    pair = [0, other]
    pose = np.stack([getattr(case, name)[-1, pair] for name in ("x", "y", "speed", "heading")], axis=-1)
    faces = find_contact(in_av_frame(pose)[None], case.sizes[None, pair, 0], case.sizes[None, pair, 1])
    apart = float(faces.relative_heading[0])
    meets = NO_ZONE if case.zone is None else int(case.zone["kind"])
    one_lane = case.route[0] == case.route[other] or meets not in (NO_ZONE, CROSS)
    sectors = int(faces.av_sector[0]), int(faces.bv_sector[0])
    if one_lane and apart < _SAME and sectors in ((FRONT, REAR), (REAR, FRONT)):
        return "rear-end-by-av" if sectors == (FRONT, REAR) else "rear-end-by-bv"
    if one_lane or (meets != NO_ZONE and apart < _SAME):
        return "sideswipe"
    if meets == NO_ZONE:
        return "other-at-site"
    ways = [case.road.site[0]["place"][case.route[i], 0]["heading"] for i in pair]
    came_apart = abs((ways[1] - ways[0] + np.pi) % (2.0 * np.pi) - np.pi)
    if apart > _FACING and came_apart > _ONCOMING:
        for name, turn, against in (("av", turns[0], turns[1]), ("bv", turns[1], turns[0])):
            if turn in (_LEFT, _BACK) and against not in (_LEFT, _BACK):
                return f"left-across-by-{name}"
    return "angle"
