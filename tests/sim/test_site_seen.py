"""A site as its AV perceives it, held against recordings, shapes and counts."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.intervals import binomial_interval
from cornerforge.perception import Perception
from cornerforge.sim import perceived, reset_world, simulate
from cornerforge.sim.perception import _hider, lose_controlled, show_as_is, show_as_seen
from cornerforge.sim.scratch import allocate_av_scratch
from cornerforge.sim.world import HERE, NO_VEHICLE, allocate_worlds, world_of
from cornerforge.site.tables import WALK, nearest_place, pose_at
from cornerforge.types import PERSON, TRUCK, Scenario
from cornerforge.world_options import WorldOptions

SEED = 11


@cache
def run_at_site(perception: str | None = None) -> Experiment:
    with pytest.warns(UserWarning, match="Site:"):
        return experiment(WorldOptions(site="mcity-signal", av="idm-yield", perception=perception))


@cache
def recorded(perception: str, test: int = 0) -> tuple[Scenario, NDArray[np.float64]]:
    scenario = run_at_site(perception).recorder().record(SEED, test)
    return scenario, perceived(scenario)


def test_a_place_on_a_route_is_found_again() -> None:
    site = run_at_site().setting.road.site
    for route in range(int(site[0]["routes"])):
        for share in (0.0, 0.3, 0.61, 1.0):
            s = share * float(site[0]["route"][route]["length"])
            x, y, _ = pose_at(site, route, s)
            assert abs(nearest_place(site, route, x, y) - s) < 1e-6


def test_one_that_sees_all_drives_as_one_that_perceives_perfectly() -> None:
    plain, wide = (
        simulate(run.setting, run.slots, seed=SEED, tests=60) for run in (run_at_site(), run_at_site("dropout=1e-12"))
    )
    blind = simulate(run_at_site("range=10").setting, run_at_site().slots, seed=SEED, tests=60)
    assert plain.digest.hexdigest() == wide.digest.hexdigest()
    assert blind.digest.hexdigest() != plain.digest.hexdigest()


def test_late_is_carried_on_along_the_route() -> None:
    scenario, seen = recorded("latency=0.5")
    site = run_at_site("latency=0.5").setting.road.site
    x, y, there = scenario.x, scenario.y, scenario.present
    checked = bent = 0
    for frame in range(20, len(x), 7):
        then = frame - 5
        for k in range(1, x.shape[1]):
            if not there[frame, k]:
                assert np.isnan(seen[frame, k]).all()
            elif not there[then, k]:
                assert np.isnan(seen[frame, k]).all()  # it had not come
            else:
                route = int(scenario.target_lane[frame, k])
                s = nearest_place(site, route, x[then, k], y[then, k]) + 0.5 * scenario.speed[then, k]
                expected = pose_at(site, route, min(s, float(site[0]["route"][route]["length"])))
                np.testing.assert_allclose(seen[frame, k], expected[:2], atol=1e-6)
                bent += abs(expected[2] - scenario.heading[then, k]) > 0.02
                checked += 1
    assert checked > 50
    assert bent > 3
    np.testing.assert_allclose(seen[:, 0], np.stack([x[:, 0], y[:, 0]], axis=1), atol=1e-9)


def test_range_ends_where_it_says() -> None:
    scenario, seen = recorded("range=40")
    away = np.hypot(scenario.x - scenario.x[:, :1], scenario.y - scenario.y[:, :1])
    assert (np.isnan(seen[:, :, 0]) == ((away > 40.0) | ~scenario.present.astype(bool))).all()
    assert np.isnan(seen[scenario.present.astype(bool)][:, 0]).any()


def test_noise_is_as_large_along_the_way_as_it_says_and_a_third_aside() -> None:
    along, aside = [], []
    for test in range(12):
        scenario, seen = recorded("noise=0.6", test)
        whole = slice(0, len(scenario.x), 10)  # errors of other seconds are drawn apart
        off = seen[whole] - np.stack([scenario.x, scenario.y], axis=2)[whole]
        fine = scenario.present[whole].astype(bool) & np.isfinite(off[..., 0]) & (scenario.speed[whole] > 1.0)
        fine[:, 0] = False
        c, s = np.cos(scenario.heading[whole][fine]), np.sin(scenario.heading[whole][fine])
        along.append(off[fine][:, 0] * c + off[fine][:, 1] * s)
        aside.append(off[fine][:, 1] * c - off[fine][:, 0] * s)
    a, b = np.concatenate(along), np.concatenate(aside)
    assert a.size > 800
    wide = 5.0 / math.sqrt(2.0 * a.size)  # 5 standard errors of a standard deviation; bends and ends of routes add some
    assert abs(a.std() / 0.6 - 1.0) < wide + 0.05
    assert abs(b.std() / 0.2 - 1.0) < wide + 0.1


def test_a_second_is_lost_as_often_as_it_says() -> None:
    lost = n = 0
    for test in range(8):
        scenario, seen = recorded("dropout=0.2", test)
        whole = slice(0, len(scenario.x), 10)
        there = scenario.present[whole].astype(bool)
        there[:, 0] = False
        lost += int(np.isnan(seen[whole][there][:, 0]).sum())
        n += int(there.sum())
    low, high = binomial_interval(lost, n, 1.0 - 1e-6)
    assert low <= 0.2 <= high
    assert n > 800


def stood(heading: float, person_at: tuple[float, float], truck_at: tuple[float, float], truck_turned: float) -> bool:
    """Is a person hidden by a truck? Places from the AV's middle, in a frame turned by `heading`."""
    road = run_at_site("occlusion").setting.road
    w = world_of(allocate_worlds(1, 3, road))
    c, s = math.cos(heading), math.sin(heading)
    w.state["n_vehicles"] = 3
    for slot, (x, y), kind, size, turned in (
        (0, (0.0, 0.0), 0, (5.0, 2.0), 0.0), (1, person_at, PERSON, (0.6, 0.6), 0.0),
        (2, truck_at, TRUCK, (7.5, 2.3), truck_turned),
    ):  # fmt: skip
        v = w.vehicles[slot]
        v["x"], v["y"], v["heading"] = 10.0 + x * c - y * s, -20.0 + x * s + y * c, heading + turned
        v["kind"], v["length"], v["width"], v["present"] = kind, *size, 1
    return bool(_hider(w, 1, True) != NO_VEHICLE)


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.0, -2.6])
def test_people_behind_a_truck_are_hidden_whichever_way_it_stands(heading: float) -> None:
    assert stood(heading, (12.0, 3.0), (7.0, 2.5), 0.0)  # its rear corner covers the way to the person
    assert not stood(heading, (12.0, -3.0), (7.0, 2.5), 0.0)
    assert not stood(heading, (6.0, 0.0), (12.0, 0.0), 0.0)  # it is behind the person
    assert stood(heading, (14.0, 5.0), (8.0, 0.0), 0.5 * math.pi)  # across the way: 7.5 m wide
    assert not stood(heading, (14.0, 5.0), (8.0, 0.0), 0.0)  # along it: 2.3 m wide
    assert not stood(heading, (14.0, 12.0), (8.0, 0.0), 0.5 * math.pi)


