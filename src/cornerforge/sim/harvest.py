"""Crashes as columns: `keep_case` makes a case of any recorded crash; `harvest_range` drives and keeps in bulk.

Cases go into flat arrays; there is no Python object per case. `fields.py` says what a case's numbers mean.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.fields import BODY, CASE_ROW, HISTORY_SHAPE, REALS
from cornerforge.recordings import Recordings, recordings_of_columns
from cornerforge.road.straight import ahead_by, half_lengths, half_widths
from cornerforge.sim.controllers import POLICY, cast_index
from cornerforge.sim.drive import drive_test
from cornerforge.sim.outcome import AV_CRASH, write_outcome
from cornerforge.sim.site.contact import most_at_site, never_jumps, shortest_at_site
from cornerforge.sim.step import forget_frames
from cornerforge.site.tables import at_site, seen_from
from cornerforge.types import FRAME_S, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.keep import Decisions, Keep
    from cornerforge.sim.outcome import Outcomes
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "LIMITS",
    "MAX_ACCELERATION",
    "MAX_BRAKING",
    "MAX_LATERAL_ACCELERATION",
    "NEAR_M",
    "TOLERANCE",
    "Buffers",
    "CaseName",
    "Harvest",
    "Recorded",
    "allocate_harvest",
    "harvest_range",
    "is_full",
    "keep_case",
    "keep_driven",
]

NEAR_M = 150.0
"""Vehicles that come this near to the AV along the road [m] are stored."""
# Limits of a passenger car on a dry road [m/s2]: about 0.87 g braking, and the ODD's default bound across the road.
MAX_BRAKING = 8.5
MAX_ACCELERATION = 4.0
MAX_LATERAL_ACCELERATION = 4.0
# Differences of recorded frames are averages, so they exceed a bound only by rounding.
MAX_ACROSS_AT_SITE = 7.0
"""Most across the way at a site [m/s2]: 0.7 g, what tyres hold; there it comes of speed in a turn, not of a plan."""
TOLERANCE = 1e-3
LIMITS = {
    "acceleration": MAX_ACCELERATION + TOLERANCE,
    "braking": MAX_BRAKING + TOLERANCE,
    "lateral_acceleration": MAX_LATERAL_ACCELERATION + TOLERANCE,
}
"""Most [m/s2] of what is physically plausible, for readers of what was kept."""

_HISTORY_SECONDS, _PAIR, _HISTORY_VALUES = HISTORY_SHAPE
_HISTORY = _HISTORY_SECONDS * _PAIR * _HISTORY_VALUES
_FRAME_S2 = FRAME_S**2
_REALS = len(REALS)
_NEAR = 1


class CaseName(NamedTuple):
    """The name of a case: seed and number of its test; index in the mixture of the policy that drove it, or 0."""

    seed: int
    test: int
    policy: int


class Recorded(NamedTuple):
    """The extent of a recording: numbers of frames, decisions, vehicles; frame of contact; column of the partner."""

    frames: int
    decisions: int
    vehicles: int
    contact: int
    partner: int


class Harvest(NamedTuple):
    """Columns of cases, one case after the other in every array, none padded.

    Attributes:
        filled: int64 (9,): how much of the other arrays is used, see `FILLED`.
        rows: CASE_ROW (C,).
        history: float32 (C, 128).
        reals: float32 (5, .), `fields.REALS`, stored vehicle by vehicle, NaN where absent.
        target_lane: int8, -1 where absent; present: bool; in the same order.
        slot: int16, slots of the stored vehicles; kind: int8, their classes; length, width: float64, their sizes [m];
            change_time: float64, the time that their lane changes take [s].
        action: int8, decisions of the stored vehicles, vehicle by vehicle.
        critical_bv, critical_bv_action, log_prob: per decision: index into the case's slots, action, ln P.
        exact: float64, the real series of all vehicles, frame by frame, 0 where absent: the first part of a digest.
        marks: uint8, the rest of a digest: target lanes, presence, actions, critical BVs (two bytes each, low first).
        near: Scratch, int64 (slots,).
    """

    filled: NDArray[np.int64]
    rows: NDArray[np.void]
    history: NDArray[np.float32]
    reals: NDArray[np.float32]
    target_lane: NDArray[np.int8]
    present: NDArray[np.bool_]
    slot: NDArray[np.int16]
    kind: NDArray[np.int8]
    length: NDArray[np.float64]
    width: NDArray[np.float64]
    change_time: NDArray[np.float64]
    action: NDArray[np.int8]
    critical_bv: NDArray[np.int16]
    critical_bv_action: NDArray[np.int8]
    log_prob: NDArray[np.float64]
    exact: NDArray[np.float64]
    marks: NDArray[np.uint8]
    near: NDArray[np.int64]

    @property
    def n_cases(self) -> int:
        """Number of cases."""
        return int(self.filled[CASES_KEPT])

    def recordings(self) -> Recordings:
        """Take the motion of all cases, at least one, as a library that stores them gives it back.

        The arrays belong to the harvest: judge before it is filled again.
        """
        rows = self.rows[: self.n_cases]
        frames, vehicles = rows["n_frames"].astype(np.int64), rows["n_kept"].astype(np.int64)
        size, stored = int(vehicles.sum()), int((frames * vehicles).sum())
        return recordings_of_columns(
            names=np.stack([rows["seed"], rows["test"]], axis=1),
            frames=frames,
            vehicles=vehicles,
            last=frames - 1,
            slot=self.slot[:size],
            bv_slot=rows["bv_slot"].astype(np.int64),
            columns={
                **{body.name: getattr(self, body.name)[:size] for body in BODY},
                **{name: values[:stored] for name, values in zip(REALS, self.reals, strict=True)},
                "target_lane": self.target_lane[:stored],
                "present": self.present[:stored],
            },
        )

    @property
    def digested(self) -> tuple[int, int]:
        """How much of `exact` and `marks` is used."""
        return int(self.filled[EXACT]), int(self.filled[MARKS])

    def clear(self) -> None:
        """Forget all cases; the numbers of tests and crashes so far stay."""
        self.filled[:DRIVEN] = 0


FILLED = CASES_KEPT, NUMBERS, SLOTS, ACTIONS_KEPT, DECISIONS, EXACT, MARKS, DRIVEN, CRASHED = range(9)
"""Entries of `Harvest.filled`. DRIVEN, CRASHED: tests and crashes so far; `harvest_range` goes by their share."""


def allocate_harvest(cases: int, slots: int, max_decisions: int) -> Harvest:
    """Allocate columns for so many usual cases (fewer long ones), and for at least one of the longest.

    Args:
        cases: Largest number of cases.
        slots: Vehicle slots per world.
        max_decisions: Largest number of decisions of a test.
    """
    frames = SUBSTEPS * max_decisions + 1
    usual = frames * slots // 4  # about 40 % of the time limit with about half of the slots
    numbers = cases * usual + frames * slots
    decided = max_decisions * slots
    return Harvest(
        np.zeros(len(FILLED), dtype=np.int64),
        np.zeros(cases, dtype=CASE_ROW),
        np.zeros((cases, _HISTORY), dtype=np.float32),
        np.empty((_REALS, numbers), dtype=np.float32),
        target_lane=np.empty(numbers, dtype=np.int8),
        present=np.empty(numbers, dtype=np.bool_),
        slot=np.empty(cases * slots, dtype=np.int16),
        kind=np.empty(cases * slots, dtype=np.int8),
        length=np.empty(cases * slots),
        width=np.empty(cases * slots),
        change_time=np.empty(cases * slots),
        action=np.empty(cases * decided, dtype=np.int8),
        critical_bv=np.empty(cases * max_decisions, dtype=np.int16),
        critical_bv_action=np.empty(cases * max_decisions, dtype=np.int8),
        log_prob=np.empty(cases * max_decisions, dtype=np.float64),
        exact=np.empty(_REALS * numbers, dtype=np.float64),
        marks=np.empty(3 * numbers, dtype=np.uint8),
        near=np.zeros(slots, dtype=np.int64),
    )


@kernel
def is_full(h: Harvest, frames: int, slots: int) -> bool:
    """Is it possible that a case of so many frames and vehicles no longer fits?"""
    most = frames * slots
    filled = h.filled
    full: bool = (
        filled[CASES_KEPT] >= h.rows.size
        or filled[NUMBERS] + most > h.present.size
        or filled[EXACT] + _REALS * most > h.exact.size
        or filled[MARKS] + 3 * most > h.marks.size
    )
    return full


@kernel
def _peaks(recording: NDArray[np.void], frame: int, i: int) -> tuple[float, float, float]:
    """Find a vehicle's largest acceleration, braking and |lateral acceleration| [m/s2] up to a frame.

    NaN where it is present in fewer than 2 (for the last: 3) frames in a row.
    """
    along = 0.0
    braking = 0.0
    across = 0.0
    n_along = 0
    n_across = 0
    for t in range(frame):
        here = recording[t, i]
        after = recording[t + 1, i]
        if here.present == 0 or after.present == 0:
            continue
        n_along += 1
        change = (after.speed - here.speed) / FRAME_S
        along = max(along, change)
        braking = max(braking, -change)
        if t + 2 <= frame and recording[t + 2, i].present:
            n_across += 1
            bend = ((recording[t + 2, i].y - after.y) - (after.y - here.y)) / _FRAME_S2
            across = max(across, abs(bend))
    return (
        along if n_along else math.nan,
        braking if n_along else math.nan,
        across if n_across else math.nan,
    )


@kernel
def _min_ttc(recording: NDArray[np.void], frame: int, n: int, bodies: NDArray[np.void]) -> float:
    """Find the AV's smallest TTC [s] before `frame`, to vehicles in its path; NaN if it never closes on one."""
    shortest = math.inf
    for t in range(frame):
        av = recording[t, 0]
        for j in range(1, n):
            other = recording[t, j]
            if other.present == 0 or abs(other.y - av.y) >= half_widths(bodies, 0, j):
                continue
            dx = ahead_by(recording[t], 0, j)
            gap = abs(dx) - half_lengths(bodies, 0, j)
            rate = other.speed - av.speed
            rate = rate if dx > 0.0 else -rate
            if gap <= 0.0:
                shortest = 0.0
            elif rate < 0.0:
                shortest = min(shortest, gap / -rate)
    return shortest if shortest < math.inf else math.nan


