"""Worlds in which somebody outside the kernels decides: for the controlled BV, or for the AV (`cornerforge.envs`).

Many worlds go one step in one call. Every world has its own seed and test number, so what happens in it does not depend
on the worlds beside it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.actions import ordered_lane
from cornerforge.sim.adversaries import choose_action
from cornerforge.sim.av_view import view_of_av
from cornerforge.sim.drive import world_row
from cornerforge.sim.drive_bv import look_as_bv, reward_of
from cornerforge.sim.reach import Pairs
from cornerforge.sim.step import SUBSTEPS, av_acts, begin_second, move_on, move_vehicle, step_world
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import (
    CONTROLLED,
    FRAME,
    N_CURRENT,
    N_DECISIONS,
    N_VEHICLES,
    OUTCOME,
    RUNNING,
    all_current,
)
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.adversaries import ChoiceScratch
    from cornerforge.sim.drive import Setting
    from cornerforge.sim.drive_bv import History
    from cornerforge.sim.rewards import RewardNumbers
    from cornerforge.sim.world import RoadNumbers, World

__all__ = [
    "MAX_TRIES",
    "NOBODY_LEFT",
    "AvSeconds",
    "allocate_av_seconds",
    "drive_on_as_av",
    "start_as_av",
    "start_as_bv",
    "step_as_bv",
    "substitute_action",
]

NOBODY_LEFT = 5
"""Outcome besides those of `world.py`: no BV is left to control."""
MAX_TRIES = 1000
"""Tests without any BV that `start_as_bv` passes over before it gives up."""
_DT = FRAME_S


@kernel
def substitute_action(wished: int, allowed: NDArray[np.bool_]) -> int:
    """The action taken instead of one that the mask forbids.

    An allowed action stays. Otherwise the allowed acceleration nearest to the wished one (to 0 for a lane change; the
    lower of two equally near), and where no acceleration is allowed the first allowed action.

    Args:
        wished: Action index, 0 to 32.
        allowed: The mask, bool (33,), with at least one True.
    """
    if allowed[wished]:
        return wished
    goal = wished if wished >= 2 else 22
    for away in range(33):
        for action in (goal - away, goal + away):
            if 2 <= action < 33 and allowed[action]:
                return action
    return 0 if allowed[0] else 1


@inlined_kernel
def _bring_up_to_date(w: World, road: RoadNumbers) -> None:
    """Move those to the moment at which a test ended whom `move_on` had left where the second began."""
    substeps = w.info[FRAME] - SUBSTEPS * (w.info[N_DECISIONS] - 1)
    for j in range(1, w.info[N_VEHICLES]):
        if w.vehicles[j].present == 0:
            continue
        is_current = False
        for k in range(w.info[N_CURRENT]):
            is_current = is_current or w.current[k] == j
        if not is_current:
            move_vehicle(w.vehicles, j, substeps * _DT, road)
    all_current(w)


@kernel
def start_as_bv(
    begin: int, end: int, chosen: NDArray[np.bool_], seeds: NDArray[np.int64], tests: NDArray[np.int64],
    setting: Setting, worlds: World, s: ChoiceScratch,
    observation: NDArray[np.float32], allowed: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Put the chosen worlds of [begin, end) at the start of their tests and look through the controlled BV's eyes.

    A test without any BV is passed over: tests[b] then names the next that has one, or is -1 after MAX_TRIES.

    Args:
        begin, end: Range of worlds.
        chosen: Which of them, bool (B,).
        seeds, tests: Name each world's test, int64 (B,).
        setting: The run.
        worlds: A batch of B.
        s: Scratch.
        observation: float32 (B, N_OBSERVATION), written.
        allowed: bool (B, 33), written.
    """
    for b in range(begin, end):
        if not chosen[b]:
            continue
        w = world_row(worlds, b)
        for _ in range(MAX_TRIES):
            reset_world(w, seeds[b], tests[b], setting.road, setting.av, setting.tables.initial)
            if look_as_bv(w, setting, s, observation[b], allowed[b]):
                break
            tests[b] += 1
        if w.info[CONTROLLED] < 0:
            tests[b] = -1


@kernel
def step_as_bv(
    begin: int, end: int, chosen: NDArray[np.bool_], seeds: NDArray[np.int64], tests: NDArray[np.int64],
    actions: NDArray[np.int64], setting: Setting, reward: RewardNumbers, worlds: World, pairs: Pairs, s: ChoiceScratch,
    recording: NDArray[np.void], history: History, observation: NDArray[np.float32], allowed: NDArray[np.bool_],
    outcome: NDArray[np.int64], rewards: NDArray[np.float64],
) -> None:  # fmt: skip
    """One decision (1 s) of the chosen worlds of [begin, end), in which the controlled BV does as it is told.

    Args:
        begin, end, chosen, seeds, tests, setting, worlds, s: As for `start_as_bv`.
        actions: Wished action indices, int64 (B,); afterwards those carried out (`substitute_action`).
        reward: What is paid for.
        pairs: Scratch.
        recording: Of size 0.
        history: Written; its world and recording are scratch.
        observation, allowed: Read, then written for the new moment; where a test ended, for the moment of its end.
        outcome: int64 (B,), written: codes of `world.py`, or NOBODY_LEFT.
        rewards: float64 (B,), written: `drive_bv.reward_of`.
    """
    for b in range(begin, end):
        if not chosen[b]:
            continue
        w = world_row(worlds, b)
        actions[b] = substitute_action(actions[b], allowed[b])
        history.bv[b, w.info[N_DECISIONS]] = w.info[CONTROLLED]
        history.action[b, w.info[N_DECISIONS]] = actions[b]
        step_world(
            w, seeds[b], tests[b], setting.bv_model, actions[b], setting.road, setting.av, setting.tables, pairs,
            recording,
        )  # fmt: skip
        code = w.info[OUTCOME]
        rewards[b] = reward_of(w, b, seeds[b], tests[b], setting, reward, history, pairs)
        if code != RUNNING:
            _bring_up_to_date(w, setting.road)
        if not look_as_bv(w, setting, s, observation[b], allowed[b]) and code == RUNNING:
            code = NOBODY_LEFT
        outcome[b] = code


