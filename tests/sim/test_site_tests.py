"""Tests at a site through the callers of the one loop: threads, scripts, stored worlds, chances, case files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import demand_of, laws_named, odd_at, site_named
from cornerforge.sim import (
    NEVER,
    Script,
    advance,
    allocate_scratch,
    allocate_worlds,
    branch_of,
    keep_nothing,
    packed,
    reset_world,
    simulate,
    unpacked,
    world_of,
)
from cornerforge.sim.recorder import scenario_digest
from cornerforge.sim.site.choice import GIVES_WAY, GOES, natural_choice
from cornerforge.sim.site.second import look_around
from cornerforge.site.network import SITE_FILES
from cornerforge.site.tables import pose_at
from cornerforge.types import PERSON, Odd, Scenario
from cornerforge.world_options import WorldOptions


def careless(name: str = "mcity-signal", **options: Any) -> Experiment:
    """A run at a site whose drivers overlook others often, so that few tests hold many crashes."""
    laws = replace(
        laws_named(None), overlooks_person=0.1, overlooks_vehicle=0.1, runs_red=0.1, looks_away=0.5, looks_back=0.05
    )
    odd = odd_at(Odd(), site_named(name), laws, demand_of("vehicles=300,people=120"))
    return experiment(WorldOptions(av="creep"), road=odd, **options)


def crashes(run: Experiment, tests: range) -> list[Scenario]:
    recorder = run.recorder()
    recorded = (recorder.record(1, test) for test in tests)
    return [one for one in recorded if one.crash is not None and one.crash.slot_a == 0]


@pytest.fixture(scope="module")
def run() -> Experiment:
    return careless()


def test_results_do_not_depend_on_threads_or_on_where_a_range_begins(run: Experiment) -> None:
    whole = simulate(run.setting, run.slots, seed=3, tests=120, threads=1)
    assert simulate(run.setting, run.slots, seed=3, tests=120, threads=2).digest.hexdigest() == whole.digest.hexdigest()
    later = run.recorder().record(3, 77)
    again = run.recorder()
    for test in (5, 77):
        last = again.record(3, test)
    assert scenario_digest(last) == scenario_digest(later)


@pytest.mark.parametrize("name", SITE_FILES)
def test_the_script_of_a_crash_gives_the_crash_and_so_does_a_later_start(name: str) -> None:
    run = careless(name)
    found = crashes(run, range(200))
    assert len(found) >= 3
    driver = run.script_driver()
    for case in found[:6]:
        frame, _ = case.contact()
        script = Script(case.slot, driver.start_of_test(case.seed, case.test), case.action, case.seed, case.test)
        ending = driver.drive(script)
        assert (ending.frame, ending.partner) == (frame, case.crash.slot_b if case.crash else None)
        again, chances = driver.record(script)
        np.testing.assert_array_equal(again.x, case.x)
        there = again.present[: 10 * len(again.action) : 10, 1:]
        np.testing.assert_allclose(chances[:, 1:][there].sum(axis=1), 1.0, atol=1e-12)
        later = driver.later(script, 2)
        assert later is not None
        ending = driver.drive(later)
        assert (ending.frame, ending.partner) == (frame - 20, case.crash.slot_b if case.crash else None)


def test_a_stored_world_goes_on_as_if_it_had_not_been_interrupted(run: Experiment) -> None:
    scratch, keep = allocate_scratch(run.slots, run.setting.who.policy), keep_nothing(run.slots)
    world = world_of(allocate_worlds(1, run.slots, run.setting.road))
    reset_world(world, 2, 9, run.setting)
    advance(world, run.setting, scratch, keep, 4)
    stored = unpacked(packed(world), run.setting)
    other = branch_of(world, 7)
    for one in (world, stored, other):
        advance(one, run.setting, scratch, keep, NEVER)
    assert packed(world) == packed(stored)
    assert packed(world) != packed(other)


def test_agents_act_as_often_as_their_chances_say(run: Experiment) -> None:
    """Branches of one moment draw their actions anew: each count is within 5 standard deviations of n p."""
    scratch, keep = allocate_scratch(run.slots, run.setting.who.policy), keep_nothing(run.slots)
    world = world_of(allocate_worlds(1, run.slots, run.setting.road))
    n, seen = 400, {"choice": 0, "noise": 0, "person": 0}
    for test in range(4):
        reset_world(world, 4, test, run.setting)
        advance(world, run.setting, scratch, keep, 6)
        slots = world.current[1 : world.state["n_current"][0]].copy()
        chances = np.zeros((run.slots, 33))
        looking = branch_of(world, 0)
        for i in slots:
            look_around(looking, i, run.setting.road.site)
            natural_choice(looking, i, run.setting.road.site, chances[i])
        counts = np.zeros_like(chances)
        for branch in range(1, n + 1):
            copy = branch_of(world, branch)
            advance(copy, run.setting, scratch, keep, 7)
            np.add.at(counts, (slots, copy.vehicles["action"][slots]), 1)
        for i in slots:
            p = chances[i]
            assert p.sum() == pytest.approx(1.0, abs=1e-12)
            assert counts[i][p == 0.0].sum() == 0
            assert (np.abs(counts[i] - n * p) <= 5.0 * np.sqrt(n * p * (1.0 - p)) + 1e-9).all()
            if world.vehicles["kind"][i] == PERSON:
                seen["person"] += 1
            elif looking.agents["chooses"][i]:
                seen["choice"] += 1
                assert p[GOES] + p[GIVES_WAY] >= 0.5
            else:
                seen["noise"] += 1
    assert min(seen["noise"], seen["choice"] + seen["person"]) > 0


def test_poses_lie_on_the_routes() -> None:
    for name in SITE_FILES:
        run = careless(name)
        site = run.odd.site
        assert site is not None
        for k, route in enumerate(site.routes):
            for s in np.linspace(0.0, route.length, 7):
                at = np.array([np.interp(s, route.along, values) for values in route.line.T])
                x, y, _ = pose_at(run.setting.road.site, k, float(s))
                assert np.hypot(x - at[0], y - at[1]) < 0.1


def test_a_case_file_holds_all_of_a_case_at_a_site(run: Experiment, tmp_path: Path) -> None:
    from cornerforge.library.case_file import CaseFile, read_case_file, write_case_file

    case = crashes(run, range(60))[0]
    driver = run.script_driver()
    script = Script(case.slot, driver.start_of_test(case.seed, case.test), case.action, case.seed, case.test)
    path = tmp_path / "case.json"
    write_case_file(CaseFile(name="one", odd=run.odd, script=script, av="creep", av_hash=None), path)
    read = read_case_file(path)
    assert read.odd == run.odd
    assert driver.drive(read.script).frame == driver.drive(script).frame == case.contact()[0]


def test_what_belongs_to_roads_is_refused_at_a_site() -> None:
    for options, text in (
        ({"av": "idm-mobil"}, "drives on roads only"),
        ({"av": "idm-yield", "lanes": 3}, "lanes is for roads"),
        ({"av": "idm-yield", "road": "curves"}, "road is for roads"),
        ({"av": "idm-yield", "site_traffic": "cars=3"}, "cars"),
        ({"av": "idm-yield", "site_traffic": "people=many"}, "write people=NUMBER"),
    ):
        with pytest.raises(InputError, match=text):
            experiment(WorldOptions(site="mcity-signal", **options))
    with pytest.raises(InputError, match="at sites only"):
        experiment(WorldOptions(av="idm-yield"))
    with pytest.raises(InputError, match="is for sites"):
        experiment(WorldOptions(site_traffic="people=3"))
