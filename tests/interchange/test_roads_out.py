"""Cases on roads whose lanes begin and end, or with curves, as files for other tools."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash
from openscenario_read_back import contact_frame, crash_of, tracks_of

import cornerforge
from cornerforge.errors import InputError
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ext.interchange.opendrive import write_road_once
from cornerforge.ext.interchange.opendrive_lanes import is_plain, is_straight
from cornerforge.ext.interchange.openscenario import write_openscenario
from cornerforge.ext.interchange.osi_messages import GROUND_TRUTH, message_class
from cornerforge.ext.interchange.road_import import road_of_opendrive
from cornerforge.ext.interchange.write_osi import write_osi
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import case_text, read_case_file
from cornerforge.library.out_case import OutCase
from cornerforge.report.surface import lane_on, marks_between
from cornerforge.road.network import Lane, Marking, Road
from cornerforge.road.reference import ReferenceLine
from cornerforge.types import Odd, Scenario
from cornerforge.verbs.drive_case import drive_case

AV = "flawed-not-behind"
ROADS = ("straight", "curves", "on-ramp", "exit", "weaving", "lane-drop", "work-zone")
EDGE = (Marking(0.0, may_cross=False),)
BENT = ReferenceLine.of_curvature([(300.0, 0.0, 0.002), (400.0, 0.002, 0.002), (300.0, 0.002, 0.0)], (70.0, -9.0, 2.5))
UNEVEN = Road(
    "A 7 <north>", BENT.pieces, BENT.length, 3.65, (-9.3, -5.6, -2.0),
    (
        Lane(0, 200.0, 450.0, "acceleration", 22.0, (), EDGE),
        Lane(1, 0.0, 1000.0, left=(*EDGE, Marking(600.0, may_cross=True))),
        Lane(2, 0.0, 700.0, limit=30.0, left=EDGE, right=(Marking(0.0, may_cross=True), Marking(800.0, False))),
        Lane(2, 700.0, 1000.0, "through", 25.0, EDGE),
    ),
)  # fmt: skip
"""Curved, with lanes of three widths, a line that may be crossed from its left side only, and one without limits."""
CUT_IN = crash(
    Car(100.0, RIGHT, 30.0),
    Car(145.0, MIDDLE, 20.0, pulls=((1.5, -3.0),), turns=(Turn(1.0, 3.0, RIGHT),)),
    Car(60.0, LEFT, 25.0),
)


def cut_in_on(road: Road) -> Scenario:
    return replace(CUT_IN, odd=odd_on(Odd(), road))


def told(road: Road, first: float) -> list[object]:
    """Lanes of a road with s counted from `first`, and the marks between slots every 20 m."""
    lanes: list[list[Lane]] = [[one for one in road.lanes if one.slot == slot] for slot in range(road.slots)]
    places = np.arange(first + 10.0, first + 1000.0, 20.0).tolist()
    sides = list(zip([[], *lanes], [*lanes, []], strict=True))
    marks = [[marks_between(lane_on(right, s), lane_on(left, s), s) for s in places] for right, left in sides]
    return [
        [
            (one.slot, one.begin - first if one.begin else 0.0, one.end - first, one.kind, one.limit)
            for one in road.lanes
        ],
        marks,
    ]


@pytest.fixture(scope="module")
def on_ramp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few crashes where a ramp meets the road."""
    path = tmp_path_factory.mktemp("on-ramp") / "library"
    cornerforge.simulate(av=AV, road="on-ramp", tests=60, out=path)
    return path


def test_only_the_straight_road_is_plain() -> None:
    assert [name for name in ROADS if is_plain(road_named(name))] == ["straight"]
    assert [name for name in ROADS if not is_straight(road_named(name))] == ["curves"]
    kept_in = replace(
        road_named("straight"), lanes=tuple(replace(one, left=EDGE) for one in road_named("straight").lanes)
    )
    assert not is_plain(kept_in)


@pytest.mark.parametrize("road", [*map(road_named, ROADS), UNEVEN], ids=lambda road: str(road.name))
@pytest.mark.parametrize("before", [0.0, 30.0])
def test_a_written_road_is_read_as_the_same_lanes(road: Road, before: float, tmp_path: Path) -> None:
    """Also where vehicles drive before its begin: the file's road begins a kilometre earlier then."""
    odd = replace(odd_on(Odd(), road), road_at=-before)
    name = write_road_once(odd, tmp_path, 10.0, 500.0)
    assert write_road_once(odd, tmp_path, 11.0, 400.0) == name
    first = 1000.0 if before else 0.0
    back = road_of_opendrive(tmp_path / name)
    assert back.length == road.length + first
    np.testing.assert_allclose(back.centres, road.centres, rtol=0, atol=1e-9)
    assert back.lane_width == pytest.approx(np.diff(road.centres).mean())
    (ours, marks), (theirs, seen) = told(road, 0.0), told(back, first)
    assert theirs == ours
    assert seen == marks
    s = np.linspace(0.0, road.length, 50)
    np.testing.assert_allclose(back.line.at(s + first, -4.0), road.line.at(s, -4.0), rtol=0, atol=1e-6)


def test_a_road_that_no_widths_fill_is_refused(tmp_path: Path) -> None:
    straight = road_named("straight")
    uneven = replace(straight, lane_width=4.0, centres=(-13.0, -10.9, -5.0))
    with pytest.raises(InputError, match="road straight has slots so uneven"):
        write_road_once(odd_on(Odd(), uneven), tmp_path, 0.0, 100.0)


