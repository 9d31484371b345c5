"""Zones of a site: for two routes, the stretches of each along which bodies on them can touch."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from cornerforge._jit import kernel
from cornerforge._schema import Declared, meant
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.site.network import Route, Site, headings_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["BODY", "PERSON", "Zone", "ZoneKind", "with_entries_that_yield", "zones_of"]

ZoneKind = Literal["cross", "merge", "diverge", "shared", "weave"]
BODY, PERSON = (5.0, 2.0), (0.6, 0.6)
"""Length and width of a vehicle and of a person for which zones are found [m]."""
_STEP = 0.5
"""Places are tried so far apart [m]; zones are made wider by as much at each end."""
_ONE_LANE = 0.05
"""Where a route lies so near another, both are in one lane [m]."""
_SHORTEST = 2.0
"""Least stretch of one lane; routes that cross are as near for a moment [m]."""


class Zone(Declared):
    """Stretches of two routes along which bodies on them can touch.

    `of_first` and `of_second` are from where to where along each route the middle of a body may be in touch. Of two
    routes that are in one lane in between they are equally long, and a place of that lane lies equally far in both.
    """

    first: Annotated[int, meant("A route, by its index; less than the second.")]
    second: Annotated[int, meant("The other route.")]
    of_first: Annotated[tuple[float, float], meant("Along the first route.", "m")]
    of_second: Annotated[tuple[float, float], meant("Along the second route.", "m")]
    kind: Annotated[
        ZoneKind,
        meant(
            "cross; merge: both leave by one lane; diverge: both come by one; shared: by one to one; weave: between."
        ),
    ]
    first_yields: Annotated[bool, meant("The first route yields to the second.")]
    second_yields: Annotated[bool, meant("The second route yields to the first.")]


def zones_of(site: Site, width: float = BODY[1], length: float = BODY[0]) -> tuple[Zone, ...]:
    """Find the zones of a site, by the first route, then the second, then from where along the first.

    Bodies of `BODY` and `PERSON` are put every 0.5 m along both routes, and tried for touch; so a stretch is found to
    half a metre, and is made wider by that. Two routes that meet, part for more than a body's length and meet again
    have a zone for each meeting. Two routes of people have none. `width`, `length`: of the vehicles [m].
    """
    places = [_places(route) for route in site.routes]
    sizes = [PERSON if route.turn == "walk" else (length, width) for route in site.routes]
    found = []
    for second, two in enumerate(site.routes):
        for first, one in enumerate(site.routes[:second]):
            if one.turn == two.turn == "walk":
                continue
            touch = np.zeros((len(places[first]), len(places[second])), dtype=np.bool_)
            if not _touching(places[first], places[second], np.array([*sizes[first], *sizes[second]]), touch):
                continue
            met = [_meeting(one, two, stretch, places[first]) for stretch in _stretches(touch)]
            yields = _yielding(one, second, [a for a, _, _ in met]), _yielding(two, first, [b for _, b, _ in met])
            found += [
                Zone(
                    first=first, second=second, of_first=a, of_second=b, kind=kind,
                    first_yields=k in yields[0], second_yields=k in yields[1],
                )
                for k, (a, b, kind) in enumerate(met)
            ]  # fmt: skip
    return tuple(sorted(found, key=lambda zone: (zone.first, zone.second, zone.of_first)))


def with_entries_that_yield(site: Site) -> Site:
    """Let the route that has just entered yield where two meet without a signal and neither does.

    That one has come less far from its stop line; as far counts as no difference. The notes name each.
    """
    routes, notes = list(site.routes), list(site.notes)
    for zone in zones_of(site):
        if zone.kind == "diverge" or zone.first_yields or zone.second_yields:
            continue
        one, two = site.routes[zone.first], site.routes[zone.second]
        inside = zone.of_first[0] - one.stop, zone.of_second[0] - two.stop
        if min(one.signal, two.signal) >= 0 or abs(inside[0] - inside[1]) < BODY[0]:
            continue
        own, other, at = (zone.first, zone.second, zone.of_first) if inside[0] < inside[1] else (
            zone.second, zone.first, zone.of_second
        )  # fmt: skip
        route = routes[own]
        places = route.yields_at or (0.5 * (route.stop + route.leaves),) * len(route.yields_to)
        routes[own] = replace(route, yields_to=(*route.yields_to, other), yields_at=(*places, round(0.5 * sum(at), 3)))
        notes.append(f"{route.name} and {site.routes[other].name} meet and neither yielded; the first does now")
    return replace(site, routes=tuple(routes), notes=tuple(notes))


def _stretches(touch: NDArray[np.bool_]) -> list[tuple[slice, slice]]:
    """Find the parts of a table of touches that hang together, or lie less than a body's length apart on both."""
    from scipy.ndimage import binary_dilation, find_objects, label  # here, because it takes long to load

    near = round(BODY[0] / _STEP) // 2
    names, _ = label(binary_dilation(touch, np.ones((3, 3)), iterations=near))
    found: list[tuple[slice, slice]] = find_objects(np.where(touch, names, 0))
    return found


