"""The loop of `sim.advance` in natural traffic with a clock between its parts.

`timed_tests` calls the same kernels in the same order on the same worlds as the simulator and reads the clock after
each. Its end frames and positions are handed out, so that its caller can see that it drove what the simulator drives.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numba
import numpy as np

from cornerforge._philox import PURPOSE_DECIDE, blocks, uniform
from cornerforge.drivers.naturalistic import following_row, free_row, sample_row
from cornerforge.drivers.policy import best_action, q_values
from cornerforge.drivers.sight import DECIDED
from cornerforge.road.straight import distance_left
from cornerforge.sim.actions import apply_action
from cornerforge.sim.av import av_decide
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.neighbours import nearest_bv, neighbours_in_lane
from cornerforge.sim.observe import allowed_actions, observe
from cornerforge.sim.outcome import COMPLETED, RUNNING, TIME_UP
from cornerforge.sim.reach import bound_motion, choose_current, find_pairs
from cornerforge.sim.step import _check_contacts, _move, av_acts
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import NO_ACTION, NO_VEHICLE, moment_of
from cornerforge.types import ACCELERATIONS, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.scratch import ChoiceScratch, Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = ["EXTRAS", "PARTS", "RESET", "SEED", "clock_cost", "timed_tests"]

SEED = 0
PARTS = (
    "initial traffic (`reset_world`, once a test)",
    "BVs decide (`decide_bvs`)",
    "BVs begin their actions (`apply_action`)",
    "AV decides, 10 x (`av_decide`)",
    "pairs that can touch, whom the AV may see (`find_pairs`, `choose_current`)",
    "motion, 10 x (`_move`)",
    "contacts, 10 x (`_check_contacts`)",
)
RESET, DECIDE, APPLY, AV, FIND_PAIRS, MOVE, CONTACTS = range(7)
EXTRAS = (
    "of BVs decide: random numbers (Philox), one block a BV",
    "of BVs decide: look-ups in the tables, free flow and one lead a BV",
    "adversary: nearest BV and its observation (`observe`)",
    "adversary: allowed actions (`allowed_actions`), unbounded",
    "adversary: allowed actions, NDD-bounded",
    "adversary: Q-network (`q_values`) and `best_action`",
)
PHILOX, LOOK_UPS, OBSERVE, ALLOWED, BOUNDED, NETWORK = range(6)

_ACCELERATIONS = ACCELERATIONS
_NANOSECONDS = 1_000_000_000
_read_clock = ctypes.CDLL(None).clock_gettime
_read_clock.argtypes = [ctypes.c_int, ctypes.c_void_p]
_read_clock.restype = ctypes.c_int
_MONOTONIC = time.CLOCK_MONOTONIC

F = TypeVar("F", bound=Callable[..., object])


def _compiled(function: F) -> F:
    """As `cornerforge._jit.kernel`, without the cache on disk, which functions that call into C cannot have."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    return cast("F", numba.njit(**options)(function))


@_compiled
def _now(clock: NDArray[np.int64]) -> int:
    """Nanoseconds of the monotonic clock; `clock` (2,) receives the seconds and the rest."""
    _read_clock(_MONOTONIC, clock.ctypes.data)
    return int(clock[0] * _NANOSECONDS + clock[1])


@_compiled
def clock_cost(clock: NDArray[np.int64], looks: int) -> float:
    """Nanoseconds that one look at the clock takes."""
    start = _now(clock)
    for _ in range(looks - 1):
        _now(clock)
    return (_now(clock) - start) / looks


@_compiled
def _lap(ns: NDArray[np.int64], part: int, since: int, clock: NDArray[np.int64]) -> int:
    """Book the time since `since` on a part, with one look at the clock; returns the present time."""
    now = _now(clock)
    ns[part, 0] += now - since
    ns[part, 1] += 1
    return now


@_compiled
def _timed_substeps(
    w: World, setting: Setting, ns: NDArray[np.int64], clock: NDArray[np.int64], since: int
) -> int:  # fmt: skip
    """The rest of a second begun: 10 substeps (`move_on`), or fewer when the test ends."""
    v, state, road = w.vehicles, w.state[0], setting.road
    first_frame = SUBSTEPS * (state.decisions - 1)
    for substep in range(SUBSTEPS):
        if substep > 0 and substep % road.av_substeps == 0:
            command, lane = av_decide(w, road, setting.av)
            av_acts(w, command, lane, road)
            since = _lap(ns, AV, since, clock)
        _move(w, substep, setting)
        since = _lap(ns, MOVE, since, clock)
        frame = first_frame + substep + 1
        ends = _check_contacts(w, frame, road)
        if not ends and distance_left(v, 0, road) <= 0.0:
            state.outcome = COMPLETED
            state.frame = frame
            ends = True
        since = _lap(ns, CONTACTS, since, clock)
        if ends:
            return since
    if state.decisions >= road.max_decisions:
        state.outcome = TIME_UP
        state.frame = first_frame + SUBSTEPS
    return since


