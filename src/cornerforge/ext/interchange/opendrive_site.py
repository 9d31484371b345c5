"""A site as ASAM OpenDRIVE 1.7: each lane a road of its own, those within the junction its connecting roads.

The reference line is the middle of the lane, whose left half a lane offset brings back. Between two points it is a
cubic that has the lane's direction at both. Crosswalks are objects of the first connecting road. Signals stand at stop
lines; OpenDRIVE has no place for their programme, nor for who yields beyond the order of priority.
"""

from __future__ import annotations

import hashlib
import itertools

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.interchange.openscenario_elements import quoted
from cornerforge.ext.interchange.site_lanes import SiteLane, lanes_at
from cornerforge.library.out_case import safe_name
from cornerforge.site.network import Site

__all__ = ["site_file"]

_JUNCTION, _FIRST_ROAD = 1, 100
_STEPS = 16


def site_file(site: Site) -> tuple[str, str]:
    """Make the file of a site: its name and its text. Two files of one name are the same."""
    text = "".join(_pieces(site))
    return f"site-{safe_name(site.name)}-{hashlib.sha256(text.encode()).hexdigest()[:8]}.xodr", text


def _pieces(site: Site) -> list[str]:
    lanes = lanes_at(site)
    roads = [n for n, lane in enumerate(lanes) if lane.part != "walk"]
    inner = [n for n in roads if lanes[n].part == "inner"]
    walks = [lane for lane in lanes if lane.part == "walk"]
    text = [
        '<?xml version="1.0" encoding="UTF-8"?>\n<OpenDRIVE>\n'
        f'<header revMajor="1" revMinor="7" name={quoted(site.name)} version="1" vendor="cornerforge"/>\n'
    ]
    for n in roads:
        text.append(_road(site, lanes, n, walks if n == inner[0] else []))
    text.append(f'<junction id="{_JUNCTION}" name={quoted(site.name)}>\n')
    for number, n in enumerate(n for n in inner if lanes[n].before):
        came = lanes[n].before[0]
        text.append(
            f'<connection id="{number}" incomingRoad="{_FIRST_ROAD + came}" connectingRoad="{_FIRST_ROAD + n}" '
            'contactPoint="start"><laneLink from="-1" to="-1"/></connection>\n'
        )
    of_route = {k: n for n in inner for k in lanes[n].routes}
    pairs = [(other, k) for k in of_route for other in site.routes[k].yields_to if other in of_route]
    # Where each yields to the other at another place, neither is of higher priority.
    text += [
        f'<priority high="{_FIRST_ROAD + of_route[high]}" low="{_FIRST_ROAD + of_route[low]}"/>\n'
        for high, low in pairs
        if (low, high) not in pairs
    ]
    return [*text, "</junction>\n</OpenDRIVE>\n"]


def _road(site: Site, lanes: list[SiteLane], n: int, walks: list[SiteLane]) -> str:
    lane = lanes[n]
    is_inner = lane.part == "inner"
    links = "".join(_link(lanes, name, found, lane) for name, found in
                    (("predecessor", lane.before), ("successor", lane.behind)))  # fmt: skip
    geometry, length = _geometry(lane)
    wide, grows = lane.widths[0], (lane.widths[1] - lane.widths[0]) / length
    of_lane = "".join(f'<{name} id="-1"/>' for name, found in
                      (("predecessor", lane.before), ("successor", lane.behind)) if is_inner and found)  # fmt: skip
    names = ", ".join(site.routes[k].name for k in lane.routes)
    return (
        f'<road name={quoted(names)} length="{length:.6f}" id="{_FIRST_ROAD + n}" '
        f'junction="{_JUNCTION if is_inner else -1}">\n<link>{links}</link>\n'
        f'<type s="0" type="town"><speed max="{lane.limit:g}" unit="m/s"/></type>\n<planView>\n{geometry}</planView>\n'
        f'<lanes><laneOffset s="0" a="{0.5 * wide:.6f}" b="{0.5 * grows:.9f}" c="0" d="0"/><laneSection s="0">'
        '<center><lane id="0" type="none" level="false"><roadMark sOffset="0" type="none" color="standard"/></lane></center>'
        f'<right><lane id="-1" type="driving" level="false"><link>{of_lane}</link>'
        f'<width sOffset="0" a="{wide:.6f}" b="{grows:.9f}" c="0" d="0"/><roadMark sOffset="0" '
        f'type="{"none" if is_inner else "solid"}" color="white" width="0.12"/></lane></right></laneSection></lanes>\n'
        f"{_objects(lane, walks)}{_signals(site, n, lane, length)}</road>\n"
    )


