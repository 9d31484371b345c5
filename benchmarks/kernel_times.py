"""Where the time of a world-step goes, by parts of the simulator's loop.

The tests of `timed_kernels` must end as those of `simulate`, or the benchmark stops: so the table cannot speak of other
work than the simulator's. What the looks at the clock cost is measured and taken off.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from measuring import Series, on_one_core, table
from timed_kernels import EXTRAS, PARTS, RESET, SEED, clock_cost, timed_tests

from cornerforge.sim.controllers import NOBODY
from cornerforge.sim.runner import simulate, simulate_chunks, warm_up
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import allocate_worlds, world_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.experiment.experiments import Experiment

__all__ = ["KernelTimes", "profile", "render"]


@dataclass(frozen=True)
class KernelTimes:
    """Microseconds per world-step (1 s of traffic) by part; `total` is `simulate` on the same tests, no clock inside.

    Attributes:
        parts, extras: By PARTS and EXTRAS.
        total: Of `simulate`.
        clock_ns: What was taken off for each look at the clock [ns].
        network: The shape of the policy's network, for people.
    """

    parts: dict[str, Series]
    extras: dict[str, Series]
    total: Series
    clock_ns: float
    network: str

    @property
    def sums(self) -> Series:
        """The sum of the parts, by round."""
        return Series("us", tuple(sum(values) for values in zip(*(p.values for p in self.parts.values()), strict=True)))

    @property
    def reset_share(self) -> float:
        """Share of all time that drawing the initial traffic takes."""
        return self.parts[PARTS[RESET]].median / self.total.median

    def to_json(self) -> dict[str, object]:
        return {
            "microseconds_per_world_step": {name: s.to_json() for name, s in (self.parts | self.extras).items()},
            "sum_of_parts": self.sums.to_json(),
            "total": self.total.to_json(),
            "clock_ns": self.clock_ns,
            "network": self.network,
        }


class _Bench:
    """Buffers of one profile, and the check that it drives what the simulator drives."""

    def __init__(self, run: Experiment, tests: int) -> None:
        self._run = run
        self._tests = tests
        self._world = world_of(allocate_worlds(1, run.slots))
        self._scratch = allocate_scratch(run.slots, run.setting.who.policy)
        self._states = np.zeros((run.slots, 2))
        self._clock = np.zeros(2, dtype=np.int64)
        self._frames = np.zeros(tests, dtype=np.int32)
        self._x = np.zeros(tests)
        self._plain = run.setting.with_drivers(critical=NOBODY)
        warm_up(self._plain, run.slots)
        chunks = simulate_chunks(self._plain, run.slots, seed=SEED, first=0, tests=tests, threads=1)
        outcomes = [out for _, out, _ in chunks]
        self._expected = np.concatenate([out.frame for out in outcomes])
        self._distance = np.concatenate([out.distance for out in outcomes])
        self.world_steps = int(self._expected.sum()) / 10.0
        self.clock_ns = clock_cost(self._clock, 1_000_000)
        self.drive(count=1, with_extras=True)  # compiles

    def drive(self, *, count: int, with_extras: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Microseconds per world-step of the parts and of the extras.

        Raises:
            RuntimeError: The tests ended otherwise than in the simulator.
        """
        ns = np.zeros((len(PARTS), 2), dtype=np.int64)
        extras = np.zeros((len(EXTRAS), 2), dtype=np.int64)
        timed_tests(
            0, count, self._run.setting, self._world, self._scratch, with_extras, self._states, ns, extras,
            self._clock, self._frames, self._x,
        )  # fmt: skip
        same = np.array_equal(self._frames[:count], self._expected[:count])
        if not same or not np.array_equal(self._x[:count] - self._run.setting.road.av_start, self._distance[:count]):
            raise RuntimeError("benchmarks/timed_kernels.py does not do what sim/loop.py does; bring it up to date.")
        return self._net(ns), self._net(extras)

    def total(self) -> float:
        """Microseconds per world-step of `simulate`."""
        start = time.perf_counter()
        simulate(self._plain, self._run.slots, seed=SEED, tests=self._tests, threads=1)
        return 1e6 * (time.perf_counter() - start) / self.world_steps

    def _net(self, ns: NDArray[np.int64]) -> NDArray[np.float64]:
        net: NDArray[np.float64] = (ns[:, 0] - self.clock_ns * ns[:, 1]) / 1e3 / self.world_steps
        return net


def profile(run: Experiment, *, repetitions: int, tests: int) -> KernelTimes:
    """Measure the parts, the extras and the whole by turns, on one core.

    Args:
        run: An experiment with a policy; the policy is timed but does not drive.
        repetitions: Rounds.
        tests: Per round.
    """
    parts, extras, totals = [], [], []
    with on_one_core():
        bench = _Bench(run, tests)
        for _ in range(repetitions):
            totals.append(bench.total())
            parts.append(bench.drive(count=tests, with_extras=False)[0])
            extras.append(bench.drive(count=tests, with_extras=True)[1])
    p = run.setting.who.policy
    return KernelTimes(
        _by_name(PARTS, parts),
        _by_name(EXTRAS, extras),
        Series("us", tuple(totals)),
        bench.clock_ns,
        f"{p.n_inputs} inputs, {p.n_shared} shared layers, 2 streams of {p.n_stream}, {p.width} wide",
    )


def _by_name(names: tuple[str, ...], rounds: list[NDArray[np.float64]]) -> dict[str, Series]:
    return {name: Series("us", tuple(float(r[k]) for r in rounds)) for k, name in enumerate(names)}


def render(times: KernelTimes) -> str:
    """The section's Markdown."""
    total = times.total.median

    def rows(series: dict[str, Series]) -> list[tuple[str, ...]]:
        return [(name, *s.cells(), f"{100.0 * s.median / total:.1f} %") for name, s in series.items()]

    head = ("microseconds per world-step, one core", "median", "min", "max", "share")
    whole = {"sum of these": times.sums, "**`simulate`, measured without clocks inside**": times.total}
    return (
        f"{table(head, rows(times.parts | whole))}\n\n"
        f"Besides, in the same worlds (not part of the sum; network: {times.network}):\n\n"
        f"{table(head, rows(times.extras))}\n\n"
        "The parts are timed inside the simulator's loop, with a clock between the kernels "
        f"({times.clock_ns:.0f} ns a look, taken off).\n"
        "The tests must end as `simulate` lets them end, or the benchmark stops. A clock between two kernels keeps\n"
        "the compiler from melting them into one, and finds caches as the part before left them: parts are good to\n"
        "about a tenth, or 0.1 microseconds."
    )
