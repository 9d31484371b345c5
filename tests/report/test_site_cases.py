"""Cases at a site on pages and pictures: the map, the lights, the vehicles in the world's plane."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from html_page import browse, needs_browser

from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import demand_of, laws_named, odd_at, site_named
from cornerforge.ext.pictures.player import player
from cornerforge.ext.pictures.road_view import PRINT, SCREEN, RoadView
from cornerforge.ext.pictures.strip import strip_figure
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.metrics.risk import plane_ttc
from cornerforge.report.cases import case_data
from cornerforge.report.moments import Moments, apart
from cornerforge.report.site_surface import changes_of, site_surface
from cornerforge.site.network import SITE_FILES, Site
from cornerforge.site.signals import clock_in, letters_over
from cornerforge.site.tables import letter_at, site_numbers, walk_letter
from cornerforge.types import FRAME_S, PERSON, Odd, Scenario
from cornerforge.world_options import WorldOptions

SIGNAL = "mcity-signal"


@pytest.fixture(scope="module")
def site() -> Site:
    return site_named(SIGNAL)


@pytest.fixture(scope="module")
def drives() -> list[Scenario]:
    """Tests at the junction, where drivers err often; one is a crash of the AV."""
    laws = replace(laws_named(None), overlooks_person=0.1, overlooks_vehicle=0.1, runs_red=0.1, looks_away=0.1)
    odd = odd_at(Odd(), site_named(SIGNAL), laws, demand_of("vehicles=300,people=120"))
    recorder = experiment(WorldOptions(av="creep"), road=odd).recorder()
    found = [recorder.record(1, test) for test in range(2)]
    crash = (recorder.record(1, test) for test in range(2, 20_000))
    return [*found, next(one for one in crash if one.crash is not None)]


def inside(points: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Which points lie in a polygon (even-odd)."""
    x, y = points.T[:, :, None]
    a, b = shape, np.roll(shape, -1, axis=0)
    crosses = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return (crosses & (x < at)).sum(axis=1) % 2 == 1


@pytest.mark.parametrize("name", sorted(SITE_FILES))
def test_each_route_lies_on_asphalt_and_each_way_of_people_on_bars(name: str) -> None:
    site = site_named(name)
    surface = site_surface(site)
    assert len(surface.lanes) == len(site.vehicles)
    for k, lane in zip(site.vehicles, surface.lanes, strict=True):
        line = site.routes[k].line[1:-1]
        assert inside(line, lane).mean() > 0.98, "sides meet in tight turns only"
        assert len(lane) < len(line), "few points say it"
    ways = {frozenset(map(tuple, np.round(site.routes[k].line[[0, -1]], 3).tolist())) for k in site.people}
    lengths = sum(site.routes[k].length for k in site.people) / 2.0
    assert len(ways) == len(site.people) // 2
    assert sum(map(len, surface.bars)) / 4 == pytest.approx(lengths, abs=0.5 * len(ways) + 0.5)
    for bar in surface.bars:
        assert np.hypot(*(bar[0] - bar[3])) == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize("name", sorted(SITE_FILES))
def test_no_edge_lies_within_a_lane(name: str) -> None:
    site = site_named(name)
    for edge in site_surface(site).edges:
        for k in site.vehicles:
            route = site.routes[k]
            far = np.hypot(*(edge[:, None, :] - route.line[None]).transpose(2, 0, 1)).min(axis=1)
            assert (far > 0.5 * route.width - 0.5).all(), route.name


def test_lights_show_what_drivers_and_people_see(site: Site) -> None:
    from cornerforge.site.laws import Demand, Laws

    numbers = site_numbers(site, Laws(), Demand(), 60.0).view(np.recarray)
    times = np.arange(0.0, 90.0, 0.37)
    names = {"r": 0, "y": 1, "G": 2, "g": 3}
    for k, route in enumerate(site.routes):
        seen = walk_letter if route.turn == "walk" else letter_at
        shown = letters_over(site, k, times)
        expected = [seen.py_func(numbers, k, time) for time in times.tolist()]  # type: ignore[attr-defined]
        assert [names[letter] for letter in shown.tolist()] == expected, route.name
    told = changes_of(site, 3.0, 400, FRAME_S)
    for light, changes in zip(site_surface(site).lights, told, strict=True):
        letters = letters_over(site, light.route, 3.0 + FRAME_S * np.arange(400))
        assert changes[0][0] == 0
        for begin, letter in changes:
            assert letters[begin] == letter
            assert begin == 0 or letters[begin - 1] != letter


