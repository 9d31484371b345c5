"""Several junctions as one site: a roundabout and a crossing, held against netconvert's own foes and right of way."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.errors import InputError
from cornerforge.experiment.sites import read_site
from cornerforge.ext.interchange.read_sumo import read_sumo
from cornerforge.ext.interchange.sumo_site import site_of_sumo
from cornerforge.ext.interchange.sumo_ways import Chain, RightOfWay, chains_of, junction_of
from cornerforge.ext.interchange.xml_input import read_xml
from cornerforge.site.faults import faults_of
from cornerforge.site.network import SITE_FILES, Route, Site, headings_of
from cornerforge.site.zones import Zone, with_entries_that_yield, zones_of

MCITY = Path(__file__).parent / "data" / "mcity.net.xml.gz"
SODERLEDEN = Path(__file__).parents[3] / "shared" / "data" / "osi" / "soderleden.xodr"
RING = ("NODE_19", "NODE_20", "NODE_21", "NODE_31", "NODE_22")
NETCONVERT = os.environ.get("NETCONVERT", "") or shutil.which("netconvert") or ""


@pytest.fixture(scope="module")
def ring() -> Site:
    return site_of_sumo(MCITY, ",".join(RING), reach=60.0, over=True)


@pytest.fixture(scope="module")
def zones() -> tuple[Zone, ...]:
    return zones_of(read_site("mcity-roundabout"))


def test_shipped_sites_are_made_of_the_network(ring: Site) -> None:
    assert read_site("mcity-crossing") == site_of_sumo(MCITY, "J5,NODE_27", over=True)
    assert read_site("mcity-two-lanes") == site_of_sumo(MCITY, "NODE_19", over=True)
    assert read_site("mcity-roundabout") == with_entries_that_yield(ring)


def test_each_arm_of_the_roundabout_leads_to_each(ring: Site) -> None:
    ways = Counter((ring.routes[k].approach, ring.routes[k].exit) for k in ring.vehicles)
    assert len(ways) == 16  # four arms
    assert set(ways.values()) == {1}
    assert len(ring.people) == 4
    for k in ring.vehicles:
        route = ring.routes[k]
        headings = headings_of(route.line)
        assert np.abs(np.diff(headings)).max() < 0.25
        assert 35.0 < route.stop < route.leaves < route.length
        turned = np.degrees(np.interp(route.leaves + 15, route.along, headings) - headings[int(route.stop) - 15])
        assert {"right": turned < -45, "straight": abs(turned) < 50, "left": 45 < turned < 135, "back": turned > 135}[
            route.turn
        ]
    assert Counter(ring.routes[k].turn for k in ring.vehicles) == {"right": 3, "straight": 5, "left": 4, "back": 4}


def middle(route: Route, chain: Chain, k: int) -> float:
    """Find where along a route the middle of its way through a junction is, by the file's own points [m]."""
    ends = chain[k].way[[0, -1]]
    return float(route.along[np.hypot(*(route.line[:, None] - ends).transpose(2, 0, 1)).argmin(axis=0)].mean())


def test_zones_of_the_roundabout_are_netconverts_foes(ring: Site) -> None:
    """Of 99 pairs of ways through a junction 3 differ: boxes touch on them, and netconvert knows no foe."""
    net, top = read_sumo(MCITY), read_xml(MCITY, root="net", what="a network")
    named = {one.string("id"): one for one in top.all("junction")}
    rules, chains, zones = RightOfWay(top, named), list(chains_of(net, RING)), zones_of(ring)
    foes = {
        one: {row.integer("index", low=0, high=99): row.string("foes")[::-1] for row in named[one].all("request")}
        for one in RING
    }
    alike, differ, wrong = 0, [], []
    for b, two in enumerate(chains):
        for a, one in enumerate(chains[:b]):
            for i, way in enumerate(one):
                for j, other in enumerate(two):
                    where = junction_of(net, way)
                    if where != junction_of(net, other) or way.begin == other.begin:
                        continue
                    links = rules.place(where, way)[1], rules.place(where, other)[1]
                    at = middle(ring.routes[a], one, i), middle(ring.routes[b], two, j)
                    here = [
                        zone for zone in zones if (zone.first, zone.second) == (a, b)
                        and zone.of_first[0] - 5 < at[0] < zone.of_first[1] + 5
                        and zone.of_second[0] - 5 < at[1] < zone.of_second[1] + 5
                    ]  # fmt: skip
                    if (foes[where][links[0]][links[1]] == "1") != bool(here):
                        differ.append((ring.routes[a].name, ring.routes[b].name, where))
                        continue
                    alike += 1
                    rows = rules.rows(where)
                    first, second = links[1] in rows[links[0]], links[0] in rows[links[1]]
                    if here and (here[0].first_yields, here[0].second_yields) != (first, second):
                        wrong.append((ring.routes[a].name, ring.routes[b].name, where))
    assert wrong == []
    assert sorted({where for _, _, where in differ}) == ["NODE_20"]
    assert (alike, len(differ)) == (96, 3)


def test_entries_that_touch_the_ring_yield_to_it(ring: Site) -> None:
    faults = faults_of(ring)
    assert len(faults) == 3
    assert all("EG_20_1_1_0>EG_20_1_11_0" in fault and "neither yields" in fault for fault in faults)
    mended = with_entries_that_yield(ring)
    assert faults_of(mended) == []
    assert len(mended.notes) == len(ring.notes) + 3


