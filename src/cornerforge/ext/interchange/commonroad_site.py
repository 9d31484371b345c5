"""A site in CommonRoad 2020a: lanelets, crosswalks, traffic lights and the intersection.

A light has CommonRoad's cycle of whole time steps and an offset from step 0. Its green does not say whether the way has
to yield, and a flashing Don't Walk is red: CommonRoad has no letters for them. Who yields where both are green is not
in its files either.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.interchange.site_lanes import SiteLane, lanes_at
from cornerforge.site.network import Site
from cornerforge.site.signals import clock_of, letters_over
from cornerforge.types import FRAME_S, Scenario

__all__ = ["SiteInCommonRoad", "site_in_commonroad"]

_LANELET, _LIGHT, _INTERSECTION = 10_000, 20_000, 30_000
_COLOURS = {"r": "red", "y": "yellow", "g": "green", "G": "green"}
_SUCCESSORS = {"right": "successorsRight", "straight": "successorsStraight", "left": "successorsLeft"}


class SiteInCommonRoad(NamedTuple):
    """Elements of the file, and the lanelets in which the AV's route ends."""

    lanelets: list[str]
    lights: list[str]
    intersection: str
    goals: list[int]


def site_in_commonroad(scenario: Scenario, site: Site) -> SiteInCommonRoad:
    """Write a site; step 0 is the first frame of the recording."""
    lanes = lanes_at(site)
    clock = clock_of(scenario)
    lights = {(n, signal): _LIGHT + i for i, (n, signal) in enumerate(
        (n, signal) for n, lane in enumerate(lanes) if lane.part in ("approach", "walk")
        for signal in sorted({site.routes[k].signal for k in lane.routes} - {-1})
    )}  # fmt: skip
    route = int(scenario.target_lane[0, 0])
    ends = [_LANELET + n for n, lane in enumerate(lanes) if route in lane.routes and not lane.behind]
    return SiteInCommonRoad(
        [_lanelet(n, lane, [light for (of, _), light in lights.items() if of == n]) for n, lane in enumerate(lanes)],
        [_light(site, lanes[n], signal, light, clock) for (n, signal), light in lights.items()],
        _intersection(site, lanes), ends,
    )  # fmt: skip


def _lanelet(n: int, lane: SiteLane, lights: list[int]) -> str:
    def bound(name: str, points: NDArray[np.float64]) -> str:
        text = "".join(f"<point><x>{x:.6f}</x><y>{y:.6f}</y></point>" for x, y in points.tolist())
        return f"<{name}>{text}</{name}>\n"

    left, right = lane.sides
    links = "".join(f'<{name} ref="{_LANELET + other}"/>' for name, found in
                    (("predecessor", lane.before), ("successor", lane.behind)) for other in found)  # fmt: skip
    stop = ""
    if lane.part == "approach":
        ends = "".join(f"<point><x>{x:.6f}</x><y>{y:.6f}</y></point>" for x, y in (left[-1], right[-1]))
        of = "".join(f'<trafficLightRef ref="{light}"/>' for light in lights)
        stop = f"<stopLine>{ends}<lineMarking>solid</lineMarking>{of}</stopLine>\n"
    refs = "".join(f'<trafficLightRef ref="{light}"/>' for light in lights)
    walks = lane.part == "walk"
    users = "<userBidirectional>pedestrian</userBidirectional>" if walks else "<userOneWay>vehicle</userOneWay>"
    return (
        f'<lanelet id="{_LANELET + n}">\n{bound("leftBound", left)}{bound("rightBound", right)}{links}\n{stop}'
        f"<laneletType>{'crosswalk' if walks else 'urban'}</laneletType>\n{users}\n{refs}</lanelet>\n"
    )


def _light(site: Site, lane: SiteLane, signal: int, light: int, clock: float) -> str:
    """Write a light by what the route shows in each time step of a cycle."""
    k = next(k for k in lane.routes if site.routes[k].signal == signal)
    steps = round(sum(phase.seconds for phase in site.programme) / FRAME_S)
    letters = letters_over(site, k, FRAME_S * (np.arange(steps) + 0.5))
    colours = ["red" if lane.part == "walk" and letter == "y" else _COLOURS[letter] for letter in letters.tolist()]
    cycle = "".join(f"<cycleElement><duration>{len(list(group))}</duration><color>{colour}</color></cycleElement>"
                    for colour, group in itertools.groupby(colours))  # fmt: skip
    x, y = (lane.line[0] if lane.part == "walk" else lane.line[-1]).tolist()
    return (
        f'<trafficLight id="{light}"><cycle>{cycle}<timeOffset>{-round(clock / FRAME_S) % steps}</timeOffset></cycle>'
        f"<position><point><x>{x:.6f}</x><y>{y:.6f}</y></point></position><active>true</active></trafficLight>\n"
    )


def _intersection(site: Site, lanes: list[SiteLane]) -> str:
    """Write where each approach leads; ways back are left turns there."""
    text = [f'<intersection id="{_INTERSECTION}">\n']
    for n, lane in enumerate(lanes):
        if lane.part != "approach":
            continue
        ways = {name: [other for other in lane.behind if _turn(site, lanes[other]) == turn]
                for turn, name in _SUCCESSORS.items()}  # fmt: skip
        refs = "".join(f'<{name} ref="{_LANELET + other}"/>' for name, found in ways.items() for other in found)
        text.append(
            f'<incoming id="{_INTERSECTION + 1 + n}"><incomingLanelet ref="{_LANELET + n}"/>{refs}</incoming>\n'
        )
    return "".join([*text, "</intersection>\n"])


def _turn(site: Site, lane: SiteLane) -> str:
    turn = site.routes[lane.routes[0]].turn
    return "left" if turn == "back" else turn
