"""What is written as OpenSCENARIO is what was recorded; others' checkers look at it in external/."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash, mirrored
from openscenario_read_back import contact_frame, crash_of, entities_of, real_crashes, times_over, tracks_of

from cornerforge.errors import InputError, OutputError, UnknownNameError
from cornerforge.ext.interchange.opendrive import lane_id, write_road_once
from cornerforge.ext.interchange.openscenario import MODES, VERSIONS, write_openscenario
from cornerforge.library.out_case import OutCase
from cornerforge.types import MOTORCYCLE, ODDS, TRUCK, Crash, Odd, Scenario

CUT_IN = crash(
    Car(100.0, RIGHT, 30.0),
    Car(145.0, MIDDLE, 20.0, pulls=((1.5, -3.0),), turns=(Turn(1.0, 3.0, RIGHT),)),
    Car(60.0, LEFT, 25.0),
)
"""The AV closes in on a car that comes over from the lane to its left and brakes."""


SOME = 12
"""Real crashes that a test looks at, of each ODD."""


def written(folder: Path, scenario: Scenario, **options: Any) -> ET.Element:
    file, _ = write_openscenario(OutCase("case", scenario, {"case_id": "0:1"}), folder, **options)
    return ET.parse(folder / file).getroot()


def aims(scenario: Scenario, changes: dict[int, list[tuple[int, int]]]) -> Scenario:
    """The scenario with target lanes: for each column, from which frame on which lane."""
    target = scenario.target_lane.copy()
    for column, parts in changes.items():
        for frame, lane in parts:
            target[frame:, column] = lane
    return replace(scenario, target_lane=target)


def assert_as_recorded(root: ET.Element, scenario: Scenario) -> None:
    tracks = tracks_of(root)
    for column, slot in enumerate(scenario.slot):
        track = tracks["Ego" if slot == 0 else f"BV{slot}"]
        n = len(scenario.x)
        np.testing.assert_allclose(track[:n, 0], 0.1 * np.arange(n), atol=1e-9)
        np.testing.assert_allclose(track[:n, 1], scenario.x[:, column], rtol=0, atol=2e-5)
        np.testing.assert_allclose(track[:n, 2], scenario.y[:, column], rtol=0, atol=2e-5)
        np.testing.assert_allclose(track[:n, 3], scenario.heading[:, column], rtol=0, atol=1e-7)
    assert contact_frame(root) == crash_of(scenario)


@pytest.mark.full
@pytest.mark.parametrize("odd", list(ODDS))
def test_real_crashes_are_as_recorded(odd: str, tmp_path: Path) -> None:
    crashes = real_crashes(odd)[:SOME]
    assert len(crashes) == SOME
    for number, scenario in enumerate(crashes):
        version = VERSIONS[number % len(VERSIONS)]
        root = written(tmp_path, scenario, version=version)
        assert_as_recorded(root, scenario)
        header = root.find("FileHeader")
        assert header is not None
        assert f"{header.get('revMajor')}.{header.get('revMinor')}" == version


def test_classes_have_their_sizes_and_words(tmp_path: Path) -> None:
    kinds = {TRUCK: "truck", MOTORCYCLE: "motorbike"}
    met = set()
    for scenario in real_crashes("mixed"):
        entities = entities_of(written(tmp_path, scenario))
        for column, kind in enumerate(scenario.kind.tolist()):
            entity = entities["Ego" if column == 0 else f"BV{scenario.slot[column]}"]
            assert entity.category == kinds.get(kind, "car")
            assert (entity.length, entity.width) == (scenario.length[column], scenario.width[column])
            met.add(kind)
    assert met == {0, TRUCK, MOTORCYCLE}


def test_a_truck_is_met_at_the_same_step(tmp_path: Path) -> None:
    # The same motion, and the other one is a truck of 16.5 m: contact comes earlier, and both sides must see it so.
    long = replace(CUT_IN, kind=np.array([0, TRUCK, 0], np.int8), length=np.array([5.0, 16.5, 5.0]))
    root = written(tmp_path, long)
    frame, partner = contact_frame(root) or (-1, "")
    assert partner == "BV1"
    assert frame < crash_of(CUT_IN)[0]
    early = replace(long, crash=Crash(0.1 * frame, 0, 1), **{
        name: getattr(long, name)[: frame + 1]
        for name in ("x", "y", "speed", "heading", "acceleration", "target_lane", "present")
    })  # fmt: skip
    assert_as_recorded(written(tmp_path, early), early)


def test_a_mirror_image_is_written_mirrored(tmp_path: Path) -> None:
    image = mirrored(CUT_IN)
    as_is, other = (tracks_of(written(tmp_path, s)) for s in (CUT_IN, image))
    for name, track in as_is.items():
        np.testing.assert_allclose(other[name], track * [1, 1, -1, -1] + [0, 0, 12, 0], atol=2e-5)
    assert contact_frame(written(tmp_path, image)) == crash_of(CUT_IN)


def test_contact_in_the_first_second_and_at_once(tmp_path: Path) -> None:
    early = crash(Car(100.0, RIGHT, 30.0), Car(106.2, RIGHT, 10.0))
    assert crash_of(early) == (1, "BV1")
    assert_as_recorded(written(tmp_path, early), early)
    at_once = crash(Car(100.0, RIGHT, 30.0), Car(104.9, RIGHT, 10.0))
    assert len(at_once.x) == 1
    for mode in MODES:
        root = written(tmp_path, at_once, mode=mode)
        if mode == "recorded":
            assert_as_recorded(root, at_once)


def test_half_a_second_follows_a_contact(tmp_path: Path) -> None:
    root = written(tmp_path, CUT_IN)
    n = len(CUT_IN.x)
    for track in tracks_of(root).values():
        assert len(track) == n + 5
        way = np.diff(track[n - 1 :, 1:3], axis=0)
        np.testing.assert_allclose(way, np.broadcast_to(way[0], way.shape), atol=1e-4)
    stop = root.find("Storyboard/StopTrigger")
    assert stop is not None
    assert list(times_over(stop)) == [pytest.approx(0.1 * (n + 4), abs=0.005)]
    no_contact = replace(CUT_IN, crash=None)
    assert {len(track) for track in tracks_of(written(tmp_path, no_contact)).values()} == {n}


def test_a_standing_vehicle_keeps_its_heading(tmp_path: Path) -> None:
    standing = crash(Car(100.0, RIGHT, 20.0), Car(160.0, RIGHT, 0.0), Car(90.0, LEFT, 6.0, pulls=((0.0, -4.0),)))
    heading = standing.heading.copy()
    heading[:, 1:] = -0.25
    standing = replace(standing, heading=heading)
    root = written(tmp_path, standing)
    tracks = tracks_of(root)
    for name in ("BV1", "BV2"):
        assert set(tracks[name][:, 3]) == {-0.25}
    np.testing.assert_allclose(
        tracks["BV1"][:, 1:3], np.broadcast_to([160.0, RIGHT], (len(tracks["BV1"]), 2)), atol=1e-5
    )
    np.testing.assert_allclose(tracks["BV2"][20:, 1], standing.x[20, 2], atol=1e-5)


def test_speeds_at_the_start_are_along_the_way(tmp_path: Path) -> None:
    turned = replace(CUT_IN, heading=np.full_like(CUT_IN.heading, 0.1))
    root = written(tmp_path, turned)
    for entity, speed in (("Ego", 30.0), ("BV1", 20.0)):
        target = root.find(f"Storyboard/Init/Actions/Private[@entityRef='{entity}']//AbsoluteTargetSpeed")
        assert target is not None
        assert float(target.get("value", "")) == pytest.approx(speed / np.cos(0.1), abs=1e-6)


def test_who_comes_and_goes(tmp_path: Path) -> None:
    present = CUT_IN.present.copy()
    present[:5, 2] = present[12:20, 2] = False  # comes at 0.5 s, gone at 1.2 s, there again from 2.0 s on
    present[9:, 1] = False
    x = np.where(present, CUT_IN.x, np.nan)
    root = written(tmp_path, replace(CUT_IN, present=present, x=x, crash=None))
    tracks = tracks_of(root)
    spans = {name: (round(10 * t[0, 0]), round(10 * t[-1, 0])) for name, t in tracks.items()}
    n = len(CUT_IN.x)
    assert spans == {"Ego": (0, n - 1), "BV1": (0, 8), "BV2": (5, 11), "BV2-2": (20, n - 1)}
    events = {event.get("name"): next(times_over(event)) for event in root.iter("Event")}
    assert events == {"BV1-goes": 0.85, "BV2-comes": 0.45, "BV2-goes": 1.15, "BV2-2-comes": 1.95}
    assert {p.get("entityRef") for p in root.iter("Private")} == {"Ego", "BV1"}
    added = [e.get("entityRef") for e in root.iter("EntityAction") if e.find("AddEntityAction") is not None]
    assert added == ["BV2", "BV2-2"]


def test_a_vehicle_for_one_frame_is_there(tmp_path: Path) -> None:
    present = CUT_IN.present.copy()
    present[:, 2] = False
    present[7, 2] = True
    root = written(tmp_path, replace(CUT_IN, present=present))
    assert "BV2" not in tracks_of(root)
    assert {event.get("name") for event in root.iter("Event")} == {"BV2-comes", "BV2-goes"}


def test_indicators_from_1_2_on(tmp_path: Path) -> None:
    scenario = aims(CUT_IN, {1: [(0, 1), (10, 0)]})
    crosses = int(np.flatnonzero(scenario.y[:, 1] < 4.0)[0])
    for version in VERSIONS:
        root = written(tmp_path, scenario, version=version)
        lights = [
            (event.get("name"), light.get("vehicleLightType"), state.get("mode"), next(times_over(event)))
            for event in root.iter("Event")
            for light, state in zip(event.iter("VehicleLight"), event.iter("LightState"), strict=True)
        ]
        wanted = [
            ("BV1-Right-on-10", "indicatorRight", "flashing", 0.95),
            (f"BV1-Right-off-{crosses}", "indicatorRight", "off", pytest.approx(0.1 * crosses - 0.05)),
        ]
        assert lights == (wanted if version >= "1.2" else [])


@pytest.mark.parametrize("version", VERSIONS)
def test_the_av_gets_a_controller(version: str, tmp_path: Path) -> None:
    root = written(tmp_path, CUT_IN, version=version, mode="controller", controller='my "AV" <1>')
    controller = root.find("Entities/ScenarioObject[@name='Ego']/ObjectController/Controller")
    assert controller is not None
    assert controller.get("name") == 'my "AV" <1>'
    assert [a.get("longitudinal") for a in root.iter("ActivateControllerAction")] == ["true"]
    tracks = tracks_of(root)
    assert set(tracks) == {"BV1", "BV2"}
    n = len(CUT_IN.x)
    np.testing.assert_allclose(tracks["BV1"][:n, 1], CUT_IN.x[:, 1], atol=2e-5)
    assert len(tracks["BV1"]) == n + 30
    assert tracks["BV1"][-1, 1] == pytest.approx(CUT_IN.x[-1, 1] + 3.0 * CUT_IN.speed[-1, 1], abs=1e-4)
    stop = root.find("Storyboard/StopTrigger")
    assert stop is not None
    assert len(list(stop.iter("CollisionCondition"))) == 1


def begins(root: ET.Element) -> ET.Element:
    return next(event for event in root.iter("Event") if str(event.get("name")).endswith("-begins"))


def facts_of(root: ET.Element) -> dict[str | None, str | None]:
    return {p.get("name"): p.get("value") for p in root.iter("Property")}


def when_met(root: ET.Element, scenario: Scenario) -> int:
    """The first frame at which the recorded AV meets all conditions under which the partner's manoeuvre begins."""
    event, entities = begins(root), entities_of(root)
    partner = str(event.get("name")).removesuffix("-begins")
    column = int(np.flatnonzero(scenario.slot == int(partner[2:]))[0])
    ahead = scenario.x[:, column] - scenario.x[:, 0]
    met = np.ones(len(ahead), dtype=bool)
    for condition in (*event.iter("TimeHeadwayCondition"), *event.iter("RelativeDistanceCondition")):
        assert condition.get("entityRef") == partner
        if condition.tag == "TimeHeadwayCondition":
            value = (np.abs(ahead) - 0.5 * (entities["Ego"].length + entities[partner].length)) / scenario.speed[:, 0]
        else:
            back = [
                entities[name].ahead * np.cos(scenario.heading[:, c]) for name, c in (("Ego", 0), (partner, column))
            ]
            value = np.abs(ahead - back[1] + back[0])
        limit = float(condition.get("value", ""))
        met &= value < limit if condition.get("rule") == "lessThan" else value > limit
    for time in times_over(event):
        met &= 0.1 * np.arange(len(ahead)) > time
    return int(np.flatnonzero(met)[0])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("odd", list(ODDS))
