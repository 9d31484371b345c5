"""Recorded lane changes in the model: scenes built by hand, and a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.ext.calibrate.lane_observations import Transition, transitions_of
from cornerforge.ext.calibrate.transitions import chance_of, compare_transitions
from cornerforge.ndd import default_model_path, load_model, read_decisions, save_model
from cornerforge.ndd.model import GAPS, RANGE_RATES


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Drivers with critical gaps: nobody accepts 10 m, or 30 m when the one behind closes by 5 m/s or more."""
    path = tmp_path_factory.mktemp("model") / "sharp.npz"
    needed = np.where(RANGE_RATES <= -5.0, 30.0, 10.0)
    accept = (GAPS[:, None] > needed[None, :]).astype(np.float32)
    model = load_model(default_model_path())
    save_model(replace(model, lc_accept_lead=accept, lc_accept_rear=accept), path)
    return experiment(model=path)


def transition(*others: tuple[float, float, bool], to_left: bool = True) -> Transition:
    """The one that changes is at 0 m, at 25 m/s; others: (how far ahead of it [m], speed, in the new lane)."""
    along, speed, in_target = zip((0.0, 25.0, False), *others, strict=True)
    return Transition(0, np.array(along), np.array(speed), np.full(len(along), 5.0), np.array(in_target), to_left)


@pytest.mark.parametrize("to_left", [True, False])
def test_possible_and_impossible_lane_changes(run: Experiment, to_left: bool) -> None:
    alone = chance_of(transition(to_left=to_left), run.setting)
    assert 0.0 < alone < 0.1
    assert chance_of(transition((3.0, 25.0, True), to_left=to_left), run.setting) == 0.0  # beside it
    assert chance_of(transition((-8.0, 35.0, True), to_left=to_left), run.setting) == 0.0  # close behind and fast
    far = transition((90.0, 30.0, True), (-90.0, 20.0, True), to_left=to_left)
    assert chance_of(far, run.setting) == pytest.approx(alone)
    behind_slow = chance_of(transition((40.0, 18.0, False), to_left=to_left), run.setting)
    assert behind_slow > alone  # the lead in its own lane is a reason


HEADER = "scenario,veh_id,lane,t_s,s_m,d_m,x_m,y_m,heading_rad,speed_mps,accel_mps2,length_m,width_m"


def row(vehicle: int, lane: int, t: float, s: float, speed: float) -> str:
    return f"A,{vehicle},{lane},{t:.1f},{s:.3f},{-3.4 * lane:.3f},{s:.3f},0.0,0.0,{speed},0.0,5.0,2.0"


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vehicles 1 and 2 change from lane 2 to lane 1 at 4 s, the second one 3 m ahead of vehicle 3, which keeps lane 1.

    Vehicle 4 changes at 1 s, so its state 2 s before is unknown.
    """
    rows = []
    for t in np.arange(0.0, 8.0, 0.1):
        rows += [
            row(1, 2 if t < 4.0 else 1, t, 300.0 + 25.0 * t, 25.0),
            row(2, 2 if t < 4.0 else 1, t, 100.0 + 25.0 * t, 25.0),
            row(3, 1, t, 92.0 + 25.0 * t, 25.0),
            row(4, 3 if t < 1.0 else 2, t, 500.0 + 25.0 * t, 25.0),
        ]
    path = tmp_path_factory.mktemp("lanes") / "lanes.csv"
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    return path


def test_transitions_of_a_file(run: Experiment, lanes: Path) -> None:
    (reading,) = read_decisions([lanes], "ngsim")
    found = transitions_of(reading)
    assert found is not None
    assert len(found) == 2
    assert all(one.to_left for one in found)
    second = found[1]
    assert second.along[0] - second.along[second.in_target] == pytest.approx([8.0])
    assert second.speed == pytest.approx(np.full(second.speed.size, 25.0), abs=0.01)
    assert second.in_target.sum() == 1
    assert second.along.size == 4  # with vehicles 1 and 4, which drive in lane 2; the order is that of the file
    (told,) = compare_transitions(run, ["lanes.csv"], [reading])
    assert (told.found, told.n, told.within) == (0.5, 2, False)
    assert told.interval95 == pytest.approx((0.0126, 0.9874), abs=1e-4)


def test_a_model_that_accepts_all_gaps_passes(lanes: Path, tmp_path: Path) -> None:
    model = load_model(default_model_path())
    easy = replace(
        model,
        lc_accept_lead=np.ones_like(model.lc_accept_lead),
        lc_accept_rear=np.ones_like(model.lc_accept_rear),
    )
    save_model(easy, tmp_path / "easy.npz")
    run = experiment(model=tmp_path / "easy.npz")
    (told,) = compare_transitions(run, ["lanes.csv"], read_decisions([lanes], "ngsim"))
    assert told.found == 0.0
    assert told.within is True


def test_a_file_without_lanes_has_no_row(run: Experiment, tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    lines = ["period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"]
    lines += [f"1,{f},99,{t}.0,25.0,25.0,40.0,test" for f in range(12) for t in range(12)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (reading,) = read_decisions([path], "pairs")
    assert transitions_of(reading) is None
    assert compare_transitions(run, ["pairs.csv"], [reading]) == []
