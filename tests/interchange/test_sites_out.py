"""Cases at a site in files of other tools: places, lanes and lights are the recording's; what is not said is refused."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from cornerforge.errors import CornerForgeError, FileFormatError, InputError
from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import site_named
from cornerforge.ext.interchange.commonroad import write_commonroad
from cornerforge.ext.interchange.export import EXPORTS, _check_site
from cornerforge.ext.interchange.opendrive_site import site_file
from cornerforge.ext.interchange.osi_messages import GROUND_TRUTH, message_class
from cornerforge.ext.interchange.osi_trace import POSITION_X, POSITION_Y, SPEED_X, SPEED_Y, YAW, read_trace
from cornerforge.ext.interchange.read_osi import read_osi
from cornerforge.ext.interchange.site_lanes import lanes_at
from cornerforge.ext.interchange.tables import read_table, write_table
from cornerforge.ext.interchange.write_osi import write_osi
from cornerforge.library.out_case import OutCase
from cornerforge.site.network import SITE_FILES
from cornerforge.site.signals import clock_of, letters_over
from cornerforge.types import FRAME_S, PERSON
from cornerforge.world_options import WorldOptions

SITES = sorted(SITE_FILES)


@pytest.fixture(scope="module")
def case() -> OutCase:
    """A test at the junction in which somebody walks."""
    with pytest.warns(UserWarning, match="Site:"):
        recorder = experiment(WorldOptions(site="mcity-signal", av="creep")).recorder()
    drives = (recorder.record(3, test) for test in range(100))
    scenario = next(one for one in drives if one.present[:, one.kind == PERSON].any())
    return OutCase("crossing", scenario, {"av": "creep"})


@pytest.mark.parametrize("name", SITES)
def test_lanes_are_the_routes_cut_once(name: str) -> None:
    site = site_named(name)
    lanes = lanes_at(site)
    for k in site.vehicles:
        chain = [lane for lane in lanes if k in lane.routes]
        assert [lane.part for lane in chain if lane.part != "inner"].count("approach") == 1
        assert sum(lane.part == "inner" for lane in chain) == 1
        length = sum(np.hypot(*np.diff(lane.line, axis=0).T).sum() for lane in chain)
        assert length == pytest.approx(site.routes[k].length, abs=0.7)
    for n, lane in enumerate(lanes):
        assert all(n in lanes[other].before for other in lane.behind)
        for other in lane.behind:
            assert np.hypot(*(lanes[other].line[0] - lane.line[-1])) < 0.4, "one begins where the other ends"


@pytest.mark.parametrize("name", SITES)
def test_an_opendrive_junction_leads_where_the_routes_do(name: str) -> None:
    site = site_named(name)
    lanes = lanes_at(site)
    file, text = site_file(site)
    assert site_file(site) == (file, text)
    root = ElementTree.fromstring(text)
    roads = {road.get("id"): road for road in root.findall("road")}
    assert len(roads) == sum(lane.part != "walk" for lane in lanes)
    assert len(root.findall("junction/connection")) == len(site.vehicles)
    ids = [element.get("id") for element in root.iter("signal")]
    assert len(set(ids)) == len(ids)
    assert len(list(root.iter("object"))) == len(site.people) // 2
    for n, lane in enumerate(lanes):
        if lane.part == "walk":
            continue
        geometries = roads[str(100 + n)].findall("planView/geometry")
        for one, after in itertools.pairwise(geometries):
            ends = end_of(one)
            begins = [float(after.get(key, "nan")) for key in ("x", "y", "hdg")]
            assert math.hypot(ends[0] - begins[0], ends[1] - begins[1]) < 1e-5, "no gap"
            assert abs(math.remainder(ends[2] - begins[2], 2.0 * math.pi)) < 1e-4, "no kink"
            assert float(one.get("s", "nan")) + float(one.get("length", "nan")) == pytest.approx(
                float(after.get("s", "nan")), abs=2e-6
            )
    for connection in root.findall("junction/connection"):
        incoming, connecting = roads[connection.get("incomingRoad", "")], roads[connection.get("connectingRoad", "")]
        assert connecting.get("junction") == "1"
        assert incoming.get("junction") == "-1"
        last = end_of(incoming.findall("planView/geometry")[-1])
        first = connecting.find("planView/geometry")
        assert first is not None
        assert math.hypot(last[0] - float(first.get("x", "nan")), last[1] - float(first.get("y", "nan"))) < 0.4


def end_of(geometry: ElementTree.Element) -> tuple[float, float, float]:
    """Where a cubic ends: x, y, heading."""
    cubic = geometry.find("paramPoly3")
    assert cubic is not None
    u, v = (sum(float(cubic.get(f"{letter}{axis}", "nan")) for letter in "abcd") for axis in "UV")
    du, dv = (sum(k * float(cubic.get(f"{x}{axis}", "nan")) for k, x in enumerate("abcd")) for axis in "UV")
    x, y, h = (float(geometry.get(name, "nan")) for name in ("x", "y", "hdg"))
    return x + u * math.cos(h) - v * math.sin(h), y + u * math.sin(h) + v * math.cos(h), h + math.atan2(dv, du)


def test_a_trace_holds_people_lanes_and_lights(case: OutCase, tmp_path: Path) -> None:
    scenario, site = case.scenario, case.scenario.odd.site
    assert site is not None
    trace, road = write_osi(case, tmp_path / "one.osi")
    assert (tmp_path / road).is_file()
    found = read_trace(tmp_path / trace)
    assert found.map_reference == road
    for column, body in enumerate(found.bodies):
        j = int(np.flatnonzero(scenario.slot == body.ident)[0])
        there = scenario.present[:, j]
        states = found.states[there, column]
        np.testing.assert_allclose(states[:, POSITION_X], scenario.x[there, j], atol=1e-6)
        np.testing.assert_allclose(states[:, POSITION_Y], scenario.y[there, j], atol=1e-6)
        assert body.kind == (3 if scenario.kind[j] == PERSON else 2)
        assert (np.abs(states[:, YAW]) <= np.pi).all()
        speed = scenario.speed[there, j]
        np.testing.assert_allclose(np.hypot(states[:, SPEED_X], states[:, SPEED_Y]), speed, atol=1e-6)
        np.testing.assert_allclose(states[:, SPEED_X], speed * np.cos(scenario.heading[there, j]), atol=1e-6)
    assert {body.ident for body in found.bodies} == set(scenario.slot[scenario.present.any(axis=0)].tolist())
    frames = messages((tmp_path / trace).read_bytes())
    lanes = {lane.id.value: lane.classification for lane in frames[0].lane}
    assert len(lanes[19_999].lane_pairing) == len(site.vehicles)
    for pair in lanes[19_999].lane_pairing:
        assert {pair.antecessor_lane_id.value, pair.successor_lane_id.value} < set(lanes)
    assert not frames[1].lane
    colours = {"r": 2, "y": 3, "g": 4, "G": 4}
    for frame, message in enumerate(frames):
        time = np.array([clock_of(scenario) + FRAME_S * frame])
        for light in message.traffic_light:
            k = light.id.value - 20_000
            letter = str(letters_over(site, k, time)[0])
            flashes = site.routes[k].turn == "walk" and letter == "y"
            assert light.classification.color == (2 if flashes else colours[letter])
            assert light.classification.mode == (4 if flashes else 3)


def messages(content: bytes) -> list[object]:
    made, found, at = message_class(GROUND_TRUTH), [], 0
    while at < len(content):
        size = int.from_bytes(content[at : at + 4], "little")
        found.append(made.FromString(content[at + 4 : at + 4 + size]))
        at += 4 + size
    return found


def test_commonroad_holds_lanelets_lights_and_people(case: OutCase, tmp_path: Path) -> None:
    scenario, site = case.scenario, case.scenario.odd.site
    assert site is not None
    (name,) = write_commonroad(case, tmp_path)
    root = ElementTree.parse(tmp_path / name).getroot()
    lanes = lanes_at(site)
    ids = {element.get("id") for element in root.findall("lanelet")}
    assert len(ids) == len(lanes)
    refs = {element.get("ref") for kind in ("predecessor", "successor") for element in root.iter(kind)}
    assert refs < ids
    walkers = sum(scenario.present[:, scenario.kind == PERSON].any(axis=0))
    assert sum(one.findtext("type") == "pedestrian" for one in root.findall("dynamicObstacle")) == walkers > 0
    assert len(root.findall("intersection/incoming")) == sum(lane.part == "approach" for lane in lanes)
    lights = {light.get("id"): light for light in root.findall("trafficLight")}
    steps = round(sum(phase.seconds for phase in site.programme) / FRAME_S)
    for n, lane in enumerate(lanes):
        if lane.part != "approach":
            continue
        stop = root.find(f"lanelet[@id='{10_000 + n}']/stopLine")
        assert stop is not None
        shown = {told(lights[ref.get("ref")], len(scenario.x)) for ref in stop.findall("trafficLightRef")}
        times = clock_of(scenario) + FRAME_S * np.arange(len(scenario.x))
        for k in lane.routes:
            letters = letters_over(site, k, times + 0.5 * FRAME_S)
            colours = ["red" if x == "r" else "yellow" if x == "y" else "green" for x in letters.tolist()]
            least = min(sum(a != b for a, b in zip(colours, one, strict=True)) for one in shown)
            assert least <= 2 * math.ceil(len(colours) / steps + 1) * 4, "whole steps only"
    goal = {element.get("ref") for element in root.findall("planningProblem/goalState/position/lanelet")}
    assert goal == {str(10_000 + n) for n, lane in enumerate(lanes) if scenario.target_lane[0, 0] in lane.routes
                    and not lane.behind}  # fmt: skip


def told(light: ElementTree.Element, frames: int) -> tuple[str, ...]:
    """Colours of a light at each step, as CommonRoad means its cycle."""
    elements = light.findall("cycle/cycleElement")
    cycle = [one.findtext("color", "") for one in elements for _ in range(int(one.findtext("duration", "0")))]
    offset = int(light.findtext("cycle/timeOffset", "0"))
    return tuple(cycle[(step - offset) % len(cycle)] for step in range(frames))


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_table_says_that_it_is_of_a_junction_and_is_not_read_as_a_road(
    case: OutCase, tmp_path: Path, ending: str
) -> None:
    import pyarrow.csv
    import pyarrow.parquet

    path = tmp_path / f"one.{ending}"
    write_table(case, path)
    table = pyarrow.parquet.read_table(path) if ending == "parquet" else pyarrow.csv.read_csv(path)
    scenario = case.scenario
    av = table.filter(pyarrow.compute.equal(table["slot"], 0))
    np.testing.assert_allclose(av["x_m"].to_numpy(), scenario.x[:, 0], atol=1e-6)
    np.testing.assert_allclose(av["y_m"].to_numpy(), scenario.y[:, 0], atol=1e-6)
    assert set(av["lane"].to_pylist()) == {int(scenario.target_lane[0, 0])}
    assert "person" in table["class"].to_pylist()
    with pytest.raises(FileFormatError, match="junction"):
        read_table(path)


def test_a_trace_at_a_junction_is_not_read_as_a_road(case: OutCase, tmp_path: Path) -> None:
    write_osi(case, tmp_path / "one.osi")
    with pytest.raises(CornerForgeError):
        read_osi(tmp_path / "one.osi")


@pytest.mark.parametrize("to", sorted(EXPORTS))
def test_formats_without_junctions_are_refused_by_name(case: OutCase, to: str) -> None:
    if to in ("commonroad", "csv", "mcap", "osi", "parquet"):
        _check_site(case.scenario.odd.site, to)
        return
    with pytest.raises(InputError, match=f"{to} is written with lanes beside each other.*junction"):
        _check_site(case.scenario.odd.site, to)
