"""The concrete scenarios of UN Regulation 157: cut-in, cut-out and deceleration of the lead, on grids.

Two or three cars of 4.3 m x 1.9 m on lanes of 3.5 m, every tenth of a second, as in the public implementation of the
reference drivers (Mattas et al. 2020, 2022). The AV drives in the second lane from the right; the others are on rails.

- *Cut-in*: a slower car comes over from the right at a constant lateral speed. Speeds, gaps and lateral speeds are from
  the published verdicts (Mattas et al. 2022). The gap is the one at full lateral speed.
- *Cut-out*: the AV follows at a time gap of 2.0 s (the regulation, Annex 4, Appendix 3); the lead leaves to the right
  and uncovers a slower or a standing car. Grid points in which the lead itself would hit that car are left out.
- *Deceleration*: the AV follows; the lead brakes to a stand, up to 1 g (Appendix 3), built up at 12.65 m/s3. Time gaps
  reach from 1.0 s, the least that paragraph 5.2.3.3 lets it keep, to the 2.0 s of Appendix 3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.drivers.careful import cut_in_poses
from cornerforge.drivers.rails import POSE_NUMBERS, SPEED, X, Y, keeps_on, move_aside, slow_down, way_before
from cornerforge.errors import InputError
from cornerforge.road.straight import along
from cornerforge.sim import outcome, rails, scripted
from cornerforge.types import CAR, Odd

__all__ = ["FAMILIES", "Driven", "Panel", "panels", "rails_of_panel", "road_of_r157"]

FAMILIES = ("cut-in", "cut-out", "deceleration")
SECONDS = 37
"""Length of a test: 35 s and what a cut-in needs before to gain its lateral speed, in whole seconds."""
_FRAMES = 10 * SECONDS + 1
_LENGTH, _WIDTH, _LANE_WIDTH = 4.3, 1.9, 3.5
_AV_LANE = 1
_TEST_LENGTH = 2000.0
"""Longest way of any vehicle in that time [m]."""
_KMH = 3.6
_JERK = 12.65
_FOLLOWING = 2.0

_CUT_INS = {20: (10,), 40: (10, 20, 30), 60: (10, 20, 30, 40, 50), 90: (10, 40, 70), 130: (10, 40, 70, 100)}
"""Speed of the AV -> speeds of the car that cuts in [km/h]."""
_SLOW = 60
"""Up to this speed of the AV [km/h] gaps are 1 to 59 m by 1 m, else 1 to 119 m by 2 m."""
_LATERAL = np.round(np.arange(0.1, 1.75, 0.1), 1)
_SPEEDS = tuple(_CUT_INS)
_DECELERATIONS = np.array([*np.arange(1.0, 9.75, 0.5), 9.81])
_TIME_GAPS = np.round(np.arange(1.0, 2.05, 0.1), 1)


@dataclass(frozen=True)
class Panel:
    """The scenarios of one family and one pair of speeds, which make one small picture.

    Attributes:
        family: One of `FAMILIES`.
        av_kmh, other_kmh: Speeds of the AV and of the car that cuts in, is uncovered, or leads [km/h].
        across: Values along the picture's x axis: gap [m], of a cut-out from the lead to the car ahead of it [m], of a
            deceleration the time gap [s], (A,).
        up: Values along its y axis: lateral speed [m/s], or deceleration [m/s2], (B,).
        possible: Which points there are, (A, B); the others cannot be.
        first: Number of its first scenario; they follow each other along y, then x.
    """

    family: str
    av_kmh: int
    other_kmh: int
    across: NDArray[np.float64]
    up: NDArray[np.float64]
    possible: NDArray[np.bool_]
    first: int = 0

    @property
    def points(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The scenarios' values along x and y, (S,) each."""
        x, y = np.nonzero(self.possible)
        return self.across[x], self.up[y]

    def __len__(self) -> int:
        """Number of its scenarios."""
        return int(self.possible.sum())


