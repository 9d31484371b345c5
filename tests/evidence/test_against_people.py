"""Rates against people's, held against what others published from their counts and miles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from cornerforge.errors import InputError
from cornerforge.ext.evidence.against_people import (
    DIFFERENCES,
    TRUE_RATIOS,
    compare,
    compare_kind,
    compare_weighted,
    effective_count,
    miles_needed,
)  # fmt: skip
from cornerforge.ext.evidence.benchmarks import benchmarks
from cornerforge.intervals import poisson_interval, weighted_interval
from cornerforge.rates.natural import natural_shares
from cornerforge.types import METRES_PER_MILE, Odd

ROWS = {row.id: row for row in benchmarks()}
DEATHS = 1.09e-2
"""Kalra and Paddock (2016): 1.09 deaths per 100 million miles, here per million."""


def test_ratio_of_two_counts_is_that_of_teoh_et_al() -> None:
    """64 crashes in 49.957 million miles against 901,525 in 221,992 million: 0.32 (0.25 to 0.40), IIHS 2026."""
    found = compare(ROWS["teoh2026-police"], 64, 49.957)
    assert round(found.ratio, 2) == 0.32
    assert (found.low, found.high) == pytest.approx((0.25, 0.40), abs=0.0075), "theirs is log-normal, ours exact"
    assert not found.exact
    assert found.verdict == "lower"


@pytest.mark.parametrize(
    ("row", "reduction", "ends"), [("kusano2025-injury", 0.79, (0.71, 0.85)), ("kusano2025-airbag", 0.81, (0.69, 0.90))]
)
def test_reductions_are_those_of_kusano_et_al(row: str, reduction: float, ends: tuple[float, float]) -> None:
    """56.7 million miles; the count is the one that gives the reduction; tails of 1.25 % as in their code of 2024."""
    people = ROWS[row]
    found = compare(people, round((1.0 - reduction) * people.rate * 56.7), 56.7, confidence=0.975)
    assert 1.0 - found.ratio == pytest.approx(reduction, abs=0.005)
    assert (1.0 - found.high, 1.0 - found.low) == pytest.approx(ends, abs=0.005)
    assert found.exact


def test_miles_without_a_crash_are_those_of_kalra_and_paddock() -> None:
    miles, most = miles_needed(DEATHS)
    assert round(miles) == 275
    assert most == 0
    assert miles == pytest.approx(3.0 / DEATHS, rel=2e-3), "rule of three"


def test_miles_for_a_fifth_fewer_are_near_those_of_kalra_and_paddock() -> None:
    """11 billion miles with 80 % power, by a normal approximation with the variance of the better AV."""
    z = stats.norm.ppf(0.95) + stats.norm.ppf(0.8)
    theirs = 0.8 * z**2 / 0.2**2 / DEATHS
    assert round(theirs / 1000) == 11
    ours, _ = miles_needed(DEATHS, 0.8)
    assert theirs < ours < 1.2 * theirs, "the exact test is of people's rate, whose variance is larger"


@pytest.mark.parametrize("ratio", [0.0, *TRUE_RATIOS, 0.95])
@pytest.mark.parametrize("power", [0.5, 0.8, 0.9])
def test_fewer_miles_do_not_show_it(ratio: float, power: float) -> None:
    """Sums of the Poisson law: right at these miles, and for no count at 1 % fewer."""
    miles, most = miles_needed(4.0, ratio, power=power)
    assert stats.poisson.cdf(most, 4.0 * miles) == pytest.approx(0.05)
    assert stats.poisson.cdf(most, ratio * 4.0 * miles) >= power
    fewer = 0.99 * 4.0 * miles
    counts = np.arange(most + 2)
    shown = stats.poisson.cdf(counts, fewer) <= 0.05
    assert not (shown & (stats.poisson.cdf(counts, ratio * fewer) >= power)).any()


def test_a_ratio_too_near_1_is_refused() -> None:
    for ratio in (1.0, 0.999):
        with pytest.raises(InputError, match="ratio"):
            miles_needed(1.0, ratio)
    with pytest.raises(InputError, match="rate"):
        miles_needed(0.0)


def test_what_is_published_with_an_interval_makes_ours_wider() -> None:
    people = ROWS["kusano2024-police"]
    exact = compare(people, 10, 5.0)
    assert (exact.low * people.rate * 5.0, exact.high * people.rate * 5.0) == pytest.approx(poisson_interval(10))
    rough = compare(replace(people, low=2.0, high=9.0), 10, 5.0)
    assert rough.low < exact.low
    assert rough.high > 1.2 * exact.high
    sure = compare(replace(people, count=10**7, miles=1e7 / people.rate), 10, 5.0)
    assert (sure.low, sure.high) == pytest.approx((exact.low, exact.high), rel=2e-3)
    assert compare(people, 0, 5.0).low == 0.0
    assert (compare(people, 0, 0.5).verdict, compare(people, 99, 5.0).verdict) == ("not known", "higher")


def test_units_are_not_mixed() -> None:
    with pytest.raises(InputError, match="counts crashes, the AV's rate crashed vehicles"):
        compare(ROWS["nhtsa2023-police"], 3, 1.0)
    assert compare(ROWS["autobahn2017-serious"], 3, 1.0).ratio == pytest.approx(3.0 / 0.04169, rel=1e-4)
    with pytest.raises(InputError, match="counts claims"):
        compare(ROWS["swissre2023-injury"], 3, 1.0)
    with pytest.raises(InputError, match="count"):
        compare(ROWS["teoh2026-police"], -1, 1.0)


@pytest.mark.parametrize("count", [1, 7, 300, 10**6])
def test_an_interval_says_how_many_events_made_it(count: int) -> None:
    assert effective_count(2.5 * count, 2.5 * poisson_interval(count)[0]) == pytest.approx(count, rel=1e-3)
    weights = np.random.default_rng(count).exponential(size=min(count, 300)) + 1e-3
    low = weighted_interval(weights, float(weights.max()))[0]
    assert effective_count(float(weights.sum()), low) == pytest.approx(
        weights.sum() ** 2 / (weights**2).sum(), rel=1e-6
    )


def test_a_weighted_rate_counts_as_its_effective_events() -> None:
    people = ROWS["kusano2024-police"]
    counted = compare(people, 40, 20.0)
    weighted = compare_weighted(people, 2.0, poisson_interval(40)[0] / 20.0 * (1 + 1e-12))
    assert (weighted.ratio, weighted.low, weighted.high) == pytest.approx((counted.ratio, counted.low, counted.high))
    with pytest.raises(InputError, match="less than one event"):
        compare_weighted(people, 1.0, 1e-6)
    for low in (0.0, 1.0, math.nan):
        with pytest.raises(InputError, match="0 < end < rate"):
            compare_weighted(people, 1.0, low)


def test_serious_injuries_are_weighed_by_their_chance() -> None:
    """1,000 crashes of equal weight, each with a chance of 1 % or 2 %: 15 injuries in expectation."""
    odd, n = Odd(), 1000
    chance = np.where(np.arange(n) % 2 == 0, 0.01, 0.02)
    yes, kind = np.ones(n, np.bool_), ["x"] * n
    found = natural_shares(
        np.full(n, 1e-8), odd,
        kinds=dict.fromkeys(("clusters", "crash_types", "mechanisms", "fault", "conducts"), kind),
        prevented={}, avoidable=yes, avoidable_after_s=0.0, looked_at=yes, injury=chance,
    )  # fmt: skip
    against = compare_kind(ROWS["kusano2025-serious"], found.serious_injuries)
    miles = odd.test_length / METRES_PER_MILE
    assert against.rate == pytest.approx(1e6 * 15e-8 / miles, rel=1e-3)
    assert against.ratio == pytest.approx(against.rate / 0.24)
    assert against.low < against.ratio < against.high
    touches = compare_kind(ROWS["kusano2024-any"], found.all)
    assert touches.rate == pytest.approx(against.rate * n / 15, rel=1e-3)


def test_the_page_is_told_what_differs() -> None:
    for word in ("every touch", "four in ten", "one direction", "MAIS 3", "this AV's miles"):
        assert word in DIFFERENCES
