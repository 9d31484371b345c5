"""Crashes as columns: drive a range of tests and put every AV crash into flat arrays, with no Python object per case.

What a case's numbers mean stands in `library/schema.py`; `library/record.py` makes the same from one `Scenario`,
slowly, and is the referee of the tests.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.sim.drive import drive_test
from cornerforge.sim.keep import write_outcome
from cornerforge.sim.setting import POLICY, cast_index
from cornerforge.sim.step import SUBSTEPS, forget_frames
from cornerforge.sim.world import AV_CRASH
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.keep import Decisions, Keep, Outcomes
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "CASE_ROW",
    "HISTORY_SECONDS",
    "MAX_ACCELERATION",
    "MAX_BRAKING",
    "MAX_LATERAL_ACCELERATION",
    "NEAR_M",
    "TOLERANCE",
    "Buffers",
    "Harvest",
    "allocate_harvest",
    "harvest_range",
    "keep_case",
]

NEAR_M = 150.0
"""Vehicles that come this near to the AV along the road [m] are stored."""
HISTORY_SECONDS = 16
"""Seconds 0..15 before the contact are kept as a case's history."""
# Limits of a passenger car on a dry road: about 0.87 g braking, and the ODD's default bound across the road.
MAX_BRAKING = 8.5
MAX_ACCELERATION = 4.0
MAX_LATERAL_ACCELERATION = 4.0
# Differences of recorded frames are averages, so they exceed a bound only by rounding.
TOLERANCE = 1e-3

_HISTORY = HISTORY_SECONDS * 2 * 4
_FRAME_S2 = FRAME_S**2
_SERIES = 5
_NEAR = 1

CASE_ROW = np.dtype(
    [
        ("test", "i8"),
        ("crash_time_s", "f8"),
        ("duration_s", "f8"),
        ("bv_slot", "i2"),
        ("av_speed_mps", "f8"),
        ("bv_speed_mps", "f8"),
        ("impact_speed_difference_mps", "f8"),
        ("relative_heading_rad", "f8"),
        ("relative_lon_m", "f8"),
        ("relative_lat_m", "f8"),
        ("av_lane", "i1"),
        ("relative_lane", "i1"),
        ("av_max_acceleration_mps2", "f8"),
        ("av_max_braking_mps2", "f8"),
        ("av_max_lateral_acceleration_mps2", "f8"),
        ("bv_max_acceleration_mps2", "f8"),
        ("bv_max_braking_mps2", "f8"),
        ("bv_max_lateral_acceleration_mps2", "f8"),
        ("physically_plausible", "u1"),
        ("min_ttc_s", "f8"),
        ("n_vehicles", "i2"),
        ("n_decisions", "i2"),
        ("log_prob_nde", "f8"),
        ("n_impossible", "i2"),
        ("shortfall_nats", "f8"),
        ("n_implausible", "i8"),
        ("log_prob_policy", "f8"),
        ("policy", "i8"),
        ("n_frames", "i4"),
        ("n_kept", "i4"),
    ],
    align=True,
)
"""One case, by the names of `library.schema`; NaN stands for null. policy: index in the mixture; n_kept: vehicles."""


class Harvest(NamedTuple):
    """Where cases go; one after the other in every array, none padded.

    Attributes:
        filled: int64 (9,): how much of the other arrays is used, see `FILLED`.
        rows: CASE_ROW (C,).
        history: float32 (C, 128).
        x, y, speed, heading, acceleration: float32, stored vehicle by vehicle, NaN where absent.
        target_lane: int8, -1 where absent; present: bool; likewise.
        slot: int16, slots of the stored vehicles.
        action: int8, decisions of the stored vehicles, vehicle by vehicle.
        critical_bv, critical_bv_action, log_prob: per decision: index into the case's slots, action, ln P.
        exact: float64, five series of all vehicles, frame by frame, 0 where absent: what a digest covers.
        marks: uint8, what else it covers: target lanes, presence, actions, critical BVs (two bytes each, low first).
        near: Scratch, int64 (slots,).
    """

    filled: NDArray[np.int64]
    rows: NDArray[np.void]
    history: NDArray[np.float32]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    speed: NDArray[np.float32]
    heading: NDArray[np.float32]
    acceleration: NDArray[np.float32]
    target_lane: NDArray[np.int8]
    present: NDArray[np.bool_]
    slot: NDArray[np.int16]
    action: NDArray[np.int8]
    critical_bv: NDArray[np.int16]
    critical_bv_action: NDArray[np.int8]
    log_prob: NDArray[np.float64]
    exact: NDArray[np.float64]
    marks: NDArray[np.uint8]
    near: NDArray[np.int64]