class AvSeconds(NamedTuple):
    """How far each of B worlds is within its second, when the AV decides outside.

    Attributes:
        substep: Substeps (0.1 s) since the BVs last decided, int64 (B,).
        n_pairs: What `begin_second` gave, int64 (B,).
        a, b: The pairs that can touch in this second, int64 (B, capacity).
    """

    substep: NDArray[np.int64]
    n_pairs: NDArray[np.int64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]


def allocate_av_seconds(n_worlds: int, pairs: Pairs) -> AvSeconds:
    """State for a batch of worlds, with room for as many pairs as `pairs` has."""
    substep, n_pairs = np.zeros(n_worlds, dtype=np.int64), np.zeros(n_worlds, dtype=np.int64)
    a, b = (np.zeros((n_worlds, pairs.a.size), dtype=np.int64) for _ in range(2))
    return AvSeconds(substep, n_pairs, a, b)


@kernel
def start_as_av(
    begin: int, end: int, chosen: NDArray[np.bool_], seeds: NDArray[np.int64], tests: NDArray[np.int64],
    setting: Setting, worlds: World, seconds: AvSeconds, found: NDArray[np.int64], view: NDArray[np.float32],
) -> None:  # fmt: skip
    """Put the chosen worlds of [begin, end) at the start of their tests and look through the AV's eyes.

    Args:
        begin, end, chosen, seeds, tests, setting, worlds: As for `start_as_bv`.
        seconds: Set to the start of a second.
        found: Scratch, int64 (VIEW_ROWS - 1,).
        view: float32 (B, VIEW_ROWS, VIEW_COLUMNS), written.
    """
    for b in range(begin, end):
        if chosen[b]:
            w = world_row(worlds, b)
            reset_world(w, seeds[b], tests[b], setting.road, setting.av, setting.tables.initial)
            seconds.substep[b] = 0
            view_of_av(w, setting.road, found, view[b])


@inlined_kernel
def _hostile_choice(w: World, seed: int, test: int, setting: Setting, s: ChoiceScratch) -> int:
    """The controlled BV's action in this second, -1 where nobody is controlled."""
    w.info[CONTROLLED] = -1
    if setting.adversary == 0 or not look_as_bv(w, setting, s, s.observation, s.allowed):
        return -1
    return choose_action(w, w.info[CONTROLLED], setting.adversary, 0.0, seed, test, setting.policy, s)


@kernel
def drive_on_as_av(
    begin: int, end: int, chosen: NDArray[np.bool_], seeds: NDArray[np.int64], tests: NDArray[np.int64],
    command: NDArray[np.float64], order: NDArray[np.int64], setting: Setting, worlds: World, seconds: AvSeconds,
    pairs: Pairs, s: ChoiceScratch, recording: NDArray[np.void], found: NDArray[np.int64],
    view: NDArray[np.float32], outcome: NDArray[np.int64], metres: NDArray[np.float64],
) -> None:  # fmt: skip
    """One decision of the AV in the chosen worlds of [begin, end): it acts, then `road.av_substeps` times 0.1 s pass.

    Args:
        begin, end, chosen, seeds, tests, setting, worlds, seconds: As for `start_as_av`; `setting.road.av_substeps`
            must be 1, 2, 5 or 10, so that the AV decides whenever the BVs do.
        command: Acceleration that the AV holds [m/s2], float64 (B,).
        order: Lane order, int64 (B,), see `ordered_lane`.
        pairs, s, found: Scratch.
        recording: Of size 0.
        view: float32 (B, VIEW_ROWS, VIEW_COLUMNS), written.
        outcome: int64 (B,), written: codes of `world.py`.
        metres: What the AV drove, float64 (B,), written.
    """
    road = setting.road
    for b in range(begin, end):
        if not chosen[b]:
            continue
        w = world_row(worlds, b)
        held = Pairs(
            seconds.a[b], seconds.b[b], pairs.least, pairs.most, pairs.is_watched, pairs.ahead, pairs.behind, pairs.av
        )
        lane = ordered_lane(w, 0, order[b], road)
        from_x = w.vehicles[0].x
        if seconds.substep[b] == 0:
            action = _hostile_choice(w, seeds[b], tests[b], setting, s)
            seconds.n_pairs[b] = begin_second(
                w, seeds[b], tests[b], setting.bv_model, action, command[b], lane, True, road, setting.av,
                setting.tables, held,
            )  # fmt: skip
        else:
            av_acts(w, command[b], lane, road)
        for _ in range(road.av_substeps):
            ends = move_on(w, seconds.substep[b], held, seconds.n_pairs[b], road, recording)
            seconds.substep[b] = (seconds.substep[b] + 1) % SUBSTEPS
            if ends:
                break
        outcome[b] = w.info[OUTCOME]
        metres[b] = w.vehicles[0].x - from_x
        view_of_av(w, road, found, view[b])
