"""Mechanism of a crash of the AV: how it came about, in plain categories, from its recording.

A crash type says which faces met; a mechanism says what the two vehicles did before. The rules read positions, target
lanes and accelerations only, so they hold for any AV and any traffic. In this order (the first that fits names it):

1. `follow-up`: two BVs had crashed into each other within 5 s before and 100 m of the AV.
2. Both were changing lanes, at least partly at the same time: into one lane from the same side (`same-lane-same-side`)
   or from opposite sides (`same-lane-opposite-sides`), or each into the lane that the other came from (`swap`).
3. A front met a rear. The one in front or the one behind had moved into the other's path (`...-cut-in`, `...-change`),
   or the one in front had braked hard (`...-braking`), or neither (`bv-rear`, `av-rear`).
4. A side took part: named after the vehicle that had moved into the other's path (`bv-side`, `av-side`); `other` if
   neither had.
5. On a road whose lanes end, instead of 3 and 4: the one that had moved into the other's path left a lane that ends
   within 600 m (`av-merges`, `bv-merges`) or came into an exit's lane (`leaving`); or neither had moved, and the AV was
   in a lane that ends so (`lane-end`).

A lane change counts once it has moved 0.2 m, while it lasts and for 3 s after; "moved into the path" means that when it
began the two did not overlap laterally and it went towards the other. A driver that turned back too late had moved into
the path too. If both moved under 3 or 4: the one that began later. Hard braking: -3 m/s2 or less within 3 s.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.contact import FRONT, REAR, find_contact
from cornerforge.analysis.crash_types import STRIKERS, classify_crashes
from cornerforge.analysis.site_case import KINDS_AT_SITES, in_av_frame, kind_at_site, site_case
from cornerforge.fields import POSE
from cornerforge.recordings import recordings_of
from cornerforge.road.lanes import lanes_of
from cornerforge.road.network import Lane
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Odd, Scenario

__all__ = [
    "AT_START_S",
    "MECHANISMS",
    "LaneChange",
    "Mechanism",
    "contact_pose",
    "crash_type_of",
    "entering_change",
    "is_free",
    "lane_changes_before",
    "lane_in",
    "mechanism_of",
    "mechanisms_of",
    "own_frame",
]

MECHANISMS: dict[str, str] = {
    "follow-up": "follows a crash between two BVs close by",
    "same-lane-same-side": "both enter the same lane from the same side",
    "same-lane-opposite-sides": "both enter the same lane from opposite sides",
    "swap": "each enters the lane that the other leaves",
    "bv-rear-av-cut-in": "BV runs into the rear of an AV that changed lanes into its path",
    "bv-rear-bv-change": "BV changes lanes into the AV's rear",
    "bv-rear-av-braking": "BV runs into the rear of an AV that brakes hard",
    "bv-rear": "BV runs into the rear of an AV that neither brakes hard nor changed lanes into its path",
    "av-rear-bv-cut-in": "AV runs into the rear of a BV that changed lanes into its path",
    "av-rear-av-change": "AV changes lanes into the BV's rear",
    "av-rear-bv-braking": "AV runs into the rear of a BV that brakes hard",
    "av-rear": "AV runs into the rear of a BV that neither brakes hard nor changed lanes into its path",
    "bv-side": "BV changes lanes into the side of the AV",
    "av-side": "AV changes lanes into the side of the BV",
    "av-merges": "AV leaves a lane that ends, into the path of the BV",
    "bv-merges": "BV leaves a lane that ends, into the path of the AV",
    "leaving": "AV or BV moves into the path of the other in the lane of an exit",
    "lane-end": "AV is where its lane ends, and neither moved into the path of the other",
    "other": "none of these",
}
"""Name and meaning, in the order of the rules; at a site `site_case.KINDS_AT_SITES` stand for them."""


def mechanisms_of(odd: Odd) -> dict[str, str]:
    """Look up names and meanings of what crashes can come of, on the road or at the site of an ODD."""
    return MECHANISMS if odd.site is None else KINDS_AT_SITES


AT_START_S = 4.0
"""A crash before this time [s] depends on how tests begin: all vehicles decide at once, in traffic just drawn."""

_FRAMES_PER_SECOND = round(1.0 / FRAME_S)
_RECENT_S = 3.0
_HARD_BRAKING = -3.0
_FOLLOW_UP_S = 5.0
_FOLLOW_UP_M = 100.0
_SETTLED_M = 0.01
_ENDS_SOON_M = 600.0
"""A lane that ends within this is one that drivers leave [m]: 20 s at 30 m/s."""
VISIBLE_M = 0.2
"""Sideways motion that can be seen, at least [m]: what a kind, a title and a sentence may name."""


@dataclass(frozen=True)
class Mechanism:
    """How one crash came about.

    Attributes:
        name: A key of `MECHANISMS`.
        plain: The same by rules 1 to 4.
        contact: "rear-end by AV", "rear-end by BV" or "side": which faces met.
        at_start: The crash came less than 4 s after the start of the test.
        av_changing: The AV changed lanes then, or had until 3 s before.
        bv_changing: The same for the partner.
        bv_start_after_av_s: When both did: the partner's lane change began so many seconds after the AV's (negative:
            before); None otherwise.
    """

    name: str
    plain: str
    contact: str
    at_start: bool
    av_changing: bool
    bv_changing: bool
    bv_start_after_av_s: float | None


@dataclass(frozen=True)
class LaneChange:
    """A vehicle's last lane change before contact: first frame, last frame, target lane, side (1 left, -1 right)."""

    start: int
    end: int
    target: int
    side: int


