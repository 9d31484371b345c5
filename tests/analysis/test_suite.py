"""The choice of a suite: against an exhaustive search, and what AVs left out get of it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.ext.studies.suite_choice import (
    apfd,
    cases_needed,
    choose,
    clear_order,
    findings,
    leave_one_out,
    rank_agreement,
)  # fmt: skip

Crashes = NDArray[np.bool_]


def drawn(seed: int, cases: int = 60, avs: int = 6) -> tuple[Crashes, NDArray[np.float64]]:
    """AVs of different strength in cases of different difficulty."""
    rng = np.random.default_rng(seed)
    chance = 1.0 / (1.0 + np.exp(rng.normal(0, 1.5, (cases, 1)) - np.linspace(-2.0, 2.0, avs)))
    return rng.random((cases, avs)) < chance, rng.uniform(0, 10, cases)


@pytest.mark.parametrize("seed", range(8))
def test_a_suite_finds_and_ranks_like_all_cases(seed: int) -> None:
    crashes, severity = drawn(seed)
    chosen = choose(crashes, severity, 60)
    assert len(set(chosen.cases)) == len(chosen.cases) < 60
    found = findings(crashes[list(chosen.cases)]).any(axis=0)
    assert (found == findings(crashes).any(axis=0)).all()
    assert chosen.found == chosen.wanted == found.sum()
    assert chosen.agreement == rank_agreement(crashes, chosen.cases)
    assert chosen.agreement is not None
    assert chosen.agreement > 0.6, "near ties may stand the other way round"
    clear = clear_order(crashes)
    assert chosen.in_order == chosen.clear == (clear > 0).sum() > 5
    total = crashes[list(chosen.cases)].sum(axis=0)
    assert all(total[i] > total[j] for i, j in np.argwhere(clear > 0))


@pytest.mark.parametrize("seed", range(4))
def test_the_cover_is_nearly_the_smallest(seed: int) -> None:
    """Greedy set cover needs at most H(d) times the fewest cases, with d findings of a case; here at most one more."""
    crashes, severity = drawn(seed, cases=14, avs=4)
    finds = findings(crashes)
    wanted = finds.any(axis=0)

    def covers(rows: tuple[int, ...]) -> bool:
        return bool((finds[list(rows)].any(axis=0) == wanted).all())

    fewest = next(n for n in range(1, 15) if any(covers(rows) for rows in itertools.combinations(range(14), n)))
    chosen = choose(crashes, severity, 14).cases
    needed = next(n for n in range(1, len(chosen) + 1) if covers(chosen[:n]))
    assert fewest <= needed <= fewest + 1


def test_equal_cases_are_taken_by_severity_and_no_more_than_asked() -> None:
    crashes = np.array([[True, False]] * 3 + [[False, True]] * 3)
    chosen = choose(crashes, np.array([1.0, 3.0, 2.0, 2.0, 1.0, 3.0]), 6)
    assert sorted(chosen.cases) == [1, 5], "two cases show all that six show"
    assert len(choose(drawn(0)[0], drawn(0)[1], 3).cases) <= 3


def test_a_set_that_shows_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="No AV crashes"):
        choose(np.zeros((3, 2), np.bool_), np.zeros(3), 2)
    with pytest.raises(InputError, match="size = 0"):
        choose(np.ones((3, 2), np.bool_), np.zeros(3), 0)


def test_an_av_left_out_is_not_seen_by_the_choice() -> None:
    crashes, severity = drawn(5, avs=5)
    crashes[:, 4] = False
    crashes[7, 4] = True  # a rare crash, which nothing but chance can find
    checked = {one.av: one for one in leave_one_out(crashes, severity, 20, random_sets=300)}
    assert set(checked) == set(range(5))
    rare = checked[4]
    without = choose(crashes[:, :4], severity, 20)
    assert rare.cases == len(without.cases)
    assert bool(rare.known[0]) == (7 in without.cases)
    # a random set of n of 60 holds one given case with probability n / 60
    expected = rare.cases / 60
    assert abs(rare.random[:, 0].mean() - expected) < 4 * np.sqrt(expected * (1 - expected) / 300)
    assert rare.share_of_all == pytest.approx(1 / 60)
    common = checked[3]
    assert common.known[0] == 1.0
    assert common.known[2] == pytest.approx(
        crashes[list(choose(np.delete(crashes, 3, 1), severity, 20).cases), 3].mean()
    )


def test_on_average_it_knows_an_av_left_out_better_than_random_sets() -> None:
    ours, theirs = [], []
    for seed in range(6):
        for one in leave_one_out(*drawn(seed, cases=200, avs=8), 200, random_sets=50):
            most = np.array([max(1, one.pairs), max(1, one.clear)])
            ours.append(one.known[[1, 4]] / most)
            theirs.append(one.random[:, [1, 4]].mean(axis=0) / most)
    assert (np.mean(ours, axis=0) > np.mean(theirs, axis=0)).all()


FAULTS = {"A": (1, 5), "B": (1, 5, 6, 7), "C": (1, 2, 3, 4, 5, 6, 7), "D": (5,), "E": (8, 9, 10)}
"""The example of Rothermel et al. (2001): which of ten faults each of five cases finds."""


@pytest.mark.parametrize(("order", "published"), [("ABCDE", 0.50), ("EDCBA", 0.64), ("CEBAD", 0.84)])
def test_apfd_is_that_of_the_published_example(order: str, published: float) -> None:
    shows = np.array([[fault in FAULTS[case] for fault in range(1, 11)] for case in order])
    assert apfd(shows) == pytest.approx(published)
    assert apfd(np.column_stack([shows, np.zeros(5, np.bool_)])) == apfd(shows), "what no case shows does not count"
    assert cases_needed(shows) == {"ABCDE": 5, "EDCBA": 3, "CEBAD": 2}[order]


def test_apfd_of_the_textbook() -> None:
    """Five faults of five cases, first shown by cases 3, 2, 1, 3 and 1: 1 - 10/25 + 1/10 = 0.7."""
    first = np.array([3, 2, 1, 3, 1])
    shows = np.arange(1, 6)[:, None] >= first
    assert apfd(shows) == pytest.approx(0.7)
    assert apfd(np.zeros((5, 2), np.bool_)) is None
    assert cases_needed(np.zeros((5, 2), np.bool_)) == 0


def test_random_orders_show_half_of_what_one_case_shows() -> None:
    """A fault that one case of n shows is at each place alike: mean 1/2, standard deviation sqrt((n^2 - 1)/12)/n."""
    crashes, severity = drawn(3, cases=40, avs=4)
    crashes[:, 3] = False
    crashes[choose(crashes[:, :3], severity, 40).cases[0], 3] = True
    found = {one.av: one for one in leave_one_out(crashes, severity, 40, random_sets=400)}[3]
    n = found.cases
    assert found.early is not None
    assert abs(found.random_early.mean() - 0.5) < 5 * np.sqrt((n * n - 1) / 12) / n / 20
    assert set(np.round(found.random_early * n - 0.5, 9)) <= set(range(n))
