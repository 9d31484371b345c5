"""How far drivers differ is found again where it is known, and no difference is found where there is none."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from scipy.stats import t as student

from cornerforge._philox import uniform
from cornerforge.ext.calibrate import traits
from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.laws import LogLaw
from cornerforge.ext.calibrate.prior import MEMORY
from cornerforge.ext.calibrate.traits import APART, FEWEST_DRIVERS, SHORTEST, fit_noise_spread
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.memory import memory_numbers, own_word, remembering_word

LAW = LogLaw()


def drive(drivers: int, seconds: int, spread: float, seed: int, *, too_narrow: float = 1.0) -> Decisions:
    """Drivers who remember, as the kernels have them, in states that change slowly.

    Args:
        drivers, seconds: How many, and for how long each.
        spread: Of their noise levels.
        seed: Of the random numbers.
        too_narrow: Below 14 m/s they scatter so many times as much as the law says.
    """
    rng = np.random.default_rng(seed)
    memory = memory_numbers(MEMORY)
    n = drivers * seconds
    noise = np.tanh(0.5 * spread * rng.standard_normal(drivers))
    quantiles = np.empty(n)
    words = rng.integers(0, 2**32, size=n, dtype=np.uint64)
    rank = 0.5
    for k in range(n):
        before = rng.random() if k % seconds == 0 else rank
        word = remembering_word(words[k], before, 0.5, memory)
        rank = float(uniform(word))
        quantiles[k] = uniform(own_word(word, noise[k // seconds]))
    speed = np.repeat(rng.uniform(8.0, 20.0, drivers), seconds) + rng.normal(0.0, 1.0, n)
    gap = np.repeat(rng.uniform(10.0, 40.0, drivers), seconds)
    rate = rng.normal(0.0, 1.0, n)
    scale = LAW.scale(speed, gap, rate) * np.where(speed < 14.0, too_narrow, 1.0)
    acceleration = LAW.mean(speed, gap, rate) + scale * student.ppf(quantiles, LAW.degrees)
    return Decisions(speed, gap, rate, acceleration, np.repeat(np.arange(drivers), seconds), np.zeros(n, dtype=bool))


@pytest.mark.parametrize("spread", [0.25, 0.5])
def test_a_known_spread_is_found_again(spread: float) -> None:
    # Unit: a driver; 400 drivers of 80 s. The interval holds the truth, and does not hold a spread half as large.
    found = fit_noise_spread(drive(400, 80, spread, seed=3), LAW)
    assert found.fitted
    assert found.drivers == 400
    low, high = found.interval95
    assert low < found.spread < high
    assert low <= spread <= high
    assert high - low < 0.2
    assert not low <= 0.5 * spread <= high  # negative control


def test_drivers_who_are_alike_do_not_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory makes what one driver does alike for seconds, a law that is too narrow for the slow for a whole track."""
    # The products of decisions of drivers who are alike have the mean 0: about half of all estimates are exactly 0.
    alike = [fit_noise_spread(drive(100, 60, 0.0, 10 + k), LAW) for k in range(10)]
    assert sum(found.interval95[0] == 0.0 for found in alike) >= 9
    assert sum(found.spread == 0.0 for found in alike) >= 2
    slow = drive(400, 80, 0.0, 5, too_narrow=1.5)
    found = fit_noise_spread(slow, LAW)
    monkeypatch.setattr(traits, "_MOST_PARTS", 1)  # negative control: speeds are not told apart
    mistaken = fit_noise_spread(slow, LAW)
    assert found.spread < 0.5 * mistaken.interval95[0]


def test_too_few_drivers_leave_the_prior() -> None:
    for drivers, seconds in ((FEWEST_DRIVERS - 1, SHORTEST), (3 * FEWEST_DRIVERS, SHORTEST - 1)):
        found = fit_noise_spread(drive(drivers, seconds, 0.5, 1), LAW)
        assert not found.fitted
        assert found.spread == InitialState().noise_spread
        assert found.drivers == (drivers if seconds >= SHORTEST else 0)
    assert fit_noise_spread(drive(FEWEST_DRIVERS, SHORTEST, 0.5, 1), LAW).fitted
    nobody = drive(1, APART, 0.0, 1)
    assert not fit_noise_spread(nobody.where(nobody.speed < 0.0), LAW).fitted


def test_the_order_of_drivers_does_not_matter() -> None:
    decisions = drive(60, 40, 0.5, 2)
    halves = [decisions.where(part) for part in (decisions.vehicle >= 30, decisions.vehicle < 30)]
    turned = Decisions(
        **{f.name: np.concatenate([getattr(half, f.name) for half in halves]) for f in fields(Decisions)}
    )
    found, other = fit_noise_spread(decisions, LAW), fit_noise_spread(turned, LAW)
    assert found == other
