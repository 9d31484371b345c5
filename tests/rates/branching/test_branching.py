"""Trees of tests: acts have the chances that nature gives them, and no mean depends on what the network says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge._philox import PURPOSE_DECIDE, blocks
from cornerforge.experiment.av_file import av_of
from cornerforge.ndd.model import NddModel
from cornerforge.rates.branching.acts import (
    BEGINS,
    BRAKES_LESS,
    GOES_ON,
    LOOKS_AWAY,
    TURNS_BACK,
    Survey,
    allocate_survey,
    last_of,
    list_acts,
    list_pairs,
    look_around,
)
from cornerforge.rates.branching.danger import N_SEEN, WIDTH, Network, untaught
from cornerforge.rates.branching.drive import DrivenTrees, drive_trees
from cornerforge.rates.branching.population import TREE, Plan, Population, allocate_pool, allocate_terminal_states
from cornerforge.rates.branching.splitting import drive_tree_range
from cornerforge.rates.branching.training_data import add_what_followed, allocate_training_data
from cornerforge.road.straight import road_numbers
from cornerforge.sim import Script, ScriptDriver, simulate
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.loop import advance
from cornerforge.sim.outcome import RUNNING
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.snapshot import copy_of
from cornerforge.sim.steering import ACCELERATION, HIGH, LANE, hold_to, let_go
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import MAX_BRANCH, World, allocate_worlds, moment_of, n_slots, world_of
from cornerforge.types import ACTION_LEFT, ACTION_RIGHT, FIRST_ACCELERATION

pytestmark = pytest.mark.full

ODD = WIDE
SLOTS = n_slots(ODD)
ODD_DECISIONS = road_numbers(ODD).max_decisions
ROUNDING = 2.0**-30
SIGMAS = 5.0
"""A right sampler is further off with a chance of 6e-7."""


@pytest.fixture(scope="module")
def careless(reckless: NddModel) -> NddModel:
    """Drivers that change lanes often, overlook what is beside them and often look away: the AV often crashes."""
    memory = replace(reckless.memory, away=0.05, away_again=0.5)
    return replace(reckless, memory=memory)


def any_network(seed: int) -> Network:
    """A network that was taught nothing: it finds some things dangerous, by chance."""
    rng = np.random.default_rng(seed)
    shapes = (N_SEEN, WIDTH), (WIDTH,), (WIDTH, WIDTH), (WIDTH,), (WIDTH + 1,)
    weights = [rng.normal(0.0, 0.5, shape).astype(np.float32) for shape in shapes]
    weights[-1][-1] = -6.0
    return Network(*weights)


def wary_of_pairs() -> Network:
    """Bad: a BV enters the AV's lane from behind; worse: and the AV will brake. All else is harmless."""
    first, second, last = (untaught(1e-6)[k] for k in (0, 2, 4))
    for unit in (0, 1):
        first[7, unit] = first[9, unit] = 1.0  # in the AV's lane; in a change
        first[2, unit] = -1.0  # behind the AV
        second[unit, unit] = 1.0
    first[25, 1] = 1.0  # how hard the AV will brake
    last[:2] = 2.0, 8.0
    return Network(
        first, np.array([-2.5, -3.0] + [0.0] * (WIDTH - 2), dtype=np.float32), second, untaught(1e-6)[3], last
    )


def plan_of(network: Network, level: float, explore: float = 0.02) -> Plan:
    return Plan(level, 0.3 * level, 0.1, explore, 1, 30.0, 2.0, network)


def setting(model: NddModel, av: str = "idm-mobil") -> Setting:
    return setting_of(model, ODD, av=av_of(av))


def trees(
    run: Setting, plan: Plan, tests: int, *, first: int = 0, threads: int = 2, learning: bool = False
) -> DrivenTrees:
    return drive_trees(run, SLOTS, plan, seed=4, first=first, tests=tests, threads=threads, learning=learning)


def fits(weights: np.ndarray, mean: float, error: float = 0.0) -> bool:
    return bool(abs(weights.mean() - mean) < SIGMAS * np.hypot(standard_error(weights), error))


def standard_error(weights: np.ndarray) -> float:
    return float(weights.std(ddof=1) / np.sqrt(weights.size))


