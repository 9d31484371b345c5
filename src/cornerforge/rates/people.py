"""How often people crash on motorways, as the traffic of drawn models is held to it.

Crashes are counted: one of two vehicles is one crash and two crashed vehicles. The rate between background vehicles
counts crashes too; an AV's rate, per mile of the AV, counts crashed vehicles. Published rates of people, with units and
sources, are in `ext/evidence/benchmarks.csv`; this one is a row there too.
"""

from typing import NamedTuple

__all__ = ["MOTORWAY"]


class PeopleRate(NamedTuple):
    """Rate of people; `low` and `high` are ends of its range per vehicle-mile, equal where no range is given."""

    low: float
    high: float
    unit: str
    covers: str
    source: str


MOTORWAY = PeopleRate(
    0.8e-6, 0.8e-6, "crashes", "police-reported, motorways, same direction", "our estimate, not published"
)