@kernel
def _keep_labels(
    end: Recorded, recording: NDArray[np.void], bodies: NDArray[np.void], road: RoadNumbers, h: Harvest
) -> None:
    """Fill the labels of the contact, the extremes of the motion of AV and partner, and whether these are plausible."""
    frame = end.contact
    partner = end.partner
    row = h.rows[h.filled[CASES_KEPT]]
    av = recording[frame, 0]
    bv = recording[frame, partner]
    row.crash_time_s = frame / 10.0
    row.duration_s = (end.frames - 1) * FRAME_S
    row.bv_slot = partner
    row.av_speed_mps = av.speed
    row.bv_speed_mps = bv.speed
    row.impact_speed_difference_mps = bv.speed - av.speed
    row.relative_heading_rad = (bv.heading - av.heading + math.pi) % (2.0 * math.pi) - math.pi
    if at_site(road.site):
        row.relative_lon_m, row.relative_lat_m = seen_from(av, bv)
        row.av_lane = av.target_lane
        row.relative_lane = bv.target_lane - av.target_lane
    else:
        row.relative_lon_m = ahead_by(recording[frame], 0, partner)
        row.relative_lat_m = bv.y - av.y
        lane = math.floor(av.y / road.lane_width)
        row.av_lane = lane
        row.relative_lane = math.floor(bv.y / road.lane_width) - lane
    peaks, of_partner = (
        (most_at_site(recording, frame, 0, bodies), most_at_site(recording, frame, partner, bodies))
        if at_site(road.site)
        else (_peaks(recording, frame, 0), _peaks(recording, frame, partner))
    )
    along, braking, across = peaks
    row.av_max_acceleration_mps2 = along
    row.av_max_braking_mps2 = braking
    row.av_max_lateral_acceleration_mps2 = across
    bv_along, bv_braking, bv_across = of_partner
    row.bv_max_acceleration_mps2 = bv_along
    row.bv_max_braking_mps2 = bv_braking
    row.bv_max_lateral_acceleration_mps2 = bv_across
    most_across = MAX_ACROSS_AT_SITE if at_site(road.site) else MAX_LATERAL_ACCELERATION
    # NaN is never above a limit, as it should be: what was not seen broke no limit.
    row.physically_plausible = not (
        along > MAX_ACCELERATION + TOLERANCE
        or bv_along > MAX_ACCELERATION + TOLERANCE
        or braking > MAX_BRAKING + TOLERANCE
        or bv_braking > MAX_BRAKING + TOLERANCE
        or across > most_across + TOLERANCE
        or bv_across > most_across + TOLERANCE
    )
    row.bv_kind = bodies[partner].kind
    row.bv_length_m = bodies[partner].length
    row.bv_width_m = bodies[partner].width
    if at_site(road.site):
        row.physically_plausible &= never_jumps(recording, frame, 0) and never_jumps(recording, frame, partner)
        row.min_ttc_s = shortest_at_site(recording, frame, end.vehicles, bodies)
    else:
        row.min_ttc_s = _min_ttc(recording, frame, end.vehicles, bodies)


