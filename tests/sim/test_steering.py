"""Words that are held to a part: uniform in it, untouched elsewhere, and counted as chances are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from statistical_bounds import dkw_bound

from cornerforge._philox import PURPOSE_DECIDE, blocks, uniform
from cornerforge.ndd.memory import away_draw
from cornerforge.sim.steering import ALL_WORDS, AWAY, LANE, allocate_steering, hold_to, let_go, steer, words_below

SLOTS = 8


def natural(test: int) -> np.ndarray:
    words = np.zeros((4, SLOTS), dtype=np.uint64)
    blocks(words, 3, test, 0, SLOTS, PURPOSE_DECIDE)
    return words


@given(st.floats(0.0, 1.0))
def test_words_below_a_chance_are_those_that_a_draw_takes(chance: float) -> None:
    count = words_below(chance)
    assert 0 <= count <= ALL_WORDS
    assert count == 0 or uniform(np.uint64(count - 1)) < chance
    assert count == ALL_WORDS or uniform(np.uint64(count)) >= chance


@pytest.mark.parametrize(
    ("chance", "count"), [(-0.1, 0), (0.0, 0), (1e-12, 0), (2.0**-32, 1), (1.0, ALL_WORDS), (1.5, ALL_WORDS)]
)
def test_words_below_at_the_ends(chance: float, count: int) -> None:
    assert words_below(chance) == count


def test_words_that_nobody_holds_stay() -> None:
    words, steering = natural(0), allocate_steering(SLOTS)
    hold_to(steering, 3, LANE, 17, 5)
    hold_to(steering, 4, AWAY, 0, 1)
    assert steering.on[0] == 1
    let_go(steering, SLOTS)
    assert steering.on[0] == 0
    steer(words, steering, SLOTS)
    assert np.array_equal(words, natural(0))


@given(st.integers(0, 10_000), st.integers(1, SLOTS - 1), st.sampled_from([LANE, AWAY]), st.data())
def test_a_held_word_lies_within_and_others_stay(test: int, slot: int, what: int, data: st.DataObject) -> None:
    first = data.draw(st.integers(0, ALL_WORDS - 1))
    count = data.draw(st.integers(1, ALL_WORDS - first))
    words, steering = natural(test), allocate_steering(SLOTS)
    hold_to(steering, slot, what, first, count)
    steer(words, steering, SLOTS)
    before = natural(test)
    low, high = uniform(np.uint64(first)), uniform(np.uint64(first + count - 1))
    if what == LANE:
        assert low <= uniform(words[0, slot]) <= high
        before[0, slot] = words[0, slot]
    else:
        assert low <= away_draw(words[2, slot], words[3, slot]) <= high
        for row in (2, 3):  # the high halves serve something else
            assert words[row, slot] >> np.uint64(16) == before[row, slot] >> np.uint64(16)
            before[row, slot] = words[row, slot]
    assert np.array_equal(words, before)


def test_held_words_are_uniform_in_their_part() -> None:
    n, steering = 20_000, allocate_steering(2)
    hold_to(steering, 1, LANE, 1000, 3_000_000_000)
    hold_to(steering, 1, AWAY, 7, 50_000)
    drawn = np.zeros((2, n))
    for test in range(n):
        words = np.zeros((4, 2), dtype=np.uint64)
        blocks(words, 5, test, 0, 2, PURPOSE_DECIDE)
        steer(words, steering, 2)
        drawn[:, test] = uniform(words[0, 1]), away_draw(words[2, 1], words[3, 1])
    for values, first, count in zip(drawn, (1000, 7), (3_000_000_000, 50_000), strict=True):
        law = stats.uniform(first / ALL_WORDS, count / ALL_WORDS)
        assert stats.kstest(values, law.cdf).statistic < dkw_bound(n, 2)
