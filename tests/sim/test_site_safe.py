"""Drivers at a site that do not err: ways to stop, zones of trucks, and no crash."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cornerforge.experiment.counting import simulate_experiment
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import laws_named
from cornerforge.ext.calibrate.site_validating import ERRORS_OFF
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.results.stating import as_json
from cornerforge.sim.motion import go_on
from cornerforge.sim.site.moves import held_then_stops_within, stops_within
from cornerforge.site.tables import CROSS, NO_ZONE, longer, pose_at
from cornerforge.work.files import write_json
from cornerforge.world_options import WorldOptions

SITES = ("mcity-signal", "mcity-crossing", "mcity-two-lanes", "mcity-roundabout")
HARDEST = -8.0
TRUCK = (7.5, 2.3)


@lru_cache
def at(site: str) -> Experiment:
    return experiment(WorldOptions(site=site, av="idm-yield"))


def test_the_way_to_a_stop_is_bounded_closely() -> None:
    """Driven out by the motion of the simulator: never farther than said, and hardly less far unless it was braking."""
    road = at("mcity-signal").setting.road
    for speed in (0.0, 0.3, 1.0, 3.0, 6.0, 9.0):
        for now in (-8.0, -4.9, -1.0, 0.0, 2.0):
            if speed == 0.0 and now != 0.0:
                continue
            braked = sum(go_on(speed, now, HARDEST, 5.0, road)[:2])
            assert braked <= stops_within(speed, now) + 1e-9
            for command in (-8.0, -3.0, -0.2, 0.0, 1.0, 2.0):
                way, top, after, held = go_on(speed, now, command, 1.0, road)
                driven = way + top + sum(go_on(after, held, HARDEST, 5.0, road)[:2])
                said = held_then_stops_within(speed, now, command)
                assert driven <= said + 1e-9, (speed, now, command)
                assert now < 0.0 or said <= driven + 1.0, (speed, now, command)


@pytest.mark.parametrize("pair", [(1, 3), (3, 12), (0, 9), (4, 12), (6, 11)])
def test_trucks_outside_a_zone_touch_nothing_in_it(pair: tuple[int, int]) -> None:
    site = at("mcity-signal").setting.road.site
    one, two = pair
    zone = site[0]["zone"][one, two, 0]
    assert zone["kind"] != NO_ZONE
    more = longer(TRUCK[0], False)
    before = zone["begin"] - more - 0.1, zone["other_begin"] - more - 0.1
    beyond = zone["end"] + more, zone["other_end"] + more
    for s in np.arange(0.0, site[0]["route"][one]["length"], 0.5):
        for o in np.arange(0.0, site[0]["route"][two]["length"], 0.5):
            out = s < before[0] or o < before[1]
            if zone["kind"] == CROSS:
                out = out or s > beyond[0] or o > beyond[1]
            if out:
                assert not boxes_overlap(Box(*pose_at(site, one, s), *TRUCK), Box(*pose_at(site, two, o), *TRUCK))


def without_errors(site: str, folder: Path) -> Experiment:
    from dataclasses import replace

    write_json(folder / "laws.json", as_json(replace(laws_named(None), **ERRORS_OFF)))
    return experiment(WorldOptions(site=site, av="idm-yield", site_laws=str(folder / "laws.json")))


@pytest.mark.parametrize("site", SITES)
def test_without_errors_none_crashes(site: str, tmp_path: Path) -> None:
    """Of 3,000 tests none; 66 of 20,000 had a crash before drivers stayed able to stop, so 10 would be expected."""
    tally, _ = simulate_experiment(without_errors(site, tmp_path), tests=3000, seed=5)
    assert (tally.av_crashes, tally.bv_crashes) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("site", SITES)
def test_without_errors_none_crashes_in_many_tests(site: str, tmp_path: Path, seed: int) -> None:
    tally, _ = simulate_experiment(without_errors(site, tmp_path), tests=1_000_000, seed=seed)
    assert (tally.av_crashes, tally.bv_crashes) == (0, 0)
