"""The critical agent at a site, what an adversary sees of it, what it may do, and the plain adversaries of sites."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.drivers.policy import NetworkShape, n_weights
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.policy_file import Policy, save_policy
from cornerforge.experiment.setting import experiment
from cornerforge.intervals import binomial_interval
from cornerforge.results import Trained
from cornerforge.sim import (
    World,
    advance,
    allocate_scratch,
    allocate_worlds,
    keep_nothing,
    look_as_bv,
    reset_world,
    simulate,
    world_of,
)
from cornerforge.sim.controllers import ROAD_ADVERSARIES, SITE_ADVERSARIES
from cornerforge.sim.observe import N_OBSERVATION, N_OWN
from cornerforge.sim.site.views import CLASS, critical_agent, meeting_with_av
from cornerforge.site.tables import CROSS, NO_ZONE, SHARED, longer
from cornerforge.types import N_ACTIONS, PERSON
from cornerforge.world_options import LEARNERS, STEER_FROM, WorldOptions

SITE = WorldOptions(site="mcity-signal", av="idm-yield")


@pytest.fixture(scope="module")
def run() -> Experiment:
    return experiment(SITE)


def moments(run: Experiment, tests: int) -> list[World]:
    """Worlds of natural tests, each some seconds after its start."""
    scratch, keep = allocate_scratch(run.slots, run.setting.who.policy), keep_nothing(run.slots)
    found = []
    for test in range(tests):
        world = world_of(allocate_worlds(1, run.slots, run.setting.road))
        reset_world(world, 4, test, run.setting)
        advance(world, run.setting, scratch, keep, 2 + test % 9)
        found.append(world)
    return found


def times_apart(world: World, j: int, run: Experiment) -> float:
    """By how much the times of the AV and an agent at their first common zone differ, in plain words."""
    one, v, agents = run.setting.road.site[0], world.vehicles, world.agents
    av, other = agents[0], agents[j]
    zone = one["zone"][av["route"], other["route"], 0]
    walks = v["kind"][j] == PERSON

    def time(room: float, speed: float, top: float) -> float:
        """Step by step: it gains 1.5 m/s each second up to `top`."""
        t = 0.0
        while room > 0.0:
            room -= speed * 1e-3
            speed = max(speed, min(top, speed + 1.5e-3))
            t += 1e-3
        return t

    av_room = zone["begin"] - longer(v["length"][0], False) - av["s"]
    room = zone["other_begin"] - longer(v["length"][j], bool(walks)) - other["s"]
    own = time(av_room, v["speed"][0], one["route"][av["route"]]["limit"])
    if walks:
        return abs(own - max(room, 0.0) / max(v["speed"][j], v["desired_speed"][j]))
    return abs(own - time(room, v["speed"][j], one["route"][other["route"]]["limit"]))


def test_the_critical_agent_meets_the_av_nearest_in_time(run: Experiment) -> None:
    crossing = 0
    for world in moments(run, 60):
        met = {
            j: meeting_with_av(world, j, run.setting.road.site)
            for j in world.current[: world.state["n_current"][0]]
            if j
        }
        chosen = critical_agent(world, run.setting.road.site)
        reachable = {j: m for j, m in met.items() if m.kind != NO_ZONE}
        if reachable:
            value = {j: m.apart + 0.2 * min(m.av_time, m.time) for j, m in reachable.items()}
            assert value[chosen] == min(value.values())
        for j, m in reachable.items():
            zones = run.setting.road.site[0]["zone"][world.agents["route"][0], world.agents["route"][j]]["kind"]
            if m.kind == CROSS and (zones != NO_ZONE).sum() == 1:
                assert m.apart == pytest.approx(times_apart(world, j, run), abs=0.02)
                crossing += 1
            elif m.kind == SHARED and m.ahead:
                gap = abs(world.agents["s"][j] - world.agents["s"][0]) - 0.5 * world.vehicles["length"][[0, j]].sum()
                if world.agents["route"][j] == world.agents["route"][0]:
                    assert m.room == pytest.approx(max(gap, 0.0))
    assert crossing > 30


def test_what_the_adversary_sees_is_small_and_finite_and_what_it_may_do_is_natural(run: Experiment) -> None:
    bounded = experiment(SITE, bv="uniform", bounded=True)
    scratch = allocate_scratch(run.slots, run.setting.who.policy)
    seen, allowed, p = np.zeros(N_OBSERVATION, np.float32), np.zeros(N_ACTIONS, np.bool_), scratch.choice.p
    classes = set()
    for world in moments(run, 60):
        bv = look_as_bv(world, bounded.setting, scratch, seen, allowed)
        if bv < 0:
            continue
        assert np.isfinite(seen).all()
        assert (np.abs(seen) <= 3.0).all()
        classes.add(float(seen[CLASS]))
        assert seen[N_OWN - 1] == 1.0  # no budget
        assert seen[N_OWN + 4] == 1.0  # the AV comes first
        np.testing.assert_array_equal(allowed, p > 0.0)
        assert p.sum() == pytest.approx(1.0)
        before = world.agents.copy()
        look_as_bv(world, run.setting, scratch, seen, allowed)
        assert (before == world.agents).all()  # a second look changes nothing
        last = 6 if world.vehicles["kind"][bv] == PERSON else N_ACTIONS
        assert allowed[:last].all()
        assert not allowed[last:].any()
    assert {0.0, 1.0} <= classes


@pytest.mark.parametrize("budget", [None, 6.0])
def test_a_bounded_adversary_does_what_is_possible_and_within_its_budget(budget: float | None) -> None:
    world = replace(SITE, bounded=True, budget=budget) if budget is not None else replace(SITE, bounded=True)
    recorder = experiment(world, bv="uniform").recorder()
    for test in range(40):
        case = recorder.record(2, test)
        assert case.shortfall is not None
        assert np.isfinite(case.log_prob_nde).all()
        if budget is not None:
            assert case.shortfall[STEER_FROM:].sum() <= budget + 1e-5 * case.shortfall.size


@pytest.mark.full
@pytest.mark.parametrize("name", SITE_ADVERSARIES)
def test_a_plain_adversary_makes_more_crashes_than_nature(name: str, run: Experiment) -> None:
    tests = 2500
    nature = simulate(run.setting, run.slots, seed=6, tests=tests, threads=2).av_crashes
    made = simulate(
        (found := experiment(SITE, bv=name)).setting, found.slots, seed=6, tests=tests, threads=2
    ).av_crashes
    assert binomial_interval(made, tests)[0] > binomial_interval(nature, tests)[1] or name == "cuts-in"
    recorder = found.recorder()
    kinds = set()
    for test in range(300):
        case = recorder.record(6, test)
        if case.crash is not None and case.crash.slot_a == 0:
            kinds.add(int(case.kind[case.crash.slot_b]))
    if name == "dart-out":
        assert PERSON in kinds


@pytest.mark.full
@pytest.mark.parametrize("learner", LEARNERS)
def test_each_learner_trains_at_a_site_and_its_policy_drives_there(learner: str, tmp_path: Path) -> None:
    policy = tmp_path / "policy.safetensors"

    def trained(resume: bool) -> Trained:
        return cornerforge.train(
            out=policy, site="mcity-signal", av="idm-yield", learner=learner, decisions=20_000, tests=64, seed=4,
            resume=resume,
        )  # fmt: skip

    found = trained(False)
    assert trained(True).kept  # a site is told as lists in the file
    assert found.decisions >= 20_000
    assert {one.name.partition(",")[0] for one in found.baselines} == {"nobody", *SITE_ADVERSARIES}
    driven = cornerforge.simulate(site="mcity-signal", av="idm-yield", bv=str(policy), tests=300, seed=4)
    assert driven.av_crashes > 0  # nature has none in 5,000


def test_adversaries_and_policies_of_another_family_of_worlds_are_refused(tmp_path: Path) -> None:
    for name in set(ROAD_ADVERSARIES) - set(SITE_ADVERSARIES):
        with pytest.raises(InputError, match="drives on roads only"):
            experiment(SITE, bv=name)
    for name in set(SITE_ADVERSARIES) - set(ROAD_ADVERSARIES):
        with pytest.raises(InputError, match="drives at sites only"):
            experiment(WorldOptions(), bv=name)
    shape = NetworkShape(N_OBSERVATION, 1, 1, 4)
    weights = np.zeros(n_weights(shape), np.float32)
    of_road, of_site = ({"odd": experiment(one).odd.stated()} for one in (WorldOptions(), SITE))
    for about, name, world, where in (
        (of_road, "road", SITE, "learned on a road"),
        (of_site, "site", WorldOptions(), "learned at a site"),
    ):
        save_policy(Policy(weights, shape, False, about), tmp_path / f"{name}.safetensors")
        with pytest.raises(InputError, match=where):
            experiment(world, bv=str(tmp_path / f"{name}.safetensors"))
    assert experiment(SITE, bv=str(tmp_path / "site.safetensors")).bv == "policy"
