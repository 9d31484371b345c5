"""Free-running traffic and the facts it is measured against."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import poisson

from cornerforge.errors import InputError
from cornerforge.pipeline.facts import CRASH_LIMIT, FACTS, compare_with_facts
from cornerforge.pipeline.free_running import (
    COUNTED,
    DRIFT,
    WINDOWS,
    FreeRunning,
    Window,
    free_running_odd,
    quantities_of,
    simulate_free_running,
    upper_rate,
)
from cornerforge.pipeline.setting import Experiment, experiment
from cornerforge.sim import statistics
from cornerforge.sim.statistics import allocate_counts

MILES = 5_000


@pytest.fixture(scope="module")
def run() -> Experiment:
    return experiment()


@pytest.fixture(scope="module")
def parts(run: Experiment) -> list[FreeRunning]:
    return [simulate_free_running(run, window, miles=MILES) for window in WINDOWS]


def test_an_upper_bound_is_the_exact_one() -> None:
    for events in (0, 1, 7, 40):
        bound = upper_rate(events, 1.0)
        assert poisson.cdf(events, bound) == pytest.approx(0.05)
    assert upper_rate(0, 1e6) == pytest.approx(2.996e-6, rel=1e-3)
    assert upper_rate(3, 2e6) == pytest.approx(upper_rate(3, 1.0) / 2e6)


def test_the_counted_stretch_is_out_of_reach_of_both_ends() -> None:
    """Somebody 10 m/s faster or slower than the stretch does not come from an end into it, nor within 115 m of it."""
    for window in WINDOWS:
        odd = free_running_odd(window)
        assert (odd.av_start, odd.time_limit) == (0.0, window.until)
        assert COUNTED[0] >= 10.0 * window.until
        assert odd.traffic_length - COUNTED[1] >= 10.0 * window.until + 115.5
        assert DRIFT == 30.0


def test_as_many_miles_as_asked_for_in_worlds_of_the_same_length(parts: list[FreeRunning]) -> None:
    for part in parts:
        assert part.miles >= MILES
        total = part.total()
        seconds = part.window.until - part.window.first
        assert total.totals[statistics.AV_STATES] == part.tests * seconds  # nobody ended early
        assert len(part.blocks) == 20
        assert all(block.totals[0] > 0 for block in part.blocks)


def test_the_density_stays_what_it_was(parts: list[FreeRunning]) -> None:
    """Were the ends felt, the counted stretch would thin out: 2 % would be seen."""
    assert parts[1].vehicles_per_km == pytest.approx(parts[0].vehicles_per_km, rel=0.02)


def test_threads_do_not_matter(run: Experiment) -> None:
    window = Window("1-3 s", 1, 3)
    one, two = (simulate_free_running(run, window, miles=1500, threads=n, seed=4) for n in (1, 2))
    assert one.tests == two.tests
    for left, right in zip(one.blocks, two.blocks, strict=True):
        for a, b in zip(left[:3], right[:3], strict=True):
            np.testing.assert_array_equal(a, b)
    assert compare_with_facts(one) == compare_with_facts(two)


def test_quantities_are_those_of_all_windows(parts: list[FreeRunning]) -> None:
    both, first = quantities_of(parts), quantities_of(parts[:1])
    assert set(both) == {grid.name for grid in statistics.JOINT}
    for name, (grid, counts) in both.items():
        assert counts.shape == (41, grid.bins)
        assert counts.sum() > first[name][1].sum() > 0
    following = both["gap"][1].sum()
    assert both["acceleration_following"][1].sum() == both["inverse_ttc"][1].sum() == following


@pytest.mark.parametrize(("name", "value"), [("miles", 99.0), ("miles", float("nan")), ("seed", -1), ("threads", 0)])
def test_numbers_out_of_range_are_refused(run: Experiment, name: str, value: float) -> None:
    arguments: dict[str, Any] = {"miles": 200.0, name: value}
    with pytest.raises(InputError, match=name):
        simulate_free_running(run, WINDOWS[0], **arguments)


# Facts


def test_the_facts_of_the_shipped_model_have_intervals_around_them(parts: list[FreeRunning]) -> None:
    rows = compare_with_facts(parts[0])
    assert len(rows) == len(FACTS) + 1
    for row in rows:
        assert row["when"] == "0-15 s"
        assert row["found"] is not None
        low, high = row["interval95"]
        assert low <= row["found"] <= high
        assert (row["allowed"] is None) == (row["within"] is None)
    by_name = {row["fact"]: row for row in rows}
    assert by_name["time gap, 50 %"]["found"] == pytest.approx(1.15, abs=0.12)
    assert by_name["speed, mean"]["within"] is True


def counted(**totals: int) -> FreeRunning:
    """Twenty equal blocks: 1000 BV states at 30 m/s, 700 following at 34.2 m, all at acceleration 0."""
    block = allocate_counts()
    block.totals[statistics.BV_STATES], block.totals[statistics.FOLLOWING_STATES] = 1000, 700
    block.totals[statistics.BV_TRAVEL_MM] = 30_000_000
    block.totals[statistics.LANE_CHANGES] = 6
    for name, value in totals.items():
        block.totals[getattr(statistics, name)] = value
    block.histograms[0, 1500] = 1000
    block.histograms[2, 228] = 700
    block.histograms[3, 1000] = 700
    block.joint[statistics.FOLLOWING_ACCELERATION, 30, 20] = 700
    block.joint[statistics.FREE_ACCELERATION, 30, [15, 20]] = [30, 270]
    return FreeRunning(WINDOWS[0], 100, (block,) * 20)


def rows_of(part: FreeRunning) -> dict[str, dict[str, Any]]:
    return {row["fact"]: row for row in compare_with_facts(part)}


def test_facts_by_hand() -> None:
    rows = rows_of(counted())
    assert rows["time gap, 50 %"]["found"] == pytest.approx(1.1425)
    assert rows["time gap, 50 %"]["interval95"] == pytest.approx([1.1425, 1.1425])  # all blocks are equal
    assert rows["speed, mean"]["found"] == pytest.approx(30.01)
    assert rows["speed, sd"]["within"] is False  # no spread at all
    assert rows["share of vehicles that follow"]["found"] == 0.7
    assert rows["lane changes"]["found"] == pytest.approx(6 / 30_000 * 1609.344)
    assert rows["lane changes"]["within"] is True
    assert rows["acceleration, sd"]["found"] is None  # nobody's acceleration was counted
    assert rows["acceleration, sd"]["within"] is False
    assert rows["free-flow acceleration at 30 m/s, share at or below -1"]["found"] == pytest.approx(0.1)
    assert rows["free-flow acceleration at 30 m/s, mean"]["found"] == pytest.approx(-0.1)
    assert rows["free-flow acceleration at 20 m/s, sd"]["found"] is None
    assert rows["free-flow acceleration at 20 m/s, sd"]["within"] is None


def test_crashes_are_judged_by_their_upper_bound() -> None:
    miles = 20 * 30_000 / 1609.344
    crash = rows_of(counted(CRASHED_BVS=2))["crashes between background vehicles"]
    assert crash["crashes"] == 20
    assert crash["found"] == pytest.approx(20 / miles)
    assert crash["interval95"] == [0.0, pytest.approx(upper_rate(20, miles))]
    assert crash["within"] is False
    long_enough = counted(BV_TRAVEL_MM=int(1.0e6 * 1609.344 * 1000 / 20))
    assert rows_of(long_enough)["crashes between background vehicles"]["within"] is True
    short = counted(BV_TRAVEL_MM=int(1.4e5 * 1609.344 * 1000 / 20))  # no crash, but too few miles to show it
    assert rows_of(short)["crashes between background vehicles"]["within"] is False
    assert upper_rate(0, 1.4e5) > CRASH_LIMIT > upper_rate(0, 1.6e5)


def test_an_odd_crashed_vehicle_is_a_crash() -> None:
    """Its partner was outside the counted stretch."""
    blocks = counted().blocks
    last = allocate_counts()
    last.add(blocks[0])
    last.totals[statistics.CRASHED_BVS] = 1
    assert (
        rows_of(FreeRunning(WINDOWS[0], 100, (*blocks[:-1], last)))["crashes between background vehicles"]["crashes"]
        == 1
    )


def test_nothing_counted_meets_no_gated_fact() -> None:
    rows = compare_with_facts(FreeRunning(WINDOWS[1], 100, tuple(allocate_counts() for _ in range(20))))
    assert all(row["found"] is None and row["within"] in (None, False) for row in rows)
    assert sum(row["within"] is False for row in rows) == 14


def test_every_gate_can_fail_on_both_sides() -> None:
    for fact in FACTS:
        if fact.low is not None and fact.high is not None:
            assert fact.low < fact.high
            if isinstance(fact.published, float):
                assert fact.low <= fact.published <= fact.high
    assert sum(fact.low is not None for fact in FACTS) == 13


def test_jackknife_intervals_hold_the_truth_about_as_often_as_they_say(seed: int) -> None:
    """Following shares of blocks, each drawn about 0.7: coverage 0.95, n = 200 (exact binomial test)."""
    from statistical_bounds import rate_fits

    rng = np.random.default_rng(seed)
    held = {20: 0, 2: 0}
    for _ in range(200):
        blocks = []
        for share in rng.beta(70.0, 30.0, 20):
            block = allocate_counts()
            block.totals[statistics.BV_STATES] = 1000
            block.totals[statistics.FOLLOWING_STATES] = int(1000 * share)
            blocks.append(block)
        row = rows_of(FreeRunning(WINDOWS[0], 1, tuple(blocks)))["share of vehicles that follow"]
        low, high = row["interval95"]
        held[20] += low <= 0.7 <= high
        middle, half = row["found"], (high - low) / 6.0
        held[2] += middle - half <= 0.7 <= middle + half  # negative control: a third as wide
    assert rate_fits(held[20], 200, 0.95, comparisons=2)
    assert not rate_fits(held[2], 200, 0.95, comparisons=2)
