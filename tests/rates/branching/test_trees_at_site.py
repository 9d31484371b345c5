"""Trees at a site: steering of words, and no mean depends on what is looked at, nor on what the network says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import laws_named
from cornerforge.rates.branching import Plan, Tilt, danger, drive_trees
from cornerforge.results.stating import as_json
from cornerforge.sim import Script, outcome, steering
from cornerforge.sim.runner import simulate_chunks
from cornerforge.sim.steering import allocate_steering, hold_to, steer_at_site
from cornerforge.site.laws import ERRORS
from cornerforge.work.files import write_json
from cornerforge.world_options import WorldOptions

SEED, SIGMAS = 4, 5.0
"""A right sampler is further off with a chance of 6e-7."""


def test_held_words_give_what_they_are_held_to() -> None:
    words = np.random.Generator(np.random.Philox(3)).integers(0, 2**32, (4, 50), dtype=np.uint64)
    before, held = words.copy(), allocate_steering(50)
    hold_to(held, 7, steering.LANE, 0, 1000)
    hold_to(held, 9, steering.AWAY, 1000, steering.ALL_WORDS - 1000)
    steer_at_site(words, held, 50)
    assert words[1, 7] < 1000
    assert words[2, 9] >= 1000
    words[1, 7], words[2, 9] = before[1, 7], before[2, 9]
    np.testing.assert_array_equal(words, before)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Careless people, and an AV that sees late and not always: one test in thirty ends in its crash."""
    file: Path = tmp_path_factory.mktemp("laws") / "laws.json"
    errors: dict[str, Any] = dict.fromkeys(ERRORS, 0.04)
    write_json(file, as_json(replace(laws_named(None), **errors)))
    late = "latency=0.5,dropout=0.05"
    return experiment(WorldOptions(site="mcity-signal", av="idm-yield", site_laws=str(file), perception=late))


def wary(**given: Any) -> Plan:
    """Trees with a network that fears those that look away or have decided to go, and knows nothing else."""
    first, first_bias, second, second_bias, last = danger.untaught(1e-3)
    first[17, 0] = first[25, 0] = second[0, 0] = 1.0
    last[0] = 2.0
    network = danger.Network(first, first_bias, second, second_bias, last)
    return Plan(3e-3, 3e-3, 0.1, 0.005, 1, 30.0, 2.0, network)._replace(**given)


def outcomes(run: Experiment, first: int, tests: int) -> np.ndarray:
    """Which natural tests end in a crash of the AV."""
    chunks = simulate_chunks(run.setting, run.slots, seed=SEED, first=first, tests=tests, threads=2)
    return np.concatenate([out.code == outcome.AV_CRASH for _, out, _ in chunks])


def fits(weights: np.ndarray, mean: float, error: float) -> bool:
    return bool(abs(weights.mean() - mean) < SIGMAS * np.hypot(weights.std() / np.sqrt(weights.size), error))


@pytest.mark.full
def test_a_look_leaves_no_trace(run: Experiment) -> None:
    """Worlds that are surveyed each second, and never copied, end as those that are not."""
    plan = wary(least_rise=1e9, explore=0.0, windows=0)
    found = drive_trees(run.setting, run.slots, plan, seed=SEED, first=0, tests=1000, threads=2)
    crashed = outcomes(run, 0, 1000)
    assert crashed.sum() > 10
    assert (found.trees["ended"] == 1.0).all()
    np.testing.assert_array_equal(found.trees["crashes"], crashed)


@pytest.fixture(scope="module")
def counted(run: Experiment) -> np.ndarray:
    return outcomes(run, 100_000, 6000)


TILT = Tilt(np.array([0.2, 0.5, 0.3]), np.array([0.0, 1.0, 1.6]), 3)


@pytest.mark.full
@pytest.mark.parametrize(
    ("plan", "tests"), [(wary(), 2500), (wary()._replace(tilt=TILT), 8000)], ids=["copied", "drawn"]
)
def test_what_a_network_fears_changes_no_rate_at_a_site(
    run: Experiment, counted: np.ndarray, plan: Plan, tests: int
) -> None:
    """Also: each crash of a tree comes again from its actions."""
    rate, error = counted.mean(), counted.std() / np.sqrt(counted.size)
    found = drive_trees(run.setting, run.slots, plan, seed=SEED, first=0, tests=tests, threads=2)
    trees = found.trees
    assert trees["lost"].sum() == 0
    assert trees["ended"].std() > 0.2, "this network must change something, or the test shows nothing"
    assert fits(trees["ended"], 1.0, 0.0)
    assert fits(trees["weight"], rate, error)
    assert not fits(1.2 * trees["ended"], 1.0, 0.0), "weights a fifth wrong would not be seen"
    driver = run.script_driver()
    for crash, actions in list(zip(found.crashes, found.actions, strict=True))[:40]:
        start = driver.start_of_test(SEED, int(crash["test"]))
        own = actions[: crash["begun"], : start.size]
        script = Script(np.arange(start.size, dtype=np.int16), start, own, SEED, int(crash["test"]))
        ending = driver.drive(script)
        assert (ending.partner, ending.frame) == (crash["partner"], round(crash["time"] / 0.1))
