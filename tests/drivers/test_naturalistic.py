from __future__ import annotations

import itertools
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from statistical_bounds import distance_to_law, dkw_bound, l1_bound, l1_distance

from cornerforge._philox import block, uniform
from cornerforge.drivers.naturalistic import (
    NddTables,
    accept_chance,
    following_row,
    free_row,
    lane_change_base,
    sample_row,
    table_row,
    tables_of,
    turn_back_chance,
)
from cornerforge.ndd.memory import (
    Memory,
    MemoryNumbers,
    memory_numbers,
    own_rank,
    own_word,
    reflected,
    remembered_share,
    remembering_word,
)
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel
from cornerforge.types import ACCELERATIONS

LAST = np.uint64(2**32 - 1)
WORD = st.integers(0, 2**32 - 1).map(np.uint64)
N = 100_000


def probabilities(tables: NddTables, row: int) -> np.ndarray:
    """A row of the model, normalised."""
    p = tables.p[row].astype(np.float64)
    return np.asarray(p / p.sum())


@pytest.fixture(scope="module")
def words(request: pytest.FixtureRequest) -> np.ndarray:
    seed = int(request.config.getoption("--seed"))
    return np.array([block(seed, test, 3, 5, 1)[1] for test in range(N)], dtype=np.uint64)


# Look-ups


def test_rows_are_those_of_the_models_arrays(model: NddModel, tables: NddTables) -> None:
    for i, j, k in [(0, 0, 0), (20, 115, 18), (7, 33, 4), (0, 115, 0), (20, 0, 18)]:
        row = following_row(tables, SPEEDS[i], 33.0, GAPS[j], RANGE_RATES[k], 0.5)
        np.testing.assert_array_equal(tables.p[row], model.following[i, j, k])
        np.testing.assert_array_equal(tables.p[free_row(SPEEDS[i], SPEEDS[i])], model.free[i])  # it lacks nothing


def test_a_free_driver_is_pulled_to_its_desired_speed(model: NddModel, tables: NddTables) -> None:
    """Its mean is that of all drivers plus the pull, its spread about theirs, and impossible stays impossible."""
    for i in (2, 10, 16):
        p = model.free[i].astype(float)
        spread = np.sqrt(p @ (ACCELERATIONS - p @ ACCELERATIONS) ** 2)
        for lack in (-6.0, -4.0, -1.5, 0.5, 4.0):
            row = tables.p[free_row(SPEEDS[i], SPEEDS[i] + lack)].astype(float)
            mean = row @ ACCELERATIONS
            assert mean == pytest.approx(p @ ACCELERATIONS + model.free_pull * lack, abs=1e-5)
            if abs(lack) <= 4.0:  # four standard deviations of desired speeds; farther off, the end of the row is near
                assert np.sqrt(row @ (ACCELERATIONS - mean) ** 2) == pytest.approx(spread, rel=0.4)
            np.testing.assert_array_equal(row > 0.0, p > 0.0)
    nobody_wants = tables_of(replace(model, free_pull=0.0))
    for lack in (-6.0, 0.0, 6.0):
        np.testing.assert_array_equal(nobody_wants.p[free_row(30.0, 30.0 + lack)], model.free[10])


@pytest.mark.parametrize(
    ("speed", "index"), [(0.0, 0), (19.0, 0), (20.49, 0), (20.5, 1), (39.49, 19), (39.5, 20), (40.0, 20), (80.0, 20)]
)
def test_speeds_take_the_nearest_row(tables: NddTables, speed: float, index: int) -> None:
    assert free_row(speed, speed) == free_row(20.0, 20.0) + 25 * index
    assert free_row(speed, speed + 2.0) == free_row(speed, speed) + 4  # it lacks 2 m/s, in halves
    assert free_row(speed, speed - 99.0) == free_row(speed, speed) - 12
    assert (
        following_row(tables, speed, 32.0, 0.0, -10.0, 0.5) == index * 116 * 19
    )  # behind a lead the wish counts for nothing
    assert following_row(tables, speed, 32.0, math.inf, 0.0, 0.5) == free_row(speed, 32.0)
    assert free_row(20.0, 0.0) == 21 * 116 * 19 == tables.p.shape[0] - 21 * 25


