"""Faults of a site: what must be mended before anything drives there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from cornerforge.site.network import Route, Site, headings_of
from cornerforge.site.zones import Zone, zones_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["faults_of"]

_TIGHTEST = 3.0
"""Least radius of a route of vehicles [m]."""
_LONGEST_GAP = 1.5
"""Most distance of two points of a route of vehicles [m]."""
_ROUNDED = 2e-3
"""Places in files are rounded, so a route may seem shorter by so much [m]."""
_LETTERS = "Ggyr"
_AMBER = (2.0, 8.0)
"""Lengths of an amber light that are believed [s]; the MUTCD names 3 to 6 s (from memory)."""


def faults_of(site: Site, zones: tuple[Zone, ...] | None = None) -> list[str]:
    """List what is wrong with a site, a sentence each; nothing if it can be driven.

    Each route must be smooth and lie in order, two routes whose middles cross must have a zone, of two that meet not
    both may go first nor both wait without a signal, and no two signals may be green that lead into one zone, unless
    one yields.

    Args:
        site: The site.
        zones: Its zones, if they are known.
    """
    zones = zones_of(site) if zones is None else zones
    found = [fault for route in site.routes for fault in _of_route(route, site)]
    found += list(_of_crossings(site, zones))
    if wrong := list(_of_programme(site)):
        return found + wrong
    return [*found, *_of_priorities(site, zones), *_of_signals(site, zones)]


def _of_route(route: Route, site: Site) -> Iterator[str]:
    if len(route.points) < 2 or not np.isfinite(route.line).all():
        yield f"route {route.name} has no two points"
        return
    if not 0.0 <= route.stop <= route.leaves <= route.length + _ROUNDED:
        yield f"route {route.name}: its stop line and its end of the junction are not in order along it"
    if route.yields_at and len(route.yields_at) != len(route.yields_to):
        yield f"route {route.name} yields to {len(route.yields_to)} routes at {len(route.yields_at)} places"
    if any(not 0 <= k < len(site.routes) for k in route.yields_to):
        yield f"route {route.name} yields to a route that is not there"
    if route.turn == "walk":
        return
    steps = np.diff(route.along)
    if steps.min() <= 0.0 or steps.max() > _LONGEST_GAP:
        yield f"route {route.name} has points {steps.max():.1f} m apart; at most {_LONGEST_GAP:g} m, and above 0"
        return
    bend = np.abs(np.diff(headings_of(route.line))) / steps
    if bend.max() > 1.0 / _TIGHTEST:
        at = float(route.along[int(bend.argmax())])
        radius = 1.0 / float(bend.max())
        yield f"route {route.name} turns with a radius of {radius:.1f} m at {at:.0f} m; {_TIGHTEST:g} m is least"


def _of_crossings(site: Site, zones: tuple[Zone, ...]) -> Iterator[str]:
    """Find routes whose middles cross without a zone: found by segments, so zones are not asked about themselves."""
    known = {(zone.first, zone.second) for zone in zones}
    for second in range(len(site.routes)):
        for first in range(second):
            one, two = site.routes[first], site.routes[second]
            both_walk = one.turn == two.turn == "walk"
            if not both_walk and (first, second) not in known and _lines_cross(one.line, two.line):
                yield f"routes {one.name} and {two.name} cross without a zone"


def _lines_cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Do two broken lines share a point inside two of their parts?"""
    p, r = a[:-1, None], np.diff(a, axis=0)[:, None]
    q, s = b[None, :-1], np.diff(b, axis=0)[None]
    cross = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
    apart = q - p
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (apart[..., 0] * s[..., 1] - apart[..., 1] * s[..., 0]) / cross
        u = (apart[..., 0] * r[..., 1] - apart[..., 1] * r[..., 0]) / cross
    return bool(((t > 0.0) & (t < 1.0) & (u > 0.0) & (u < 1.0)).any())


def _of_priorities(site: Site, zones: tuple[Zone, ...]) -> Iterator[str]:
    for zone in zones:
        one, two = site.routes[zone.first], site.routes[zone.second]
        if zone.kind in ("diverge", "shared"):
            continue
        signals = one.signal >= 0 and two.signal >= 0
        if zone.first_yields and zone.second_yields and (not signals or _green_together(site, one, two)):
            yield f"routes {one.name} and {two.name} each yield to the other"
        if not signals and not zone.first_yields and not zone.second_yields:
            yield f"of routes {one.name} and {two.name} neither yields, and not both have a signal"


def _green_together(site: Site, one: Route, two: Route) -> bool:
    """Are the signals of two routes green at the same time in some phase?"""
    return any({phase.states[one.signal], phase.states[two.signal]} <= {"G", "g"} for phase in site.programme)


def _of_programme(site: Site) -> Iterator[str]:
    """Find phases without a letter for each signal."""
    most = max((route.signal for route in site.routes), default=-1)
    if most >= 0 and not site.programme:
        yield "routes have signals, but there is no programme"
    for k, phase in enumerate(site.programme):
        if len(phase.states) <= most or set(phase.states) - set(_LETTERS):
            yield f"phase {k} must have {most + 1} letters or more, of {', '.join(_LETTERS)}; it is {phase.states}"


def _of_signals(site: Site, zones: tuple[Zone, ...]) -> Iterator[str]:
    for k, phase in enumerate(site.programme):
        for zone in zones:
            one, two = site.routes[zone.first], site.routes[zone.second]
            if zone.kind in ("diverge", "shared") or min(one.signal, two.signal) < 0:
                continue
            letters = phase.states[one.signal], phase.states[two.signal]
            if letters == ("G", "G") and not zone.first_yields and not zone.second_yields:
                yield f"phase {k}: routes {one.name} and {two.name} are both green, and neither yields"
    for signal in {route.signal for route in site.routes if route.signal >= 0 and route.turn != "walk"}:
        yield from _of_amber(site, signal)


def _of_amber(site: Site, signal: int) -> Iterator[str]:
    """Find a green that ends without amber, or an amber of an unusual length."""
    letters = [phase.states[signal] for phase in site.programme]
    for k, letter in enumerate(letters):
        after = letters[(k + 1) % len(letters)]
        if letter in "Gg" and after == "r":
            yield f"signal {signal} goes from green to red without amber after phase {k}"
        seconds = site.programme[k].seconds
        if letter == "y" and letters[k - 1] != "y" and not _AMBER[0] <= seconds <= _AMBER[1]:
            yield f"signal {signal} is amber for {seconds:g} s; {_AMBER[0]:g} to {_AMBER[1]:g} s are usual"
