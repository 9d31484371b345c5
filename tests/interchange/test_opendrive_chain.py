"""Chains of roads of OpenDRIVE files: linked, driven against their lines, through junctions, and those refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.errors import CornerForgeError
from cornerforge.experiment.roads import read_road
from cornerforge.ext.interchange.road_import import road_of_opendrive
from cornerforge.road.network import Road
from cornerforge.road.reference import ReferenceLine

SODERLEDEN = Path(__file__).parents[3] / "shared" / "data" / "osi" / "soderleden.xodr"
ON = ((-1, -1), (-2, -2))
LINE = ReferenceLine.of_curvature([(300.0, 0.0, 0.0), (200.0, 0.0, 0.002), (250.0, 0.002, 0.002)], (10.0, 20.0, 0.5))
"""Where the roads lie: 12 from 0 to 300 m, 13 to 500 m, drawn from its end to its begin, 14 to 750 m."""
WAY = '<connection id="{}" incomingRoad="{}" connectingRoad="{}" contactPoint="{}">{}</connection>'
JUNCTION = "".join((
    '<junction id="5">', WAY.format(0, 12, 13, "end", ""),
    WAY.format(1, 20, 21, "start", '<laneLink from="-1" to="-1"/>'),
    WAY.format(2, 12, 22, "start", '<laneLink from="-3" to="-1"/>'), "</junction>",
))  # fmt: skip


def geometry(begin: float, end: float, *, back: bool = False, gap: float = 0.0, kink: float = 0.0) -> str:
    """A piece of LINE, drawn against it if `back`; moved to the left and turned at its begin."""
    s, way = (end, -1.0) if back else (begin, 1.0)
    x, y, heading, _ = (float(part) for part in LINE.at(s))
    x, y, turn = x - gap * math.sin(heading), y + gap * math.cos(heading), heading + kink + (math.pi if back else 0.0)
    inside = [begin + 1e-9, end - 1e-9]
    first, last = (way * float(bend) for bend in LINE.at(inside[::-1] if back else inside).curvature)
    shape = f'<spiral curvStart="{first!r}" curvEnd="{last!r}"/>'
    if abs(last - first) < 1e-9:  # another reader takes no spiral that is an arc
        shape = f'<arc curvature="{first!r}"/>' if first else "<line/>"
    return f'<geometry s="0" x="{x!r}" y="{y!r}" hdg="{turn!r}" length="{end - begin!r}">{shape}</geometry>'


def lane(ident: int, before: Sequence[int] = (), after: Sequence[int] = ()) -> str:
    links = [f'<predecessor id="{one}"/>' for one in before] + [f'<successor id="{one}"/>' for one in after]
    width = '<width sOffset="0" a="3.6" b="0" c="0" d="0"/>'
    return f'<lane id="{ident}" type="driving"><link>{"".join(links)}</link>{width}</lane>'


def section(*lanes: str, s: float = 0.0) -> str:
    left, right = ("".join(one for one in lanes if ('lane id="-' in one) == is_right) for is_right in (False, True))
    sides = f"<left>{left}</left>" * bool(left), f"<right>{right}</right>" * bool(right)
    return f'<laneSection s="{s}">{sides[0]}<center><lane id="0" type="none"/></center>{sides[1]}</laneSection>'


def link(tag: str, to: str) -> str:
    """The link of a road to "13 start", to junction "5", or to nothing."""
    ident, _, end = to.partition(" ")
    if not to:
        return ""
    contact = f'elementType="road" contactPoint="{end}"' if end else 'elementType="junction"'
    return f'<{tag} elementId="{ident}" {contact}/>\n'


def road(
    ident: str, length: float, shape: str, lanes: str, before: str = "", after: str = "", junction: str = "-1"
) -> str:
    links = f"<link>{link('predecessor', before)}{link('successor', after)}</link>"
    return (
        f'\n<road id="{ident}" length="{length!r}" junction="{junction}">{links}<planView>{shape}</planView>'
        f"<lanes>{lanes}</lanes></road>"
    )


def written(path: Path, *roads: str) -> Path:
    path.write_text(f'<OpenDRIVE><header revMajor="1" revMinor="6"/>{"".join(roads)}</OpenDRIVE>', encoding="utf-8")
    return path


def three(**changed: str) -> dict[str, str]:
    """Roads 12, 13 and 14 in a row with two lanes, the middle one drawn against the travel."""
    right = section(lane(-1, [1], [1]), lane(-2, [2], [2]))
    return {
        "12": road("12", 300.0, geometry(0.0, 300.0), right, after="13 end"),
        "13": road("13", 200.0, geometry(300.0, 500.0, back=True), section(lane(1, [-1], [-1]), lane(2, [-2], [-2])),
                   before="14 start", after="12 end"),
        "14": road("14", 250.0, geometry(500.0, 750.0), right, before="13 start"),
    } | changed  # fmt: skip


def lanes_of(found: Road) -> list[tuple[int, float, float, str]]:
    return [(one.slot, round(one.begin, 3), round(one.end, 3), one.kind) for one in found.lanes]


def test_roads_in_a_row_are_one_road_whichever_way_they_are_drawn(tmp_path: Path) -> None:
    file = written(tmp_path / "row.xodr", *three().values())
    found = road_of_opendrive(file)
    assert (found.name, found.length, found.centres) == ("row 12 to 14", 750.0, (-5.4, -1.8))
    assert lanes_of(found) == [(0, 0.0, 750.0, "through"), (1, 0.0, 750.0, "through")]
    s = np.linspace(0.0, 750.0, 1501)
    ours, drawn = found.line.at(s, -5.4), LINE.at(s, -5.4)
    assert np.hypot(ours.x - drawn.x, ours.y - drawn.y).max() < 1e-6
    assert np.abs(np.remainder(ours.heading - drawn.heading + 1.0, 2.0 * np.pi) - 1.0).max() < 1e-7
    assert found.line.gaps.max() < 1e-6
    assert road_of_opendrive(file, ident="12, 13,14") == found
    assert lanes_of(road_of_opendrive(file, ident="12")) == [(0, 0.0, 300.0, "through"), (1, 0.0, 300.0, "through")]
    part = road_of_opendrive(file, begin=250.0, end=620.0)
    places = np.array([0.0, 100.0, 370.0])
    np.testing.assert_allclose(part.pose_at(places, 2.0), found.pose_at(places + 250.0, 2.0), atol=1e-6)
    assert road_of_opendrive(file, begin=300.0, end=500.0).name == "row 13"


def test_traffic_the_other_way_takes_the_same_roads_back(tmp_path: Path) -> None:
    ids = (-1, 1, 2)
    file = written(
        tmp_path / "both.xodr",
        road("12", 300.0, geometry(0.0, 300.0), section(*(lane(k, [], [-k]) for k in ids)), after="13 end"),
        road("13", 200.0, geometry(300.0, 500.0, back=True), section(*(lane(k, [-k], [-k]) for k in (1, -1, -2))),
             "14 start", "12 end"),
        road("14", 250.0, geometry(500.0, 750.0), section(*(lane(k, [-k]) for k in ids)), before="13 start"),
    )  # fmt: skip
    along, back = road_of_opendrive(file), road_of_opendrive(file, against=True)
    assert (along.name, back.name) == ("both 12 to 14", "both 14 to 12")
    there, here = back.line.at(120.0, -2.0), along.line.at(630.0, 2.0)
    np.testing.assert_allclose([there.x, there.y], [here.x, here.y], atol=1e-6)
    assert road_of_opendrive(file, ident="14,13,12") == back


def test_a_lane_without_a_link_ends_and_another_may_begin_in_its_place(tmp_path: Path) -> None:
    loose = {"14": road("14", 250.0, geometry(500.0, 750.0), section(lane(-1, [1]), lane(-2)), before="13 start")}
    thirteen = section(lane(1, [-1], [-1]), lane(2, [], [-2]))
    loose["13"] = road("13", 200.0, geometry(300.0, 500.0, back=True), thirteen, "14 start", "12 end")
    found = road_of_opendrive(written(tmp_path / "loose.xodr", *three(**loose).values()))
    assert lanes_of(found) == [(0, 0.0, 500.0, "through"), (0, 501.0, 750.0, "through"), (1, 0.0, 750.0, "through")]
    assert found.ends_ahead(0, 400.0) == 100.0


def joined(**changed: str) -> list[str]:
    """Road 12 with an exit lane, 13 in junction 5, and 14 with an entry; 20 joins and 23 leaves, by 21 and 22."""
    three_ = section(lane(-1), lane(-2), lane(-3))
    entry = section(lane(-1), lane(-2), lane(-3)), section(lane(-1), lane(-2), s=150.0)
    beside = geometry(300.0, 500.0)
    roads = {
        "12": road("12", 300.0, geometry(0.0, 300.0), three_, after="5"),
        "13": road("13", 200.0, geometry(300.0, 500.0, back=True), section(lane(1, [-1], [-1]), lane(2, [-2], [-2])),
                   "14 start", "12 end", "5"),
        "14": road("14", 250.0, geometry(500.0, 750.0), "".join(entry), before="5"),
        "20": road("20", 200.0, geometry(0.0, 200.0), section(lane(-1)), after="5"),
        "21": road("21", 200.0, beside, section(lane(-1, [-1], [-3])), "20 end", "14 start", "5"),
        "22": road("22", 200.0, beside, section(lane(-1, [-3], [-1])), "12 end", "23 start", "5"),
        "23": road("23", 80.0, geometry(0.0, 80.0), section(lane(-1)), before="5"),
        "junction": JUNCTION,
    }  # fmt: skip
    return list((roads | changed).values())


def test_through_a_junction_it_goes_on_where_most_lanes_do(tmp_path: Path) -> None:
    file = written(tmp_path / "junction.xodr", *joined())
    found = road_of_opendrive(file)
    assert found == road_of_opendrive(file, ident="12,13,14")
    assert lanes_of(found) == [
        (0, 0.0, 300.0, "deceleration"), (0, 500.0, 650.0, "acceleration"), (1, 0.0, 750.0, "through"),
        (2, 0.0, 750.0, "through"),
    ]  # fmt: skip
    assert found.notes == ("roads that join are left out: 20", "roads that leave are left out: 23")


def test_a_lane_that_begins_in_a_junction_on_a_road_of_its_own_comes_from_no_ramp(tmp_path: Path) -> None:
    widens = road("30", 200.0, geometry(300.0, 500.0), section(lane(-1, [-2], [-3])), "12 end", "14 start", "5")
    found = road_of_opendrive(written(tmp_path / "wide.xodr", *joined(**{"20": "", "21": ""}, widens=widens)))
    assert lanes_of(found)[1] == (0, 500.0, 650.0, "through")
    assert found.notes == ("roads that leave are left out: 23",)


def test_a_direct_junction_is_passed_where_its_roads_are_named(tmp_path: Path) -> None:
    ways = "".join(f'<laneLink from="{a}" to="{b}"/>' for a, b in ON)
    junction = f'<junction id="8" type="direct"><connection incomingRoad="1" linkedRoad="2" contactPoint="start">{ways}'
    first = road("1", 300.0, geometry(0.0, 300.0), section(lane(-1), lane(-2)), after="8")
    second = road("2", 200.0, geometry(300.0, 500.0), section(lane(-1), lane(-2)), before="8")
    file = written(tmp_path / "direct.xodr", first, second, f"{junction}</connection></junction>")
    assert road_of_opendrive(file).length == 300.0
    assert lanes_of(road_of_opendrive(file, ident="1,2")) == [(0, 0.0, 500.0, "through"), (1, 0.0, 500.0, "through")]


RIGHT = section(lane(-1, [1], [1]), lane(-2, [2], [2]))
ACROSS = road("30", 20.0, geometry(400.0, 420.0), section(lane(-1)), "31 end", "32 start", "5")
BESIDE = road("30", 200.0, geometry(300.0, 500.0), section(lane(-1, [-3], [-3])), "12 end", "14 start", "5")
REFUSED: dict[str, tuple[list[str], str]] = {
    "a gap": (
        list(three(**{"14": road("14", 250.0, geometry(500.0, 750.0, gap=0.2), RIGHT, "13 start")}).values()),
        r"line 7: road 14 begins 0\.20 m and 0\.000 rad from the end of the road before it; 0\.05 m and 0\.02 rad",
    ),
    "a kink": (
        list(three(**{"14": road("14", 250.0, geometry(500.0, 750.0, kink=0.05), RIGHT, "13 start")}).values()),
        r"line 7: road 14 begins 0\.00 m and 0\.050 rad",
    ),
    "a link elsewhere": (
        list(three(**{"14": road("14", 250.0, geometry(500.0, 750.0), RIGHT, "12 end")}).values()),
        r"line 7: the start of road 14 is linked to road 12, not to the end of road 13 that is linked to it\.",
    ),
    "lanes linked sideways": (
        list(three(**{
            "13": road("13", 200.0, geometry(300.0, 500.0, back=True),
                       section(lane(1, [-2], [-1]), lane(2, [-1], [-2])), "14 start", "12 end"),
            "14": road("14", 250.0, geometry(500.0, 750.0), section(lane(-1, [2]), lane(-2, [1])), "13 start"),
        }).values()),
        r"line 8: lane -[12] is linked to lane [12], which ends 3\.60 m beside: not represented",
    ),
    "a road across": (joined(across=ACROSS), r"line \d+: in junction 5 road 30 leads beside or across road 13"),
    "lanes on several roads": (joined(beside=BESIDE), r"line \d+: in junction 5 road 30 leads beside road 13"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_one_road_is_refused_with_its_line(what: str, tmp_path: Path) -> None:
    roads, message = REFUSED[what]
    with pytest.raises(CornerForgeError, match=rf"^bad\.xodr, {message}"):
        road_of_opendrive(written(tmp_path / "bad.xodr", *roads), ident="12,13,14")


@pytest.mark.parametrize("what", ["a road across", "lanes on several roads"])
def test_the_longest_chain_ends_before_a_junction_that_is_refused(what: str, tmp_path: Path) -> None:
    assert road_of_opendrive(written(tmp_path / "ends.xodr", *REFUSED[what][0])).name == "ends 12"


def test_a_ring_is_taken_once(tmp_path: Path) -> None:
    turn = 250.0 * math.pi
    half = '<geometry s="0" x="0" y="{}" hdg="{}" length="{!r}"><arc curvature="0.004"/></geometry>'
    lanes = section(lane(-1, [-1], [-1]))
    file = written(
        tmp_path / "ring.xodr",
        road("1", turn, half.format(0, 0, turn), lanes, "2 end", "2 start"),
        road("2", turn, half.format(500, math.pi, turn), lanes, "1 end", "1 start"),
    )
    assert road_of_opendrive(file).length == pytest.approx(2.0 * turn)
    assert road_of_opendrive(file, ident="2,1").length == pytest.approx(2.0 * turn)


ASKED = {
    "12,15": r"no road '15'; it has 12, 13, 14",
    "12,13,12": r"names a road twice",
    "12,14": r"line 2: no link leads from road 12 on to road 14",
    "14,13": r"road 14 has no lane that is driven against its line",
}


@pytest.mark.parametrize("names", ASKED)
def test_names_that_are_no_chain(names: str, tmp_path: Path) -> None:
    with pytest.raises(CornerForgeError, match=ASKED[names]):
        road_of_opendrive(written(tmp_path / "row.xodr", *three().values()), ident=names)


def test_what_is_asked_of_a_chain_in_vain(tmp_path: Path) -> None:
    file = written(tmp_path / "row.xodr", *three().values())
    with pytest.raises(CornerForgeError, match="leave out --against"):
        road_of_opendrive(file, ident="12,13", against=True)
    with pytest.raises(CornerForgeError, match=r"The chain of roads 12 to 14 has s from 0 to 750 m; from 100 to 800"):
        road_of_opendrive(file, begin=100.0, end=800.0)


def test_the_command(tmp_path: Path) -> None:
    file, out = written(tmp_path / "row.xodr", *three().values()), tmp_path / "row.json"
    told = cornerforge.road_import(file, out=out, road="12,13,14", begin=50.0)
    assert (told.name, told.length_m, told.files) == ("row 12 to 14", 700.0, (str(out),))
    assert read_road(out) == road_of_opendrive(file, begin=50.0)


@pytest.mark.skipif(not SODERLEDEN.exists(), reason="the folder shared/data/osi is not beside the repository")
def test_a_real_motorway_goes_on_through_its_direct_junction() -> None:
    assert road_of_opendrive(SODERLEDEN).name == "soderleden 0"
    found = road_of_opendrive(SODERLEDEN, ident="2,0")
    assert lanes_of(found)[0] == (0, 239.843, 322.824, "acceleration")
    assert found.notes == ("roads that join are left out: 5",)
    assert found.line.gaps.max() < 0.01
