"""Zones of a site: for two routes, the stretches of each along which bodies on them can touch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from cornerforge._jit import kernel
from cornerforge._schema import Declared, meant
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.site.network import Route, Site, headings_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["BODY", "PERSON", "Zone", "ZoneKind", "zones_of"]

ZoneKind = Literal["cross", "merge", "diverge", "shared"]
BODY, PERSON = (5.0, 2.3), (0.6, 0.6)
"""Length and width of a vehicle and of a person for which zones are found [m]: of a delivery truck."""
_STEP = 0.5
"""Places are tried so far apart [m]; zones are made wider by as much at each end."""
_NONE = -1


class Zone(Declared):
    """Stretches of two routes along which bodies on them can touch.

    `of_first` and `of_second` are from where to where along each route the middle of a body may be in touch.
    """

    first: Annotated[int, meant("A route, by its index; less than the second.")]
    second: Annotated[int, meant("The other route.")]
    of_first: Annotated[tuple[float, float], meant("Along the first route.", "m")]
    of_second: Annotated[tuple[float, float], meant("Along the second route.", "m")]
    kind: Annotated[
        ZoneKind, meant("cross; merge: both leave by one lane; diverge: both come by one; shared: by one to one.")
    ]
    first_yields: Annotated[bool, meant("The first route yields to the second.")]
    second_yields: Annotated[bool, meant("The second route yields to the first.")]


def zones_of(site: Site) -> tuple[Zone, ...]:
    """Find the zones of a site, by the first route and then the second.

    Bodies of `BODY` and `PERSON` are put every 0.5 m along both routes, and tried for touch; so a stretch is found to
    half a metre, and is made wider by that. Two routes of people have no zone.
    """
    places = [_places(route) for route in site.routes]
    sizes = [PERSON if route.turn == "walk" else BODY for route in site.routes]
    found = []
    for second, two in enumerate(site.routes):
        for first, one in enumerate(site.routes[:second]):
            if one.turn == two.turn == "walk":
                continue
            a, b = places[first], places[second]
            stretch = np.full(4, _NONE, dtype=np.int64)
            _touching(a, b, np.array([*sizes[first], *sizes[second]]), stretch)
            if stretch[0] == _NONE:
                continue
            ends = [_widened(one, stretch[:2]), _widened(two, stretch[2:])]
            found.append(
                Zone(
                    first=first, second=second, of_first=ends[0], of_second=ends[1], kind=_kind(one, two),
                    first_yields=second in one.yields_to, second_yields=first in two.yields_to,
                )
            )  # fmt: skip
    return tuple(sorted(found, key=lambda zone: (zone.first, zone.second)))


def _kind(one: Route, two: Route) -> ZoneKind:
    """Say how two routes meet, by the places where they begin and end."""
    begin = bool(np.allclose(one.line[0], two.line[0], atol=1e-6))
    end = bool(np.allclose(one.line[-1], two.line[-1], atol=1e-6))
    return "shared" if begin and end else "diverge" if begin else "merge" if end else "cross"


def _places(route: Route) -> NDArray[np.float64]:
    """Give x, y and heading every 0.5 m along a route, (P, 3)."""
    at = np.append(np.arange(0.0, route.length, _STEP), route.length)
    headings = headings_of(route.line)
    columns = [np.interp(at, route.along, values) for values in (*route.line.T, headings)]
    return np.ascontiguousarray(np.stack(columns, axis=1))


def _widened(route: Route, stretch: NDArray[np.int64]) -> tuple[float, float]:
    """Turn the first and last place in touch into a stretch [m], wider by a step at each end."""
    begin, end = _STEP * (float(stretch[0]) - 1.0), _STEP * (float(stretch[1]) + 1.0)
    return round(max(0.0, begin), 3), round(min(route.length, end), 3)


@kernel
def _touching(
    a: NDArray[np.float64], b: NDArray[np.float64], sizes: NDArray[np.float64], out: NDArray[np.int64]
) -> None:
    """Find the first and the last places of each route at which a body touches one on the other; -1 for none."""
    for i in range(a.shape[0]):
        one = Box(a[i, 0], a[i, 1], a[i, 2], sizes[0], sizes[1])
        for j in range(b.shape[0]):
            if boxes_overlap(one, Box(b[j, 0], b[j, 1], b[j, 2], sizes[2], sizes[3])):
                if out[0] < 0:
                    out[0] = i
                    out[2] = j
                    out[3] = j
                out[1] = i
                out[2] = min(out[2], j)
                out[3] = max(out[3], j)
