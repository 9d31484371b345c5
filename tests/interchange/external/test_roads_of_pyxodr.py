"""Another reader of OpenDRIVE sees lanes where `road import` puts them, and where we wrote them, within 5 cm.

It needs an environment of its own (`make test-interchange` makes it and names its Python in ASAM_PYTHON).
"""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ext.interchange.opendrive import write_road_once
from cornerforge.ext.interchange.road_import import road_of_opendrive
from cornerforge.road.network import Road
from cornerforge.types import Odd

pytestmark = pytest.mark.interchange

REFEREE = Path(__file__).with_name("pyxodr_referee.py")
WITHIN = 0.05
LANE = (
    '<lane id="{}" type="{}"><width sOffset="0" a="{}" b="0" c="0" d="0"/><roadMark sOffset="0" type="broken"/></lane>'
)
# Line, clothoid, arc, clothoid, and a cubic; lanes 3.5, 3.75 and, from 200 to 500 m, 3.25 m wide.
GEOMETRY = """
<geometry s="0" x="100" y="-40" hdg="0.7" length="150"><line/></geometry>
<geometry s="150" x="{0[0]!r}" y="{0[1]!r}" hdg="{0[2]!r}" length="120">
<spiral curvStart="0" curvEnd="0.0015"/></geometry>
<geometry s="270" x="{1[0]!r}" y="{1[1]!r}" hdg="{1[2]!r}" length="250"><arc curvature="0.0015"/></geometry>
<geometry s="520" x="{2[0]!r}" y="{2[1]!r}" hdg="{2[2]!r}" length="200">
<paramPoly3 pRange="arcLength" aU="0" bU="1" cU="0" dU="0" aV="0" bV="0" cV="0.0004" dV="-0.000001"/></geometry>
"""


def begins() -> list[tuple[float, float, float]]:
    """Where each piece behind the first begins, by summing up 1 mm steps."""
    s = np.arange(0.0, 520.0, 1e-3)
    bend = np.interp(s, [0.0, 150.0, 270.0, 520.0], [0.0, 0.0, 0.0015, 0.0015])
    heading = 0.7 + np.concatenate([[0.0], np.cumsum(0.5 * (bend[1:] + bend[:-1]) * 1e-3)])
    x = 100.0 + np.concatenate([[0.0], np.cumsum(np.cos(heading[:-1]) * 1e-3)])
    y = -40.0 + np.concatenate([[0.0], np.cumsum(np.sin(heading[:-1]) * 1e-3)])
    return [(float(x[k]), float(y[k]), float(heading[k])) for k in (150_000, 270_000, s.size - 1)]


def section(s: float, *lanes: tuple[str, float]) -> str:
    right = "".join(LANE.format(-k, kind, width) for k, (kind, width) in enumerate(lanes, start=1))
    return f'<laneSection s="{s}"><center><lane id="0" type="none"/></center><right>{right}</right></laneSection>'


def test_its_lanes_lie_where_ours_do(tmp_path: Path) -> None:
    python = os.environ.get("ASAM_PYTHON", "")
    if not python:
        pytest.skip("ASAM_PYTHON names no environment; run `make test-interchange`")
    two, entry = (("driving", 3.5), ("driving", 3.75)), ("entry", 3.25)
    file = tmp_path / "road.xodr"
    file.write_text(
        f'<OpenDRIVE><header revMajor="1" revMinor="6"/><road id="1" length="720" junction="-1" name="r"><link/>'
        f"<planView>{GEOMETRY.format(*begins())}</planView><lanes>{section(0, *two)}{section(200, *two, entry)}"
        f"{section(500, *two)}</lanes></road></OpenDRIVE>",
        encoding="utf-8",
    )
    seen = lanes_seen(python, file)
    assert sorted(one["lane"] for one in seen) == [-3, -2, -2, -2, -1, -1, -1]
    assert_lanes_lie(seen, road_of_opendrive(file))


