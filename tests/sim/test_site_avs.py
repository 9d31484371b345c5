"""Built-in AVs of sites: what RSS demands of one of them, and that the bad one is bad."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cornerforge.drivers.avs import AVS, MANNERS, AvModel
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.intervals import rate_ratio_interval
from cornerforge.sim import reset_world, simulate
from cornerforge.sim.site.av import _rss_bound, junction_av_decides
from cornerforge.sim.world import HERE, allocate_worlds, world_of
from cornerforge.site.tables import CROSS, pose_at
from cornerforge.world_options import WorldOptions


@cache
def run_of(av: str) -> Experiment:
    with pytest.warns(UserWarning, match="Site:"):
        return experiment(WorldOptions(site="mcity-signal", av=av))


def two(own: tuple[int, float, float], other: tuple[int, float, float]) -> float:
    """RSS bound of the AV with one other vehicle; each by its route, place and speed. No light is green for long."""
    run = run_of("rss-yield")
    site = run.setting.road.site
    w = world_of(allocate_worlds(1, 2, run.setting.road))
    w.state["n_vehicles"], w.state["n_current"] = 2, 2
    w.current[:2] = 0, 1
    for slot, (route, s, speed) in enumerate((own, other)):
        w.agents["route"][slot], w.agents["s"][slot], w.agents["stage"][slot] = route, s, HERE
        w.vehicles["present"][slot], w.vehicles["speed"][slot] = 1, speed
        w.vehicles["x"][slot], w.vehicles["y"][slot], w.vehicles["heading"][slot] = pose_at(site, route, s)
    return float(_rss_bound(w, 0.0, site, run.setting.av.rss))


def test_rss_keeps_its_distance_to_what_is_ahead() -> None:
    assert two((0, 10.0, 10.0), (0, 60.0, 10.0)) == np.inf
    assert two((0, 60.0, 10.0), (0, 10.0, 10.0)) == np.inf  # it is behind
    near = [two((0, 10.0, 10.0), (0, 15.0 + gap, 0.0)) for gap in (12.0, 9.0, 6.0, 3.0)]
    assert near == sorted(near, reverse=True)
    assert near[0] == np.inf or near[0] > near[-1]
    assert near[-1] <= -8.0 + 1e-9


def crossing() -> tuple[int, int, float, float]:
    """A route that yields to another where they cross: both, and where the zone begins on each."""
    site = run_of("rss-yield").setting.road.site[0]
    n = int(site["vehicle_routes"])
    zones = site["zone"][:n, :n, 0]
    found = np.argwhere((zones["kind"] == CROSS) & (zones["yields"] == 1))
    a, b = found[0]
    return int(a), int(b), float(zones[a, b]["begin"]), float(zones[a, b]["other_begin"])


def test_rss_stops_before_one_that_goes_first_while_it_can() -> None:
    own, other, begin, other_begin = crossing()
    stop = float(run_of("rss-yield").setting.road.site[0]["route"][other]["stop"])
    comes = max(other_begin - 12.0, stop + 3.0)  # it has passed its line: its light says nothing any more
    assert two((own, begin - 60.0, 8.0), (other, comes, 9.0)) == np.inf  # far away
    assert two((own, begin - 7.0, 8.0), (other, comes, 9.0)) < -2.0
    assert two((own, begin + 1.0, 8.0), (other, comes, 9.0)) == np.inf  # it is there, and leaves
    assert two((own, begin - 7.0, 8.0), (other, other_begin + 60.0, 9.0)) == np.inf  # it is through


def test_rss_yield_never_wants_more_than_rss_allows_nor_its_law() -> None:
    """In worlds as they come, its command is the smaller of the law's and the bound."""
    rss, law = run_of("rss-yield"), run_of("idm-yield")
    road, bounds = rss.setting.road, 0
    w, again = (world_of(allocate_worlds(1, rss.slots, road)) for _ in range(2))
    for test in range(60):
        reset_world(w, 3, test, rss.setting)
        reset_world(again, 3, test, law.setting)
        command = junction_av_decides(w, 0, road, rss.setting.av)
        usual = junction_av_decides(again, 0, road, law.setting.av)
        bound = max(-8.0, _rss_bound(w, float(w.state["clock"][0]), road.site, rss.setting.av.rss))
        assert command == min(usual, bound)
        bounds += bound < usual
    assert bounds < 60


@pytest.mark.full
def test_the_creeping_av_crashes_more_often() -> None:
    """Unit: a test; 10,000 of each. Rates 0.012 and 0.0026 were measured of 20,000."""
    found = {
        av: simulate(run_of(av).setting, run_of(av).slots, seed=8, tests=10_000, threads=2).av_crashes
        for av in ("idm-yield", "creep")
    }
    low, _ = rate_ratio_interval(found["creep"], 10_000, found["idm-yield"], 10_000, 1.0 - 1e-6)
    assert low > 1.0


def test_what_is_said_of_them_is_what_they_have() -> None:
    at_sites = {name: model for name, model in AVS.items() if model.kind == "junction"}
    assert set(at_sites) == {"idm-yield", "rss-yield", "creep"}
    assert [MANNERS[model.junction.manner].rss for model in at_sites.values()] == [False, True, False]
    assert all(isinstance(model, AvModel) for model in at_sites.values())