def test_the_clock_of_the_signals_follows_from_the_tests_name(drives: list[Scenario], site: Site) -> None:
    cycle = sum(phase.seconds for phase in site.programme)
    clocks = {clock_in(replace(one, signals_s=None)) for one in drives}
    assert len(clocks) == len(drives)
    for one in drives:
        assert one.signals_s == clock_in(replace(one, signals_s=None))
        assert 0.0 <= clock_in(one) < cycle
    assert clock_in(replace(drives[0], signals_s=7.5)) == 7.5


def test_a_page_shows_vehicles_on_the_map(drives: list[Scenario]) -> None:
    for scenario in drives:
        data = case_data("1:1", scenario)
        assert set(data["site"]) == {"lanes", "edges", "bars", "stops", "lights"}
        assert "surface" not in data
        assert data["ttc"] == []
        lanes = [np.reshape(lane, (-1, 2)) for lane in data["site"]["lanes"]]
        for vehicle in data["vehicles"]:
            assert set(vehicle["lane"]) == {-1}
            column = int(np.flatnonzero(scenario.slot == vehicle["slot"])[0])
            assert (vehicle["kind"] == "person") == (scenario.kind[column] == PERSON)
            if vehicle["kind"] != "person":
                places = np.array([vehicle["x"], vehicle["y"]], dtype=float).T
                places = places[np.isfinite(places).all(axis=1)]
                on = np.any([inside(places, lane) for lane in lanes], axis=0)
                # its middle is on the edge where a route begins, and at its end until the second is over
                assert (~on).sum() <= 1 + 10
        frames = data["frames"]
        assert all(light["from"][0] == 0 and light["from"][-1] < frames for light in data["site"]["lights"])
        assert all(len(light["from"]) == len(light["letters"]) for light in data["site"]["lights"])


def test_time_to_collision_in_the_plane_ends_in_the_contact(drives: list[Scenario]) -> None:
    crash = drives[-1]
    assert crash.partner is not None
    assert plane_ttc(crash, crash.partner)[-1] == 0.0
    speed, heading = crash.speed[-2], crash.heading[-2]
    ahead = [np.array([crash.x[-2, c], crash.y[-2, c]]) for c in (0, crash.partner)]
    least = math.inf
    for step in range(400):  # driven out in steps of 10 ms
        moved = [
            Box(
                float(place[0] + 0.01 * step * speed[c] * np.cos(heading[c])),
                float(place[1] + 0.01 * step * speed[c] * np.sin(heading[c])),
                heading[c], crash.length[c], crash.width[c],
            )
            for place, c in zip(ahead, (0, crash.partner), strict=True)
        ]  # fmt: skip
        if boxes_overlap(*moved):
            least = 0.01 * step
            break
    told = plane_ttc(crash, crash.partner)[-2]
    assert told == pytest.approx(least, abs=0.011) or (least == math.inf and told > 3.99)


def test_the_distance_of_two_boxes_is_that_of_their_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(50):
        angle, place = rng.uniform(-3.0, 3.0), rng.uniform(-9.0, 9.0, 2)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        box = np.array([[2.5, 1.0], [-2.5, 1.0], [-2.5, -1.0], [2.5, -1.0]])
        other = box @ turn.T + place
        part = np.linspace(0.0, 1.0, 401)[:, None]

        def rim(corners: np.ndarray, part: np.ndarray = part) -> np.ndarray:
            return np.concatenate([a + part * (b - a) for a, b in zip(corners, np.roll(corners, 1, 0), strict=True)])

        near = np.hypot(*(rim(box)[:, None] - rim(other)[None]).transpose(2, 0, 1)).min()
        assert apart(box, other) == pytest.approx(near if apart(box, other) > 0.0 else 0.0, abs=0.02)