def test_the_recorded_av_triggers_the_manoeuvre_when_it_began(odd: str, tmp_path: Path) -> None:
    found = []
    for number, scenario in enumerate(real_crashes(odd)[:SOME]):
        root = written(tmp_path, scenario, mode="relative", version=VERSIONS[number % len(VERSIONS)])
        facts = facts_of(root)
        found.append(facts["relative_manoeuvre"])
        if found[-1] == "none":
            assert not [event for event in root.iter("Event") if str(event.get("name")).endswith("-begins")]
            continue
        begin = round(10 * float(str(facts["relative_begin_s"])))
        assert when_met(root, scenario) == begin
        track, partner = tracks_of(root), crash_of(scenario)[1]
        column = int(np.flatnonzero(scenario.slot == int(partner[2:]))[0])
        np.testing.assert_allclose(track[partner][: begin + 1, 1], scenario.x[: begin + 1, column], atol=2e-5)
        on = np.diff(track[partner][begin:, 1])  # along the road, at its speed, until the AV is near
        np.testing.assert_allclose(on, 0.1 * scenario.speed[begin, column], atol=0.02)
    assert found.count("lane change") > len(found) // 3


def test_a_cut_in_begins_at_the_recorded_gap(tmp_path: Path) -> None:
    scenario = aims(CUT_IN, {1: [(0, 1), (10, 0)]})
    root = written(tmp_path, scenario, mode="relative", version="1.3")
    event = begins(root)
    gap = (scenario.x[:, 1] - scenario.x[:, 0] - 5.0) / scenario.speed[:, 0]
    headway = next(event.iter("TimeHeadwayCondition"))
    assert headway.get("rule") == "lessThan"
    assert gap[10] < float(headway.get("value", "")) < gap[9]
    lane, dynamics = next(event.iter("AbsoluteTargetLane")), next(event.iter("LaneChangeActionDynamics"))
    assert lane.get("value") == str(lane_id(0, 3)) == "-3"
    assert float(dynamics.get("value", "")) == pytest.approx(3.0, rel=0.15)
    speeds = [float(target.get("value", "")) for e in root.iter("Event") for target in e.iter("AbsoluteTargetSpeed")]
    knots = [*range(20, len(scenario.x), 10), len(scenario.x) - 1]
    np.testing.assert_allclose(speeds, scenario.speed[knots, 1], atol=1e-5)
    assert next(event.iter("VehicleLight")).get("vehicleLightType") == "indicatorRight"


