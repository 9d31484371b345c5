"""One contract over all doors: same seed, same controllers, same tests, whoever asks for them.

The reference is bulk simulation. Each door drives the same tests of the built-in AV `rl`, whose twin outside the loop
sees what every AV from outside sees, against every kind of BVs; what is compared is the digest over all outcomes, or,
where a door shows less, all that it shows.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from learned_twin import TwinOfMany
from sim.test_digests import random_policy

import cornerforge.ext.gym  # noqa: F401  registers the environments
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.worlds.drive_bv import Exploring, allocate_actors, collect, start_worlds
from cornerforge.adversary.worlds.rewards import reward_numbers
from cornerforge.drivers.policy import HEADS, NetworkShape, PolicyNumbers, best_action, q_values
from cornerforge.drivers.sight import VISIBLE
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.policy_file import Policy
from cornerforge.experiment.setting import experiment
from cornerforge.ext.gym.batch import AvBatch, BvBatch
from cornerforge.ext.gym.vector import AdversaryVectorEnv, DrivingVectorEnv
from cornerforge.library.harvester import Harvester
from cornerforge.sim.controllers import POLICY, TOLD
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.outcome import AV_CRASH, BV_CRASH, Outcomes, allocate_outcomes, write_outcome
from cornerforge.sim.recorder import Recorder, scenario_digest
from cornerforge.sim.runner import Tally, drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.scripted import Script, ScriptDriver
from cornerforge.sim.statistics import EVERYBODY, allocate_counts
from cornerforge.sim.world import world_of

SEED = 12
TESTS = 24


def policy(seed: int, *, bounded: bool = False, budget: float | None = None, head: str = "greedy") -> Policy:
    numbers = random_policy(seed)
    shape = NetworkShape(numbers.n_inputs, numbers.n_shared, numbers.n_stream, numbers.width)
    return Policy(numbers.weights, shape, bounded, {}, budget, head)


BVS: dict[str, Callable[[str], Experiment]] = {
    "natural": lambda av: experiment(av=av, takes_foreign=True),
    "idm": lambda av: experiment(av=av, bv="idm", takes_foreign=True),
    "swerve": lambda av: experiment(av=av, bv="swerve", takes_foreign=True),
    "uniform, bounded": lambda av: experiment(av=av, bv="uniform", bounded=True, takes_foreign=True),
    "policy": lambda av: experiment(av=av, policy=policy(1), takes_foreign=True),
    "policy with a budget": lambda av: experiment(
        av=av, policy=policy(2, bounded=True, budget=6.0), takes_foreign=True
    ),
    "softmax": lambda av: experiment(av=av, policy=policy(2), acting="softmax:0.3", takes_foreign=True),
    "drawing": lambda av: experiment(av=av, policy=policy(2, head="softmax"), takes_foreign=True),
    "mixture": lambda av: experiment(
        av=av,
        takes_foreign=True,
        policy=[policy(0), policy(1, bounded=True, head="softmax"), policy(2, bounded=True, budget=4.0)],
    ),
}
"""Runs by who drives the BVs, for an AV."""
EVERY = pytest.mark.parametrize("bvs", BVS)


def digest(out: Outcomes) -> str:
    tally = Tally()
    tally.add(out, allocate_counts())
    return tally.digest.hexdigest()


def bulk(run: Experiment) -> Outcomes:
    return drive_chunk(run.setting, run.slots, SEED, 0, TESTS, False)[0]


def bulk_by_motion(run: Experiment) -> Outcomes:
    """With a built-in AV that sees what AVs from outside are shown."""
    setting = run.setting._replace(av=run.setting.av._replace(sight=VISIBLE))
    return drive_chunk(setting, run.slots, SEED, 0, TESTS, False)[0]


@EVERY
def test_something_happens_that_doors_could_disagree_on(bvs: str) -> None:
    out = bulk(BVS[bvs]("rl"))
    assert len(set(out.distance.tolist())) == TESTS
    if "policy" in bvs or bvs in ("swerve", "softmax", "drawing", "mixture"):
        assert digest(out) != digest(bulk(BVS["natural"]("rl")))


def test_a_budget_changes_tests() -> None:
    """The negative control of what `Driving-v0` forgot: a door without the budget would be seen."""
    free = experiment(av="rl", policy=policy(2, bounded=True))
    assert digest(bulk(free)) != digest(bulk(BVS["policy with a budget"]("rl")))


@EVERY
def test_counting_changes_nothing(bvs: str) -> None:
    run = BVS[bvs]("rl")
    counted = drive_chunk(run.setting, run.slots, SEED, 0, TESTS, EVERYBODY)[0]
    assert digest(counted) == digest(bulk(run))


@EVERY
def test_the_recorder(bvs: str) -> None:
    run = BVS[bvs]("rl")
    recorder, out = Recorder(run.setting, run.odd), allocate_outcomes(TESTS)
    for test in range(TESTS):
        recorder.record(SEED, test)
        write_outcome(recorder._world, out, test, run.setting.road)
    assert digest(out) == digest(bulk(run))


@EVERY
def test_the_harvester(bvs: str) -> None:
    run = BVS[bvs]("rl")
    found = Harvester(run.setting, run.slots).harvest(SEED, 0, TESTS)
    assert digest(found.outcomes) == digest(bulk(run))


def test_a_script_of_a_recorded_test() -> None:
    run = BVS["natural"]("rl")
    recorder, scripts = Recorder(run.setting, run.odd), ScriptDriver(run.setting, run.odd)
    for test in range(TESTS):
        scenario = recorder.record(SEED, test)
        script = Script(scenario.slot, scripts.start_of_test(SEED, test), scenario.action)
        again, _ = scripts.record(script)
        assert scenario_digest(again) == scenario_digest(scenario)


def outcomes_of(batch: AvBatch | BvBatch) -> Outcomes:
    out = allocate_outcomes(batch.n)
    for b in range(batch.n):
        write_outcome(world_of(batch.worlds, b), out, b, batch.run.setting.road)
    return out


@EVERY
def test_worlds_of_an_agent_that_is_the_av(bvs: str) -> None:
    """`Driving-v0` lets an agent meet these BVs; the agent here is the twin of `rl`."""
    run = BVS[bvs]("idm-mobil")
    batch = AvBatch(run, TESTS, 2, 2, box=False)
    twin = TwinOfMany(run.odd, TESTS)
    for b in range(TESTS):
        batch.name(b, SEED, b, lambda: 0)
    batch.begin(np.ones(TESTS, dtype=np.bool_))
    while not batch.is_over.all():
        running = ~batch.is_over
        actions = np.zeros(TESTS, dtype=np.int64)
        for b in map(int, np.flatnonzero(running)):
            actions[b] = twin.action(b, batch.observation[b])
        batch.step(actions, running)
    assert digest(outcomes_of(batch)) == digest(bulk_by_motion(BVS[bvs]("rl")))


@pytest.fixture
def budgeted(tmp_path: Path) -> Path:
    """A policy file with a likelihood budget."""
    from cornerforge.experiment.policy_file import save_policy

    path = tmp_path / "budgeted.safetensors"
    save_policy(policy(2, bounded=True, budget=6.0), path)
    return path


def test_driving_single_and_vector(budgeted: Path) -> None:
    expected = bulk_by_motion(BVS["policy with a budget"]("rl"))
    env: Any = gymnasium.make("cornerforge/Driving-v0", bv=str(budgeted), scaled=False)
    for test in range(4):
        twin = TwinOfMany(BVS["natural"]("rl").odd, 1)
        seen, _ = env.reset(seed=SEED, options={"test": test})
        over = False
        while not over:
            seen, _, ended, cut, info = env.step(twin.action(0, seen))
            over = ended or cut
        assert round(info["time_s"] * 10) == expected.frame[test]
    vector: Any = DrivingVectorEnv(TESTS, bv=str(budgeted), scaled=False, autoreset_mode="Disabled")
    views, _ = vector.reset(seed=[SEED] * TESTS, options={"test": list(range(TESTS))})
    twins = TwinOfMany(BVS["natural"]("rl").odd, TESTS)
    frames = np.zeros(TESTS, dtype=np.int64)
    running = np.ones(TESTS, dtype=np.bool_)
    while running.any():
        actions = np.full(TESTS, 22)
        for b in map(int, np.flatnonzero(running)):
            actions[b] = twins.action(b, views[b])
        views, _, ended, cut, _ = vector.step(actions)
        frames[running] += 1
        running = running & ~np.asarray(ended | cut)
        if running.any() and not running.all():
            vector.reset(options={"reset_mask": ~running})
    np.testing.assert_array_equal(frames, expected.frame)


def greedy(numbers: PolicyNumbers, observation: np.ndarray, allowed: np.ndarray) -> int:
    s = allocate_scratch(1, numbers).choice
    q_values(numbers, np.ascontiguousarray(observation), s.layers, s.q)
    return int(best_action(s.q, np.ascontiguousarray(allowed)))


@pytest.mark.parametrize("bounded", [False, True])
def test_adversary_single_and_vector(bounded: bool) -> None:
    numbers = random_policy(1)
    run = experiment(av="rl", policy=policy(1, bounded=bounded))
    expected = bulk(run)
    env: Any = gymnasium.make("cornerforge/Adversary-v0", av="rl", bounded=bounded)
    for test in range(4):
        seen, info = env.reset(seed=SEED, options={"test": test})
        over = False
        while not over:
            seen, _, ended, cut, info = env.step(greedy(numbers, seen, info["action_mask"]))
            over = ended or cut
        assert round(info["time_s"] * 10) == expected.frame[test]
    vector: Any = AdversaryVectorEnv(TESTS, av="rl", bounded=bounded, autoreset_mode="Disabled")
    batch: BvBatch = vector._batch
    for b in range(TESTS):
        batch.name(b, SEED, b, lambda: 0)
    batch.begin(np.ones(TESTS, dtype=np.bool_))
    while not batch.is_over.all():
        running = ~batch.is_over
        pairs = zip(batch.observation, batch.allowed, strict=True)
        batch.step(np.array([greedy(numbers, seen, allowed) for seen, allowed in pairs]), running)
    assert digest(outcomes_of(batch)) == digest(expected)


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("bounded", [False, True])
def test_the_collector_of_training(bounded: bool, head: str) -> None:
    """It shows rewards and ends; a test's outcome and its length in decisions must be those of bulk simulation."""
    run = experiment(av="rl", policy=policy(1, bounded=bounded, head=head))
    expected = bulk(run)
    setting, numbers = run.setting.with_drivers(critical=TOLD), run.setting.who.policy
    actors = allocate_actors(TESTS, setting, run.slots, N_OBSERVATION)
    scratch, out = allocate_scratch(run.slots, numbers), allocate_transitions(TESTS)
    start_worlds(SEED, 0, setting, scratch, keep_nothing(run.slots), actors)
    exploring = Exploring(POLICY, numbers, 0.0, 0, 0.0)
    rewards, decisions = np.zeros(TESTS), np.zeros(TESTS, dtype=np.int64)
    running = np.ones(TESTS, dtype=np.bool_)
    while running.any():
        collect(TESTS, exploring, setting, reward_numbers("crash"), actors, scratch, keep_nothing(run.slots), out)
        rewards[running] += out.reward[running]
        decisions[running] += 1
        running &= ~out.end
    np.testing.assert_array_equal(decisions, expected.decisions)
    np.testing.assert_array_equal(rewards, 1.0 * (expected.code == AV_CRASH) - (expected.code == BV_CRASH))
    assert actors.finished["tests"][0] >= TESTS


@pytest.mark.full
@EVERY
def test_an_av_in_a_process_of_its_own(bvs: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tests = Path(__file__).parent
    (tmp_path / "twin_of_rl.py").write_text(
        f"import sys\nsys.path.insert(0, {str(tests)!r})\nfrom learned_twin import Twin\n", encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    run = BVS[bvs]("twin_of_rl:Twin")
    try:
        out, _ = run.drive(run.setting, run.slots, SEED, 0, TESTS, False)
        recorder, recorded = run.recorder(), allocate_outcomes(4)
        for test in range(4):
            recorder.record(SEED, test)
            write_outcome(recorder._world, recorded, test, run.setting.road)
    finally:
        run.rest()
    expected = bulk_by_motion(BVS[bvs]("rl"))
    assert digest(out) == digest(expected)
    assert digest(recorded) == digest(Outcomes._make(column[:4] for column in expected))
