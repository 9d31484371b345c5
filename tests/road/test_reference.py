"""The reference line against integrals by other means, and its own inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid
from scipy.special import fresnel

from cornerforge.errors import InputError
from cornerforge.road.reference import Piece, ReferenceLine

CURVED = [(120.0, 0.0, 0.0), (80.0, 0.0, 0.004), (300.0, 0.004, 0.004), (150.0, 0.004, -0.002), (90.0, -0.002, 0.0)]


def test_an_arc_is_a_circle() -> None:
    line = ReferenceLine.of_curvature([(2500.0, 0.002, 0.002)], (100.0, -50.0, 0.3))
    s = np.linspace(0.0, 2500.0, 101)
    x, y, heading, bend = line.at(s)
    centre = np.array([100.0 - 500.0 * np.sin(0.3), -50.0 + 500.0 * np.cos(0.3)])
    np.testing.assert_allclose(np.hypot(x - centre[0], y - centre[1]), 500.0, atol=1e-9)
    np.testing.assert_allclose(heading, 0.3 + 0.002 * s, atol=1e-12)
    np.testing.assert_allclose(bend, 0.002)


def test_a_clothoid_is_fresnels() -> None:
    a = 200.0  # curvature s / a^2
    line = ReferenceLine.of_curvature([(300.0, 0.0, 300.0 / a**2)])
    s = np.linspace(1.0, 300.0, 60)
    up, along = fresnel(s / (a * np.sqrt(np.pi)))
    scale = a * np.sqrt(np.pi)
    x, y, heading, _ = line.at(s)
    np.testing.assert_allclose(x, scale * along, atol=1e-9)
    np.testing.assert_allclose(y, scale * up, atol=1e-9)
    np.testing.assert_allclose(heading, s**2 / (2.0 * a**2), atol=1e-12)


def test_pieces_join_as_an_integration_of_the_curvature_does() -> None:
    line = ReferenceLine.of_curvature(CURVED, (10.0, 20.0, -1.0))
    ends = np.cumsum([length for length, _, _ in CURVED])
    fine = np.linspace(0.0, ends[-1], 740_001)
    bend = np.interp(fine, [0.0, *ends], [CURVED[0][1], *(last for _, _, last in CURVED)])
    heading = -1.0 + cumulative_trapezoid(bend, fine, initial=0.0)
    x = 10.0 + cumulative_trapezoid(np.cos(heading), fine, initial=0.0)
    y = 20.0 + cumulative_trapezoid(np.sin(heading), fine, initial=0.0)
    found = line.at(fine[::1000])
    np.testing.assert_allclose(found[:3], np.stack([x, y, heading])[:, ::1000], atol=1e-6)
    assert np.abs(line.gaps).max() < 1e-9
    assert line.tightest == pytest.approx(250.0)


def test_beyond_its_ends_it_goes_on_straight() -> None:
    line = ReferenceLine.of_curvature([(100.0, 0.01, 0.01)])
    assert [round(float(part), 6) for part in line.at(-30.0, 2.0)] == [-30.0, 2.0, 0.0, 0.0]
    end, beyond = line.at(100.0), line.at(150.0)
    assert np.hypot(beyond.x - end.x, beyond.y - end.y) == pytest.approx(50.0)
    assert beyond.heading == end.heading


@given(st.floats(-50.0, 790.0), st.floats(-30.0, 30.0))
def test_a_point_is_projected_back_to_where_it_was_put(s: float, d: float) -> None:
    line = ReferenceLine.of_curvature(CURVED, (1e5, -2e5, 2.0))
    x, y, _, _ = line.at(s, d)
    again = line.project(x, y)
    assert np.allclose(again, (s, d), atol=1e-6)


def test_pieces_out_of_order_are_refused() -> None:
    with pytest.raises(InputError, match="follow each other"):
        ReferenceLine((Piece(0.0, 0.0, 0.0, 0.0), Piece(0.0, 1.0, 0.0, 0.0)), 10.0)
    with pytest.raises(InputError, match="begin at 0"):
        ReferenceLine((), 10.0)
    with pytest.raises(InputError, match="begin at 0"):
        ReferenceLine((Piece(0.0, 0.0, 0.0, 0.0),), float("nan"))
    with pytest.raises(InputError, match="not finite"):
        ReferenceLine((Piece(0.0, 0.0, float("nan"), 0.0),), 10.0)
    with pytest.raises(InputError, match="full circle"):
        ReferenceLine((Piece(0.0, 0.0, 0.0, 0.0, 100.0),), 1e6)
