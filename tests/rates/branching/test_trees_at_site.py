"""Trees of tests at a site: their mean weight is the rate that counting finds, where danger is raised."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import demand_of, laws_named, odd_at, site_named
from cornerforge.rates.branching import drive_trees
from cornerforge.rates.teaching import blind_plan
from cornerforge.sim import simulate, steering
from cornerforge.sim.steering import allocate_steering, hold_to, steer_at_site
from cornerforge.types import Odd
from cornerforge.world_options import WorldOptions

pytestmark = pytest.mark.filterwarnings("ignore:Site")
_SIGMAS = 4.9
"""Two-sided false alarms of a normal variable: 1e-6."""


def careless() -> Experiment:
    """Drivers and people that err about a hundred times as often as they do."""
    laws = replace(laws_named(None), overlooks_person=0.03, overlooks_vehicle=0.03, runs_red=0.03, walks_blindly=0.03)
    odd = odd_at(Odd(), site_named("mcity-signal"), laws, demand_of("vehicles=150,people=40"))
    return experiment(WorldOptions(av="idm-yield"), road=odd)


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


@pytest.mark.slow
def test_trees_and_counting_agree_at_raised_danger(seed: int) -> None:
    run, counted, trees = careless(), 20_000, 600
    plain = simulate(run.setting, run.slots, seed=seed, tests=counted, threads=2)
    driven = drive_trees(run.setting, run.slots, blind_plan(), seed=seed + 1, first=0, tests=trees, threads=2).trees
    rate = plain.av_crashes / counted
    apart = driven["weight"].mean() - rate
    error = math.sqrt(rate * (1.0 - rate) / counted + driven["weight"].var(ddof=1) / trees)
    assert abs(apart) < _SIGMAS * error
    assert abs(driven["ended"].mean() - 1.0) < _SIGMAS * driven["ended"].std(ddof=1) / math.sqrt(trees)
    assert error < 0.4 * rate  # so a rate that is three times as large would be seen
