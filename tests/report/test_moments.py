"""Moments of a case: as recorded at frames, straight lines between, boxes that touch when the world says so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.analysis.avoidability import WayOut
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.report.moments import Moments, corners_of, overlap_of
from cornerforge.types import FRAME_S, Crash, Scenario

MakeScenario = Callable[[int, str], Scenario]


def test_frames_are_as_recorded_and_between_them_is_a_straight_line(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(3, "cut-in")
    moments = Moments(scenario)
    frame = len(scenario.x) // 2  # column 5 appears here
    at, half = moments.at(frame * FRAME_S), moments.at((frame + 0.5) * FRAME_S)
    np.testing.assert_allclose(at.place, scenario.x[frame] - scenario.x[0, 0], rtol=1e-12)
    np.testing.assert_array_equal(at.y, scenario.y[frame])
    assert at.there.all()
    np.testing.assert_allclose(half.y, scenario.y[frame : frame + 2].mean(axis=0), rtol=1e-9)
    before = moments.at((frame - 0.5) * FRAME_S)
    assert not before.there[5], "it is there in one of the two frames only"
    assert moments.end == pytest.approx(FRAME_S * (len(scenario.x) - 1))


def test_the_gap_is_from_bumper_to_bumper(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(4, "rear")
    moments = Moments(scenario)
    assert moments.partner == 1
    gaps = [moments.gap(moments.at(moments.end - before), 1) for before in (1.0, 0.0)]
    assert gaps[0] == pytest.approx(abs(scenario.x[-11, 0] - scenario.x[-11, 1]) - 5.0)
    assert gaps[0] > 2.0 > 0.0 > gaps[1], "the boxes overlap in the frame of the contact"


def test_without_a_crash_of_the_av_there_is_no_partner(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(0, "side")
    assert replace(scenario, crash=None).partner is None
    assert replace(scenario, crash=Crash(1.0, 1, 2)).partner is None
    moments = Moments(replace(scenario, crash=None))
    assert (moments.contact, moments.end) == (None, moments.last)


def test_a_ghost_begins_and_ends_with_the_way_out(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(0, "side")
    n = 8  # 0.5 s before the contact to 0.2 s after it
    way = WayOut(0.5, scenario.x[-6, 0] + 3.0 * np.arange(n), np.full(n, 6.0), np.full(n, 30.0), np.zeros(n))
    moments = Moments(scenario)
    assert moments.ghost(way, moments.end - 0.55) is None
    assert moments.ghost(way, moments.end + 0.25) is None
    begun = moments.ghost(way, moments.end - 0.45)
    assert begun is not None
    np.testing.assert_allclose(begun.mean(axis=0), [scenario.x[-6, 0] - scenario.x[0, 0] + 1.5, 6.0])
    assert np.ptp(begun, axis=0) == pytest.approx([scenario.length[0], scenario.width[0]])


BOXES = st.builds(
    Box, st.floats(-6, 6), st.floats(-4, 4), st.floats(-0.5, 0.5), st.floats(2, 16), st.floats(0.8, 2.6)
)  # fmt: skip


@given(BOXES, BOXES)
def test_boxes_have_a_common_area_exactly_when_the_world_says_that_they_touch(a: Box, b: Box) -> None:
    corners = [corners_of(*(np.array([value]) for value in box))[0] for box in (a, b)]
    area = overlap_of(*corners)
    smaller, larger = (
        [box._replace(length=by * box.length, width=by * box.width) for box in (a, b)] for by in (0.999, 1.001)
    )
    if boxes_overlap(*smaller):  # sizes a little off, because whether edges touch is a matter of rounding
        x, y = (area - area[0]).T
        size = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
        assert 0.0 < size <= min(a.length * a.width, b.length * b.width) + 1e-9
    elif not boxes_overlap(*larger):
        assert len(area) == 0
