"""Parameters, paths and roads of OpenSCENARIO files: what is left out is named, what cannot be is refused."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from reference.openscenario import (
    AHEAD,
    apart,
    at,
    car,
    condition,
    event,
    lane,
    on_lane,
    read,
    road,
    scenario,
    speed_action,
    time_is,
    trajectory,
)

from cornerforge.drivers.rails import SPEED, X, Y
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError
from cornerforge.ext.interchange import xosc_storyboard
from cornerforge.ext.interchange.read_opendrive import read_opendrive
from cornerforge.ext.interchange.read_openscenario import read_openscenario

DATA = Path(__file__).parent / "data"


# Parameters and catalogs


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("${$v / 3.6}", 20.0), ("${($v + 1.5e1) % 7 * 2}", 6.0), ("${pow(2, 4) - -1}", 17.0),
        ("${max($v, 3) - min(1, 2) - 46}", 25.0),
        ("${round(4.5) + floor(1.9) + ceil(0.1) + sqrt(16)}", 11.0), ("${sign(-3) * -4}", 4.0),
        ("$v2", 18.0), (" $v2 ", 18.0),
    ],
)  # fmt: skip
def test_expressions(tmp_path: Path, expression: str, value: float) -> None:
    parameters = """<ParameterDeclarations><ParameterDeclaration name="v2" parameterType="double" value="${$v / 4}"/>
<ParameterDeclaration name="v" parameterType="double" value="72"/></ParameterDeclarations>"""
    init = at("Ego", on_lane(-2, 100), expression) + at("B", on_lane(-2, 130))
    assert read(tmp_path, scenario(init=init, parameters=parameters, stop=1)).poses[0, 0, SPEED] == pytest.approx(value)


@pytest.mark.parametrize(
    ("values", "expression", "message"),
    [
        ({"a": "$b", "b": "$a"}, "$a", "refers to itself"),
        ({"a": "${$a + 1}"}, "$a", "refers to itself"),
        ({"a": "1"}, "$c", 'parameter "c" is not declared'),
        ({"a": "1"}, "${$a / 0}", "cannot be computed"),
        ({"a": "1"}, "${__import__('os')}", "cannot be computed"),
        ({"a": "1"}, "${" + "(" * 500 + "1" + ")" * 500 + "}", "cannot be computed"),
        ({"a": "1"}, "${pow(10, 400)}", "cannot be computed"),
        ({"a": "x"}, "${$a + 1}", "cannot be computed"),
        ({"a": "1"}, "${1" + "+1" * 2000 + "}", "characters"),
        ({"a": "1"}, "twice $a", "neither a parameter"),
        ({"a": "fast"}, "$a", 'value of AbsoluteTargetSpeed is "fast"'),
    ],
)
def test_parameters_that_are_wrong(tmp_path: Path, values: dict[str, str], expression: str, message: str) -> None:
    declared = "".join(
        f'<ParameterDeclaration name="{n}" parameterType="double" value="{v}"/>' for n, v in values.items()
    )
    parameters = f"<ParameterDeclarations>{declared}</ParameterDeclarations>"
    text = scenario(init=at("Ego", on_lane(-2, 100), expression) + at("B", on_lane(-2, 130)), parameters=parameters)
    with pytest.raises(DataError, match=message):
        read(tmp_path, text)


def test_parameters_that_double_are_no_bomb(tmp_path: Path) -> None:
    """Each of 45 parameters names the one before twice: to follow all references would take years."""
    doubles = "".join(
        f'<ParameterDeclaration name="p{k + 1}" parameterType="double" value="${{$p{k} + $p{k}}}"/>' for k in range(45)
    )
    first = '<ParameterDeclaration name="p0" parameterType="double" value="1"/>'
    parameters = f"<ParameterDeclarations>{doubles}{first}</ParameterDeclarations>"
    init = at("Ego", on_lane(-2, 100), "$p45") + at("B", on_lane(-2, 130), "$p4")
    with pytest.raises(DataError, match=f'value of AbsoluteTargetSpeed is "{2**45}"'):
        read(tmp_path, scenario(init=init, parameters=parameters))
    case = read(tmp_path, scenario(init=init.replace("$p45", "$p3"), parameters=parameters, stop=1))
    assert case.poses[0, :, SPEED].tolist() == [8.0, 16.0]


def test_more_conditions_than_can_be_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xosc_storyboard, "_MOST_WORK", 20_000)  # else this would take half a minute
    many = condition(apart(1, "lessThan"), entity="Ego") * 1000
    with pytest.raises(DataError, match="too many to wait for"):
        read(tmp_path, scenario(event("go", speed_action(10), many), stop=None))


def test_manoeuvres_and_trajectories_of_catalogs(tmp_path: Path) -> None:
    way = trajectory([(0.0, on_lane(-2, 150)), (2.0, on_lane(-2, 190))]).split("<TrajectoryRef>")[1]
    way = way.split("</TrajectoryRef>")[0].replace('name="t"', 'name="way"')
    declared = '<ParameterDeclaration name="to" parameterType="double" value="1"/>'
    slow = event("slow", speed_action("$to"), time_is(4))
    maneuver = f"""<Maneuver name="slow"><ParameterDeclarations>{declared}</ParameterDeclarations>{slow}</Maneuver>"""
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "damaged.xosc").write_text("<OpenSCENARIO")
    for name, entry in (("ways", way), ("turns", maneuver)):
        (tmp_path / "c" / f"{name}.xosc").write_text(
            f'<OpenSCENARIO><Catalog name="{name}">{entry}</Catalog></OpenSCENARIO>'
        )
    follow = trajectory([(0.0, on_lane(-2, 150)), (2.0, on_lane(-2, 190))], "relative")
    begin, end = follow.index("<Trajectory "), follow.index("</Trajectory>") + len("</Trajectory>")
    follow = follow[:begin] + '<CatalogReference catalogName="ways" entryName="way"/>' + follow[end:]
    reference = """</Maneuver><CatalogReference catalogName="turns" entryName="slow"><ParameterAssignments>
