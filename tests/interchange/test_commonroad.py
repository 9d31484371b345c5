"""CommonRoad scenarios: what is written is read back, what cannot be carried over is named with its line."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash, mirrored
from hypothesis import given, settings
from hypothesis import strategies as st

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, SPEED, X, Y
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.ext.interchange.commonroad import write_commonroad
from cornerforge.ext.interchange.read_commonroad import read_commonroad
from cornerforge.library.out_case import Fact, MovingCase, OutCase, script_of
from cornerforge.types import Scenario

SIX_DECIMALS = 6e-7
FACTS: dict[str, Fact] = {"av": "idm-mobil", "rate_per_mile": 1.5e-7, "licence": 'as <is> & "so"; ask', "judge": None}
GOAL = "The goal of planningProblem 99 is not carried over."


def cut_in() -> Scenario:
    """A truck cuts in from the left and brakes; a car is in the right lane, another leaves the record early."""
    scenario = crash(
        Car(0.0, MIDDLE, 30.0),
        Car(35.0, LEFT, 27.0, ((1.0, -3.0),), (Turn(0.5, 3.0, MIDDLE),)),
        Car(20.0, RIGHT, 28.0, turns=(Turn(0.0, 3.0, RIGHT + 0.8),)),
        Car(-60.0, RIGHT, 25.0),
    )
    present = scenario.present.copy()
    present[12:, 3] = False
    length, width = scenario.length.copy(), scenario.width.copy()
    length[1], width[1] = 16.5, 2.55
    return replace(scenario, present=present, kind=np.array([0, 1, 0, 2], np.int8), length=length, width=width)


def written(tmp_path: Path, scenario: Scenario, av: str = "both") -> Path:
    [name] = write_commonroad(OutCase("case-1", scenario, FACTS), tmp_path, av=av)
    return tmp_path / name


def assert_same(case: MovingCase, scenario: Scenario) -> None:
    there = scenario.present
    np.testing.assert_array_equal(np.isfinite(case.poses[:, :, X]), there)
    for number, series in ((X, scenario.x), (Y, scenario.y), (HEADING, scenario.heading)):
        np.testing.assert_allclose(case.poses[:, :, number][there], series[there], rtol=0.0, atol=SIX_DECIMALS)
    for number, series in ((SPEED, scenario.speed), (ACCELERATION, scenario.acceleration)):
        np.testing.assert_allclose(case.poses[:, :, number][there], series[there], rtol=0.0, atol=1e-5)
    np.testing.assert_array_equal(case.kind, scenario.kind)
    np.testing.assert_allclose(case.length, scenario.length, atol=SIX_DECIMALS)
    np.testing.assert_allclose(case.width, scenario.width, atol=SIX_DECIMALS)
    assert (case.odd.n_lanes, case.odd.lane_width) == (scenario.odd.n_lanes, scenario.odd.lane_width)


@pytest.mark.parametrize("turned", [False, True])
def test_what_is_written_is_read(tmp_path: Path, turned: bool) -> None:
    scenario = mirrored(cut_in()) if turned else cut_in()
    case = read_commonroad(written(tmp_path, scenario))
    assert_same(case, scenario)
    assert case.av_is_recorded
    assert [note.partition(": ")[2] for note in case.notes] == [GOAL]
    assert case.name == "ZAM_Cornerforge-4_1_T-1"
    kept = {"av": "idm-mobil", "rate_per_mile": 1.5e-7, "licence": 'as <is> & "so", ask'}
    assert {name: case.facts.get(name) for name in (*kept, "judge")} == kept | {"judge": None}
    sideways = np.gradient(scenario.y[:, 1], 0.1)
    np.testing.assert_allclose(case.poses[:, 1, LATERAL_SPEED], sideways, atol=1e-4)
    # The truck heads for the middle lane as soon as it moves, and the car that only drifts keeps its lane.
    assert set(case.poses[8:, 1, LANE]) == {1.0}
    assert set(case.poses[:, 2, LANE]) == {2.0 if turned else 0.0}


def test_the_crash_comes_again_at_the_same_step(tmp_path: Path) -> None:
    scenario = crash(Car(0.0, MIDDLE, 30.0), Car(35.0, LEFT, 27.0, ((1.0, -3.0),), (Turn(0.5, 3.0, MIDDLE),)))
    case = read_commonroad(written(tmp_path, scenario))
    driver = experiment(road=case.odd, av=RECORDED_AV, takes_recorded=True).script_driver()
    again, _ = driver.record(script_of(case))
    assert scenario.crash is not None
    assert again.crash == scenario.crash


def test_a_planner_takes_the_place_of_the_av(tmp_path: Path) -> None:
    scenario = cut_in()
    length = scenario.length.copy()
    length[0] = 4.3
    case = read_commonroad(written(tmp_path, replace(scenario, length=length), av="planning"))
    assert not case.av_is_recorded
    assert np.isnan(case.poses[1:, 0]).all()
    np.testing.assert_allclose(case.poses[0, 0, [X, Y, SPEED]], [0.0, MIDDLE, 30.0])
    assert case.length[0] == 4.3
    recorded = len(scenario.x)
    np.testing.assert_allclose(case.poses[:recorded, 1, X], scenario.x[:, 1], atol=SIX_DECIMALS)
    after = case.poses[recorded:, 1, X]
    assert after.size == 30, "who plans gets 3 s more: a contact may come later than the recorded one"
    np.testing.assert_allclose(np.diff(after), 0.1 * scenario.speed[-1, 1], atol=2 * SIX_DECIMALS)


def test_the_file_says_what_the_schema_asks_for(tmp_path: Path) -> None:
    write_commonroad(OutCase("b", cut_in(), FACTS), tmp_path)
    write_commonroad(OutCase("a", cut_in(), FACTS), tmp_path, date="2024-02-29")
    assert (tmp_path / "b.xml").read_text().replace("1970-01-01", "2024-02-29") == (tmp_path / "a.xml").read_text()
    root = ElementTree.parse(tmp_path / "a.xml").getroot()
    assert root.attrib == {
        "commonRoadVersion": "2020a",
        "benchmarkID": "ZAM_Cornerforge-4_1_T-1",
        "date": "2024-02-29",
        "author": "cornerforge",
        "affiliation": "not stated",
        "source": 'cornerforge; av: idm-mobil; rate_per_mile: 1.5e-07; licence: as <is> & "so", ask',
        "timeStepSize": "0.1",
    }
    tags = [child.tag for child in root]
    order = ["location", "scenarioTags", "lanelet", "dynamicObstacle", "planningProblem"]
    assert tags == [tag for tag in order for _ in range(tags.count(tag))]
    assert [child.get("id") for child in root if "id" in child.attrib] == [
        "1", "2", "3", "100", "101", "102", "103", "99",
    ]  # fmt: skip
    # Lanelet 1 is the rightmost lane, so lanelet 2 is on its left.
    assert [(a.tag, a.get("ref")) for a in root.findall("lanelet")[0] if "ref" in a.attrib] == [("adjacentLeft", "2")]
    goal = root.find("planningProblem/goalState/time/intervalEnd")
    assert goal is not None
    assert goal.text == str(len(cut_in().x) - 1)


def test_a_vehicle_that_comes_back_is_two_obstacles(tmp_path: Path) -> None:
    scenario = cut_in()
    present = scenario.present.copy()
    present[:5, 2] = present[9:11, 2] = False
    path = written(tmp_path, replace(scenario, present=present))
    ids = [child.get("id") for child in ElementTree.parse(path).getroot().findall("dynamicObstacle")]
    assert ids == ["100", "101", "102", "1102", "103"]
    case = read_commonroad(path)
    assert np.flatnonzero(np.isfinite(case.poses[:, 2, X])).tolist() == [5, 6, 7, 8]
    assert np.flatnonzero(np.isnan(case.poses[:, 3, X])).tolist() == list(range(11))


@pytest.mark.parametrize("name", ["../up", "a/b", "", "a b", "a\0", "é"])
def test_names_with_path_parts_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="letters, digits"):
        write_commonroad(OutCase(name, cut_in(), {}), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_numbers_that_are_none_are_refused(tmp_path: Path) -> None:
    scenario = cut_in()
    x = scenario.x.copy()
    x[3, 1] = np.nan
    with pytest.raises(InputError, match="not finite"):
        written(tmp_path, replace(scenario, x=x))
    with pytest.raises(InputError, match="way to write the AV"):
        written(tmp_path, scenario, av="obstacle")
    assert list(tmp_path.iterdir()) == []


# Other people's files


Place = Callable[[float, float], tuple[float, float]]


def turned_by(angle: float, east: float = 0.0, north: float = 0.0) -> Place:
    """From our coordinates to those of a file whose road goes in another direction."""
    cos, sin = math.cos(angle), math.sin(angle)
    return lambda x, y: (east + x * cos - y * sin, north + x * sin + y * cos)


def on_a_bend(radius: float) -> Place:
    """From our coordinates to those of a road that bends to the left around (0, radius), laid along y = 0."""
    return lambda x, y: (
        (radius - y) * math.sin(x / radius),
        radius - (radius - y) * math.cos(x / radius),
    )


def scenario_text(
    place: Place,
    *,
    way: Callable[[float], float] = lambda _: 0.0,
    extra: str = "",
    step: float = 0.1,
    split: bool = True,
) -> str:
    """A recorded motorway of three lanes of 3.6 m, right edge at y = -4, drawn in two pieces; an AV to be planned.

    Obstacle 31 is 20 m ahead in the AV's lane at 20 m/s, obstacle 32 a truck that changes from the right lane to the
    AV's in 4 s. `extra` stands before the planning problem.
    """

    def points(y: float, xs: np.ndarray) -> str:
        return "".join("<point><x>{:.9f}</x><y>{:.9f}</y></point>".format(*place(x, y)) for x in xs)

    pieces = (
        [np.linspace(-50.0, 120.0, 30), np.linspace(120.0, 260.0, 25)] if split else [np.linspace(-50.0, 260.0, 55)]
    )
    lanelets = ""
    for lane in range(3):
        right, left = -4.0 + 3.6 * lane, -0.4 + 3.6 * lane
        for piece, xs in enumerate(pieces):
            name = 10 * lane + piece + 1
            links = f'<predecessor ref="{name - 1}"/>' if piece else ""
            links += "" if piece == len(pieces) - 1 else f'<successor ref="{name + 1}"/>'
            lanelets += (
                f'<lanelet id="{name}"><leftBound>{points(left, xs)}</leftBound><rightBound>{points(right, xs)}'
                f"</rightBound>{links}<laneletType>highway</laneletType></lanelet>\n"
            )

    def state(tag: str, k: int, x: float, y: float, speed: float) -> str:
        at = place(x, y)
        return (
            f"<{tag}><position><point><x>{at[0]:.9f}</x><y>{at[1]:.9f}</y></point></position><orientation><exact>"
            f"{way(x):.9f}</exact></orientation><time><exact>{k}</exact></time><velocity><exact>{speed}</exact>"
            f"</velocity></{tag}>\n"
        )

    def obstacle(
        name: int, kind: str, length: float, motion: Callable[[float], tuple[float, float]], speed: float
    ) -> str:
        first, *later = (state("state" if k else "initialState", k, *motion(step * k), speed) for k in range(41))
        return (
            f'<dynamicObstacle id="{name}"><type>{kind}</type><shape><rectangle><length>{length}</length><width>1.9'
            f"</width></rectangle></shape>{first}<trajectory>{''.join(later)}</trajectory></dynamicObstacle>\n"
        )

    def smooth(t: float) -> float:
        s = min(t / 4.0, 1.0)
        return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)

    start = state("initialState", 0, 0.0, 1.4, 25.0)
    return (
        '<?xml version="1.0"?>\n'
        f'<commonRoad commonRoadVersion="2020a" benchmarkID="USA_Any-1_1_T-1" author="A" affiliation="B" '
        f'source="drawn by hand" date="2020-01-01" timeStepSize="{step}">\n'
        f"<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude></location>"
        f"<scenarioTags><highway/></scenarioTags>\n{lanelets}"
        f"{obstacle(31, 'car', 4.5, lambda t: (20.0 + 20.0 * t, 1.4), 20.0)}"
        f"{obstacle(32, 'truck', 12.0, lambda t: (60.0 + 22.0 * t, -2.2 + 3.6 * smooth(t)), 22.0)}{extra}"
        f'<planningProblem id="7">{start}<goalState><time><intervalStart>0</intervalStart><intervalEnd>40</intervalEnd>'
        "</time></goalState></planningProblem>\n</commonRoad>\n"
    )


def read(tmp_path: Path, text: str, ego: int | None = None) -> MovingCase:
    path = tmp_path / "theirs.xml"
    path.write_text(text)
    return read_commonroad(path, ego=ego)


PLACES = {
    "along": (turned_by(0.0), 0.0, 0.0),
    "turned": (turned_by(2.3), 2.3, 0.0),
    "far off": (turned_by(-0.6, 691_608.0, 5_334_755.0), -0.6, 0.0),
    "a bend": (on_a_bend(1200.0), 0.0, 1.0 / 1200.0),
}


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("split", [True, False])
def test_a_road_in_any_direction_becomes_ours(tmp_path: Path, name: str, split: bool) -> None:
    place, angle, bend = PLACES[name]
    case = read(tmp_path, scenario_text(place, way=lambda x: angle + bend * x, split=split))
    assert (case.odd.n_lanes, round(case.odd.lane_width, 2)) == (3, 3.6)
    assert not case.av_is_recorded
    time = 0.1 * np.arange(41)
    x = case.poses[:, :, X] - case.poses[0, 0, X]
    ahead = 1.0 - bend * 1.4  # the lane's own line is the road's: what is beside the middle of the bend keeps its angle
    np.testing.assert_allclose(case.poses[0, 0, [Y, SPEED, HEADING]], [5.4, 25.0, 0.0], atol=0.01)
    np.testing.assert_allclose(x[:, 1], (20.0 + 20.0 * time) * ahead, atol=0.02)
    np.testing.assert_allclose(case.poses[:, 1, Y], 5.4, atol=0.03)
    np.testing.assert_allclose(case.poses[[0, -1], 2, Y], [1.8, 5.4], atol=0.03)
    np.testing.assert_allclose(case.poses[:, :, HEADING][1:, 1:], 0.0, atol=0.002)
    np.testing.assert_array_equal(case.poses[[0, -1], 1:, LANE], [[1, 0], [1, 1]])
    assert case.poses[10, 2, LANE] == 1.0  # it is under way there
    assert case.kind.tolist() == [0, 0, 1]
    curved = [note for note in case.notes if "curve" in note]
    assert len(curved) == (bend > 0.0)
    assert not bend or "radius of 1,19" in curved[0]


def test_time_steps_of_another_length_are_interpolated(tmp_path: Path) -> None:
    case = read(tmp_path, scenario_text(turned_by(0.0), step=0.04))
    assert len(case.poses) == 17
    np.testing.assert_allclose(case.poses[:, 1, X], 20.0 + 2.0 * np.arange(17), atol=1e-6)
    assert any("0.04 s" in note for note in case.notes)


EXTRA = """<trafficSign id="900"><trafficSignElement/></trafficSign>
<intersection id="901"/>
<staticObstacle id="902"><type>parkedVehicle</type><shape/></staticObstacle>
<dynamicObstacle id="903"><type>pedestrian</type><shape><circle><radius>0.5</radius></circle></shape>
{walks}</dynamicObstacle>
<dynamicObstacle id="904"><type>car</type><shape><circle><radius>2</radius></circle></shape></dynamicObstacle>
<dynamicObstacle id="905"><type>car</type><shape><rectangle><length>4</length><width>2</width></rectangle></shape>
{vague}</dynamicObstacle>
<dynamicObstacle id="906"><type>bus</type><shape><rectangle><length>12</length><width>2.5</width></rectangle></shape>
{oncoming}</dynamicObstacle>
<dynamicObstacle id="907"><type>taxi</type><shape><rectangle><length>4</length><width>2</width></rectangle></shape>
{beside}<initialSignalState><time><exact>0</exact></time></initialSignalState></dynamicObstacle>
<laneletX/>
<lanelet id="950"><leftBound><point><x>200</x><y>-4</y></point><point><x>260</x><y>-20</y></point></leftBound>
<rightBound><point><x>200</x><y>-8</y></point><point><x>260</x><y>-24</y></point></rightBound></lanelet>
<planningProblem id="8"/>
"""
_STATE = (
    "<initialState><position>{at}</position><orientation><exact>{way}</exact></orientation><time><exact>0</exact></time>"
    "<velocity><exact>20</exact></velocity></initialState>"
)
_POINT = "<point><x>30</x><y>{y}</y></point>"


def test_what_is_not_carried_over_is_named_with_its_line(tmp_path: Path) -> None:
    extra = EXTRA.format(
        vague=_STATE.format(at="<circle><radius>1</radius></circle>", way=0),
        walks=_STATE.format(at=_POINT.format(y=-10), way=0),
        oncoming=_STATE.format(at=_POINT.format(y=18), way=3.1),
        beside=_STATE.format(at=_POINT.format(y=-12), way=0),
    )
    text = scenario_text(turned_by(0.0), extra=extra).replace('<planningProblem id="8"/>\n', "")
    text = text.replace("</commonRoad>", '<planningProblem id="8"/>\n</commonRoad>')
    case = read(tmp_path, text)
    assert case.poses.shape[1] == 3
    lines = text.split("\n")
    found = {}
    for note in case.notes:
        line, _, what = note.removeprefix("line ").partition(": ")
        found[what] = lines[int(line) - 1]
    expected = {
        "trafficSign 900 is not carried over.": "trafficSign",
        "intersection 901 is not carried over.": "intersection",
        "staticObstacle 902 is left out: its shape is not one rectangle; how near it comes is not known.": 'id="902"',
        'dynamicObstacle 903 is left out: "pedestrian" is no vehicle that can be driven here; it comes within 28.8 m of'
        " the AV (after 0.0 s).": 'id="903"',
        "dynamicObstacle 904 is left out: its shape is not one rectangle; how near it comes is not known.": 'id="904"',
        "dynamicObstacle 905 is left out: its position is not exact; how near it comes is not known.": 'id="905"',
        "dynamicObstacle 906 is left out: it is across the road, or drives the other way;"
        " it comes within 26.0 m of the AV (after 0.0 s).": 'id="906"',
        'dynamicObstacle 906 is "bus"; it is taken as a truck of its size.': 'id="906"',
        "dynamicObstacle 907 is left out: it is never on the AV's road;"
        " it comes within 27.9 m of the AV (after 0.0 s).": 'id="907"',
        'dynamicObstacle 907 is "taxi"; it is taken as a car of its size.': 'id="907"',
        "initialSignalState of dynamicObstacle 907 is not carried over.": "initialSignalState",
        "laneletX is not carried over.": "laneletX",
        "lanelet 950 is not carried over: it is no lane of the AV's road.": 'id="950"',
        "planningProblem 8 is not carried over: one AV drives, that of planningProblem 7.": 'planningProblem id="8"',
        "The goal of planningProblem 7 is not carried over.": "goalState",
        "The AV has no size in the file; it is 5 m x 2 m here.": 'planningProblem id="7"',
    }
    assert set(found) == set(expected)
    for what, part in expected.items():
        assert part in found[what], what


BOX = "<rectangle><length>4.6</length><width>1.8</width></rectangle>"
FENCE = "<polygon>" + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x in (-5, 5) for y in (-1, 1)) + "</polygon>"


def standing(kind: str, x: float, y: float, *, shape: str = BOX, way: float = 0.0, tag: str = "static") -> str:
    """An obstacle in the frame of the road, and as the AV of `scenario_text` drives for 4 s at 25 m/s along y = 1.4."""
    return (
        f'<{tag}Obstacle id="60"><type>{kind}</type><shape>{shape}</shape><initialState><position><point><x>{x}</x>'
        f"<y>{y}</y></point></position><orientation><exact>{way}</exact></orientation><time><exact>0</exact></time>"
        f"</initialState></{tag}Obstacle>\n"
    )


def test_a_parked_vehicle_along_a_lane_stands_in_the_case(tmp_path: Path) -> None:
    text = scenario_text(turned_by(0.0), extra=standing("parkedVehicle", 90.0, -3.0))
    case = read(tmp_path, text)
    assert case.called[-1] == "obstacle 60"
    np.testing.assert_allclose(case.poses[:, 3, [X, Y, SPEED, LANE]], np.tile([90.0, 1.0, 0.0, 0.0], (41, 1)))
    assert any('staticObstacle 60 is "parkedVehicle"; it is taken as a car' in note for note in case.notes)
    assert len(case.poses) == len(read(tmp_path, scenario_text(turned_by(0.0))).poses)


@pytest.mark.parametrize(
    ("extra", "why", "gap", "seconds"),
    [
        (standing("roadBoundary", 50.0, -6.0, shape=FENCE), '"roadBoundary" is no vehicle', 5.4, 1.7),
        (standing("pillar", 50.0, -6.0, shape="<circle><radius>0.5</radius></circle>"), '"pillar" is', 5.9, 1.9),
        (standing("parkedVehicle", 50.0, 9.0), "it is never on the AV's road", 5.7, 1.9),
        (standing("unknown", 250.0, 1.4), '"unknown" is no vehicle', 145.2, 4.0),
        (standing("parkedVehicle", 250.0, 1.4, way=1.57), "it is across the road,", 146.6, 4.0),
        (standing("bicycle", 50.0, -10.0, tag="dynamic"), '"bicycle" is no vehicle', 46.2, 0.0),
    ],
)
def test_what_is_left_out_is_named_with_how_near_it_comes(
    tmp_path: Path, extra: str, why: str, gap: float, seconds: float
) -> None:
    case = read(tmp_path, scenario_text(turned_by(0.0), extra=extra))
    [note] = [note for note in case.notes if "60 is left out" in note]
    assert why in note
    assert note.endswith(f"; it comes within {gap} m of the AV (after {seconds} s).")
    assert len(case.kind) == 3


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (standing("constructionZone", 90.0, 1.4, shape=FENCE), '"constructionZone" is no vehicle.*within 0.0 m'),
        (
            standing("parkedVehicle", 90.0, 1.4, way=3.14),
            "it is across the road, or drives the other way; it comes within 0.0 m",
        ),
        (standing("parkedVehicle", 90.0, -4.5), r"it is never on the AV's road; it comes within 4\.0 m"),
        (standing("pedestrian", 30.0, 1.4, tag="dynamic"), '"pedestrian" is no vehicle'),
        (
            standing("car", 30.0, 5.0, way=3.1, tag="dynamic"),
            "it is across the road, or drives the other way; it comes within 25.2 m",
        ),
    ],
)
def test_what_is_in_the_way_of_the_av_refuses_the_file(tmp_path: Path, extra: str, message: str) -> None:
    with pytest.raises(DataError, match=rf"line \d+: \w+ 60 cannot be carried over and is in the AV's way: {message}"):
        read(tmp_path, scenario_text(turned_by(0.0), extra=extra))


def test_an_obstacle_can_be_the_av(tmp_path: Path) -> None:
    text = scenario_text(turned_by(0.5), way=lambda _: 0.5)
    case = read(tmp_path, text, ego=32)
    assert case.av_is_recorded
    assert case.length.tolist() == [12.0, 4.5]
    assert case.facts["av_id"] == 32
    assert read(tmp_path, text, ego=7).length.tolist() == [5.0, 4.5, 12.0]
    with pytest.raises(InputError, match=r"No vehicle of id 33 can be the AV\. Name an obstacle; ids: 31, 32"):
        read(tmp_path, text, ego=33)
    begin, end = text.index("<planningProblem"), text.index("</commonRoad>")
    alone = text[:begin] + text[end:]
    assert read(tmp_path, alone, ego=31).av_is_recorded
    with pytest.raises(InputError, match="No planning problem says who is the AV"):
        read(tmp_path, alone)


def test_only_the_time_of_a_recorded_av_is_read(tmp_path: Path) -> None:
    text = scenario_text(turned_by(0.0))
    at = text.index('id="31"')
    for step in (*range(10), *range(30, 41)):  # the AV is there from step 10 to 29 only
        tag = "initialState" if step == 0 else "state"
        begin = text.rindex(f"<{tag}>", 0, text.index(f"<exact>{step}</exact></time>", at))
        end = text.index(f"</{tag}>", begin) + len(f"</{tag}>")
        text = text[:begin] + text[end:]
    begin = text.index("<state>", at)
    end = text.index("</state>", begin)
    first = text[begin + 7 : end]
    text = text[:begin] + text[end + 8 :]
    text = text.replace("<trajectory>", f"<initialState>{first}</initialState><trajectory>", 1)
    case = read(tmp_path, text, ego=31)
    assert len(case.poses) == 20
    np.testing.assert_allclose(case.poses[0, :, X], [40.0, 82.0], atol=1e-6)
    assert any("Only steps 10 to 29 are read" in note for note in case.notes)


def broken(old: str, new: str, count: int = 1) -> Callable[[str], str]:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new, count)

    return change


def repeated(text: str) -> str:
    at = text.rindex("<state>", 0, text.index("<time><exact>40<"))
    end = text.index("</state>", at) + len("</state>")
    return text[:end] + text[at:end] + text[end:]


def in_kmh(text: str) -> str:
    return text.replace("<exact>22.0<", "<exact>79.2<")


def test_an_av_that_moves_otherwise_than_its_velocity_says_is_refused(tmp_path: Path) -> None:
    text = scenario_text(turned_by(0.0))
    assert read(tmp_path, text, ego=32).av_is_recorded
    with pytest.raises(
        DataError, match=r"line \d+: the AV, dynamicObstacle 32, cannot drive as recorded: it is not where"
    ):
        read(tmp_path, in_kmh(text), ego=32)


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (broken("<length>12.0<", "<length>0.0<"), "its length is 0 m; 0.5 to 30 m can be driven"),
        (broken("1.9</width>", "19</width>"), "its width is 19 m; 0.3 to 4 m can be driven"),
        (
            broken("<time><exact>40<", "<time><exact>39<"),
            "it has two different states at one time step",
        ),
        (in_kmh, "it is not where its velocity takes it (jumps, or other units)"),
    ],
)
def test_an_obstacle_that_cannot_be_stops_the_file_only_in_the_way_of_the_av(
    tmp_path: Path, change: Callable[[str], str], note: str
) -> None:
    text = change(scenario_text(turned_by(0.0)))
    with pytest.raises(
        DataError,
        match=rf"dynamicObstacle 3[12] cannot be carried over and is in the AV's way: {re.escape(note)}; it comes",
    ):
        read(tmp_path, text)
    start = text.index("<planningProblem")
    behind = text[start:].replace("<x>0.0", "<x>-45.0").replace("<exact>25.0<", "<exact>10.0<")
    case = read(tmp_path, text[:start] + behind)
    assert any(re.search(rf"dynamicObstacle 3[12] is left out: {re.escape(note)}; it comes", n) for n in case.notes)
    assert len(case.kind) == 2


def test_a_state_given_twice_counts_once(tmp_path: Path) -> None:
    text = scenario_text(turned_by(0.0))
    case = read(tmp_path, repeated(text))
    assert any("has 1 state(s) twice; each counts once." in note for note in case.notes), case.notes
    np.testing.assert_array_equal(case.poses, read(tmp_path, text).poses)


BAD: dict[str, tuple[Callable[[str], str], type[CornerForgeError], str]] = {
    "half a file": (lambda text: text[: len(text) // 2], FileFormatError, "cut off"),
    "empty": (lambda _: "", FileFormatError, "no whole XML file"),
    "a bomb": (
        broken('<?xml version="1.0"?>\n', '<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]>\n'), FileFormatError,
        "declares a document type",
    ),
    "another format": (
        lambda text: text.replace("commonRoad ", "OpenSCENARIO ").replace("/commonRoad", "/OpenSCENARIO"),
        FileFormatError, "no.* a CommonRoad scenario|not a CommonRoad scenario",
    ),
    "an old version": (broken('"2020a"', '"2018b"'), FileFormatError, 'version "2018b"; 2020a is read'),
    "a new version": (broken('"2020a"', '"2024"'), FileFormatError, 'version "2024"; 2020a is read'),
    "no version": (broken('commonRoadVersion="2020a" ', ""), FileFormatError, 'version "none"'),
    "NaN": (broken("<velocity><exact>20.0", "<velocity><exact>NaN"), DataError, 'line .*exact is "NaN"'),
    "infinite": (broken("<y>", "<y>1e999"), DataError, "line .*y is"),
    "no step": (broken('timeStepSize="0.1"', 'timeStepSize="0"'), DataError, "timeStepSize"),
    "endless": (broken("<time><exact>40<", "<time><exact>4000000<"), DataError, "allowed: 0 to 6000"),
    "two of one id": (broken('dynamicObstacle id="32"', 'dynamicObstacle id="31"'), DataError, "several obstacles"),
    "no orientation": (
        broken("<orientation><exact>0.000000000</exact></orientation>", ""), DataError, "lacks orientation"
    ),
    "no lanelets": (lambda text: text.replace("lanelet ", "way ").replace("</lanelet>", "</way>"), DataError,
                    "starts on no lanelet"),
    "one point": (
        lambda text: text[: (a := text.index("<point>", text.index("<leftBound>") + 20) + 7)].rpartition("<point>")[0]
        + text[text.index("</leftBound>", a) :],
        DataError, "fewer than two points",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_one_clear_error(tmp_path: Path, name: str) -> None:
    change, error, message = BAD[name]
    with pytest.raises(error, match=message):
        read(tmp_path, change(scenario_text(turned_by(0.0))))


def test_a_road_that_is_not_straight_is_refused(tmp_path: Path) -> None:
    place = on_a_bend(150.0)
    with pytest.raises(DataError, match=r"line 5: the road is not straight: .* gentle curves, of a radius of 500 m"):
        read(tmp_path, scenario_text(place, way=lambda x: x / 150.0, split=False))


@pytest.mark.full
def test_ten_thousand_vehicles_are_refused(tmp_path: Path) -> None:
    car = (
        '<dynamicObstacle id="{}"><type>car</type><shape><rectangle><length>4</length><width>2</width></rectangle>'
        "</shape>" + _STATE.format(at=_POINT.format(y=1.4), way=0) + "</dynamicObstacle>\n"
    )
    for number, message in (
        (10_000, "there are 10,002 obstacles; up to 1,000"),
        (300, "There are 303 vehicles"),
    ):
        extra = "".join(car.format(1000 + k) for k in range(number))
        with pytest.raises(InputError, match=message):
            read(tmp_path, scenario_text(turned_by(0.0), extra=extra))


def test_no_such_file() -> None:
    with pytest.raises(InputError, match="No file"):
        read_commonroad(Path("nowhere.xml"))


@settings(max_examples=40, deadline=None)
@given(
    at=st.integers(0, 40_000), put=st.sampled_from(["", "<", ">", "0", "-", '"', "&", "\x00", "é", "</state>", "9e9"])
)
def test_a_damaged_file_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, at: int, put: str) -> None:
    text = scenario_text(turned_by(0.0))
    at %= len(text)
    path = tmp_path_factory.getbasetemp() / "damaged.xml"
    path.write_text(text[:at] + put + text[at + 1 :], encoding="utf-8")
    message = ""
    try:
        case = read_commonroad(path)
    except CornerForgeError as error:
        message = str(error)
    else:
        assert np.isfinite(case.poses[0, 0]).all()
    assert "\n" not in message
