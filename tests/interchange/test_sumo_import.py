"""Roads of SUMO networks: one that netconvert made, and what damages of it say."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import CornerForgeError, DataError, FileFormatError
from cornerforge.experiment.roads import road_named
from cornerforge.ext.interchange.sumo_import import road_of_sumo
from cornerforge.road.network import Road

MOTORWAY = Path(__file__).parent / "data" / "motorway.net.xml"
TEXT = MOTORWAY.read_text(encoding="utf-8")
WITHIN = 0.05
STRAIGHT_ON = r"(ab|bc|cd|de|ef|fg|:b_1|:c_0|:e_1|:f_0)_\d"
MCITY = Path(__file__).parent / "data" / "mcity.net.xml.gz"


def lanes_of(road: Road) -> list[tuple[int, float, float, str]]:
    return [(one.slot, round(one.begin, 1), round(one.end, 1), one.kind) for one in road.lanes]


def changed(tmp_path: Path, *pairs: tuple[str, str], pattern: str = "", to: str = "") -> Path:
    text = re.sub(pattern, to, TEXT, count=1) if pattern else TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    assert text != TEXT
    file = tmp_path / "changed.net.xml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_ramp_joins_an_exit_leaves_a_lane_ends_and_limits_change() -> None:
    road = road_of_sumo(MOTORWAY)
    assert lanes_of(road) == [
        (0, 565.9, 846.0, "acceleration"), (0, 1404.0, 1562.3, "deceleration"), (1, 0.0, 2296.0, "through"),
        (2, 0.0, 2304.0, "through"), (2, 2304.0, 2700.8, "through"), (3, 0.0, 2304.0, "through"),
        (3, 2304.0, 2700.8, "through"),
    ]  # fmt: skip
    assert {one.limit for one in road.lanes} == {33.33, 27.78}
    assert road.lane_width == 3.2
    left, right = road.lanes[5], road.lanes[2]
    assert [left.may_cross(s, left=False) for s in (800.0, 900.0, 1500.0)] == [True, False, True]  # changeRight
    assert [right.may_cross(s, left=False) for s in (500.0, 700.0, 900.0)] == [False, True, False]
    assert not left.may_cross(500.0, left=True)
    assert road.notes == ("edges that join are left out: rb", "edges that leave are left out: ex")


def test_lanes_lie_where_the_file_has_them_at_its_points_and_between() -> None:
    road, off = road_of_sumo(MOTORWAY), []
    for lane in ElementTree.fromstring(TEXT).iterfind("edge/lane"):
        if re.fullmatch(STRAIGHT_ON, lane.attrib["id"]):
            drawn = np.array([[float(number) for number in point.split(",")] for point in lane.attrib["shape"].split()])
            points = np.concatenate([a + np.linspace(0, 1, 20)[:, None] * (b - a) for a, b in pairwise(drawn)])
            s, y = road.project(*points.T)
            slot = np.floor(y / road.lane_width).astype(int)
            pose = road.pose_at(s, (slot + 0.5) * road.lane_width)
            inside = (s > 0.0) & (s < road.length)
            off += np.hypot(pose.x - points[:, 0], pose.y - points[:, 1])[inside].tolist()
    assert len(off) > 2_000
    assert max(off) < WITHIN


def test_named_edges_a_stretch_and_a_packed_file(tmp_path: Path) -> None:
    packed = tmp_path / "motorway.net.xml.gz"
    packed.write_bytes(gzip.compress(TEXT.encode()))
    whole, road = road_of_sumo(MOTORWAY), road_of_sumo(packed, edges="ab, bc", begin=200.0, end=700.0)
    assert lanes_of(road) == [
        (0, 365.9, 500.0, "acceleration"), *((slot, 0.0, 500.0, "through") for slot in (1, 2, 3)),
    ]  # fmt: skip
    np.testing.assert_allclose(road.pose_at(100.0, 5.0), whole.pose_at(300.0, 5.0), atol=0.01)
    packed.write_bytes(packed.read_bytes()[:-500])
    with pytest.raises(FileFormatError, match=r"motorway.net.xml.gz is no whole gzip file"):
        road_of_sumo(packed)
    packed.write_bytes(gzip.compress(b"<net>" + b" " * 65 * 2**20))
    with pytest.raises(FileFormatError, match="up to 64 MB are read"):
        road_of_sumo(packed)


def test_a_lane_that_cars_may_not_use_is_closed_where_one_goes_on(tmp_path: Path) -> None:
    road = road_of_sumo(changed(tmp_path, ('id="cd_2" index="2"', 'id="cd_2" index="2" allow="bus"')))
    assert [one[1:] for one in lanes_of(road) if one[0] == 3] == [
        (0.0, 854.0, "through"), (854.0, 1404.0, "closed"), (1404.0, 2304.0, "through"), (2304.0, 2700.8, "through"),
    ]  # fmt: skip
    bus = changed(tmp_path, ('id="ab_0" index="0"', 'id="ab_0" index="0" disallow="passenger"'))
    assert lanes_of(road_of_sumo(bus))[2:4] == [(1, 0.0, 565.9, "closed"), (1, 565.9, 2296.0, "through")]
    stop = changed(tmp_path, ('id="ab_0" index="0"', 'id="ab_0" index="0" type="stop"'))
    assert lanes_of(road_of_sumo(stop))[2] == (1, 565.9, 2296.0, "through")


def test_points_far_apart_make_a_smooth_road_that_says_how_far_it_is_off(tmp_path: Path) -> None:
    shape = "1565.48,68.56 1665.3,62.3 1764.5,50 1862,33"
    road = road_of_sumo(changed(tmp_path, pattern=r'(id="ex_0".*shape=")[^"]*', to=rf"\g<1>{shape}"), edges="ex")
    assert road.line.tightest > 100.0
    assert re.search(r"misses their way by 0\.\d\d m", " ".join(road.notes))


BACK = (
    '<edge id="ba" from="b" to="a"><lane id="ba_0" index="0" speed="30" length="562.5" '
    'shape="562.5,{0} 0,{0}"/></edge><junction id="a"'
)
ACROSS = (
    '<edge id="y1" from="y" to="c"><lane id="y1_0" index="0" speed="9" length="9" shape="850,60 850,70"/></edge>'
    '<edge id="y2" from="c" to="z"><lane id="y2_0" index="0" speed="9" length="9" shape="850,80 850,90"/></edge>'
    '<connection from="y1" to="y2" fromLane="0" toLane="0" dir="s" state="M"/><junction id="a"'
)
REFUSED: dict[str, tuple[tuple[str, str], str]] = {
    "the left": (('version="1.20"', 'version="1.20" lefthand="true"'), r"line 19: its traffic drives on the left"),
    "lights": (('id="c" type="priority"', 'id="c" type="traffic_light"'), "junction c,.* has traffic lights"),
    "rails": (('id="c" type="priority"', 'id="c" type="rail_crossing"'), "junction c,.* has a rail crossing"),
    "people": (
        ('<junction id="a"', '<edge id=":c_c0" function="crossing"/><junction id="a"'),
        r"line \d+: junction c, to which edge bc leads, has a crossing for people",
    ),
    "ramp lights": (
        ('from="rb" to="bc" fromLane="0"', 'tl="m" from="rb" to="bc" fromLane="0"'), "junction b,.* has traffic lights",
    ),
    "across": (('<junction id="a"', ACROSS), r"line \d+: at junction c edge y1 leads to edge y2, beside or across"),
    "both ways": (('<junction id="a"', BACK.format(75.2)), r"edge ba \(line \d+\) leads the other way over the same"),
    "narrow": (('id="bc_2"', 'width="2.2" id="bc_2"'), 'width of lane is "2.2"; allowed: 2.5 to 6 m'),
    "sideways": (("565.92,72.00 846.00,72.00", "565.92,72.00 846.00,73.00"), "lane bc_1 shifts sideways by 1.0"),
    "folded": (("565.92,72.00 846.00,72.00", "565.92,72.00 846,72 700,72"), "lane bc_1 turns back"),
    "sharp": (("565.92,78.40 846.00,78.40", "565.92,78.40 700,60 846.00,78.40"), r"misses their way by \d\.\d m"),
    "no shape": (('shape="565.92,72.00 846.00,72.00"', ""), "line 59: lane lacks shape"),
    "empty shape": (("565.92,72.00 846.00,72.00", ""), "bc_1 has 0; 2 to 10,000 points that lie apart"),
    "one point": (("565.92,72.00 846.00,72.00", "5,5 5,5"), "bc_1 has 1; 2 to 10,000 points that lie apart"),
    "NaN": (("565.92,72.00 846.00,72.00", "565.92,72.00 nan,72.00"), 'bc_1 has the point "nan,72.00"; x,y'),
    "huge": (("565.92,72.00 846.00,72.00", "565.92,72.00 1e300,72.00"), 'bc_1 has the point "1e300,72.00"'),
    "words": (("565.92,72.00 846.00,72.00", "565.92,72.00 here"), 'bc_1 has the point "here"'),
    "index twice": (('id="bc_1" index="1"', 'id="bc_1" index="0"'), "edge bc has two lanes of index 0"),
    "edge twice": (('id="cd" from="c" to="d" pri', 'id="bc" from="c" to="d" pri'), "edge bc is there twice"),
    "length 0": (('length="280.08"', 'length="0"'), 'length of lane is "0"; allowed: 0.1 to 1000000 m'),
    "huge length": (('length="280.08"', 'length="1e300"'), 'length of lane is "1e300"'),
    "speed": (('id="bc_1" index="1" speed="33.33"', 'id="bc_1" index="1" speed="-1"'), 'speed of lane is "-1"'),
    "no such lane": (('to="cd" fromLane="3"', 'to="cd" fromLane="7"'), "it connects lane 7 of edge bc, which has none"),
    "no such way": (('via=":c_0_2"', 'via=":c_9_2"'), "it goes via lane :c_9_2, which is not there"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_represented_or_is_damaged_is_refused_in_a_line(what: str, tmp_path: Path) -> None:
    pair, message = REFUSED[what]
    with pytest.raises(DataError, match=message) as caught:
        road_of_sumo(changed(tmp_path, pair), edges="ab,bc,cd,de,ef")
    assert re.search(r"changed\.net\.xml, line \d+: ", str(caught.value))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_road_beside_that_leads_the_other_way_is_none_of_it(tmp_path: Path) -> None:
    road = road_of_sumo(changed(tmp_path, ('<junction id="a"', BACK.format(84.8))))
    assert lanes_of(road) == lanes_of(road_of_sumo(MOTORWAY))


def test_the_longest_chain_ends_at_lights(tmp_path: Path) -> None:
    road = road_of_sumo(changed(tmp_path, ('id="c" type="priority"', 'id="c" type="traffic_light"')))
    assert road.name == "changed cd"
    assert lanes_of(road)[0] == (0, 550.0, 708.3, "deceleration")


CALLS: dict[str, tuple[Callable[[], Road], str]] = {
    "edge": (lambda: road_of_sumo(MOTORWAY, edges="ab,no"), "no edge 'no' that cars may use; it has ab, bc"),
    "none": (lambda: road_of_sumo(MOTORWAY, edges=" , "), "no edge ''"),
    "order": (lambda: road_of_sumo(MOTORWAY, edges="ab,cd"), "line 63: no lane leads from edge ab to edge cd"),
    "stretch": (lambda: road_of_sumo(MOTORWAY, begin=100.0, end=3000.0), "s goes from 0 to 2700.7.* is none of it"),
    "short": (lambda: road_of_sumo(MOTORWAY, begin=100.0, end=150.0), "the road is 50 m long; 100 to 50000"),
    "other": (lambda: road_of_sumo(Path(__file__).parent / "data" / "three_lanes.xodr"), "this is not a SUMO network"),
}


@pytest.mark.parametrize("what", CALLS)
def test_what_a_user_asks_for_in_vain(what: str) -> None:
    call, message = CALLS[what]
    with pytest.raises(CornerForgeError, match=message):
        call()


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "motorway.json"
    told = cornerforge.road_import(MOTORWAY, out=out, road="ab,bc,cd")
    assert (told.name, told.slots, told.files) == ("motorway ab", 4, (str(out),))
    assert road_named(out) == road_of_sumo(MOTORWAY, edges="ab,bc,cd")
    assert main(["road", "import", str(MOTORWAY), "--against", "--out", str(tmp_path / "other.json")]) == 2
    assert "lead one way" in capsys.readouterr().err
    with pytest.raises(FileFormatError, match="no road file yet"):
        road_named(MOTORWAY)


def test_a_test_track_is_taken_piece_by_piece_or_refused_by_name() -> None:
    road = road_of_sumo(MCITY, edges="EG_1_3_1,EG_1_3_1.61")
    assert lanes_of(road)[0] == (0, 68.2, 137.5, "through")
    with pytest.raises(DataError, match=r"mcity.net.xml.gz, line \d+: edge EG_12_1_1: the road is 6 m long"):
        road_of_sumo(MCITY, edges="EG_12_1_1")


def test_a_network_without_edges_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.net.xml"
    path.write_text('<net version="1.20"/>', encoding="utf-8")
    with pytest.raises(CornerForgeError, match=r"none\.net\.xml has no edge that cars may use"):
        road_of_sumo(path)
