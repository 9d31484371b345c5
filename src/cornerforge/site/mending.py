"""Sites mended where their sources are wrong or unlike a street, each mending named in the notes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cornerforge.errors import InputError
from cornerforge.site.network import STEP, Route, Site
from cornerforge.site.zones import zones_of

__all__ = ["with_approaches", "with_kerbs", "with_limit"]

_LEAST, _STEP, _MOST = 0.5, 0.5, 6.0
"""A person at the kerb stands so far beside every vehicle's way; a crosswalk is lengthened by steps, and so far [m]."""
_FIRST = 3
"""A lane is led back in the direction of so many of its points, which are rounded."""


def with_kerbs(site: Site) -> Site:
    """Lengthen crosswalks straight on until people at both ends stand beside every vehicle's way.

    The notes name each crosswalk that was lengthened.
    """
    for _ in range(round(_MOST / _STEP)):
        in_a_lane = [
            zone.second for zone in zones_of(site)
            if site.routes[zone.second].turn == "walk" and zone.of_second[0] < _LEAST
        ]  # fmt: skip
        if not in_a_lane:
            break
        for k in dict.fromkeys(in_a_lane):
            site = _begun_earlier(site, k)
    return site


def _begun_earlier(site: Site, k: int) -> Site:
    """Begin crosswalk k a step earlier, and let the way back end there."""
    old = site.routes[k].points
    first, second = np.array(old[0]), np.array(old[1])
    begin = first + _STEP * (first - second) / np.hypot(*(first - second))
    new = ((round(float(begin[0]), 3), round(float(begin[1]), 3)), *old[1:])
    ways = {old: new, old[::-1]: new[::-1]}
    routes = tuple(
        replace(one, points=ways[one.points], leaves=round(one.leaves + _STEP, 3)) if one.points in ways else one
        for one in site.routes
    )
    note = f"crosswalk {site.routes[k].name} began in a lane; it is lengthened to the kerb"
    return replace(site, routes=routes, notes=tuple(dict.fromkeys([*site.notes, note])))


def with_limit(site: Site, limit: float) -> Site:
    """Let one speed limit [m/s] hold on all routes of vehicles; turns stay as slow as their radius demands."""
    routes = tuple(one if one.turn == "walk" else replace(one, limits=(limit, limit)) for one in site.routes)
    found = sorted(3.6 * speed for k in site.vehicles for speed in site.routes[k].limits)
    note = f"the limit is {3.6 * limit:g} km/h; the source has {found[0]:.0f} to {found[-1]:.0f} km/h"
    return replace(site, routes=routes, notes=(*site.notes, note))


def with_approaches(site: Site, metres: float) -> Site:
    """Lead lanes straight back until they begin so far before their stop lines.

    Raises:
        InputError: A lane would come into the way of others, or meet them in another manner.
    """
    lanes: dict[tuple[str, tuple[float, float]], list[Route]] = {}
    for route in (site.routes[k] for k in site.vehicles):
        lanes.setdefault((route.approach, route.points[0]), []).append(route)
    routes, notes = list(site.routes), list(site.notes)
    for own in lanes.values():
        steps = math.ceil((metres - min(route.stop for route in own)) / STEP - 1e-3)
        if steps > 0:
            notes.append(f"the approach {own[0].approach} is led straight back by {steps * STEP:g} m")
            back = own[0].line[0] - own[0].line[_FIRST]
            line = own[0].line[0] + np.arange(steps, 0, -1)[:, None] * STEP * back / np.hypot(*back)
            points = tuple((round(x, 3), round(y, 3)) for x, y in line.tolist())
            routes = [_begun_before(one, points) if one in own else one for one in routes]
    longer = replace(site, routes=tuple(routes), notes=tuple(dict.fromkeys(notes)))
    before, after = ({(one.first, one.second, one.kind) for one in zones_of(which)} for which in (site, longer))
    for first, second, _ in sorted(before ^ after):
        raise InputError(
            f"approach = {metres:g} m leads {routes[first].name} into the way of {routes[second].name}; take less."
        )
    return longer


def _begun_before(route: Route, points: tuple[tuple[float, float], ...]) -> Route:
    """Begin a route with points that lie a metre apart."""
    more = len(points) * STEP
    return replace(
        route,
        points=(*points, *route.points),
        stop=round(route.stop + more, 3),
        leaves=round(route.leaves + more, 3),
        yields_at=tuple(round(at + more, 3) for at in route.yields_at),
    )