def test_an_aborted_change_is_two_changes(tmp_path: Path) -> None:
    back = (Turn(1.0, 1.0, RIGHT + 1.5), Turn(2.2, 2.0, MIDDLE))
    scenario = crash(Car(100.0, RIGHT, 30.0), Car(131.0, MIDDLE, 20.0, turns=back))
    scenario = aims(scenario, {1: [(0, 1), (10, 0), (22, 1)]})
    root = written(tmp_path, scenario, mode="relative")
    changes = [
        (lane.get("value"), float(action.get("targetLaneOffset", "")), condition.get("delay"))
        for event in root.iter("Event")
        for action, lane in zip(event.iter("LaneChangeAction"), event.iter("AbsoluteTargetLane"), strict=True)
        for condition in list(event.iter("Condition"))[:1]
    ]
    assert changes == [("-3", 1.5, "0"), ("-2", 0.0, "1.2")]


def test_without_a_manoeuvre_all_others_drive_as_recorded(tmp_path: Path) -> None:
    steady = crash(Car(100.0, RIGHT, 30.0), Car(150.0, RIGHT, 20.0))
    root = written(tmp_path, steady, mode="relative")
    assert facts_of(root)["relative_manoeuvre"] == "none"
    np.testing.assert_allclose(tracks_of(root)["BV1"][: len(steady.x), 1], steady.x[:, 1], atol=2e-5)


