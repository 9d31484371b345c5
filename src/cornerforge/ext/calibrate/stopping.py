"""Traffic that stops and merges: gaps in a queue as in recordings, where drivers merge, recorded merges one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.naturalistic import tables_of
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ext.calibrate.free_running import on_road
from cornerforge.ext.calibrate.judging import judged, spread
from cornerforge.ext.calibrate.lane_observations import transitions_of
from cornerforge.ext.calibrate.readers import Reading
from cornerforge.ext.calibrate.transitions import HARDLY, chance_of, rarities
from cornerforge.intervals import binomial_interval
from cornerforge.results.validation import FactFound
from cornerforge.road.lanes import lanes_of
from cornerforge.road.straight import along
from cornerforge.sim import (
    OVER,
    World,
    advance,
    allocate_scratch,
    allocate_worlds,
    keep_nothing,
    reset_world,
    warn_of_left_out,
    world_of,
)
from cornerforge.types import Odd

__all__ = ["compare_merges", "compare_queues"]

Floats = NDArray[np.float64]

_BLOCKS, _TESTS = 20, 20
_BANDS = ((0.0, 0.3), (3.0, 8.0))
"""Speeds [m/s]: standing, crawling."""
_FARTHEST = 50.0
_FEWEST = 200
_FACTOR = 1.35
"""Quartiles of gaps in a queue may differ by this factor: I-80 is one place, in three quarters of an hour."""
_LATE = 60.0
"""A driver is late that has not begun to leave an acceleration lane so far before its end [m]."""
_MOST_LATE = 0.02


def _driven(run: Experiment, odd: Odd, seed: int, seconds: range) -> Iterator[tuple[int, World]]:
    """Drive natural traffic and show it at some seconds; with the number of the block that a test belongs to."""
    moved = on_road(run, odd)
    setting = moved.setting._replace(tables=tables_of(run.model, stops=True, traffic=odd.traffic))
    world, scratch = (
        world_of(allocate_worlds(1, moved.slots, setting.road)),
        allocate_scratch(moved.slots, NO_POLICY),
    )
    for test in range(_BLOCKS * _TESTS):
        reset_world(world, seed, test, setting)
        for second in seconds:
            if advance(world, setting, scratch, keep_nothing(moved.slots), second) == OVER:
                break
            yield test % _BLOCKS, world
    warn_of_left_out(scratch)


def _gaps(world: World, n_lanes: int) -> Floats:
    """Give speed and gap of all that follow in their lane, (n, 2)."""
    v = world.vehicles[: int(world.state["n_vehicles"][0])]
    v = v[(v["present"] == 1) & (v["duration"] == 0.0)]
    found = []
    for lane in range(n_lanes):
        one = np.sort(v[v["target_lane"] == lane], order="x")
        gap = along(one["x"][:-1], one["x"][1:]) - 0.5 * (one["length"][1:] + one["length"][:-1])
        found.append(np.stack([one["speed"][:-1], gap], axis=1))
    return np.concatenate(found)


def _row(
    blocks: Sequence[Floats], value: Callable[[Floats], float], allowed: tuple[float, float] | None, **row: object
) -> FactFound:
    """Judge a value of all blocks' numbers together, with its interval over the blocks."""

    def of(parts: Sequence[Floats]) -> float | None:
        joined = np.concatenate(parts)
        return float(value(joined)) if joined.size else None

    without = [of([*blocks[:k], *blocks[k + 1 :]]) for k in range(len(blocks))]
    n = sum(block.size for block in blocks)
    return judged(of(blocks), allowed, interval95=spread(of(blocks), without), n=n, **row)


