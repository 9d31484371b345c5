"""Writes cases as CommonRoad scenarios, 2020a XML.

CommonRoad's conventions are nearly ours: rectangle centres, y to the left, radians counter-clockwise, whole time steps.
Only its velocity is along the vehicle's own length, where ours is along the road. The road's right edge is y = 0;
lanelet 1 is the rightmost lane. The vehicle of slot s is obstacle 100 + s, the AV obstacle 100.

The AV's place has a planning problem: its start, and as the goal to be somewhere on the road at the last recorded step.
So it is solved by getting through without a contact, at any speed. The schema wants a planning problem in every file.

At a site the plane is the site's: `commonroad_site` writes its lanelets, lights and intersection.

What a case brings besides stands in the attribute `source`, the only one with free text that CommonRoad's own tools
keep: "cornerforge; name: value; name: value".
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_finite, check_in
from cornerforge._files import writing
from cornerforge.ext.interchange.commonroad_site import site_in_commonroad
from cornerforge.ext.interchange.site_lanes import within_a_turn
from cornerforge.library.out_case import Fact, OutCase, check_name, fact_of_text
from cornerforge.types import CLASSES, FRAME_S, Scenario

__all__ = ["AV_WAYS", "NO_DATE", "facts_of_source", "source_of_facts", "write_commonroad"]

AV_WAYS = ("both", "planning")
"""How the AV can be written: recorded, as an obstacle, with a planning problem beside it, or as the problem alone."""

NO_DATE = "1970-01-01"
"""The schema wants a date. This constant stands for no date: the same case gives the same bytes on any day."""
_OBSTACLE = 100
_PLANNING = 99
_AGAIN = 1000
"""Added to the id of a vehicle that comes back after it was away: an obstacle of CommonRoad has no gaps."""
_BEHIND, _AHEAD = 50.0, 250.0
"""How far the road goes on behind and ahead of all vehicles [m]."""
_SOURCE = "cornerforge"
_AFTER = 30
"""Frames for which the others go on after the record, where another AV drives."""

_STATE = (
    "<position><point><x>%.6f</x><y>%.6f</y></point></position><orientation><exact>%.6f</exact></orientation>"
    "<time><exact>%d</exact></time><velocity><exact>%.6f</exact></velocity>"
    "<acceleration><exact>%.6f</exact></acceleration>"
)
_LATER = f"<state>{_STATE}</state>\n"
_FIRST = f"<initialState>{_STATE}</initialState>\n"


def write_commonroad(case: OutCase, folder: Path, *, av: str = "both", date: str = NO_DATE) -> tuple[str, ...]:
    """Write a case as NAME.xml.

    Positions, speeds and angles have six decimals. Vehicles that were not there in frame 0 get the step at which they
    come as their first; the schema knows only step 0 there, CommonRoad's own reader takes both.

    Args:
        case: The case; the file gets its name.
        folder: Where to write; it is made.
        av: One of `AV_WAYS`. "both": all vehicles as recorded, the AV too. "planning": the AV is left out, so that a
            planner can take its place; its size then stands among the facts, and the others go straight on for 3 s
            after the record; the goal is at the end of that.
        date: When it was made, year-month-day.

    Returns:
        Names of the files written.

    Raises:
        InputError: The case's name is not allowed (`cases.check_name`), or a number is not finite.
        OutputError: The file cannot be written.
    """
    check_in("way to write the AV", av, AV_WAYS)
    check_name(case.name)
    facts = dict(case.facts)
    if av == "planning":
        facts |= {"av_length_m": float(case.scenario.length[0]), "av_width_m": float(case.scenario.width[0])}
    scenario = case.scenario if av == "both" else _prolonged(case.scenario)
    text = "".join(_pieces(scenario, facts, with_av=av == "both", date=date))
    name = f"{case.name}.xml"
    with writing(folder / name, "the CommonRoad scenario") as part:
        part.write_bytes(text.encode())
    return (name,)


def source_of_facts(facts: dict[str, Fact]) -> str:
    """Write facts as one line of text, in their order; unknown ones are left out.

    >>> source_of_facts({"av": "idm", "rate_per_mile": 1e-07, "note": "a; b", "judge": None})
    'cornerforge; av: idm; rate_per_mile: 1e-07; note: a, b'
    """
    known = [(name, value) for name, value in facts.items() if value is not None]
    return "; ".join([_SOURCE, *(f"{name}: {_plain(value)}" for name, value in known)])


def facts_of_source(source: str) -> dict[str, Fact]:
    """Read the line that `source_of_facts` wrote; a line of another program is one fact, `source`.

    >>> facts_of_source("cornerforge; av: idm; rate_per_mile: 1e-07; found: true")
    {'av': 'idm', 'rate_per_mile': 1e-07, 'found': True}
    >>> facts_of_source("highD")
    {'source': 'highD'}
    """
    first, *pairs = source.split("; ")
    if first != _SOURCE:
        return {"source": source}
    return {name: fact_of_text(text) for name, _, text in (pair.partition(": ") for pair in pairs)}


def _plain(value: Fact) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return "".join(c if c.isprintable() else " " for c in text).replace(";", ",")


def _prolonged(scenario: Scenario) -> Scenario:
    """Let all vehicles present at the end go straight on for some time: another AV may need longer."""
    after = FRAME_S * np.arange(1, _AFTER + 1)[:, None]
    last = {name: getattr(scenario, name)[-1:] for name in ("x", "y", "speed", "target_lane", "present")}
    more: dict[str, Any] = {name: np.repeat(values, _AFTER, axis=0) for name, values in last.items()}
    more["heading"] = more["acceleration"] = np.zeros_like(more["x"])
    if scenario.odd.site is not None:
        more["heading"] = np.repeat(scenario.heading[-1:], _AFTER, axis=0)
        more["y"] = more["y"] + more["speed"] * np.sin(more["heading"]) * after
    more["x"] = more["x"] + more["speed"] * np.cos(more["heading"]) * after
    longer: dict[str, Any] = {name: np.concatenate([getattr(scenario, name), more[name]]) for name in more}
    return replace(scenario, **longer)


def _pieces(scenario: Scenario, facts: dict[str, Fact], *, with_av: bool, date: str) -> Iterator[str]:
    """Make the file's text, piece by piece, in the order that the schema wants."""
    road, site = scenario.odd, None if scenario.odd.site is None else site_in_commonroad(scenario, scenario.odd.site)
    changes = np.unique(scenario.target_lane[scenario.present[:, 0], 0]).size > 1
    ways = f"{'<lane_change/>' if changes else '<lane_following/>'}<multi_lane/><no_oncoming_traffic/><parallel_lanes/>"
    tags = f"<highway/>{'<critical/>' if scenario.crash else ''}{ways}" if site is None else (
        f"<urban/>{'<critical/>' if scenario.crash else ''}<intersection/>"
    )  # fmt: skip
    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<commonRoad commonRoadVersion="2020a" benchmarkID="{_benchmark_id(scenario)}" date={quoteattr(date)} '
        f'author="cornerforge" affiliation="not stated" source={quoteattr(source_of_facts(facts))} '
        f'timeStepSize="{FRAME_S}">\n'
        "<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude>"
        f"</location>\n<scenarioTags>{tags}<simulated/></scenarioTags>\n"
    )
    if site is None:
        along = scenario.x[scenario.present]
        ends = float(along.min()) - _BEHIND, float(along.max()) + _AHEAD
        for lane in range(road.n_lanes):
            yield _lanelet(lane, road.n_lanes, road.lane_width, ends)
        goals = range(1, 1 + road.n_lanes)
    else:
        yield from site.lanelets
        yield from site.lights
        yield site.intersection
        goals = site.goals
    there = np.flatnonzero(scenario.present.any(axis=0)).tolist()  # at a site some come only after the end
    for column in there[0 if with_av else 1 :]:
        yield from _obstacles(scenario, column)
    yield _planning_problem(scenario, goals)
    yield "</commonRoad>\n"


