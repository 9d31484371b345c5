"""The interfaces of an AV from outside: what it is told, what it sees, what it may answer.

`Av` is interface 1: one array in, an acceleration and a lane order out, for many worlds at once. `Planner` (one world
at a time) and `PlannerForAll` (many at once) are interface 2: boxes with identities and road coordinates in, and out a
lane order, a curvature, a steering angle or a trajectory. At a site they see a `SiteScene` and answer by an
acceleration along their path. Deriving from them is optional.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cornerforge.foreign.scene import Scene, Scenes
    from cornerforge.foreign.site_scene import SiteScene, SiteScenes

__all__ = ["ANSWERS", "AT_SITES", "NEAREST", "VIEW_SHAPE", "Av", "AvContext", "Planner", "PlannerForAll", "RoadLane"]

AT_SITES = "acceleration"
"""What an AV at a site answers by, and none on a road."""
ANSWERS = ("lane", "curvature", "steering", "trajectory", AT_SITES)
"""What an AV of interface 2 may answer by; it says which one in its attribute `answers`."""
NEAREST = 12
"""So many of the nearest vehicles an AV of interface 2 sees, unless it says otherwise in its attribute `objects`; at a
site 24 (`site_scene.AGENTS`)."""

VIEW_SHAPE = (13, 8)
"""Rows and columns of the view (`cornerforge.sim.av_view`). An AV's process imports nothing of the simulator, so the
numbers stand here again, and a test holds them together."""


@dataclass(frozen=True)
class RoadLane:
    """One lane of a road whose lanes begin and end, along x from where the AV starts [m].

    Attributes:
        slot: Number of the lane, 0 the rightmost; lanes that follow each other have the same.
        kind: "through", "acceleration", "deceleration", or "ramp", which no vehicle may change into or out of.
        begin, end: From where to where it is there; -inf, inf: to the road's ends.
        leave_by: Where the AV, by its task, must have left it and the lanes that follow; inf: nowhere.
        limit: Speed limit [m/s]; inf: none is known.
    """

    slot: int
    kind: str
    begin: float = -inf
    end: float = inf
    leave_by: float = inf
    limit: float = inf


@dataclass(frozen=True)
class AvContext:
    """Facts of its world that an AV is told; constant in a run.

    Attributes:
        batch: Number of worlds B that are driven side by side; every view has B rows.
        n_lanes: Lanes of the road, 0 is the rightmost.
        lane_width: [m].
        vehicle_length, vehicle_width: Size of a car [m]; the view does not tell other classes (ODD `mixed`) from cars.
        max_speed: No vehicle is faster [m/s].
        lane_change_duration: Duration of an undisturbed lane change [s].
        interval: Time between two decisions of the AV [s].
        test_length: How far the AV drives in a test [m].
        view_version: Version of the view's columns (`cornerforge.sim.av_view`).
        seed: Seed of the run.
        set_speed: Speed at which the AV is to drive where nothing is in its way [m/s].
        wheelbase: Distance of the AV's axles [m]; its box's centre is halfway between them.
        most_lateral_acceleration: No AV that steers is faster in a bend [m/s2].
        task: What the AV is to do: drive "through", come from the "ramp", or take the "exit".
        lanes: Open lanes by slot and begin; empty on a road along which all lanes go on.
        site: Name of the site, "" on a road. At a site nothing but the AV's size and the interval says anything.
    """

    batch: int
    n_lanes: int
    lane_width: float
    vehicle_length: float
    vehicle_width: float
    max_speed: float
    lane_change_duration: float
    interval: float
    test_length: float
    view_version: int
    seed: int
    set_speed: float = 35.0
    wheelbase: float = 0.0
    most_lateral_acceleration: float = 8.0
    task: str = "through"
    lanes: tuple[RoadLane, ...] = ()
    site: str = ""

    def stated(self) -> dict[str, Any]:
        """All fields, for JSON: `task` and `lanes` only where lanes end, and of a lane no number that is infinite.

        `site` only at one.
        """
        about = asdict(self)
        if not self.site:
            del about["site"]
        task, lanes = about.pop("task"), about.pop("lanes")
        finite = [{name: value for name, value in lane.items() if value not in (-inf, inf)} for lane in lanes]
        return {**about, "task": task, "lanes": finite} if finite else about

    @staticmethod
    def of_stated(stated: dict[str, Any]) -> AvContext:
        """Make the context of which `stated` gave the fields."""
        return AvContext(**{**stated, "lanes": tuple(RoadLane(**lane) for lane in stated.get("lanes", ()))})

    @property
    def speed_limit(self) -> float:
        """Highest speed that is allowed anywhere on the road [m/s]."""
        return self.max_speed

    @property
    def route_lanes(self) -> tuple[int, ...]:
        """Lanes that lead to where the AV is to go: that of the exit, or those that it must leave nowhere."""
        if self.task == "exit":
            return tuple({one.slot for one in self.lanes if one.kind == "deceleration" and one.leave_by == inf})
        ended = {one.slot for one in self.lanes if one.leave_by < inf or one.kind == "ramp"}
        return tuple(slot for slot in range(self.n_lanes) if slot not in ended)

    def lane_ends_in(self, lane: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Compute how far ahead of x the AV must have left a lane; a vehicle needs half its length less.

        Args:
            lane: Number of the lane; one that is not on the road has ended.
            x: Place along the road, from where the AV started [m]; in a view, `test_length` minus column 1 of row 0.

        Returns:
            [m], in the shape of both together: inf where the lane goes on, or leads to the AV's exit; 0 where there is
            no lane, or a closed one.
        """
        slot, at = np.broadcast_arrays(np.asarray(lane), np.asarray(x, np.float64))
        if not self.lanes:
            return np.where((slot >= 0) & (slot < self.n_lanes), inf, 0.0)
        ahead = np.zeros(at.shape)
        for one in self.lanes:
            ahead = np.where((slot == one.slot) & (one.begin <= at) & (at < one.end), one.leave_by - at, ahead)
        return ahead

    def centre_line(self, lane: int, start: float, end: float, step: float = 5.0) -> NDArray[np.float64]:
        """Make the centre line of a lane from x = `start` to `end` [m], a point every `step` [m], (P, 2).

        Of a lane that begins or ends between them it is the first part that is there; (0, 2) where none is.
        """
        return self._line((lane + 0.5) * self.lane_width, *self._part((lane,), start, end), step)

    def edge(self, k: int, start: float, end: float, step: float = 5.0) -> NDArray[np.float64]:
        """Make an edge of a lane, likewise: edge k is right of lane k, edge `n_lanes` the left edge of the road."""
        return self._line(k * self.lane_width, *self._part((k - 1, k), start, end), step)

    def _part(self, slots: tuple[int, ...], start: float, end: float) -> tuple[float, float]:
        """Give the first part between two places along which a lane is in one of the slots; inf, inf: there is none."""
        if not self.lanes:
            return start, end
        there = sorted((one.begin, one.end) for one in self.lanes if one.slot in slots and one.end > start)
        first, last = inf, inf
        for begins, ends in there:
            if first == inf and begins < end:
                first, last = max(start, begins), min(end, ends)
            elif begins <= last:
                last = max(last, min(end, ends))
        return first, last

    @staticmethod
    def _line(y: float, start: float, end: float, step: float) -> NDArray[np.float64]:
        if start == inf:
            return np.zeros((0, 2))
        x = np.linspace(start, end, max(2, round((end - start) / step) + 1))
        return np.stack([x, np.full(x.size, y)], axis=1)