@inlined_kernel
def _real(cell: Any, q: int) -> float:
    """Give series q of `fields.REALS` of a vehicle in a frame; the first of them are the series of `fields.POSE`.

    Numba's own way to take fields by name, `literal_unroll`, fails on Python 3.12 and later.
    """
    value: float = cell.x
    if q == 1:
        value = cell.y
    elif q == 2:
        value = cell.speed
    elif q == 3:
        value = cell.heading
    elif q == 4:
        value = cell.acceleration
    return value


@kernel
def _keep_history(end: Recorded, recording: NDArray[np.void], h: Harvest) -> None:
    """Fill the states of AV and partner at each second before the contact."""
    history = h.history[h.filled[CASES_KEPT]]
    for k in range(_HISTORY):
        history[k] = math.nan
    for second in range(_HISTORY_SECONDS):
        frame = end.contact - SUBSTEPS * second
        if frame < 0:
            break
        for who in range(_PAIR):
            cell = recording[frame, 0 if who == 0 else end.partner]
            if cell.present:
                place = (_PAIR * second + who) * _HISTORY_VALUES
                for q in range(_HISTORY_VALUES):
                    history[place + q] = _real(cell, q)


@kernel
def _find_near(
    end: Recorded, near_m: float, recording: NDArray[np.void], decisions: Decisions, road: RoadNumbers,
    near: NDArray[np.int64],
) -> int:  # fmt: skip
    """Write each vehicle's index among the stored vehicles into `near`, -1 for the others; return how many."""
    n = end.vehicles
    for i in range(n):
        near[i] = _NEAR if near_m == math.inf else -1
    near[0] = _NEAR
    near[end.partner] = _NEAR
    for k in range(end.decisions):
        if decisions.controlled[k] >= 0:
            near[decisions.controlled[k]] = _NEAR
    for t in range(end.frames):
        for i in range(1, n):
            cell = recording[t, i]
            if near[i] >= 0 or cell.present == 0:
                continue
            away = abs(ahead_by(recording[t], 0, i))
            if at_site(road.site):
                away = max(away, abs(cell.y - recording[t, 0].y))
            if away <= near_m:
                near[i] = _NEAR
    kept = 0
    for i in range(n):
        if near[i] >= 0:
            near[i] = kept
            kept += 1
    return kept