# What may happen


def surveyed(run: Setting, test: int, second: int) -> tuple[World, Survey]:
    """A world of natural traffic at the begin of a second, and all acts that may happen there."""
    world, survey, network = world_of(allocate_worlds(1, SLOTS)), allocate_survey(), untaught(1e-6)
    reset_world(world, 4, test, run)
    advance(world, run, allocate_scratch(SLOTS, run.who.policy), keep_nothing(SLOTS), second)
    total, ahead = look_around(world, run, network, survey)
    list_acts(world, total, -1.0, ahead, run, network, survey)
    list_pairs(world, ahead, run, network, survey)
    return world, survey


def test_one_who_enters_ahead_is_listed_for_the_sake_of_one_behind(careless: NddModel) -> None:
    """Alone too harmless to be listed, together dangerous: one enters ahead of the AV, one behind it."""
    run, network, survey, found = setting(careless), wary_of_pairs(), allocate_survey(), 0
    for test in range(300):
        world = surveyed(run, test, 1 + test % 9)[0]
        if world.state["outcome"][0] != RUNNING:
            continue
        total, ahead = look_around(world, run, network, survey)
        list_acts(world, total, 1.1 * total, ahead, run, network, survey)
        list_pairs(world, ahead, run, network, survey)
        n = int(survey.n_acts[0])
        pairs = survey.pairs[:n, :n] + survey.pairs[:n, :n].T
        groups = [(int(act["slot"]), int(act["word"])) for act in survey.acts[:n]]
        for k, act in enumerate(survey.acts[:n]):
            if act["danger"] > 1.1 * total or groups.count(groups[k]) > 1:
                continue
            others = survey.acts["danger"][:n]
            assert act["kind"] == BEGINS
            assert world.vehicles["x"][act["slot"]] > world.vehicles["x"][0]
            assert (pairs[k] > 2.0 * np.maximum(others, 1.1 * total)).any()
            found += 1
    assert found > 10, "so few that this test shows nothing"


def happened(world: World, act: np.void) -> bool:
    """Did an act happen in the second that was just driven?"""
    driver = world.vehicles[act["slot"]]
    if act["kind"] == LOOKS_AWAY:
        return bool(driver["away"] == 1)
    if act["kind"] in (BEGINS, TURNS_BACK):
        return bool(driver["action"] in (ACTION_LEFT, ACTION_RIGHT) and driver["target_lane"] == act["lane"])
    if act["kind"] == BRAKES_LESS:
        least, most = (HIGH[0], 1.0) if act["first"] == 0 else (HIGH[1], HIGH[0])
        return bool(least <= driver["quantile"] + ROUNDING and driver["quantile"] - ROUNDING < most)
    return bool(driver["action"] >= FIRST_ACCELERATION)


def can_be_hindered(world: World, act: np.void) -> bool:
    """A driver that looks away begins no change and turns back in none; one that gives way begins none."""
    driver = world.vehicles[act["slot"]]
    return bool(driver["away"] == 1) or (act["kind"] == BEGINS and driver["action"] >= FIRST_ACCELERATION)


def test_an_act_happens_with_its_words_and_with_no_others(careless: NddModel) -> None:
    run = setting(careless)
    scratch = allocate_scratch(SLOTS, run.who.policy)
    seen: dict[tuple[int, bool], int] = {}
    for test in range(400):
        world, survey = surveyed(run, test, 1 + test % 9)
        if world.state["outcome"][0] != RUNNING:
            continue
        n = int(world.state["n_vehicles"][0])
        words = np.zeros((4, n), dtype=np.uint64)
        blocks(words, 4, test, moment_of(world), n, PURPOSE_DECIDE)
        low = np.uint64(0xFFFF)
        away = (words[2] & low) | ((words[3] & low) << np.uint64(16))
        advance(world, run, scratch, keep_nothing(SLOTS), int(world.state["decisions"][0]) + 1)
        for act in survey.acts[: survey.n_acts[0]]:
            if act["word"] == ACCELERATION:  # its words are not counted, but their places (tests/sim/test_steering.py)
                continue
            word = int((words[0] if act["word"] == LANE else away)[act["slot"]])
            within = act["first"] <= word < act["first"] + act["count"]
            if not within and act["kind"] == GOES_ON and world.vehicles["away"][act["slot"]]:
                continue
            assert happened(world, act) == within or (within and can_be_hindered(world, act)), (test, act)
            seen[int(act["kind"]), within] = seen.get((int(act["kind"]), within), 0) + 1
    assert {(kind, True) for kind in (BEGINS, LOOKS_AWAY, GOES_ON)} <= set(seen), seen


