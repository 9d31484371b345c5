"""Scenarios with a crash, made by integrating random accelerations: real kinematics, no simulator needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from reference.records import CaseRecord, append, case_record

from cornerforge.library import CaseLibrary
from cornerforge.types import ODDS, Crash, Odd, Scenario

IDENTITY: dict[str, str | int | float | bool | None] = {
    "seed": 7,
    "av": "idm-mobil",
    "av_hash": "a1",
    "model_hash": "a1",
    "policy_hash": None,
    "bounded": False,
}
PARTNER = 3


def crash_scenario(test: int, *, n_frames: int = 61, n_vehicles: int = 6, odd: Odd = ODDS["default"]) -> Scenario:
    """The AV runs into a braking BV (slot 3) at the last frame; all else is random, and slot 2 vanishes half-way."""
    rng = np.random.default_rng((7, test))
    n_decisions = max(1, -(-(n_frames - 1) // 10))
    acceleration = np.round(rng.uniform(-1.0, 1.0, (n_decisions, n_vehicles)), 1)
    acceleration[:, 0] = 0.0
    acceleration[:, PARTNER] = 0.0
    acceleration[-3:, PARTNER] = -3.0
    held = np.repeat(acceleration, 10, axis=0)[: n_frames - 1]
    speed = rng.uniform(25.0, 30.0, n_vehicles) + np.vstack([np.zeros(n_vehicles), np.cumsum(held, axis=0) * 0.1])
    x = rng.uniform(300.0, 900.0, n_vehicles) + np.vstack(
        [np.zeros(n_vehicles), np.cumsum(0.05 * (speed[1:] + speed[:-1]), axis=0)]
    )
    x[:, PARTNER] += x[-1, 0] + 4.99 - x[-1, PARTNER]
    y = np.broadcast_to(odd.lane_width * (rng.integers(0, 3, n_vehicles) + 0.5), (n_frames, n_vehicles)).copy()
    y[:, PARTNER] = y[:, 0] + 0.25
    present = np.ones((n_frames, n_vehicles), dtype=bool)
    present[n_frames // 2 :, 2] = False
    action = rng.integers(0, 33, (n_decisions, n_vehicles)).astype(np.int8)
    action[:, 0] = -1
    critical = np.full(n_decisions, PARTNER, dtype=np.int16)
    critical[0] = -1
    log_prob = np.where(critical < 0, 0.0, -rng.exponential(1.0, n_decisions))
    poisoned = [np.where(present, a, np.nan) for a in (x, y, speed, np.zeros_like(x))]
    return Scenario(
        seed=7,
        test=test,
        odd=odd,
        slot=np.arange(n_vehicles, dtype=np.int16),
        x=poisoned[0],
        y=poisoned[1],
        speed=poisoned[2],
        heading=poisoned[3],
        acceleration=np.where(present, np.vstack([held, held[-1:] if len(held) else acceleration[:1]]), np.nan),
        target_lane=np.where(present, np.floor(y / odd.lane_width), -1).astype(np.int8),
        present=present,
        action=action,
        critical_bv=critical,
        log_prob_nde=log_prob,
        crash=Crash(time=0.1 * (n_frames - 1), slot_a=0, slot_b=PARTNER),
    )


def record_of(test: int) -> CaseRecord:
    return case_record(crash_scenario(test), trajectory_digest=f"{test:064x}", extra={"log_prob_policy": -0.5 * test})


def fill(library: CaseLibrary, shards: Sequence[Sequence[int]]) -> None:
    """Append one shard per list of tests; a test that is no crash follows each shard."""
    for tests in shards:
        crashes = library.crashes + len(tests)
        done = max(tests, default=library.next_test) + 2
        append(library, [record_of(test) for test in tests], next_test=done, tests=done, crashes=crashes)


@pytest.fixture
def make_scenario() -> Callable[..., Scenario]:
    return crash_scenario


@pytest.fixture
def make_record() -> Callable[[int], CaseRecord]:
    return record_of


@pytest.fixture
def append_shards() -> Callable[[CaseLibrary, Sequence[Sequence[int]]], None]:
    return fill


@pytest.fixture
def identity() -> dict[str, str | int | float | bool | None]:
    return dict(IDENTITY)


@pytest.fixture
def filled(tmp_path: Path) -> Path:
    """Folder of a library with three shards: tests 1 4 | 10 12 13 | 20."""
    folder = tmp_path / "library"
    fill(CaseLibrary.create(folder, IDENTITY, ODDS["default"]), [[1, 4], [10, 12, 13], [20]])
    return folder