<ParameterAssignment parameterRef="to" value="7"/></ParameterAssignments></CatalogReference>"""
    text = scenario(event("go", follow, time_is(1)), stop=6).replace("</Maneuver>", reference)
    text = text.replace("<CatalogLocations/>", '<CatalogLocations><X><Directory path="c"/></X></CatalogLocations>')
    case = read(tmp_path, text)
    assert case.poses[20, 1, X] == pytest.approx(170.0 + AHEAD)
    assert case.poses[-1, 1, SPEED] == 7.0
    with pytest.raises(FileFormatError, match=r"damaged\.xosc, line 1: this is no whole XML file"):
        read(tmp_path, text.replace('catalogName="ways"', 'catalogName="damaged"'))


def test_facts_of_a_file(tmp_path: Path) -> None:
    properties = '<Properties><Property name="{}" value="{}"/></Properties>'
    header = f'author="me"><License name="CC0-1.0"/>{properties.format("likelihood", 3)}</FileHeader>'
    text = scenario(stop=1).replace('author="me"/>', header)
    text = text.replace(
        "</BoundingBox></Vehicle>", f"</BoundingBox>{properties.format('source', 'a lie')}</Vehicle>", 1
    )
    facts = read(tmp_path, text).facts
    assert (facts["licence"], facts["likelihood"], facts["source"]) == ("CC0-1.0", 3, "case.xosc")


@pytest.mark.parametrize(
    "stated",
    [
        "/etc/passwd",
        "../../../../etc/passwd",
        "http://localhost/r.xodr",
        "file:///etc/hosts",
        "~/../../../root/x",
        "\0",
    ],
)
def test_paths_stay_near_the_scenario(tmp_path: Path, stated: str) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    with pytest.raises(CornerForgeError) as caught:
        read(folder, scenario(road_file=stated.replace("\0", "&#1;")))
    assert "passwd" not in str(caught.value).partition('"')[0]


def test_roads_and_catalogs_beside_the_folder_are_read(tmp_path: Path) -> None:
    folder = tmp_path / "xosc"
    folder.mkdir()
    (tmp_path / "xodr").mkdir()
    (tmp_path / "xodr" / "r.xodr").write_text(road())
    text = scenario(road_file="../xodr/r.xodr", stop=1).replace("<CatalogLocations/>", "")
    assert read(folder, text).poses.shape == (11, 2, 7)
    (folder / "link").symlink_to("/etc")
    with pytest.raises(DataError, match="lies outside"):
        read(folder, text.replace("../xodr/r.xodr", "link/passwd"))


# Roads


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ('<arc curvature="0.002"/>', "line 2: road 1 is not straight where the AV starts .arc, radius 500 m"),
        ('<spiral curvStart="0" curvEnd="0.01"/>', "not straight"),
        ('<paramPoly3 aV="0" bV="0" cV="0" dV="300" pRange="normalized"/>', None),
        ('<paramPoly3 aV="0" bV="0.5" cV="0" dV="0" pRange="arcLength"/>', "not straight"),
        ('<poly3 a="0" b="0" c="0.002" d="0"/>', "not straight"),
        ('<arc curvature="0.0005"/>', None),
        ('<arc curvature="1e-9"/>', ""),
        ("", "no line, arc"),
    ],
)  # fmt: skip
def test_straight_roads_and_others(tmp_path: Path, shape: str, message: str | None) -> None:
    if message:
        with pytest.raises(DataError, match=message):
            read(tmp_path, scenario(stop=1), road(shape=shape))
        return
    case = read(tmp_path, scenario(stop=1), road(shape=shape))
    assert case.poses[0, 0, X] == pytest.approx(100.0 + AHEAD)
    bends = message is None
    assert any("it is read as straight" in note for note in case.notes) == bends
    if bends:  # then a point of the world is no place on it
        text = scenario(init=at("Ego", on_lane(-2, 100)) + at("B", '<WorldPosition x="120" y="-6"/>'), stop=1)
        assert any("B is nowhere on the road" in note for note in read(tmp_path, text, road(shape=shape)).notes)


def test_lanes_of_several_widths_and_sections(tmp_path: Path) -> None:
    right = [lane(-1, "shoulder", 1.5), lane(-2, width=3.5), lane(-3, width=3.75), lane(-4, "border")]
    later = f'<laneSection s="500"><right>{lane(-1, "shoulder", 1.5)}{lane(-2, width=3.5)}</right></laneSection>'
    case = read(tmp_path, scenario(stop=1), road(right=right, sections=later))
    assert case.odd.lane_width == pytest.approx(3.625)
    assert case.poses[0, 0, Y] == pytest.approx(3.75 + 1.75)
    told = " ".join(case.notes)
    for words in (
        "-1 (shoulder), -4 (border)",
        "3.75, 3.50 m wide; each counts as 3.62 m",
        "has other lanes or widths farther on",
    ):
        assert words in told
    with pytest.raises(DataError, match="differ too much in width"):
        read(tmp_path, scenario(), road(right=[lane(-1, width=2.5), lane(-2, width=6.0), lane(-3, width=2.5)]))
    with pytest.raises(DataError, match="no lane -2 there; it has: -1"):
        read(tmp_path, scenario(), road(right=[lane(-1)]))
    with pytest.raises(DataError, match="no lane to drive in"):
        read(tmp_path, scenario(), road(right=[lane(-1, "walking"), lane(-2, "biking")]))


def test_what_a_road_has_besides_is_said(tmp_path: Path) -> None:
    besides = """<elevationProfile><elevation s="0" a="5" b="0.01" c="0" d="0"/></elevationProfile>
