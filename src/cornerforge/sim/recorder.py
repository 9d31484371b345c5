"""Drive one test and keep everything: what was driven last can be had as a `Scenario` and as a case."""

from __future__ import annotations

import hashlib
import math

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.fields import BODY, REALS, SERIES
from cornerforge.sim.controllers import cast_index
from cornerforge.sim.drive import drive_test
from cornerforge.sim.harvest import NEAR_M, SLOTS, CaseName, Harvest, Recorded, keep_case
from cornerforge.sim.keep import Keep, keep_whole_test
from cornerforge.sim.outcome import AV_CRASH, BV_CRASH
from cornerforge.sim.scratch import allocate_scratch, warn_of_left_out
from cornerforge.sim.setting import Setting
from cornerforge.sim.step import forget_frames
from cornerforge.sim.traffic import naming_tests
from cornerforge.sim.world import World, allocate_worlds, n_slots, world_of
from cornerforge.types import FRAME_S, SUBSTEPS, Crash, Odd, Scenario

__all__ = ["Recorder", "Recording", "scenario_digest"]


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


class Recording:
    """Buffers in which tests of one run are driven and kept whole; one serves one thread.

    Args:
        setting: The run.
        odd: The ODD that `setting.road` was made of.
    """

    def __init__(self, setting: Setting, odd: Odd) -> None:
        self._setting = setting
        self._odd = odd
        slots = n_slots(odd)
        self._worlds = allocate_worlds(1, slots, setting.road)
        self._world = world_of(self._worlds)
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._keep = keep_whole_test(setting, slots)
        self._frames = 0
        self._name = (0, 0)
        self._slot = np.empty(0, dtype=np.int16)

    def _forget(self) -> None:
        """Remove the last drive; the next one then sees no trace of it, even if this one does not end."""
        forget_frames(self._keep.recording, self._frames, self._world.order.size)
        self._frames = len(self._keep.recording)

    def _driven(self, seed: int, test: int, slot: NDArray[np.int16] | None = None) -> None:
        """Note what was driven: its name, and the names of its vehicles, (N,); None: they are called by number."""
        state = self._world.state[0]
        self._frames, self._name = int(state["frame"]) + 1, (seed, test)
        self._slot = np.arange(int(state["n_vehicles"]), dtype=np.int16) if slot is None else slot

    def scenario(self) -> Scenario:
        """Copy what was driven last: all vehicles, every 0.1 s."""
        n = self._slot.size
        state, decisions = self._world.state[0], self._keep.decisions
        last = int(state["frame"])
        frames = self._keep.recording[: last + 1, :n]
        present = frames["present"].astype(np.bool_)
        columns = {name: np.where(present, frames[name], np.nan) for name in REALS}
        decided = -(-last // SUBSTEPS)
        crash = None
        if int(state["outcome"]) in (AV_CRASH, BV_CRASH):
            pair = self._slot[[state["slot_a"], state["slot_b"]]].tolist()
            crash = Crash(round(last * FRAME_S, 1), *pair)
        there = present[: decided * SUBSTEPS : SUBSTEPS]
        seed, test = self._name
        return Scenario(
            seed=seed,
            test=test,
            odd=self._odd,
            slot=self._slot,
            target_lane=np.where(present, frames["target_lane"], -1).astype(np.int8),
            present=present,
            action=np.where(there, decisions.action[:decided, :n], -1).astype(np.int8),
            critical_bv=decisions.controlled[:decided].copy(),
            log_prob_nde=decisions.log_prob[:decided].copy(),
            crash=crash,
            shortfall=decisions.shortfall[:decided].copy(),
            excess=decisions.excess[:decided].copy(),
            signals_s=None if self._odd.site is None else float(self._world.state["clock"][0]),
            hidden=sum(1 << k for k in np.flatnonzero(decisions.hidden[:decided]).tolist()),
            **{body.name: self._world.vehicles[body.name][:n].astype(body.recorded) for body in BODY},
            **columns,
        )

    def keep(self, harvest: Harvest, *, whole: bool = False) -> None:
        """Append what was driven last to `harvest`, which must not be full.

        Args:
            harvest: The columns.
            whole: Store all its vehicles, not only vehicles within `harvest.NEAR_M` of the AV.

        Raises:
            InputError: It did not end in a crash of the AV.
        """
        state, (seed, test) = self._world.state[0], self._name
        if int(state["outcome"]) != AV_CRASH:
            raise InputError(f"Test {seed}:{test} holds no crash of the AV; only AV crashes are cases.")
        policies = self._setting.who.cast.members.size
        name = CaseName(seed, test, int(cast_index(seed, test, policies)) if policies else 0)
        last, n, partner = int(state["frame"]), self._slot.size, int(state["slot_b"])
        end = Recorded(last + 1, -(-last // SUBSTEPS), n, last, partner)
        row, first = harvest.n_cases, int(harvest.filled[SLOTS])
        keep_case(
            name, end, math.inf if whole else NEAR_M, self._setting.road, self._keep.recording, self._keep.decisions,
            self._world.vehicles, harvest,
        )  # fmt: skip
        # the kernel counts vehicles; here they have names
        kept = slice(first, int(harvest.filled[SLOTS]))
        harvest.slot[kept] = self._slot[harvest.slot[kept]]
        harvest.rows["bv_slot"][row] = self._slot[partner]


class Recorder(Recording):
    """Records tests of one run."""

    def _drive(self, seed: int, test: int) -> None:
        """Drive the test in `_world` and keep it in `_keep`."""
        drive_test(self._world, seed, test, self._setting, self._scratch, self._keep)

    def drive(self, seed: int, test: int) -> tuple[World, Keep]:
        """Drive one test; returns its world and all that was kept of it, both overwritten by the next test."""
        check_integer("seed", seed, low=0, high=2**63 - 1)
        check_integer("test", test, low=0, high=2**62)
        self._forget()
        with naming_tests(self._world):
            self._drive(seed, test)
        warn_of_left_out(self._scratch)
        self._driven(seed, test)
        return self._world, self._keep

    def record(self, seed: int, test: int) -> Scenario:
        """Drive one test and return all of it: all vehicles, every 0.1 s."""
        self.drive(seed, test)
        return self.scenario()
