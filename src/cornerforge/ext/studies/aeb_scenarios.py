"""Car-to-car rear scenarios of tests of automatic emergency braking: the car ahead stands, is slower, or brakes.

Read: UN Regulation 152 (E/ECE/TRANS/505/Rev.3/Add.151 and its Amend.1: paragraphs 5.2.1.1 to 5.2.1.4 with the table of
largest relative impact speeds for M1, 6.4 and 6.5), by machine reading and summaries of others; Euro NCAP, Test
Protocol AEB Car-to-Car systems, version 4.3.1 of February 2024, sections 4.1.1 and 8.2.2, by its text.

- *Stationary* (R152 6.4, Euro NCAP CCRs) and *moving* (R152 6.5, CCRm), which drives at 20 km/h: the tests begin at a
  TTC of 4 s (Euro NCAP: T0). Pictures go on to a TTC of 0.5 s: an obstacle that is seen no sooner.
- *Braking* (CCRb): both drive at 50 km/h, 12 or 40 m apart; the lead brakes with 2 or 6 m/s2, reached within 1 s. The
  picture fills the points between. R152 has no such test.

Full overlap alone, and lanes beside are closed, as on a test track. Euro NCAP asks for AEB without warning up to 50
km/h in CCRs and for warnings above; its speeds up to 80 km/h are driven here, and the 42 km/h of R152.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.careful import SCENARIOS
from cornerforge.drivers.rails import slow_down
from cornerforge.ext.studies.scenarios import LANE_WIDTH, Axis, Family, Panel, Suite, follow
from cornerforge.road.network import Lane, Road
from cornerforge.road.reference import ReferenceLine

__all__ = ["AEB", "R152_KMH"]

_SECONDS = 20
_T0 = 4.0
"""TTC at which a test begins [s]."""
_TTCS = np.arange(0.5, _T0 + 0.1, 0.25)
_STANDING = (10, 15, 20, 25, 30, 35, 40, 42, 45, 50, 55, 60, 65, 70, 75, 80)
_MOVING, _MOVING_KMH = tuple(range(30, 85, 5)), 20
_BRAKING_KMH = 50
_HEADWAYS, _TESTED_HEADWAYS = np.arange(12.0, 41.0, 4.0), (12.0, 40.0)
_DECELERATIONS, _TESTED_DECELERATIONS = np.arange(2.0, 6.25, 0.5), (2.0, 6.0)
_REACHED_IN = 1.0
"""Time in which the lead's deceleration is reached [s]."""

R152_KMH = {10: 0, 15: 0, 20: 0, 25: 0, 30: 0, 35: 0, 40: 0, 42: 0, 45: 15, 50: 25, 55: 30, 60: 35}
"""R152, table of 5.2.1.4 for M1 in running order: relative speed -> largest relative impact speed [km/h]. At the
maximum mass 42 has 10; nothing is laden here."""
_FASTEST = 60
"""Speed of the vehicle up to which R152 asks for it [km/h]."""


def _allowed(av_kmh: int, other_kmh: int) -> float | None:
    return R152_KMH.get(av_kmh - other_kmh) if av_kmh <= _FASTEST else None


def _columns(speeds: tuple[int, ...], other_kmh: int, family: Family) -> Iterator[Panel]:
    """List the panels of a car ahead that keeps its speed: a column of the picture for each speed of the AV."""
    for av in speeds:
        yield Panel(family, av, other_kmh, np.array([float(av)]), _TTCS, np.ones((1, _TTCS.size), dtype=np.bool_))


def _keeps(av: float, other: float, _: float, ttc: float) -> NDArray[np.float64]:
    return follow(_SECONDS, ttc * (av - other), other)


def _at_t0(_: NDArray[np.float64], ttc: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(ttc == _T0)


def _brakings(family: Family) -> Iterator[Panel]:
    every = np.ones((_HEADWAYS.size, _DECELERATIONS.size), dtype=np.bool_)
    yield Panel(family, _BRAKING_KMH, _BRAKING_KMH, _HEADWAYS, _DECELERATIONS, every)


def _brakes(_: float, other: float, headway: float, braking: float) -> NDArray[np.float64]:
    poses = follow(_SECONDS, headway, other)
    slow_down(poses[:, 1], braking, braking / _REACHED_IN)
    return poses


def _is_ccrb(headway: NDArray[np.float64], braking: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.isin(headway, _TESTED_HEADWAYS) & np.isin(braking, _TESTED_DECELERATIONS)


_LINE = ReferenceLine.of_curvature(((2500.0, 0.0, 0.0),))
_TRACK = Road(
    "test-track", _LINE.pieces, _LINE.length, LANE_WIDTH, (-LANE_WIDTH, 0.0, LANE_WIDTH),
    tuple(Lane(slot, 0.0, _LINE.length, "through" if slot == 1 else "closed") for slot in range(3)),
)  # fmt: skip
_SPEED = Axis("av_kmh", "speed of the AV [km/h]")
_BEGIN = Axis("ttc_s", "TTC at the start [s]")
_IN_LANE = SCENARIOS["deceleration"]
AEB = Suite(
    "aeb", "tests of automatic emergency braking (UN R152, Euro NCAP)", _SECONDS,
    (
        Family(
            "stationary", "Stationary: the car ahead stands (R152 6.4, CCRs)", _SPEED, _BEGIN, _IN_LANE,
            partial(_columns, _STANDING, 0), _keeps, _at_t0, _allowed,
        ),
        Family(
            "moving", "Moving: the car ahead drives at 20 km/h (R152 6.5, CCRm)", _SPEED, _BEGIN, _IN_LANE,
            partial(_columns, _MOVING, _MOVING_KMH), _keeps, _at_t0, _allowed,
        ),
        Family(
            "braking", "Braking: both drive at 50 km/h, the car ahead brakes to a stand (CCRb)",
            Axis("headway_m", "headway [m]"), Axis("deceleration_mps2", "deceleration [m/s²]"), _IN_LANE, _brakings,
            _brakes, _is_ccrb, without=("reg157",),  # a formula for cut-ins, which touches in 70 of these 72
        ),
    ),
    has_tests=True,
    meaning="The tests are of systems that brake when a human does not, as late as they may; an AV drives itself, may "
    "brake earlier, and is held to the reference drivers: a touch that R152 allows is a failure here.",
    road=_TRACK,
)  # fmt: skip