def _meeting(
    one: Route, two: Route, stretch: tuple[slice, slice], places: NDArray[np.float64]
) -> tuple[tuple[float, float], tuple[float, float], ZoneKind]:
    """Turn places in touch into a stretch of each route [m], and say how they meet."""
    a, b = (
        (max(0.0, _STEP * (part.start - 1.0)), min(route.length, _STEP * part.stop))
        for part, route in zip(stretch, (one, two), strict=True)
    )
    begin = a[0] == b[0] == 0.0 and bool(np.allclose(one.line[0], two.line[0], atol=1e-6))
    end = a[1] == one.length and b[1] == two.length and bool(np.allclose(one.line[-1], two.line[-1], atol=1e-6))
    at = np.minimum(_STEP * np.arange(stretch[0].start, stretch[0].stop), one.length)
    together = _in_one_lane(places[stretch[0], :2], at, two.line, two.along, b)
    if together is not None:
        a, b = _as_long(a, b, together, one.length, two.length)
    kind: ZoneKind = "shared" if begin and end else "diverge" if begin else "merge" if end else "cross"
    if kind == "cross" and together is not None:
        kind = "weave"
    return (round(a[0], 3), round(a[1], 3)), (round(b[0], 3), round(b[1], 3)), kind


def _in_one_lane(
    places: NDArray[np.float64], at: NDArray[np.float64], line: NDArray[np.float64], along: NDArray[np.float64],
    within: tuple[float, float],
) -> NDArray[np.float64] | None:  # fmt: skip
    """Find where the one lane of two routes begins and ends along each, ((begin, end), (begin, end)) [m]; or None.

    Args:
        places, at: Places on the first route, (P, 2) [m], and how far along it they are.
        line, along: Points of the second, and how far along it they are.
        within: Stretch of the second that is looked at [m].
    """
    ways = np.diff(line, axis=0)
    part = np.clip(((places[:, None] - line[:-1]) * ways).sum(axis=2) / (ways**2).sum(axis=1), 0.0, 1.0)
    away = np.hypot(*np.moveaxis(places[:, None] - line[:-1] - part[..., None] * ways, 2, 0))
    away[:, (along[1:] < within[0]) | (along[:-1] > within[1])] = np.inf
    nearest = away.argmin(axis=1)
    rows = np.arange(len(places))
    near = np.flatnonzero(away[rows, nearest] < _ONE_LANE)
    if near.size < 1 + _SHORTEST / _STEP:
        return None
    of_second = along[nearest] + part[rows, nearest] * np.diff(along)[nearest]
    return np.stack([at, of_second])[:, near[[0, -1]]]


def _as_long(
    a: tuple[float, float], b: tuple[float, float], together: NDArray[np.float64], *lengths: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Lengthen the shorter stretch before the one lane, and behind it, as far as its route goes."""
    before = max(together[0, 0] - a[0], together[1, 0] - b[0])
    behind = max(a[1] - together[0, 1], b[1] - together[1, 1])
    ends = np.clip(together + np.array([-before, behind]), 0.0, np.array(lengths)[:, None]).tolist()
    return tuple(ends[0]), tuple(ends[1])


def _yielding(route: Route, other: int, stretches: list[tuple[float, float]]) -> set[int]:
    """Say in which of its zones with another a route yields: in the nearest to each place where it does.

    `faults_of` tells of places that are too few.
    """
    if not route.yields_at:
        return set(range(len(stretches))) if other in route.yields_to else set()
    return {
        min(range(len(stretches)), key=lambda k: max(stretches[k][0] - at, at - stretches[k][1], 0.0))
        for index, at in zip(route.yields_to, route.yields_at, strict=False) if index == other
    }  # fmt: skip


def _places(route: Route) -> NDArray[np.float64]:
    """Give x, y and heading every 0.5 m along a route, (P, 3)."""
    at = np.append(np.arange(0.0, route.length, _STEP), route.length)
    headings = headings_of(route.line)
    columns = [np.interp(at, route.along, values) for values in (*route.line.T, headings)]
    return np.ascontiguousarray(np.stack(columns, axis=1))


@kernel
def _touching(
    a: NDArray[np.float64], b: NDArray[np.float64], sizes: NDArray[np.float64], out: NDArray[np.bool_]
) -> bool:
    """Mark at which places of each route a body touches one on the other; say whether there are any."""
    found = False
    for i in range(a.shape[0]):
        one = Box(a[i, 0], a[i, 1], a[i, 2], sizes[0], sizes[1])
        for j in range(b.shape[0]):
            if boxes_overlap(one, Box(b[j, 0], b[j, 1], b[j, 2], sizes[2], sizes[3])):
                out[i, j] = True
                found = True
    return found
