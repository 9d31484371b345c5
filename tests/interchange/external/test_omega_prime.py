"""omega-prime's own validation takes our OSI traces, sees in them what we wrote, and we read what it writes.

It needs an environment of its own, of which OMEGA_PYTHON names the Python (requirements-omega.txt).
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
from openscenario_read_back import real_crashes
from reference.osi import Thing, scene

from cornerforge.drivers.rails import X, Y
from cornerforge.ext.interchange.read_osi import read_osi
from cornerforge.ext.interchange.write_osi import write_osi
from cornerforge.library.out_case import OutCase
from cornerforge.types import Scenario

pytestmark = pytest.mark.interchange

REFEREE = Path(__file__).with_name("omega_referee.py")
SOME = 6
"""Real crashes that are looked at, in both formats."""


@pytest.fixture(scope="module")
def omega_python() -> str:
    """Python of an environment with omega-prime."""
    given = os.environ.get("OMEGA_PYTHON", "")
    if not given:
        pytest.skip("OMEGA_PYTHON names no environment with omega-prime (1.1 GB, so `make` sets up none)")
    return given


def looked_at(python: str, folder: Path, again: Path) -> dict[str, Any]:
    again.mkdir()
    done = subprocess.run(
        [python, str(REFEREE), str(folder), str(again)], capture_output=True, text=True, check=False, timeout=600
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def cases() -> list[Scenario]:
    """Crashes, each with the vehicles that are there throughout: the validation wants no gaps."""
    return [scenario for scenario in real_crashes("mixed") if scenario.present.all()][:SOME]


def test_our_traces_are_valid_and_say_what_we_wrote(omega_python: str, tmp_path: Path) -> None:
    scenarios = cases()
    assert scenarios
    for number, scenario in enumerate(scenarios):
        for ending in ("osi", "mcap"):
            write_osi(OutCase("case", scenario, {"made_by": "us"}), tmp_path / "out" / f"case-{number}.{ending}")
    found = looked_at(omega_python, tmp_path / "out", tmp_path / "again")
    assert {name: about["fault"] for name, about in found.items() if about["fault"]} == {}
    assert len(found) == 2 * len(scenarios)
    for number, scenario in enumerate(scenarios):
        for ending in ("osi", "mcap"):
            about = found[f"case-{number}.{ending}"]
            rows = np.array(about["rows"]).reshape(*scenario.x.shape, -1)
            assert about["host"] == 0
            np.testing.assert_array_equal(rows[:, 0, 0], 1e8 * np.arange(len(scenario.x)))
            order = np.argsort(scenario.slot)
            for column, wanted in ((2, scenario.x), (3, scenario.y), (4, scenario.heading), (5, scenario.speed)):
                np.testing.assert_array_equal(rows[..., column], wanted[:, order])
            np.testing.assert_array_equal(rows[0, :, 6:], np.stack([scenario.length, scenario.width], axis=1)[order])
            road = next((tmp_path / "out").glob(f"road-{scenario.odd.n_lanes}x*.xodr"))
            back = read_osi(tmp_path / "again" / f"case-{number}-{ending}.mcap", road=road)
            np.testing.assert_allclose(back.poses[..., X] + scenario.x[0, 0], scenario.x, rtol=0, atol=1e-9)
            np.testing.assert_allclose(back.poses[..., Y], scenario.y, rtol=0, atol=1e-9)


def test_its_validation_sees_what_is_wrong(omega_python: str, tmp_path: Path) -> None:
    """A control: a heading beyond half a turn."""
    (tmp_path / "out").mkdir()
    av = Thing(0, 0.0, -6.0)
    scene(tmp_path / "out" / "case-good.osi", av)
    scene(tmp_path / "out" / "case-bad.osi", replace(av, yaw=7.0))
    found = looked_at(omega_python, tmp_path / "out", tmp_path / "again")
    assert "yaw" in found["case-bad.osi"]["fault"]
