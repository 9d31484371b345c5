"""Suites of concrete scenarios on grids: what a family of scenarios is, and how its cars stand and are driven.

Two or three cars of 4.3 m x 1.9 m on straight lanes of 3.5 m, every tenth of a second. The AV drives in the second lane
from the right; the others are on rails, so neither the traffic model nor its range of speeds matters. A suite is data:
`r157_scenarios.R157`, and `aeb_scenarios.AEB`, on a road with one open lane.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.drivers.careful import CAREFUL
from cornerforge.drivers.rails import POSE_NUMBERS, SPEED, X, Y, keeps_on
from cornerforge.errors import InputError
from cornerforge.road.network import Road
from cornerforge.sim import outcome, rails, scripted
from cornerforge.types import CAR, Odd

__all__ = [
    "AV_LANE", "KMH", "LANE_WIDTH", "LENGTH", "ROAD_AT", "WIDTH", "Axis", "Driven", "Family", "Panel", "Suite",
    "absent", "follow", "glued", "lane_centre", "panels", "rails_of_panel", "road_of_suite",
]  # fmt: skip

LENGTH, WIDTH, LANE_WIDTH = 4.3, 1.9, 3.5
AV_LANE = 1
KMH = 3.6
_TEST_LENGTH = 2000.0
"""Longest way of any vehicle in a scenario [m]."""
ROAD_AT = 100.0
"""Place of a suite's road at which the AV begins [m]."""


class Axis(NamedTuple):
    """Quantity along an axis of a picture: its column in files, its label."""

    column: str
    label: str


@dataclass(frozen=True)
class Family:
    """Scenarios of one kind.

    Attributes:
        name, head: Its name, and the head of its section.
        across, up: Axes of its pictures.
        scenario: What is danger for `cc-human` in it, a code of `drivers.careful.SCENARIOS`.
        panels: Function that lists its panels.
        poses: Function of the speeds of the AV and of the other [m/s], and of x and y: rails (F, N, POSE_NUMBERS).
        is_test: Function of x and y (S,): which scenarios a protocol demands.
        allowed_kmh: Function of the speeds of the AV and of the other [km/h]: the largest relative speed at contact
            that a regulation allows in such a test [km/h]; None: it says nothing of it.
        without: Reference drivers that are not meant for it, and do not count when all must pass.
        is_weighed: Recorded cut-ins say how often its scenarios happen (`r157_roads`).
    """

    name: str
    head: str
    across: Axis
    up: Axis
    scenario: int
    panels: Callable[[Family], Iterator[Panel]]
    poses: Callable[[float, float, float, float], NDArray[np.float64]]
    is_test: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]] = lambda x, _: x != x
    allowed_kmh: Callable[[int, int], float | None] = lambda av, other: None  # noqa: ARG005
    without: tuple[str, ...] = ()
    is_weighed: bool = False

    @property
    def all_in_words(self) -> str:
        """Name the reference drivers that count."""
        return f"all but {', '.join(self.without)}" if self.without else "all four"


@dataclass(frozen=True)
class Suite:
    """Families of scenarios that are driven and judged together.

    Attributes:
        name: Its name in commands.
        title: What people call its scenarios.
        seconds: Length of a scenario, whole seconds.
        families: Its families.
        has_tests: Its families say which scenarios a protocol demands; speeds at contact are told.
        meaning: What the text of a result says last.
        road: Its road, if it is not the ODD's lanes; x is 0 at `ROAD_AT` of it.
    """

    name: str
    title: str
    seconds: int
    families: tuple[Family, ...]
    has_tests: bool
    meaning: str
    road: Road | None = None

    @property
    def columns(self) -> list[str]:
        """Columns of what changes along the axes of its pictures, without the AV's speed, which has one already."""
        axes = [family.across for family in self.families] + [family.up for family in self.families]
        return [name for name in dict.fromkeys(axis.column for axis in axes) if name != "av_kmh"]


