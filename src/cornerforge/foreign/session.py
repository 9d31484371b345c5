"""One process of a foreign AV with the worlds that it drives side by side, and single tests driven answer by answer."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.idm import IdmParams
from cornerforge.foreign import tracking
from cornerforge.foreign.answers import carry_out
from cornerforge.foreign.edge_cases import scenes_of, trials_of
from cornerforge.foreign.interface import AT_SITES, VIEW_SHAPE, AvContext, RoadLane
from cornerforge.foreign.process import AvFailureError, AvProcess
from cornerforge.road.lanes import lane_table, lanes_of
from cornerforge.sim import (
    Setting,
    allocate_scratch,
    av_scene,
    av_view,
    bicycle,
    keep_nothing,
    lockstep,
    warn_of_left_out,
)
from cornerforge.types import FRAME_S, SUBSTEPS, Odd

if TYPE_CHECKING:
    from collections.abc import Callable

    from cornerforge.road.straight import RoadNumbers

__all__ = ["AvSession", "Steps", "answers_per_second", "answers_per_test", "context_of", "seeds_of"]


def context_of(odd: Odd, *, batch: int, seed: int) -> AvContext:
    """Make the context of an AV: what it is told of its world."""
    return AvContext(
        batch=batch,
        n_lanes=odd.n_lanes,
        lane_width=odd.lane_width,
        vehicle_length=odd.vehicle_length,
        vehicle_width=odd.vehicle_width,
        max_speed=odd.max_speed,
        lane_change_duration=odd.lane_change_duration,
        interval=round(odd.av_substeps * FRAME_S, 1),
        test_length=odd.test_length,
        view_version=av_view.AV_VIEW_VERSION,
        seed=seed,
        set_speed=IdmParams().desired_speed,
        wheelbase=tracking.wheelbase(odd.vehicle_length),
        most_lateral_acceleration=bicycle.MOST_LATERAL_ACCELERATION,
        task=odd.task,
        lanes=_lanes_told(odd),
        site="" if odd.site is None else odd.site.name,
    )


def _lanes_told(odd: Odd) -> tuple[RoadLane, ...]:
    """Make the lanes as an AV is told of them, along x from where it starts; none where all lanes go on."""
    table, start = lane_table(odd), odd.av_start
    told = []
    for lane in lanes_of(odd) if table.varied else ():
        if lane.kind != "closed":
            by = next(by for begin, end, by, _ in table.stretches[lane.slot].tolist() if begin <= lane.begin < end)
            by = inf if odd.task == "exit" and lane.slot == table.exit_slot else by - start
            limit = inf if lane.limit is None else lane.limit
            told.append(RoadLane(lane.slot, lane.kind, lane.begin - start, lane.end - start, by, limit))
    return tuple(told)


def seeds_of(seed: int, tests: NDArray[np.int64]) -> NDArray[np.int64]:
    """Compute a number, 0 or more, for each test from seed and test alone (SplitMix64), shape as `tests`."""
    start = np.uint64(seed * 0x9E3779B97F4A7C15 % 2**64)  # in Python's integers: NumPy warns where one number overflows
    z = np.full(tests.shape, start) + tests.astype(np.uint64)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(1)).astype(np.int64)


def answers_per_second(setting: Setting) -> int:
    """Compute how often the AV answers in a second."""
    return -(-SUBSTEPS // int(setting.road.av_substeps))


def answers_per_test(setting: Setting) -> float:
    """Compute about how often the AV answers in a test that it drives to its end: at 30 m/s, at a site in 30 s."""
    road = setting.road
    return (30.0 if road.site.size else float(road.test_length) / 30.0) * answers_per_second(setting)


class AvSession:
    """One AV process and the worlds that it drives side by side; serves one thread at a time.

    Args:
        context, road: What the AV is told of its world; the road's constants.
        start: Starts a process of the AV.
    """

    def __init__(self, context: AvContext, road: RoadNumbers, start: Callable[[], AvProcess]) -> None:
        self._context, self._road, self._start = context, road, start
        self._process: AvProcess | None = None
        self._batch: lockstep.Batch | None = None

    def process(self) -> AvProcess:
        """Give the AV's process, set up; a new one if it was given up."""
        if self._process is None:
            process = self._start()
            process.setup(self._context)
            self._process = process
        return self._process

    @property
    def batch_size(self) -> int:
        """Worlds that the AV drives side by side."""
        return self._context.batch

    @property
    def remembers(self) -> bool:
        """May the AV's answer depend on what it saw before in a test? An AV without `reset` can have no such memory."""
        return self.process().about["remembers"] == "yes"

    def views(self, size: int, slots: int) -> NDArray[Any]:
        """Allocate what the AV sees of `size` worlds of `slots` vehicle slots (`sim.av_scene`)."""
        about = self.process().about
        if about["form"] == "view":
            return np.zeros((size, *VIEW_SHAPE), dtype=np.float32)
        objects = int(about["objects"])
        others = slots - 1 if objects < 0 else min(objects, slots - 1)
        if about["form"] == AT_SITES:
            return np.zeros((size, av_scene.FIRST_AGENT + others, av_scene.SITE_COLUMNS))
        return np.zeros((size, 1 + others, av_scene.SCENE_COLUMNS))

    def shown(self, views: NDArray[np.float32]) -> NDArray[Any]:
        """Turn views (B, 13, 8), or scenes of a site, into what this AV sees; for trials without a simulator."""
        about = self.process().about
        if about["form"] == "view":
            return views
        objects = int(about["objects"])
        if about["form"] == AT_SITES:
            return views if objects < 0 else np.ascontiguousarray(views[:, : av_scene.FIRST_AGENT + objects])
        return scenes_of(views, VIEW_SHAPE[0] if objects < 0 else 1 + objects, self._context)

    def act(
        self, views: NDArray[Any], rows: NDArray[np.int64], fresh: NDArray[np.int64], seeds: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], dict[int, AvFailureError]]:
        """Ask the AV what it does in some rows; in rows `fresh` tests begin, for which it is told `seeds`.

        Returns:
            Answers, (B, W), 0 where they cannot be carried out; and why not, for those of `rows`, ascending.

        Raises:
            AvFailureError: It failed, and it is not known in which world.
        """
        process = self.process()
        given, failed = process.act(views, fresh, seeds)
        answers, failed = carry_out(given, failed, process.about["form"], views, self._road)
        bad = np.asarray(~np.isfinite(answers).all(axis=1))
        answers[bad] = 0.0
        return answers, {row: AvFailureError(*failed[row]) for row in rows[bad[rows]].tolist()}

    def ask_once(self) -> None:
        """Ask about ordinary traffic; after it no row remembers anything of use.

        Raises:
            AvFailureError: There is no answer.
        """
        everywhere = np.arange(self.batch_size)
        views = self.shown(trials_of(self._context).ordinary(self.batch_size))
        self.act(views, everywhere, everywhere, np.zeros_like(everywhere))

    @property
    def is_fresh(self) -> bool:
        """Will the next question be the first to its process?"""
        return self._process is None

    def renew(self) -> None:
        """Make the AV anew after a failure; where that fails, the next question starts a new process."""
        if self._process is not None and not self._process.renew(self._context):
            self.drop()

    def resize(self, batch: int) -> None:
        """Drive so many worlds side by side from now on; where that is another number, the AV is made anew."""
        if batch != self._context.batch:
            self._context, self._batch = replace(self._context, batch=batch), None
            self.renew()

    def set_to(self, speed: float) -> None:
        """Let the AV drive at a speed where nothing is in its way [m/s]; where that is another one, it is made anew."""
        if speed != self._context.set_speed:
            self._context = replace(self._context, set_speed=speed)
            self.renew()

    def drop(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def batch(self, slots: int) -> lockstep.Batch:
        """Give the batch with all worlds idle."""
        if self._batch is None or self._batch.worlds.vehicles.shape[1] != slots:
            views = self.views(self._context.batch, slots)
            self._batch = lockstep.allocate_batch(self._context.batch, slots, views, self._road)
        lockstep.stop(self._batch, np.arange(len(self._batch.views)))
        return self._batch


class Steps:
    """Drives the test in world 0 of a batch, answer by answer; keeps nothing of it.

    The setting's AV is OUTSIDE or STEERED.
    """

    def __init__(self, setting: Setting, slots: int, batch: lockstep.Batch) -> None:
        self._setting, self._batch = setting, batch
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._keep = keep_nothing(slots)
        self._done = np.zeros(batch.views.shape[0], dtype=np.int64)

    def see(self) -> None:
        """Write what the AV sees into the batch's views."""
        lockstep.see(self._batch, self._setting, self._scratch)

    def act(self, answers: NDArray[np.float64]) -> None:
        """Carry out the AV's answers and go on to its next decision."""
        lockstep.act(answers, False, self._setting, self._batch, self._scratch, self._keep, self._done)
        warn_of_left_out(self._scratch)
