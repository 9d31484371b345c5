"""Drive one test again and keep everything: how crashes become cases."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.sim.drive import drive_test
from cornerforge.sim.keep import Keep, keep_whole_test
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.step import SUBSTEPS
from cornerforge.sim.world import AV_CRASH, BV_CRASH, World, allocate_worlds, n_slots, world_of
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
        self._world = world_of(allocate_worlds(1, slots))
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._keep = keep_whole_test(setting, slots)

    def _drive(self, seed: int, test: int) -> None:
        """Drive the test in `_world` and keep it in `_keep`."""
        drive_test(self._world, seed, test, self._setting, self._scratch, self._keep)

    def record(self, seed: int, test: int) -> Scenario:
        """Drive one test and return it whole: all vehicles, every 0.1 s."""
        check_integer("seed", seed, low=0, high=2**63 - 1)
        check_integer("test", test, low=0, high=2**62)
        self._keep.recording["present"] = 0
        self._drive(seed, test)
        slots = np.arange(int(self._world.state["n_vehicles"][0]), dtype=np.int16)
        return scenario_of(self._world, self._keep, slots, self._odd, seed, test)


def scenario_of(world: World, keep: Keep, slot: NDArray[np.int16], odd: Odd, seed: int, test: int) -> Scenario:
    """What was recorded of one drive, copied.

    Args:
        world: After the drive.
        keep: Frames and decisions of the drive.
        slot: Names of the world's vehicles, (N,).
        odd, seed, test: What the scenario says of itself.
    """
    n = slot.size
    state, decisions = world.state[0], keep.decisions
    last = int(state["frame"])
    frames = keep.recording[: last + 1, :n]
    present = frames["present"].astype(np.bool_)
    columns = {name: np.where(present, frames[name], np.nan) for name in ("x", "y", "speed", "heading", "acceleration")}
    decided = -(-last // SUBSTEPS)
    crash = None
    if int(state["outcome"]) in (AV_CRASH, BV_CRASH):
        crash = Crash(round(last * FRAME_S, 1), int(slot[state["slot_a"]]), int(slot[state["slot_b"]]))
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
