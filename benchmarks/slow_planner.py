"""An AV as slow as many planners: it computes 0.2 s for each world and answer, and then drives by a simple rule.

Set SLOW_PLANNER_S to another time [s]. Try it in the folder `benchmarks`:

    cornerforge check-av slow_planner:SlowPlanner
    cornerforge run --av slow_planner:SlowPlanner --hours 1 --out out/slow
"""

from __future__ import annotations

import os
import time

import numpy as np
from numpy.typing import NDArray

SECONDS = float(os.environ.get("SLOW_PLANNER_S", "0.2"))


class SlowPlanner:
    """Keeps its lane, 30 m/s and a time gap of 1.2 s to the vehicle ahead; plans world by world."""

    def act(self, view: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.array([self._plan(rows) if rows[0, 0] == 1.0 else (0.0, 0.0) for rows in view])

    def _plan(self, rows: NDArray[np.float32]) -> tuple[float, float]:
        end = time.perf_counter() + SECONDS
        plans = np.ones((64, 64))
        while time.perf_counter() < end:  # as if it looked through many plans
            plans = np.tanh(plans @ plans / 64.0)
        speed, others = float(rows[0, 3]), rows[1:]
        ahead = others[(others[:, 0] == 1.0) & (others[:, 1] > 0.0) & (others[:, 6] == rows[0, 6])]
        wanted = 0.3 * (30.0 - speed)
        if len(ahead):
            gap, lead = float(ahead[0, 1]) - 5.0, float(ahead[0, 3])
            wanted = min(wanted, 0.5 * (gap - 2.0 - 1.2 * speed) + 1.0 * (lead - speed))
        return float(np.clip(wanted, -8.0, 2.0)), 0.0