@pytest.mark.parametrize(
    ("gap", "range_rate", "place"),
    [
        (0.0, -10.0, (0, 0)),
        (-7.0, 0.0, (0, 10)),  # overlap is looked up at no gap
        (0.49, 0.49, (0, 10)),
        (0.5, 0.5, (1, 11)),
        (115.0, 8.0, (115, 18)),
        (115.5, 50.0, (115, 18)),  # the last that is following; opening faster than the grid takes its end
        (115.50001, 0.0, (-1, -1)),
        (math.inf, 0.0, (-1, -1)),
        (20.0, -9.51, (20, 0)),
        (20.0, -9.5, (20, 1)),
    ],
)
def test_places_on_the_grid_and_at_its_edges(gap: float, range_rate: float, place: tuple[int, int]) -> None:
    assert table_row(gap, range_rate, 0.5) == place


@given(st.floats(4.01, 400.0), st.floats(10.01, 40.0))
def test_fast_closing_is_looked_up_at_equal_deceleration(gap: float, closing: float) -> None:
    # v^2 / (2 (gap - 4)): the braking that leaves 4 m
    equal = 4.0 + (gap - 4.0) * (10.0 / closing) ** 2
    assert closing**2 / (gap - 4.0) == pytest.approx(100.0 / (equal - 4.0))
    gap_row, rate_row = table_row(gap, -closing, 0.5)
    if equal > 115.5 + 1e-9:
        assert gap_row == -1
    elif equal <= 115.5 - 1e-9:
        assert rate_row == 0
        assert abs(gap_row - equal) <= 0.5 + 1e-9


def test_fast_closing_at_and_within_four_metres_keeps_its_gap() -> None:
    assert table_row(4.0, -30.0, 0.5) == (4, 0)
    assert table_row(2.0, -30.0, 0.5) == (2, 0)


@given(st.floats(0.0, 400.0), st.floats(10.0, 40.0), st.floats(0.0, 10.0))
def test_closing_faster_is_never_taken_for_a_milder_state(gap: float, closing: float, more: float) -> None:
    def braking_need(place: tuple[int, int]) -> float:
        return -math.inf if place[0] < 0 else -float(place[0])

    assert braking_need(table_row(gap, -closing - more, 0.5)) >= braking_need(table_row(gap, -closing, 0.5))


@given(st.integers(-1279, 1023).map(lambda k: k / 128.0), st.integers(1, 255).map(lambda k: k / 256.0))
def test_random_rounding_takes_one_of_the_two_columns_beside(range_rate: float, rounding: float) -> None:
    lower = math.floor(range_rate)
    expected = lower + 1 if rounding >= 1.0 - (range_rate - lower) else lower
    assert table_row(30.0, range_rate, rounding) == (30, expected + 10)


def test_random_rounding_interpolates_linearly(words: np.ndarray) -> None:
    # H0: the column above is taken with the chance of the fraction, 0.3; unit: a test's word; n = 100,000.
    taken = np.array([table_row(30.0, -2.7, uniform(word))[1] for word in words])
    assert set(taken.tolist()) == {7, 8}
    assert abs((taken == 8).mean() - 0.3) <= 5.0 * math.sqrt(0.3 * 0.7 / N)


# Sampling


def test_cuts_end_at_the_last_word_and_never_fall(tables: NddTables) -> None:
    assert (tables.cut[:, 30:] == 2**32 - 1).all()
    assert (np.diff(tables.cut.astype(np.int64), axis=1) >= 0).all()


def test_impossible_actions_have_no_width(tables: NddTables) -> None:
    widths = np.diff(tables.cut[:, :31].astype(np.float64), axis=1, prepend=0.0)
    impossible = tables.p == 0.0
    assert impossible.mean() > 0.1  # otherwise this test looks at nothing
    assert (widths[impossible] == 0).all()
    # and every action that matters has one: 2^-32 is lost by rounding down, once for either end
    p = tables.p.astype(np.float64)
    p /= p.sum(axis=1, keepdims=True)
    assert np.abs(widths / 2.0**32 - p).max() < 1e-9


