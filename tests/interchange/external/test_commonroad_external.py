"""CommonRoad's own packages read our files, and see what we saw: the same pair touch at the same step, nothing before.

They need an environment of their own (`make test-interchange` makes it and names its Python in COMMONROAD_PYTHON).
"""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cornerforge
from cornerforge.drivers.rails import ACCELERATION, HEADING, SPEED, X, Y
from cornerforge.ext.interchange.commonroad import write_commonroad
from cornerforge.ext.interchange.read_commonroad import read_commonroad
from cornerforge.library import CaseLibrary
from cornerforge.library.out_case import OutCase
from cornerforge.types import MOTORCYCLE, TRUCK, Crash, Scenario

pytestmark = pytest.mark.interchange

REFEREE = Path(__file__).with_name("commonroad_referee.py")
CASES = 240
REWRITTEN = 40
SIX_DECIMALS = 6e-7


@pytest.fixture(scope="module")
def referee_python() -> str:
    """Python of an environment with commonroad-io and commonroad-drivability-checker."""
    given = os.environ.get("COMMONROAD_PYTHON", "")
    if not given:
        pytest.skip("COMMONROAD_PYTHON names no environment; run `make test-interchange`")
    return given


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> list[OutCase]:
    """Random crashes among cars, trucks and motorcycles, every other one mirrored, some cut to their last second."""
    path = tmp_path_factory.mktemp("cases") / "library"
    cornerforge.generate(policy="swerve", odd="mixed", cases=CASES, out=path, seed=20)
    library = CaseLibrary.open(path)
    made = []
    for number, name in enumerate(library.scalars(["case_id"])["case_id"].to_pylist()):
        scenario = library.scenario(name).scenario
        if number % 2:
            scenario = mirrored(scenario)
        if number % 8 == 0:
            scenario = last_second(scenario)
        made.append(OutCase(f"case-{number}", scenario, {"case_id": name, "licence": 'see "there" <&>'}))
    return made


def mirrored(scenario: Scenario) -> Scenario:
    """The same, left and right changed over."""
    road = scenario.odd
    there = scenario.present
    return replace(
        scenario,
        y=road.n_lanes * road.lane_width - scenario.y,
        heading=-scenario.heading,
        target_lane=np.where(there, road.n_lanes - 1 - scenario.target_lane, -1).astype(np.int8),
    )


def last_second(scenario: Scenario) -> Scenario:
    """The last ten frames only: the contact comes in the first second."""
    assert scenario.crash is not None
    cut = len(scenario.x) - 10
    if cut <= 0 or not scenario.present[cut:].all():
        return scenario
    parts = {
        name: getattr(scenario, name)[cut:]
        for name in ("x", "y", "speed", "heading", "acceleration", "target_lane", "present")
    }
    crash = Crash(round(scenario.crash.time - 0.1 * cut, 1), 0, scenario.crash.slot_b)
    return replace(scenario, crash=crash, **parts)


@pytest.fixture(scope="module")
def seen(
    cases: list[OutCase], referee_python: str, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, Any], Path]:
    """What the referee says of each file, and the folder in which commonroad-io wrote them again."""
    ours, theirs = tmp_path_factory.mktemp("ours"), tmp_path_factory.mktemp("theirs")
    for case in cases:
        write_commonroad(case, ours)
    run = subprocess.run(
        [referee_python, str(REFEREE), str(ours), "--rewrite", str(theirs), str(REWRITTEN)],
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-4000:]
    return json.loads(run.stdout), theirs


def test_the_schema_finds_no_fault(seen: tuple[dict[str, Any], Path]) -> None:
    verdicts, _ = seen
    assert len(verdicts) == CASES
    assert {name: verdict["faults"] for name, verdict in verdicts.items() if verdict["faults"]} == {}


def test_the_same_pair_touches_at_the_same_step_and_nothing_before(
    cases: list[OutCase], seen: tuple[dict[str, Any], Path]
) -> None:
    verdicts, _ = seen
    assert sum(len(case.scenario.x) <= 10 for case in cases) >= 10
    for case in cases:
        verdict = verdicts[f"{case.name}.xml"]
        crash = case.scenario.crash
        assert crash is not None
        assert verdict["contacts"] == [[round(10 * crash.time), 100 + crash.slot_b]], case.facts["case_id"]
        assert verdict["av_collides"]


def test_everybody_is_there_with_its_class(cases: list[OutCase], seen: tuple[dict[str, Any], Path]) -> None:
    verdicts, _ = seen
    kinds = set()
    for case in cases:
        names = {str(100 + slot): kind for slot, kind in zip(case.scenario.slot, case.scenario.kind, strict=True)}
        kinds |= set(names.values())
        classes = ("car", "truck", "motorcycle")
        assert verdicts[f"{case.name}.xml"]["obstacles"] == {name: classes[kind] for name, kind in names.items()}
        assert verdicts[f"{case.name}.xml"]["lanelets"] == case.scenario.odd.n_lanes
    assert {TRUCK, MOTORCYCLE} <= kinds


def test_what_commonroad_io_writes_is_read(cases: list[OutCase], seen: tuple[dict[str, Any], Path]) -> None:
    _, theirs = seen
    rewritten = [case for case in cases if (theirs / f"{case.name}.xml").exists()]
    assert len(rewritten) == REWRITTEN
    for case in rewritten:
        back, scenario = read_commonroad(theirs / f"{case.name}.xml"), case.scenario
        assert back.poses.shape[:2] == scenario.x.shape
        for number, series in ((X, scenario.x), (Y, scenario.y), (HEADING, scenario.heading)):
            assert np.nanmax(np.abs(back.poses[:, :, number] - series)) <= SIX_DECIMALS
        for number, series in ((SPEED, scenario.speed), (ACCELERATION, scenario.acceleration)):
            assert np.nanmax(np.abs(back.poses[:, :, number] - series)) <= 1e-5
        np.testing.assert_allclose(back.length, scenario.length, atol=SIX_DECIMALS)
        assert back.facts["case_id"] == case.facts["case_id"]
