"""Lanes of a vehicle that changes lanes, as an AV sees them (docs/adr/0023-what-an-av-sees.md)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from cornerforge._checks import check_in, check_number

__all__ = [
    "BY_CENTRE", "BY_DECISION", "BY_MOTION", "DECIDED", "FOLLOWED", "HUMAN", "VISIBLE", "Sight",
    "SightNumbers", "numbers_of_sight",
]  # fmt: skip

BY_CENTRE, BY_DECISION, BY_MOTION = range(3)
_CODES = {"centre": BY_CENTRE, "decision": BY_DECISION, "motion": BY_MOTION}


@dataclass(frozen=True)
class Sight:
    """Way in which an AV sees other vehicles' lane changes.

    Attributes:
        by: "motion": a vehicle is in the lanes that its body touches, and in the lane that it moves towards from
            `offset` on. "decision": it is in its target lane as soon as its driver has decided, before it moves.
            "centre": it is in the lane of its centre only.
        offset: Distance of the vehicle's centre from the centre of the lane that it leaves, from which on it counts as
            entering the next lane. 0.375 m is the measure of UN R157 for the begin of a cut-in.
        indicators: By motion, a vehicle with its indicator on is in its target lane from the begin of its change on.
        perception_time: The AV sees `offset` passed this much later. 0.4 s is UN R157's time to perceive a risk.

    Raises:
        InputError: `by` is unknown, or a number is out of range.
    """

    by: str = "motion"
    offset: float = field(default=0.375, metadata={"unit": "m"})
    perception_time: float = field(default=0.0, metadata={"unit": "s"})
    indicators: bool = False

    def __post_init__(self) -> None:
        check_in("av.sight.by", self.by, tuple(_CODES))
        check_number("av.sight.offset", self.offset, low=0.0, high=3.0, unit="m")
        check_number("av.sight.perception_time", self.perception_time, low=0.0, high=2.0, unit="s")


class SightNumbers(NamedTuple):
    """`Sight` as compiled kernels take it: `by` as a code, then the same fields in the same units."""

    by: int
    offset: float
    perception_time: float
    indicators: bool


def numbers_of_sight(sight: Sight) -> SightNumbers:
    """Make the constants of a sight for the kernels."""
    return SightNumbers(_CODES[sight.by], sight.offset, sight.perception_time, sight.indicators)


DECIDED = SightNumbers(BY_DECISION, 0.0, 0.0, False)
"""How vehicles are counted."""
HUMAN = numbers_of_sight(Sight(indicators=True))
"""How BVs see each other and the AV when they decide on lanes."""
FOLLOWED = numbers_of_sight(Sight(offset=0.55))
"""How BVs see what they follow: when it is well off the centre of its old lane. An indicator makes none brake."""
VISIBLE = numbers_of_sight(Sight())
"""Sight that an AV from outside has."""