<lateralProfile><superelevation s="0" a="0.02" b="0" c="0" d="0"/></lateralProfile><objects><object id="1"/>
<object id="2"/></objects><signals><signal id="3"/></signals>"""
    notes = read(tmp_path, scenario(stop=1), road().replace("<lanes>", besides + "<lanes>")).notes
    told = " ".join(notes)
    for words in (
        "it is not level",
        "it leans",
        "2 objects beside or on it are left",
        "1 signal beside or on it is left",
    ):
        assert words in told
    level = road().replace("<lanes>", besides.replace('b="0.01"', 'b="0"').replace("0.02", "0") + "<lanes>")
    assert "level" not in " ".join(read(tmp_path, scenario(stop=1), level).notes)


def test_straight_roads_one_after_the_other(tmp_path: Path) -> None:
    second = road().split("<road", 1)[1].replace('id="1"', 'id="2"').replace('x="0"', 'x="3000"')
    chain = road().replace("</OpenDRIVE>", "<road" + second)
    init = at("Ego", on_lane(-2, 2990)) + at("B", on_lane(-2, 30, "2"))
    case = read(tmp_path, scenario(init=init, stop=2), chain)
    assert case.poses[0, 1, X] == pytest.approx(3030.0 + AHEAD)
    assert case.notes == ()
    past = read(
        tmp_path,
        scenario(init=init.replace('roadId="2" laneId="-2" s="30"', 'roadId="1" laneId="-2" s="2950"'), stop=2),
    )
    assert any(
        "Ego is beyond the straight stretch of the road (x = -2991 to 9 m) at 0.5 s" in note for note in past.notes
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('length="3000" rule', 'length="nan" rule', "length of road"),
        ('hdg="0.0"', 'hdg="inf"', "hdg of geometry"),
        ('<lane id="-2"', '<lane id="-1"', "two lanes -1"),
        ('<lane id="-2"', '<lane id="-7"', "lane -2 is missing"),
        ('<lane id="-2"', '<lane id="2"', "a lane on the right has id 2"),
        ('<width sOffset="0" a="4.0" b="0" c="0" d="0"/>', "", "has no width"),
        ("<lanes>", "<lanes/><lanes>", "no laneSection"),
        ("<road ", "<rode ", "no whole XML"),
        ("<planView>", "<planView/><planView>", "planView holds no geometry"),
    ],
)  # fmt: skip
def test_roads_that_are_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(CornerForgeError, match=message):
        read(tmp_path, scenario(), road().replace(old, new, 1))


def test_a_file_with_two_roads_of_one_id(tmp_path: Path) -> None:
    (tmp_path / "r.xodr").write_text(road().replace("</OpenDRIVE>", "<road" + road().split("<road", 1)[1]))
    with pytest.raises(DataError, match='two roads "1"'):
        read_opendrive(tmp_path / "r.xodr")


# What is not carried over, and what cannot be


def test_what_is_left_out_is_named_with_its_line(tmp_path: Path) -> None:
    keep = """<LongitudinalAction><LongitudinalDistanceAction entityRef="Ego" distance="9" continuous="true"
