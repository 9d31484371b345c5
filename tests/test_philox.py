from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.philox import Stream, normal_pair, philox
from scipy import stats
from statistical_bounds import distance_to_law, dkw_bound

from cornerforge import _philox

WORD = st.integers(0, 2**32 - 1)

# Random123 1.14, tests/kat_vectors: counter, key, result.
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((2**32 - 1,) * 4, (2**32 - 1,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


def compiled(counter: tuple[int, ...], key: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(int(word) for word in _philox.philox4x32(*map(np.uint64, (*counter, *key))))


@pytest.mark.parametrize(("counter", "key", "expected"), KNOWN)
def test_known_answers_of_random123(
    counter: tuple[int, int, int, int], key: tuple[int, int], expected: tuple[int, ...]
) -> None:
    assert compiled(counter, key) == expected
    assert philox(counter, key) == expected


@given(st.tuples(WORD, WORD, WORD, WORD), st.tuples(WORD, WORD))
def test_compiled_equals_whole_numbers(counter: tuple[int, int, int, int], key: tuple[int, int]) -> None:
    assert compiled(counter, key) == philox(counter, key)


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1), WORD, st.integers(0, 65535), st.integers(1, 3))
def test_block_takes_all_bits_of_its_names(seed: int, test: int, step: int, vehicle: int, purpose: int) -> None:
    words = _philox.block(seed, test, step, vehicle, purpose)
    assert tuple(int(word) for word in words) == Stream(seed, test).words(step, vehicle, purpose)


def test_blocks_of_different_names_differ() -> None:
    names = list(itertools.product((0, 1, 2**32), (0, 1, 2**32), (0, 1), (0, 1), (1, 2, 3)))
    assert len({_philox.block(*name) for name in names}) == len(names)


def test_uniform_stays_inside_the_open_interval() -> None:
    assert 0.0 < _philox.uniform(np.uint64(0)) < 1e-9
    assert 1.0 - 1e-9 < _philox.uniform(np.uint64(2**32 - 1)) < 1.0


def test_normal_pair_at_its_ends() -> None:
    for first, second in itertools.product((0, 2**31, 2**32 - 1), repeat=2):
        pair = _philox.normal_pair(np.uint64(first), np.uint64(second))
        assert pair == normal_pair(first, second)
        assert math.hypot(*pair) < 6.8


def test_words_are_uniform_and_normal_pairs_normal(seed: int) -> None:
    # H0: independent draws of U(0, 1) and N(0, 1); unit: a block; n = 20,000 sees errors of 0.02 in the distribution.
    n = 20_000
    blocks = np.array([_philox.block(seed, test, 7, 3, 1) for test in range(n)], dtype=np.uint64)
    bound = dkw_bound(n, comparisons=6)
    for column in range(4):
        assert distance_to_law((blocks[:, column].astype(np.float64) + 0.5) / 2.0**32, stats.uniform()) <= bound
    pairs = np.array([_philox.normal_pair(a, b) for a, b in blocks[:, :2]])
    for column in range(2):
        assert distance_to_law(pairs[:, column], stats.norm()) <= bound
        # negative control: a spread that is 10 % off is seen
        assert distance_to_law(1.1 * pairs[:, column], stats.norm()) > bound