def contact_pose(scenario: Scenario) -> NDArray[np.float64]:
    """[x m, y m, speed m/s, heading rad] of the AV (0) and its partner (1) at contact, shape (2, 4).

    Raises:
        InputError: There is no crash of the AV, or the recording does not hold its contact.
    """
    frame, partner = scenario.contact()
    pair = [0, partner]
    return np.stack([getattr(scenario, name)[frame, pair] for name in POSE], axis=-1).astype(np.float64)


def crash_type_of(scenario: Scenario) -> tuple[str, str]:
    """Name the type of the AV's crash, and its striker, one of `crash_types.STRIKERS`.

    Raises:
        InputError: There is no crash of the AV, or the recording does not hold its contact.
    """
    types = classify_crashes(own_frame(contact_pose(scenario)[None], scenario.odd), *_sizes(scenario))
    return types.names[0], STRIKERS[int(types.striker[0])]


def _sizes(scenario: Scenario) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lengths and widths of the AV and its partner [m], (1, 2) each."""
    pair = [0, scenario.contact()[1]]
    return scenario.length[None, pair], scenario.width[None, pair]


def mechanism_of(scenario: Scenario) -> Mechanism:
    """Say how the AV's crash came about; the module's text states the rules.

    Args:
        scenario: Recording of a test that ended in a crash of the AV; vehicles more than 150 m away may be missing, as
            in a case library.

    Returns:
        The mechanism. The mirrored scenario (left for right) gives the same.

    Raises:
        InputError: There is no crash of the AV, or the recording does not hold its contact.
    """
    if scenario.odd.site is not None:
        return _at_site(scenario)
    frame, partner = scenario.contact()
    av_changes, bv_changes = lane_changes_before(scenario, frame, 0), lane_changes_before(scenario, frame, partner)
    av, bv = next(iter(av_changes), None), next(iter(bv_changes), None)
    contact = _contact_kind(scenario)
    plain = "follow-up" if _follows_bv_crash(scenario, frame) else _of_two_changes(av_changes, bv_changes)
    name = plain
    if plain is None:
        by_av = entering_change(scenario, frame, 0, partner)
        by_bv = entering_change(scenario, frame, partner, 0)
        entered_av, entered_bv = by_av is not None, by_bv is not None
        if by_av is not None and by_bv is not None:
            entered_av, entered_bv = by_av.start > by_bv.start, by_bv.start >= by_av.start
        plain = _of_contact(scenario, contact, frame, partner, entered_av, entered_bv)
        mover, change = (partner, by_bv) if entered_bv else (0, by_av)
        name = _where_lanes_end(scenario, mover, frame if change is None else change.start, change) or plain
    difference = None if av is None or bv is None else round((bv.start - av.start) * FRAME_S, 1)
    at_start = scenario.crash is not None and scenario.crash.time < AT_START_S
    return Mechanism(name or plain, plain, contact, at_start, av is not None, bv is not None, difference)


def _at_site(scenario: Scenario) -> Mechanism:
    """Name the kind of crash at a site (`site_case`); nobody changes lanes there."""
    name = kind_at_site(site_case(recordings_of(scenario), scenario.odd))
    early = scenario.crash is not None and scenario.crash.time < AT_START_S
    return Mechanism(
        name, name, _contact_kind(scenario), early, av_changing=False, bv_changing=False, bv_start_after_av_s=None
    )


def own_frame(pose: NDArray[np.floating], odd: Odd) -> NDArray[np.float64]:
    """Give poses in the frame in which crash types are told: the road's, at a site the AV's."""
    return np.asarray(pose, np.float64) if odd.site is None else in_av_frame(pose)


def _contact_kind(scenario: Scenario) -> str:
    faces = find_contact(own_frame(contact_pose(scenario)[None], scenario.odd), *_sizes(scenario))
    av, bv = int(faces.av_sector[0]), int(faces.bv_sector[0])
    if (av, bv) == (FRONT, REAR):
        return "rear-end by AV"
    return "rear-end by BV" if (av, bv) == (REAR, FRONT) else "side"


def lane_changes_before(scenario: Scenario, frame: int, column: int) -> list[LaneChange]:
    """Find the lane changes that a vehicle is in at a frame, or ended at most 3 s before, the newest first.

    An aborted lane change ends, and the one back begins, where the vehicle is farthest: it moves on for a while after
    it has decided to turn back. Motion of less than `VISIBLE_M` is none that a witness would see, and left out. Frames
    hold the target lane that was decided at them, so a change decided at the start shows in frame 0.
    """
    first = int(np.argmax(scenario.present[:, column]))
    target = scenario.target_lane[: frame + 1, column].astype(np.int64)
    away = (target + 0.5) * scenario.odd.lane_width - scenario.y[: frame + 1, column]
    starts = (np.flatnonzero(np.diff(target[first:]) != 0) + first + 1).tolist()
    if abs(away[first]) > _SETTLED_M:
        starts.insert(0, first)
    changes, farthest = [], 0
    for k, decided in enumerate(starts):
        following, after = (starts[i] if i < len(starts) else frame for i in (k + 1, k + 2))
        side = 1 if away[decided] > 0.0 else -1
        settled = np.flatnonzero(np.abs(away[decided : following + 1]) <= _SETTLED_M)
        start = max(decided, farthest)
        end = decided + int(settled[0]) if settled.size else following
        if not settled.size and following < frame:
            end = decided + int(np.argmax(side * scenario.y[decided : after + 1, column]))
            farthest = end
        moved = float(np.ptp(scenario.y[start : end + 1, column])) if end >= start else 0.0
        if (frame - end) * FRAME_S <= _RECENT_S and moved >= VISIBLE_M:
            changes.append(LaneChange(start, end, int(target[decided]), side))
    return changes[::-1]


def entering_change(scenario: Scenario, frame: int, mover: int, other: int) -> LaneChange | None:
    """Find the newest lane change of `lane_changes_before` with which the mover moved into the other's path."""
    changes = lane_changes_before(scenario, frame, mover)
    return next((change for change in changes if _came_from_outside(scenario, change, mover, other)), None)