@_compiled
def _timed_second(
    w: World, setting: Setting, s: Scratch, ns: NDArray[np.int64], clock: NDArray[np.int64], since: int
) -> int:
    """One second of `advance` with a clock: nobody is controlled, nothing kept."""
    v, state, road = w.vehicles, w.state[0], setting.road
    command, lane = av_decide(w, road, setting.av)
    since = _lap(ns, AV, since, clock)
    state.controlled = NO_VEHICLE
    decide_bvs(w, NO_ACTION, lane, setting, s)
    since = _lap(ns, DECIDE, since, clock)
    for i in range(1, state.n_vehicles):
        if v[i].present:
            apply_action(w, i, v[i].action, _ACCELERATIONS, road)
    av_acts(w, command, lane, road)
    since = _lap(ns, APPLY, since, clock)
    bound_motion(w, setting.av.idm.max_braking, setting.av.idm.max_acceleration, s)
    find_pairs(w, road, s)
    choose_current(w, s, False, road)
    state.decisions += 1
    since = _lap(ns, FIND_PAIRS, since, clock)
    return _timed_substeps(w, setting, ns, clock, since)


@_compiled
def _timed_draws(
    w: World, setting: Setting, words: NDArray[np.uint64], states: NDArray[np.float64],
    extras: NDArray[np.int64], clock: NDArray[np.int64],
) -> int:  # fmt: skip
    """The random numbers and table look-ups of all BVs alone; their leads are found before the clock starts."""
    v, state, road = w.vehicles, w.state[0], setting.road
    n = state.n_vehicles
    for i in range(1, n):
        lead, _ = neighbours_in_lane(w, i, v[i].target_lane, road.lane_width, DECIDED)
        states[i, 0] = v[lead].x - v[i].x - road.length if lead >= 0 else np.inf
        states[i, 1] = v[lead].speed - v[i].speed if lead >= 0 else 0.0
    since = _now(clock)
    blocks(words, state.seed, state.test, moment_of(w), n, PURPOSE_DECIDE)
    since = _lap(extras, PHILOX, since, clock)
    total = 0
    cut = setting.tables.cut
    for i in range(1, n):
        if v[i].present:
            total += sample_row(cut, free_row(v[i].speed, v[i].desired_speed), words[1, i])
            if states[i, 0] < np.inf:
                total += sample_row(
                    cut,
                    following_row(
                        setting.tables, v[i].speed, v[i].desired_speed, states[i, 0], states[i, 1], uniform(words[1, i])
                    ),
                    words[1, i],
                )
    _lap(extras, LOOK_UPS, since, clock)
    return total


@_compiled
def _timed_choice(
    w: World, setting: Setting, s: ChoiceScratch, extras: NDArray[np.int64], clock: NDArray[np.int64]
) -> int:
    """What an adversary with a policy does in one decision."""
    since = _now(clock)
    bv = nearest_bv(w, setting.road)
    if bv < 0:
        return 0
    observe(w, bv, setting.road, s.found, s.observation)
    since = _lap(extras, OBSERVE, since, clock)
    allowed_actions(w, bv, 1, setting.road, setting.tables, s.starters, s.p, s.allowed)
    since = _lap(extras, BOUNDED, since, clock)
    allowed_actions(w, bv, 0, setting.road, setting.tables, s.starters, s.p, s.allowed)
    since = _lap(extras, ALLOWED, since, clock)
    q_values(setting.who.policy, s.observation, s.layers, s.q)
    action = best_action(s.q, s.allowed)
    _lap(extras, NETWORK, since, clock)
    return action


@_compiled
def timed_tests(
    first: int, count: int, setting: Setting, w: World, s: Scratch, with_extras: bool, states: NDArray[np.float64],
    ns: NDArray[np.int64], extras: NDArray[np.int64], clock: NDArray[np.int64], frames: NDArray[np.int32],
    x: NDArray[np.float64],
) -> int:  # fmt: skip
    """Drive tests first .. first + count - 1; end frames and the AV's end positions show what was driven."""
    kept = 0
    state = w.state[0]
    for k in range(count):
        test = first + k
        since = _now(clock)
        reset_world(w, SEED, test, setting)
        since = _lap(ns, RESET, since, clock)
        while state.outcome == RUNNING:
            if with_extras:
                kept += _timed_draws(w, setting, s.words, states, extras, clock)
                kept += _timed_choice(w, setting, s.choice, extras, clock)
                since = _now(clock)
            since = _timed_second(w, setting, s, ns, clock, since)
        frames[k] = state.frame
        x[k] = w.vehicles[0].x
    return kept
