from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge.drivers.avs import AVS
from cornerforge.drivers.policy import NetworkShape, PolicyNumbers, n_weights
from cornerforge.errors import InputError
from cornerforge.ndd.model import NddModel
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.outcome import AV_CRASH, Outcomes
from cornerforge.sim.recorder import Recorder, scenario_digest
from cornerforge.sim.runner import crashed_tests, simulate, simulate_chunks
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import n_slots
from cornerforge.types import ODDS

ODD = replace(WIDE, n_lanes=3)
SLOTS = n_slots(ODD)
TESTS = 150


def random_policy() -> PolicyNumbers:
    shape = NetworkShape(N_OBSERVATION, 2, 1, 32)
    weights = np.random.default_rng(0).normal(0.0, 0.3, n_weights(shape)).astype(np.float32)
    return PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)


@pytest.fixture(scope="module", params=["nobody", "uniform", "policy", "bounded policy"])
def setting(request: pytest.FixtureRequest, reckless: NddModel) -> Setting:
    kind = request.param.removeprefix("bounded ")
    return setting_of(reckless, ODD, adversary=kind, bounded=request.param != kind, policy=random_policy())


def outcomes(
    setting: Setting, *, seed: int = 7, first: int = 100, tests: int = TESTS, threads: int = 1, chunk: int = 512
) -> Outcomes:
    chunks = simulate_chunks(setting, SLOTS, seed=seed, first=first, tests=tests, threads=threads, chunk=chunk)
    parts = [out for _, out, _ in chunks]
    return Outcomes._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def assert_equal(a: Outcomes, b: Outcomes) -> None:
    for left, right in zip(a, b, strict=True):
        np.testing.assert_array_equal(left, right)


@pytest.mark.sampled(1)
def test_threads_and_chunks_do_not_matter(setting: Setting) -> None:
    alone = outcomes(setting)
    assert np.unique(alone.distance).size > 20
    for threads, chunk in ((2, 512), (3, 16), (1, 1), (2, 7)):
        assert_equal(outcomes(setting, threads=threads, chunk=chunk), alone)


def test_a_test_alone_is_as_within_a_batch(setting: Setting) -> None:
    batch = outcomes(setting)
    for k in (0, 1, 17, TESTS - 1):
        alone = outcomes(setting, first=100 + k, tests=1)
        assert_equal(alone, Outcomes._make(column[k : k + 1] for column in batch))


def test_a_recording_ends_as_the_bulk_run_does(setting: Setting) -> None:
    batch = outcomes(setting, tests=20)
    recorder = Recorder(setting, ODD)
    for k in range(20):
        scenario = recorder.record(7, 100 + k)
        assert scenario.x.shape[0] == batch.frame[k] + 1
        assert scenario.x[-1, 0] - ODD.av_start == batch.distance[k]
        assert scenario.action.shape[0] == batch.decisions[k]
        crashed = scenario.crash is not None and scenario.crash.slot_a == 0
        assert crashed == (batch.code[k] == AV_CRASH)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("odd", ["default", "swift", "paper"])
@pytest.mark.parametrize("av", ["idm-mobil", "idm-mobil-blind", "idm-mobil-watchful", "rss-cautious"])
@pytest.mark.parametrize("adversary", [None, "lane-changer", "swerve"])
def test_moving_only_who_matters_changes_nothing(odd: str, av: str, adversary: str | None, reckless: NddModel) -> None:
    """A recording moves everybody in every substep, a bulk run only who may touch somebody or be looked at."""
    road = ODDS[odd]
    setting = setting_of(reckless, road, av=AVS[av], adversary=adversary)
    recorder = Recorder(setting, road)
    ((_, bulk, _),) = simulate_chunks(setting, n_slots(road), seed=8, first=0, tests=300, threads=1, chunk=300)
    for test in range(300):
        scenario = recorder.record(8, test)
        assert len(scenario.x) - 1 == bulk.frame[test], test
        assert scenario.x[-1, 0] - road.av_start == bulk.distance[test], test
        contact = (0, 0) if scenario.crash is None else (scenario.crash.slot_a, scenario.crash.slot_b)
        assert contact == (bulk.slot_a[test], bulk.slot_b[test]), test


def test_seeds_and_tests_differ(setting: Setting) -> None:
    runs = [outcomes(setting, tests=30), outcomes(setting, tests=30, seed=8), outcomes(setting, tests=30, first=130)]
    assert len({run.distance.tobytes() for run in runs}) == 3


def test_the_digest_is_of_the_outcomes(setting: Setting) -> None:
    digests = [
        simulate(setting, SLOTS, seed=7, tests=TESTS, threads=threads).digest.hexdigest() for threads in (1, 2, 3)
    ]
    assert len(set(digests)) == 1
    assert simulate(setting, SLOTS, seed=8, tests=TESTS).digest.hexdigest() != digests[0]
    assert simulate(setting, SLOTS, seed=7, tests=TESTS - 1).digest.hexdigest() != digests[0]


