"""Outcomes of tests: how a world stands, and how tests ended."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel
from cornerforge.road.straight import driven
from cornerforge.site.tables import at_site

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = [
    "AV_CRASH",
    "AV_FAULT",
    "BV_CRASH",
    "COMPLETED",
    "IDLE",
    "LEFT_ROAD",
    "RUNNING",
    "TIME_UP",
    "UNDRAWN",
    "Outcomes",
    "allocate_outcomes",
    "write_outcome",
]

RUNNING, COMPLETED, AV_CRASH, BV_CRASH, TIME_UP = range(5)
"""Outcome codes. BV_CRASH ends a test only when the controlled BV takes part; others are counted and their vehicles
removed."""
AV_FAULT = 5
"""Outcome code of a test that does not count: an AV from outside raised, hung, or gave no usable answer in it."""
LEFT_ROAD = 6
"""Outcome code of a test in which the AV drove on where its lane had ended."""
UNDRAWN = 7
"""Outcome code of a world with no traffic drawn at the start; `UndrawableError` ends the drive."""
IDLE = -1
"""Outcome code of a world that drives no test."""


class Outcomes(NamedTuple):
    """How tests ended, one entry a test.

    Attributes:
        code: Outcome code.
        frame: Frame (0.1 s) of the crash, or of the end.
        slot_a, slot_b: Slots in contact, of a test that ended in a crash.
        bv_crashes: Crashes between BVs.
        decisions: Seconds begun.
        distance: How far the AV drove [m].
    """

    code: NDArray[np.uint8]
    frame: NDArray[np.int32]
    slot_a: NDArray[np.int16]
    slot_b: NDArray[np.int16]
    bv_crashes: NDArray[np.int16]
    decisions: NDArray[np.int32]
    distance: NDArray[np.float64]


def allocate_outcomes(n: int) -> Outcomes:
    """Allocate the outcomes of n tests."""
    return Outcomes(
        np.zeros(n, dtype=np.uint8),
        np.zeros(n, dtype=np.int32),
        np.zeros(n, dtype=np.int16),
        np.zeros(n, dtype=np.int16),
        np.zeros(n, dtype=np.int16),
        np.zeros(n, dtype=np.int32),
        np.zeros(n),
    )


@inlined_kernel
def write_outcome(w: World, out: Outcomes, k: int, road: RoadNumbers) -> None:
    """Write how a world's test ended as entry k."""
    state = w.state[0]
    out.code[k] = state.outcome
    out.frame[k] = state.frame
    out.slot_a[k] = state.slot_a
    out.slot_b[k] = state.slot_b
    out.bv_crashes[k] = state.bv_crashes
    out.decisions[k] = state.decisions
    out.distance[k] = w.agents[0].s if at_site(road.site) else driven(w.vehicles, 0, road)
