"""All that is constant in a run, as kernels take it: road, AV, naturalistic model, and controllers of the vehicles."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cornerforge.sim.controllers import STEERED

if TYPE_CHECKING:
    from cornerforge.drivers.avs import AvNumbers
    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.controllers import Controllers

__all__ = ["Setting"]


class Setting(NamedTuple):
    """All that is constant in a run.

    Attributes:
        road: The road and the limits of the ODD.
        av: The AV under test.
        tables: The naturalistic model.
        who: The controllers.
    """

    road: RoadNumbers
    av: AvNumbers
    tables: NddTables
    who: Controllers

    def with_drivers(self, **changed: object) -> Setting:
        """Copy the setting with other controllers, by the fields of `Controllers`; for Python, not for kernels."""
        return self._replace(who=self.who._replace(**changed))  # type: ignore[arg-type]

    def with_set_speed(self, speed: float) -> Setting:
        """Copy the setting with an AV that drives at another speed where nothing is in its way [m/s]."""
        return self._replace(av=self.av._replace(idm=self.av.idm._replace(desired_speed=speed)))

    @property
    def answer_width(self) -> int:
        """Count of the numbers in an answer of an AV outside the kernels; for Python, not for kernels.

        Two, an acceleration [m/s2] and a lane order. From an AV that steers (STEERED) two for each tenth of a second
        until it answers again, an acceleration [m/s2] and a curvature [1/m].
        """
        return 2 * int(self.road.av_substeps) if self.who.av == STEERED else 2