def _benchmark_id(scenario: Scenario) -> str:
    """Name a scenario as CommonRoad does: Zamunda, the country of invented scenarios; seed and test, both from 1 on."""
    return f"ZAM_Cornerforge-{scenario.seed + 1}_{scenario.test + 1}_T-1"


def _lanelet(lane: int, lanes: int, width: float, ends: tuple[float, float]) -> str:
    """Write a lane, 0 the rightmost, as lanelet 1 + lane."""

    def bound(name: str, edge: int) -> str:
        points = "".join(f"<point><x>{x:.6f}</x><y>{edge * width:.6f}</y></point>" for x in ends)
        marking = "solid" if edge in (0, lanes) else "dashed"
        return f"<{name}>{points}<lineMarking>{marking}</lineMarking></{name}>\n"

    def beside(name: str, other: int) -> str:
        return f'<{name} ref="{1 + other}" drivingDir="same"/>\n' if 0 <= other < lanes else ""

    return (
        f'<lanelet id="{1 + lane}">\n{bound("leftBound", lane + 1)}{bound("rightBound", lane)}'
        f"{beside('adjacentLeft', lane + 1)}{beside('adjacentRight', lane - 1)}"
        "<laneletType>highway</laneletType><laneletType>mainCarriageWay</laneletType>\n"
        "<userOneWay>vehicle</userOneWay>\n</lanelet>\n"
    )


