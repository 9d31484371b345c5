"""The grids of the naturalistic model's tables, which are the grids of the published IVBSS arrays (Feng et al. 2021).

Lane-change tables (desire, acceptance) use the grids of gap and range rate too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["GAP_GRID", "LACK_GRID", "RANGE_RATE_GRID", "SLOW_GRID", "SPEED_GRID", "Grid"]


class Grid(NamedTuple):
    """Evenly spaced points. A value belongs to the nearest point; beyond the ends, to the outermost.

    Attributes:
        low: The lowest point, a whole number of steps.
        step: Between two points.
        bins: How many there are.
    """

    low: float
    step: float
    bins: int

    @property
    def lower(self) -> float:
        """Lower border of the lowest point's cell, half a step below the point."""
        return self.low - 0.5 * self.step

    @property
    def upper(self) -> float:
        """Upper border of the highest point's cell, half a step above the point."""
        return self.low + (self.bins - 0.5) * self.step

    def points(self) -> NDArray[np.float64]:
        """Return all points, rising, shape (bins,)."""
        return np.asarray(self.low + self.step * np.arange(self.bins), np.float64)

    def edges(self) -> NDArray[np.float64]:
        """Return the borders of the points' cells, shape (bins + 1,)."""
        return np.asarray(self.lower + self.step * np.arange(self.bins + 1), np.float64)

    def nearest(self, values: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the index of each finite value's nearest point, any shape; of two equally near, the upper.

        Beyond the ends the index goes on, below 0 too; `place` cuts it.

        >>> SPEED_GRID.nearest(np.array([18.0, 20.5, 41.0]))
        array([-2,  1, 21])
        """
        return np.floor(values / self.step + 0.5).astype(np.int64) - round(self.low / self.step)

    def place(self, values: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the index of each value's nearest point, cut to the grid.

        >>> SPEED_GRID.place(np.array([18.0, 20.5, 41.0]))
        array([ 0,  1, 20])
        """
        return np.clip(self.nearest(values), 0, self.bins - 1)


SPEED_GRID = Grid(20.0, 1.0, 21)
"""Subject speed [m/s]."""
SLOW_GRID = Grid(0.0, 1.0, 20)
"""Subject speed below it [m/s], for traffic that stops."""
GAP_GRID = Grid(0.0, 1.0, 116)
"""Bumper-to-bumper distance to the lead [m]."""
RANGE_RATE_GRID = Grid(-10.0, 1.0, 19)
"""Range rate [m/s], lead minus subject; negative is closing."""
LACK_GRID = Grid(-6.0, 0.5, 25)
"""Desired speed minus speed of a driver [m/s]; negative: it drives faster."""
