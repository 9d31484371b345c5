"""Avoidable by braking: hand-built crashes with a known answer, a closed form, and real crashes judged in two ways."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hand_built import WIDE, setting_of
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.adversary.worlds.judge import judge_crashes
from cornerforge.counterfactual.begin import manoeuvre_begin
from cornerforge.counterfactual.braking import Braking, avoidable_by_braking
from cornerforge.errors import InputError
from cornerforge.geometry import Box, boxes_overlap, path_at, plan_path
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import road_numbers
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import crashed_tests, simulate_chunks
from cornerforge.sim.step import allocate_recording
from cornerforge.sim.world import n_slots
from cornerforge.types import Crash, Scenario

ODD = WIDE
FRAMES = 80


@dataclass(frozen=True)
class Mover:
    """A vehicle at a constant acceleration [m/s2] from frame `brakes`, which changes lanes at frame `change`."""

    x: float
    lane: int
    speed: float
    acceleration: float = 0.0
    brakes: int = 0
    change: int | None = None
    side: int = 1


def drive(*movers: Mover) -> Scenario:
    """Their test up to the first contact of the first of them, the AV; nobody reacts to anything."""
    shape = FRAMES, len(movers)
    x, y, speed, heading, acceleration = (np.zeros(shape) for _ in range(5))
    lane = np.zeros(shape, dtype=np.int8)
    for j, m in enumerate(movers):
        begin = FRAMES + 1 if m.change is None else m.change
        path, duration = plan_path(4.0 * m.lane + 2.0, 0.0, 0.0, 4.0 * (m.lane + m.side) + 2.0, 4.0, 4.0)
        for f in range(FRAMES):
            held = min(max(f - m.brakes, 0) * 0.1, m.speed / -m.acceleration if m.acceleration < 0.0 else np.inf)
            speed[f, j] = m.speed + m.acceleration * held
            free = (f - max(f - m.brakes, 0)) * 0.1 + (max(f - m.brakes, 0) * 0.1 if m.acceleration == 0.0 else held)
            x[f, j] = m.x + m.speed * free + 0.5 * m.acceleration * held**2
            acceleration[f, j] = m.acceleration if f >= m.brakes else 0.0
            lane[f, j] = m.lane + (m.side if f >= begin else 0)
            y[f, j] = 4.0 * m.lane + 2.0
            if f > begin:
                where = min((f - begin) * 0.1, duration)
                y[f, j], lateral, _ = path_at(path, where)
                heading[f, j] = np.arctan(lateral / max(speed[f, j], 5.0)) if where < duration else 0.0
    for f in range(FRAMES):
        for j in range(1, len(movers)):
            if boxes_overlap(*(Box(x[f, i], y[f, i], heading[f, i], 5.0, 2.0) for i in (0, j))):
                n = f + 1
                columns: dict[str, Any] = {
                    "x": x,
                    "y": y,
                    "speed": speed,
                    "heading": heading,
                    "acceleration": acceleration,
                }
                decided = -(-f // 10)
                return Scenario(
                    seed=0, test=0, odd=ODD, slot=np.arange(len(movers), dtype=np.int16), target_lane=lane[:n],
                    present=np.ones((n, len(movers)), dtype=np.bool_),
                    action=np.zeros((decided, len(movers)), dtype=np.int8),
                    critical_bv=np.ones(decided, dtype=np.int16), log_prob_nde=np.zeros(decided),
                    crash=Crash(round(0.1 * f, 1), 0, j), **{name: values[:n] for name, values in columns.items()},
                )  # fmt: skip
    raise AssertionError("they do not meet")


AV = Mover(400.0, 1, 30.0)
CASES = {
    "swerves in alongside": (drive(AV, Mover(399.0, 0, 30.0, change=10)), False),
    "swerves in alongside, from the left": (drive(AV, Mover(400.0, 2, 30.0, change=10, side=-1)), False),
    "cuts in with room to brake": (drive(AV, Mover(436.0, 0, 20.0, change=5)), True),
    "cuts in with no room to brake": (drive(AV, Mover(424.0, 0, 18.0, change=0)), False),
    "brakes hard ahead": (drive(AV, Mover(415.0, 1, 30.0, -4.0, brakes=10)), True),
    "stands ahead for long": (drive(AV, Mover(560.0, 1, 0.0)), True),
    "runs into the AV's rear": (drive(AV, Mover(380.0, 1, 38.0)), False),
    "AV changes into its side": (drive(replace(AV, change=5), Mover(400.0, 2, 30.0)), True),
    "AV changes lanes far behind it": (drive(replace(AV, change=0), Mover(440.0, 2, 20.0)), True),
}


@pytest.mark.parametrize("name", CASES)
def test_hand_built_crashes(name: str) -> None:
    scenario, expected = CASES[name]
    assert avoidable_by_braking(scenario) is expected


@pytest.mark.parametrize("name", CASES)
def test_left_and_right_are_alike(name: str) -> None:
    scenario, expected = CASES[name]
    mirrored = replace(
        scenario, y=12.0 - scenario.y, heading=-scenario.heading, target_lane=(2 - scenario.target_lane).astype(np.int8)
    )
    assert avoidable_by_braking(mirrored) is expected


def test_a_follower_who_would_be_hit_makes_it_unavoidable() -> None:
    bv = Mover(415.0, 1, 30.0, -4.0, brakes=10)
    assert avoidable_by_braking(drive(AV, bv)) is True
    assert avoidable_by_braking(drive(AV, bv, Mover(394.0, 1, 30.0))) is False
    assert avoidable_by_braking(drive(AV, bv, Mover(360.0, 1, 30.0))) is True


@given(st.floats(3.0, 40.0), st.integers(1, 25), st.sampled_from([math.inf, 12.65]))
def test_behind_a_braking_lead_the_closed_form_decides(gap: float, tenths: int, max_jerk: float) -> None:
    """Both at 30 m/s, the lead brakes at 4 m/s2 at once from 1 s on, the AV at 8 from d later, after a ramp of q.

    It just does not touch at the gap 4 d^2 + 4 d q + 2 q^2 / 3.
    """
    delay, q = 0.1 * tenths, 8.0 / max_jerk
    needed = 4.0 * delay**2 + 4.0 * delay * q + q**2 / 1.5
    if abs(gap - needed) < 0.3:  # contacts are looked for every 0.1 s
        return
    scenario = drive(AV, Mover(405.0 + gap, 1, 30.0, -4.0, brakes=10))
    scenario = replace(scenario, odd=replace(ODD, max_jerk=max_jerk))
    assert avoidable_by_braking(scenario, delay_s=delay) is bool(gap > needed)


def begin_of(scenario: Scenario, speed: np.ndarray | None = None) -> float:
    """When the manoeuvre began [s]; `speed` of the partner, frame by frame, instead of the recorded one."""
    assert scenario.crash is not None
    frames = allocate_recording(*scenario.x.shape)
    for field in frames.dtype.names or ():
        frames[field] = getattr(scenario, field)
    if speed is not None:
        frames["speed"][:, 1] = speed
    return 0.1 * manoeuvre_begin(frames, 1, round(scenario.crash.time / 0.1), road_numbers(ODD))[0]


def test_a_follower_comes_since_it_is_faster_and_its_own_braking_is_no_manoeuvre() -> None:
    ahead = drive(AV, Mover(415.0, 1, 30.0, -4.0, brakes=10))
    assert begin_of(ahead) == pytest.approx(1.0)
    late = drive(AV, Mover(380.0, 1, 38.0, -2.0, brakes=15))
    assert begin_of(late) == 0.0  # closing all the time
    faster = drive(AV, Mover(394.0, 1, 30.0, 2.0, brakes=20))
    assert begin_of(faster) == pytest.approx(2.1)
    assert begin_of(drive(replace(AV, acceleration=-4.0, brakes=12), Mover(388.0, 1, 30.0))) == pytest.approx(1.1)


@pytest.mark.parametrize(("pause", "begin"), [(9, 0.0), (10, 2.0)])
def test_a_pause_of_a_second_begins_it_anew(pause: int, begin: float) -> None:
    rammed = drive(AV, Mover(370.0, 1, 38.0))
    speed = np.array(rammed.speed[:, 1])
    speed[20 - pause : 20] = 29.0
    assert len(speed) > 25
    assert begin_of(rammed, speed) == pytest.approx(begin)


def test_time_to_react_and_harder_braking_count() -> None:
    scenario, _ = CASES["brakes hard ahead"]
    assert avoidable_by_braking(scenario, delay_s=2.0) is False
    assert avoidable_by_braking(scenario, deceleration_mps2=4.1) is False
    no_time = scenario.crash.time if scenario.crash else 0.0
    assert avoidable_by_braking(scenario, delay_s=no_time) is False


def test_only_crashes_of_the_av_can_be_avoidable() -> None:
    scenario, _ = CASES["brakes hard ahead"]
    with pytest.raises(InputError, match="holds no crash of the AV"):
        avoidable_by_braking(replace(scenario, crash=None))
    with pytest.raises(InputError, match="is not in the recording"):
        avoidable_by_braking(replace(scenario, crash=Crash(60.0, 0, 1)))
    for wrong in ({"delay_s": -0.1}, {"deceleration_mps2": 0.0}):
        with pytest.raises(InputError):
            avoidable_by_braking(scenario, **wrong)


def test_judged_in_bulk_as_from_the_recording(model: NddModel, seed: int) -> None:
    odd = WIDE
    setting, slots = setting_of(model, odd, adversary="swerve"), n_slots(odd)
    chunks = simulate_chunks(setting, slots, seed=seed, first=0, tests=150, threads=2)
    tests = [test for first, out, _ in chunks for test in crashed_tests(first, out)]
    braking, recording = Braking(1.0, 8.0), partial(Recorder, setting, odd)
    _, avoidable = judge_crashes(recording, setting, seed=seed, tests=tests, braking=braking, threads=2)
    recorder = recording()
    assert avoidable.tolist() == [avoidable_by_braking(recorder.record(seed, test)) for test in tests]
    assert 0 < avoidable.sum() < len(tests)
    again = judge_crashes(recording, setting, seed=seed, tests=tests[::-1], braking=braking)[1]
    assert again.tolist() == avoidable.tolist()[::-1]  # nothing is left over from the test before


def test_a_test_without_a_crash_and_no_tests_are_judged_too(model: NddModel) -> None:
    setting, braking = setting_of(model), Braking(1.0, 8.0)
    recording = partial(Recorder, setting, WIDE)
    assert not any(part.any() for part in judge_crashes(recording, setting, seed=0, tests=[0, 1], braking=braking))
    assert all(part.size == 0 for part in judge_crashes(recording, setting, seed=0, tests=[], braking=braking))