def test_an_act_that_is_held_to_happens_and_else_does_not(careless: NddModel) -> None:
    run = setting(careless)
    scratch, kinds = allocate_scratch(SLOTS, run.who.policy), set()
    rng = np.random.default_rng(0)
    for test in range(300):
        world, survey = surveyed(run, test, 1 + test % 9)
        if world.state["outcome"][0] != RUNNING or survey.n_acts[0] == 0:
            continue
        k = int(rng.integers(survey.n_acts[0]))
        act = survey.acts[k].copy()
        rest = survey.acts[last_of(k, survey)].copy()
        for lets in (True, False):
            copy = copy_of(world)
            words = (act["first"], act["count"]) if lets else (rest["rest_first"], rest["rest_count"])
            hold_to(scratch.steering, act["slot"], act["word"], *words)
            advance(copy, run, scratch, keep_nothing(SLOTS), int(copy.state["decisions"][0]) + 1)
            let_go(scratch.steering, SLOTS)
            if lets:
                assert happened(copy, act) or can_be_hindered(copy, act)
            elif not (act["kind"] in (GOES_ON, BRAKES_LESS) and copy.vehicles["away"][act["slot"]]):
                assert not happened(copy, act)
        kinds.add(int(act["kind"]))
    assert {BEGINS, LOOKS_AWAY, BRAKES_LESS} <= kinds


def test_words_of_a_group_are_all_words(careless: NddModel) -> None:
    for test in range(100):
        _, survey = surveyed(setting(careless), test, 3)
        groups: dict[tuple[int, int], list[np.void]] = {}
        for act in survey.acts[: survey.n_acts[0]]:
            groups.setdefault((int(act["slot"]), int(act["word"])), []).append(act)
        for acts in groups.values():
            assert [act["is_last"] for act in acts] == [0] * (len(acts) - 1) + [1]
            parts = [(act["first"], act["count"]) for act in acts]
            parts = sorted([*parts, (acts[-1]["rest_first"], acts[-1]["rest_count"])])
            ends = [first + count for first, count in parts]
            assert [first for first, _ in parts] == [0, *ends[:-1]]
            assert ends[-1] == 2**32


# Means


@pytest.mark.parametrize("av", ["idm-mobil", "idm-mobil-blind"])
def test_a_network_that_knows_nothing_changes_no_rate(careless: NddModel, av: str) -> None:
    run = setting(careless, av)
    plain = simulate(run, SLOTS, seed=9, tests=30_000, threads=2)
    rate = plain.av_crashes / plain.tests
    error = np.sqrt(rate * (1.0 - rate) / plain.tests)
    for network in (untaught(1e-3), any_network(1)):
        found = trees(run, plan_of(network, 0.05), 2500)
        assert found.trees["lost"].sum() == 0
        for what, mean, off in (("ended", 1.0, 0.0), ("weight", rate, error)):
            weights = found.trees[what]
            assert fits(weights, mean, off), (what, weights.mean(), standard_error(weights), mean)
        assert SIGMAS * standard_error(found.trees["ended"]) < 0.25, "weights a quarter wrong would not be seen"


def test_without_windows_nothing_is_dropped(careless: NddModel) -> None:
    blind = Plan(1.0, 1e-9, -1.0, 0.01, 0, 30.0, 0.0, untaught(1e-9))
    found = trees(setting(careless), blind, 100)
    assert fits(found.trees["ended"], 1.0)
    assert (found.trees["seconds"] >= 10).mean() > 0.9