@inlined_kernel
def _action(recording: NDArray[np.void], decisions: Decisions, k: int, i: int) -> int:
    """Look up vehicle i's action at decision k; -1 where it is absent."""
    action: int = decisions.action[k, i] if recording[SUBSTEPS * k, i].present else -1
    return action


@kernel
def _keep_decisions(
    end: Recorded, recording: NDArray[np.void], decisions: Decisions, bodies: NDArray[np.void], h: Harvest
) -> None:
    """Fill class, size and actions of the stored vehicles, and the log-probabilities of the critical BV's actions."""
    filled = h.filled
    row = h.rows[filled[CASES_KEPT]]
    near = h.near
    for i in range(end.vehicles):
        if near[i] >= 0:
            h.slot[filled[SLOTS]] = i
            h.kind[filled[SLOTS]] = bodies[i].kind
            h.length[filled[SLOTS]] = bodies[i].length
            h.width[filled[SLOTS]] = bodies[i].width
            h.change_time[filled[SLOTS]] = bodies[i].change_time
            filled[SLOTS] += 1
            for k in range(end.decisions):
                h.action[filled[ACTIONS_KEPT]] = _action(recording, decisions, k, i)
                filled[ACTIONS_KEPT] += 1
    row.log_prob_nde = 0.0
    row.n_impossible = 0
    row.possible_shortfall_nats = 0.0
    row.n_implausible = 0
    row.excess_nats = 0.0
    stretch = 0.0
    row.log_prob_policy = 0.0
    row.hidden = 0
    for k in range(end.decisions):
        place = filled[DECISIONS] + k
        critical = decisions.controlled[k]
        h.critical_bv[place] = near[critical] if critical >= 0 else -1
        # An absent vehicle is never critical, so this action always belongs to a present vehicle.
        h.critical_bv_action[place] = decisions.action[k, critical] if critical >= 0 else -1
        h.log_prob[place] = decisions.log_prob[k]
        row.log_prob_policy += decisions.log_prob_policy[k]
        if decisions.hidden[k]:
            row.hidden |= 1 << k
        if decisions.log_prob[k] == -math.inf:
            row.n_impossible += 1
        row.log_prob_nde += decisions.log_prob[k]
        stretch = 0.0 if stretch + decisions.excess[k] < 0.0 else stretch + decisions.excess[k]
        row.excess_nats = row.excess_nats if stretch <= row.excess_nats else stretch  # NaN stays
        if decisions.shortfall[k] == math.inf:
            row.n_implausible += 1
        else:
            row.possible_shortfall_nats += decisions.shortfall[k]
    if row.n_impossible > 0:
        row.log_prob_nde = math.nan
    row.shortfall_nats = math.inf if row.n_implausible > 0 else row.possible_shortfall_nats
    filled[DECISIONS] += end.decisions


