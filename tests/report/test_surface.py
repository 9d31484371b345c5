"""Where asphalt is, and which lines are on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.report.cases import case_data
from cornerforge.report.surface import TAPER, Surface, outline, strokes, surface_of
from cornerforge.road.lanes import lanes_of
from cornerforge.road.network import Marking
from cornerforge.types import Odd, Scenario

ROADS = ["straight", "curves", "on-ramp", "exit", "weaving", "lane-drop", "work-zone"]
W = 3.66


def on(name: str) -> Odd:
    """An ODD whose x is the road's s."""
    return replace(odd_on(Odd(), road_named(name)), road_at=0.0)


def asphalt(surface: Surface, s: float, y: float) -> bool:
    """Is there asphalt?"""
    for area in surface.areas:
        (begin, right), (end, right_end), (_, left_end), (_, left) = outline(area, -1e4, 1e4, 0.0)
        sides = np.interp(s, [begin, end], [right, right_end]), np.interp(s, [begin, end], [left, left_end])
        if begin <= s < end and sides[0] <= y < sides[1]:
            return True
    return False


def marks(surface: Surface, s: float, y: float) -> list[str]:
    """The lines along the road that cross a section at y."""
    along = [line for line in surface.lines if line.y == line.y_end and line.begin <= s < line.end]
    return [line.mark for line in along if abs(line.y - y) < 0.01]


@pytest.mark.parametrize("name", ROADS)
def test_asphalt_lies_in_lanes_and_ends_a_taper_beyond_them(name: str) -> None:
    odd = on(name)
    surface, lanes = surface_of(odd), lanes_of(odd)
    for slot in range(odd.n_lanes):
        mine = [lane for lane in lanes if lane.slot == slot]
        for s in np.arange(-300.0, 2300.0, 7.0).tolist():
            middle = (slot + 0.5) * W
            if any(lane.begin <= s < lane.end for lane in mine):
                assert asphalt(surface, s, middle)
            elif all(s < lane.begin - TAPER or s > lane.end + TAPER for lane in mine):
                assert not asphalt(surface, s, middle)


def test_a_lane_that_ends_becomes_narrower_towards_its_neighbour() -> None:
    surface = surface_of(on("lane-drop"))
    wide = [sum(asphalt(surface, 900.0 + s, y) for y in np.linspace(0.0, W, 101)[:-1]) for s in (-1, 1, 20, 39, 41)]
    assert wide == [100, 97, 50, 2, 0]
    assert [marks(surface, s, W) for s in (899.0, 901.0, 941.0)] == [["broken"], [], ["solid"]]
    assert (900.0, 0.0, 940.0, W, "solid") in surface.lines


def test_lines_say_what_lies_beside_them() -> None:
    ramp, works = surface_of(on("on-ramp")), surface_of(on("work-zone"))
    assert [marks(ramp, s, W) for s in (50.0, 300.0, 700.0, 870.0, 900.0)] == [
        ["solid"],
        ["solid"],
        ["wide"],
        [],
        ["solid"],
    ]
    assert [marks(works, s, 2 * W) for s in (600.0, 900.0, 1300.0)] == [["broken"], ["barrier"], ["broken"]]
    assert (700.0, 2 * W, 700.0, 3 * W, "barrier") in works.lines


def test_a_ramp_comes_from_beside_the_road() -> None:
    surface = surface_of(on("on-ramp"))
    assert not asphalt(surface, 70.0, 0.9 * W)
    assert asphalt(surface, 70.0, -0.4 * W)


def test_a_border_that_one_side_may_cross_has_two_lines() -> None:
    base = road_named("straight")
    lanes = tuple(
        replace(lane, left=(Marking(0.0, may_cross=False),)) if lane.slot == 0 else lane for lane in base.lanes
    )
    surface = surface_of(Odd(road=replace(base, lanes=lanes)))
    beside = [line for line in surface.lines if 0.0 < abs(line.y - W) < 0.2]
    assert [(line.y < W, line.mark) for line in beside] == [(True, "solid"), (False, "broken")]


def test_strokes_are_dashes_of_the_line_within_the_span() -> None:
    broken = surface_of(Odd()).lines[1]
    assert strokes(broken, -13.0, 14.0) == [((a, W), (b, W)) for a, b in ((-12.0, -9.0), (0.0, 3.0), (12.0, 14.0))]
    (hatch,) = (line for line in surface_of(on("work-zone")).lines if line.mark == "hatch")
    painted = strokes(hatch, 650.0, 720.0)
    assert painted[0][0] == (702.0, 2 * W)
    assert all(end == (begin + 3.0, 3 * W) for (begin, _), end in painted)


def test_pages_are_given_the_surface_of_a_road_whose_lanes_end(make_scenario: Callable[[int, str], Scenario]) -> None:
    scenario = make_scenario(4, "rear")
    assert "surface" not in case_data("0:4", scenario)
    assert "surface" not in case_data("0:4", replace(scenario, odd=on("curves")))
    start = float(scenario.x[0, 0])
    drop = case_data("0:4", replace(scenario, odd=on("lane-drop")))["surface"]
    assert drop["areas"][0] == [None, pytest.approx(900.0 - start, abs=1e-3), 0.0, W, 0.0, W]
    assert [None, 2 * W, None, 2 * W, "broken"] in drop["lines"]
