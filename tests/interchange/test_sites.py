"""Sites from SUMO networks, held against netconvert's own foes; and what `site check` finds in broken ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.errors import DataError, InputError, UnknownNameError
from cornerforge.experiment.sites import read_site
from cornerforge.ext.interchange.read_sumo import read_sumo
from cornerforge.ext.interchange.sumo_site import site_of_sumo
from cornerforge.ext.interchange.sumo_ways import id_of
from cornerforge.ext.interchange.xml_input import read_xml
from cornerforge.site.faults import faults_of
from cornerforge.site.mending import with_approaches, with_limit
from cornerforge.site.network import SITE_FILES, Phase, Site, headings_of, with_amber
from cornerforge.site.zones import zones_of

MCITY = Path(__file__).parent / "data" / "mcity.net.xml.gz"
"""Network of the Mcity test facility, by the University of Michigan (mcity/TeraSim); Apache-2.0, licence beside it."""
NODE = "NODE_18"


@pytest.fixture(scope="module")
def site() -> Site:
    return site_of_sumo(MCITY, NODE)


def test_a_junction_has_its_routes_signals_and_crosswalks(site: Site) -> None:
    assert len(site.vehicles) == 13  # two connections of 15 come by a lane of bicycles
    assert len(site.people) == 8  # four crosswalks, there and back
    turns = [route.turn for route in site.routes]
    assert {turn: turns.count(turn) for turn in sorted(set(turns))} == {"left": 4, "right": 4, "straight": 5, "walk": 8}
    assert [phase.seconds for phase in site.programme] == [15, 3, 1, 15, 3, 1]
    assert sorted({route.signal for route in site.routes}) == list(range(1, 13))
    for k in site.vehicles:
        route = site.routes[k]
        assert 0.0 < route.stop < route.leaves <= route.length
        assert np.abs(np.diff(headings_of(route.line))).max() < 0.3
        assert not set(route.yields_to) & {k}
        turned = np.degrees(headings_of(route.line)[-1] - headings_of(route.line)[0])
        assert {"left": 45 < turned < 135, "right": -135 < turned < -45, "straight": abs(turned) < 45}[route.turn]


def test_zones_are_netconverts_foes() -> None:
    """Of all pairs of all junctions: in 20 of 808 they differ, most where two lead into lanes side by side."""
    net, top = read_sumo(MCITY), read_xml(MCITY, root="net", what="a network")
    rows = {one.string("id"): one for one in top.all("junction")}
    alike = differ = 0
    for junction, ways in net.connections.items():
        ways = [way for way in ways if net.lanes[way.begin].cars and net.lanes[way.end].cars]
        if not ways:
            continue
        found = site_of_sumo(MCITY, junction)
        via = {id_of(one): one.string("via") for one in top.all("connection") if one.string("via", "")}
        names = sorted({v for v in via.values() if v.rpartition("_")[0].rpartition("_")[0] == f":{junction}"},
                       key=lambda v: tuple(map(int, v.removeprefix(f":{junction}_").split("_"))))  # fmt: skip
        outer = [v for v in names if any(via[n] == v and not n[0].startswith(":") for n in via)]
        foes = {one.integer("index", low=0, high=99): one.string("foes")[::-1] for one in rows[junction].all("request")}
        zones = {(z.first, z.second) for z in zones_of(found) if z.kind in ("cross", "merge")}
        link = [outer.index(via[id_of(way.element)]) for way in ways]
        link += [len(outer) + k // 2 for k in range(len(found.people))]
        for second in range(len(found.routes)):
            for first in range(min(second, len(ways))):
                if (foes[link[first]][link[second]] == "1") == ((first, second) in zones):
                    alike += 1
                else:
                    differ += 1
    assert (alike, differ) == (788, 20)


def test_a_green_without_amber_is_found_and_mended(site: Site) -> None:
    first, amber, *rest = site.programme
    broken = replace(site, programme=(first, replace(amber, states="yr" + amber.states[2:]), *rest))
    assert faults_of(broken) == ["signal 1 goes from green to red without amber after phase 0"]
    mended = with_amber(broken)
    assert mended.programme[1].states[:2] == "yy"
    assert mended.notes[-1] == "signal 1 went from green to red; it is amber in phase 1 now"
    assert faults_of(mended) == []


def test_shipped_sites_are_made_of_the_network_and_sound(site: Site) -> None:
    assert read_site("mcity-signal") == site == with_amber(site)
    for name in SITE_FILES:
        assert faults_of(read_site(name)) == []


def test_approaches_are_led_straight_back_and_nothing_else_moves(site: Site) -> None:
    longer = with_approaches(site, 100.0)
    before = {(zone.first, zone.second): zone for zone in zones_of(site)}
    after = {(zone.first, zone.second): zone for zone in zones_of(longer)}
    assert before.keys() == after.keys()
    for old, new in zip(site.routes, longer.routes, strict=True):
        more = new.stop - old.stop
        assert new.points[round(more) :] == old.points
        assert (new.leaves - old.leaves, more % 1.0) == pytest.approx((more, 0.0))
        assert (100.0 <= new.stop < 102.0) == (new.turn != "walk")
        led = headings_of(new.line)[: round(more) + 3]
        assert np.ptp(led) < 0.03 if more else old == new
    for pair, zone in before.items():
        if zone.kind in ("cross", "merge"):
            moved = longer.routes[pair[0]].stop - site.routes[pair[0]].stop
            assert after[pair].of_first == pytest.approx([at + moved for at in zone.of_first], abs=0.51)
    assert [faults for faults in faults_of(longer) if "amber" not in faults] == []


def test_an_approach_that_would_cross_others_is_refused(site: Site) -> None:
    """The ring's arms bend towards each other: 250 m back, straight on, they cross."""
    assert with_approaches(site, 15.0) == site  # none is shorter
    with pytest.raises(InputError, match="into the way of"):
        with_approaches(read_site("mcity-roundabout"), 250.0)


