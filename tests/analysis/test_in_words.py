"""Sentences on crashes driven by hand: who moved, from which side, how close, how hard."""

from __future__ import annotations

from dataclasses import replace

import pytest
from driven_by_hand import Driver, mirrored, scenario_of

from cornerforge.analysis.in_words import avoidance_in_words, case_in_words, what_happened
from cornerforge.road.network import Lane, LaneKind, Road
from cornerforge.road.reference import ReferenceLine
from cornerforge.types import Scenario

CUT_IN = [Driver(0, 1, 35), Driver(46, 0, 25, ((1, 1),))]


@pytest.mark.parametrize(
    ("drivers", "text"),
    [
        (CUT_IN, "BV cuts in from the right at 31 m"),
        (
            [Driver(0, 1, 33), Driver(12, 0, 30, ((0, 1),), (1, 4, -4.0))],
            "BV cuts in from the right at 7 m with -4.0 m/s2",
        ),
        ([Driver(0, 1, 30), Driver(1, 0, 30, ((1, 1),))], "BV changes lanes from the right into the AV beside it"),
        ([Driver(0, 0, 30, ((1, 1),)), Driver(1, 1, 30)], "AV changes lanes from the right into the BV beside it"),
        ([Driver(0, 1, 25), Driver(-46, 0, 35, ((1, 1),))], "BV changes lanes from the right, 31 m behind the AV"),
        (
            [Driver(0, 1, 22), Driver(-48, 0, 35, ((1, 1), (3.2, 0)))],
            "BV changes lanes from the right, 30 m behind the AV",  # it turns back by less than can be seen
        ),
        ([Driver(0, 1, 30), Driver(15, 1, 30, braking=(3, 6, -4.0))], "BV brakes with -4.0 m/s2 in front of the AV"),
        ([Driver(0, 1, 30, braking=(3, 6, -4.0)), Driver(-15, 1, 30)], "AV brakes with -4.0 m/s2 in front of the BV"),
        (
            [Driver(0, 1, 30), Driver(40, 1, 25)],
            "AV runs into the rear of a BV that neither brakes hard nor changed lanes into its path",
        ),
    ],
)  # fmt: skip
def test_what_happened(drivers: list[Driver], text: str) -> None:
    scenario = scenario_of(drivers)
    assert what_happened(scenario) == text
    swapped = text.replace("the right", "the LEFT").replace("the left", "the right").replace("the LEFT", "the left")
    assert what_happened(mirrored(scenario)) == swapped


def on_a_road(scenario: Scenario, kind: LaneKind, until: float) -> Scenario:
    """The same recording on a road whose right lane is of a kind and ends there; the others go on."""
    odd, line = scenario.odd, ReferenceLine.of_curvature([(5000.0, 0.0, 0.0)])
    lanes = (Lane(0, 0.0, until, kind), *(Lane(slot, 0.0, 5000.0) for slot in range(1, odd.n_lanes)))
    centres = tuple((slot + 0.5) * odd.lane_width for slot in range(odd.n_lanes))
    road = Road("hand-made", line.pieces, 5000.0, odd.lane_width, centres, lanes)
    return replace(scenario, odd=replace(odd, road=road, road_at=100.0))


@pytest.mark.parametrize(
    ("kind", "until", "reason"),
    [
        ("acceleration", 700.0, ", merging from the ramp"), ("through", 700.0, ", as its lane ends"),
        ("through", 4000.0, ""), ("deceleration", 700.0, ""),
    ],
)  # fmt: skip
def test_the_road_tells_why_a_vehicle_changed_lanes(kind: LaneKind, until: float, reason: str) -> None:
    scenario = on_a_road(scenario_of(CUT_IN), kind, until)
    assert what_happened(scenario) == "BV cuts in from the right at 31 m" + reason


def test_the_road_tells_where_it_was() -> None:
    behind = scenario_of([Driver(0, 0, 30, braking=(3, 6, -4.0)), Driver(-15, 0, 30)])
    told = "AV brakes with -4.0 m/s2 in front of the BV"
    assert what_happened(on_a_road(behind, "acceleration", 700.0)) == told + ", on the acceleration lane"
    assert what_happened(on_a_road(behind, "through", 700.0)) == told + ", where the lane ends"
    assert what_happened(on_a_road(behind, "through", 5000.0)) == told


def test_the_whole_sentence() -> None:
    """No rate: how likely a sequence of actions is does not tell how often its kind of crash happens."""
    scenario = scenario_of(CUT_IN)
    assert case_in_words(scenario, avoidance_in_words("by braking", 1.2)) == (
        "BV cuts in from the right at 31 m; in hindsight avoidable by braking; last way out 1.2 s before contact"
    )
    assert avoidance_in_words("unavoidable", 1.2) == "in hindsight unavoidable"
    assert case_in_words(scenario, avoidance_in_words("undecided", None)).endswith("; no way out found, not all tried")
    assert avoidance_in_words(None, None) == ""
    assert case_in_words(scenario, "") == "BV cuts in from the right at 31 m"