FILLED = CASES, NUMBERS, SLOTS, ACTIONS, DECISIONS, EXACT, MARKS, DRIVEN, CRASHED = range(9)
"""Entries of `Harvest.filled`. DRIVEN, CRASHED: tests and crashes so far, by which the next range is driven."""


def allocate_harvest(cases: int, slots: int, max_decisions: int) -> Harvest:
    """Room for so many usual cases (fewer of the longest); never less than one of the longest.

    Args:
        cases: At most.
        slots: Vehicle slots per world.
        max_decisions: Of a test.
    """
    frames = SUBSTEPS * max_decisions + 1
    usual = frames * slots // 4  # about 40 % of the time limit with about half of the slots
    numbers = cases * usual + frames * slots
    decided = max_decisions * slots
    x, y, speed, heading, acceleration = (np.empty(numbers, dtype=np.float32) for _ in range(_SERIES))
    return Harvest(
        np.zeros(len(FILLED), dtype=np.int64),
        np.zeros(cases, dtype=CASE_ROW),
        np.zeros((cases, _HISTORY), dtype=np.float32),
        x,
        y,
        speed,
        heading,
        acceleration,
        target_lane=np.empty(numbers, dtype=np.int8),
        present=np.empty(numbers, dtype=np.bool_),
        slot=np.empty(cases * slots, dtype=np.int16),
        action=np.empty(cases * decided, dtype=np.int8),
        critical_bv=np.empty(cases * max_decisions, dtype=np.int16),
        critical_bv_action=np.empty(cases * max_decisions, dtype=np.int8),
        log_prob=np.empty(cases * max_decisions, dtype=np.float64),
        exact=np.empty(_SERIES * numbers, dtype=np.float64),
        marks=np.empty(3 * numbers, dtype=np.uint8),
        near=np.zeros(slots, dtype=np.int64),
    )


@kernel
def _is_full(h: Harvest, frames: int, slots: int) -> bool:
    """May the longest case not fit any more?"""
    most = frames * slots
    filled = h.filled
    full: bool = (
        filled[CASES] >= h.rows.size
        or filled[NUMBERS] + most > h.x.size
        or filled[EXACT] + _SERIES * most > h.exact.size
        or filled[MARKS] + 3 * most > h.marks.size
    )
    return full


@kernel
def _peaks(recording: NDArray[np.void], frame: int, i: int) -> tuple[float, float, float]:
    """Largest acceleration, braking and |lateral acceleration| of a vehicle up to a frame; NaN below 2 or 3 frames."""
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
def _min_ttc(recording: NDArray[np.void], frame: int, n: int, length: float, width: float) -> float:
    """Smallest TTC [s] of the AV before contact with vehicles in its path; NaN if never closing."""
    shortest = math.inf
    for t in range(frame):
        av = recording[t, 0]
        for j in range(1, n):
            other = recording[t, j]
            if other.present == 0 or abs(other.y - av.y) >= width:
                continue
            dx = other.x - av.x
            gap = abs(dx) - length
            rate = other.speed - av.speed
            rate = rate if dx > 0.0 else -rate
            if gap <= 0.0:
                shortest = 0.0
            elif rate < 0.0:
                shortest = min(shortest, gap / -rate)
    return shortest if shortest < math.inf else math.nan


@kernel
def _keep_labels(w: World, recording: NDArray[np.void], setting: Setting, h: Harvest) -> None:
    """What the contact looked like, and what AV and partner did to the physics."""
    road = setting.road
    frame = w.state[0].frame
    partner = w.state[0].slot_b
    row = h.rows[h.filled[CASES]]
    av = recording[frame, 0]
    bv = recording[frame, partner]
    row.crash_time_s = frame / 10.0
    row.duration_s = frame * FRAME_S
    row.bv_slot = partner
    row.av_speed_mps = av.speed
    row.bv_speed_mps = bv.speed
    row.impact_speed_difference_mps = bv.speed - av.speed
    row.relative_heading_rad = (bv.heading - av.heading + math.pi) % (2.0 * math.pi) - math.pi
    row.relative_lon_m = bv.x - av.x
    row.relative_lat_m = bv.y - av.y
    lane = math.floor(av.y / road.lane_width)
    row.av_lane = lane
    row.relative_lane = math.floor(bv.y / road.lane_width) - lane
    along, braking, across = _peaks(recording, frame, 0)
    row.av_max_acceleration_mps2 = along
    row.av_max_braking_mps2 = braking
    row.av_max_lateral_acceleration_mps2 = across
    bv_along, bv_braking, bv_across = _peaks(recording, frame, partner)
    row.bv_max_acceleration_mps2 = bv_along
    row.bv_max_braking_mps2 = bv_braking
    row.bv_max_lateral_acceleration_mps2 = bv_across
    # NaN is never above a limit, as it should be: what was not seen broke none.
    row.physically_plausible = not (
        along > MAX_ACCELERATION + TOLERANCE
        or bv_along > MAX_ACCELERATION + TOLERANCE
        or braking > MAX_BRAKING + TOLERANCE
        or bv_braking > MAX_BRAKING + TOLERANCE
        or across > MAX_LATERAL_ACCELERATION + TOLERANCE
        or bv_across > MAX_LATERAL_ACCELERATION + TOLERANCE
    )
    row.min_ttc_s = _min_ttc(recording, frame, w.state[0].n_vehicles, road.length, road.width)


