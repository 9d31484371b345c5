"""Memory of drivers: what is drawn is what is stated, and over all drivers nothing changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.ndd.memory import Memory, given_the_past, memory_numbers, remembered_share, remembering_word

N = 200_000
BOTH = Memory(near=0.3, near_width=0.1, far=0.35, far_width=0.4)
ALL = Memory(near=0.2, near_width=0.05, far=0.3, far_width=0.3, habit=0.25, habit_width=0.15)


@kernel
def _draw(words: NDArray[np.uint64], before: NDArray[np.float64], habit: NDArray[np.float64], m: Any, u: Any) -> None:
    for k in range(words.size):
        u[k] = (np.float64(remembering_word(words[k], before[k], habit[k], m)) + 0.5) / 4294967296.0


@kernel
def _shares(x: NDArray[np.float64], before: float, habit: float, m: Any, out: NDArray[np.float64]) -> None:
    for k in range(x.size):
        out[k] = remembered_share(x[k], before, habit, m)


def drawn(memory: Memory, before: Any, habit: Any, seed: int) -> NDArray[np.float64]:
    """N quantiles drawn after given ones."""
    words = np.random.default_rng(seed).integers(0, 2**32, N, dtype=np.uint64)
    u = np.empty(N)
    _draw(words, np.broadcast_to(before, N).copy(), np.broadcast_to(habit, N).copy(), memory_numbers(memory), u)
    return u


def distance(u: NDArray[np.float64], share: NDArray[np.float64], x: NDArray[np.float64]) -> float:
    """Largest distance between shares below x and stated ones (Kolmogorov)."""
    return float(np.abs(np.searchsorted(np.sort(u), x) / u.size - share).max())


X = np.linspace(0.0, 1.0, 1001)
# H0: u is drawn from what is stated; n = 200,000 independent draws; P(distance > bound) < 1e-9 (Dvoretzky, Massart)
BOUND = np.sqrt(np.log(2.0 / 1e-9) / 2.0 / N)


@pytest.mark.parametrize("memory", [BOTH, ALL, Memory(far=1.0, far_width=0.4)])
@pytest.mark.parametrize("before", [0.0, 0.03, 0.5, 0.97])
def test_what_is_stated_is_what_is_drawn(memory: Memory, before: float) -> None:
    share = np.empty(X.size)
    _shares(X, before, 0.8, memory_numbers(memory), share)
    u = drawn(memory, before, 0.8, seed=3)
    assert (share[0], share[-1]) == (0.0, pytest.approx(1.0, abs=1e-12))
    assert distance(u, share, X) < BOUND
    assert distance(u, X, X) > 3.0 * BOUND  # negative control: without the past


def test_over_all_drivers_every_quantile_is_as_likely_as_before() -> None:
    rng = np.random.default_rng(4)
    u, habit = rng.random(N), rng.random(N)
    for second in range(5):  # quantiles of one driver depend on each other, those of different drivers do not
        before, u = u, drawn(ALL, u, habit, seed=10 + second)
        assert distance(u, X, X) < BOUND
        assert 0.4 < np.corrcoef(before, u)[0, 1] < 0.8


def test_without_weights_a_word_stays_as_it_is() -> None:
    words = np.random.default_rng(5).integers(0, 2**32, N, dtype=np.uint64)
    u = np.empty(N)
    _draw(words, np.full(N, 0.2), np.full(N, 0.2), memory_numbers(Memory()), u)
    np.testing.assert_array_equal(u, (words + 0.5) / 2.0**32)


def test_a_past_known_to_its_bin_is_the_mean_over_the_bin() -> None:
    rng = np.random.default_rng(6)
    row = rng.dirichlet(np.ones(31))
    row[4:7] = 0.0
    row /= row.sum()
    low, high = np.array([0.2, np.nan]), np.array([0.6, np.nan])
    p = np.stack([row, row])
    given_the_past(p, low, high, memory_numbers(BOTH))
    np.testing.assert_array_equal(p[1], row)  # nothing is known
    np.testing.assert_allclose(p[0].sum(), 1.0)
    assert (p[0][row == 0.0] == 0.0).all()  # impossible stays impossible
    u = drawn(BOTH, rng.uniform(0.2, 0.6, N), rng.random(N), seed=7)
    counts = np.bincount(np.minimum(np.searchsorted(np.cumsum(row), u, side="right"), 30), minlength=31) / N
    bound = np.sqrt(2.0 * (31 * np.log(2.0) + np.log(1e9)) / N)  # L1, as in the tests of bins
    assert np.abs(counts - p[0]).sum() < bound
    assert np.abs(counts - row).sum() > 2.0 * bound
