"""Sites mended where their sources are wrong, each mending named in the notes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cornerforge.site.network import Site
from cornerforge.site.zones import zones_of

__all__ = ["with_kerbs"]

_LEAST, _STEP, _MOST = 0.5, 0.5, 6.0
"""A person at the kerb stands so far beside every vehicle's way; a crosswalk is lengthened by steps, and so far [m]."""


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
