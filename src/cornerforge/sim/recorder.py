"""Drive one test again and keep everything: how crashes become cases."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.fields import FRAME_FIELDS, REALS, SERIES
from cornerforge.sim.adversaries import allocate_choice_scratch
from cornerforge.sim.drive import Decisions, Setting, allocate_decisions, drive_test, world_row
from cornerforge.sim.harvest import Harvest, Recorded, keep_driven
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

__all__ = ["Recorder", "recording_of", "scenario_digest", "scenario_of"]


def scenario_digest(scenario: Scenario) -> str:
    """SHA-256 (hex) over all recorded numbers at full precision: what "identical" means for a replay."""
    digest = hashlib.sha256()
    present = scenario.present
    for series in SERIES:
        values = getattr(scenario, series.name)
        digest.update(
            (np.where(present, values, 0.0) if series.name in REALS else values).astype(series.recorded).tobytes()
        )
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

    def _driven(self, seed: int, test: int) -> World:
        """The world at the end of a test, which is recorded now."""
        check_integer("seed", seed, low=0, high=2**63 - 1)
        check_integer("test", test, low=0, high=2**62)
        self._recording["present"] = 0
        world: World = world_row.py_func(self._worlds, 0)  # type: ignore[attr-defined]
        self._drive(world, seed, test)
        return world

    def record(self, seed: int, test: int) -> Scenario:
        """Drive one test and return it whole: all vehicles, every 0.1 s."""
        world = self._driven(seed, test)
        slots = np.arange(int(world.info[N_VEHICLES]), dtype=np.int16)
        return scenario_of(world, self._recording, self._decisions, slots, self._odd, seed, test)

    def keep(self, seed: int, test: int, harvest: Harvest) -> None:
        """Drive one test that ends in a crash of the AV, and store it as a case; there must be room for one.

        Raises:
            InputError: It does not end so.
        """
        world = self._driven(seed, test)
        if int(world.info[OUTCOME]) != AV_CRASH:
            raise InputError(f"Test {seed}:{test} holds no crash of the AV; only AV crashes are cases.")
        keep_driven(world, seed, test, self._setting, self._recording, self._decisions, harvest)


def recording_of(scenario: Scenario) -> tuple[Recorded, NDArray[np.void], Decisions]:
    """The way back from `scenario_of`: how far the recording goes, and the two of it, for `harvest.keep_case`.

    What the scenario does not know is NaN (shortfall) or 0 (probability under a policy).

    Raises:
        InputError: It holds no crash of the AV, not its contact, or decisions after its last frame.
    """
    name, crash = f"{scenario.seed}:{scenario.test}", scenario.crash
    if crash is None or crash.slot_a != 0:
        raise InputError(f"Test {name} holds no crash of the AV; only AV crashes are cases.")
    shape = scenario.x.shape
    contact = round(crash.time / FRAME_S)
    found = np.flatnonzero(scenario.slot == crash.slot_b)
    if not 0 <= contact < shape[0] or found.size != 1 or not scenario.present[contact, found[0]]:
        raise InputError(
            f"Test {name}: slot {crash.slot_b} is not in the recording of {shape[0]} frames at {crash.time} s."
        )
    decided = len(scenario.critical_bv)
    if SUBSTEPS * (decided - 1) >= shape[0]:
        raise InputError(f"Test {name} has {decided} decisions in {shape[0]} frames; there is one every {SUBSTEPS}.")
    recording = np.zeros(shape, dtype=FRAME_FIELDS)
    for series in SERIES:
        recording[series.name] = np.where(scenario.present, getattr(scenario, series.name), 0)
    unknown = np.full(decided, np.nan)
    decisions = Decisions(
        np.ascontiguousarray(scenario.action, dtype=np.int8),
        np.ascontiguousarray(scenario.critical_bv, dtype=np.int16),
        np.ascontiguousarray(scenario.log_prob_nde, dtype=np.float64),
        unknown if scenario.shortfall is None else np.ascontiguousarray(scenario.shortfall, dtype=np.float64),
        np.zeros(decided),
    )
    return Recorded(shape[0], decided, shape[1], contact, int(found[0])), recording, decisions


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
    columns = {name: np.where(present, frames[name], np.nan) for name in REALS}
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
        shortfall=decisions.shortfall[:decided].copy(),
        **columns,
    )