def lane_in(scenario: Scenario, slot: int, x: float) -> Lane | None:
    """Find the lane in a slot at x of a road whose lanes begin or end; None: there is none, or the road is straight."""
    lanes = lanes_of(scenario.odd) if scenario.odd.road is not None else ()
    return next((lane for lane in lanes if lane.slot == slot and lane.begin <= x < lane.end), None)


def is_free(lane: Lane, x: float) -> bool:
    """Need a vehicle at x not leave a lane yet? It must from `_ENDS_SOON_M` before the end of a lane that ends."""
    return lane.kind in ("deceleration", "ramp") or float(along(x, lane.end)) > _ENDS_SOON_M


def _where_lanes_end(scenario: Scenario, mover: int, frame: int, change: LaneChange | None) -> str | None:
    """Rule 5; None if it does not fit. `frame`: when the mover's lane change began, without one that of the contact."""
    x, slot = float(scenario.x[frame, mover]), int(scenario.y[frame, mover] // scenario.odd.lane_width)
    new = None if change is None else lane_in(scenario, change.target, x)
    if new is not None and new.kind == "deceleration":
        return "leaving"
    old = lane_in(scenario, slot if change is None else change.target - change.side, x)
    if old is None or is_free(old, x):
        return None
    return "lane-end" if change is None else "av-merges" if mover == 0 else "bv-merges"


def _of_two_changes(av_changes: list[LaneChange], bv_changes: list[LaneChange]) -> str | None:
    """Rule 2: both change lanes at the same time; None if it does not fit."""
    for av, bv in itertools.product(av_changes, bv_changes):
        if av.start > bv.end or bv.start > av.end:
            continue
        if av.target == bv.target:
            return "same-lane-same-side" if av.side == bv.side else "same-lane-opposite-sides"
        if av.side != bv.side and av.target - av.side == bv.target and bv.target - bv.side == av.target:
            return "swap"
    return None


def _came_from_outside(scenario: Scenario, change: LaneChange, mover: int, other: int) -> bool:
    """Did the mover, when its lane change began, stand clear of the other laterally and turn towards it?"""
    start = change.start
    towards = (scenario.y[start, other] - scenario.y[start, mover]) * change.side
    clear = 0.5 * (scenario.width[mover] + scenario.width[other])
    return bool(scenario.present[start, other] and towards >= clear)


def _of_contact(
    scenario: Scenario, contact: str, frame: int, partner: int, entered_av: bool, entered_bv: bool
) -> str:  # fmt: skip
    """Rules 3 and 4; at most one of the two `entered_...` is True."""
    if contact == "side":
        return "bv-side" if entered_bv else "av-side" if entered_av else "other"
    by_bv = contact == "rear-end by BV"
    who, front_name = ("bv-rear", "av") if by_bv else ("av-rear", "bv")
    entered_front, entered_behind = (entered_av, entered_bv) if by_bv else (entered_bv, entered_av)
    if entered_front:
        return f"{who}-{front_name}-cut-in"
    if entered_behind:
        return "bv-rear-bv-change" if by_bv else "av-rear-av-change"
    return f"{who}-{front_name}-braking" if _braked(scenario, frame, 0 if by_bv else partner) else who


def _braked(scenario: Scenario, frame: int, column: int) -> bool:
    """Did a vehicle brake at -3 m/s2 or harder within the 3 s before a frame?"""
    first = max(0, frame - round(_RECENT_S * _FRAMES_PER_SECOND))
    held = scenario.acceleration[first : max(frame, 1), column]
    return bool(np.nanmin(held, initial=np.inf) <= _HARD_BRAKING)


def _follows_bv_crash(scenario: Scenario, frame: int) -> bool:
    """Did two BVs that touched vanish (so the simulator clears a BV-BV crash) within 5 s before and 100 m of the AV?"""
    first = max(1, frame - round(_FOLLOW_UP_S * _FRAMES_PER_SECOND))
    closed = scenario.odd.max_speed * FRAME_S  # what closing at full speed adds within the last frame
    for t in range(first, frame + 1):
        gone = np.flatnonzero(scenario.present[t - 1, 1:] & ~scenario.present[t, 1:]) + 1
        if gone.size < 2:
            continue
        x, y = scenario.x[t - 1, gone], scenario.y[t - 1, gone]
        length, width = scenario.length[gone], scenario.width[gone]
        reach, beside = 0.5 * (length[:, None] + length) + closed, 0.5 * (width[:, None] + width) + 1.0
        touched = (np.abs(along(x[:, None], x)) < reach) & (np.abs(y[:, None] - y) < beside)
        np.fill_diagonal(touched, val=False)
        near = np.abs(along(scenario.x[t - 1, 0], x)) <= _FOLLOW_UP_M
        if (touched.any(axis=1) & near).any():
            return True
    return False