def test_counting_changes_nothing_and_adds_up(setting: Setting) -> None:
    plain, counted = (simulate(setting, SLOTS, seed=7, tests=60, counting=counting) for counting in (False, True))
    assert counted.digest.hexdigest() == plain.digest.hexdigest()
    assert not plain.counts.histograms.any()
    halves = [simulate(setting, SLOTS, seed=7, first=first, tests=30, counting=True) for first in (0, 30)]
    np.testing.assert_array_equal(halves[0].counts.histograms + halves[1].counts.histograms, counted.counts.histograms)
    np.testing.assert_array_equal(halves[0].counts.totals + halves[1].counts.totals, counted.counts.totals)
    assert halves[0].millimetres + halves[1].millimetres == counted.millimetres


def test_sums(setting: Setting) -> None:
    out = outcomes(setting, first=0)
    tally = simulate(setting, SLOTS, seed=7, tests=TESTS)
    assert tally.tests == TESTS
    assert tally.av_crashes == len(crashed_tests(0, out)) == int((out.code == AV_CRASH).sum())
    assert tally.bv_crashes == int(out.bv_crashes.sum())
    assert tally.decisions == int(out.decisions.sum())
    assert tally.miles == pytest.approx(out.distance.sum() / 1609.344, abs=1e-6 * TESTS)


def test_progress_counts_up(reckless: NddModel) -> None:
    seen: list[int] = []
    simulate(setting_of(reckless, ODD), SLOTS, seed=1, tests=1300, progress=seen.append)
    assert seen == [512, 1024, 1300]


def test_a_run_may_be_left_early(reckless: NddModel) -> None:
    chunks = simulate_chunks(setting_of(reckless, ODD), SLOTS, seed=1, first=0, tests=10**9, threads=2, chunk=4)
    assert [next(chunks)[0] for _ in range(3)] == [0, 4, 8]
    chunks.close()


@pytest.mark.parametrize(
    "arguments",
    [{"seed": -1}, {"seed": 2**63}, {"tests": 0}, {"tests": 1.5}, {"threads": 0}, {"first": -1}, {"first": 2**62 + 1}],
)
def test_numbers_out_of_range_are_refused(reckless: NddModel, arguments: dict[str, int]) -> None:
    with pytest.raises(InputError, match=next(iter(arguments))):
        simulate(setting_of(reckless, ODD), SLOTS, **{"seed": 1, "tests": 1, **arguments})  # type: ignore[arg-type]


# Recordings


def test_a_recording_is_repeatable_and_leaves_no_trace(setting: Setting) -> None:
    recorder = Recorder(setting, ODD)
    first = scenario_digest(recorder.record(3, 4))
    recorder.record(3, 5)
    assert scenario_digest(recorder.record(3, 4)) == first
    assert scenario_digest(Recorder(setting, ODD).record(3, 4)) == first
    assert scenario_digest(recorder.record(3, 5)) != first
    assert scenario_digest(recorder.record(2, 4)) != first


def test_the_digest_sees_every_number_but_not_what_is_absent(reckless: NddModel) -> None:
    recorder = Recorder(setting_of(reckless, ODD, adversary="uniform"), ODD)
    scenario = recorder.record(3, 4)
    digest = scenario_digest(scenario)
    for name in ("x", "y", "speed", "heading", "acceleration"):
        changed = getattr(scenario, name).copy()
        changed[-1, 0] = np.nextafter(changed[-1, 0], np.inf)
        assert scenario_digest(replace(scenario, **{name: changed})) != digest
    for name in ("target_lane", "action", "critical_bv"):
        changed = getattr(scenario, name).copy()
        changed.flat[-1] += 1
        assert scenario_digest(replace(scenario, **{name: changed})) != digest
    present = scenario.present.copy()
    present[-1, -1] = False
    gone = replace(scenario, present=present)
    x = scenario.x.copy()
    x[-1, -1] = np.nan
    assert scenario_digest(gone) != digest
    assert scenario_digest(replace(gone, x=x)) == scenario_digest(gone)


def test_the_shapes_and_marks_of_a_scenario(reckless: NddModel) -> None:
    recorder = Recorder(setting_of(reckless, ODD, adversary="uniform"), ODD)
    removed = 0
    for test in range(30):
        s = recorder.record(1, test)
        frames, n = s.x.shape
        decisions = -(-(frames - 1) // 10)
        assert s.action.shape == (decisions, n)
        assert s.critical_bv.shape == s.log_prob_nde.shape == (decisions,)
        assert (s.slot == np.arange(n)).all()
        for name in ("x", "y", "speed", "heading", "acceleration"):
            np.testing.assert_array_equal(np.isnan(getattr(s, name)), ~s.present)
        np.testing.assert_array_equal(s.target_lane == -1, ~s.present)
        assert s.present[:, 0].all()
        assert (s.action[:, 0] == -1).all()
        at_decisions = s.present[:-1:10]
        np.testing.assert_array_equal(s.action[:, 1:] >= 0, at_decisions[:, 1:])
        assert all(at_decisions[k, column] for k, column in enumerate(s.critical_bv) if column >= 0)
        assert (s.log_prob_nde <= 0.0).all()
        removed += int((~s.present[-1]).sum())
        speeds = s.speed[s.present]
        assert speeds.min() >= 0.0
        assert speeds.max() <= ODD.max_speed
    assert removed > 0