@kernel
def _keep_tracks(end: Recorded, recording: NDArray[np.void], h: Harvest) -> None:
    """Fill the series of the stored vehicles."""
    filled = h.filled
    for i in range(end.vehicles):
        if h.near[i] < 0:
            continue
        for t in range(end.frames):
            place = filled[NUMBERS] + t
            cell = recording[t, i]
            there = cell.present != 0
            for q in range(_REALS):
                h.reals[q, place] = _real(cell, q) if there else math.nan
            h.target_lane[place] = cell.target_lane if there else -1
            h.present[place] = there
        filled[NUMBERS] += end.frames


@kernel
def _keep_exact(end: Recorded, recording: NDArray[np.void], decisions: Decisions, h: Harvest) -> None:
    """Fill all that `recorder.scenario_digest` covers, in its order."""
    filled = h.filled
    n = end.vehicles
    size = end.frames * n
    exact = filled[EXACT]
    marks = filled[MARKS]
    for t in range(end.frames):
        for i in range(n):
            cell = recording[t, i]
            place = t * n + i
            there = cell.present != 0
            for q in range(_REALS):
                h.exact[exact + place + q * size] = _real(cell, q) if there else 0.0
            h.marks[marks + place] = cell.target_lane & 255 if there else 255
            h.marks[marks + size + place] = 1 if there else 0
    filled[EXACT] += _REALS * size
    marks += 2 * size
    for k in range(end.decisions):
        for i in range(n):
            h.marks[marks + k * n + i] = _action(recording, decisions, k, i) & 255
    marks += end.decisions * n
    for k in range(end.decisions):
        h.marks[marks + 2 * k] = decisions.controlled[k] & 255
        h.marks[marks + 2 * k + 1] = (decisions.controlled[k] >> 8) & 255
    filled[MARKS] = marks + 2 * end.decisions