@given(st.integers(0, 21 * 116 * 19 + 20))
def test_the_extreme_words_draw_the_first_and_last_possible_action(tables: NddTables, row: int) -> None:
    possible = np.flatnonzero(tables.p[row])
    first, last = sample_row(tables.cut, row, np.uint64(0)), sample_row(tables.cut, row, LAST)
    # the first word may miss a first action rarer than 2^-32
    assert first == possible[tables.cut[row, possible] > 0][0]
    assert tables.p[row, last] > 0.0
    assert tables.cut[row, last] == 2**32 - 1
    assert last <= 30


def test_an_impossible_last_action_is_not_drawn_by_the_last_word(tables: NddTables) -> None:
    rows = np.flatnonzero(tables.p[:, -1] == 0.0)
    assert rows.size > 0
    for row in rows[:: max(1, rows.size // 500)]:
        assert tables.p[row, sample_row(tables.cut, int(row), LAST)] > 0.0


@given(st.integers(0, 21 * 116 * 19 + 20), WORD)
def test_sampling_is_the_first_cut_above_the_word(tables: NddTables, row: int, word: np.uint64) -> None:
    expected = int(np.argmax(tables.cut[row] > min(int(word), 2**32 - 2)))
    assert sample_row(tables.cut, row, word) == expected
    assert tables.p[row, expected] > 0.0


@pytest.mark.parametrize(
    ("speed", "gap", "range_rate"), [(25.0, 15.0, -2.0), (30.0, 60.0, 0.0), (20.0, 3.0, -8.0), (35.0, math.inf, 0.0)]
)
def test_frequencies_match_the_row(
    tables: NddTables, words: np.ndarray, speed: float, gap: float, range_rate: float
) -> None:
    # H0: actions are independent draws of the row; unit: a test's word; n = 100,000 sees L1 errors of 0.026.
    row = following_row(tables, speed, 0.0, gap, range_rate, 0.5)
    drawn = [sample_row(tables.cut, row, word) for word in words]
    counts = np.bincount(drawn, minlength=31)
    bound = l1_bound(31, N, comparisons=4)
    p = probabilities(tables, row)
    assert l1_distance(counts, p) <= bound
    assert counts[p == 0.0].sum() == 0
    # negative control: a table that is one bin (0.2 m/s2) off is seen
    assert l1_distance(counts, np.roll(p, 1)) > bound


@given(WORD, st.floats(20.0, 40.0), st.floats(5.0, 100.0))
def test_one_word_never_accelerates_more_in_a_worse_row(
    tables: NddTables, word: np.uint64, speed: float, gap: float
) -> None:
    rows = [following_row(tables, speed, 0.0, gap, rate, 0.5) for rate in RANGE_RATES]
    for worse, better in itertools.pairwise(rows):
        # stochastically worse: the distribution function lies above everywhere
        if (tables.cut[worse] >= tables.cut[better]).all():
            assert sample_row(tables.cut, worse, word) <= sample_row(tables.cut, better, word)


def test_the_shipped_model_has_ordered_rows(tables: NddTables) -> None:
    rows = [following_row(tables, 30.0, 0.0, 30.0, rate, 0.5) for rate in RANGE_RATES]
    ordered = [(tables.cut[a] >= tables.cut[b]).all() for a, b in itertools.pairwise(rows)]
    assert any(ordered)  # otherwise the property above looks at nothing


# Lane changes


def test_lane_change_base_is_base_times_desire(model: NddModel, tables: NddTables) -> None:
    for i, j, k in [(0, 0, 0), (10, 30, 5), (20, 115, 18)]:
        expected = float(model.lc_base[i]) * float(model.lc_desire[j, k])
        assert lane_change_base(tables, SPEEDS[i], GAPS[j], RANGE_RATES[k]) == pytest.approx(expected, rel=1e-12)
    free = float(model.lc_base[10]) * model.lc_desire_free
    assert lane_change_base(tables, 30.0, math.inf, 0.0) == pytest.approx(free, rel=1e-12)


def test_nobody_wants_to_change_lanes_more_than_the_bound(model: NddModel, tables: NddTables) -> None:
    # `>=` in floating point, since a draw is compared with the bound before the chance itself is looked up
    chances = model.lc_base.astype(float)[:, None, None] * model.lc_desire.astype(float)
    assert chances.max() <= tables.lc_most
    assert tables.lc_most >= float(model.lc_base.max()) * model.lc_desire_free
    eager = tables_of(replace(model, lc_desire_free=50.0))
    assert eager.lc_most == lane_change_base(eager, float(SPEEDS[int(model.lc_base.argmax())]), math.inf, 0.0)


def test_accept_chance(model: NddModel, tables: NddTables) -> None:
    for rear, table in enumerate((model.lc_accept_lead, model.lc_accept_rear)):
        assert accept_chance(tables.lc_accept, rear, 40.0, -3.0) == pytest.approx(float(table[40, 7]))
        for rate in (-12.0, -10.0, -2.3, -0.5, 0.0, 0.499, 7.9, 8.0, 9.0):  # the grid ends at 10 m/s of closing
            expected = np.interp(rate, RANGE_RATES, table[40].astype(float))
            gap = 40.0 if rate >= -10.0 else 4.0 + 36.0 * 1.44
            assert accept_chance(tables.lc_accept, rear, gap, rate) == pytest.approx(float(expected), rel=1e-12)
        assert accept_chance(tables.lc_accept, rear, 0.0, 5.0) == 0.0
        assert accept_chance(tables.lc_accept, rear, -4.0, 5.0) == 0.0
        assert accept_chance(tables.lc_accept, rear, 116.0, 0.0) == 1.0
        assert accept_chance(tables.lc_accept, rear, math.inf, 0.0) == 1.0


def test_turn_back_chance(model: NddModel, tables: NddTables) -> None:
    for gap, rate in ((40.0, -3.0), (7.0, 2.0), (0.4, 0.0)):
        table = model.lc_turn_back[round(gap), round(rate) + 10]
        assert turn_back_chance(tables.lc_turn_back, gap, rate) == float(table)
    assert turn_back_chance(tables.lc_turn_back, 0.0, 5.0) == 1.0
    assert turn_back_chance(tables.lc_turn_back, -4.0, 5.0) == 1.0
    assert turn_back_chance(tables.lc_turn_back, 116.0, 0.0) == 0.0
    assert turn_back_chance(tables.lc_turn_back, math.inf, 0.0) == 0.0


# Memory

UNIT = st.floats(0.0, 1.0)
WIDTH = st.floats(0.01, 1.0)
MEMORIES = st.builds(
    lambda shares, total, widths: memory_numbers(
        Memory(
            *(
                part
                for share, width in zip(shares, widths, strict=True)
                for part in (total * share / sum(shares), width)
            )
        )
    ),
    st.lists(st.floats(0.01, 1.0), min_size=3, max_size=3),
    st.floats(0.0, 1.0),
    st.lists(WIDTH, min_size=3, max_size=3),
)
MINDFUL = memory_numbers(Memory(0.25, 0.1, 0.2, 0.45, 0.35, 0.2))


def test_a_quantile_that_leaves_the_unit_interval_is_reflected() -> None:
    for u, inside in ((-1.0, 1.0), (-0.2, 0.2), (0.0, 0.0), (0.7, 0.7), (1.0, 1.0), (1.3, 0.7), (2.0, 0.0)):
        assert reflected(u) == pytest.approx(inside, abs=1e-15)


@given(MEMORIES, UNIT, UNIT, UNIT, UNIT)
def test_remembered_shares_are_a_distribution_function(
    memory: MemoryNumbers, before: float, habit: float, x: float, y: float
) -> None:
    assert remembered_share(0.0, before, habit, memory) == pytest.approx(0.0, abs=1e-12)
    assert remembered_share(1.0, before, habit, memory) == pytest.approx(1.0, abs=1e-9)
    low, high = (remembered_share(min(x, y), before, habit, memory), remembered_share(max(x, y), before, habit, memory))
    assert -1e-12 <= low <= high + 1e-12


@given(MEMORIES, UNIT, UNIT, WORD)
def test_a_word_that_remembers_is_a_word(memory: MemoryNumbers, before: float, habit: float, word: np.uint64) -> None:
    assert 0 <= remembering_word(word, before, habit, memory) <= 2**32 - 1


@given(WORD, UNIT, UNIT)
def test_who_has_no_memory_takes_the_word_as_it_is(word: np.uint64, before: float, habit: float) -> None:
    none = memory_numbers(Memory(0.0, 0.1, 0.0, 0.3, 0.0, 0.1))
    assert remembering_word(word, before, habit, none) == word
    assert remembered_share(float(uniform(word)), before, habit, none) == uniform(word)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("before", "habit"), [(0.5, 0.5), (0.02, 0.9), (0.99, 0.1)])
def test_words_that_remember_have_the_stated_distribution(words: np.ndarray, before: float, habit: float) -> None:
    # H0: quantiles are independent draws of `remembered_share`; unit: a test's word; n = 100,000 sees 0.009.
    drawn = np.sort([float(uniform(remembering_word(word, before, habit, MINDFUL))) for word in words])
    bound = dkw_bound(N, comparisons=3)

    def distance(memory: MemoryNumbers) -> float:
        stated = np.array([remembered_share(float(u), before, habit, memory) for u in drawn])
        return float(np.abs(stated - np.arange(1, N + 1) / N).max())

    assert distance(MINDFUL) <= bound
    # negative controls: a width that is a third too small; habit and past mistaken
    assert distance(MINDFUL._replace(far_width=0.3)) > bound
    assert before == habit or distance(MINDFUL._replace(near=0.35, habit=0.25)) > bound


def test_over_all_drivers_quantiles_stay_uniform(words: np.ndarray) -> None:
    # H0: where quantiles and habits are uniform, they stay so from one second to the next; n = 100,000 sees 0.009.
    rng = np.random.default_rng(7)
    before, habits = rng.random(N), rng.random(N)
    after = np.array(
        [uniform(remembering_word(word, u, h, MINDFUL)) for word, u, h in zip(words, before, habits, strict=True)]
    )
    bound = dkw_bound(N)
    assert distance_to_law(after, stats.uniform()) <= bound
    assert distance_to_law(after**1.05, stats.uniform()) > bound  # negative control
    assert np.corrcoef(before, after)[0, 1] > 0.3  # and they are remembered


NOISE = st.floats(-0.999, 0.999)


@given(NOISE, UNIT, UNIT)
def test_own_ranks_are_a_distribution_function_and_in_the_mean_that_of_all(noise: float, x: float, y: float) -> None:
    assert (own_rank(0.0, noise), own_rank(1.0, noise), own_rank(0.5, noise)) == (0.0, 1.0, 0.5)
    assert own_rank(min(x, y), noise) <= own_rank(max(x, y), noise)
    assert own_rank(1.0 - x, noise) == pytest.approx(1.0 - own_rank(x, noise), abs=1e-15)
    assert 0.5 * (own_rank(x, noise) + own_rank(x, -noise)) == pytest.approx(x, abs=1e-15)
    assert own_rank(x, 0.0) == x
    outer = own_rank(0.25, noise) + 1.0 - own_rank(0.75, noise)
    assert outer == pytest.approx(0.5 * (1.0 + noise), abs=1e-15)


@given(WORD, NOISE)
def test_the_word_of_a_driver_is_looked_up_where_its_rank_is(word: np.uint64, noise: float) -> None:
    assert own_word(word, 0.0) == word
    quantile = uniform(own_word(word, noise))
    step = 2.0**-32 * (1.0 + abs(noise))  # a word of the table is so much of the driver's own
    assert own_rank(float(quantile), noise) == pytest.approx(float(uniform(word)), abs=step)


def test_tables_of_a_model_do_not_copy_its_meaning(model: NddModel) -> None:
    tables = tables_of(model)
    assert tables.overlook == model.overlook
    assert tables.overlook_conflict == model.overlook_conflict
    traits = {"noise_spread", "vigilance_sigma"}  # they become levels
    assert tables.initial._asdict() == {n: v for n, v in asdict(model.initial).items() if n not in traits}
    assert tables.noise.std() == pytest.approx(0.5 * model.initial.noise_spread, rel=0.02)
    assert tables.noise.sum() == pytest.approx(0.0, abs=1e-12)
    assert tables.inattention.mean() == pytest.approx(1.0, abs=1e-15)
    said = tables.memory._asdict()
    said.pop("ways")  # what follows from the rest
    assert said == asdict(model.memory)
    np.testing.assert_array_equal(tables.lc_accept[0], model.lc_accept_lead)
    np.testing.assert_array_equal(tables.lc_accept[1], model.lc_accept_rear)
    np.testing.assert_array_equal(tables.lc_turn_back, model.lc_turn_back)
