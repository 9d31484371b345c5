"""A run's folder made of real parts: a kinematic world, the library and the analysis; only the rates are chosen."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from edited_files import write_object
from numpy.typing import NDArray
from plain_results import plain_result
from reference.records import append, case_record

from cornerforge import analyse
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.library import CaseLibrary
from cornerforge.results import NaturalRate, Simulated, as_json
from cornerforge.results.learning import Baseline
from cornerforge.types import ACCELERATIONS, ACTION_LEFT, ACTION_RIGHT, FRAME_S, Crash, Odd, Scenario

ODD = Odd()
FRAMES = 201
IDENTITY: dict[str, str | int | float | bool | None] = {"seed": 0, "av": "idm-mobil"}
Scenes = dict[str, NDArray[np.float64]]


def _smooth(
    time: NDArray[np.float64], start: float, duration: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of a lane change done and its rate [1/s]: the quintic at rest at both ends."""
    s = np.clip((time - start) / duration, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2 / duration


def _drive_all(rng: np.random.Generator, kind: str) -> tuple[Scenes, int, float]:
    """All vehicles for 20 s: the AV in slot 0 keeps its lane, slot 1 attacks, the rest keep theirs.

    Returns the arrays (FRAMES, N), the lane that slot 1 comes from, and when its lane change begins [s].
    """
    time = FRAME_S * np.arange(FRAMES, dtype=np.float64)
    n = 9
    lane = rng.integers(0, 3, n)
    lane[0] = 1
    ahead = np.array([0.0, 0.0, 35, 60, 90, -30, -60, -85, 260.0]) + rng.normal(0, 3, n)
    speed = np.tile(rng.normal(30.0, 1.0, n), (FRAMES, 1))
    begin = rng.uniform(2.0, 5.0)
    if kind == "rear":
        lane[1], ahead[1] = 1, ahead[0] - rng.uniform(15, 25)
        speed[:, 1] = speed[0, 0] + rng.uniform(3, 6)
    else:
        lane[1] = 2 * rng.integers(0, 2)
        ahead[1] = ahead[0] + (rng.uniform(-3, 3) if kind == "side" else rng.uniform(12, 25))
        speed[:, 1] = speed[0, 0]
    if kind == "cut-in":
        speed[:, 1] = np.maximum(speed[0, 0] - 4.0 * np.maximum(time - begin - 1.0, 0.0), 2.0)
    lane[2:][lane[2:] == 1] = 2
    y = np.tile((lane + 0.5) * ODD.lane_width, (FRAMES, 1))
    heading = np.zeros((FRAMES, n))
    if lane[1] != 1:
        share, pace = _smooth(time, begin, rng.uniform(2.5, 4.0))
        sideways = (1 - lane[1]) * ODD.lane_width
        y[:, 1] += sideways * share
        heading[:, 1] = np.arctan(sideways * pace / speed[:, 1])
    x = 400.0 + ahead + np.cumsum(np.vstack([np.zeros((1, n)), speed[:-1] * FRAME_S]), axis=0)
    return {"x": x, "y": y, "speed": speed, "heading": heading}, int(lane[1]), begin


def _first_contact(scenes: Scenes) -> int | None:
    x, y, heading = scenes["x"], scenes["y"], scenes["heading"]
    for k in range(FRAMES):
        a, b = ((x[k, i], y[k, i], heading[k, i]) for i in (0, 1))
        if boxes_overlap(
            Box(*a, ODD.vehicle_length, ODD.vehicle_width), Box(*b, ODD.vehicle_length, ODD.vehicle_width)
        ):
            return k
    return None


def _decisions(speed: NDArray[np.float64], lane: int, begin: float) -> NDArray[np.int8]:
    """The actions, shape (K, N), that each vehicle's speed and slot 1's lane change amount to."""
    gained = np.diff(np.vstack([speed, np.tile(speed[-1], (10, 1))])[::10], axis=0)
    gained = np.vstack([gained, np.zeros((1, speed.shape[1]))])[: (len(speed) - 1) // 10 + 1]
    action = 2 + np.argmin(np.abs(np.clip(np.nan_to_num(gained), -4, 2)[..., None] - ACCELERATIONS), axis=-1)
    action[:, 0] = -1
    if lane != 1:
        action[min(int(begin), len(action) - 1), 1] = ACTION_LEFT if lane == 0 else ACTION_RIGHT
    return np.asarray(action, dtype=np.int8)


def crash_scenario(test: int, kind: str) -> Scenario:
    """A test in which slot 1 and the AV collide; `kind` is "side", "cut-in" or "rear"."""
    rng = np.random.default_rng([7, test])
    contact = None
    while contact is None:
        scenes, lane, begin = _drive_all(rng, kind)
        contact = _first_contact(scenes)
    cut: dict[str, Any] = {name: values[: contact + 1].copy() for name, values in scenes.items()}
    n_frames, n = cut["x"].shape
    present = np.ones((n_frames, n), dtype=np.bool_)
    present[: n_frames // 2, 5] = False  # this one comes into the stored range late
    for values in cut.values():
        values[~present] = math.nan
    n_decisions = (n_frames - 1) // 10 + 1
    target = np.where(present, (cut["y"] // ODD.lane_width), -1).astype(np.int8)
    target[int(begin / FRAME_S) :, 1] = 1
    return Scenario(
        seed=0,
        test=test,
        odd=ODD,
        slot=np.arange(n, dtype=np.int16),
        **cut,
        acceleration=np.where(present, 0.0, math.nan),
        target_lane=target,
        present=present,
        action=_decisions(cut["speed"], lane, begin),
        critical_bv=np.ones(n_decisions, dtype=np.int16),
        log_prob_nde=np.where(np.arange(n_decisions) == int(begin), -math.inf, math.log(0.05)),
        crash=Crash(contact * FRAME_S, 0, 1),
        shortfall=np.where(np.arange(n_decisions) == int(begin), math.inf, 0.5),
    )


def write_run(out: Path, tests: int) -> Path:
    """Fill `out` with the artefacts of a run of `tests` crashing tests."""
    kinds = ("side", "side", "side", "cut-in", "rear")
    scenarios = [crash_scenario(test, kinds[test % len(kinds)]) for test in range(tests)]
    library = CaseLibrary.create(out / "library", IDENTITY, ODD)
    records = [case_record(s, trajectory_digest=f"{s.test:08x}") for s in scenarios]
    append(library, records, next_test=tests, tests=tests, crashes=tests)
    result = as_json(analyse(library.path, out=out / "analysis"))
    write_object(out / "summary.json", _summary(tests, result))
    write_object(out / "training.json", _training())
    write_object(out / "exposure.json", _exposure(scenarios))
    provenance = {"version": "0.1.0", "command": "cornerforge run", "seed": 0, "hashes": {"policy": "ab12"}}
    write_object(out / "provenance.json", provenance)
    return out


def write_natural(out: Path) -> None:
    """Give a run natural crashes that trees of tests found."""
    library = CaseLibrary.create(out / "natural" / "weighted", IDENTITY | {"bv": "nde"}, ODD)
    kinds = {"side": "bv-side", "cut-in": "av-rear-bv-cut-in", "rear": "av-rear"}
    records = []
    for test in range(100, 130):
        kind = ("side", "side", "cut-in", "rear")[test % 4]
        extra: dict[str, str | float] = {"weight": 1e-8, "mechanism": kinds[kind]}
        records.append(case_record(crash_scenario(test, kind), trajectory_digest=f"{test:08x}", extra=extra))
    append(library, records, next_test=130, tests=130, crashes=30)
    file = out / "summary.json"
    summary = json.loads(file.read_text(encoding="utf-8"))
    summary["natural"] = as_json(
        plain_result(
            NaturalRate, method="splitting", tests=150_000, plain_tests=262_144, crashes_per_test=3e-7,
            interval95=(1e-7, 5e-7), crashes_per_mile=1.2e-6, interval95_per_mile=(4e-7, 2e-6), av_crashes=90,
            doubts=("it rests on 30 effective trees, fewer than 300",), effective_sample_size=30, cpu_seconds=160.0,
            acceleration=900.0,
        )
    )  # fmt: skip
    summary["natural_cases"] = as_json(analyse(library.path, out=out / "natural" / "analysis"))
    write_object(file, summary)


def _summary(tests: int, analysis: dict[str, Any]) -> dict[str, Any]:
    plain = plain_result(
        Baseline, name="lane-changing random", tests=8192, crashes_per_test=0.05, interval95=(0.045, 0.055)
    )
    rate = {"tests": 4 * tests, "crashes_per_test": 0.25, "interval95": [0.2, 0.3], "seconds": 1.5}
    return {
        "out": "out",
        "version": "0.1.0",
        "seed": 0,
        "effort": "quick",
        "av": "idm-mobil",
        "bounded": False,
        "nde": as_json(
            plain_result(
                Simulated, tests=2_000_000, av_crashes=9, bv_crashes=3, crashes_per_test=4.5e-6,
                crashes_per_mile=1.8e-5, interval95=(2.1e-6, 8.5e-6), miles=497_000.0, seconds=30.0,
            )
        ),
        "train": {"decisions": 1_000_000, "seconds": 60.0, "crashes_per_test": 0.24, "interval95": [0.2, 0.3]},
        "generate": {"cases": tests, "av_crashes": tests, **rate},
        "baselines": [as_json(plain)],
        "analyse": analysis,
        "seconds": 100.0,
    }  # fmt: skip


def _training() -> dict[str, Any]:
    """A learning curve that saturates, with binomial noise."""
    rng = np.random.default_rng(3)
    points: list[dict[str, float | None]] = [
        {
            "seconds": 0.0,
            "decisions": 0,
            "updates": 0,
            "epsilon": 1.0,
            "loss": None,
            "crashes_per_test": None,
            "tests": 0,
        }
    ]
    for k in range(1, 60):
        share = 0.26 * (1 - math.exp(-k / 12)) + 0.01
        epsilon = max(0.1, 1 - k / 20)
        seen = rng.binomial(800, share * (1 - 0.6 * epsilon)) / 800
        row: dict[str, float | None] = {
            "seconds": float(k),
            "decisions": 20_000 * k,
            "updates": 80 * k,
            "epsilon": epsilon,
        }
        points.append(row | {"loss": 0.02 / math.sqrt(k), "crashes_per_test": seen, "tests": 800})
    return {"preset": "fast", "config": {}, "points": points}


def _exposure(scenarios: list[Scenario]) -> dict[str, Any]:
    """Histograms at 1 Hz from the crashing tests, and from the same tests without their last 4 s."""
    quantities = {}
    for name, sign in (("front", 1.0), ("rear", -1.0)):
        distance: dict[str, list[float]] = {"nde": [], "adversary": []}
        for scenario in scenarios:
            gap = sign * (scenario.x[::10, 1:] - scenario.x[::10, :1]) - ODD.vehicle_length
            nearest = np.where(gap > 0, gap, np.inf).min(axis=1)
            distance["adversary"] += nearest.tolist()
            distance["nde"] += (nearest[:-4] * 1.6).tolist()
        for quantity, unit, scale, top in (("bbd", "m", 1.0, 120.0), ("ttc", "s", 0.25, 20.0)):
            edges = np.linspace(0, top, 41)
            counts = {k: np.histogram(scale * np.array(v), edges)[0].tolist() for k, v in distance.items()}
            label = {"bbd": "bumper-to-bumper distance", "ttc": "time to collision"}[quantity] + f", {name}"
            quantities[f"{quantity}_{name}"] = {"label": label, "unit": unit, "edges": edges.tolist(), **counts}
    return {"miles": {"nde": 50.0, "adversary": 50.0}, "quantities": quantities}


@pytest.fixture(scope="session")
def _finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("report") / "out", tests=60)


@pytest.fixture
def run_folder(_finished_run: Path, tmp_path: Path) -> Path:
    """The artefacts of a run, a copy that the test may change."""
    return Path(shutil.copytree(_finished_run, tmp_path / "out"))


@pytest.fixture
def natural_run_folder(run_folder: Path) -> Path:
    """The same, with natural crashes."""
    write_natural(run_folder)
    return run_folder


@pytest.fixture
def make_scenario() -> Callable[[int, str], Scenario]:
    """`crash_scenario`, for tests of single functions."""
    return crash_scenario
