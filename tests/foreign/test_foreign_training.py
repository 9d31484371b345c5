"""Training against an AV from outside: as against the same AV inside; stops and faults change nothing else."""

from __future__ import annotations

import functools
import importlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from foreign.opened_av import opened

import cornerforge
import cornerforge.ext.gym
from cornerforge.adversary import ppo
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import PRESETS, TrainConfig
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.train import TRAINING_TESTS, CurvePoint, TrainResult, train_adversary
from cornerforge.adversary.verdicts import verdict_of
from cornerforge.adversary.worlds.collector import ForeignCollector, Group
from cornerforge.adversary.worlds.drive_bv import Exploring, allocate_actors, start_worlds
from cornerforge.adversary.worlds.rewards import reward_numbers
from cornerforge.cli import main
from cornerforge.errors import AvFaultError, OutputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.policy_file import load_policy
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.driver import MAX_FAULTS, Fault, ForeignAv
from cornerforge.foreign.session import seeds_of
from cornerforge.results.rates import Yield
from cornerforge.sim import controllers, observe
from cornerforge.sim.controllers import UNIFORM
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import VEHICLE
from cornerforge.types import Odd
from cornerforge.verbs.train import evaluate

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("in_memory")]

TINY = replace(
    PRESETS["fast"], width=16, batch=32, replay_size=2048, replay_start=256, worlds=64, decisions_per_update=16,
    target_update=10, epsilon_decisions=2000, decisions=3000,
)  # fmt: skip
LONG = replace(TINY, decisions=64 * 100)
"""Points of its curve at 50 and 100 iterations."""
FEW = replace(TINY, worlds=16, decisions=16 * 6, decisions_per_update=16)
ODD = Odd()


@functools.cache
def world(av: str) -> Experiment:
    return experiment(av=av, bv="uniform")


@functools.cache
def inside(reward: str) -> TrainResult:
    run = world("rl")
    return train_adversary(run.setting, run.slots, replace(TINY, reward=reward), verdict=verdict_of(reward, run))


def outside(
    av: ForeignAv, like: str, config: TrainConfig = TINY, *, seed: int = 0, threads: int = 2,
    checkpoint: CheckpointFile | None = None, progress: Callable[[CurvePoint], None] | None = None,
    run: Experiment | None = None,
) -> TrainResult:  # fmt: skip
    """Train against an AV from outside whose tests start as those of the built-in AV `like`."""
    run = run or world(like)
    setting = run.setting.with_drivers(av=controllers.OUTSIDE)
    try:
        return train_adversary(
            setting, run.slots, config, av=av, verdict=verdict_of(config.reward, run), seed=seed, threads=threads,
            checkpoint=checkpoint, progress=progress,
        )  # fmt: skip
    finally:
        av.close()


def timeless(result: TrainResult) -> list[CurvePoint]:
    return [replace(point, seconds=0.0) for point in result.curve]


def assert_same(result: TrainResult, expected: TrainResult) -> None:
    assert result.weights.tobytes() == expected.weights.tobytes()
    assert timeless(result) == timeless(expected)


# --- the same as inside ---


@pytest.mark.usefixtures("twins")
@pytest.mark.parametrize("reward", ["crash", "avoidable", "preventable"])
@pytest.mark.parametrize(("batch", "threads"), [pytest.param(256, 2, marks=pytest.mark.slow), (24, 2), (24, 1)])
def test_the_weights_are_those_of_the_same_av_inside(reward: str, batch: int, threads: int) -> None:
    """`rl` decides every half second, so a world that was given the wrong seat would be out of step."""
    av = opened("twins:Twin", ODD, batch=batch)
    assert_same(outside(av, "rl", replace(TINY, reward=reward), threads=threads), inside(reward))
    assert av.faults == {}


@pytest.mark.usefixtures("twins")
def test_the_weights_are_those_of_the_same_av_inside_where_actions_are_drawn() -> None:
    config = replace(ppo.PRESETS["fast"], width=16, batch=256, worlds=64, rollout=8, decisions=3000)
    run = world("rl")
    found = outside(opened("twins:Twin", ODD, batch=24), "rl", config)
    assert_same(found, train_adversary(run.setting, run.slots, config))
    assert found.updates > 0


@pytest.mark.usefixtures("twins")
def test_the_weights_are_those_of_the_same_av_inside_where_the_adversary_steers_later() -> None:
    """In the first seconds the AV is asked in worlds that no transition is made of."""
    run = world("rl")
    later = replace(run, setting=run.setting.with_drivers(steers_from=3, bounded=1, budget=9_000_001))
    av = opened("twins:Twin", ODD, batch=24)
    found = outside(av, "rl", FEW, run=later)
    assert_same(found, train_adversary(later.setting, later.slots, FEW))
    assert av.faults == {}