def test_an_agent_that_is_not_seen_is_not_looked_at_and_comes_back() -> None:
    run = run_at_site("range=10")
    road = run.setting.road
    w = world_of(allocate_worlds(1, run.slots, road))
    hidden = 0
    for test in range(5):
        reset_world(w, SEED, test, run.setting)
        before = [array.copy() for array in (w.vehicles, w.agents, w.current[: int(w.state["n_current"][0])])]
        s = allocate_av_scratch(run.slots)
        show_as_seen(w, 0, road, s)
        listed = w.current[: int(w.state["n_current"][0])]
        away = np.hypot(w.vehicles["x"][listed] - w.vehicles["x"][0], w.vehicles["y"][listed] - w.vehicles["y"][0])
        assert (away <= 10.0).all()
        hidden += before[2].size - listed.size
        show_as_is(w, road, s)
        assert (w.vehicles == before[0]).all()
        assert (w.agents == before[1]).all()
        assert sorted(w.current[: int(w.state["n_current"][0])]) == sorted(before[2])
    assert hidden > 10


def test_an_adversary_hides_only_what_meets_the_av_soon() -> None:
    run = run_at_site("dropout=0.01")
    road = run.setting.road
    site = road.site[0]
    w = world_of(allocate_worlds(1, 3, road))
    w.state["n_vehicles"] = 3
    zones = site["zone"]
    walks = [r for r in range(int(site["routes"])) if site["route"][r]["turn"] == WALK]
    own, other = next((a, b) for a in range(int(site["vehicle_routes"])) for b in walks if zones[a, b, 0]["kind"])
    zone = zones[own, other, 0]
    w.agents["stage"] = HERE
    w.agents["route"][:2] = own, other
    w.vehicles["present"][:2] = 1
    w.vehicles["speed"][0] = 5.0

    def hides(own_s: float, other_s: float, budget: int = 10**9) -> bool:
        w.agents["s"][:2] = own_s, other_s
        w.state["budget_left"], w.state["hidden"] = budget, -1
        lose_controlled(w, 1, road)
        assert (int(w.state["budget_left"][0]) < budget) == (int(w.state["hidden"][0]) == 1)
        return int(w.state["hidden"][0]) == 1

    begin, through = float(zone["begin"]), float(zone["other_end"])
    assert hides(begin - 10.0, 0.0)
    assert not hides(begin - 40.0, 0.0)  # too far away
    assert not hides(begin - 10.0, through + 0.1)  # it is through
    assert not hides(begin - 10.0, 0.0, budget=1)  # no budget


def test_perception_is_told_at_a_site() -> None:
    assert run_at_site("occlusion").odd.perception == Perception(occlusion=True)
    assert replace(run_at_site("latency=0.5").odd, perception=None) == run_at_site().odd
