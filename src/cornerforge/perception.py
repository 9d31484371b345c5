"""Perception of an AV: what it sees late, not at all, or not where it is (docs/adr/0081-perception.md)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, NamedTuple

from cornerforge._checks import check_number
from cornerforge._schema import check_fields, meant
from cornerforge.errors import InputError, UnknownNameError

__all__ = ["FARTHEST", "PERFECT", "Perception", "PerceptionNumbers", "numbers_of_perception", "perception_of"]

FARTHEST = 200.0
"""No AV sees a vehicle farther away than this along the road [m, centre to centre]."""
_TENTHS = 10


@dataclass(frozen=True)
class Perception:
    """How an AV perceives the other vehicles; its own motion it knows. All at their defaults: perfectly.

    Raises:
        InputError: A number is out of range, or the latency is no whole number of tenths of a second.
    """

    latency: Annotated[
        float,
        meant("It sees others as they were so long ago, carried on at the speed of then.", "s", 0, 1),
    ] = 0.0
    range: Annotated[float, meant("It sees no vehicle whose centre is farther away.", "m", 10, FARTHEST)] = FARTHEST
    dropout: Annotated[
        float, meant("Chance that it sees nothing of a vehicle for a second, for each vehicle and second.", "", 0, 0.5)
    ] = 0.0
    noise: Annotated[
        float,
        meant(
            "Standard deviation of where it sees a vehicle along the road; a third of it across the road.", "m", 0, 5
        ),
    ] = 0.0
    occlusion: Annotated[bool, meant("It does not see a vehicle that others hide wholly.")] = False

    def __post_init__(self) -> None:
        check_fields(self, "perception.")
        if abs(self.latency * _TENTHS - round(self.latency * _TENTHS)) > 1e-9:
            raise InputError(f"perception.latency = {self.latency:g} s; allowed: tenths of a second, such as 0.2.")
        for one in fields(self):
            if isinstance(one.default, float):
                object.__setattr__(self, one.name, float(getattr(self, one.name)))

    @property
    def is_random(self) -> bool:
        """Is any of it drawn?"""
        return self.dropout > 0.0 or self.noise > 0.0

    def in_words(self) -> str:
        """Say it as options do.

        >>> Perception(latency=0.5, occlusion=True).in_words()
        'latency=0.5,occlusion'
        """
        told = [(one.name, getattr(self, one.name)) for one in fields(self) if getattr(self, one.name) != one.default]
        return ",".join(name if value is True else f"{name}={value:g}" for name, value in told)


def perception_of(text: str) -> Perception | None:
    """Read a perception as options have it: "latency=0.2,range=120,dropout=0.01,noise=0.3,occlusion".

    Returns:
        None if it is perfect.

    Raises:
        UnknownNameError: A name is none of these.
        InputError: A part has no number, is there twice, or is out of range.
    """
    known = tuple(one.name for one in fields(Perception))
    given: dict[str, float | bool] = {}
    for part in filter(None, (one.strip() for one in text.split(","))):
        name, equals, number = (one.strip() for one in part.partition("="))
        if name not in known:
            raise UnknownNameError("part of a perception", name, known)
        if name in given:
            raise InputError(f"perception = {text!r}: {name} is there twice.")
        if name == "occlusion":
            if equals:
                raise InputError(f"perception = {text!r}: occlusion takes no number; write it alone.")
            given[name] = True
            continue
        try:
            given[name] = float(number)
        except ValueError as error:
            raise InputError(f"perception = {text!r}: write {name}=NUMBER, such as {name}=0.1.") from error
        check_number(f"perception.{name}", given[name], low=0.0, high=FARTHEST)
    found = Perception(**given)  # type: ignore[arg-type]
    return None if found == Perception() else found


class PerceptionNumbers(NamedTuple):
    """`Perception` as kernels take it.

    Attributes:
        on: It is not perfect.
        late: The latency in tenths of a second.
        range, dropout, noise, occlusion: As there.
    """

    on: bool
    late: int
    range: float
    dropout: float
    noise: float
    occlusion: bool


def numbers_of_perception(perception: Perception | None) -> PerceptionNumbers:
    """Make the constants of a perception for the kernels; None is the perfect one."""
    p = perception or Perception()
    return PerceptionNumbers(
        p != Perception(), round(p.latency * _TENTHS), p.range, p.dropout, p.noise, bool(p.occlusion)
    )


PERFECT = numbers_of_perception(None)