@pytest.mark.usefixtures("twins")
def test_negative_control_another_av_gives_other_weights() -> None:
    found = outside(opened("twins:Dice", ODD), "rl")
    assert found.weights.tobytes() != inside("crash").weights.tobytes()


@pytest.mark.usefixtures("twins")
@pytest.mark.parametrize(("bv", "tests"), [pytest.param("swerve", 300, marks=pytest.mark.processes), ("uniform", 1000)])
def test_the_yield_is_that_of_the_same_av_inside(bv: str, tests: int) -> None:
    """Strikes and avoidable crashes are judged by the AV's stored answers."""
    built_in, foreign = (experiment(av=av, bv=bv, takes_foreign=True) for av in ("rl", "twins:Twin"))
    foreign = replace(foreign, setting=built_in.setting.with_drivers(av=controllers.OUTSIDE))
    expected, found = (evaluate(run, tests=tests, seed=4, reward="own-fault", threads=2) for run in (built_in, foreign))
    assert isinstance(found, Yield)
    assert found == expected
    assert found.avoidable_per_test is not None
    assert 0.0 < found.avoidable_per_test < found.crashes_per_test
    assert bv != "uniform" or found.striking_share


def test_a_yield_counts_the_tests_that_the_av_did_not_spoil(avs: Path) -> None:  # noqa: ARG001
    run = experiment(av="avs:Nan", bv="swerve", takes_foreign=True)
    found = evaluate(run, tests=200, seed=4)
    assert found.tests == 200 - len(run.faults) < 200
    assert found.avoidable_per_test is not None
    assert found.avoidable_per_test * found.tests == pytest.approx(round(found.avoidable_per_test * found.tests))


# --- stops ---


@pytest.fixture
def stopped(tmp_path: Path, twins: None) -> CheckpointFile:  # noqa: ARG001
    """The checkpoint of a training that was stopped amid its tests."""

    def stop(point: CurvePoint) -> None:
        if point.decisions == 3200:
            raise KeyboardInterrupt

    checkpoint = CheckpointFile(tmp_path / "p.checkpoint", {"av": "twin"})
    with pytest.raises(KeyboardInterrupt):
        outside(opened("twins:Twin", ODD), "rl", LONG, checkpoint=checkpoint, progress=stop)
    return checkpoint


@functools.cache
def unbroken() -> TrainResult:
    run = world("rl")
    return train_adversary(run.setting, run.slots, LONG)


def test_a_stopped_training_goes_on_to_the_same_weights(stopped: CheckpointFile) -> None:
    """In a batch of another size, too: seats are no part of the state."""
    assert_same(outside(opened("twins:Twin", ODD, batch=24), "rl", LONG, checkpoint=stopped), unbroken())


