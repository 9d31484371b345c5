"""Roads whose lanes begin and end: what may be asked of them, and what is wrong with some."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.errors import FileFormatError, InputError, UnknownNameError
from cornerforge.experiment.roads import road_named, write_road_file
from cornerforge.ext.pictures.road import road_figure
from cornerforge.road.network import Lane, Marking, Road, faults_of
from cornerforge.road.shipped import ROAD_FILES, SHIPPED


@pytest.mark.parametrize("name", [*SHIPPED, *ROAD_FILES])
def test_shipped_roads_can_be_driven_and_come_back_from_a_file(name: str, tmp_path: Path) -> None:
    road = road_named(name)
    assert faults_of(road) == []
    write_road_file(road, tmp_path / "road.json")
    assert road_named(tmp_path / "road.json") == road


def test_a_lane_ends_where_nothing_follows_it() -> None:
    ramp, works = road_named("on-ramp"), road_named("work-zone")
    assert [ramp.ends_ahead(0, s) for s in (50.0, 500.0, 600.0, 800.0, 850.0, 900.0)] == [
        0.0,
        350.0,
        250.0,
        50.0,
        0.0,
        0.0,
    ]
    assert ramp.ends_ahead(1, 0.0) == float("inf")
    before = works.lane_at(2, 100.0)
    assert before is not None
    assert [one.kind for one in works.next_lanes(before)] == ["closed"]
    assert [works.ends_ahead(2, s) for s in (100.0, 800.0, 1500.0)] == [600.0, 0.0, float("inf")]
    assert works.lane_at(3, 0.0) is None


def test_a_marking_holds_from_where_it_begins() -> None:
    lane = Lane(0, 0.0, 500.0, left=(Marking(100.0, may_cross=False), Marking(200.0, may_cross=True)))
    assert [lane.may_cross(s, left=True) for s in (50.0, 150.0, 250.0)] == [True, False, True]
    assert lane.may_cross(150.0, left=False)


def test_places_of_the_simulator_and_of_the_world_are_each_other_back() -> None:
    """Slots of unequal width: the middle of each stays the middle, and beyond the outer ones metres stay metres."""
    road = replace(road_named("curves"), centres=(-9.3, -5.4, -1.8), lane_width=3.75)
    np.testing.assert_allclose(road.aside([1.875, 5.625, 9.375]), [-9.3, -5.4, -1.8])
    np.testing.assert_allclose(road.aside([0.875, 10.375]), [-10.3, -0.8])
    rng = np.random.default_rng(3)
    s, y = rng.uniform(0.0, 2000.0, 500), rng.uniform(-1.0, 12.0, 500)
    pose = road.pose_at(s, y)
    np.testing.assert_allclose(road.project(pose.x, pose.y), (s, y), atol=1e-6)


def test_what_is_left_of_a_curve_to_the_left_is_nearer_to_its_middle() -> None:
    road = road_named("curves")
    s = np.array([500.0, 510.0])
    ways = [float(np.hypot(*np.diff(np.stack(road.pose_at(s, y)[:2]))[:, 0])) for y in (1.83, 9.15)]
    assert ways[0] / ways[1] == pytest.approx((1000.0 + 9.15) / (1000.0 + 1.83), rel=1e-5)


def test_a_closed_lane_without_one_beside_it_is_a_dead_end() -> None:
    road = replace(road_named("straight"), centres=(-1.83,))
    road = replace(road, lanes=(Lane(0, 0.0, 900.0), Lane(0, 900.0, 2000.0, "closed")))
    assert "no lane beside it goes on" in " ".join(faults_of(road))
    wide = replace(road, centres=tuple(-3.66 * k for k in range(7, 0, -1)))
    assert "7 lanes side by side" in " ".join(faults_of(wide))
    pieces = tuple(Lane(0, 100.0 * k, 100.0 * (k + 1)) for k in range(9))
    assert "slot 0 has 9 lanes" in " ".join(faults_of(replace(road, lanes=pieces)))


FAULTS = {
    "no lane beside it goes on": [Lane(0, 0.0, 900.0), Lane(1, 0.0, 900.0)],
    "lies outside the road": [Lane(0, 0.0, 3000.0), Lane(1, 0.0, 2000.0)],
    "there is no lane in slot 1": [Lane(0, 0.0, 2000.0)],
    "lie over each other": [Lane(0, 0.0, 900.0), Lane(0, 800.0, 2000.0), Lane(1, 0.0, 2000.0)],
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_road_that_cannot_be_driven_is_told_why(fault: str, tmp_path: Path) -> None:
    road: Road = replace(road_named("straight"), centres=(-5.49, -1.83), lanes=tuple(FAULTS[fault]))
    assert fault in " ".join(faults_of(road))
    write_road_file(road, tmp_path / "road.json")
    with pytest.raises(InputError, match=fault):
        road_named(tmp_path / "road.json")


def test_a_name_that_no_road_has(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="on-ramp"):
        road_named("on-rmp")
    (tmp_path / "road.json").write_text("[]", encoding="utf-8")
    with pytest.raises(FileFormatError, match="cornerforge road import"):
        road_named(tmp_path / "road.json")


@pytest.mark.parametrize("name", [*SHIPPED, *ROAD_FILES])
def test_every_shipped_road_can_be_drawn(name: str) -> None:
    road = road_named(name)
    legend = road_figure(road).axes[1].get_legend()
    assert {text.get_text() for text in legend.get_texts()} == {lane.kind for lane in road.lanes}
