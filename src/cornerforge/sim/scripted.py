"""Scripted drives: a world starts from given vehicles, BVs do what they are told, the AV decides by itself.

A test of a seed is named by two numbers because its start and its BVs' decisions are drawn from them. What has been
taken apart (`analysis/shrink.py`) has no such name: it says itself where everybody starts and what every BV does.
Rules, motion and contacts are those of natural tests, in the same kernels, so the script of a recorded crash of the AV
gives that crash again, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._checks import check_integer
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.errors import InputError
from cornerforge.sim.adversaries import allocate_choice_scratch
from cornerforge.sim.av_kinds import built_in_av_decides
from cornerforge.sim.chances import action_probabilities
from cornerforge.sim.drive import allocate_decisions, record_choice, world_row
from cornerforge.sim.neighbours import nearest_bv, sort_by_x
from cornerforge.sim.reach import allocate_pairs
from cornerforge.sim.recorder import scenario_of
from cornerforge.sim.step import SUBSTEPS, allocate_recording, av_acts, begin_to_act, move_on, record_frame
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import (
    AV_CRASH,
    CONTROLLED,
    FRAME,
    INFO_FIELDS,
    N_BV_CRASHES,
    N_DECISIONS,
    N_VEHICLES,
    OUTCOME,
    RUNNING,
    SLOT_B,
    VEHICLE,
    all_current,
    allocate_worlds,
    n_slots,
)
from cornerforge.types import ACCELERATIONS, N_ACTIONS, Odd, Scenario

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.adversaries import ChoiceScratch
    from cornerforge.sim.drive import Decisions, Setting
    from cornerforge.sim.reach import Pairs
    from cornerforge.sim.world import World

__all__ = ["NATURAL", "START_FIELDS", "Ending", "Script", "ScriptDriver", "scripted_start"]

NATURAL = -1
"""Entry of a script: the likeliest action of the naturalistic model in the state at hand (the lowest index of several
equally likely). Recordings have it where a vehicle is absent, and there it says nothing."""

START_FIELDS = (
    "x", "y", "speed", "lateral_speed", "heading", "acceleration", "clock", "duration",
    "c0", "c1", "c2", "c3", "c4", "c5", "target_lane", "lanes",
)  # fmt: skip
"""Fields of `world.VEHICLE` that make a start. The others follow: whoever starts is present, has decided nothing yet,
and holds its acceleration from there on."""

_ACCELERATIONS = ACCELERATIONS


@dataclass(frozen=True)
class Script:
    """A start and what the BVs do from there on; nothing is drawn.

    Attributes:
        slot: Names of the vehicles, int16 (N,), ascending, at least one; the first is 0, the AV.
        start: Everybody's state, (N,) of `world.VEHICLE`; make it with `scripted_start`.
        action: Action index of each vehicle at each decision (1 s apart), int8 (K, N), K at least 1; NATURAL for the
            likeliest. The AV's column is not looked at: it decides by itself.
    """

    slot: NDArray[np.int16]
    start: NDArray[np.void]
    action: NDArray[np.int8]

    def __post_init__(self) -> None:
        n = self.slot.size
        if self.slot.shape != (n,) or n == 0 or self.slot[0] != 0 or (np.diff(self.slot) <= 0).any():
            raise InputError(f"slot = {self.slot.tolist()}: slots must ascend from 0, the AV.")
        if self.start.dtype != VEHICLE or self.start.shape != (n,):
            raise InputError(f"start has shape {self.start.shape} of {self.start.dtype}; allowed: ({n},) of VEHICLE.")
        if self.action.ndim != 2 or self.action.shape[0] == 0 or self.action.shape[1] != n:
            raise InputError(f"action has shape {self.action.shape}; allowed: (decisions, {n}), at least one decision.")
        if self.action.min() < NATURAL or self.action.max() >= N_ACTIONS:
            raise InputError(f"action must lie in [{NATURAL}, {N_ACTIONS - 1}]; it goes from {self.action.min()} to "
                             f"{self.action.max()}.")  # fmt: skip

    def of(self, columns: NDArray[np.bool_]) -> Script:
        """The same with some vehicles only, bool (N,); the AV must be one of them."""
        return Script(self.slot[columns], self.start[columns], self.action[:, columns])


@dataclass(frozen=True)
class Ending:
    """How a scripted drive ended.

    Attributes:
        pose: [x m, y m, speed m/s, heading rad] of the AV and its crash partner in the frame of contact, float64
            (2, 4); None without a crash of the AV.
        partner: Slot of the crash partner, -1 without a crash of the AV.
        frame: Frame (0.1 s) of the contact, counted from the start; 0 without a crash of the AV.
        bv_crashes: Crashes between BVs.
    """

    pose: NDArray[np.float64] | None
    partner: int
    frame: int
    bv_crashes: int


def scripted_start(fields: NDArray[np.float64]) -> NDArray[np.void]:
    """States for `Script.start` from the values of START_FIELDS, float64 (N, len(START_FIELDS)).

    Raises:
        InputError: The shape is wrong, or a value is not finite.
    """
    if fields.ndim != 2 or fields.shape[1] != len(START_FIELDS) or not np.isfinite(fields).all():
        raise InputError(f"A start is finite numbers of shape (vehicles, {len(START_FIELDS)}); this is {fields.shape}.")
    start = np.zeros(len(fields), dtype=VEHICLE)
    for name, values in zip(START_FIELDS, fields.T, strict=True):
        start[name] = values
    start["x_held"], start["speed_held"] = start["x"], start["speed"]
    start["present"], start["action"] = 1, -1
    return start


@inlined_kernel
def _put(w: World, start: NDArray[np.void]) -> None:
    """Put a world at a start."""
    for k in range(INFO_FIELDS):
        w.info[k] = 0
    for i in range(start.size):
        w.vehicles[i] = start[i]
        w.order[i] = i
    w.info[N_VEHICLES] = start.size
    w.info[CONTROLLED] = -1
    all_current(w)


@inlined_kernel
def _likeliest(w: World, i: int, av_lane: int, setting: Setting, s: ChoiceScratch) -> int:
    """Index of the likeliest action of slot i; fills `s.p` with all probabilities."""
    action_probabilities(w, i, False, av_lane, setting.road, setting.tables, s.starters, s.p)
    best = 0
    for a in range(1, N_ACTIONS):
        if s.p[a] > s.p[best]:
            best = a
    return best


@inlined_kernel
def _bvs_decide(
    w: World, step: int, script: NDArray[np.int8], av_lane: int, setting: Setting, s: ChoiceScratch,
    chances: NDArray[np.float64],
) -> None:  # fmt: skip
    """All BVs choose, into their `action`, by the script; at the same time, from the state before anybody acts.

    `av_lane` is the target lane that the AV has just chosen.
    """
    v = w.vehicles
    recorded = step < chances.shape[0]
    for i in range(1, w.info[N_VEHICLES]):
        if v[i].present == 0:
            continue
        action: int = script[step, i]
        if recorded or action < 0:
            likeliest = _likeliest(w, i, av_lane, setting, s)
            if action < 0:
                action = likeliest
        if recorded:
            for a in range(N_ACTIONS):
                chances[step, i, a] = s.p[a]
        v[i].action = action


@inlined_kernel
def _av_decides(
    w: World, substep: int, av_is_natural: bool, setting: Setting, pairs: Pairs, s: ChoiceScratch
) -> tuple[float, int]:
    """What the AV does: acceleration [m/s2] and target lane. A natural one decides once a second and then goes on."""
    v = w.vehicles
    if not av_is_natural:
        return built_in_av_decides(w, substep, setting.road, setting.av, pairs.av)
    if substep > 0:
        return v[0].acceleration, v[0].target_lane
    action = _likeliest(w, 0, v[0].target_lane, setting, s)
    if action >= 2:
        return _ACCELERATIONS[action - 2], v[0].target_lane
    return 0.0, v[0].target_lane + 1 - 2 * action


@kernel
def _drive_script(
    w: World, start: NDArray[np.void], script: NDArray[np.int8], av_is_natural: bool, setting: Setting, pairs: Pairs,
    s: ChoiceScratch, recording: NDArray[np.void], decisions: Decisions, chances: NDArray[np.float64],
) -> None:  # fmt: skip
    """Drive from a start until the script or the test is at an end; the outcome is in `w.info`, RUNNING for the script.

    Args:
        w: The world, of at least as many slots as the start has vehicles.
        start, script: See `Script`.
        av_is_natural: The AV too takes the likeliest action, once a second.
        setting: The run; who drives the BVs in it does not matter.
        pairs, s: Scratch.
        recording, decisions: Of size 0, or large enough.
        chances: P(action) of each BV at each decision, float64 (K, N, 33), written; of size 0, or of K decisions.
    """
    road, tables = setting.road, setting.tables
    _put(w, start)
    for step in range(script.shape[0]):
        if w.info[OUTCOME] != RUNNING:
            break
        sort_by_x(w)
        command, lane = _av_decides(w, 0, av_is_natural, setting, pairs, s)
        _bvs_decide(w, step, script, lane, setting, s, chances)
        if step < decisions.controlled.size:
            bv = nearest_bv(w)
            if bv >= 0:
                action_probabilities(w, bv, False, lane, road, tables, s.starters, s.p)
                action_probabilities(w, bv, True, w.vehicles[0].target_lane, road, tables, s.starters, s.attentive)
            record_choice(w, step, bv, 0.0, s, decisions)
        n_pairs = begin_to_act(w, command, lane, True, road, setting.av, pairs)
        for substep in range(SUBSTEPS):
            if substep > 0 and substep % road.av_substeps == 0:
                command, lane = _av_decides(w, substep, av_is_natural, setting, pairs, s)
                av_acts(w, command, lane, road)
            if move_on(w, substep, pairs, n_pairs, road, recording):
                break
    if w.info[OUTCOME] == RUNNING:
        w.info[FRAME] = SUBSTEPS * w.info[N_DECISIONS]
        record_frame(w, w.info[FRAME], recording)


class ScriptDriver:
    """Drives scripts in the world of one run; keeps its buffers, so one driver serves one thread.

    Args:
        setting: The run, with a built-in AV; its adversary, if any, has no say.
        odd: The ODD that `setting.road` was made of.
    """

    def __init__(self, setting: Setting, odd: Odd) -> None:
        self._setting = setting
        self._odd = odd
        slots, most = n_slots(odd), setting.road.max_decisions
        worlds = allocate_worlds(1, slots)
        self._world: World = world_row.py_func(worlds, 0)  # type: ignore[attr-defined]
        self._pairs = allocate_pairs(slots)
        self._scratch = allocate_choice_scratch(setting.policy)
        self._recording = allocate_recording(SUBSTEPS * most + 1, slots)
        self._decisions = allocate_decisions(most, slots)
        self._nothing = (allocate_recording(0, slots), allocate_decisions(0, slots), np.zeros((0, slots, N_ACTIONS)))
        self.max_decisions = most
        """Of a script."""
        self.drives = 0
        """Scripts driven so far."""

    def _check(self, script: Script) -> None:
        check_integer("vehicles of a script", script.slot.size, low=1, high=self._world.order.size)
        check_integer("decisions of a script", len(script.action), low=1, high=self._setting.road.max_decisions)

    def _drive(
        self, script: Script, av_is_natural: bool, record: tuple[NDArray[np.void], Decisions, NDArray[np.float64]]
    ) -> None:
        self._check(script)
        self.drives += 1
        _drive_script(
            self._world, script.start, np.ascontiguousarray(script.action), av_is_natural, self._setting, self._pairs,
            self._scratch, *record,
        )  # fmt: skip

    def drive(self, script: Script, *, av_is_natural: bool = False) -> Ending:
        """Drive a script and say how it ended.

        Args:
            script: What the BVs do.
            av_is_natural: The AV too takes the likeliest action of the naturalistic model, once a second.

        Raises:
            InputError: The script has more vehicles or decisions than a test can have.
        """
        self._drive(script, av_is_natural, self._nothing)
        info, v = self._world.info, self._world.vehicles
        if info[OUTCOME] != AV_CRASH:
            return Ending(None, -1, 0, int(info[N_BV_CRASHES]))
        pair = v[[0, info[SLOT_B]]]
        pose = np.stack([pair[name] for name in ("x", "y", "speed", "heading")], axis=1)
        return Ending(pose, int(script.slot[info[SLOT_B]]), int(info[FRAME]), int(info[N_BV_CRASHES]))

    def record(
        self, script: Script, *, seed: int, test: int, av_is_natural: bool = False
    ) -> tuple[Scenario, NDArray[np.float64]]:
        """Drive a script and keep everything.

        Args:
            script: What the BVs do.
            seed, test: What the scenario is named after; nothing is drawn.
            av_is_natural: As for `drive`.

        Returns:
            The recording, and P(action) of each BV at each decision under the naturalistic model, float64 (K, N, 33);
            NaN where it is absent, for the AV, and after the end.

        Raises:
            InputError: As for `drive`.
        """
        chances = np.full((len(script.action), script.slot.size, N_ACTIONS), np.nan)
        self._recording["present"] = 0
        self._drive(script, av_is_natural, (self._recording, self._decisions, chances))
        scenario = scenario_of(self._world, self._recording, self._decisions, script.slot, self._odd, seed, test)
        return scenario, chances

    def start_of_test(self, seed: int, test: int) -> NDArray[np.void]:
        """Everybody's state at the start of a test of a seed, (N,) of `world.VEHICLE`; nobody changes lanes there."""
        setting = self._setting
        reset_world(self._world, seed, test, setting.road, setting.av, setting.tables.initial)
        return self._world.vehicles[: self._world.info[N_VEHICLES]].copy()

    def later(self, script: Script, decisions: int) -> Script | None:
        """The script that starts where this one is after some decisions, 0 or more; None where it is over by then.

        Who has been taken off the road is left out. An AV whose decisions look at nothing but the present (all that are
        built in) goes on from there as it did.
        """
        if decisions == 0:
            return script
        check_integer("decisions", decisions, low=0, high=len(script.action) - 1)
        self._drive(Script(script.slot, script.start, script.action[:decisions]), False, self._nothing)
        if self._world.info[OUTCOME] != RUNNING:
            return None
        states = self._world.vehicles[: script.slot.size]
        there = states["present"] == 1
        start = scripted_start(np.stack([states[name] for name in START_FIELDS], axis=1)[there].astype(np.float64))
        return Script(script.slot[there], start, script.action[decisions:, there])
