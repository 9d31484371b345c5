"""How speed and memory grow: with BVs, lanes, tests per batch and threads; and what the ground truth would take."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from measuring import Series, interleave, on_one_core, table
from worlds import SEED, driven_seconds, mean_bvs, with_bvs

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.sim.runner import simulate, simulate_chunks, warm_up
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import allocate_worlds, world_of
from cornerforge.work import default_threads

__all__ = ["GROUND_TRUTH_TESTS", "Memory", "Scaling", "measure_scaling", "render"]

GROUND_TRUTH_TESTS = 234_212_252
"""Tests behind the released natural crash rate on two lanes (D2RL), which took 72,000 core-hours."""
BVS = (5, 10, 20, 37, 60)
LANES = (2, 3, 4, 5, 6)
BATCHES = (1, 8, 64, 512, 4096)


@dataclass(frozen=True)
class Memory:
    """Bytes of one world: the arrays' sizes, scratch included, and what a batch of worlds makes the process grow by."""

    slots: int
    computed: int
    measured: float
    worlds: int


@dataclass(frozen=True)
class Scaling:
    """Rates by what was varied.

    Attributes:
        bvs, lanes: World-steps per second on one core, by mean number of BVs, or by (lanes, mean number of BVs).
        batches: Tests per second on all cores, by tests per chunk.
        threads: World-steps per second, by threads.
        twenty: World-steps per second of 3 lanes and 20 BVs, on all cores.
        ground_truth: Tests per second on all cores, by the AV's name; 2 lanes, 400 m.
        memory: Of the default world.
    """

    bvs: dict[float, Series]
    lanes: dict[tuple[int, float], Series]
    batches: dict[int, Series]
    threads: dict[int, Series]
    twenty: Series
    ground_truth: dict[str, Series]
    memory: Memory

    @staticmethod
    def core_hours(tests_per_second: float) -> float:
        """Core-hours that all tests of the ground truth would take at this rate on all cores."""
        return GROUND_TRUTH_TESTS / tests_per_second * default_threads() / 3600.0

    def to_json(self) -> dict[str, object]:
        return {
            "bvs": {f"{n:.1f}": s.to_json() for n, s in self.bvs.items()},
            "lanes": {str(n): {"mean_bvs": bvs, **s.to_json()} for (n, bvs), s in self.lanes.items()},
            "tests_per_chunk": {str(n): s.to_json() for n, s in self.batches.items()},
            "threads": {str(n): s.to_json() for n, s in self.threads.items()},
            "three_lanes_twenty_bvs": self.twenty.to_json(),
            "ground_truth": {
                av: {"core_hours": self.core_hours(s.median), **s.to_json()} for av, s in self.ground_truth.items()
            },
            "bytes_per_world": {"computed": self.memory.computed, "measured": self.memory.measured},
        }


def _rate(run: Experiment, tests: int, threads: int, counted: float) -> Callable[[], float]:
    """A measurement of `simulate`: `counted` (world-steps or tests) per second."""
    warm_up(run.setting, run.slots)

    def measure() -> float:
        start = time.perf_counter()
        simulate(run.setting, run.slots, seed=SEED, tests=tests, threads=threads)
        return counted / (time.perf_counter() - start)

    return measure


def _by_world(runs: dict[str, Experiment], repetitions: int, tests: int) -> dict[str, Series]:
    """World-steps per second on one core, by turns."""
    measurements = {name: _rate(run, tests, 1, driven_seconds(run, tests)) for name, run in runs.items()}
    with on_one_core():
        return interleave(repetitions, measurements, "world-steps/s")


def _batches(run: Experiment, repetitions: int, tests: int) -> dict[int, Series]:
    """Tests per second by tests per chunk, on all cores."""

    def measurement(chunk: int) -> Callable[[], float]:
        def measure() -> float:
            start = time.perf_counter()
            for _ in simulate_chunks(
                run.setting, run.slots, seed=SEED, first=0, tests=tests, threads=default_threads(), chunk=chunk
            ):
                pass
            return tests / (time.perf_counter() - start)

        return measure

    named = {str(chunk): measurement(chunk) for chunk in BATCHES}
    return {int(name): s for name, s in interleave(repetitions, named, "tests/s").items()}


def _threads(run: Experiment, repetitions: int, tests: int) -> dict[int, Series]:
    """World-steps per second by threads: 1, 2, 4, ... up to all cores."""
    cores = default_threads()
    counts = sorted({1, 2, cores, *(2**k for k in range(cores.bit_length()) if 2**k <= cores)})
    steps = driven_seconds(run, tests)
    named = {str(n): _rate(run, tests, n, steps) for n in counts}
    return {int(name): s for name, s in interleave(repetitions, named, "world-steps/s").items()}