def test_one_limit_holds_everywhere_and_the_notes_name_the_old_ones(site: Site) -> None:
    faster = with_limit(site, 50.0 / 3.6)
    assert {faster.routes[k].limits for k in faster.vehicles} == {(50.0 / 3.6,) * 2}
    assert [faster.routes[k] for k in site.people] == [site.routes[k] for k in site.people]
    assert faster.notes[-1] == "the limit is 50 km/h; the source has 18 to 22 km/h"


def test_what_is_wrong_with_a_site_is_found(site: Site) -> None:
    def first_of(**changed: object) -> list[str]:
        return faults_of(replace(site, routes=(replace(site.routes[0], **changed), *site.routes[1:])))  # type: ignore[arg-type]

    assert any("in order" in fault for fault in first_of(stop=500.0))
    assert any("m apart" in fault for fault in first_of(points=site.routes[0].points[::5]))
    assert any("not there" in fault for fault in first_of(yields_to=(99,)))
    assert any("at 1 places" in fault for fault in first_of(yields_at=(1.0,)))
    kinked = (*site.routes[0].points[:20], *((x, y + 0.9) for x, y in site.routes[0].points[20:]))
    assert any("radius" in fault for fault in first_of(points=kinked))
    green = replace(site, programme=(Phase(10, "G" * 13), Phase(4, "y" * 13), Phase(10, "r" * 13)))
    assert any("each yield" in fault for fault in faults_of(green))
    nobody_yields = replace(green, routes=tuple(replace(route, yields_to=()) for route in site.routes))
    assert any("both green, and neither yields" in fault for fault in faults_of(nobody_yields))
    assert any("letters" in fault for fault in faults_of(replace(site, programme=(Phase(10, "Gr"),))))
    assert any("cross without a zone" in fault for fault in faults_of(site, zones_of(site)[40:]))
    no_signals = tuple(replace(route, signal=-1, yields_to=()) for route in site.routes)
    assert any("neither yields" in fault for fault in faults_of(replace(site, routes=no_signals, programme=())))


def test_commands_import_check_and_show(tmp_path: Path) -> None:
    file = tmp_path / "site.json"
    told = cornerforge.site_import(MCITY, junction="NODE_24", out=file)
    assert told.faults == ()
    assert read_site(file) == site_of_sumo(MCITY, "NODE_24")
    assert cornerforge.site_check(file).zones == told.zones == {"cross": 3, "diverge": 3, "merge": 3}
    faster = cornerforge.site_import(MCITY, junction="NODE_24", limit=50.0, approach=80.0, out=tmp_path / "fast.json")
    assert all(route.stop_m >= 80.0 for route in faster.routes)
    assert faster.notes[-1].startswith("the limit is 50 km/h")
    picture = tmp_path / "site.png"
    assert cornerforge.site_show(file, out=picture).files == (str(picture),)
    assert picture.stat().st_size > 10_000


def test_what_is_no_site_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="NODE_8"):
        cornerforge.site_import(MCITY, junction="NODE_81", out=tmp_path / "a.json")
    with pytest.raises(InputError, match="connects no lanes of cars"):
        cornerforge.site_import(MCITY, junction="J1", out=tmp_path / "a.json")
    with pytest.raises(InputError, match="netconvert"):
        cornerforge.site_import(tmp_path / "a.xodr", junction="J1", out=tmp_path / "a.json")
    with pytest.raises(UnknownNameError):
        cornerforge.site_check(tmp_path / "none.json")


def test_a_network_with_a_broken_right_of_way_is_refused(tmp_path: Path) -> None:
    import gzip

    text = gzip.decompress(MCITY.read_bytes()).decode()
    file = tmp_path / "broken.net.xml"
    file.write_text(text.replace('response="1001000000000000000"', 'response="10010"', 1), encoding="utf-8")
    with pytest.raises(DataError, match="response has 5 letters"):
        site_of_sumo(file, NODE)
