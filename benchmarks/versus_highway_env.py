"""World-steps per second of `simulate` and of highway-env, on one core, with the same number of vehicles.

A world-step is 1 s of traffic of the AV and all background vehicles (BVs) in 10 substeps of 0.1 s. What differs: see
`DIFFERENCES`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from highway_env.envs.highway_env import HighwayEnv, HighwayEnvFast
from measuring import Series, interleave, on_one_core, ratio, table
from worlds import SEED, driven_seconds, mean_bvs, with_bvs

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.sim.runner import simulate, warm_up

__all__ = ["Comparison", "SmallWorld", "compare", "compare_small", "render", "render_small"]

_IDLE = 1
"""highway-env's discrete action that keeps lane and speed."""
DIFFERENCES = """\
What differs between the two:

- Our BVs draw their decision from naturalistic tables once a second; highway-env's (`IDMVehicle`, its default) follow
  the IDM every 0.1 s and consider a lane change by MOBIL once a second. "IDM BVs" is ours with the IDM once a second,
  without lane changes.
- Our AV is IDM and MOBIL, deciding every 0.1 s; highway-env's ego vehicle keeps lane and speed (action `IDLE`), which
  costs it less.
- Both move all vehicles and look for contacts every 0.1 s: highway-env between all pairs, we between those that
  can touch within the second. `highway-fast-v0` is highway-env without contacts among BVs: less work than ours.
- highway-env builds a Gymnasium observation (5 vehicles) and a reward once a second, we neither.
- Ours drive on {road:.0f} m around the AV; highway-env puts the same number ahead of its ego vehicle at its default
  density, somewhat closer together. It is stepped without rendering and without Gymnasium's wrappers, and reset after
  {steps} steps (our mean test); resets after a crash of its ego vehicle are not counted. An unfinished last second of
  our tests counts by its tenths.
- "Without resets" leaves the drawing of the initial traffic out; for ours that time is measured apart (next section)
  and taken off."""


@dataclass(frozen=True)
class Comparison:
    """All of one comparison; rates in world-steps per second."""

    mean_bvs: float
    n_bvs: int
    steps_per_test: int
    pinned: bool
    traffic_length: float
    rates: dict[str, Series]

    def to_json(self) -> dict[str, object]:
        return {
            "mean_bvs": self.mean_bvs,
            "highway_env_bvs": self.n_bvs,
            "highway_env_steps_per_episode": self.steps_per_test,
            "pinned_to_one_core": self.pinned,
            "world_steps_per_second": {name: series.to_json() for name, series in self.rates.items()},
            "ratios": {name: series.to_json() for name, series in self.ratios().items()},
        }

    def ratios(self) -> dict[str, Series]:
        """Ours over theirs, each against the highway-env run right beside it."""
        theirs, fast = self.rates["highway-env"], self.rates["highway-env, `highway-fast-v0`"]
        with_resets = self.rates["highway-env, resets included"]
        return {
            "resets included": ratio(self.rates["ours, resets included"], with_resets),
            "without resets": ratio(self.rates["ours"], theirs),
            "without resets, against `highway-fast-v0`": ratio(self.rates["ours"], fast),
            "IDM BVs, resets included": ratio(self.rates["ours, IDM BVs, resets included"], with_resets),
        }


class _Theirs:
    """highway-env with a given number of vehicles; counts seconds of stepping and of resetting apart.

    Args:
        kind: Which of its environments.
        n_bvs, lanes: The world.
        steps_per_episode: Steps to the next reset, if the ego vehicle does not crash before.
    """

    def __init__(self, kind: type[HighwayEnv], n_bvs: int, lanes: int, steps_per_episode: int) -> None:
        self._steps_per_episode = steps_per_episode
        self._episode = 0
        self._env = kind(
            config={
                "simulation_frequency": 10,
                "policy_frequency": 1,
                "lanes_count": lanes,
                "vehicles_count": n_bvs,
                "other_vehicles_type": "highway_env.vehicle.behavior.IDMVehicle",
                "duration": 10**9,
            }
        )

    def drive(self, episodes: int) -> tuple[int, float, float]:
        """Drive so many tests' worth of steps; returns steps, seconds in `step`, seconds in `reset`.

        Only the reset that begins an episode counts: ours crash once in a million tests, its idle ego vehicle often.
        """
        stepping = resetting = 0.0
        for _ in range(episodes):
            resetting += self._reset()
            for _ in range(self._steps_per_episode):
                start = time.perf_counter()
                _, _, terminated, truncated, _ = self._env.step(_IDLE)
                stepping += time.perf_counter() - start
                if terminated or truncated:
                    self._reset()
        return episodes * self._steps_per_episode, stepping, resetting

    def _reset(self) -> float:
        start = time.perf_counter()
        self._env.reset(seed=self._episode)
        self._episode += 1
        return time.perf_counter() - start