def test_trees_do_not_depend_on_threads_or_chunks(careless: NddModel) -> None:
    run, plan = setting(careless), plan_of(any_network(1), 0.05)
    whole = trees(run, plan, 600, threads=2, learning=True)
    alone = trees(run, plan, 600, threads=1)
    later = trees(run, plan, 100, first=333)
    assert whole.trees["crashes"].sum() > 100
    for name in whole.trees.dtype.names or ():
        assert np.array_equal(whole.trees[name], alone.trees[name])
        assert np.array_equal(whole.trees[name][333:433], later.trees[name])
    assert np.array_equal(whole.crashes, alone.crashes)
    assert np.array_equal(whole.actions, alone.actions)
    for crash, actions in zip(alone.crashes, alone.actions, strict=True):
        assert not actions[crash["begun"] :].any(), "what an earlier crash left in the row"


def test_weights_of_crashes_sum_up_to_those_of_their_trees(careless: NddModel) -> None:
    found = trees(setting(careless), plan_of(any_network(1), 0.05), 1000)
    assert found.crashes.size == found.trees["crashes"].sum() > 20
    sums = np.bincount(found.crashes["test"], weights=found.crashes["weight"], minlength=1000)
    assert sums == pytest.approx(found.trees["weight"])


def test_a_crash_of_a_tree_comes_again_from_its_actions(careless: NddModel) -> None:
    run = setting(careless)
    found = trees(run, plan_of(any_network(1), 0.05), 800)
    driver = ScriptDriver(run, ODD)
    for crash, actions in list(zip(found.crashes, found.actions, strict=True))[:60]:
        start = driver.start_of_test(4, int(crash["test"]))
        script = Script(np.arange(start.size, dtype=np.int16), start, actions[: crash["begun"], : start.size])
        ending = driver.drive(script)
        assert (ending.partner, ending.frame) == (crash["partner"], round(crash["time"] / 0.1))


def test_samples_say_what_followed(careless: NddModel) -> None:
    """What followed the first sample about a BV, times its weight, is the weight of the crashes with it."""
    run, slots, decisions = setting(careless), SLOTS, ODD_DECISIONS
    log, terminal = allocate_training_data(20_000, 400_000), allocate_terminal_states(2000, slots, decisions)
    pool, trees, checked = allocate_pool(400, slots, decisions), np.zeros(1, dtype=TREE), 0
    plan, scratch = plan_of(any_network(1), 0.02), allocate_scratch(slots, run.who.policy)
    for test in range(300):
        log.used[:], terminal.used[:] = 0, 0
        drive_tree_range(4, test, Population(plan, run, scratch, keep_nothing(slots), pool, terminal, log), trees)
        samples, moments = log.samples[: log.used[1]], log.moments[: log.used[0]]
        if not moments.size:
            continue
        before = samples["before"]
        later = np.flatnonzero(before >= 0)
        assert (before[later] < later).all()
        assert (samples["slot"][later] == samples["slot"][before[later]]).all()
        assert (samples["share"][later] > 0.0).all()
        followed = np.empty(samples.size)
        add_what_followed(log, followed)
        crashes = terminal.crashes[: terminal.used[0]]
        for p in range(moments["n"][0]):
            slot, total = samples["slot"][p], 0.0
            if (samples["slot"][(before < 0)] == slot).sum() == 1:  # seen without a break from the start on
                total = crashes["weight"][crashes["partner"] == slot].sum()
                assert followed[p] * moments["weight"][0] == pytest.approx(total)
                checked += total > 0.0
    assert checked > 5


def test_kept_samples_stand_for_all(careless: NddModel) -> None:
    found = trees(setting(careless), plan_of(any_network(1), 0.02), 400, learning=True)
    table = found.training
    assert table is not None
    assert np.isfinite(table.seen).all()
    assert (table.weight >= 1.0).all()
    assert (table.weight[table.followed > 0.0] == 1.0).all()
    assert 0 < (table.followed > 0.0).sum() < table.followed.size


def test_more_branches_than_random_words_are_told(careless: NddModel) -> None:
    assert MAX_BRANCH == 2**16 - 1
    greedy = Plan(1e-9, 1.0, -1.0, 1.0, 1, 30.0, 2.0, any_network(1))
    found = trees(setting(careless), greedy, 1)
    assert (found.trees["lost"] > 0).all()
    assert found.trees["seconds"] < 20 * MAX_BRANCH
