"""`site validate`: what is measured in recordings, and how it is held against data."""

from __future__ import annotations

from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cornerforge
from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import laws_named
from cornerforge.ext.calibrate import site_measures
from cornerforge.ext.calibrate.site_data import read_site_data
from cornerforge.ext.calibrate.site_measures import CRASH_KINDS, Kerb, Measured, Meeting, Turn, crash_kinds, measures
from cornerforge.ext.calibrate.site_validating import (
    bars_of,
    crashed,
    priorities,
    right_of_way_taken,
    site_did_not_pass,
    site_validation_text,
)
from cornerforge.results.stating import as_json
from cornerforge.work.files import write_json
from cornerforge.world_options import WorldOptions


def folder(path: Path) -> Path:
    """Write 40 encounters at 8 signals, of which the vehicle goes first in half, 2 or 6 s apart."""
    rows = ["encroachment_time,signal.id,pedcp_ped,ped.reaction"]
    rows += [f"{(-2, 2, -6, 6)[k % 4]},s{k % 8 // 2},{('Walk', 'FDW', 'SDW')[k % 3]},None" for k in range(240)]
    path.mkdir(exist_ok=True)
    (path / "utah_right_turn_conflicts.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def met(seconds: tuple[float, ...], n: int) -> Measured:
    return Measured(meetings=[Meeting(seconds[k % len(seconds)], k % 3) for k in range(n)])


def test_a_simulation_like_the_data_holds_and_another_misses(tmp_path: Path) -> None:
    tables = read_site_data(folder(tmp_path / "data"))
    like = {bar.measure: bar for bar in bars_of(met((-2.2, 1.8, -6.0, 6.3), 240), tables)}
    assert all(bar.holds for bar in like.values())
    assert like["vehicle first, Walk"].data == pytest.approx(0.5)
    other = {bar.measure: bar.holds for bar in bars_of(met((1.0, 2.0, 2.9), 240), tables)}
    assert other["vehicle first, Walk"] is False
    assert other["encroachment time at most 3 s, of 10 s"] is False
    unlit = bars_of(Measured(meetings=[Meeting(-2.0, -1)] * 240), tables)  # the data are of signals
    assert all(bar.holds is None for bar in unlit)
    few = bars_of(met((-2.0, 2.0), 12), tables)
    assert all(bar.holds is None for bar in few)


def test_people_are_measured_as_they_walk() -> None:
    run = experiment(WorldOptions(site="mcity-signal", av="idm-yield", site_traffic="people=200"))
    zones, recorder = run.setting.road.site[0]["zone"], run.recorder()
    scenarios = [recorder.record(1, test) for test in range(12)]
    seen = measures(scenarios, zones)
    fastest = run.setting.road.site[0]["walks"][-1]
    assert len(seen.walks) > 30
    assert min(seen.walks) > 0.0
    assert max(seen.walks) <= 1.05 * fastest
    assert all(abs(meeting.seconds) < 10.5 and meeting.light in (0, 1, 2) for meeting in seen.meetings)
    assert len(seen.kerbs) > 10
    assert all(isinstance(kerb, Kerb) for kerb in seen.kerbs)
    again = measures(scenarios[:6], zones), measures(scenarios[6:], zones)
    assert seen.walks == again[0].walks + again[1].walks


def leavers(tmp_path: Path, tests: int, **laws: Any) -> list[tuple[bool, float]]:
    """Of all that come on don't walk: do they leave before it ends, and how long before [s]."""
    file = tmp_path / "laws.json"
    write_json(file, as_json(replace(laws_named(None), walks_blindly=0.0, **laws)))
    run = experiment(WorldOptions(site="mcity-signal", av="idm-yield", site_traffic="people=200", site_laws=str(file)))
    zones, recorder = run.setting.road.site[0]["zone"], run.recorder()
    found = []
    for seen in (site_measures._seen(recorder.record(2, test), zones) for test in range(tests)):
        for person in (one for one in seen.tracks if one.person and one.begin > 0):
            came, left = person.begin * 0.1, person.when(0.1)
            if seen.walk(person.route, came) == 0 and left == left:
                before = next((t for t in np.arange(0.0, 40.0, 0.1) if seen.walk(person.route, left + t) == 2), 40.0)
                found.append((seen.walk(person.route, left) == 0, float(before)))
    return found


def test_people_on_dont_walk_obey_or_take_a_gap_or_start_early(tmp_path: Path) -> None:
    none = leavers(tmp_path, 15, obeys=1.0, starts_early=0.0)
    assert len(none) > 20
    assert not any(left for left, _ in none)
    early = [before for left, before in leavers(tmp_path, 15, obeys=1.0, starts_early=1.0) if left]
    assert len(early) > 10
    assert max(early) < 2.7
    often = [left for left, _ in leavers(tmp_path, 15, obeys=0.0, starts_early=0.0, patience=1000.0)]
    seldom = [left for left, _ in leavers(tmp_path, 15, obeys=0.0, starts_early=0.0, patience=0.5)]
    assert sum(often) > 1.5 * sum(seldom) > 0


def test_only_people_that_came_early_enough_for_any_wait_are_counted() -> None:
    run = experiment(WorldOptions(site="mcity-signal", av="idm-yield"))
    assert run.odd.site is not None
    assert site_measures._longest_wait(run.odd.site) == pytest.approx(23.0)  # 38 s, of which 15 are green
    zones = run.setting.road.site[0]["zone"]
    stands = [site_measures._Track(13, True, 0.5, begin, np.zeros(300 - begin), np.zeros(300)) for begin in (60, 80)]
    for clock in np.arange(0.0, 38.0, 0.5):
        seen = site_measures._Seen(run.odd.site, zones, stands, [], float(clock), 29.9)
        on_dont_walk = [seen.walk(13, one.begin * 0.1) == 0 for one in stands]
        assert len(site_measures._kerbs(seen)) == int(on_dont_walk[0])  # the second came after 8 s of 29.9


def drives(route: int, *way: tuple[float, float]) -> site_measures._Track:
    """A vehicle that is at places [m] at times [s], and drives evenly between."""
    s = np.interp(np.arange(0.0, 20.0, 0.1), *np.array(way).T)
    return site_measures._Track(route, False, 5.0, 0, s, np.gradient(s, 0.1))


@pytest.mark.parametrize(("leaves", "found"), [(8.0, Turn(3.0, 6.0)), (13.0, Turn(6.0, 15.0))])
def test_a_gap_is_taken_where_the_ways_of_both_cross(leaves: float, found: Turn) -> None:
    """Of two ways from one lane the turn crosses one sooner: to come into that is not yet to take the gap before both.

    Oncoming vehicles are at their zones after 2, 5 and 11 s.
    """
    run = experiment(WorldOptions(site="mcity-signal", av="idm-yield"))
    assert run.odd.site is not None
    zones = run.setting.road.site[0]["zone"]
    there = zones[12, 5, 0]["other_begin"]
    oncoming = [
        drives(route, (at - 6.0, there - 30.0), (at + 6.0, there + 30.0)) for route, at in ((5, 2), (5, 5), (4, 11))
    ]
    turn = drives(12, (0.0, 20.0), (1.0, 27.2), (6.0, 27.2), (6.5, 28.5), (leaves - 0.1, 31.5), (leaves + 2.0, 50.0))
    queued = drives(12, (0.0, 12.0), (1.0, 19.0), (6.0, 19.0), (7.0, 20.0), (9.0, 28.0), (18.0, 50.0))
    seen = site_measures._Seen(run.odd.site, zones, [*oncoming, turn, queued], [], 0.0, 20.0)
    turns, follow_up = site_measures._turns(seen)
    assert astuple(turns[0]) == pytest.approx(astuple(found), abs=0.11)
    assert follow_up == [pytest.approx(2.7, abs=0.2)]


def test_crashes_have_kinds_and_are_as_many_as_were_counted() -> None:
    run = experiment(WorldOptions(site="mcity-signal", av="idm-yield", site_traffic="vehicles=500"))
    out, _ = run.drive(run.setting, run.slots, 7, 0, 600, False)
    recorder = run.recorder()
    tests = np.flatnonzero((out.bv_crashes > 0) & (out.code != 2))
    kinds = [crash_kinds(recorder.record(7, int(test))) for test in tests]
    assert all(set(found) <= set(CRASH_KINDS) for found in kinds)
    assert [len(found) for found in kinds] == out.bv_crashes[tests].tolist()


@pytest.mark.full
def test_the_verb_says_which_bars_hold(tmp_path: Path) -> None:
    found = cornerforge.site_validate("mcity-signal", data=folder(tmp_path / "data"), recordings=5, tests=50)
    text = site_validation_text(found)
    assert text.splitlines()[-1] == ("Passed." if found.passed else "NOT passed.")
    assert (site_did_not_pass(found) is None) == found.passed
    assert all(bar.measure in text for bar in found.bars)


def test_right_of_way_is_taken_by_those_that_must_yield_and_by_nobody_else() -> None:
    run = experiment(WorldOptions(site="mcity-signal", av="idm-yield"))
    true, zones = (one.setting.road.site[0]["zone"] for one in (run, right_of_way_taken(run)))
    vehicles = run.setting.road.site[0]["vehicle_routes"]
    changed = (true["yields"] != zones["yields"]).any(axis=2)
    assert changed[:vehicles, :vehicles].any()
    assert not changed[vehicles:].any()
    assert not changed[:, vehicles:].any()
    assert not (changed & changed.T).any()  # the other of two keeps the true table
    for one, two in np.argwhere(changed):
        assert zones["goes_first"][one, two].any()
        assert zones["goes_first"][two, one].any()


def test_ten_times_as_many_crashes_are_told_from_fewer_and_from_too_few_to_say() -> None:
    """Against 2 crashes (0.24 to 7.2) 100 (81 to 122) are enough, 40 (29 to 54) say nothing, 0 of 50 are too few."""
    assert priorities(2, 100, 1000).holds is True
    assert priorities(2, 40, 1000).holds is None
    assert priorities(50, 100, 1000).holds is False
    assert priorities(0, 0, 1000).holds is None


@pytest.mark.full
@pytest.mark.parametrize("site", ["mcity-signal", "mcity-roundabout"])
def test_with_right_of_way_taken_traffic_crashes_ten_times_as_often(site: str, seed: int) -> None:
    """Negative control of the laws: some 200 tests of 5,000 crash at the lights, 5 of 200,000 with the true table."""
    run, tests = experiment(WorldOptions(site=site, av="idm-yield")), 5000
    true, taken = (crashed(one, tests, seed) for one in (run, right_of_way_taken(run)))
    assert priorities(true, taken, tests).holds
