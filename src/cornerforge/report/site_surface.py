"""The surface of a site: where asphalt is, which lines are on it, where lights stand and what they show.

Lanes are bands along the routes of vehicles, with lines at their edges where no other lane lies; crosswalks are bars
across the way of people, half a metre wide and every metre. A light is a stroke: on the stop line, in as many parts as
the lane has signals, from left to right; at the kerb where people begin to walk.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.site.network import Route, Site, headings_of
from cornerforge.site.signals import letters_over

__all__ = ["BAR", "Light", "SiteSurface", "changes_of", "site_surface"]

Points = NDArray[np.float64]

BAR, _EVERY = 0.5, 1.0
_NEAR = 0.03
"""So far may a simpler line lie beside the one that it stands for [m]."""
_LINE_STEP = 0.5
_INSIDE, _SAME, _SHORTEST = 0.4, 0.45, 3.0
"""An edge is not drawn so far within another lane, nor so near to one that is drawn, nor if it is so short [m]."""
_BESIDE, _SHOULDER = 1.5, 0.6
"""A kerb has no asphalt so far beside it; asphalt reaches so far beyond lanes [m]."""
_ORDER = {"back": 0, "left": 1, "straight": 2, "right": 3, "walk": 4}
_LIGHT_AT = 0.6
"""A light is shown so far before its stop line, or kerb [m]."""


class Light(NamedTuple):
    """A light: the stroke that shows it, from left to right, (2, 2) [m]; the route that it holds; whether of people."""

    at: Points
    route: int
    walks: bool


class SiteSurface(NamedTuple):
    """Outlines of lanes, (P, 2) each, clockwise; their edges, (P, 2); bars of crosswalks, (4, 2); stop lines, (2, 2).

    All in the world's plane [m].
    """

    lanes: tuple[Points, ...]
    edges: tuple[Points, ...]
    bars: tuple[Points, ...]
    stops: tuple[Points, ...]
    lights: tuple[Light, ...]


@lru_cache(maxsize=4)
def site_surface(site: Site) -> SiteSurface:
    """Find the surface of a site."""
    lanes: list[Points] = []
    stops: dict[tuple[int, ...], Points] = {}
    held: dict[tuple[int, ...], list[int]] = {}
    for k in site.vehicles:
        route = site.routes[k]
        left, right = (_simpler(side) for side in _sides(route)[1])
        lanes.append(np.concatenate([left, right[::-1]]))
        stop = _across(route, route.stop)
        stops.setdefault(_key(stop), stop)
        if route.signal >= 0:
            held.setdefault(_key(stop), []).append(k)
    ways = {_key(np.sort(site.routes[k].line[[0, -1]], axis=0)): site.routes[k] for k in site.people}
    lights = [light for routes in held.values() for light in _on_lane(site, routes)]
    lights += [
        Light(_across(site.routes[k], -_LIGHT_AT), k, walks=True) for k in site.people if site.routes[k].signal >= 0
    ]
    return SiteSurface(
        tuple(lanes), _edges(site), tuple(bar for way in ways.values() for bar in _bars(way)),
        tuple(stops[key] for key in stops), tuple(lights),
    )  # fmt: skip


def changes_of(site: Site, clock: float, frames: int, frame_s: float) -> list[list[tuple[int, str]]]:
    """Say from which frame on each light of `site_surface` shows which letter (`site.signals.letters_over`).

    Args:
        site: The site.
        clock: Time of its signals at frame 0 [s].
        frames: How many frames.
        frame_s: How long each lasts [s].
    """
    times = clock + frame_s * np.arange(frames)
    told = []
    for light in site_surface(site).lights:
        letters = letters_over(site, light.route, times)
        begins = np.flatnonzero(np.append(True, letters[1:] != letters[:-1]))
        told.append([(int(frame), str(letters[frame])) for frame in begins])
    return told


def _on_lane(site: Site, routes: list[int]) -> list[Light]:
    """Part the stop line of a lane among its signals, the leftmost way first."""
    routes = sorted(routes, key=lambda k: _ORDER[site.routes[k].turn])
    first = list({site.routes[k].signal: k for k in reversed(routes)}.values())[::-1]
    left, right = _across(site.routes[first[0]], site.routes[first[0]].stop - _LIGHT_AT)
    cuts = np.linspace(0.0, 1.0, len(first) + 1)
    ends = left + cuts[:, None] * (right - left)
    return [Light(ends[n : n + 2], k, walks=False) for n, k in enumerate(first)]


def _pose(route: Route, at: Points) -> tuple[Points, Points]:
    """Give the middle at places along a route, also before its begin, and the way to the left there, (P, 2) each."""
    inside = np.clip(at, 0.0, route.length)
    middle = np.stack([np.interp(inside, route.along, values) for values in route.line.T], axis=1)
    heading = np.interp(inside, route.along, headings_of(route.line))
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return middle + (at - inside)[:, None] * ahead, np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)


def _sides(route: Route) -> tuple[Points, tuple[Points, Points]]:
    """Give places along a route every half metre, (P,), and its left and right edge there, (P, 2) each [m]."""
    at = np.append(np.arange(0.0, route.length, _LINE_STEP), route.length)
    middle, left = _pose(route, at)
    aside = 0.5 * route.width * left
    return at, (middle + aside, middle - aside)


def _edges(site: Site) -> tuple[Points, ...]:
    """Give the edges of lanes where they lie in no other lane, each once; pieces that are too short are left out.

    Within the junction only those beside which there is no asphalt: kerbs.
    """
    routes = [site.routes[k] for k in site.vehicles]
    middles = np.concatenate([route.line for route in routes])
    half = np.concatenate([np.full(len(route.line), 0.5 * route.width) for route in routes])
    kept: list[Points] = []
    for route in routes:
        at, sides = _sides(route)
        within = (at > route.stop) & (at < route.leaves)
        for side, other in (sides, sides[::-1]):
            inside = (_distances(side, middles) < half - _INSIDE).any(axis=1)
            out = side + (side - other) * (_BESIDE / route.width)
            inside |= within & (_distances(out, middles) < half + _SHOULDER).any(axis=1)
            known = np.concatenate([np.empty((0, 2)), *kept])
            there = ~inside & ~(_distances(side, known) < _SAME).any(axis=1)
            cuts = np.flatnonzero(np.diff(there)) + 1
            for first, piece in zip(np.append(0, cuts), np.split(side, cuts), strict=True):
                if there[first] and len(piece) * _LINE_STEP >= _SHORTEST:
                    kept.append(piece)
    return tuple(_simpler(piece) for piece in kept)


def _distances(a: Points, b: Points) -> Points:
    """Compute the distances of points [m], (A, B)."""
    return np.asarray(np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1]))


def _across(route: Route, at: float) -> Points:
    """Give the left and the right end of a line across a route, (2, 2)."""
    (middle,), (left,) = _pose(route, np.array([at]))
    return np.stack([middle + 0.5 * route.width * left, middle - 0.5 * route.width * left])


def _bars(route: Route) -> list[Points]:
    """Give the bars of a crosswalk, (4, 2) each."""
    count = max(1, round(route.length / _EVERY))
    middles = (np.arange(count) + 0.5) * route.length / count
    bars = []
    for at in middles.tolist():
        begin, end = _across(route, at - 0.5 * BAR), _across(route, at + 0.5 * BAR)
        bars.append(np.concatenate([begin, end[::-1]]))
    return bars


def _simpler(line: Points) -> Points:
    """Leave out points of a line that lie within 3 cm of the rest (Ramer 1972, Douglas and Peucker 1973)."""
    if len(line) < 3:
        return line
    way = line[-1] - line[0]
    length = float(np.hypot(*way))
    beside = line[1:-1] - line[0]
    far = np.hypot(*beside.T) if length < _NEAR else np.abs(beside[:, 0] * way[1] - beside[:, 1] * way[0]) / length
    worst = int(np.argmax(far)) + 1
    if far[worst - 1] <= _NEAR:
        return line[[0, -1]]
    return np.concatenate([_simpler(line[: worst + 1])[:-1], _simpler(line[worst:])])


def _key(points: Points) -> tuple[int, ...]:
    """Name points by their decimetres, so that a lane of several routes counts once."""
    return tuple(np.rint(10.0 * points).astype(int).ravel().tolist())
