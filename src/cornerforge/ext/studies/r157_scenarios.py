"""The concrete scenarios of UN Regulation 157: cut-in, cut-out and deceleration of the lead, on grids.

Cars and rhythm are those of the public implementation of the reference drivers (Mattas et al. 2020, 2022).

- *Cut-in*: a slower car comes over from the right at a constant lateral speed. Speeds, gaps and lateral speeds are from
  the published verdicts (Mattas et al. 2022). The gap is the one at full lateral speed.
- *Cut-out*: the AV follows at a time gap of 2.0 s (the regulation, Annex 4, Appendix 3); the lead leaves to the right
  and uncovers a slower or a standing car. Grid points in which the lead itself would hit that car are left out.
- *Deceleration*: the AV follows; the lead brakes to a stand, up to 1 g (Appendix 3), built up at 12.65 m/s3. Time gaps
  reach from 1.0 s, the least that paragraph 5.2.3.3 lets it keep, to the 2.0 s of Appendix 3.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.careful import SCENARIOS, cut_in_poses
from cornerforge.drivers.rails import X, Y, keeps_on, move_aside, slow_down, way_before
from cornerforge.ext.studies.scenarios import (
    AV_LANE,
    KMH,
    LANE_WIDTH,
    LENGTH,
    WIDTH,
    Axis,
    Family,
    Panel,
    Suite,
    absent,
    follow,
    lane_centre,
)
from cornerforge.road.straight import along

__all__ = ["R157"]

_SECONDS = 37
"""Length of a test: 35 s and what a cut-in needs before to gain its lateral speed, in whole seconds."""
_JERK = 12.65
_FOLLOWING = 2.0

_CUT_INS = {20: (10,), 40: (10, 20, 30), 60: (10, 20, 30, 40, 50), 90: (10, 40, 70), 130: (10, 40, 70, 100)}
"""Speed of the AV -> speeds of the car that cuts in [km/h]."""
_SLOW = 60
"""Up to this speed of the AV [km/h] gaps are 1 to 59 m by 1 m, else 1 to 119 m by 2 m."""
_LATERAL = np.round(np.arange(0.1, 1.75, 0.1), 1)
_DECELERATIONS = np.array([*np.arange(1.0, 9.75, 0.5), 9.81])
_TIME_GAPS = np.round(np.arange(1.0, 2.05, 0.1), 1)


def _cut_ins(family: Family) -> Iterator[Panel]:
    for av, others in _CUT_INS.items():
        gaps = np.arange(1.0, 60.0) if av <= _SLOW else np.arange(1.0, 120.0, 2.0)
        for other in others:
            yield Panel(family, av, other, gaps, _LATERAL, np.ones((gaps.size, _LATERAL.size), dtype=np.bool_))


def _cut_outs(family: Family) -> Iterator[Panel]:
    for av in _CUT_INS:
        ahead = np.arange(5.0, 101.0, 5.0) if av <= _SLOW else np.arange(10.0, 201.0, 10.0)
        for other in (0, av // 2):
            out = np.array([[_gets_out(av, other, d, u) for u in _LATERAL] for d in ahead])
            yield Panel(family, av, other, ahead, _LATERAL, out)


def _decelerations(family: Family) -> Iterator[Panel]:
    for av in _CUT_INS:
        shape = (_TIME_GAPS.size, _DECELERATIONS.size)
        yield Panel(family, av, av, _TIME_GAPS, _DECELERATIONS, np.ones(shape, dtype=np.bool_))


def _gets_out(av_kmh: int, other_kmh: int, distance: float, lateral_speed: float) -> bool:
    """Does the lead of a cut-out pass the car ahead of it without touching it?"""
    poses = _cut_out(av_kmh / KMH, other_kmh / KMH, distance, lateral_speed)
    ahead = np.abs(along(poses[:, 1, X], poses[:, 2, X]))
    return not ((ahead < LENGTH) & (np.abs(poses[:, 2, Y] - poses[:, 1, Y]) < WIDTH)).any()


def _cut_in(av: float, other: float, gap: float, lateral_speed: float) -> NDArray[np.float64]:
    poses = absent(_SECONDS, 2)
    cut_in_poses(poses[:, 1], lane_centre(AV_LANE), av, other, gap, lateral_speed, AV_LANE)
    return poses


def _cut_out(av: float, other: float, distance: float, lateral_speed: float) -> NDArray[np.float64]:
    poses = absent(_SECONDS, 3)
    lead = _FOLLOWING * av + LENGTH
    keeps_on(poses[:, 1], lead, lane_centre(AV_LANE), av, AV_LANE)
    move_aside(poses[:, 1], way_before(lateral_speed) - LANE_WIDTH, lateral_speed, AV_LANE - 1)
    keeps_on(poses[:, 2], lead + distance + LENGTH, lane_centre(AV_LANE), other, AV_LANE)
    return poses


def _deceleration(av: float, other: float, time_gap: float, braking: float) -> NDArray[np.float64]:
    poses = follow(_SECONDS, time_gap * av, other)
    slow_down(poses[:, 1], braking, _JERK)
    return poses


_ASIDE = Axis("lateral_speed_mps", "lateral speed [m/s]")
R157 = Suite(
    "r157", "UN R157", _SECONDS,
    (
        Family(
            "cut-in", "Cut-ins: a slower car comes over from the right", Axis("gap_m", "gap [m]"), _ASIDE,
            SCENARIOS["cut-in"], _cut_ins, _cut_in, is_weighed=True,
        ),
        Family(
            "cut-out", "Cut-outs: the lead leaves to the right, a slower or standing car is uncovered",
            Axis("gap_ahead_of_lead_m", "gap ahead of the lead [m]"), _ASIDE, SCENARIOS["cut-out"], _cut_outs, _cut_out,
        ),
        Family(
            "deceleration", "Decelerations: the lead brakes to a stand", Axis("time_gap_s", "time gap [s]"),
            Axis("deceleration_mps2", "deceleration [m/s²]"), SCENARIOS["deceleration"], _decelerations, _deceleration,
        ),
    ),
    has_tests=False, meaning="A grid is no sample of the road: shares of scenarios are no rates.",
)  # fmt: skip
