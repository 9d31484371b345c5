"""Lanes and lights of a site in OSI ground truth.

An approach and an exit are each a lane with its middle; all within the junction is one lane of type intersection, which
in OSI has no middle but the pairs of lanes that it joins. Each light is the bulb that is lit, over the end of the
approach or at the kerb. Where exactly ways lead and crosswalks lie is said by the road's file.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.interchange.site_lanes import SiteLane, lanes_at
from cornerforge.site.network import Site
from cornerforge.site.signals import clock_of, letters_over
from cornerforge.types import FRAME_S, Scenario

__all__ = ["SiteInOsi", "add_site", "site_in_osi"]

_LANE, _JUNCTION, _LIGHT = 10_000, 19_999, 20_000
"""First ids of lanes and lights, and the id of the junction; those of vehicles and people are their slots."""
_DRIVING, _INTERSECTION = 2, 4
_RED, _YELLOW, _GREEN = 2, 3, 4
_COLOURS = {"r": _RED, "y": _YELLOW, "g": _GREEN, "G": _GREEN}
_ICONS = {"straight": 3, "left": 4, "right": 7}
_NO_ICON, _WALK, _DONT_WALK = 2, 16, 17
_CONSTANT, _FLASHING = 3, 4
_HEIGHT = 5.0
"""Of lights above the ground [m]; the site does not say it."""


class SiteInOsi(NamedTuple):
    """A site, the letter of each route at each frame, (F, routes), and its lanes."""

    site: Site
    letters: NDArray[np.str_]
    lanes: list[SiteLane]


def site_in_osi(scenario: Scenario, site: Site) -> SiteInOsi:
    """Prepare what `add_site` writes."""
    times = clock_of(scenario) + FRAME_S * np.arange(len(scenario.x))
    letters = np.stack([letters_over(site, k, times) for k in range(len(site.routes))], axis=1)
    return SiteInOsi(site, letters, lanes_at(site))


def add_site(message: Any, made: SiteInOsi, frame: int) -> None:
    """Add the lights to a ground truth, and in the first frame the lanes, which do not change."""
    if frame == 0:
        _add_lanes(message, made.lanes)
    for n, lane in enumerate(made.lanes):
        if lane.part == "approach":
            held = {made.site.routes[k].signal: k for k in reversed(lane.routes)}
            for signal in sorted(held.keys() - {-1}):
                _add_light(message, made, frame, held[signal], lane.line[-1], float(lane.headings[-1]), n)
        elif lane.part == "walk":
            for k in lane.routes:
                if made.site.routes[k].signal >= 0:
                    line = made.site.routes[k].line
                    _add_light(message, made, frame, k, line[-1], float(np.arctan2(*(line[-1] - line[0])[::-1])), None)


def _add_lanes(message: Any, lanes: list[SiteLane]) -> None:
    junction = message.lane.add()
    junction.id.value, junction.classification.type = _JUNCTION, _INTERSECTION
    for n, lane in enumerate(lanes):
        if lane.part == "inner":
            for before, behind in itertools.product(lane.before, lane.behind):
                pair = junction.classification.lane_pairing.add()
                pair.antecessor_lane_id.value, pair.successor_lane_id.value = _LANE + before, _LANE + behind
        if lane.part not in ("approach", "exit"):
            continue
        of = message.lane.add()
        of.id.value, about = _LANE + n, of.classification
        about.type, about.centerline_is_driving_direction = _DRIVING, True
        for x, y in lane.line.tolist():
            about.centerline.add(x=x, y=y, z=0.0)
        pair = about.lane_pairing.add()
        (pair.successor_lane_id if lane.part == "approach" else pair.antecessor_lane_id).value = _JUNCTION


def _add_light(
    message: Any, made: SiteInOsi, frame: int, k: int, at: NDArray[np.float64], heading: float, lane: int | None
) -> None:
    """Add the bulb that is lit for a route."""
    route, letter = made.site.routes[k], str(made.letters[frame, k])
    walks = route.turn == "walk"
    light = message.traffic_light.add()
    light.id.value = _LIGHT + k
    place = light.base.position
    place.x, place.y, place.z = float(at[0]), float(at[1]), _HEIGHT
    light.base.orientation.yaw = float(np.arctan2(-np.sin(heading), -np.cos(heading)))  # it faces those that come
    about = light.classification
    about.color = _RED if walks and letter == "y" else _COLOURS[letter]
    about.icon = (_WALK if letter == "G" else _DONT_WALK) if walks else _icon(made, k)
    about.mode = _FLASHING if walks and letter == "y" else _CONSTANT
    if lane is not None:
        about.assigned_lane_id.add(value=_LANE + lane)


def _icon(made: SiteInOsi, k: int) -> int:
    """Choose an arrow where a signal is for one turn, else none."""
    turns = {route.turn for route in made.site.routes if route.signal == made.site.routes[k].signal}
    return _ICONS.get(turns.pop(), _NO_ICON) if len(turns) == 1 else _NO_ICON