class Av(ABC):
    """An AV under test. Deriving from this class is optional: any class with a method `act` will do.

    The AV is made without arguments, in a process of its own. It drives B worlds side by side that know nothing of each
    other: world b is row b of every array. If its answer for a row depends only on that row, and on what it saw in that
    world since `reset`, results do not depend on batches, threads or resumes.
    """

    def setup(self, context: AvContext) -> None:  # noqa: B027 - to do nothing is the right default
        """Prepare for a run; called once, before the other methods."""

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:  # noqa: B027 - see setup
        """Forget the past of some worlds; called when new tests begin there.

        An AV without this method is taken to answer by what it sees at the moment alone.

        Args:
            worlds: Rows in which a test begins, (K,).
            seeds: For each row a number, 0 or more, that depends on the test alone, (K,): the seed for an AV that draws
                random numbers.
        """

    @abstractmethod
    def act(self, view: NDArray[np.float32]) -> NDArray[np.floating]:
        """Decide for all worlds; called every `context.interval`.

        Args:
            view: (B, 13, 8), SI units: row 0 the AV, then the vehicles nearest to it; columns: present, x ahead, y to
                the left, speed, lateral speed, acceleration now, lane, changes lanes (`cornerforge.sim.av_view` has the
                details). All zeros for a world that drives no test now; the answer for it is not used.

        Returns:
            (B, 2), numbers: acceleration [m/s2], cut to [-8, 2], and lane order: +1 left, 0 keep, -1 right, relative
            to the lane that the AV keeps or changes to. While a lane change runs, an order against it turns back and an
            order in its direction changes nothing; an order that would leave the road is not carried out, nor one to
            where no lane is, or into or out of a ramp.
        """


