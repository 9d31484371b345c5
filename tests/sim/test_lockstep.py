"""Worlds in lockstep: with a built-in AV's answers the same bits as the kernels' own loop, in any batch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, Car, setting_of, world_of
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.ndd.model import NddModel
from cornerforge.sim import lockstep
from cornerforge.sim.actions import ordered_lane, start_lane_change
from cornerforge.sim.av import av_decide
from cornerforge.sim.controllers import OUTSIDE
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.outcome import AV_CRASH, IDLE, RUNNING, Outcomes, allocate_outcomes
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.statistics import EVERYBODY, NOBODY_COUNTED, Census, Counts, allocate_counts
from cornerforge.sim.world import n_slots, world_row
from cornerforge.types import ODDS


@kernel
def answers_of_built_in(batch: lockstep.Batch, setting: Setting, answers: NDArray[np.float64]) -> None:
    for b in range(answers.shape[0]):
        w = world_row(batch.worlds, b)
        if w.state[0].outcome == RUNNING:
            command, lane = av_decide(w, setting.road, setting.av)
            answers[b, 0] = command
            answers[b, 1] = lane


def drive(
    setting: Setting, slots: int, tests: int, size: int, census: Census = NOBODY_COUNTED
) -> tuple[Outcomes, Counts]:
    """Tests 0, 1, ... of seed 5 in a batch of `size` worlds, refilled as tests end."""
    setting = setting.with_drivers(av=OUTSIDE)
    batch, out, counts = lockstep.allocate_batch(size, slots), allocate_outcomes(tests), allocate_counts()
    scratch, done = allocate_scratch(slots, setting.who.policy), np.zeros(size, np.int64)
    answers, keep = np.zeros((size, 2)), keep_nothing(slots, counts=counts, census=census)
    begun = 0
    while True:
        fresh = lockstep.idle(batch)[: tests - begun]
        lockstep.begin(5, fresh, np.arange(begun, begun + fresh.size), setting, batch)
        begun += fresh.size
        if lockstep.running(batch).size == 0:
            return out, counts
        answers_of_built_in(batch, setting, answers)
        running = lockstep.running(batch).tolist()
        n = lockstep.act(answers, True, setting, batch, scratch, keep, done)
        assert set(done[:n].tolist()) == set(running) - set(lockstep.running(batch).tolist())
        for b in done[:n]:
            state = batch.worlds.state[b, 0]
            test = state["test"]
            out.code[test], out.frame[test] = state["outcome"], state["frame"]
            out.slot_a[test], out.slot_b[test] = state["slot_a"], state["slot_b"]
            out.bv_crashes[test], out.decisions[test] = state["bv_crashes"], state["decisions"]
            out.distance[test] = batch.worlds.vehicles["x"][b, 0] - setting.road.av_start


def assert_same(a: tuple[Outcomes, Counts], b: tuple[Outcomes, Counts]) -> None:
    for ours, theirs in zip((*a[0], a[1].histograms, a[1].totals), (*b[0], b[1].histograms, b[1].totals), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("adversary", [None, "swerve", "lane-changer"])
@pytest.mark.parametrize("odd", ["default", "paper", "every 0.3 s"])
def test_the_same_bits_as_the_loop_of_the_kernels(model: NddModel, adversary: str | None, odd: str) -> None:
    road = ODDS[odd] if odd in ODDS else replace(WIDE, av_substeps=3)
    setting, slots = setting_of(model, road, adversary=adversary), n_slots(road)
    loop = drive_chunk(setting, slots, 5, 0, 150, True)
    assert_same(loop, drive(setting, slots, 150, 32, EVERYBODY))
    if adversary:
        assert (loop[0].code == AV_CRASH).any()  # there were crashes to agree on


def test_any_batch_gives_the_same(model: NddModel) -> None:
    setting, slots = setting_of(model, adversary="swerve"), n_slots(WIDE)
    one = drive(setting, slots, 60, 1)
    for size in (7, 60, 100):
        assert_same(one, drive(setting, slots, 60, size))


def test_idle_worlds_show_nothing(model: NddModel) -> None:
    setting, slots = setting_of(model).with_drivers(av=OUTSIDE), n_slots(WIDE)
    batch = lockstep.allocate_batch(3, slots)
    batch.views[:] = np.nan
    lockstep.begin(0, np.array([1]), np.array([9]), setting, batch)
    lockstep.see(batch, setting, allocate_scratch(slots, setting.who.policy))
    assert not batch.views[[0, 2]].any()
    assert batch.views[1, 0, 0] == 1.0
    assert batch.worlds.state["outcome"][:, 0].tolist() == [IDLE, RUNNING, IDLE]
    assert (lockstep.running(batch).tolist(), lockstep.idle(batch).tolist()) == ([1], [0, 2])
    assert batch.worlds.state["test"][1, 0] == 9


def test_commands_are_cut_to_what_a_vehicle_can_do(model: NddModel) -> None:
    setting, slots = setting_of(model).with_drivers(av=OUTSIDE), n_slots(WIDE)
    for wish, held in ((-50.0, -8.0), (50.0, 2.0), (-1.5, -1.5)):
        batch = lockstep.allocate_batch(1, slots)
        lockstep.begin(0, np.array([0]), np.array([0]), setting, batch)
        scratch = allocate_scratch(slots, setting.who.policy)
        lockstep.act(
            np.array([[wish, 0.0]]), False, setting, batch, scratch, keep_nothing(slots), np.zeros(1, np.int64)
        )
        assert batch.worlds.vehicles["commanded"][0, 0] == held


@pytest.mark.parametrize(
    ("lane", "change_to", "order", "then"),
    [
        (1, None, 0, 1), (1, None, 1, 2), (1, None, -1, 0),
        (2, None, 1, 2), (0, None, -1, 0),  # it would leave the road
        (1, 2, 1, 2), (1, 0, -1, 0),  # in the direction of the running change: nothing
        (1, 2, -1, 1), (1, 0, 1, 1),  # against it: back
        (1, 2, 0, 2),
    ],
)  # fmt: skip
def test_lane_orders(model: NddModel, lane: int, change_to: int | None, order: int, then: int) -> None:
    road = setting_of(model).road
    world = world_of([Car(400.0, lane, 30.0)])
    if change_to is not None:
        start_lane_change(world, 0, change_to, road)
    assert ordered_lane(world, 0, order, road) == then
