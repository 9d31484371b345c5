"""The interfaces of an AV from outside: what it is told, what it sees, what it may answer.

`Av` is interface 1: one array in, an acceleration and a lane order out, for many worlds at once. `Planner` (one world
at a time) and `PlannerForAll` (many at once) are interface 2: boxes with identities and road coordinates in, and out a
lane order, a curvature, a steering angle or a trajectory. Deriving from them is optional.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cornerforge.foreign.scene import Scene, Scenes

__all__ = ["ANSWERS", "NEAREST", "VIEW_SHAPE", "Av", "AvContext", "Planner", "PlannerForAll"]

ANSWERS = ("lane", "curvature", "steering", "trajectory")
"""What an AV of interface 2 may answer by; it says which one in its attribute `answers`."""
NEAREST = 12
"""So many of the nearest vehicles an AV of interface 2 sees, unless it says otherwise in its attribute `objects`."""

VIEW_SHAPE = (13, 8)
"""Rows and columns of the view (`cornerforge.sim.av_view`). An AV's process imports nothing of the simulator, so the
numbers stand here again, and a test holds them together."""


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

    @property
    def speed_limit(self) -> float:
        """Highest speed that is allowed anywhere on the road [m/s]."""
        return self.max_speed

    @property
    def route_lanes(self) -> tuple[int, ...]:
        """Lanes that lead to where the AV is to go: all lanes of a highway without exits."""
        return tuple(range(self.n_lanes))

    def centre_line(self, lane: int, start: float, end: float, step: float = 5.0) -> NDArray[np.float64]:
        """Make the centre line of a lane from x = `start` to `end` [m], a point every `step` [m], (P, 2)."""
        return self._line((lane + 0.5) * self.lane_width, start, end, step)

    def edge(self, k: int, start: float, end: float, step: float = 5.0) -> NDArray[np.float64]:
        """Make an edge of a lane, likewise: edge k is right of lane k, edge `n_lanes` the left edge of the road."""
        return self._line(k * self.lane_width, start, end, step)

    @staticmethod
    def _line(y: float, start: float, end: float, step: float) -> NDArray[np.float64]:
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
            order in its direction changes nothing; an order that would leave the road is not carried out.
        """


class Planner(ABC):
    """An AV of interface 2 that plans for one world at a time: any class with a method `plan` will do.

    For each test an instance is made without arguments, unless the class has a method `reset(seed)`, which is then
    called instead on an instance that drove before. An AV without a memory of its test says so: `memory = False`; one
    instance then serves all tests.

    Attributes:
        answers: "lane", "curvature", "steering" or "trajectory".
        objects: How many of the nearest vehicles it sees; None: all within 200 m.
        history: How many scenes before the present one it sees.
        memory: Whether an answer may depend on what was seen before in the test.
    """

    answers: str = "lane"
    objects: int | None = NEAREST
    history: int = 0
    memory: bool = True

    def setup(self, context: AvContext) -> None:  # noqa: B027 - to do nothing is the right default
        """Prepare for a run; called once on every instance."""

    @abstractmethod
    def plan(self, scene: Scene) -> ArrayLike:
        """Decide; called every `context.interval`.

        Returns:
            By `answers`:
            "lane": acceleration [m/s2], cut to [-8, 2], and lane order (`Av.act`).
            "curvature": acceleration and curvature [1/m], to the left positive; both hold until the next answer.
            "steering": acceleration and angle of the front wheels [rad]: curvature tan(angle) / wheelbase.
            "trajectory": (M, 3) to (M, 5), M >= 2: time from now [s], ascending; x, y of the box's centre [m] in the
            scene's coordinates; if given heading [rad] and speed [m/s]. It must reach to the next answer.
            The vehicle's limits: `cornerforge.sim.bicycle`; following a trajectory: `cornerforge.foreign.tracking`.
        """


class PlannerForAll(ABC):
    """An AV of interface 2 that answers for many worlds at once: a class with `interface = 2` and a method `act`.

    Attributes:
        answers, objects, history: As for `Planner`.
    """

    interface: int = 2
    answers: str = "lane"
    objects: int | None = NEAREST
    history: int = 0

    def setup(self, context: AvContext) -> None:  # noqa: B027 - see Planner
        """Prepare for a run; called once, before the other methods."""

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:  # noqa: B027 - see Planner
        """Forget the past of some worlds, as `Av.reset`; an AV without this method has no memory."""

    @abstractmethod
    def act(self, scenes: Scenes) -> Any:
        """Decide for all worlds; called every `context.interval`.

        Returns:
            As `Planner.plan`, for B worlds: (B, 2), or trajectories (B, M, 3 to 5). A trajectory with fewer poses ends
            in rows whose time is NaN.
        """