def test_negative_control_the_av_must_be_shown_again_what_it_saw(
    stopped: CheckpointFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without it the twin does not know when it decided last."""
    monkeypatch.setattr(Group, "_show_again", lambda *_: None)
    found = outside(opened("twins:Twin", ODD), "rl", LONG, checkpoint=stopped)
    assert found.weights.tobytes() != unbroken().weights.tobytes()


@pytest.mark.slow
def test_faults_before_a_stop_are_not_forgotten(avs: Path, tmp_path: Path) -> None:  # noqa: ARG001
    def stop(point: CurvePoint) -> None:
        if point.decisions == 3200:
            raise KeyboardInterrupt

    whole = opened("avs:Raises", ODD)
    expected = outside(whole, "idm-mobil", LONG)
    checkpoint = CheckpointFile(tmp_path / "p.checkpoint", {})
    first, second = opened("avs:Raises", ODD), opened("avs:Raises", ODD)
    with pytest.raises(KeyboardInterrupt):
        outside(first, "idm-mobil", LONG, checkpoint=checkpoint, progress=stop)
    assert 0 < len(first.faults) < len(whole.faults)
    assert_same(outside(second, "idm-mobil", LONG, checkpoint=checkpoint), expected)
    assert second.faults.keys() == whole.faults.keys()


def test_what_is_shown_again_ends_where_the_worlds_are(avs: Path) -> None:  # noqa: ARG001
    """Amid their tests, each after another number of seconds, the worlds driven again are the worlds."""
    run = world("idm-mobil")
    av = opened("avs:Counts", ODD, batch=16)
    setting = run.setting.with_drivers(av=controllers.OUTSIDE, critical=controllers.TOLD)
    actors = allocate_actors(16, setting, run.slots, observe.N_OBSERVATION)
    start_worlds(3, 0, setting, allocate_scratch(run.slots, setting.who.policy), keep_nothing(run.slots), actors)
    collector = ForeignCollector(av, setting, run.slots, actors, 1)
    exploring = Exploring(UNIFORM, setting.who.policy, 0.0, 0, 0.0)
    for _ in range(20):
        collector.collect(exploring, reward_numbers("crash"), allocate_transitions(16))
    (group,) = collector._groups
    group._show_again(np.arange(16))
    assert len(set(actors.history.answered.tolist())) > 2
    assert group._again is not None
    begun = np.flatnonzero(actors.history.answered)
    again, ours = group._again.vehicles[begun], actors.worlds.vehicles[begun]
    there = ours["present"] == 1
    assert np.array_equal(again["present"] == 1, there)
    for name in set(VEHICLE.names or ()) - {"c0", "c1", "c2", "c3", "c4", "c5"}:  # which mean nothing outside a change
        assert np.array_equal(again[name][there], ours[name][there]), name
    collector.close()
    av.close()


# --- faults ---


def expected_faults(av: ForeignAv, one_in: int, seed: int = 0) -> bool:
    """Are the faults those tests whose seeds say so?"""
    tests = np.array([test for _, test in av.faults], dtype=np.int64)
    return bool((seeds_of(seed, tests) % one_in == 0).all() and (tests >= TRAINING_TESTS).all())


@pytest.mark.parametrize(
    ("name", "one_in", "what"),
    [("Raises", 61, "raised"), pytest.param("Exits", 97, "ended", marks=pytest.mark.slow), ("Nan", 40, "answer")],
)
def test_a_fault_costs_its_own_test_in_any_batch(avs: Path, name: str, one_in: int, what: str) -> None:  # noqa: ARG001
    many, few = (opened(f"avs:{name}", ODD, batch=batch) for batch in (256, 24))
    results = [outside(av, "idm-mobil") for av in (many, few)]
    assert_same(*results)
    assert many.faults == few.faults
    assert 1 <= len(many.faults) < MAX_FAULTS
    assert expected_faults(many, one_in)
    assert {fault.what for fault in many.faults.values()} == {what}
    good = outside(opened("avs:Good", ODD), "idm-mobil")
    assert good.weights.tobytes() != results[0].weights.tobytes(), "the faults were not met"


def test_a_hang_costs_its_own_test(avs: Path) -> None:  # noqa: ARG001
    first = TRAINING_TESTS + np.arange(16)
    seed = next(seed for seed in range(1000) if (seeds_of(seed, first) % 97 == 0).sum() == 1)
    av = opened("avs:Hangs", ODD, timeout=0.5)
    outside(av, "idm-mobil", FEW, seed=seed)
    assert [fault.what for fault in av.faults.values()] == ["hung"]
    assert expected_faults(av, 97, seed)


def test_an_av_that_fails_once_costs_no_test(avs: Path) -> None:  # noqa: ARG001
    flaky = opened("avs:Flaky", ODD)
    assert_same(outside(flaky, "idm-mobil"), outside(opened("avs:Good", ODD), "idm-mobil"))
    assert Path("once").exists()
    assert flaky.faults == {}


def test_an_av_that_only_fails_for_many_worlds_together_ends_the_training(avs: Path) -> None:
    source = """
class Crowded(Base):
    def act(self, view):
        if view[:, 0, 0].sum() > 5 and (view[:, 0, 1] < 300.0).any():
            raise ValueError('too many')
        return self.good(view)
"""
    with (avs / "avs.py").open("a", encoding="utf-8") as file:
        file.write(source)
    with pytest.raises(AvFaultError, match=r"raised ValueError\(too many\).*for 16 worlds together and for none alone"):
        outside(opened("avs:Crowded", ODD), "idm-mobil", FEW)


def test_too_many_faults_end_the_training(avs: Path) -> None:  # noqa: ARG001
    av = opened("avs:AlwaysRaises", ODD)
    with pytest.raises(AvFaultError, match=r"AlwaysRaises spoiled 2\d tests .* it raised ValueError\(always\)"):
        outside(av, "idm-mobil")
    assert all(isinstance(fault, Fault) for fault in av.faults.values())


# --- through the doors ---

RARELY = """
class Rarely(Base):
    def act(self, view):
        if self.struck(view, 499).any(): raise ValueError('on purpose')
        return self.good(view)
"""


@pytest.fixture
def rarely(avs: Path) -> str:
    """An AV that fails in one test of 499."""
    with (avs / "avs.py").open("a", encoding="utf-8") as file:
        file.write(RARELY)
    return "avs:Rarely"


def test_train_takes_it_and_says_what_it_spoiled(rarely: str, capsys: pytest.CaptureFixture[str]) -> None:
    said: dict[str, Any] = {"av": rarely, "decisions": 20_000, "tests": 100, "seed": 2}
    trained = cornerforge.train(out="p.safetensors", **said)
    assert 0 < trained.av_faults < MAX_FAULTS
    kept = cornerforge.train(out="p.safetensors", resume=True, **said)
    assert (kept.kept, kept.policy_hash) == (True, trained.policy_hash)
    assert {b.name for b in trained.baselines} >= {"nobody", "swerve", "swerve, bounded"}
    assert load_policy(Path("p.safetensors")).about["av_hash"] == opened(rarely, ODD).hash
    arguments = [f"--{name}={value}" for name, value in said.items()]
    assert main(["train", "--out", "again.safetensors", *arguments]) == 0
    assert f"{trained.av_faults} training tests abandoned, because the AV raised" in capsys.readouterr().out
    assert Path("again.safetensors").read_bytes() == Path("p.safetensors").read_bytes()
    with Path("avs.py").open("a", encoding="utf-8") as file:
        file.write("# another AV\n")
    with pytest.raises(OutputError, match="another av_hash"):
        cornerforge.train(out="p.safetensors", resume=True, **said)


@pytest.mark.usefixtures("avs")
def test_the_whole_job_ends_in_a_page(monkeypatch: pytest.MonkeyPatch) -> None:
    efforts = importlib.import_module("cornerforge.verbs.run").EFFORTS
    tiny = replace(
        efforts["quick"], nde_tests=300, natural_tests=300, decisions=20_000, evaluation_tests=100, exposure_tests=60,
        cases=12,
    )  # fmt: skip
    monkeypatch.setitem(efforts, "quick", tiny)
    done = cornerforge.run(effort="quick", out="out", seed=2, av="avs:Good")
    assert (done.av, done.generate.cases, done.train.tests, done.train.av_faults) == ("avs:Good", 12, 100, 0)
    assert done.nde.tests == 300
    exposure = json.loads(Path("out/exposure.json").read_text(encoding="utf-8"))
    assert sum(exposure["quantities"]["bbd_front"]["adversary"]) > 0
    assert "avs:Good" in Path("out/report.html").read_text(encoding="utf-8")
    again = cornerforge.run(effort="quick", out="out", seed=2, av="avs:Good", resume=True)
    assert replace(again, seconds=0.0) == replace(done, seconds=0.0)


@pytest.mark.slow
@pytest.mark.usefixtures("twins")
def test_plausibility_and_variety_take_it(monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("cornerforge.ext.studies.plausibility")
    monkeypatch.setattr(module, "_NATURAL_TESTS", 10)
    small: dict[str, Any] = {"budgets": (5.0,), "seeds": 1, "decisions": 600, "tests": 60}
    found = cornerforge.plausibility(out="foreign", av="twins:Twin", **small)
    assert [(row.budget, row.bounded) for row in found.rows] == [(5.0, True), (None, True), (None, False)]
    assert found.natural.log_prob_per_decision < 0.0 < found.natural.shortfall_per_test
    varied = cornerforge.variety(policies=["foreign/unbounded-0.safetensors"], av="twins:Twin", tests=60)
    assert [row.tests for row in varied.rows] == [60, 60]


# --- Adversary-v0 ---


def _driven(av: str, mode: str, steps: int = 250, reward: str = "avoidable") -> tuple[list[Any], ...]:
    """What an adversary that draws at random sees and gets in 6 worlds, and how its tests end."""
    many: Any = gymnasium.make_vec(
        "cornerforge/Adversary-v0", num_envs=6, av=av, reward=reward, autoreset_mode=mode, threads=1
    )
    rng = np.random.default_rng(3)
    seen, paid, ends = [many.reset(seed=5)[0].tobytes()], [], []
    for _ in range(steps):
        observation, given, terminated, truncated, info = many.step(rng.integers(0, 33, 6))
        seen.append(observation.tobytes())
        paid.append(given.tolist())
        if (terminated | truncated).any():
            told = info if "outcome" in info else info["final_info"]
            ends.append([(told["outcome"][b], told["case"][b]) for b in np.flatnonzero(terminated | truncated)])
    many.close()
    return seen, paid, ends


@pytest.mark.usefixtures("twins")
@pytest.mark.parametrize(
    ("mode", "reward"), [("NextStep", "avoidable"), ("SameStep", "avoidable"), ("SameStep", "preventable:rss-brake")]
)
def test_an_agent_sees_and_gets_the_same_from_the_same_av_outside(mode: str, reward: str) -> None:
    """In mode NextStep a world that begins anew stands still while the others go on: the AV must not lose its step."""
    expected, found = (_driven(av, mode, reward=reward) for av in ("rl", "twins:Twin"))
    assert found == expected
    assert len(expected[2]) > 10
    assert any(any(row) for row in expected[1])


def test_a_fault_of_the_av_cuts_off_its_test_only(avs: Path) -> None:  # noqa: ARG001
    _, _, ends = _driven("avs:Raises", "SameStep", 1_200)
    outcomes = [outcome for step in ends for outcome, _ in step]
    assert 0 < outcomes.count("av-fault") < 10
    assert len(outcomes) > 20 * outcomes.count("av-fault")
