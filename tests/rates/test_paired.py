"""Comparing two AVs by the same tests: what the interval covers, and how often the sequential test errs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from cornerforge.errors import InputError
from cornerforge.rates.paired import ALPHA, BETA, RATIO, Verdict, difference_interval, sequential_verdict

REPEATS = 2_000


@pytest.mark.parametrize(("p", "tests"), [(0.01, 500), (0.05, 100), (0.2, 1000)])
def test_the_interval_covers_the_difference(p: float, tests: int) -> None:
    rng = np.random.default_rng(20_261_125)
    counts = rng.multinomial(tests, [p, 0.5 * p, 1.0 - 1.5 * p], size=REPEATS)
    inside = 0
    for new_only, old_only, _ in counts.tolist():
        low, high = difference_interval(new_only, old_only, tests)
        inside += low <= 0.5 * p <= high
    assert stats.binomtest(inside, REPEATS, 0.94, alternative="less").pvalue > 1e-4


def repeated(chance_of_new: float, n: int = 400) -> list[str]:
    """Verdicts where each discordant test falls on the new AV with a chance."""
    rng = np.random.default_rng(20_261_126)
    draws = rng.random((REPEATS, n)) < chance_of_new
    return [sequential_verdict(new, ~new).word for new in draws]


def test_equal_avs_are_seldom_told_apart() -> None:
    found = repeated(0.5)
    wrong = sum(word in ("worse", "better") for word in found)
    assert stats.binomtest(wrong, REPEATS, ALPHA, alternative="greater").pvalue > 1e-4
    assert found.count("alike") > 0.9 * REPEATS


def test_avs_that_differ_are_told_apart() -> None:
    for chance, word in ((RATIO / (1.0 + RATIO), "worse"), (1.0 / (1.0 + RATIO), "better")):
        found = repeated(chance)
        assert stats.binomtest(found.count("alike"), REPEATS, BETA, alternative="greater").pvalue > 1e-4
        assert found.count(word) > (1.0 - 1.2 * BETA) * REPEATS


def test_tests_that_end_alike_for_both_say_nothing() -> None:
    both = np.ones(1000, np.bool_)
    assert sequential_verdict(both, both) == Verdict("open", 1000)
    new = np.zeros(100, np.bool_)
    new[10:40] = True
    assert sequential_verdict(new, np.zeros(100, np.bool_)) == Verdict("worse", 23)


def test_bad_counts_are_named() -> None:
    with pytest.raises(InputError, match="old_only"):
        difference_interval(3, 8, 10)
