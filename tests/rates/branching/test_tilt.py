"""Tests drawn from proposals: no mean depends on the network or the proposals, and no weight is too large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge.experiment.av_file import av_of
from cornerforge.ndd.model import NddModel
from cornerforge.rates.branching.danger import N_SEEN, WIDTH, Network
from cornerforge.rates.branching.drive import DrivenTrees, drive_trees
from cornerforge.rates.branching.population import Plan, Tilt, tree_of
from cornerforge.sim import Script, ScriptDriver, Setting, simulate
from cornerforge.sim.world import n_slots

pytestmark = pytest.mark.full

ODD = WIDE
SLOTS = n_slots(ODD)
SIGMAS = 5.0
"""A right sampler is further off with a chance of 6e-7."""
SHARES, POWERS = np.array([0.2, 0.5, 0.3]), np.array([0.0, 1.0, 1.6])


@pytest.fixture(scope="module")
def careless(reckless: NddModel) -> NddModel:
    """Drivers that change lanes often, overlook what is beside them and often look away: the AV often crashes."""
    return replace(reckless, memory=replace(reckless.memory, away=0.05, away_again=0.5))


def any_network(seed: int) -> Network:
    """A network that was taught nothing: it finds some things dangerous, by chance."""
    rng = np.random.default_rng(seed)
    shapes = (N_SEEN, WIDTH), (WIDTH,), (WIDTH, WIDTH), (WIDTH,), (WIDTH + 1,)
    weights = [rng.normal(0.0, 0.5, shape).astype(np.float32) for shape in shapes]
    weights[-1][-1] = -6.0
    return Network(*weights)


def plan_of(network: Network, candidates: int = 3) -> Plan:
    return Plan(0.05, 0.01, 0.1, 0.0, 1, 10.0, 2.0, network, Tilt(SHARES, POWERS, candidates))


def setting(model: NddModel, av: str = "idm-mobil") -> Setting:
    return setting_of(model, ODD, av=av_of(av))


def driven(run: Setting, plan: Plan, tests: int, *, first: int = 0, threads: int = 2) -> DrivenTrees:
    return drive_trees(run, SLOTS, plan, seed=4, first=first, tests=tests, threads=threads)


def off(weights: np.ndarray, mean: float, error: float = 0.0) -> float:
    """How far a mean is off, in standard errors."""
    return float(abs(weights.mean() - mean) / np.hypot(weights.std(ddof=1) / np.sqrt(weights.size), error))


@pytest.mark.parametrize("av", ["idm-mobil", "idm-mobil-blind"])
def test_no_network_and_no_proposal_changes_a_rate(careless: NddModel, av: str) -> None:
    run = setting(careless, av)
    plain = simulate(run, SLOTS, seed=9, tests=30_000, threads=2)
    rate = plain.av_crashes / plain.tests
    error = np.sqrt(rate * (1.0 - rate) / plain.tests)
    for network, candidates in ((any_network(2), 1), (any_network(1), 3)):
        trees = driven(run, plan_of(network, candidates), 20_000).trees
        assert (trees["lost"] == 0).all()
        assert off(trees["weight"], rate, error) < SIGMAS
        assert off(trees["ended"], 1.0) < SIGMAS
        assert trees["ended"].max() <= 1.0 / SHARES[0] * (1.0 + 1e-9), "nature is one of the proposals"
    assert trees["ended"].std() > 0.3, "this network must tilt something, or the test shows nothing"
    spread = trees["ended"].std() / np.sqrt(trees.size)
    assert SIGMAS * spread < 0.05, "weights 5 % wrong would not be seen"

    # Without the weights the same tests crash far more, or less, often.
    crashed = trees["crashes"].astype(np.float64)
    assert off(crashed, rate, error) > SIGMAS


def test_one_proposal_that_is_nature_weighs_nothing(careless: NddModel) -> None:
    plan = plan_of(any_network(1))._replace(tilt=Tilt(np.array([1.0]), np.array([0.0]), 3))
    trees = driven(setting(careless), plan, 200).trees
    assert trees["ended"] == pytest.approx(np.ones(200))


def test_a_test_does_not_depend_on_threads_or_range(careless: NddModel) -> None:
    run, plan = setting(careless), plan_of(any_network(1))
    whole, alone = driven(run, plan, 900), driven(run, plan, 900, threads=1)
    later = driven(run, plan, 100, first=333)
    for name in whole.trees.dtype.names or ():
        assert np.array_equal(whole.trees[name], alone.trees[name])
        assert np.array_equal(whole.trees[name][333:433], later.trees[name])
    assert np.array_equal(whole.crashes, alone.crashes)


def test_a_crash_comes_again_from_its_start_and_actions(careless: NddModel) -> None:
    run, plan = setting(careless), plan_of(any_network(1))
    found = driven(run, plan, 2_000)
    driver = ScriptDriver(run, ODD)
    assert found.crashes.size > 30
    moved = 0
    for crash, actions in zip(found.crashes, found.actions, strict=True):
        test = int(crash["test"])
        assert found.trees["weight"][tree_of(test, plan)] == crash["weight"]
        moved += test % plan.tilt.candidates > 0
        start = driver.start_of_test(4, test)
        script = Script(np.arange(start.size, dtype=np.int16), start, actions[: crash["begun"], : start.size])
        ending = driver.drive(script)
        assert (ending.partner, ending.frame) == (crash["partner"], round(crash["time"] / 0.1))
    assert moved > 0.3 * found.crashes.size