def _link(lanes: list[SiteLane], name: str, found: list[int], lane: SiteLane) -> str:
    """Link a road: an inner one to the lane that it continues, others to the junction."""
    if not found:
        return ""
    if lane.part == "inner":
        point = "end" if name == "predecessor" else "start"
        return f'<{name} elementType="road" elementId="{_FIRST_ROAD + found[0]}" contactPoint="{point}"/>'
    if any(lanes[other].part == "inner" for other in found):
        return f'<{name} elementType="junction" elementId="{_JUNCTION}"/>'
    point = "end" if name == "predecessor" else "start"
    return f'<{name} elementType="road" elementId="{_FIRST_ROAD + found[0]}" contactPoint="{point}"/>'


def _geometry(lane: SiteLane) -> tuple[str, float]:
    """Write the reference line as cubics of Hermite from point to point; return it with its length [m]."""
    s, text, headings = 0.0, [], lane.headings
    for (a, h), (b, g) in itertools.pairwise(zip(lane.line, headings, strict=True)):
        chord = float(np.hypot(*(b - a)))
        end = _turned(b - a, -h)
        slope = chord * np.array([np.cos(g - h), np.sin(g - h)])
        start = np.array([chord, 0.0])
        c, d = 3.0 * end - 2.0 * start - slope, start + slope - 2.0 * end
        p = np.linspace(0.0, 1.0, _STEPS + 1)[:, None]
        length = float(np.hypot(*np.diff(start * p + c * p**2 + d * p**3, axis=0).T).sum())
        text.append(
            f'<geometry s="{s:.6f}" x="{a[0]:.6f}" y="{a[1]:.6f}" hdg="{h:.9f}" length="{length:.6f}">'
            f'<paramPoly3 pRange="normalized" aU="0" bU="{start[0]:.9f}" cU="{c[0]:.9f}" dU="{d[0]:.9f}" '
            f'aV="0" bV="0" cV="{c[1]:.9f}" dV="{d[1]:.9f}"/></geometry>\n'
        )
        s += round(length, 6)
    return "".join(text), s


def _turned(vector: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])


def _objects(lane: SiteLane, walks: list[SiteLane]) -> str:
    """Write crosswalks by their corners, seen from the begin of a road."""
    told = []
    for n, walk in enumerate(walks):
        left, right = walk.sides
        corners = [_turned(corner - lane.line[0], -float(lane.headings[0])) for corner in (*left, *right[::-1])]
        points = "".join(f'<cornerLocal u="{u:.4f}" v="{v:.4f}" z="0" height="0" id="{k}"/>'
                         for k, (u, v) in enumerate(corners))  # fmt: skip
        told.append(
            f'<object id="{n}" name="crosswalk {n}" type="crosswalk" s="0" t="0" zOffset="0" hdg="0" pitch="0" '
            f'roll="0" orientation="none"><outlines><outline id="0" closed="true" outer="true">{points}</outline>'
            "</outlines></object>\n"
        )
    return f"<objects>\n{''.join(told)}</objects>\n" if told else ""


def _signals(site: Site, n: int, lane: SiteLane, length: float) -> str:
    """Write one signal at the stop line for each letter of the programme that routes of this lane obey."""
    if lane.part != "approach":
        return ""
    held = sorted({site.routes[k].signal for k in lane.routes} - {-1})
    told = [
        f'<signal s="{length:.6f}" t="{-0.5 * lane.widths[1] - 0.5:.3f}" id="{100 * n + signal}" name="signal {signal}" '
        'dynamic="yes" orientation="+" zOffset="3" country="OpenDRIVE" type="1000001" subtype="-1" value="-1"/>\n'
        for signal in held
    ]
    return f"<signals>\n{''.join(told)}</signals>\n" if told else ""
