"""Roads that come with cornerforge.

Lengths of acceleration and deceleration lanes are those of the German guideline for motorways (RAA 2008: 250 m); radii
of curves lie above its least one for 130 km/h (900 m) and for 100 km/h (470 m).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cornerforge.road.network import Lane, Marking, Road
from cornerforge.road.reference import ReferenceLine

__all__ = ["ROAD_FILES", "SHIPPED"]

_WIDTH = 3.66
_LIMIT = 33.3
_STRAIGHT = ((2000.0, 0.0, 0.0),)
_TIGHT, _WIDE = 1.0 / 700.0, 1.0 / 1000.0
_CURVES = (
    (200.0, 0.0, 0.0), (150.0, 0.0, _WIDE), (400.0, _WIDE, _WIDE), (150.0, _WIDE, 0.0), (150.0, 0.0, -_TIGHT),
    (350.0, -_TIGHT, -_TIGHT), (150.0, -_TIGHT, 0.0), (450.0, 0.0, 0.0),
)  # fmt: skip
_RAMP_FROM, _RAMP = 100.0, (600.0, 850.0)
_WEAVING = (600.0, 1000.0)
_OFF_RAMP = 300.0
_DROP = 900.0
_WORKS, _WORKS_LIMIT = (700.0, 1200.0), 22.2
_SOLID = (Marking(0.0, may_cross=False),)


def _road(name: str, slots: int, lanes: list[Lane], parts: tuple[tuple[float, float, float], ...] = _STRAIGHT) -> Road:
    """Make a road whose reference line is the left edge."""
    line = ReferenceLine.of_curvature(parts)
    centres = tuple(round((slot + 0.5 - slots) * _WIDTH, 6) for slot in range(slots))
    edged = [
        Lane(
            lane.slot, lane.begin, min(lane.end, line.length), lane.kind, lane.limit or _LIMIT,
            _SOLID if lane.slot == slots - 1 else lane.left, _SOLID if lane.slot == 0 else lane.right,
        )
        for lane in lanes
    ]  # fmt: skip
    return Road(name, line.pieces, line.length, _WIDTH, centres, tuple(edged))


def _through(slots: range) -> list[Lane]:
    return [Lane(slot, 0.0, float("inf")) for slot in slots]


def _on_ramp() -> Lane:
    return Lane(0, _RAMP_FROM, _RAMP[0], "ramp", left=_SOLID)


def _off_ramp(begin: float) -> Lane:
    return Lane(0, begin, begin + _OFF_RAMP, "ramp", left=_SOLID)


def _work_zone() -> Road:
    begin, end = _WORKS
    open_ = [
        Lane(slot, *part, limit=_WORKS_LIMIT if part == _WORKS else None)
        for slot in (0, 1) for part in ((0.0, begin), _WORKS, (end, float("inf")))
    ]  # fmt: skip
    closed = [Lane(2, 0.0, begin), Lane(2, begin, end, "closed"), Lane(2, end, float("inf"))]
    return _road("work-zone", 3, [*open_, *closed])


SHIPPED: dict[str, Callable[[], Road]] = {
    "straight": lambda: _road("straight", 3, _through(range(3))),
    "curves": lambda: _road("curves", 3, _through(range(3)), _CURVES),
    "on-ramp": lambda: _road("on-ramp", 4, [_on_ramp(), Lane(0, *_RAMP, "acceleration"), *_through(range(1, 4))]),
    "exit": lambda: _road("exit", 4, [Lane(0, *_RAMP, "deceleration"), _off_ramp(_RAMP[1]), *_through(range(1, 4))]),
    "weaving": lambda: _road(
        "weaving",
        4,
        [_on_ramp(), Lane(0, *_WEAVING, "deceleration"), _off_ramp(_WEAVING[1]), *_through(range(1, 4))],
    ),
    "lane-drop": lambda: _road("lane-drop", 3, [Lane(0, 0.0, _DROP), *_through(range(1, 3))]),
    "work-zone": _work_zone,
}
"""Roads by name: 2 km in the direction of travel, lanes 3.66 m wide. Ramps run beside the road, behind a solid line."""

ROAD_FILES = {"e6mini": Path(__file__).with_name("e6mini.json")}
"""Files of roads as they were built, by name, made by `road import`; `.LICENSE.txt` beside has source and licence."""