@kernel
def _keep_history(w: World, recording: NDArray[np.void], h: Harvest) -> None:
    """The seconds before the contact, of AV and partner."""
    history = h.history[h.filled[CASES]]
    for k in range(_HISTORY):
        history[k] = math.nan
    for second in range(HISTORY_SECONDS):
        frame = w.state[0].frame - SUBSTEPS * second
        if frame < 0:
            break
        for who in range(2):
            cell = recording[frame, 0 if who == 0 else w.state[0].slot_b]
            place = (2 * second + who) * 4
            if cell.present:
                history[place] = cell.x
                history[place + 1] = cell.y
                history[place + 2] = cell.speed
                history[place + 3] = cell.heading


@kernel
def _find_near(
    w: World, recording: NDArray[np.void], decisions: Decisions, decided: int, near: NDArray[np.int64]
) -> int:
    """Mark whom to store, by their index among the stored, -1 for the others; returns their number."""
    n = w.state[0].n_vehicles
    for i in range(n):
        near[i] = -1
    near[0] = _NEAR
    near[w.state[0].slot_b] = _NEAR
    for k in range(decided):
        if decisions.controlled[k] >= 0:
            near[decisions.controlled[k]] = _NEAR
    for t in range(w.state[0].frame + 1):
        for i in range(1, n):
            cell = recording[t, i]
            if near[i] < 0 and cell.present and abs(cell.x - recording[t, 0].x) <= NEAR_M:
                near[i] = _NEAR
    kept = 0
    for i in range(n):
        if near[i] >= 0:
            near[i] = kept
            kept += 1
    return kept


@kernel
def _keep_decisions(w: World, recording: NDArray[np.void], decisions: Decisions, decided: int, h: Harvest) -> None:
    """Actions of the stored vehicles, and what the critical BV's were worth."""
    filled = h.filled
    row = h.rows[filled[CASES]]
    near = h.near
    for i in range(w.state[0].n_vehicles):
        if near[i] >= 0:
            h.slot[filled[SLOTS]] = i
            filled[SLOTS] += 1
            for k in range(decided):
                there = recording[SUBSTEPS * k, i].present
                h.action[filled[ACTIONS]] = decisions.action[k, i] if there else -1
                filled[ACTIONS] += 1
    row.log_prob_nde = 0.0
    row.n_impossible = 0
    row.shortfall_nats = 0.0
    row.n_implausible = 0
    row.log_prob_policy = 0.0
    for k in range(decided):
        place = filled[DECISIONS] + k
        critical = decisions.controlled[k]
        h.critical_bv[place] = near[critical] if critical >= 0 else -1
        # An absent vehicle is never critical, so its action is always that of somebody there.
        h.critical_bv_action[place] = decisions.action[k, critical] if critical >= 0 else -1
        h.log_prob[place] = decisions.log_prob[k]
        row.log_prob_policy += decisions.log_prob_policy[k]
        if decisions.log_prob[k] == -math.inf:
            row.n_impossible += 1
        row.log_prob_nde += decisions.log_prob[k]
        if decisions.shortfall[k] == math.inf:
            row.n_implausible += 1
        else:
            row.shortfall_nats += decisions.shortfall[k]
    if row.n_impossible > 0:
        row.log_prob_nde = math.nan
    filled[DECISIONS] += decided


@kernel
def _keep_tracks(w: World, recording: NDArray[np.void], h: Harvest) -> None:
    """Series of the stored vehicles."""
    filled = h.filled
    for i in range(w.state[0].n_vehicles):
        if h.near[i] < 0:
            continue
        for t in range(w.state[0].frame + 1):
            place = filled[NUMBERS] + t
            cell = recording[t, i]
            there = cell.present != 0
            h.present[place] = there
            h.x[place] = cell.x if there else math.nan
            h.y[place] = cell.y if there else math.nan
            h.speed[place] = cell.speed if there else math.nan
            h.heading[place] = cell.heading if there else math.nan
            h.acceleration[place] = cell.acceleration if there else math.nan
            h.target_lane[place] = cell.target_lane if there else -1
        filled[NUMBERS] += w.state[0].frame + 1


