"""The examples of planners: our own, and those that others wrote, in real traffic."""

from __future__ import annotations

import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.experiment.setting import experiment
from cornerforge.sim import controllers

pytestmark = pytest.mark.full

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def examples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for file in EXAMPLES.glob("*_*.py"):
        shutil.copy(file, tmp_path)
    return tmp_path


@pytest.mark.usefixtures("examples")
@pytest.mark.parametrize(
    ("av", "package"),
    [
        ("my_planner:MyPlanner", "numpy"),
        ("fiss_av:FissPlus", "fiss_planner"),
        ("highway_env_av:HighwayIdm", "highway_env"),
    ],
)
def test_a_planner_drives_as_one_would_expect(av: str, package: str) -> None:
    """It gets up to speed in free lanes, keeps to lane centres unless it changes, and its motion is smooth."""
    pytest.importorskip(package)
    run = experiment(av=av, takes_foreign=True)
    assert run.opened_setting.who.av == controllers.STEERED
    recorder, crashed, settled, frames, wide = run.recorder(), 0, 0, 0, run.odd.lane_width
    fastest: list[float] = []
    for test in range(8):
        driven = recorder.record(0, test)
        crashed += driven.crash is not None and driven.crash.slot_a == 0
        y, speed = driven.y[:, 0], driven.speed[:, 0]
        settled += int((np.abs(y % wide - 0.5 * wide) < 0.6).sum())
        frames += y.size
        fastest.append(speed.max())
        assert max(abs(b - a) for a, b in pairwise(y)) < 0.5
        assert np.abs(np.diff(y, 2)).max() < 0.12  # 12 m/s2
        assert y.min() > 1.0
        assert y.max() < 3 * wide - 1.0
    run.rest()
    assert crashed == 0
    assert np.median(fastest) > 28.0
    assert settled > 0.5 * frames


@pytest.mark.slow
@pytest.mark.usefixtures("examples")
def test_what_they_crash_in_is_a_case_that_replays(tmp_path: Path) -> None:
    pytest.importorskip("highway_env")
    library = tmp_path / "lib"
    cornerforge.generate(policy="swerve", av="highway_env_av:HighwayIdm", cases=3, out=library)
    assert cornerforge.replay(library, "all", check=True).identical is True
