"""How often people crash: published rates per vehicle-mile, each with its unit.

A crash of two vehicles is one crash and two crashed vehicles. The rate between background vehicles counts crashes; an
AV's rate, per mile of the AV, counts crashed vehicles: to compare it with a rate of crashes, double that one.
"""

from typing import NamedTuple

__all__ = ["ALL_ROADS", "FREEWAY_INJURIES", "MOTORWAY"]


class PeopleRate(NamedTuple):
    """Rate of people; `low` and `high` are ends of its range per vehicle-mile, equal where no range is given."""

    low: float
    high: float
    unit: str
    covers: str
    source: str


_ALL = 6_138_359 / 3.25e12
ALL_ROADS = PeopleRate(_ALL, _ALL, "crashes", "police-reported, all roads", "NHTSA 2023, doi:10.21949/rdm5-2086")
MOTORWAY = PeopleRate(
    0.8e-6, 0.8e-6, "crashes", "police-reported, motorways, same direction", "our estimate, not published"
)
FREEWAY_INJURIES = PeopleRate(
    0.7e-6, 2.4e-6, "crashed vehicles", "any injury reported, freeways", "Scanlon et al. 2024/2025, not checked"
)
