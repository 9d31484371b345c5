"""The measured speeds beside their aims, in one table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from measuring import Series, table
from versus_c import AIM as AIM_C

from cornerforge.work import default_threads

if TYPE_CHECKING:
    from scaling import Scaling
    from versus_c import Comparison
    from versus_highway_env import SmallWorld

__all__ = ["AIM_HIGHWAY_ENV", "render", "to_json"]

AIM_HIGHWAY_ENV = 5000.0
"""Times highway-env per core, 3 lanes and 20 BVs."""
AIM_WORLD_STEPS = 0.4e6
"""World-steps per second on two cores, 3 lanes and 20 BVs."""
AIM_CORE_HOURS = (4.0, 1.0)
"""Core-hours for the ground truth on two lanes: first step, aim."""
Row = tuple[str, Series, str, bool]


def _rows(small: SmallWorld, in_c: list[Comparison], growth: Scaling) -> list[Row]:
    """What, measured, the aim in words, is it met."""
    cores = default_threads()
    rows: list[Row] = [
        ("times highway-env, one core, 3 lanes and 20 BVs", small.ratio, f"{AIM_HIGHWAY_ENV:,.0f} or more",
         small.ratio.median >= AIM_HIGHWAY_ENV),
        (f"world-steps/s, {cores} cores, 3 lanes and 20 BVs", growth.twenty, f"{AIM_WORLD_STEPS:,.0f} on 2 cores",
         growth.twenty.median >= AIM_WORLD_STEPS),
    ]  # fmt: skip
    for result in in_c:
        share = result.ratio(1)
        rows.append((f"of C's speed, one core, {result.world}", share, f"{AIM_C:g} or more", share.median >= AIM_C))
    first, aim = AIM_CORE_HOURS
    for av, series in growth.ground_truth.items():
        hours = Series("core-hours", tuple(growth.core_hours(v) for v in series.values))
        words = f"{first:g}, then {aim:g}"
        rows.append((f"core-hours for the ground truth, 2 lanes, `{av}`", hours, words, hours.median <= first))
    return rows


def to_json(small: SmallWorld, in_c: list[Comparison], growth: Scaling) -> list[dict[str, object]]:
    """One object a row."""
    return [
        {"what": what, "aim": aim, "met": bool(met), **series.to_json()}
        for what, series, aim, met in _rows(small, in_c, growth)
    ]


def render(small: SmallWorld, in_c: list[Comparison], growth: Scaling) -> str:
    """The section's Markdown."""
    rows = [
        (what, *series.cells(), aim, "yes" if met else "**no**")
        for what, series, aim, met in _rows(small, in_c, growth)
    ]
    return table(("what", "median", "min", "max", "aim", "met"), rows)
