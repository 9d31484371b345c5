"""The interface of a foreign AV: three methods, called for many worlds at once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["VIEW_SHAPE", "Av", "AvContext"]

VIEW_SHAPE = (13, 8)
"""Rows and columns of the view (`cornerforge.sim.av_view`). An AV's process imports nothing of the simulator, so the
numbers stand here again, and a test holds them together."""


@dataclass(frozen=True)
class AvContext:
    """What an AV is told of its world; constant in a run.

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