freespace="true"/></LongitudinalAction>"""
    events = "\n" + event("keep", keep, time_is(1)) + "\n\n" + event("go", speed_action(10), time_is(2))
    angle = condition('<AngleCondition angle="1" angleTolerance="1" angleType="heading"/>', entity="B")
    events += "\n" + event("turned", speed_action(5), angle)
    text = scenario(events)
    case = read(tmp_path, text)
    lines = {k + 1: line for k, line in enumerate(text.splitlines())}
    for tag, words in (("LongitudinalDistanceAction", "B goes on as it was"), ("AngleCondition", "it never holds")):
        (note,) = [note for note in case.notes if tag in note]
        assert words in note
        assert f"<{tag}" in lines[int(note.split("line ")[1].split(":")[0])]
    assert case.poses[-1, 1, SPEED] == 10.0


def test_a_case_of_which_nothing_is_left_is_refused(tmp_path: Path) -> None:
    synchronize = "<SynchronizeAction masterEntityRef='Ego'/>"
    with pytest.raises(
        DataError, match=r"nothing that moves its vehicles can be carried over: SynchronizeAction \(line"
    ):
        read(tmp_path, scenario(event("go", synchronize, time_is(1))))


def test_other_road_users_count_as_boxes(tmp_path: Path) -> None:
    walker = (
        car("P")
        .replace(
            '<Vehicle name="v" vehicleCategory="car">',
            '<Pedestrian name="p" mass="70" pedestrianCategory="pedestrian">',
        )
        .replace("</Vehicle>", "</Pedestrian>")
    )
    init = at("Ego", on_lane(-2, 100)) + at("B", on_lane(-1, 130)) + at("P", on_lane(-3, 200), 0)
    case = read(
        tmp_path,
        scenario(entities=car("Ego") + car("B", category="bus", length=12, width=2.5) + walker, init=init, stop=1),
    )
    assert case.kind.tolist() == [0, 1, 2]
    assert case.notes == ("case.xosc, line 7: P is a Pedestrian; it counts as a motorcycle of its size",)


START = on_lane(-2, 100)
BAD: list[tuple[str, str, str]] = [
    ('revMinor="2"', 'revMinor="7"', "OpenSCENARIO 1.7 is not read; 1.0 to 1.3 are"),
    ('revMajor="1"', 'revMajor="2"', "OpenSCENARIO 2.2 is not read"),
    ("<OpenSCENARIO>", "<OpenDRIVE>", "mismatched tag|not an OpenSCENARIO file"),
    (
        '<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="300"/>',
        r'line \d+: value of AbsoluteTargetSpeed is "300"; allowed: 0 to 80 m/s',
    ),
    ('<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="-3"/>', "allowed: 0 to 80 m/s"),
    ('<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="NaN"/>', "allowed: 0 to 80 m/s"),
    ('length="5"', 'length="0"', "length of Dimensions is \"0\"; allowed: 0.2 to 40 m"),
    ('width="2"', 'width="inf"', "width of Dimensions"),
    ('width="2"', 'width="2.9"', "odd.vehicle_width"),
    ('name="B"', 'name="Ego"', 'two entities "Ego"'),
    ('Private entityRef="B"', 'Private entityRef="Z"', 'no entity "Z"'),
    ('EntityRef entityRef="B"', 'EntityRef entityRef="Z"', 'no entity "Z"'),
    ('roadId="1"', 'roadId="../../x"', 'has no road "../../x"; it has: 1'),
    ('laneId="-2"', 'laneId="-2.5"', "no whole number"),
    ('laneId="-2"', 'laneId="0"', "has no lane 0"),
    (' s="100"', ' s="1e99"', "s of LanePosition"),
    ('dynamicsShape="step"', 'dynamicsShape="wavy"', 'dynamicsShape "wavy" is none of'),
    ('conditionEdge="none"', 'conditionEdge="sharp"', 'conditionEdge "sharp" is none of'),
    ('delay="0"', 'delay="-1"', "delay of Condition"),
    ('rule="greaterThan"', 'rule="about"', 'rule "about" is none of'),
    ("<LogicFile filepath=\"road.xodr\"/>", "", "names no LogicFile"),
    ('filepath="road.xodr"', 'filepath="nowhere.xodr"', "No file .*nowhere.xodr"),
    ("<Entities>", "<Entities/><Entities>", "no ScenarioObject"),
    ("<Storyboard>", "<Catalog/><Storybook>", "mismatched tag"),
    ("TeleportAction>", "TransportAction>", "is put nowhere in Init"),
    ("<BoundingBox>", "<Box>", "mismatched tag"),
    (START, '<RelativeLanePosition entityRef="Ego" dLane="0" ds="1"/>', 'relative to "Ego"'),
    (START, '<WorldPosition x="1e5" y="0"/>', "on no lane of a straight road"),
    (START, '<GeoPosition latitude="1" longitude="2"/>', "the AV starts is a GeoPosition"),
    (START, '<WorldPosition x="100" y="-6" h="3.1"/>', "drives against the direction"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_files_that_are_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = scenario(event("go", speed_action(10), time_is(1)))
    assert old in text
    with pytest.raises(CornerForgeError, match=message) as caught:
        read(tmp_path, text.replace(old, new, 1 if "Action>" not in old else -1))
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([(0.0, 100), (-1.0, 120)], "time of Vertex"),
        ([(1.0, 100), (0.5, 120)], "times must rise"),
        ([(0.0, 100)], "two vertices at least"),
        ([(0.0, 100), (None, 120)], "1 of 2 vertices have a time"),
        ([(0.0, 100), (float("nan"), 120)], "time of Vertex"),
    ],
)
def test_trajectories_that_are_wrong(tmp_path: Path, vertices: list[tuple[float | None, float]], message: str) -> None:
    text = scenario(event("go", trajectory([(t, on_lane(-2, s)) for t, s in vertices]), time_is(1)))
    with pytest.raises(DataError, match=message):
        read(tmp_path, text)


@pytest.mark.full
def test_too_many_vehicles(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there are 10,001 entities; up to 200 are read"):
        read(tmp_path, scenario(entities=car("Ego") + "".join(car(f"v{k}") for k in range(10_000))))


def test_impossible_speeds_of_trajectories(tmp_path: Path) -> None:
    leap = trajectory([(0.0, on_lane(-2, 100)), (1.0, on_lane(-2, 400))])
    with pytest.raises(InputError, match="drives at 300 m/s; up to 80 m/s"):
        read(tmp_path, scenario(event("go", leap, time_is(0)), stop=2))


def test_circles_of_places_and_catalogs(tmp_path: Path) -> None:
    circle = at("Ego", '<RelativeLanePosition entityRef="B" dLane="0" ds="1"/>') + at(
        "B", '<RelativeLanePosition entityRef="Ego" dLane="0" ds="1"/>'
    )
    with pytest.raises(DataError, match="which has no place of its own"):
        read(tmp_path, scenario(init=circle))
    reference = '<ScenarioObject name="Ego"><CatalogReference catalogName="cars" entryName="saloon"/></ScenarioObject>'
    with pytest.raises(DataError, match='no entry "saloon" in a catalog "cars"'):
        read(tmp_path, scenario(entities=reference + car("B")))


def test_nothing_ends_it(tmp_path: Path) -> None:
    """A story that waits for ever is cut, and so is one with no storyboard at all."""
    far = '<TraveledDistanceCondition value="999999"/>'
    case = read(tmp_path, scenario(event("go", speed_action(10), condition(far, entity="Ego")), stop=None))
    assert len(case.poses) in (601, 602)
    assert any("nothing begins or ends for 60 s" in note for note in case.notes)
    assert len(read(tmp_path, scenario(stop=None)).poses) == 201


def test_names_with_path_parts(tmp_path: Path) -> None:
    (tmp_path / "road.xodr").write_text(road())
    odd = tmp_path / "a b;..c%2F.xosc"
    odd.write_text(
        scenario(stop=1).replace('name="B"', 'name="../../b"').replace('entityRef="B"', 'entityRef="../../b"')
    )
    case = read_openscenario(odd)
    assert case.name == "a-b-c-2F"
    assert case.facts["vehicles"] == "Ego, ../../b"


@pytest.mark.full
def test_damaged_files_give_one_clear_error(tmp_path: Path) -> None:
    """400 files with random damage: read, or refused by an error of ours; nothing else, and never for long."""
    draw = random.Random(20)
    good = (DATA / "cut_in.xosc").read_text()
    plain = road().replace('id="1"', 'id="7"').replace("three", "two")
    (tmp_path / "Catalogs").mkdir()
    (tmp_path / "Catalogs" / "cars.xosc").write_bytes((DATA / "Catalogs" / "cars.xosc").read_bytes())
    words = [
        "",
        "0",
        "-1",
        "1e308",
        "nan",
        "$kmh",
        "${1/0}",
        "Ego",
        "Other",
        "<a/>",
        '"',
        "&lt;",
        "../x",
        "act",
        "16",
        "é",
    ]
    read_ones = refused = 0
    for k in range(400):
        text = list(good)
        for _ in range(draw.randint(1, 3)):
            place = draw.randrange(len(text))
            quotes = [i for i, c in enumerate(text) if c == '"']
            if k % 2 and len(quotes) > 10:  # another value for an attribute
                i = draw.randrange(len(quotes) - 1)
                text[quotes[i] + 1 : quotes[i + 1]] = draw.choice(words)
            elif k % 3:
                del text[place : place + draw.randint(1, 200)]
            else:
                text[place:place] = draw.choice(words)
        (tmp_path / "three_lanes.xodr").write_text(plain if k % 7 else plain[: draw.randrange(len(plain))])
        (tmp_path / "case.xosc").write_text("".join(text))
        try:
            case = read_openscenario(tmp_path / "case.xosc")
        except CornerForgeError:
            refused += 1
        else:
            assert np.isfinite(case.poses[0, 0]).all()
            read_ones += 1
    assert read_ones > 15
    assert refused > 150


def test_half_files(tmp_path: Path) -> None:
    text = scenario(event("go", speed_action(10), time_is(1)))
    (tmp_path / "road.xodr").write_text(road())
    for share in (0.0, 0.1, 0.5, 0.99):
        (tmp_path / "case.xosc").write_text(text[: int(share * len(text))])
        with pytest.raises(FileFormatError, match="no whole XML file"):
            read_openscenario(tmp_path / "case.xosc")