def test_the_lanes_of_a_chain_lie_where_ours_do(tmp_path: Path) -> None:
    """The same line as three roads, the arc drawn from its end to its begin, with lanes on its left."""
    python = os.environ.get("ASAM_PYTHON", "")
    if not python:
        pytest.skip("ASAM_PYTHON names no environment; run `make test-interchange`")
    line, spiral, _, cubic = (f"<geometry {one}" for one in GEOMETRY.format(*begins()).split("<geometry ")[1:])
    x, y, heading = begins()[2]
    pose = f's="0" x="{x!r}" y="{y!r}" hdg="{heading + np.pi!r}" length="250"'
    back = f'<geometry {pose}><arc curvature="-0.0015"/></geometry>'
    ends = '<{} elementType="road" elementId="{}" contactPoint="{}"/>'.format
    links = '<link><predecessor id="{0}"/><successor id="{0}"/></link><width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
    lanes = {side: "".join(
        f'<lane id="{side * k}" type="driving">{links.format(other * k)}</lane>' for k in (1, 2)
    ) for side, other in ((-1, 1), (1, -1))}  # fmt: skip
    roads = (
        (1, 270, line + spiral, ends("successor", 2, "end"), f"<right>{lanes[-1]}</right>"),
        (2, 250, back, ends("predecessor", 3, "start") + ends("successor", 1, "end"), f"<left>{lanes[1]}</left>"),
        (3, 200, cubic.replace('s="520"', 's="0"'), ends("predecessor", 2, "start"), f"<right>{lanes[-1]}</right>"),
    )
    file = tmp_path / "chain.xodr"
    file.write_text('<OpenDRIVE><header revMajor="1" revMinor="6"/>' + "".join(
        f'<road id="{ident}" length="{length}" junction="-1" name="r"><link>{link}</link><planView>{shape}</planView>'
        f'<lanes><laneSection s="0"><center><lane id="0" type="none"/></center>{own}</laneSection></lanes></road>'
        for ident, length, shape, link, own in roads
    ) + "</OpenDRIVE>", encoding="utf-8")  # fmt: skip
    seen = lanes_seen(python, file)
    assert sorted(one["lane"] for one in seen) == [-2, -2, -1, -1, 1, 2]
    assert_lanes_lie([one | {"lane": -abs(one["lane"])} for one in seen], road_of_opendrive(file))


def lanes_seen(python: str, file: Path) -> list[dict[str, Any]]:
    done = subprocess.run([python, str(REFEREE), str(file)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def assert_lanes_lie(seen: list[dict[str, Any]], road: Road) -> None:
    for one in seen:
        slot = one["lane"] + road.slots
        x, y = np.array(one["points"])[1:-1].T
        s, d = road.line.project(x, y)
        np.testing.assert_allclose(d, road.centres[slot], rtol=0, atol=WITHIN)
        assert all(road.lane_at(slot, place) is not None for place in s.tolist())


@pytest.mark.parametrize("name", ["curves", "on-ramp", "lane-drop"])
def test_the_lanes_that_are_written_lie_where_the_road_has_them(name: str, tmp_path: Path) -> None:
    python = os.environ.get("ASAM_PYTHON", "")
    if not python:
        pytest.skip("ASAM_PYTHON names no environment; run `make test-interchange`")
    shipped = road_named(name)
    shift = 0.02 * np.arange(shipped.slots) ** 2  # lanes of several widths, beside the reference line
    road = replace(shipped, centres=tuple((np.array(shipped.centres) + 0.5 + shift).tolist()))
    file = tmp_path / write_road_once(odd_on(Odd(), road), tmp_path, 0.0, 600.0)
    seen = lanes_seen(python, file)
    wanted = {lane.slot for lane in road.lanes if lane.kind != "ramp"}
    assert {one["lane"] + road.slots for one in seen} == wanted
    assert_lanes_lie(seen, road)