@dataclass(frozen=True)
class Driven:
    """Outcomes of a panel's scenarios.

    Attributes:
        panel: The panel.
        code: Outcome of the AV, (S,).
        crashes: Whether each reference driver, and one that holds the speed, crashes, by name, bool (S,).
    """

    panel: Panel
    code: NDArray[np.uint8]
    crashes: Mapping[str, NDArray[np.bool_]]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Scenarios in which the AV gave usable answers, (S,)."""
        return np.asarray(self.code != outcome.AV_FAULT)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Scenarios in which the AV crashes, (S,)."""
        return np.asarray(self.code == outcome.AV_CRASH)

    def prevented(self, driver: str) -> NDArray[np.bool_]:
        """Scenarios in which the AV fails and the driver does not, (S,)."""
        return self.failed & ~self.crashes[driver]

    def cells(self, marks: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Lay marks of the scenarios, (S,), out as the picture's points, (A, B)."""
        found = np.zeros(self.panel.possible.shape, dtype=np.bool_)
        found[self.panel.possible] = marks
        return found


def road_of_r157(odd: Odd) -> Odd:
    """Make the road of the scenarios of an ODD: its lanes, limits and rhythm, cars and widths of Mattas et al."""
    return replace(
        odd,
        name="r157" if odd.name == "default" else f"r157-{odd.name}",
        lane_width=_LANE_WIDTH,
        vehicle_length=_LENGTH,
        vehicle_width=_WIDTH,
        test_length=_TEST_LENGTH,
        time_limit=float(SECONDS),
        av_start=0.0,
        traffic_length=50.0,
        truck_share=0.0,
        motorcycle_share=0.0,
    )


def panels(families: Iterable[str], odd: Odd) -> tuple[list[Panel], list[int]]:
    """List the panels of some families; a scenario has the same number whichever families are asked for.

    Args:
        families: Names of `FAMILIES`.
        odd: Its highest speed.

    Returns:
        The panels, and the speeds of the AV that the ODD does not allow [km/h].

    Raises:
        UnknownNameError: The family is unknown.
        InputError: None is given.
    """
    wanted = [check_in("family", one, FAMILIES) for one in families]
    if not wanted:
        raise InputError(f"No family of scenarios is given; there are {', '.join(FAMILIES)}.")
    every, first = [], 0
    for panel in _all_panels():
        every.append(replace(panel, first=first))
        first += len(panel)
    too_fast = sorted({one.av_kmh for one in every if one.av_kmh / _KMH > odd.max_speed})
    return [one for one in every if one.family in wanted and one.av_kmh not in too_fast], too_fast


def _all_panels() -> Iterator[Panel]:
    for av, others in _CUT_INS.items():
        gaps = np.arange(1.0, 60.0) if av <= _SLOW else np.arange(1.0, 120.0, 2.0)
        for other in others:
            yield Panel("cut-in", av, other, gaps, _LATERAL, np.ones((gaps.size, _LATERAL.size), dtype=np.bool_))
    for av in _SPEEDS:
        ahead = np.arange(5.0, 101.0, 5.0) if av <= _SLOW else np.arange(10.0, 201.0, 10.0)
        for other in (0, av // 2):
            out = np.array([[_gets_out(av, other, d, u) for u in _LATERAL] for d in ahead])
            yield Panel("cut-out", av, other, ahead, _LATERAL, out)
    for av in _SPEEDS:
        shape = (_TIME_GAPS.size, _DECELERATIONS.size)
        yield Panel("deceleration", av, av, _TIME_GAPS, _DECELERATIONS, np.ones(shape, dtype=np.bool_))


def _gets_out(av_kmh: int, other_kmh: int, distance: float, lateral_speed: float) -> bool:
    """Does the lead of a cut-out pass the car ahead of it without touching it?"""
    poses = _cut_out(av_kmh / _KMH, other_kmh / _KMH, distance, lateral_speed)
    ahead = np.abs(along(poses[:, 1, X], poses[:, 2, X]))
    return not ((ahead < _LENGTH) & (np.abs(poses[:, 2, Y] - poses[:, 1, Y]) < _WIDTH)).any()


def _lane_centre(lane: int) -> float:
    return (lane + 0.5) * _LANE_WIDTH


def _cut_in(av: float, other: float, gap: float, lateral_speed: float) -> NDArray[np.float64]:
    poses = np.full((_FRAMES, 2, POSE_NUMBERS), np.nan)
    cut_in_poses(poses[:, 1], _lane_centre(_AV_LANE), av, other, gap, lateral_speed, _AV_LANE)
    return poses


def _cut_out(av: float, other: float, distance: float, lateral_speed: float) -> NDArray[np.float64]:
    poses = np.full((_FRAMES, 3, POSE_NUMBERS), np.nan)
    lead = _FOLLOWING * av + _LENGTH
    keeps_on(poses[:, 1], lead, _lane_centre(_AV_LANE), av, _AV_LANE)
    move_aside(poses[:, 1], way_before(lateral_speed) - _LANE_WIDTH, lateral_speed, _AV_LANE - 1)
    keeps_on(poses[:, 2], lead + distance + _LENGTH, _lane_centre(_AV_LANE), other, _AV_LANE)
    return poses


def _deceleration(av: float, time_gap: float, braking: float) -> NDArray[np.float64]:
    poses = np.full((_FRAMES, 2, POSE_NUMBERS), np.nan)
    keeps_on(poses[:, 1], time_gap * av + _LENGTH, _lane_centre(_AV_LANE), av, _AV_LANE)
    slow_down(poses[:, 1], braking, _JERK)
    return poses


def rails_of_panel(panel: Panel, odd: Odd) -> rails.Rails:
    """Make starts and rails of a panel's scenarios. The AV is set to drive at the speed that it has.

    Args:
        panel: The panel.
        odd: Its road (`road_of_r157`).
    """
    av, other = panel.av_kmh / _KMH, panel.other_kmh / _KMH
    poses = [
        _cut_in(av, other, x, y) if panel.family == "cut-in"
        else _cut_out(av, other, x, y) if panel.family == "cut-out"
        else _deceleration(av, x, y)
        for x, y in zip(*panel.points, strict=True)
    ]  # fmt: skip
    return rails.rails_of(np.stack([_start(one[0], av, odd) for one in poses]), np.stack(poses), panel.first)


def _start(poses: Sequence[NDArray[np.float64]] | NDArray[np.float64], speed: float, odd: Odd) -> NDArray[np.void]:
    """Make the states of the AV and of the vehicles on rails (N, POSE_NUMBERS) at frame 0."""
    state = dict.fromkeys(scripted.START_FIELDS, 0.0) | {
        "target_lane": _AV_LANE, "lanes": 1 << _AV_LANE, "length": _LENGTH, "width": _WIDTH, "kind": CAR,
        "quantile": 0.5, "habit": 0.5, "change_time": odd.lane_change_duration, "inattention": 1.0,
    }  # fmt: skip
    rows = []
    for slot, pose in enumerate(poses):
        place = (0.0, _lane_centre(_AV_LANE), speed) if slot == 0 else (pose[X], pose[Y], pose[SPEED])
        at = dict(zip(("x", "y", "speed"), place, strict=True)) | {"desired_speed": place[2], "signals": slot == 0}
        rows.append([float(value) for value in (state | at).values()])
    return scripted.scripted_start(np.array(rows))