def _ours(run: Experiment, tests: int) -> Callable[[], float]:
    """A measurement of `simulate`, resets, thread pool and tally included [world-steps/s]."""
    warm_up(run.setting, run.slots)
    steps = driven_seconds(run, tests)

    def measure() -> float:
        start = time.perf_counter()
        simulate(run.setting, run.slots, seed=SEED, tests=tests, threads=1)
        return steps / (time.perf_counter() - start)

    return measure


def compare(*, repetitions: int, tests: int, episodes: int, reset_share: float) -> Comparison:
    """Measure both, by turns, in one process that is kept on one core.

    Args:
        repetitions: Rounds.
        tests: Of ours per round.
        episodes: Of theirs per round.
        reset_share: Share of our time that resets take.
    """
    run, idm = experiment(), experiment(bv="idm")
    bvs = mean_bvs(run, 50)
    steps_per_test = round(driven_seconds(run, 500) / 500)
    size = (round(bvs), run.odd.n_lanes, steps_per_test)
    theirs, fast = _Theirs(HighwayEnv, *size), _Theirs(HighwayEnvFast, *size)
    with_resets: list[float] = []

    def normal() -> float:
        steps, stepping, resetting = theirs.drive(episodes)
        with_resets.append(steps / (stepping + resetting))
        return steps / stepping

    def without_contacts() -> float:
        steps, stepping, _ = fast.drive(episodes)
        return steps / stepping

    measurements = {
        "ours, resets included": _ours(run, tests),
        "highway-env": normal,
        "ours, IDM BVs, resets included": _ours(idm, tests),
        "highway-env, `highway-fast-v0`": without_contacts,
    }
    with on_one_core() as pinned:
        theirs.drive(1)  # what is made once is not counted
        fast.drive(1)
        rates = interleave(repetitions, measurements, "world-steps/s")
    everything = rates["ours, resets included"]
    rates["ours"] = Series(everything.unit, tuple(v / (1.0 - reset_share) for v in everything.values))
    rates["highway-env, resets included"] = Series("world-steps/s", tuple(with_resets))
    return Comparison(bvs, round(bvs), steps_per_test, pinned, run.odd.traffic_length, rates)


@dataclass(frozen=True)
class SmallWorld:
    """World-steps per second, resets included, on one core with about 20 BVs."""

    mean_bvs: float
    ours: Series
    theirs: Series

    @property
    def ratio(self) -> Series:
        return ratio(self.ours, self.theirs)

    def to_json(self) -> dict[str, object]:
        parts = {"ours": self.ours, "highway_env": self.theirs, "ratio": self.ratio}
        return {"mean_bvs": self.mean_bvs, **{name: series.to_json() for name, series in parts.items()}}


def compare_small(*, repetitions: int, tests: int, episodes: int) -> SmallWorld:
    """The same with 3 lanes and 20 BVs, resets included; arguments as those of `compare`."""
    run, bvs = with_bvs(20)
    theirs = _Theirs(HighwayEnv, round(bvs), run.odd.n_lanes, round(driven_seconds(run, 500) / 500))

    def with_resets() -> float:
        steps, stepping, resetting = theirs.drive(episodes)
        return steps / (stepping + resetting)

    with on_one_core():
        theirs.drive(1)
        rates = interleave(repetitions, {"ours": _ours(run, tests), "theirs": with_resets}, "world-steps/s")
    return SmallWorld(bvs, rates["ours"], rates["theirs"])


def render_small(result: SmallWorld) -> str:
    """One more table for the section."""
    rows = [
        ("ours, world-steps/s", *result.ours.cells()),
        ("highway-env, world-steps/s", *result.theirs.cells()),
        ("ours / highway-env", *result.ratio.cells()),
    ]
    return table((f"3 lanes, {result.mean_bvs:.1f} BVs, one core, resets included", "median", "min", "max"), rows)


def render(result: Comparison) -> str:
    """The section's Markdown."""
    order = (
        "ours, resets included",
        "ours",
        "ours, IDM BVs, resets included",
        "highway-env, resets included",
        "highway-env",
        "highway-env, `highway-fast-v0`",
    )
    rates = table(
        ("world-steps per second, one core", "median", "min", "max"),
        [(name, *result.rates[name].cells()) for name in order],
    )
    ratios = table(
        ("ours / highway-env", "median", "min", "max"),
        [(name, *series.cells()) for name, series in result.ratios().items()],
    )
    where = "The process is kept on one core." if result.pinned else "The process could not be kept on one core."
    counts = (
        f"Our worlds hold {result.mean_bvs:.1f} BVs on average, highway-env's {result.n_bvs}; both the AV too. {where}"
    )
    notes = DIFFERENCES.format(road=result.traffic_length, steps=result.steps_per_test)
    return f"{counts}\n\n{rates}\n\n{ratios}\n\n{notes}"
