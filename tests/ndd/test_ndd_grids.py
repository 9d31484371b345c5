"""The grids of the tables: what a point is, which cell a value lies in, and that kernels mean the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.drivers.naturalistic import gap_index, range_rate_index, speed_index
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID, SPEED_GRID, Grid
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS

GRIDS = {
    "speed": (SPEED_GRID, SPEEDS, speed_index, (20.0, 40.0, 21)),
    "gap": (GAP_GRID, GAPS, gap_index, (0.0, 115.0, 116)),
    "range rate": (RANGE_RATE_GRID, RANGE_RATES, lambda v: range_rate_index(v, 0.5), (-10.0, 8.0, 19)),
}


@pytest.mark.parametrize("name", GRIDS)
def test_the_grids_are_those_of_the_published_arrays(name: str) -> None:
    grid, points, _, (first, last, bins) = GRIDS[name]
    assert (points[0], points[-1], points.size) == (first, last, bins)
    assert set(np.diff(points)) == {grid.step}
    assert (grid.lower, grid.upper) == (first - 0.5, last + 0.5) == (grid.edges()[0], grid.edges()[-1])
    np.testing.assert_array_equal((grid.edges()[:-1] + grid.edges()[1:]) / 2.0, points)
    assert grid.low % grid.step == 0.0


@given(value=st.floats(-200.0, 200.0))
@pytest.mark.parametrize("name", GRIDS)
def test_kernels_and_arrays_take_the_same_point_and_it_is_the_nearest(name: str, value: float) -> None:
    grid, points, index, _ = GRIDS[name]
    place = int(grid.place(np.array([value]))[0])
    assert index(value) == place
    assert abs(points[place] - value) == np.abs(points - value).min()


def test_another_step_is_taken_as_it_is_said() -> None:
    """The shipped grids all step by 1: a step that is forgotten in a formula would be seen here only."""
    grid = Grid(-1.0, 0.25, 9)
    np.testing.assert_array_equal(grid.points(), np.arange(-1.0, 1.01, 0.25))
    assert grid.nearest(grid.points()).tolist() == list(range(9))
    assert grid.place(np.array([-9.0, -0.9, -0.8, 0.0, 9.0])).tolist() == [0, 0, 1, 4, 8]
    assert (grid.lower, grid.upper) == (-1.125, 1.125)