def _resident() -> int:
    """Resident bytes of this process (Linux; 0 elsewhere)."""
    path = Path("/proc/self/statm")
    return int(path.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if path.exists() else 0


def _bytes(parts: tuple[Any, ...]) -> int:
    """Size of all arrays in nested tuples."""
    return sum(_bytes(part) if isinstance(part, tuple) else part.nbytes for part in parts)


def measure_memory(run: Experiment, worlds: int) -> Memory:
    """Fill a batch of worlds with traffic and see how the process grows."""
    before = _resident()
    batch = allocate_worlds(worlds, run.slots)
    scratch = allocate_scratch(run.slots, run.setting.who.policy)
    for b in range(worlds):
        reset_world(world_of(batch, b), SEED, b, run.setting)
    grown = (_resident() - before) / worlds
    computed = _bytes(batch) // worlds + _bytes(scratch)
    return Memory(run.slots, computed, grown, worlds)


def measure_scaling(*, repetitions: int, tests: int) -> Scaling:
    """Measure all of it; `tests` is the size of one measurement on one core in the default world."""
    default = experiment()
    sized = [with_bvs(n) for n in BVS]
    wide = [(n, experiment(lanes=n)) for n in LANES]
    by_bvs = _by_world({str(n): run for n, (run, _) in zip(BVS, sized, strict=True)}, repetitions, tests)
    by_lanes = _by_world({str(n): run for n, run in wide}, repetitions, tests)
    cores = default_threads()
    twenty = sized[BVS.index(20)][0]
    steps = driven_seconds(twenty, cores * tests)
    two = {av: experiment(av=av, lanes=2) for av in ("idm-mobil", "idm-mobil-d2rl")}
    on_all = {"twenty": _rate(twenty, cores * tests, cores, steps)}
    on_all |= {av: _rate(run, 4 * tests, cores, 4 * tests) for av, run in two.items()}
    rates = interleave(repetitions, on_all, "per s")
    return Scaling(
        bvs={found: by_bvs[str(n)] for n, (_, found) in zip(BVS, sized, strict=True)},
        lanes={(n, mean_bvs(run, 50)): by_lanes[str(n)] for n, run in wide},
        batches=_batches(default, repetitions, cores * tests),
        threads=_threads(default, repetitions, cores * tests),
        twenty=rates["twenty"],
        ground_truth={av: rates[av] for av in two},
        memory=measure_memory(default, 2000),
    )


def _render_sizes(result: Scaling) -> str:
    bvs = [(f"3 lanes, {n:.1f} BVs", *s.cells(), f"{1e6 / s.median / n:.3f}") for n, s in result.bvs.items()]
    lanes = [
        (f"{n} lanes, {found:.1f} BVs", *s.cells(), f"{1e6 / s.median / found:.3f}")
        for (n, found), s in result.lanes.items()
    ]
    return table(("world-steps per second, one core", "median", "min", "max", "us a BV"), bvs + lanes)


def _render_threads(result: Scaling) -> str:
    rows = []
    for threads, series in result.threads.items():
        gains = Series("x", tuple(a / b for a, b in zip(series.values, result.threads[1].values, strict=True)))
        rows.append((str(threads), *series.cells(), f"{gains.median:.2f}"))
    return table(("threads", "world-steps/s, median", "min", "max", "times one thread"), rows)


def render(result: Scaling) -> str:
    """The section's Markdown."""
    batches = [(f"{n:,}", *s.cells()) for n, s in result.batches.items()]
    truth = [
        (f"2 lanes, `{av}`, 400 m", *s.cells(), f"**{result.core_hours(s.median):.2f}**")
        for av, s in result.ground_truth.items()
    ]
    cores, memory = default_threads(), result.memory
    head = (f"tests per second, {cores} cores", "median", "min", "max", f"core-hours for {GROUND_TRUTH_TESTS:,} tests")
    return (
        f"{table(head, truth)}\n\n"
        "The released ground truth on two lanes took 72,000 core-hours; ours by the mean test of this seed.\n\n"
        f"**3 lanes and 20 BVs: {result.twenty.cells()[0]} world-steps/s on {cores} cores** "
        f"({result.twenty.cells()[1]} to {result.twenty.cells()[2]}).\n\n"
        f"{_render_sizes(result)}\n\n"
        "The first rows lengthen or shorten the stretch with traffic at the same density; the AV starts as far\n"
        "along it as in the default world.\n\n"
        f"{_render_threads(result)}\n\n"
        f"{table((f'tests per chunk, {cores} cores', 'tests/s, median', 'min', 'max'), batches)}\n\n"
        f"Memory per world ({memory.slots} slots, 3 lanes): {memory.computed:,} bytes by the arrays' sizes, scratch\n"
        f"included; {memory.measured:,.0f} bytes by how the process grows with {memory.worlds:,} worlds full of\n"
        "traffic (pages of slots that stay empty are never touched; one scratch serves all). The tables, once a\n"
        "process: 12 MB."
    )
