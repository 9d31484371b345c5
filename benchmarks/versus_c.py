"""The Numba kernels against the same loops in C, by turns, on one core and through one thread pool."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from measuring import Series, interleave, on_one_core, ratio, table
from worlds import SEED, driven_seconds, with_bvs
from yardstick import COMPILER, FLAGS, Yardstick, compiler_version, has_compiler, same_outcomes

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.sim.runner import drive_chunk, warm_up
from cornerforge.work import default_threads

__all__ = ["AIM", "Comparison", "compare", "render"]

AIM = 0.6
"""Of C's speed."""
_CHUNK = 512


@dataclass(frozen=True)
class Comparison:
    """World-steps per second of one world, by "ours" and "C" and number of threads.

    Attributes:
        world: For people.
        rates: Keys (who, threads).
    """

    world: str
    rates: dict[tuple[str, int], Series]

    def ratio(self, threads: int) -> Series:
        """Ours over C's, formed within a round."""
        return ratio(self.rates["ours", threads], self.rates["C", threads])

    def to_json(self) -> dict[str, object]:
        by_name = {f"{who}, {threads} threads": s.to_json() for (who, threads), s in self.rates.items()}
        threads = sorted({n for _, n in self.rates})
        return {"world_steps_per_second": by_name, "ratio": {str(n): self.ratio(n).to_json() for n in threads}}


def _drivers(run: Experiment) -> dict[str, Callable[[int, int], object]]:
    """Both as functions of (first test, count), held to equal outcomes on a first chunk.

    Raises:
        RuntimeError: They do not drive the same.
    """
    warm_up(run.setting, run.slots)
    yardstick = Yardstick(run.setting)
    ours, _ = drive_chunk(run.setting, run.slots, SEED, 0, _CHUNK, False)
    if not same_outcomes(ours, yardstick.drive_chunk(run.slots, SEED, 0, _CHUNK)):
        raise RuntimeError("benchmarks/yardstick no longer drives what the simulator drives; bring it up to date.")
    return {
        "ours": lambda first, count: drive_chunk(run.setting, run.slots, SEED, first, count, False),
        "C": lambda first, count: yardstick.drive_chunk(run.slots, SEED, first, count),
    }


def _rate(drive: Callable[[int, int], object], tests: int, threads: int, steps: float) -> Callable[[], float]:
    """A measurement [world-steps/s]; both sides get the same chunks from the same kind of pool."""
    starts = range(0, tests, _CHUNK)

    def measure() -> float:
        with ThreadPoolExecutor(threads) as pool:
            start = time.perf_counter()
            list(pool.map(lambda first: drive(first, min(_CHUNK, tests - first)), starts))
            return steps / (time.perf_counter() - start)

    return measure


def _compare_world(name: str, run: Experiment, repetitions: int, tests: int) -> Comparison:
    drivers, steps = _drivers(run), driven_seconds(run, tests)
    rates = {}
    with on_one_core():
        one = {who: _rate(drive, tests, 1, steps) for who, drive in drivers.items()}
        for who, series in interleave(repetitions, one, "world-steps/s").items():
            rates[who, 1] = series
    cores = default_threads()
    if cores > 1:
        steps = driven_seconds(run, cores * tests)
        many = {who: _rate(drive, cores * tests, cores, steps) for who, drive in drivers.items()}
        for who, series in interleave(repetitions, many, "world-steps/s").items():
            rates[who, cores] = series
    return Comparison(name, rates)


def compare(*, repetitions: int, tests: int) -> list[Comparison]:
    """Three lanes with 20 and 37 BVs, and the default two-lane world; empty without a C compiler."""
    if not has_compiler():
        return []
    worlds = {f"3 lanes, {found:.0f} BVs": run for run, found in (with_bvs(20), with_bvs(37))}
    worlds["2 lanes, `idm-mobil-d2rl`"] = experiment(lanes=2, av="idm-mobil-d2rl")
    return [_compare_world(name, run, repetitions, tests) for name, run in worlds.items()]


def render(results: list[Comparison]) -> str:
    """The section's Markdown."""
    if not results:
        return f"Left out: there is no {COMPILER} on this machine."
    rows = []
    for result in results:
        for threads in sorted({n for _, n in result.rates}):
            share = result.ratio(threads)
            ours, theirs = (result.rates[who, threads] for who in ("ours", "C"))
            name = f"{result.world}; {threads} thread{'s' * (threads > 1)}"
            rows.append((name, ours.cells()[0], theirs.cells()[0], *share.cells()))
    head = ("world-steps per second", "ours, median", "C, median", "**ours / C**, median", "min", "max")
    return (
        f"{table(head, rows)}\n\n"
        f"Aim: at least {AIM:g}. The same loops on the same arrays in C (`benchmarks/yardstick/`), compiled now with\n"
        f"`{COMPILER} {' '.join(FLAGS)}`\n"
        f"({compiler_version()}), called in the same chunks from the same thread pool.\n"
        "Outcomes are compared here, and final states bit for bit in `tests/benchmarks/test_yardstick.py`."
    )
