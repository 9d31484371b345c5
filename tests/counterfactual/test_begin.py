"""Begin of the manoeuvre that led to a crash: hand-built motion, and recorded crashes against positions alone."""

from __future__ import annotations

import numpy as np
import pytest
from hand_built import WIDE, reckless_drivers, setting_of

from cornerforge.counterfactual.begin import MANOEUVRES, manoeuvre_begin
from cornerforge.geometry import path_at, plan_path
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import lane_centre, lane_of, road_numbers
from cornerforge.sim import Recorder, allocate_recording
from cornerforge.sim.runner import crashed_tests, simulate_chunks
from cornerforge.sim.world import n_slots
from cornerforge.types import Scenario

ODD = WIDE
KINDS = list(MANOEUVRES)
BEGINS, TURNS = 20, 42


def across(lane: int, to: int, frames: int, *, turns: int = 1_000, begins: int = BEGINS) -> np.ndarray:
    """Way of a vehicle that changes lanes in 4 s from a frame on, and turns back at another [m], (frames,)."""
    width = ODD.lane_width
    y = np.full(frames, lane_centre(lane, width))
    path, _ = plan_path(y[0], 0.0, 0.0, lane_centre(to, width), 4.0, 4.0)
    for f in range(begins, min(frames, turns + 1)):
        y[f] = path_at(path, min(0.1 * (f - begins), 4.0))[0]
    if turns < frames:
        state = path_at(path, 0.1 * (turns - begins))
        path, _ = plan_path(*state, lane_centre(lane, width), 4.0, 4.0)
        for f in range(turns, frames):
            y[f] = path_at(path, min(0.1 * (f - turns), 4.0))[0]
    return y


def begin_of(own: np.ndarray, other: np.ndarray, ahead: float = 2.0) -> tuple[int, str]:
    """Begin and kind where both drive at one speed, the contact in the last frame."""
    frames = allocate_recording(own.size, 2)
    for slot, y in enumerate((own, other)):
        frames["present"][:, slot], frames["speed"][:, slot], frames["y"][:, slot] = 1, 30.0, y
        frames["x"][:, slot] = 400.0 + ahead * slot + 3.0 * np.arange(own.size)
        frames["target_lane"][:, slot] = lane_of(y[-1], ODD.lane_width)
        frames["target_lane"][:BEGINS, slot] = lane_of(y[0], ODD.lane_width)
    begin, kind = manoeuvre_begin(frames, 1, own.size - 1, road_numbers(ODD))
    return begin, KINDS[kind]


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize(("frames", "turns"), [(BEGINS + 25, 1_000), (TURNS + 6, TURNS), (TURNS + 25, TURNS)])
def test_turning_back_belongs_to_it_for_both(frames: int, turns: int, noise: float) -> None:
    drawn = np.random.default_rng(4)
    keeps = across(1, 1, frames) + drawn.normal(0.0, noise, frames)
    moves = across(2, 1, frames, turns=turns) + drawn.normal(0.0, noise, frames)
    for given, at, kind in (((keeps, moves), BEGINS, "other-moves"), ((moves, keeps), BEGINS - 1, "av-moves")):
        begin, found = begin_of(*given)
        assert found == kind
        assert abs(begin - at) <= (1 if noise == 0.0 else 8)
    assert begin_of(keeps, moves) == begin_of(keeps, moves, ahead=-2.0)


def test_the_earlier_of_both_and_neither_what_only_leads_away_nor_what_is_long_over() -> None:
    frames = BEGINS + 35
    early, late = across(0, 1, frames), across(2, 1, frames, begins=BEGINS + 10)
    assert begin_of(early, late) == (BEGINS - 1, "av-moves")
    assert begin_of(late, early) == (BEGINS, "other-moves")
    away = across(1, 2, frames)
    assert begin_of(across(1, 1, frames), away) == (0, "approach")
    assert begin_of(away, across(1, 1, frames)) == (0, "approach")
    over = across(2, 1, BEGINS + 60)
    assert begin_of(across(1, 1, BEGINS + 60), over) == (0, "approach")
    wander = across(1, 1, frames) + 0.12 * np.sin(np.arange(frames) / 5.0)
    assert begin_of(across(1, 1, frames), wander) == (0, "approach")


def at_rest(scenario: Scenario, column: int, last: int) -> int:
    """Last frame before its last motion at which a vehicle kept its place on a lane's centre; 0: none."""
    y = scenario.y[: last + 1, column]
    width = ODD.lane_width
    centre = np.array([lane_centre(lane_of(value, width), width) for value in y])
    leaves = np.array([np.ptp(y[f:]) > 0.3 for f in range(last + 1)])
    still = np.flatnonzero((np.abs(y - centre) < 1e-4) & (np.abs(np.diff(y, prepend=y[0])) < 0.01) & leaves)
    return int(still[-1]) if still.size else 0


@pytest.mark.parametrize("adversary", [None, "swerve"])
def test_recorded_crashes_begin_where_a_vehicle_last_kept_its_place(model: NddModel, adversary: str | None) -> None:
    """All natural ones, to 0.3 s; of an adversary's nine in ten: slow changes begin as wander does."""
    setting = setting_of(reckless_drivers(model), ODD, adversary=adversary, budget=None if adversary is None else 20.0)
    chunks = simulate_chunks(setting, n_slots(ODD), seed=3, first=0, tests=2_000, threads=2)
    tests = [test for first, out, _ in chunks for test in crashed_tests(first, out)]
    recorder = Recorder(setting, ODD)
    moved, turned, late = 0, 0, 0
    for test in tests[:600]:
        scenario = recorder.record(3, test)
        last, partner = scenario.contact()
        frames = allocate_recording(*scenario.x.shape)
        for name in frames.dtype.names or ():
            frames[name] = getattr(scenario, name)
        begin, kind = manoeuvre_begin(frames, partner, last, road_numbers(ODD))
        if KINDS[kind].endswith("-moves"):
            column = 0 if KINDS[kind] == "av-moves" else partner
            late += abs(begin - at_rest(scenario, column, last)) > 3  # some starts are not from rest
            moved += 1
            turned += bool(np.unique(scenario.target_lane[begin + 1 : last + 1, column]).size > 1)
    assert moved >= 20
    assert late <= (0 if adversary is None else 0.1 * moved)
    assert turned >= 2
