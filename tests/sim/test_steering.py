"""Words that are held to a part: uniform in it, untouched elsewhere, and counted as chances are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from statistical_bounds import dkw_bound

from cornerforge._philox import PURPOSE_DECIDE, blocks, uniform
from cornerforge.ndd.memory import Memory, away_draw, memory_numbers, remembered_share, remembering_word
from cornerforge.sim.steering import (
    ACCELERATION,
    ALL_WORDS,
    AWAY,
    HIGH,
    LANE,
    allocate_steering,
    hold_to,
    let_go,
    places_up_to,
    steer,
    word_at_place,
    words_below,
)
from cornerforge.sim.world import allocate_worlds

SLOTS = 8
STILL = allocate_worlds(1, SLOTS).vehicles[0]
NO_MEMORY = memory_numbers(Memory())
MEMORIES = [
    Memory(),
    Memory(near=0.12, near_width=0.09, far=0.35, far_width=0.32),
    Memory(near=0.2, near_width=0.5, far=0.3, far_width=0.2, habit=0.3, habit_width=0.1),
    Memory(habit=1.0, habit_width=0.3),
]
PASTS = [(0.5, 0.5), (0.999, 0.01), (0.0, 1.0), (0.93, 0.97)]
"""Quantile of the second before; habit."""


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
    steer(words, steering, SLOTS, STILL, NO_MEMORY)
    assert np.array_equal(words, natural(0))


@given(st.integers(0, 10_000), st.integers(1, SLOTS - 1), st.sampled_from([LANE, AWAY]), st.data())
def test_a_held_word_lies_within_and_others_stay(test: int, slot: int, what: int, data: st.DataObject) -> None:
    first = data.draw(st.integers(0, ALL_WORDS - 1))
    count = data.draw(st.integers(1, ALL_WORDS - first))
    words, steering = natural(test), allocate_steering(SLOTS)
    hold_to(steering, slot, what, first, count)
    steer(words, steering, SLOTS, STILL, NO_MEMORY)
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
        steer(words, steering, 2, STILL, NO_MEMORY)
        drawn[:, test] = uniform(words[0, 1]), away_draw(words[2, 1], words[3, 1])
    for values, first, count in zip(drawn, (1000, 7), (3_000_000_000, 50_000), strict=True):
        law = stats.uniform(first / ALL_WORDS, count / ALL_WORDS)
        assert stats.kstest(values, law.cdf).statistic < dkw_bound(n, 2)


def quantile(word: int, past: tuple[float, float], memory: Memory) -> float:
    return float(uniform(remembering_word(np.uint64(word), *past, memory_numbers(memory))))


@pytest.mark.parametrize("memory", MEMORIES)
@pytest.mark.parametrize("past", PASTS)
def test_the_first_places_are_the_words_of_high_quantiles(memory: Memory, past: tuple[float, float]) -> None:
    numbers = memory_numbers(memory)
    very, high, every = (places_up_to(ring, *past, numbers) for ring in range(3))
    assert every == ALL_WORDS
    edges = {0, very - 1, very, high - 1, high, ALL_WORDS - 1}
    places = np.array(sorted({*np.linspace(0, ALL_WORDS - 1, 1000).astype(int), *edges} - {-1}))
    words = [word_at_place(place, *past, numbers) for place in places.tolist()]
    assert len(set(words)) == len(words)
    found = np.array([quantile(word, past, memory) for word in words])
    for count, least in zip((very, high), HIGH, strict=True):
        assert (found[places < count] > least - 2.0**-30).all()
        assert (found[places >= count] < least + 2.0**-30).all()
        assert count / ALL_WORDS == pytest.approx(1.0 - remembered_share(least, *past, numbers), abs=1e-8)


@pytest.mark.parametrize("memory", MEMORIES)
@pytest.mark.parametrize("past", PASTS)
def test_held_to_parts_as_often_as_they_happen_quantiles_are_natural(memory: Memory, past: tuple[float, float]) -> None:
    n, numbers, steering, v = 4000, memory_numbers(memory), allocate_steering(2), allocate_worlds(1, 2).vehicles[0]
    v["quantile"][1], v["habit"][1] = past
    ends = [0, *(places_up_to(ring, *past, numbers) for ring in range(3))]
    draws, found = np.random.default_rng(3).integers(0, ALL_WORDS, n), np.empty(n)
    for test, draw in enumerate(draws.tolist()):
        words = np.zeros((4, 2), dtype=np.uint64)
        blocks(words, 5, test, 0, 2, PURPOSE_DECIDE)
        before = words.copy()
        ring = next(k for k in range(3) if draw < ends[k + 1])
        hold_to(steering, 1, ACCELERATION, ends[ring], ends[ring + 1] - ends[ring])
        steer(words, steering, 2, v, numbers)
        found[test] = quantile(int(words[1, 1]), past, memory)
        assert np.array_equal(np.delete(words, 1, axis=0), np.delete(before, 1, axis=0))
    law = np.frompyfunc(lambda u: remembered_share(u, *past, numbers), 1, 1)
    assert stats.kstest(found, lambda u: law(u).astype(float)).statistic < dkw_bound(n, len(MEMORIES) * len(PASTS))
