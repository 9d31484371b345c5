"""Contracts of all measures: values, edge values, no NaN, no mutation; monotony by hypothesis."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.errors import InputError
from cornerforge.metrics import bbd, drac, thw, ttc

distances = st.floats(-1e3, 1e4)
rates = st.floats(-100.0, 100.0)
two_argument = pytest.mark.parametrize("metric", [ttc, thw, drac])


def test_bbd_is_centre_distance_less_half_lengths() -> None:
    assert bbd([0.0, 0.0], [20.0, 3.0], 5.0, [7.0, 5.0]).tolist() == [14.0, -2.0]
    assert bbd(0.0, np.inf, 5.0, 5.0) == np.inf


@given(x=st.floats(-1e4, 1e4), d=distances, shift=st.floats(-1e4, 1e4))
def test_bbd_ignores_where_the_road_begins(x: float, d: float, shift: float) -> None:
    assert bbd(x + shift, x + d + shift, 5.0, 5.0) == pytest.approx(bbd(x, x + d, 5.0, 5.0), abs=1e-8)


@pytest.mark.parametrize(
    ("metric", "distance", "second", "expected"),
    [
        (ttc, 20.0, -5.0, 4.0),
        (ttc, 20.0, 0.0, np.inf),
        (ttc, 20.0, 5.0, np.inf),
        (ttc, 0.0, 5.0, 0.0),
        (ttc, -1.0, -5.0, 0.0),
        (ttc, np.inf, -5.0, np.inf),
        (ttc, 20.0, -1e-320, np.inf),
        (thw, 30.0, 20.0, 1.5),
        (thw, 30.0, 0.0, np.inf),
        (thw, -1.0, 20.0, 0.0),
        (thw, -1.0, 0.0, 0.0),
        (thw, np.inf, 0.0, np.inf),
        (thw, np.inf, 20.0, np.inf),
        (drac, 20.0, -10.0, 2.5),
        (drac, 20.0, 10.0, 0.0),
        (drac, 0.0, -1.0, np.inf),
        (drac, -1.0, -1.0, np.inf),
        (drac, -1.0, 1.0, 0.0),
        (drac, np.inf, -10.0, 0.0),
        (drac, 1e-320, -1.0, np.inf),
    ],
)
def test_edge_values(metric, distance: float, second: float, expected: float) -> None:
    assert metric(np.array([distance]), np.array([second])).tolist() == [expected]


@two_argument
@given(pairs=st.lists(st.tuples(distances, rates), max_size=20))
def test_in_range_never_nan_and_the_same_one_by_one(metric, pairs: list[tuple[float, float]]) -> None:
    first, second = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
    before = first.copy(), second.copy()
    result = metric(first, second)
    assert result.shape == first.shape
    assert (result >= 0.0).all()  # false for NaN too
    assert result.tolist() == [float(metric(a, b)) for a, b in pairs]
    assert (first == before[0]).all()
    assert (second == before[1]).all()


@given(near=distances, extra=st.floats(0.0, 1e3), rate=rates)
def test_more_distance_is_never_more_dangerous(near: float, extra: float, rate: float) -> None:
    assert ttc(near + extra, rate) >= ttc(near, rate)
    assert thw(near + extra, abs(rate)) >= thw(near, abs(rate))
    assert drac(near + extra, rate) <= drac(near, rate)


@given(distance=st.floats(0.1, 1e3), rate=st.floats(-50.0, -0.1))
def test_drac_is_half_the_closing_speed_over_ttc(distance: float, rate: float) -> None:
    assert drac(distance, rate) == pytest.approx(-rate / (2.0 * ttc(distance, rate)))


@two_argument
def test_bad_input_is_named(metric) -> None:
    with pytest.raises(InputError, match=r"bbd\[1\] is NaN \(1 such"):
        metric(np.array([1.0, np.nan]), np.array([1.0, 1.0]))
    with pytest.raises(InputError, match=r"do not match: bbd \(2,\), \w+ \(3,\)"):
        metric(np.zeros(2), np.zeros(3))
    with pytest.raises(InputError, match="bbd = 'near' is not an array of numbers"):
        metric("near", 1.0)


@pytest.mark.parametrize(
    ("kmh", "seconds", "metres"),
    [
        (7.2, 1.0, 2.0),
        (10, 1.1, 3.1),
        (20, 1.2, 6.7),
        (30, 1.3, 10.8),
        (40, 1.4, 15.6),
        (50, 1.5, 20.8),
        (60, 1.6, 26.7),
    ],
)
def test_headway_is_that_of_the_regulation(kmh: float, seconds: float, metres: float) -> None:
    """Least gaps in time and metres (to 0.1) that an automated lane keeping system leaves: UN R157, 5.2.3.3."""
    assert thw(metres, kmh / 3.6) == pytest.approx(seconds, abs=0.05 / (kmh / 3.6) + 1e-9)


def test_infinite_subject_and_lengths_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match=r"x_subject\[0\] = inf is not finite"):
        bbd([np.inf], [np.inf], 5.0, 5.0)
    with pytest.raises(InputError, match=r"length_lead = inf is out of range"):
        bbd(0.0, np.inf, 5.0, np.inf)
    with pytest.raises(InputError, match=r"length_subject = -1\.0 is out of range"):
        bbd(0.0, 10.0, -1.0, 5.0)


@two_argument
def test_no_vehicles_no_values(metric) -> None:
    assert metric(np.empty((0, 3)), np.empty((0, 3))).shape == (0, 3)