@pytest.mark.parametrize("name", ["on-ramp", "work-zone", "curves", "uneven"])
def test_vehicles_are_where_the_files_road_has_their_lanes(name: str, tmp_path: Path) -> None:
    road = UNEVEN if name == "uneven" else road_named(name)
    scenario = cut_in_on(road)
    file, of_road = write_openscenario(OutCase("case", scenario, {}), tmp_path)
    root, read = ET.parse(tmp_path / file).getroot(), road_of_opendrive(tmp_path / of_road)
    read = replace(read, lane_width=road.lane_width)
    tracks = tracks_of(root)
    n = len(scenario.x)
    for column, vehicle in enumerate(("Ego", "BV1", "BV2")):
        x, y, heading = tracks[vehicle][:n, 1:].T
        s, across = read.project(x, y)
        np.testing.assert_allclose(
            s - (read.length - road.length), scenario.x[:, column] + scenario.odd.road_at, atol=1e-4
        )
        np.testing.assert_allclose(across, scenario.y[:, column], atol=1e-4)
        turn = heading - read.line.at(s).heading - scenario.heading[:, column]
        np.testing.assert_allclose(np.remainder(turn + 1.0, 2.0 * np.pi), 1.0, atol=1e-6)
        (speed,) = (
            float(one.get("value", "")) for private in root.iter("Private") if private.get("entityRef") == vehicle
            for one in private.iter("AbsoluteTargetSpeed")
        )  # fmt: skip
        assert speed == pytest.approx(float(np.hypot(x[1] - x[0], y[1] - y[0])) / 0.1, rel=1e-3)
    if is_straight(road):
        assert contact_frame(root) == crash_of(scenario)


@pytest.mark.parametrize("name", ["on-ramp", "curves", "uneven"])
def test_a_trace_moves_in_the_world_of_the_files_road(name: str, tmp_path: Path) -> None:
    """Places are on the road of the file, velocities and accelerations are those of the places."""
    pytest.importorskip("google.protobuf", reason="protobuf is not installed (the extra osi)")
    road = UNEVEN if name == "uneven" else road_named(name)
    scenario = cut_in_on(road)
    of_trace, of_road = write_osi(OutCase("case", scenario, {}), tmp_path / "case.osi")
    read = replace(road_of_opendrive(tmp_path / of_road), lane_width=road.lane_width)
    content, rows = (tmp_path / of_trace).read_bytes(), []
    while content:
        size = int.from_bytes(content[:4], "little")
        message = message_class(GROUND_TRUTH).FromString(content[4 : 4 + size])
        assert message.map_reference == of_road
        for thing in message.moving_object:
            base = thing.base
            rows += [
                [getattr(part, axis) for part in (base.position, base.velocity, base.acceleration) for axis in "xy"]
            ]
            rows[-1].append(base.orientation.yaw)
        content = content[4 + size :]
    x, y, vx, vy, ax, ay, heading = np.moveaxis(np.reshape(rows, (*scenario.x.shape, 7)), 2, 0)
    s, across = read.project(x, y)
    np.testing.assert_allclose(s - (read.length - road.length), scenario.x + scenario.odd.road_at, atol=1e-4)
    np.testing.assert_allclose(across, scenario.y, atol=1e-4)
    np.testing.assert_allclose(heading, read.line.at(s).heading + scenario.heading, atol=1e-6)
    keeps = [0, 2]  # they keep their speed on the reference line; beside it a clothoid changes it by up to 0.06 m/s2
    for place, speed, pull in ((x, vx, ax), (y, vy, ay)):
        np.testing.assert_allclose(np.gradient(place, 0.1, axis=0)[1:-1], speed[1:-1], atol=0.15)
        np.testing.assert_allclose(np.gradient(speed, 0.1, axis=0)[1:-1, keeps], pull[1:-1, keeps], atol=0.07)


def test_relative_manoeuvres_need_straight_lanes_of_one_width(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"relative measures along straight lanes .* road curves has others"):
        write_openscenario(OutCase("case", cut_in_on(road_named("curves")), {}), tmp_path, mode="relative")
    scenario = cut_in_on(road_named("on-ramp"))
    file, _ = write_openscenario(OutCase("case", scenario, {}), tmp_path, mode="relative")
    (target,) = ET.parse(tmp_path / file).getroot().iter("AbsoluteTargetLane")
    assert target.get("value") == "-4"


@pytest.mark.full
@pytest.mark.parametrize("to", ["commonroad", "csv", "parquet", "rerun"])
def test_a_format_that_cannot_hold_the_road_is_refused(on_ramp: Path, tmp_path: Path, to: str) -> None:
    with pytest.raises(InputError, match=rf"^{to} is written .* road on-ramp has others; .* to: json, "):
        cornerforge.export(on_ramp, "all", to=to, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.full
def test_a_case_file_holds_the_road_and_drives_to_the_same_contact(on_ramp: Path, tmp_path: Path) -> None:
    library = CaseLibrary.open(on_ramp)
    files = cornerforge.export(on_ramp, "all", to="json", out=tmp_path / "out").files
    assert files
    for file in files:
        path = tmp_path / "out" / file
        case = read_case_file(path)
        assert case.odd == library.odd
        assert case_text(case) == path.read_text(encoding="utf-8")
        driven = drive_case(path, av=AV)
        assert case.happened is not None
        assert driven.happened.frame == case.happened.frame
        np.testing.assert_array_equal(driven.happened.pose, case.happened.pose)
    with_road = library.odd.road
    assert with_road is not None
    assert with_road.name == "on-ramp"
