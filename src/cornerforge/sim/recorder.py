"""Drive one test and keep everything, as a `Scenario` or as a case."""

from __future__ import annotations

import hashlib
import math

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.fields import BODY, FRAME_FIELDS, REALS, SERIES
from cornerforge.road.straight import road_numbers
from cornerforge.sim.drive import drive_test
from cornerforge.sim.harvest import NEAR_M, CaseName, Harvest, Recorded, allocate_harvest, keep_case, keep_driven
from cornerforge.sim.keep import Decisions, Keep, keep_whole_test
from cornerforge.sim.outcome import AV_CRASH, BV_CRASH
from cornerforge.sim.scratch import allocate_scratch, warn_of_left_out
from cornerforge.sim.setting import Setting
from cornerforge.sim.traffic import naming_tests
from cornerforge.sim.world import VEHICLE, World, allocate_worlds, n_slots, world_of
from cornerforge.types import FRAME_S, SUBSTEPS, Crash, Odd, Scenario

__all__ = ["Recorder", "case_of", "recording_of", "scenario_digest", "scenario_of"]


def scenario_digest(scenario: Scenario) -> str:
    """Compute SHA-256 (hex) over all recorded numbers at full precision: a replay is identical if it has the same."""
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
        self._world = world_of(allocate_worlds(1, slots))
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._keep = keep_whole_test(setting, slots)

    def _drive(self, seed: int, test: int) -> None:
        """Drive the test in `_world` and keep it in `_keep`."""
        drive_test(self._world, seed, test, self._setting, self._scratch, self._keep)

    def drive(self, seed: int, test: int) -> tuple[World, Keep]:
        """Drive one test; returns its world and all that was kept of it, both overwritten by the next test."""
        check_integer("seed", seed, low=0, high=2**63 - 1)
        check_integer("test", test, low=0, high=2**62)
        self._keep.recording["present"] = 0
        with naming_tests(self._world):
            self._drive(seed, test)
        warn_of_left_out(self._scratch)
        return self._world, self._keep

    def record(self, seed: int, test: int) -> Scenario:
        """Drive one test and return all of it: all vehicles, every 0.1 s."""
        self.drive(seed, test)
        return self._scenario(seed, test)

    def _scenario(self, seed: int, test: int) -> Scenario:
        """Copy what was driven last."""
        slots = np.arange(int(self._world.state["n_vehicles"][0]), dtype=np.int16)
        return scenario_of(self._world, self._keep, slots, self._odd, seed, test)

    def keep(self, seed: int, test: int, harvest: Harvest) -> None:
        """Drive one test that ends in a crash of the AV and append it to `harvest`, which must not be full.

        Raises:
            InputError: The test does not end in a crash of the AV.
        """
        self.drive(seed, test)
        if int(self._world.state["outcome"][0]) != AV_CRASH:
            raise InputError(f"Test {seed}:{test} holds no crash of the AV; only AV crashes are cases.")
        keep_driven(self._world, self._setting, self._keep, harvest)


def recording_of(scenario: Scenario) -> tuple[Recorded, NDArray[np.void], Decisions, NDArray[np.void]]:
    """Turn a scenario back into a recording for `harvest.keep_case`: its extent, frames, decisions and bodies.

    What the scenario does not hold is NaN (shortfall) or 0 (log-probability under a policy).

    Raises:
        InputError: The scenario holds no crash of the AV, not its contact, or decisions after its last frame.
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
    bodies = np.zeros(shape[1], dtype=VEHICLE)
    for body in BODY:
        bodies[body.name] = getattr(scenario, body.name)
    return Recorded(shape[0], decided, shape[1], contact, int(found[0])), recording, decisions, bodies


def case_of(scenario: Scenario, *, whole: bool = False) -> Harvest:
    """Make a case of a recorded AV crash, by the kernel that makes cases in bulk.

    Args:
        scenario: Recording that ends in a crash of the AV.
        whole: Store all its vehicles, not only vehicles within `harvest.NEAR_M` of the AV.

    Returns:
        A harvest of one case, with the scenario's slots.

    Raises:
        InputError: As for `recording_of`.
    """
    end, recording, decisions, bodies = recording_of(scenario)
    harvest = allocate_harvest(1, end.vehicles, max(end.decisions, -(-end.frames // SUBSTEPS)))
    name = CaseName(int(scenario.seed), int(scenario.test), 0)
    near_m = math.inf if whole else NEAR_M
    keep_case(name, end, near_m, road_numbers(scenario.odd), recording, decisions, bodies, harvest)
    # the kernel counts vehicles; their names are the scenario's
    kept = int(harvest.rows["n_kept"][0])
    harvest.slot[:kept] = scenario.slot[harvest.slot[:kept]]
    harvest.rows["bv_slot"] = scenario.slot[end.partner]
    return harvest


def scenario_of(world: World, keep: Keep, slot: NDArray[np.int16], odd: Odd, seed: int, test: int) -> Scenario:
    """Copy what was recorded of one drive into a scenario.

    Args:
        world: The world after the drive.
        keep: Frames and decisions of the drive.
        slot: Slot numbers of the world's vehicles in the scenario, (N,).
        odd, seed, test: Fields of the scenario.
    """
    n = slot.size
    state, decisions = world.state[0], keep.decisions
    last = int(state["frame"])
    frames = keep.recording[: last + 1, :n]
    present = frames["present"].astype(np.bool_)
    columns = {name: np.where(present, frames[name], np.nan) for name in REALS}
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
        shortfall=decisions.shortfall[:decided].copy(),
        **{body.name: world.vehicles[body.name][:n].astype(body.recorded) for body in BODY},
        **columns,
    )