def test_left_turns_from_opposite_arms_meet_twice_and_each_yields_once(zones: tuple[Zone, ...]) -> None:
    site = read_site("mcity-roundabout")
    names = [route.name for route in site.routes]
    north, south = names.index("EG_19_1_1_1>EG_18_1_1_0"), names.index("EG_22_1_1_0>EG_19_1_10_0")
    met = [zone for zone in zones if (zone.first, zone.second) == (north, south)]
    assert [zone.kind for zone in met] == ["cross", "weave"]
    assert [(zone.first_yields, zone.second_yields) for zone in met] == [(True, False), (False, True)]
    assert met[0].of_second[0] > met[1].of_second[1]  # the one from the south is there in the other order
    anywhere = replace(site, routes=tuple(replace(route, yields_at=()) for route in site.routes))
    assert any("each yield" in fault for fault in faults_of(anywhere))


def off_the_line(site: Site, zone: Zone) -> float:
    """Measure by how much the linear map of a zone misses the other route's place, where both are in one lane [m]."""
    one, two = site.routes[zone.first], site.routes[zone.second]
    at = np.arange(*zone.of_first, 0.5)
    fine = np.arange(0.0, two.length, 0.02)
    places, others = (
        np.stack([np.interp(x, route.along, part) for part in route.line.T], axis=1)
        for route, x in ((one, at), (two, fine))
    )
    away = np.hypot(*(places[:, None] - others).transpose(2, 0, 1))
    near = away.min(axis=1) < 0.05
    missed = np.interp(at, zone.of_first, zone.of_second) - fine[away.argmin(axis=1)]
    return float(np.abs(missed[near]).max(initial=0.0))


@pytest.mark.parametrize("name", SITE_FILES)
def test_a_place_of_a_shared_lane_is_as_far_into_the_zone_on_both(name: str) -> None:
    site = read_site(name)
    shared = [zone for zone in zones_of(site) if zone.kind != "cross"]
    assert shared
    for zone in shared:
        assert off_the_line(site, zone) < 0.1
    cut = replace(shared[0], of_second=(shared[0].of_second[0] + 2.0, shared[0].of_second[1]))
    assert off_the_line(site, cut) > 0.1


def test_the_crossing_has_one_road_and_one_crosswalk() -> None:
    site = read_site("mcity-crossing")
    assert {site.routes[k].turn for k in site.vehicles} == {"straight"}
    assert [site.routes[k].name for k in site.people] == ["NODE_27_c0+J5_c0 there", "NODE_27_c0+J5_c0 back"]
    for k in site.vehicles:
        assert site.routes[k].stop >= 60.0
        assert set(site.routes[k].yields_to) == set(site.people)
    for over in ("NODE_12", "NODE_31"):
        assert any(over in note for note in site.notes)


def test_sites_that_are_too_large_are_refused() -> None:
    net = read_sumo(MCITY)
    with pytest.raises(InputError, match="400 m is most"):
        site_of_sumo(MCITY, ",".join(RING), reach=300.0, over=True)
    with pytest.raises(InputError, match="More than 64 routes"):
        site_of_sumo(MCITY, ",".join(one for one, ways in net.connections.items() if ways))


@pytest.mark.full
@pytest.mark.skipif(not NETCONVERT, reason="no netconvert: pip install eclipse-sumo, or name it in NETCONVERT")
@pytest.mark.parametrize("source", ["roundabout", "soderleden"])
def test_junctions_of_opendrive_are_imported_after_netconvert(source: str, tmp_path: Path) -> None:
    """Mcity goes to OpenDRIVE and back by netconvert; Söderleden's direct junction needs --ignore-errors."""
    if source == "soderleden" and not SODERLEDEN.exists():
        pytest.skip("the folder shared/data/osi is not beside the repository")
    road, city = tmp_path / "road.xodr", tmp_path / "city.net.xml"

    def convert(*arguments: object) -> None:
        subprocess.run([NETCONVERT, *map(str, arguments)], check=True, capture_output=True, timeout=300)

    if source == "soderleden":
        convert("--ignore-errors", "--opendrive", SODERLEDEN, "-o", city)
        told = cornerforge.site_import(city, junction="8", out=tmp_path / "site.json")
        assert (len(told.routes), told.faults) == (3, ())
        return
    convert("-s", MCITY, "--opendrive-output", road)
    convert("--opendrive", road, "--offset.disable-normalization", "-o", city)
    top = read_xml(road, root="OpenDRIVE", what="a road")
    ids = {one.string("name"): one.string("id") for one in top.all("junction")}
    again = site_of_sumo(city, ",".join(ids[one] for one in RING), reach=60.0)
    once = site_of_sumo(MCITY, ",".join(RING), reach=60.0)
    assert len(again.vehicles) == len(once.vehicles) == 16
    assert not again.people  # OpenDRIVE's crosswalks are objects, which netconvert leaves out
    for k in once.vehicles:
        inside = once.routes[k].line[(once.routes[k].along > once.routes[k].stop)][:-1]
        off = min(
            np.hypot(*(inside[:, None] - again.routes[m].line).transpose(2, 0, 1)).min(axis=1).max()
            for m in again.vehicles if again.routes[m].turn == once.routes[k].turn
        )  # fmt: skip
        assert off < 1.0