def compare_queues(
    run: Experiment, names: Sequence[str], readings: Sequence[Reading], *, seed: int = 0
) -> list[FactFound]:
    """Compare gaps of standing and crawling vehicles in a queue with those of each file that has enough of them.

    A model that knows no traffic that stops has no rows.
    """
    if run.model.slow is None:
        return []
    odd = Odd(traffic="queue")
    found: list[list[Floats]] = [[np.zeros((0, 2))] for _ in range(_BLOCKS)]
    for block, world in _driven(run, odd, seed, range(15, 46, 3)):
        found[block].append(_gaps(world, odd.n_lanes))
    blocks = [np.concatenate(parts) for parts in found]
    rows = []
    for name, reading in zip(names, readings, strict=True):
        for low, high in _BANDS:
            d = reading.decisions
            recorded = d.gap[(d.speed >= low) & (d.speed < high) & (d.gap < _FARTHEST)]
            if recorded.size < _FEWEST:
                continue
            seen = [
                block[(block[:, 0] >= low) & (block[:, 0] < high) & (block[:, 1] < _FARTHEST), 1] for block in blocks
            ]
            for share in (25, 50, 75):
                there = float(np.percentile(recorded, share))
                rows.append(
                    _row(
                        seen, partial(np.percentile, q=share), (there / _FACTOR, there * _FACTOR),
                        theme="queues", when=name, unit="m", published=there,
                        fact=f"gap at {low:g} to {high:g} m/s, {share} % of followers are nearer",
                        source=f"recorded, {recorded.size:,} decisions",
                    )
                )  # fmt: skip
    return rows


def compare_merges(
    run: Experiment, names: Sequence[str], readings: Sequence[Reading], *, seed: int = 0
) -> list[FactFound]:
    """Judge where drivers of the road `on-ramp` merge, and how likely the recorded merges are there, file by file.

    A recorded lane change out of a file's outermost lane counts as a merge: on US-101 that is the lane between an
    on-ramp and an exit. It is put into the middle of the acceleration lane, where it is urgent.
    """
    odd = odd_on(Odd(), road_named("on-ramp"))
    lane = next(one for one in lanes_of(odd) if one.kind == "acceleration")
    places: list[list[float]] = [[] for _ in range(_BLOCKS)]
    late: list[list[float]] = [[] for _ in range(_BLOCKS)]
    for block, world in _driven(run, odd, seed, range(1, 30)):
        v = world.vehicles[1 : int(world.state["n_vehicles"][0])]
        there = (v["present"] == 1) & (v["y"] < odd.lane_width)
        begins = there & (v["duration"] > 0.0) & (v["clock"] <= 1.05) & (v["target_lane"] == lane.slot + 1)
        moved = along(lane.begin, v["x"][begins]) - v["speed"][begins] * v["clock"][begins]
        places[block] += (moved / (lane.end - lane.begin)).tolist()
        left = along(v["x"], lane.end)
        passes = there & (left < _LATE) & (left + v["speed"] >= _LATE)
        late[block] += (v["duration"][passes] == 0.0).astype(float).tolist()
    asked = [np.array(one) for one in places]
    n_merges, n_late = sum(map(len, places)), int(sum(sum(one) for one in late))
    rows = [
        _row(
            asked, np.median, (0.0, 0.5), theme="merging", when="on-ramp", unit="", published=None,
            fact="half of the merges begin in this share of the acceleration lane",
            source="Blumenfeld and Weiss 1971: most merge near its begin",
        ),
        judged(
            n_late / max(n_merges, 1), (0.0, _MOST_LATE), theme="merging", when="on-ramp", unit="", published=None,
            fact=f"share that has not begun to merge {_LATE:g} m before the end", source="stated",
            n=n_merges, interval95=binomial_interval(min(n_late, n_merges), max(n_merges, 1)),
        ),
    ]  # fmt: skip
    setting = on_road(run, odd).setting._replace(tables=tables_of(run.model, stops=True))
    for name, reading in zip(names, readings, strict=True):
        every = transitions_of(reading) or []
        outer = max((one.lane for one in every), default=0)
        middle = 0.5 * (lane.begin + lane.end)
        chances = np.array(
            [chance_of(one, setting, lane=lane.slot, at=middle) for one in every if one.lane == outer and one.to_left]
        )
        fact = f"share of lane changes out of the outermost lane that are of probability below {HARDLY:g}"
        rows += rarities(chances, "merging", name, fact)
    return rows
