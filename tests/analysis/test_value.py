"""Parts of a case's value at the ends of their scales, and the score that is made of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.analysis.value import (
    PARTS,
    avoidability_part,
    novelty_part,
    severity_part,
    value_of,
)
from cornerforge.errors import InputError

real = st.floats(0.0, 1.0)


def test_ends_of_the_scales() -> None:
    np.testing.assert_array_equal(avoidability_part([-np.inf, 0.0, 2.0, 9.0, np.nan]), [0.0, 0.0, 1.0, 1.0, np.nan])
    np.testing.assert_allclose(severity_part([0.0, 1e-4, 1e-3, 1e-2, 1.0]), [0.0, 0.0, 0.0, 1.0 / 3.0, 1.0], atol=1e-12)


@given(real, real)
def test_more_is_more(low: float, high: float) -> None:
    """More time and more risk never make a part smaller."""
    low, high = sorted((low, high))
    for part, scale in ((avoidability_part, 3.0), (severity_part, 1.0)):
        first, second = part([scale * low, scale * high])
        assert 0.0 <= first <= second <= 1.0


def test_novelty_is_the_share_of_cases_in_denser_company() -> None:
    rng = np.random.default_rng(0)
    crowd = rng.normal(0.0, 0.1, (200, 2))
    alone = np.array([[5.0, 5.0], [-9.0, 0.0]])
    part = novelty_part(np.concatenate([crowd, alone]))
    assert part[-1] == 1.0, "nobody is farther from everybody"
    assert part[-2] == 200.0 / 201.0
    assert part[:200].min() == 0.0
    np.testing.assert_array_equal(novelty_part(np.zeros((50, 2))), np.zeros(50))
    np.testing.assert_array_equal(novelty_part(np.zeros((1, 2))), [0.0])


def test_the_score_is_the_weighted_mean_and_hides_nothing() -> None:
    parts = {
        "own_doing": [0.5, 0.5, 0.5], "avoidability": [1.0, 0.0, np.nan], "severity": [0.2, 0.8, 0.5],
        "novelty": [0.0, 1.0, 0.5],
    }  # fmt: skip
    found = value_of(parts, {"own_doing": 0.0, "avoidability": 3.0, "severity": 1.0, "novelty": 0.0})
    np.testing.assert_allclose(found.score, [(3.0 + 0.2) / 4.0, 0.2, np.nan])
    assert found.weights == {"own_doing": 0.0, "avoidability": 0.75, "severity": 0.25, "novelty": 0.0}
    for name in PARTS:
        np.testing.assert_array_equal(found.parts[name], parts[name])
    assert found.best(5).tolist() == [0, 1], "a case that nobody looked at has no rank"
    blind = value_of(parts, {"own_doing": 0.0, "avoidability": 0.0, "severity": 1.0, "novelty": 0.0})
    assert blind.best(2).tolist() == [1, 2], "a part without a weight need not be known"


def test_nothing_of_a_likelihood_is_in_the_score() -> None:
    """A sequence's likelihood is not the rate of its kind: once it gave 160 of 308 natural crashes no likelihood."""
    assert PARTS == ("own_doing", "avoidability", "severity", "novelty")
    with pytest.raises(InputError, match="needed: own_doing, avoidability, severity, novelty"):
        value_of({name: [0.5] for name in (*PARTS, "likelihood")})
    assert value_of({name: [0.5] for name in PARTS}).weights == pytest.approx(dict.fromkeys(PARTS, 0.25))


def test_equal_scores_keep_their_order() -> None:
    flat = dict.fromkeys(PARTS, np.full(4, 0.5))
    assert value_of(flat).best(3).tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parts": {"severity": [0.5]}}, "needed: own_doing"),
        ({"weights": {"severity": 1.0}}, "needed: own_doing"),
        ({"weights": dict.fromkeys(PARTS, 0.0)}, "one above it"),
        ({"weights": dict.fromkeys(PARTS, -1.0)}, "at least 0"),
        ({"parts": {name: [1.5] for name in PARTS}}, "outside 0 to 1"),
        ({"parts": {**{name: [0.5] for name in PARTS}, "novelty": [0.5, 0.5]}}, "one value a case"),
    ],
)
def test_what_is_refused(change: dict[str, dict[str, object]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        value_of(**{"parts": {name: [0.5] for name in PARTS}, **change})  # type: ignore[arg-type]