@kernel
def _keep_exact(w: World, recording: NDArray[np.void], decisions: Decisions, decided: int, h: Harvest) -> None:
    """All that `recorder.scenario_digest` covers, in its order."""
    filled = h.filled
    n = w.state[0].n_vehicles
    frames = w.state[0].frame + 1
    size = frames * n
    exact = filled[EXACT]
    marks = filled[MARKS]
    for t in range(frames):
        for i in range(n):
            cell = recording[t, i]
            place = t * n + i
            there = cell.present != 0
            h.exact[exact + place] = cell.x if there else 0.0
            h.exact[exact + size + place] = cell.y if there else 0.0
            h.exact[exact + 2 * size + place] = cell.speed if there else 0.0
            h.exact[exact + 3 * size + place] = cell.heading if there else 0.0
            h.exact[exact + 4 * size + place] = cell.acceleration if there else 0.0
            h.marks[marks + place] = cell.target_lane & 255 if there else 255
            h.marks[marks + size + place] = 1 if there else 0
    filled[EXACT] += _SERIES * size
    marks += 2 * size
    for k in range(decided):
        for i in range(n):
            there = recording[SUBSTEPS * k, i].present != 0
            h.marks[marks + k * n + i] = decisions.action[k, i] & 255 if there else 255
    marks += decided * n
    for k in range(decided):
        h.marks[marks + 2 * k] = decisions.controlled[k] & 255
        h.marks[marks + 2 * k + 1] = (decisions.controlled[k] >> 8) & 255
    filled[MARKS] = marks + 2 * decided


@kernel
def keep_case(w: World, setting: Setting, keep: Keep, h: Harvest) -> None:
    """Store the crash of the AV that a world has just ended in.

    Args:
        w: The world, after its test.
        setting: The run.
        keep: Frames and decisions of the whole test.
        h: Where the case goes, behind those that are there.
    """
    state = w.state[0]
    recording, decisions = keep.recording, keep.decisions
    row = h.rows[h.filled[CASES]]
    decided = -(-state.frame // SUBSTEPS)
    row.test = state.test
    row.n_vehicles = state.n_vehicles
    row.n_decisions = decided
    row.n_frames = state.frame + 1
    n_policies = setting.who.cast.members.size
    row.policy = cast_index(state.seed, state.test, n_policies) if n_policies > 0 else 0
    row.n_kept = _find_near(w, recording, decisions, decided, h.near)
    _keep_labels(w, recording, setting, h)
    _keep_history(w, recording, h)
    _keep_decisions(w, recording, decisions, decided, h)
    _keep_tracks(w, recording, h)
    _keep_exact(w, recording, decisions, decided, h)
    h.filled[CASES] += 1


class Buffers(NamedTuple):
    """Where a harvest drives: a world, scratch, and what is kept of a test that is recorded, and of one that is not."""

    world: World
    scratch: Scratch
    whole: Keep
    nothing: Keep


@kernel
def harvest_range(seed: int, first: int, setting: Setting, at: Buffers, out: Outcomes, h: Harvest) -> int:
    """Drive tests first, first + 1, ... and store every AV crash, until `out` or the room is at an end.

    Where most tests crash they are recorded at once, else only crashes are driven again; what is stored is the same.

    Args:
        seed, first: Which tests.
        setting: The run.
        at: Where they are driven; its recording holds nobody.
        out: How each ended.
        h: Where the cases go, behind those that are there.

    Returns:
        Tests done.
    """
    w, s, recording = at.world, at.scratch, at.whole.recording
    for k in range(out.code.size):
        if _is_full(h, recording.shape[0], recording.shape[1]):
            return k
        test = first + k
        # A policy is taken for a good one until it is known better.
        knows_none = h.filled[DRIVEN] == 0 and setting.who.critical == POLICY
        at_once = 2 * h.filled[CRASHED] > h.filled[DRIVEN] or knows_none
        drive_test(w, seed, test, setting, s, at.whole if at_once else at.nothing)
        write_outcome(w, out, k, setting.road)
        h.filled[DRIVEN] += 1
        crashed = w.state[0].outcome == AV_CRASH
        if crashed:
            h.filled[CRASHED] += 1
            if not at_once:
                drive_test(w, seed, test, setting, s, at.whole)
            keep_case(w, setting, at.whole, h)
        if crashed or at_once:
            forget_frames(recording, w.state[0].frame + 1, w.state[0].n_vehicles)
    return out.code.size
