"""Drive one test again and keep everything: how crashes become cases."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.sim.adversaries import allocate_choice_scratch
from cornerforge.sim.drive import Decisions, Setting, allocate_decisions, drive_test, world_row
from cornerforge.sim.reach import allocate_pairs
from cornerforge.sim.statistics import NOBODY, allocate_counts
from cornerforge.sim.step import SUBSTEPS, allocate_recording
from cornerforge.sim.world import (
    AV_CRASH,
    BV_CRASH,
    FRAME,
    N_VEHICLES,
    OUTCOME,
    SLOT_A,
    SLOT_B,
    World,
    allocate_worlds,
    n_slots,
)
from cornerforge.types import FRAME_S, Crash, Odd, Scenario

__all__ = ["Recorder", "scenario_digest", "scenario_of"]


def scenario_digest(scenario: Scenario) -> str:
    """SHA-256 (hex) over all recorded numbers at full precision: what "identical" means for a replay."""
    digest = hashlib.sha256()
    present = scenario.present
    for name in ("x", "y", "speed", "heading", "acceleration"):
        digest.update(np.where(present, getattr(scenario, name), 0.0).astype("<f8").tobytes())
    digest.update(scenario.target_lane.astype("i1").tobytes())
    digest.update(present.astype("i1").tobytes())
    digest.update(scenario.action.astype("i1").tobytes())
    digest.update(scenario.critical_bv.astype("<i2").tobytes())
    return digest.hexdigest()


class Recorder:
    """Records tests of one run; keeps its buffers between tests, so one recorder serves one thread.

    Args:
        setting: The run.
        odd: The ODD that `setting.road` was made of.
    """

    def __init__(self, setting: Setting, odd: Odd) -> None:
        self._setting = setting
        self._odd = odd
        slots = n_slots(odd)
        decisions = setting.road.max_decisions
        self._worlds = allocate_worlds(1, slots)
        self._pairs = allocate_pairs(slots)
        self._scratch = allocate_choice_scratch(setting.policy)
        self._recording = allocate_recording(SUBSTEPS * decisions + 1, slots)
        self._decisions = allocate_decisions(decisions, slots)
        self._counts = allocate_counts()

    def _drive(self, world: World, seed: int, test: int) -> None:
        """Drive the test in `world`, the one world of `_worlds`, into `_recording` and `_decisions`."""
        drive_test(
            world,
            seed,
            test,
            self._setting,
            self._pairs,
            self._scratch,
            self._recording,
            self._decisions,
            self._counts,
            NOBODY,
        )

    def record(self, seed: int, test: int) -> Scenario:
        """Drive one test and return it whole: all vehicles, every 0.1 s."""
        check_integer("seed", seed, low=0, high=2**63 - 1)
        check_integer("test", test, low=0, high=2**62)
        self._recording["present"] = 0
        world = world_row.py_func(self._worlds, 0)  # type: ignore[attr-defined]
        self._drive(world, seed, test)
        slots = np.arange(int(world.info[N_VEHICLES]), dtype=np.int16)
        return scenario_of(world, self._recording, self._decisions, slots, self._odd, seed, test)


def scenario_of(
    world: World, recording: NDArray[np.void], decisions: Decisions, slot: NDArray[np.int16], odd: Odd, seed: int,
    test: int,
) -> Scenario:  # fmt: skip
    """What was recorded of one drive, copied.

    Args:
        world: After the drive.
        recording, decisions: Of the drive.
        slot: Names of the world's vehicles, (N,).
        odd, seed, test: What the scenario says of itself.
    """
    n = slot.size
    last = int(world.info[FRAME])
    frames = recording[: last + 1, :n]
    present = frames["present"].astype(np.bool_)
    columns = {name: np.where(present, frames[name], np.nan) for name in ("x", "y", "speed", "heading", "acceleration")}
    decided = -(-last // SUBSTEPS)
    crash = None
    if int(world.info[OUTCOME]) in (AV_CRASH, BV_CRASH):
        crash = Crash(round(last * FRAME_S, 1), int(slot[world.info[SLOT_A]]), int(slot[world.info[SLOT_B]]))
    there = present[: decided * SUBSTEPS : SUBSTEPS]
    return Scenario(
        seed=seed,
        test=test,
        odd=odd,
        slot=slot,
        target_lane=np.where(present, frames["target_lane"], -1).astype(np.int8),
        present=present,
        action=np.where(there, decisions.action[:decided, :n], -1).astype(np.int8),
        critical_bv=decisions.controlled[:decided].copy(),
        log_prob_nde=decisions.log_prob[:decided].copy(),
        crash=crash,
        **columns,
    )