def test_facts_survive_strange_characters(tmp_path: Path) -> None:
    facts = {
        '<a> & "b"': "tab\tline\nend",
        "$c": "$d",
        "none": None,
        "bad": "x\x00y\ud800",
        "n": 3,
        "p": 1e-9,
        "t": True,
    }
    for version in VERSIONS:
        write_openscenario(OutCase("case", CUT_IN, facts), tmp_path, version=version)
        read = facts_of(ET.parse(tmp_path / "case.xosc").getroot())
        assert read['<a> & "b"'] == "tab\tline\nend"
        assert (read[" $c"], read["bad"], read["n"], read["p"], read["t"]) == (" $d", "x�y�", "3", "1e-09", "true")
        assert "none" not in read


def test_the_same_case_gives_the_same_bytes_and_shares_its_road(tmp_path: Path) -> None:
    files = write_openscenario(OutCase("one", CUT_IN, {}), tmp_path)
    assert files == ("one.xosc", "road-3x4.00.xodr")
    before = {file: (tmp_path / file).read_bytes() for file in files}
    assert write_openscenario(OutCase("two", CUT_IN, {}), tmp_path)[1] == files[1]
    write_openscenario(OutCase("one", CUT_IN, {}), tmp_path)
    assert {file: (tmp_path / file).read_bytes() for file in files} == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.xosc", "road-3x4.00.xodr", "two.xosc"]
    far = replace(CUT_IN, x=CUT_IN.x + 7_000.0)
    assert write_openscenario(OutCase("far", far, {}), tmp_path)[1] == "road-3x4.00_-1000_8000.xodr"


