"""Roads of OpenDRIVE files: made by hand, esmini's, and those that must be refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import DataError, InputError
from cornerforge.experiment.roads import road_named
from cornerforge.ext.interchange.road_import import road_of_opendrive
from cornerforge.road.network import Road
from cornerforge.road.shipped import ROAD_FILES

LANE = '<lane id="{0}" type="{1}"><width sOffset="0" a="{2}" b="{3}" c="0" d="0"/>{4}</lane>'
GEOMETRY = (
    '<geometry s="0" x="10" y="20" hdg="0.5" length="300"><line/></geometry>'
    '<geometry s="300" x="{x1!r}" y="{y1!r}" hdg="0.5" length="200"><arc curvature="0.002"/></geometry>'
)
MARK = '<roadMark sOffset="0" type="{0}"/>'
E6MINI = Path(__file__).parents[3] / "shared" / "data" / "osi" / "e6mini.xodr"
AFTER = 10 + 300 * math.cos(0.5), 20 + 300 * math.sin(0.5)


def lane(ident: int, kind: str = "driving", a: float = 3.6, b: float = 0.0, more: str = "") -> str:
    return LANE.format(ident, kind, a, b, more)


def written(path: Path, *sections: str, extra: str = "", geometry: str = "") -> Path:
    shape = geometry or GEOMETRY.format(x1=AFTER[0], y1=AFTER[1])
    path.write_text(
        f'<OpenDRIVE><header revMajor="1" revMinor="6"/>\n<road id="7" length="500" junction="-1">'
        f'<type s="0" type="motorway"><speed max="100" unit="km/h"/></type><planView>{shape}</planView>{extra}'
        f"<lanes>{''.join(sections)}</lanes></road></OpenDRIVE>",
        encoding="utf-8",
    )
    return path


def section(s: float, *right: str, left: str = "", middle: str = MARK.format("solid")) -> str:
    sides = f"<left>{left}</left>" if left else ""
    centre = f'<center><lane id="0" type="none">{middle}</lane></center>'
    return f'<laneSection s="{s}">{sides}{centre}<right>{"".join(right)}</right></laneSection>'


@pytest.fixture
def merging(tmp_path: Path) -> Path:
    """Two lanes, and from 100 to 300 m an entry that then becomes narrower for 50 m."""
    two = lane(-1, more=MARK.format("broken")), lane(-2, more=MARK.format("solid"))
    open_ = (*two[:1], lane(-2, more=MARK.format("broken")), lane(-3, "entry", more='<speed max="60" unit="km/h"/>'))
    return written(
        tmp_path / "merging.xodr", section(0, *two), section(100, *open_),
        section(300, *two, lane(-3, "entry", 3.6, -3.6 / 50, '<speed max="60" unit="km/h"/>')), section(350, *two),
    )  # fmt: skip


def test_lanes_begin_and_end_with_kinds_marks_and_limits(merging: Path) -> None:
    road = road_of_opendrive(merging)
    assert road.centres == pytest.approx((-9.0, -5.4, -1.8))
    assert road.lane_width == pytest.approx(3.6)
    entry, right, left = road.lanes
    assert (entry.slot, entry.kind, entry.begin) == (0, "acceleration", 100.0)
    assert entry.end == pytest.approx(300.0 + 50.0 * (3.6 - 2.5) / 3.6, abs=1.0)  # 2.5 m can be driven
    assert (entry.limit, right.limit) == pytest.approx((60 / 3.6, 100 / 3.6))
    assert (right.begin, right.end, left.begin, left.end) == (0.0, 500.0, 0.0, 500.0)
    assert [right.may_cross(s, left=False) for s in (50.0, 200.0, 400.0)] == [False, True, False]
    assert right.may_cross(50.0, left=True)
    assert not left.may_cross(50.0, left=True)


def test_it_lies_in_the_world_where_the_file_says(merging: Path) -> None:
    road = road_of_opendrive(merging)
    x, y, heading, _ = road.line.at([0.0, 300.0, 500.0])
    end = 0.5 + 0.4
    arc = AFTER[0] + 500 * (math.sin(end) - math.sin(0.5)), AFTER[1] + 500 * (math.cos(0.5) - math.cos(end))
    np.testing.assert_allclose(np.stack([x, y], axis=1), [(10.0, 20.0), AFTER, arc], atol=1e-9)
    np.testing.assert_allclose(heading, [0.5, 0.5, end])


def test_a_stretch_and_the_other_direction_are_the_same_place(tmp_path: Path) -> None:
    file = written(tmp_path / "two.xodr", section(0, lane(-1), left=lane(1) + lane(2)))
    part, whole = road_of_opendrive(file, begin=250.0, end=450.0), road_of_opendrive(file)
    np.testing.assert_allclose(part.pose_at(100.0, 1.0), whole.pose_at(350.0, 1.0), atol=1e-9)
    other = road_of_opendrive(file, against=True)
    assert other.slots == 2
    there, here = other.line.at(120.0, -2.0), whole.line.at(380.0, 2.0)
    turned = here.x, here.y, here.heading + math.pi, -here.curvature
    np.testing.assert_allclose(there, turned, atol=1e-8)


def test_a_polynomial_that_is_a_circle_is_one(tmp_path: Path) -> None:
    """The cubic that meets an arc of 400 m with its headings, as drawing programs write it; off by less than 1 mm."""
    turn, radius = 0.1, 400.0
    end = radius * math.sin(turn), radius * (1 - math.cos(turn))
    reach = radius * turn
    u = (0.0, reach, 3 * end[0] - 2 * reach - reach * math.cos(turn), -2 * end[0] + reach + reach * math.cos(turn))
    v = (0.0, 0.0, 3 * end[1] - reach * math.sin(turn), -2 * end[1] + reach * math.sin(turn))
    names = "".join(f' {n}U="{p!r}" {n}V="{q!r}"' for n, p, q in zip("abcd", u, v, strict=True))
    shape = (
        f'<geometry s="0" x="0" y="0" hdg="0" length="{reach!r}"><paramPoly3 pRange="normalized"{names}/></geometry>'
    )
    file = written(tmp_path / "poly.xodr", section(0, lane(-1)), geometry=shape)
    whole = file.read_text(encoding="utf-8")
    file.write_text(whole.replace('length="500"', f'length="{reach!r}"'), encoding="utf-8")
    road = road_of_opendrive(file)
    x, y, _, bend = road.line.at(np.linspace(0.0, reach, 200))
    np.testing.assert_allclose(np.hypot(x, y - radius), radius, atol=1e-3)
    np.testing.assert_allclose(bend, 1.0 / radius, rtol=0.01)


def test_a_polynomial_that_stands_still_is_refused_with_its_line(tmp_path: Path) -> None:
    shape = '<geometry s="0" x="0" y="0" hdg="0" length="500"><paramPoly3 pRange="normalized" cU="500"/></geometry>'
    with pytest.raises(DataError, match=r"still\.xodr, line 2: road 7: The line turns back"):
        road_of_opendrive(written(tmp_path / "still.xodr", section(0, lane(-1)), geometry=shape))


@pytest.mark.parametrize("shape", ['spiral curvStart="0" curvEnd="0.001"', 'paramPoly3 bU="1"'])
def test_a_piece_of_no_length_is_refused_with_its_line(shape: str, tmp_path: Path) -> None:
    drawn = f'<geometry s="0" x="0" y="0" hdg="0" length="0"><{shape}/></geometry>'
    with pytest.raises(DataError, match=r"none\.xodr, line 2: road 7: The (spiral|paramPoly3) of line 2 is 0 m long"):
        road_of_opendrive(written(tmp_path / "none.xodr", section(0, lane(-1)), geometry=drawn))


REFUSED = {
    "reversed": (section(0, LANE.format(-1, 'driving" direction="reversed', 3.6, 0, "")), ""),
    "driven both ways": (section(0, lane(-1, "bidirectional")), ""),
    "superelevation": (
        section(0, lane(-1)), '<lateralProfile><superelevation s="0" a="0.02" b="0" c="0" d="0"/></lateralProfile>',
    ),
    "shifts sideways": ('<laneOffset s="0" a="0" b="0.01" c="0" d="0"/>' + section(0, lane(-1), lane(-2)), ""),
    "8.00 m wide": (section(0, lane(-1, a=8.0)), ""),
    "no lane that is driven": (section(0, lane(-1, "shoulder")), ""),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_represented_is_refused_with_its_line(what: str, tmp_path: Path) -> None:
    lanes, extra = REFUSED[what]
    with pytest.raises(DataError, match=rf"bad\.xodr, line 2: .*{what}"):
        road_of_opendrive(written(tmp_path / "bad.xodr", lanes, extra=extra))


def test_ramps_and_closed_lanes_are_told_by_their_lines_and_neighbours(tmp_path: Path) -> None:
    """An onRamp is a ramp where its line is solid; a restricted lane counts where an open one goes on in its place."""
    ramp = [
        section(s, lane(-1, one), lane(-2, more=MARK.format(mark)), lane(-3, "onRamp"), lane(-4, "restricted"))
        for s, one, mark in ((0, "driving", "solid"), (200, "restricted", "broken"))
    ]
    road = road_of_opendrive(written(tmp_path / "ramp.xodr", *ramp))
    found = [(one.slot, one.kind, one.begin, one.end) for one in road.lanes]
    assert found == [
        (0, "ramp", 0.0, 200.0), (0, "acceleration", 200.0, 500.0), (1, "through", 0.0, 500.0),
        (2, "through", 0.0, 200.0), (2, "closed", 200.0, 500.0),
    ]  # fmt: skip
    with pytest.raises(DataError, match="no lane that is driven"):
        road_of_opendrive(written(tmp_path / "none.xodr", section(0, lane(-1, "restricted"))))


def test_a_road_or_stretch_that_the_file_lacks(merging: Path) -> None:
    with pytest.raises(InputError, match="no road '8'; it has 7"):
        road_of_opendrive(merging, ident="8")
    with pytest.raises(InputError, match="s from 0 to 500 m"):
        road_of_opendrive(merging, begin=400.0, end=600.0)


@pytest.mark.skipif(not E6MINI.exists(), reason="the folder shared/data/osi is not beside the repository")
def test_the_real_road_that_is_shipped_is_what_import_makes_of_its_source() -> None:
    assert road_of_opendrive(E6MINI) == road_named("e6mini")


def test_the_licence_of_the_real_road_lies_beside_it() -> None:
    text = ROAD_FILES["e6mini"].with_suffix(".LICENSE.txt").read_text(encoding="utf-8")
    assert "cornerforge road import e6mini.xodr" in text
    assert "Mozilla Public License Version 2.0" in text


def test_the_commands(merging: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "merging.json"
    told = cornerforge.road_import(merging, out=out, begin=50.0)
    assert told.files == (str(out),)
    read: Road = road_named(out)
    assert (read.length, told.length_m, told.tightest_m) == (450.0, 450.0, 500.0)
    assert main(["road", "check", str(out)]) == 0
    assert main(["road", "show", str(out), "--out", str(tmp_path / "road.svg"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["files"] == [str(tmp_path / "road.svg")]
    assert (tmp_path / "road.svg").read_text(encoding="utf-8").count("<path") > 10
    assert main(["road", "show", str(out), "--out", str(tmp_path / "road.txt")]) == 2
    assert "neither in .png nor in .svg" in capsys.readouterr().err
    content = json.loads(out.read_text(encoding="utf-8"))
    del content["sha256"], content["lanes"][1:]
    out.write_text(json.dumps(content), encoding="utf-8")
    assert main(["road", "check", str(out)]) != 0