def _obstacles(scenario: Scenario, column: int) -> Iterator[str]:
    """Write a vehicle as an obstacle for each time that it is there without a break."""
    frames = np.flatnonzero(scenario.present[:, column])
    kind = CLASSES[scenario.kind[column]].name.replace("person", "pedestrian")
    shape = f"<length>{scenario.length[column]:.6f}</length><width>{scenario.width[column]:.6f}</width>"
    for again, span in enumerate(np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)):
        states = _states(scenario, column, span)
        later = _LATER * (len(states) - 1) % tuple(states[1:].ravel().tolist())
        yield (
            f'<dynamicObstacle id="{_OBSTACLE + int(scenario.slot[column]) + _AGAIN * again}">\n'
            f"<type>{kind}</type><shape><rectangle>{shape}</rectangle></shape>\n{_FIRST % tuple(states[0].tolist())}"
            f"{f'<trajectory>{chr(10)}{later}</trajectory>{chr(10)}' if later else ''}</dynamicObstacle>\n"
        )


def _states(scenario: Scenario, column: int, frames: NDArray[np.int64]) -> NDArray[np.float64]:
    """Make x, y, orientation, time step, velocity and acceleration at these frames, (F, 6)."""
    heading = scenario.heading[frames, column]
    along = scenario.speed[frames, column]
    states = np.stack(
        [
            scenario.x[frames, column],
            scenario.y[frames, column],
            within_a_turn(heading),
            frames.astype(np.float64),
            along if scenario.odd.site else along / np.cos(heading),
            scenario.acceleration[frames, column],
        ],
        axis=1,
    )
    check_finite(f"vehicle {scenario.slot[column]}", states)
    return states


def _planning_problem(scenario: Scenario, goals: Iterable[int]) -> str:
    """Write the AV's start, and the goal to be in one of these lanelets at the last step."""
    x, y, heading, _, velocity, acceleration = _states(scenario, 0, np.arange(1))[0].tolist()
    turned = scenario.heading[1:2, 0] - scenario.heading[:1, 0]
    yaw_rate = float(turned[0]) / FRAME_S if turned.size else 0.0
    last = max(len(scenario.x) - 1, 1)
    lanelets = "".join(f'<lanelet ref="{lanelet}"/>' for lanelet in goals)
    return (
        f'<planningProblem id="{_PLANNING}">\n'
        f"<initialState><position><point><x>{x:.6f}</x><y>{y:.6f}</y></point></position>"
        f"<velocity><exact>{velocity:.6f}</exact></velocity><orientation><exact>{heading:.6f}</exact></orientation>"
        f"<yawRate><exact>{yaw_rate:.6f}</exact></yawRate><slipAngle><exact>0</exact></slipAngle>"
        f"<time><exact>0</exact></time><acceleration><exact>{acceleration:.6f}</exact></acceleration></initialState>\n"
        f"<goalState><time><intervalStart>{last}</intervalStart><intervalEnd>{last}</intervalEnd></time>"
        f"<position>{lanelets}</position></goalState>\n</planningProblem>\n"
    )
