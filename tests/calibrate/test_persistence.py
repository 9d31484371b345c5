"""Memory of drivers: pairs found in states built by hand, and correlations against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from cornerforge.ext.calibrate.persistence import Pairs, compare_persistence, pairs_of, residuals
from cornerforge.fields import FRAME_FIELDS

SECONDS = 62
LANE = 4.0


def states_of(*cars: tuple[float, int, float]) -> np.ndarray:
    """One world of cars (x, lane, speed) that go on as they are; the first is the AV."""
    states = np.zeros((1, SECONDS, len(cars)), dtype=FRAME_FIELDS)
    for slot, (x, lane, speed) in enumerate(cars):
        states["x"][0, :, slot] = x + speed * np.arange(SECONDS)
        states["y"][0, :, slot] = LANE * (lane + 0.5)
        states["speed"][0, :, slot] = speed
        states["target_lane"][0, :, slot] = lane
    states["present"] = 1
    return states


def found_in(states: np.ndarray, length: float = 5.0) -> Pairs:
    lengths = np.full((states.shape[0], states.shape[2]), length)
    return pairs_of(states, lengths, states["present"] == 1, LANE)


def test_pairs_by_hand() -> None:
    """Slot 2 follows 1 and gains 0.5 m/s: 55 m between centres at 0 s. Slot 3 is alone; the AV follows nobody."""
    pairs = found_in(states_of((0.0, 1, 30.0), (200.0, 1, 29.5), (145.0, 1, 30.0), (150.0, 2, 30.0)))
    after = {10: (10, 20, 30), 20: (10, 20, 30), 30: (10, 20, 30), 40: (10, 20)}
    for lag, starts in after.items():
        wanted = [[np.log((50.0 - 0.5 * t) / 30.0) for t in (start, start + lag)] for start in starts]
        np.testing.assert_allclose(pairs.time_gaps[lag], np.transpose(wanted))
    assert pairs.seconds.shape == (2, 4, 5)
    np.testing.assert_allclose(pairs.seconds[0, :, 0], [30.0, 45.0, -0.5, 0.0])
    np.testing.assert_allclose(pairs.seconds[1, :, 0], [30.0, 44.5, -0.5, 0.0])


def test_accelerations_are_those_of_two_successive_seconds() -> None:
    states = states_of((0.0, 0, 30.0), (200.0, 1, 30.0), (145.0, 1, 30.0))
    states["speed"][0, 11, 2], states["speed"][0, 12, 2] = 30.7, 30.3
    first, second = found_in(states).seconds[:, 3]
    assert first.tolist() == pytest.approx([0.7, 0.0, 0.0, 0.0, 0.0])
    assert second.tolist() == pytest.approx([-0.4, 0.0, 0.0, 0.0, 0.0])


def test_a_new_leader_ends_a_pair() -> None:
    """At 25 s slot 3 is between them: the pairs that started at 10 s still hold at 20 s, not at 30 s."""
    states = states_of((0.0, 0, 30.0), (200.0, 1, 30.0), (145.0, 1, 30.0), (172.0, 2, 30.0))
    states["y"][0, 25:, 3] = 1.5 * LANE
    states["target_lane"][0, 25:, 3] = 1
    pairs = found_in(states)
    assert {lag: found.shape[1] for lag, found in pairs.time_gaps.items()} == {10: 3, 20: 2, 30: 2, 40: 0}
    assert pairs.time_gaps[10][0, 0] == pairs.time_gaps[10][1, 0] == pytest.approx(np.log(50.0 / 30.0))


def test_who_changes_lanes_has_left_or_is_too_far_behind_is_no_pair() -> None:
    cars = ((0.0, 0, 30.0), (200.0, 1, 30.0), (145.0, 1, 30.0))
    changing = states_of(*cars)
    changing["y"][0, :, 2] += 0.1
    assert found_in(changing).seconds.shape[2] == 0  # its acceleration is that of a lane change
    assert found_in(changing).time_gaps[10].shape[1] == 3
    gone = states_of(*cars)
    gone["present"][0, 20:, 1] = 0
    assert found_in(gone).time_gaps[10].shape[1] == 0
    assert found_in(gone).seconds.shape[2] == 1
    assert found_in(states_of(cars[0], (265.7, 1, 30.0), cars[2])).time_gaps[10].shape[1] == 0  # gap of 115.7 m
    assert found_in(states_of(*cars), length=56.0).time_gaps[10].shape[1] == 0  # they overlap
    assert found_in(states_of((200.0, 1, 30.0), (500.0, 2, 30.0), cars[2])).time_gaps[10].shape[1] == 0  # the AV leads


def drivers(rng: np.random.Generator, memory: float) -> list[Pairs]:
    """Blocks of followers whose acceleration answers the range rate, with noise of this correlation."""
    blocks = []
    for _ in range(20):
        m = 4000
        noise = rng.standard_normal((2, m))
        noise[1] = memory * noise[0] + np.sqrt(1.0 - memory**2) * noise[1]
        rate = np.tile(rng.normal(0.0, 1.0, m), (2, 1))
        speed, gap = rng.uniform(28.0, 30.0, (2, m)), rng.uniform(30.0, 40.0, (2, m))
        gaps = rng.multivariate_normal([0.0, 0.0], [[1.0, 0.9], [0.9, 1.0]], m).T
        seconds = np.stack([speed, gap, rate, 0.8 * rate + 0.4 * noise], axis=1)
        blocks.append(Pairs(dict.fromkeys((10, 20, 30, 40), gaps), seconds))
    return blocks


@pytest.mark.full
@pytest.mark.parametrize("memory", [0.0, 0.5])
def test_correlations_are_those_of_numpy(memory: float, seed: int) -> None:
    """The answer to the range rate, which is the same in both seconds, is no memory (0.1 is left within a class)."""
    blocks = drivers(np.random.default_rng(seed), memory)
    rows = compare_persistence(blocks)
    assert [row.n for row in rows[:4]] == [80_000] * 4
    gaps = np.concatenate([block.time_gaps[10] for block in blocks], axis=1)
    assert rows[0].found == pytest.approx(np.corrcoef(gaps)[0, 1])
    assert rows[0].interval95 is not None
    low, high = rows[0].interval95
    assert low < 0.9 < high or rows[0].found == pytest.approx(0.9, abs=0.01)
    assert [row.within for row in rows] == [True, False, False, None, memory > 0.0]
    residual = rows[-1]
    everything = np.concatenate([block.seconds for block in blocks], axis=2)
    left = residuals(everything)
    known = np.isfinite(left).all(axis=0)
    assert residual.n == known.sum() > 70_000
    assert residual.found == pytest.approx(np.corrcoef(left[0, known], left[1, known])[0, 1])
    assert residual.found == pytest.approx(memory, abs=0.12)
    without_state = np.corrcoef(everything[0, 3], everything[1, 3])[0, 1]
    assert without_state > memory + 0.3  # the range rate alone makes them alike


def test_nothing_noted_is_nothing_found() -> None:
    nothing = Pairs(dict.fromkeys((10, 20, 30, 40), np.zeros((2, 0))), np.zeros((2, 4, 0)))
    rows = compare_persistence([nothing] * 20)
    assert all(row.found is None and row.n == 0 and not row.within for row in rows)