@pytest.mark.parametrize("look", [SCREEN, PRINT], ids=["screen", "print"])
def test_a_picture_stands_still_where_the_two_meet(drives: list[Scenario], look: object) -> None:
    from matplotlib.figure import Figure

    moments = Moments(drives[-1])
    view = RoadView(Figure().add_subplot(), moments, (-25.0, 25.0), look, points_per_metre=5.0)  # type: ignore[arg-type]
    view.show(moments.at(moments.end))
    late = view._lines.get_segments()
    view.show(moments.at(moments.end - 0.5))
    np.testing.assert_allclose(view._lines.get_segments()[0], late[0])
    assert len(view._bodies.get_paths()) > 1
    assert len(strip_figure(drives[-1], [1.0, 0.0], width=3.5).axes) == 2


COUNTS = """
setTimeout(() => {
  const canvas = document.getElementById("look-road");
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  const wanted = {red: [255, 59, 48], amber: [255, 191, 0], green: [46, 204, 113]};
  for (const [name, [r, g, b]] of Object.entries(wanted)) {
    let n = 0;
    for (let i = 0; i < pixels.length; i += 4) n += pixels[i] === r && pixels[i + 1] === g && pixels[i + 2] === b;
    document.body.dataset[name] = n;
  }
}, 1000);
"""


@needs_browser
def test_a_browser_draws_the_lights_of_the_moment(drives: list[Scenario], tmp_path: Path) -> None:
    """A colour that no light shows is not there, the others are."""
    crash = drives[-1]
    site = crash.odd.site
    assert site is not None
    cycle = sum(phase.seconds for phase in site.programme)
    last = FRAME_S * (len(crash.x) - 1)
    found = set[str]()
    for clock in (2.0, 12.0, 18.2, 31.0):  # of which one is all red
        shown = replace(crash, signals_s=(clock + 0.5 - last) % cycle)
        letters = {str(letters_over(site, k, np.array([clock + 0.5]))[0]) for k in range(len(site.routes))}
        (frame,) = re.findall(r'srcdoc="(.*?)"', player("0:7", shown), re.DOTALL)
        text = re.sub(r"<meta http-equiv[^>]*>", "", unescape(frame))
        (tmp_path / "page.html").write_text(text + f"<script>{COUNTS}</script>", encoding="utf-8")
        html = browse((tmp_path / "page.html").as_uri(), tmp_path / f"profile-{clock:g}")
        counts = {name: int(n) for name, n in re.findall(r'data-(red|amber|green)="(\d+)"', html)}
        colours = {"r": "red", "y": "amber", "g": "green", "G": "green"}
        seen = {name for name, n in counts.items() if n > 50}
        assert seen <= {colours[letter] for letter in letters}, clock
        found |= seen
    assert found == {"red", "amber", "green"}, "not every light is in the picture each time"


def test_what_a_vehicle_hides_is_not_seen(drives: list[Scenario]) -> None:
    """A vehicle cuts the line from the AV's middle to that of one that is not seen, but where two hide a part each."""
    cut = []
    for drive in drives:
        told = case_data("1:1", drive)
        assert told["lineOfSight"]
        for one in told["vehicles"][1:]:
            (column,) = np.flatnonzero(drive.slot == one["slot"])
            first = told["first"] + one["from"]
            there = zip(one["x"], one["seenX"], strict=True)
            lost = [first + k for k, (x, seen) in enumerate(there) if x is not None and seen is None]
            cut += [is_cut(drive, frame, int(column)) for frame in lost]
    assert len(cut) > 100
    assert np.mean(cut) > 0.9


def is_cut(drive: Scenario, frame: int, column: int) -> bool:
    """Does a vehicle's box hold a point of the line from the AV to another, tried at 400 of them?"""
    part = np.linspace(0.0, 1.0, 400)
    x, y = (v[frame, 0] + part * (v[frame, column] - v[frame, 0]) for v in (drive.x, drive.y))
    for j in range(1, len(drive.slot)):
        if j == column or drive.kind[j] == PERSON or not drive.present[frame, j]:
            continue
        c, s = np.cos(drive.heading[frame, j]), np.sin(drive.heading[frame, j])
        dx, dy = x - drive.x[frame, j], y - drive.y[frame, j]
        inside_box = (abs(dx * c + dy * s) < 0.5 * drive.length[j]) & (abs(dy * c - dx * s) < 0.5 * drive.width[j])
        if inside_box.any():
            return True
    return False