class Planner(ABC):
    """An AV of interface 2 that plans for one world at a time: any class with a method `plan` will do.

    For each test an instance is made without arguments, unless the class has a method `reset(seed)`, which is then
    called instead on an instance that drove before. An AV without a memory of its test says so: `memory = False`; one
    instance then serves all tests.

    Attributes:
        answers: "lane", "curvature", "steering" or "trajectory"; at a site "acceleration".
        objects: How many of the nearest vehicles it sees, `NEAREST` by default; None: all within 200 m.
        history: How many scenes before the present one it sees.
        memory: Whether an answer may depend on what was seen before in the test.
    """

    answers: str = "lane"
    objects: int | None
    history: int = 0
    memory: bool = True

    def setup(self, context: AvContext) -> None:  # noqa: B027 - to do nothing is the right default
        """Prepare for a run; called once on every instance."""

    @abstractmethod
    def plan(self, scene: Scene | SiteScene) -> ArrayLike:
        """Decide; called every `context.interval`.

        Returns:
            By `answers`:
            "lane": acceleration [m/s2], cut to [-8, 2], and lane order (`Av.act`).
            "curvature": acceleration and curvature [1/m], to the left positive; both hold until the next answer.
            "steering": acceleration and angle of the front wheels [rad]: curvature tan(angle) / wheelbase.
            "trajectory": (M, 3) to (M, 5), M >= 2: time from now [s], ascending; x, y of the box's centre [m] in the
            scene's coordinates; if given heading [rad] and speed [m/s]. It must reach to the next answer.
            "acceleration": along its path [m/s2], cut to [-8, 2]; the scene is a `SiteScene`.
            The vehicle's limits: `cornerforge.sim.bicycle`; following a trajectory: `cornerforge.foreign.tracking`.
        """


class PlannerForAll(ABC):
    """An AV of interface 2 that answers for many worlds at once: a class with `interface = 2` and a method `act`.

    Attributes:
        answers, objects, history: As for `Planner`.
    """

    interface: int = 2
    answers: str = "lane"
    objects: int | None
    history: int = 0

    def setup(self, context: AvContext) -> None:  # noqa: B027 - see Planner
        """Prepare for a run; called once, before the other methods."""

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:  # noqa: B027 - see Planner
        """Forget the past of some worlds, as `Av.reset`; an AV without this method has no memory."""

    @abstractmethod
    def act(self, scenes: Scenes | SiteScenes) -> Any:
        """Decide for all worlds; called every `context.interval`.

        Returns:
            As `Planner.plan`, for B worlds: (B, 2), at a site (B,), or trajectories (B, M, 3 to 5). A trajectory with fewer poses ends
            in rows whose time is NaN.
        """