@dataclass(frozen=True)
class Panel:
    """The scenarios of one family and one pair of speeds, which make one small picture or a column of one.

    Attributes:
        family: Its family.
        av_kmh, other_kmh: Speeds of the AV and of the car that cuts in, is uncovered, or is ahead [km/h].
        across: Values along the picture's x axis, (A,).
        up: Values along its y axis, (B,).
        possible: Which points there are, (A, B); the others cannot be.
        first: Number of its first scenario; they follow each other along y, then x.
    """

    family: Family
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

    @property
    def tests(self) -> NDArray[np.bool_]:
        """Marks of the scenarios that a protocol demands, (S,)."""
        return self.family.is_test(*self.points)

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
        touch_kmh: Relative speed along the road at the AV's contact [km/h], (S,); NaN without one, or where it was not
            recorded.
    """

    panel: Panel
    code: NDArray[np.uint8]
    crashes: Mapping[str, NDArray[np.bool_]]
    touch_kmh: NDArray[np.float64]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Scenarios in which the AV gave usable answers, (S,)."""
        return np.asarray(self.code != outcome.AV_FAULT)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Scenarios in which the AV crashes, (S,)."""
        return np.asarray(self.code == outcome.AV_CRASH)

    @property
    def allowed_kmh(self) -> NDArray[np.float64]:
        """Largest relative speed at contact that a regulation allows [km/h], (S,); NaN where it says nothing."""
        allowed = self.panel.family.allowed_kmh(self.panel.av_kmh, self.panel.other_kmh)
        return np.where(self.panel.tests, np.nan if allowed is None else allowed, np.nan)

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Scenarios in which the AV touches at a higher speed than is allowed, (S,)."""
        return self.failed & (self.touch_kmh > self.allowed_kmh)

    @property
    def prevented_by_all(self) -> NDArray[np.bool_]:
        """Scenarios in which the AV fails and no reference driver does that counts in the family, (S,)."""
        count = [name for name in CAREFUL if name not in self.panel.family.without]
        return np.asarray(np.logical_and.reduce([self.prevented(name) for name in count]))

    def prevented(self, driver: str) -> NDArray[np.bool_]:
        """Scenarios in which the AV fails and the driver does not, (S,)."""
        return self.failed & ~self.crashes[driver]

    def cells(self, marks: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Lay marks of the scenarios, (S,), out as the picture's points, (A, B)."""
        found = np.zeros(self.panel.possible.shape, dtype=np.bool_)
        found[self.panel.possible] = marks
        return found


def glued(driven: Sequence[Driven]) -> list[Driven]:
    """Put panels of a family that are a column each beside each other, in one panel; others stay as they are."""
    if any(one.panel.across.size > 1 for one in driven):
        return list(driven)
    every = [one.panel for one in driven]
    across, possible = np.concatenate([p.across for p in every]), np.concatenate([p.possible for p in every])
    crashes = {name: np.concatenate([one.crashes[name] for one in driven]) for name in driven[0].crashes}
    code, touch = (np.concatenate([getattr(one, name) for one in driven]) for name in ("code", "touch_kmh"))
    return [Driven(replace(every[0], across=across, possible=possible), code, crashes, touch)]


def road_of_suite(suite: Suite, odd: Odd) -> Odd:
    """Make the road of a suite's scenarios of an ODD: its lanes, limits and rhythm, cars and widths of Mattas et al.

    Raises:
        InputError: The ODD has a road of its own, traffic that stops, or lanes other than those of the suite's road.
    """
    if odd.road is not None or odd.traffic != "free":
        raise InputError(
            f"The scenarios of {suite.name} are on a straight road, among vehicles on rails; leave out road, task and "
            "traffic."
        )
    if suite.road is not None and odd.n_lanes != suite.road.slots:
        raise InputError(f"The scenarios of {suite.name} have one open lane; leave out lanes = {odd.n_lanes}.")
    return replace(
        odd,
        road=suite.road,
        road_at=0.0 if suite.road is None else ROAD_AT,
        name=suite.name if odd.name == "default" else f"{suite.name}-{odd.name}",
        lane_width=LANE_WIDTH,
        vehicle_length=LENGTH,
        vehicle_width=WIDTH,
        test_length=_TEST_LENGTH,
        time_limit=float(suite.seconds),
        av_start=0.0,
        traffic_length=50.0,
        truck_share=0.0,
        motorcycle_share=0.0,
    )


def panels(suite: Suite, families: Iterable[str], odd: Odd) -> tuple[list[Panel], list[int]]:
    """List the panels of some families; a scenario has the same number whichever families are asked for.

    Args:
        suite: The suite.
        families: Names of its families.
        odd: Its highest speed.

    Returns:
        The panels, and the speeds of the AV that the ODD does not allow [km/h].

    Raises:
        UnknownNameError: The family is unknown.
        InputError: None is given.
    """
    names = tuple(family.name for family in suite.families)
    wanted = [check_in("family", one, names) for one in families]
    if not wanted:
        raise InputError(f"No family of scenarios is given; there are {', '.join(names)}.")
    every, first = [], 0
    for panel in (panel for family in suite.families for panel in family.panels(family)):
        every.append(replace(panel, first=first))
        first += len(panel)
    too_fast = sorted({one.av_kmh for one in every if one.av_kmh / KMH > odd.max_speed})
    return [one for one in every if one.family.name in wanted and one.av_kmh not in too_fast], too_fast


def lane_centre(lane: int) -> float:
    """Compute y of the middle of a lane [m]."""
    return (lane + 0.5) * LANE_WIDTH


def absent(seconds: int, vehicles: int) -> NDArray[np.float64]:
    """Make rails on which no vehicle is there yet, (F, N, POSE_NUMBERS)."""
    return np.full((10 * seconds + 1, vehicles, POSE_NUMBERS), np.nan)


def follow(seconds: int, gap: float, speed: float) -> NDArray[np.float64]:
    """Make rails of one vehicle that keeps its speed [m/s] at first a gap [m] ahead of the AV, in its lane."""
    poses = absent(seconds, 2)
    keeps_on(poses[:, 1], gap + LENGTH, lane_centre(AV_LANE), speed, AV_LANE)
    return poses


def rails_of_panel(panel: Panel, odd: Odd) -> rails.Rails:
    """Make starts and rails of a panel's scenarios. The AV is set to drive at the speed that it has.

    Args:
        panel: The panel.
        odd: Its road (`road_of_suite`).
    """
    av, other = panel.av_kmh / KMH, panel.other_kmh / KMH
    poses = [panel.family.poses(av, other, x, y) for x, y in zip(*panel.points, strict=True)]
    return rails.rails_of(np.stack([_start(one[0], av, odd) for one in poses]), np.stack(poses), panel.first)


def _start(poses: NDArray[np.float64], speed: float, odd: Odd) -> NDArray[np.void]:
    """Make the states of the AV and of the vehicles on rails (N, POSE_NUMBERS) at frame 0."""
    state = dict.fromkeys(scripted.START_FIELDS, 0.0) | {
        "target_lane": AV_LANE, "lanes": 1 << AV_LANE, "length": LENGTH, "width": WIDTH, "kind": CAR,
        "quantile": 0.5, "habit": 0.5, "change_time": odd.lane_change_duration, "inattention": 1.0,
    }  # fmt: skip
    rows = []
    for slot, pose in enumerate(poses):
        place = (0.0, lane_centre(AV_LANE), speed) if slot == 0 else (pose[X], pose[Y], pose[SPEED])
        at = dict(zip(("x", "y", "speed"), place, strict=True)) | {"desired_speed": place[2], "signals": slot == 0}
        rows.append([float(value) for value in (state | at).values()])
    return scripted.scripted_start(np.array(rows))
