"""Rewards that are given case by case: the same crash has the same verdict everywhere, and in an analysis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import cornerforge
from cornerforge.adversary.config import PRESETS
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.train import train_adversary
from cornerforge.adversary.verdicts import judge_by_case, verdict_of
from cornerforge.adversary.worlds.crash_cases import CrashCases, Verdict
from cornerforge.adversary.worlds.drive_bv import Exploring, allocate_actors, collect, start_worlds
from cornerforge.adversary.worlds.rewards import reward_numbers
from cornerforge.drivers.careful import CAREFUL
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.errors import InputError
from cornerforge.experiment.setting import experiment
from cornerforge.library import CaseLibrary
from cornerforge.recordings import Recordings, recordings_of_tracks
from cornerforge.sim import allocate_scratch, controllers, keep_nothing, observe
from cornerforge.verbs.train import evaluate

SEED = 3
CASES = 300
BY_CASE = [*(f"preventable:{driver}" for driver in CAREFUL), "preventable-by-braking:fsm", "own-fault", "own-doing"]


@pytest.fixture(scope="module", params=[("idm-mobil", "default"), ("rl", "mixed")], ids=lambda world: "-".join(world))
def library(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """A few hundred crashes of an AV with `swerve`, and what `analyse` says of each."""
    world = dict(zip(("av", "odd"), request.param, strict=True))
    folder = tmp_path_factory.mktemp("verdicts")
    cornerforge.generate(out=folder / "lib", cases=CASES, policy="swerve", seed=SEED, threads=1, **world)
    cornerforge.analyse(folder / "lib", out=folder / "analysis", avoidability="none", threads=1)
    return world, folder


def analysed(folder: Path, reward: str) -> dict[int, tuple[bool, bool]]:
    """What a reward should pay for, and by the stricter reading, by test, as the analysis of the library has it."""
    rows = pq.read_table(folder / "analysis" / "cases.parquet").to_pylist()
    assert len(rows) == CASES
    _, _, driver = reward.partition(":")

    def paid(row: dict[str, Any]) -> tuple[bool, bool]:
        if reward == "own-doing":
            return row["conduct"] != "none", row["conduct"] != "none" and row["prevented_by"] != "nobody"
        if not driver:
            return row["fault"] in ("av", "both"), row["fault"] == "av"
        prevented = driver in str(row["prevented_by"]).split(", ")
        by_braking = prevented and not row["held_speed_prevents"]
        return by_braking if reward.startswith("preventable-by-braking") else prevented, by_braking

    return {int(row["case_id"].partition(":")[2]): paid(row) for row in rows}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("reward", BY_CASE)
def test_a_crash_is_paid_for_as_an_analysis_says(reward: str, library: tuple[dict[str, Any], Path]) -> None:
    world, folder = library
    expected = analysed(folder, reward)
    found = judge_by_case(experiment(bv="swerve", **world), SEED, list(expected), reward, 1)
    assert found is not None
    pairs = list(zip(found.paid.tolist(), found.strictly.tolist(), strict=True))
    assert pairs == list(expected.values())
    assert reward == "own-doing" or any(paid for paid, _ in pairs), "nothing would be learnt from these cases"
    assert not all(paid for paid, _ in pairs)


def test_a_learners_crashes_are_the_cases_of_the_library(library: tuple[dict[str, Any], Path]) -> None:
    """To the bit: what the worlds of a learner give a judge, and what a library gives back; and the rewards follow."""
    world, folder = library
    run = experiment(bv="swerve", **world)
    judge = verdict_of("own-fault", run)
    assert judge is not None
    judged: dict[str, Recordings] = {}

    def verdict(recordings: Recordings) -> np.ndarray:
        for case in Recordings(*(np.array(column) for column in recordings)).blocks(1):
            judged[case.case_ids[0]] = case
        return judge(recordings)

    setting, n = run.setting.with_drivers(critical=controllers.TOLD), 24
    exploring = Exploring(controllers.ADVERSARIES["swerve"], NO_POLICY, 0.0, 0, 0.0)
    actors, out = allocate_actors(n, setting, run.slots, observe.N_OBSERVATION), allocate_transitions(n)
    scratch, nothing = allocate_scratch(run.slots, NO_POLICY), keep_nothing(run.slots)
    cases = CrashCases(setting, run.slots, verdict)
    start_worlds(SEED, 0, setting, scratch, nothing, actors)
    paid: set[int] = set()
    for _ in range(120):
        before = actors.worlds.state["test"][:, 0].copy()
        collect(n, exploring, setting, reward_numbers("own-fault"), actors, scratch, nothing, out)
        assert out.reward.max() <= 0.0
        paid |= set(before[cases.judge(actors.worlds, actors.history)].tolist())
        assert (actors.history.crashed == -1).all()

    [(rows, tracks)] = CaseLibrary.open(folder / "lib").shards()
    stored = {case.case_ids[0]: case for case in recordings_of_tracks(rows, tracks).blocks(1)}
    both = stored.keys() & judged.keys()
    assert len(both) > 30
    for name in both:
        for column in Recordings._fields:
            np.testing.assert_array_equal(getattr(judged[name], column), getattr(stored[name], column), err_msg=column)
    tests = {int(name.partition(":")[2]) for name in both}
    assert paid & tests == {test for test, (is_paid, _) in analysed(folder, "own-fault").items() if is_paid} & tests


@pytest.mark.full
def test_a_training_pays_by_verdict() -> None:
    """Tests of the curve are paid if the judge says so; one that never pays leaves the learner nothing but -1 and 0."""
    run = experiment(bv="uniform")
    config = replace(
        PRESETS["fast"], reward="preventable:fsm", worlds=64, decisions=64 * 250, decisions_per_update=64,
        replay_start=64 * 250, epsilon_end=1.0, guided=0.0,
    )  # fmt: skip
    said: list[bool] = []

    def every_second(recordings: Recordings) -> np.ndarray:
        said.extend((recordings.test % 2 == 0).tolist())
        return np.asarray(recordings.test % 2 == 0)

    def paid(verdict: Verdict, threads: int) -> float:
        result = train_adversary(run.setting, run.slots, config, verdict=verdict, threads=threads)
        return sum(point.tests * (point.paid_per_test or 0.0) for point in result.curve)

    assert paid(every_second, 1) == pytest.approx(sum(said))
    assert 0 < sum(said) < len(said)
    assert paid(every_second, 2) == pytest.approx(sum(said) / 2)
    assert paid(lambda recordings: np.zeros(recordings.n_cases, np.bool_), 1) == 0.0
    with pytest.raises(InputError, match="needs it; got preventable:fsm"):
        train_adversary(run.setting, run.slots, config)


def test_a_yield_counts_what_is_paid_for() -> None:
    run = experiment(bv="swerve")
    found = evaluate(run, tests=400, seed=SEED, reward="preventable:fsm", threads=2)
    assert found == evaluate(run, tests=400, seed=SEED, reward="preventable:fsm", threads=1)
    assert found.paid_per_test is not None
    assert found.paid_interval95 is not None
    assert found.strictly_paid_per_test is not None
    assert 0.0 < found.strictly_paid_per_test < found.paid_per_test < found.crashes_per_test
    assert found.paid_interval95[0] < found.paid_per_test < found.paid_interval95[1]
    by_kernels = evaluate(run, tests=400, seed=SEED, reward="avoidable", threads=2)
    assert by_kernels.paid_per_test is None
    assert by_kernels.crashes_per_test == found.crashes_per_test


@pytest.mark.full
@pytest.mark.parametrize("bounded", [False, True])
def test_train_says_what_was_paid_for(bounded: bool, tmp_path: Path) -> None:
    found = cornerforge.train(
        out=tmp_path / "p.safetensors", reward="own-fault", decisions=20_480, tests=1_000, bounded=bounded, threads=1
    )
    assert found.reward == "own-fault"
    assert found.paid_per_test is not None
    swerve = {one.name: one for one in found.baselines}["swerve"]
    assert swerve.paid_per_test is not None
    assert 0.0 < swerve.paid_per_test < swerve.crashes_per_test
