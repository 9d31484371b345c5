"""Recordings of several scenarios in memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cornerforge.recordings import Recordings, recordings_of
from cornerforge.types import Scenario

__all__ = ["recordings_of_all"]


def recordings_of_all(scenarios: Sequence[Scenario]) -> Recordings:
    """`recordings_of` each of them, one case after the other."""
    parts = [recordings_of(scenario) for scenario in scenarios]
    joined = Recordings._make(np.concatenate(columns) for columns in zip(*parts, strict=True))
    sizes = joined.frames * joined.vehicles
    return joined._replace(at=np.cumsum(sizes) - sizes, vehicle_at=np.cumsum(joined.vehicles) - joined.vehicles)