def test_many_may_write_into_one_folder_at_the_same_time(tmp_path: Path) -> None:
    cases = [OutCase(f"case-{number}", replace(CUT_IN, test=number), {}) for number in range(40)]
    with ThreadPoolExecutor(8) as pool:
        files = list(pool.map(lambda case: write_openscenario(case, tmp_path / "out"), cases))
    assert {road for _, road in files} == {"road-3x4.00.xodr"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == {name for names in files for name in names}


def test_a_date_where_one_is_wanted(tmp_path: Path) -> None:
    header = written(tmp_path, CUT_IN, date="2026-01-31T12:00:00+01:00").find("FileHeader")
    assert header is not None
    assert header.get("date") == "2026-01-31T12:00:00+01:00"


def test_the_road_has_our_axes(tmp_path: Path) -> None:
    odd = Odd(n_lanes=4, lane_width=3.5, max_speed=50.0)
    road = ET.parse(tmp_path / write_road_once(odd, tmp_path, -100.0, 900.0)).getroot().find("road")
    assert road is not None
    line = road.find("planView/geometry")
    assert line is not None
    assert [float(line.get(key, "")) for key in ("x", "y", "hdg", "length")] == [-1000.0, 14.0, 0.0, 6000.0]
    y, middles = 14.0, {}
    for lane in road.findall("lanes/laneSection/right/lane"):
        width, speed = lane.find("width"), lane.find("speed")
        assert width is not None
        assert speed is not None
        assert (speed.get("max"), speed.get("unit")) == ("50.0", "m/s")
        middles[int(lane.get("id", ""))] = y - 0.5 * float(width.get("a", ""))
        y -= float(width.get("a", ""))
    assert middles == {lane_id(lane, 4): (lane + 0.5) * 3.5 for lane in range(4)}
    assert y == 0.0


@pytest.mark.parametrize(
    "name", ["", "../case", "a/b", "a\\b", "C:case", "a b", "ä", "x" * 101, "a.b", "a\n", "$a", "_a"]
)
def test_names_that_are_no_file_names(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be the name of a case's file"):
        write_openscenario(OutCase(name, CUT_IN, {}), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_asked_for(tmp_path: Path) -> None:
    case = OutCase("case", CUT_IN, {})
    with pytest.raises(UnknownNameError, match=r'No OpenSCENARIO version "2\.0"'):
        write_openscenario(case, tmp_path, version="2.0")
    with pytest.raises(UnknownNameError, match='Did you mean "relative"'):
        write_openscenario(case, tmp_path, mode="relative2")
    with pytest.raises(InputError, match="has no name"):
        write_openscenario(case, tmp_path, mode="controller", controller=" ")
    for date in ("today", "2026-01-01", "2026-13-01T00:00:00"):
        with pytest.raises(InputError, match="is no time"):
            write_openscenario(case, tmp_path, date=date)
    late = CUT_IN.present.copy()
    late[0, 0] = False
    with pytest.raises(InputError, match="the AV is not there in the first frame"):
        write_openscenario(OutCase("case", replace(CUT_IN, present=late), {}), tmp_path)
    bad = CUT_IN.x.copy()
    bad[3, 2] = np.nan
    with pytest.raises(InputError, match="Vehicle 2 has no finite place"):
        write_openscenario(OutCase("case", replace(CUT_IN, x=bad), {}), tmp_path)
    with pytest.raises(InputError, match="last metre of the road"):
        write_road_once(CUT_IN.odd, tmp_path, 0.0, 2e7)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="Cannot write"):
        write_openscenario(case, tmp_path / "file")
