"""What formats of straight, endless lanes can hold of a road."""

from __future__ import annotations

import numpy as np

from cornerforge.road.network import Road

__all__ = ["is_plain", "is_straight"]

_SAME = 1e-6


def is_straight(road: Road) -> bool:
    """Say whether distances in the simulator are those in the world: no curves, and slots as far apart as there."""
    even = np.allclose(np.diff(road.centres), road.lane_width, rtol=0.0, atol=_SAME)
    return bool(even) and road.line.tightest == float("inf") and not (road.line.gaps > _SAME).any()


def is_plain(road: Road) -> bool:
    """Say whether a road is as the simulator's without one: straight, its lanes go on and may be left all along."""
    inner = [(one.left, one.slot + 1) for one in road.lanes] + [(one.right, one.slot) for one in road.lanes]
    free = all(mark.may_cross for marks, border in inner if 0 < border < road.slots for mark in marks)
    whole = all((one.begin, one.end, one.kind) == (0.0, road.length, "through") for one in road.lanes)
    return is_straight(road) and whole and free