@kernel
def keep_case(
    name: CaseName, end: Recorded, near_m: float, road: RoadNumbers, recording: NDArray[np.void], decisions: Decisions,
    bodies: NDArray[np.void], h: Harvest,
) -> None:  # fmt: skip
    """Append a recorded crash of the AV to the columns: the only way in which cases are made.

    Args:
        name: The case's name.
        end: The extent of the recording.
        near_m: Vehicles that come this near to the AV along the road, at a site east and north, are stored [m], besides
            its partner and critical BVs; infinite: all.
        road: Constants of the recording.
        recording, decisions: Frames and decisions of the test.
        bodies: Class and size of each vehicle, records with the fields of `fields.BODY`.
        h: The columns; they must not be full (`is_full`).
    """
    row = h.rows[h.filled[CASES_KEPT]]
    row.seed = name.seed
    row.test = name.test
    row.policy = name.policy
    row.n_vehicles = end.vehicles
    row.n_decisions = end.decisions
    row.n_frames = end.frames
    row.n_kept = _find_near(end, near_m, recording, decisions, road, h.near)
    _keep_labels(end, recording, bodies, road, h)
    _keep_history(end, recording, h)
    _keep_decisions(end, recording, decisions, bodies, h)
    _keep_tracks(end, recording, h)
    _keep_exact(end, recording, decisions, h)
    h.filled[CASES_KEPT] += 1


@kernel
def keep_driven(w: World, setting: Setting, keep: Keep, h: Harvest) -> None:
    """Append the test that has just been driven and kept whole, and that ended in a crash of the AV, as a case."""
    state = w.state[0]
    n_policies = setting.who.cast.members.size
    policy = cast_index(state.seed, state.test, n_policies) if n_policies > 0 else 0
    name = CaseName(state.seed, state.test, policy)
    end = Recorded(state.frame + 1, -(-state.frame // SUBSTEPS), state.n_vehicles, state.frame, state.slot_b)
    keep_case(name, end, NEAR_M, setting.road, keep.recording, keep.decisions, w.vehicles, h)


class Buffers(NamedTuple):
    """The memory that `harvest_range` drives in.

    Attributes:
        world, scratch: Memory to drive in.
        counted: What is kept of a test that is not recorded: counts.
        whole_counted: What is kept of a test that is recorded at once: counts, frames and decisions.
        whole: What is kept of a crashed test that is driven again: frames and decisions.
    """

    world: World
    scratch: Scratch
    counted: Keep
    whole_counted: Keep
    whole: Keep


@kernel
def harvest_range(seed: int, first: int, setting: Setting, at: Buffers, out: Outcomes, h: Harvest) -> int:
    """Drive tests first, first + 1, ... and append every AV crash, until `out` or `h` is full.

    Where most tests crash, tests are recorded at once; else crashed tests are driven again. What is stored is the same.

    Args:
        seed, first: The tests.
        setting: The run.
        at: The memory to drive in; all vehicles are absent in its recording. Each test is counted once.
        out: How each test ended.
        h: The columns to append to.

    Returns:
        The number of tests driven.
    """
    w, s, recording = at.world, at.scratch, at.whole.recording
    for k in range(out.code.size):
        if is_full(h, recording.shape[0], recording.shape[1]):
            return k
        test = first + k
        # A policy is taken for a good one until it is known better.
        knows_none = h.filled[DRIVEN] == 0 and setting.who.critical == POLICY
        at_once = 2 * h.filled[CRASHED] > h.filled[DRIVEN] or knows_none
        drive_test(w, seed, test, setting, s, at.whole_counted if at_once else at.counted)
        crashed = w.state[0].outcome == AV_CRASH
        if crashed and not at_once:
            drive_test(w, seed, test, setting, s, at.whole)
        write_outcome(w, out, k, setting.road)
        h.filled[DRIVEN] += 1
        if crashed:
            h.filled[CRASHED] += 1
            keep_driven(w, setting, at.whole, h)
        if crashed or at_once:
            forget_frames(recording, w.state[0].frame + 1, w.state[0].n_vehicles)
    return out.code.size
