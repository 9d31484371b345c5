"""An ODD on a road: where the AV starts, what it is to do, what files hold of it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.drivers.policy import NetworkShape, n_weights
from cornerforge.errors import FileFormatError, InputError
from cornerforge.experiment.policy_file import Policy, save_policy
from cornerforge.experiment.roads import odd_on, road_in_words, road_named
from cornerforge.experiment.setting import experiment, road_of
from cornerforge.library import CaseLibrary
from cornerforge.road.network import Lane
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.types import Odd
from cornerforge.world_options import WorldOptions


@pytest.mark.parametrize(
    ("name", "task", "start", "length"),
    [
        ("on-ramp", "through", 350.0, 600.0), ("on-ramp", "ramp", 450.0, 500.0), ("exit", "exit", 100.0, 850.0),
        ("weaving", "through", 350.0, 750.0), ("lane-drop", "through", 400.0, 600.0),
        ("curves", "through", 240.0, 400.0), ("short", "through", 0.0, 400.0),
    ],
)  # fmt: skip
def test_the_drive_begins_before_the_lanes_change(name: str, task: str, start: float, length: float) -> None:
    road = road_named("straight" if name == "short" else name)
    if name == "short":  # beyond its end its lanes go on
        road = replace(road, length=300.0, lanes=tuple(Lane(slot, 0.0, 300.0) for slot in range(3)))
    odd = odd_on(Odd(), road, task)
    assert odd.av_start + odd.road_at == pytest.approx(start)
    assert odd.test_length == pytest.approx(length)
    assert Odd.of_stated(odd.stated()) == odd


def test_a_task_needs_its_road() -> None:
    with pytest.raises(InputError, match="on-ramp has none"):
        odd_on(Odd(), road_named("on-ramp"), "exit")
    bare = replace(
        road_named("lane-drop"), lanes=(Lane(0, 450.0, 2000.0), Lane(1, 450.0, 2000.0), Lane(2, 450.0, 2000.0))
    )
    with pytest.raises(InputError, match="no lane at 200 m in which the AV could start"):
        odd_on(Odd(), bare)
    with pytest.raises(InputError, match="give road"):
        road_of(WorldOptions(task="ramp"))
    with pytest.raises(InputError, match="leave out lanes"):
        road_of(WorldOptions(road="on-ramp", lanes=3))
    with pytest.raises(InputError, match=r"4 lanes of 3\.66 m, the ODD 3"):
        replace(Odd(), road=road_named("exit"))


def test_a_road_on_which_the_law_was_not_fitted_says_so() -> None:
    with pytest.warns(UserWarning, match=r"on-ramp; the AV comes from the ramp. Where lanes end .* not fitted"):
        road_of(WorldOptions(road="on-ramp", task="ramp"))
    assert road_in_words(road_of(WorldOptions(road="curves"))) == "Road: curves; the AV drives through."
    assert "road" not in road_of(WorldOptions()).stated()


def test_a_policy_of_another_road_says_so(tmp_path: Path) -> None:
    shape = NetworkShape(N_OBSERVATION, 1, 1, 8)
    weights = np.zeros(n_weights(shape), np.float32)
    for name, about in (("straight", {"odd": Odd().stated()}), ("unknown", {})):
        save_policy(Policy(weights, shape, False, about), tmp_path / f"{name}.safetensors")
    with pytest.warns(UserWarning, match="lanes 3, here 4; road straight, here on-ramp"):
        experiment(WorldOptions(road="on-ramp"), bv=tmp_path / "straight.safetensors")
    with pytest.warns(UserWarning, match=r"perception perfect, here latency=0\.2,occlusion"):
        experiment(WorldOptions(perception="latency=0.2,occlusion"), bv=tmp_path / "straight.safetensors")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        experiment(WorldOptions(road="on-ramp"), bv=tmp_path / "unknown.safetensors")
    assert not any("another world" in str(one.message) for one in said)


def test_an_opendrive_file_must_be_imported_first(tmp_path: Path) -> None:
    (tmp_path / "a.xodr").write_text("<OpenDRIVE/>", encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"a.xodr is no road file yet; make one: cornerforge road import"):
        road_of(WorldOptions(road=str(tmp_path / "a.xodr")))


def test_a_library_keeps_its_road(tmp_path: Path) -> None:
    cornerforge.simulate(tests=40, bv="swerve", road="exit", task="exit", out=tmp_path / "lib")
    library = CaseLibrary.open(tmp_path / "lib")
    assert library.odd == odd_on(Odd(), road_named("exit"), "exit")
    assert cornerforge.replay(tmp_path / "lib", "all", check=True).identical
