"""Tests with foreign AVs: the same in any batch, and a fault costs the tests that it belongs to and no others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign.opened_av import opened

from cornerforge.errors import AvFaultError, InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.recorder import ForeignRecorder
from cornerforge.foreign.session import seeds_of
from cornerforge.sim.outcome import AV_CRASH, AV_FAULT, Outcomes
from cornerforge.sim.recorder import scenario_digest
from cornerforge.sim.runner import simulate
from cornerforge.types import Odd

pytestmark = pytest.mark.usefixtures("in_memory")

SEED = 2
TESTS = 200


def hostile(**changes: Any) -> Experiment:
    """Its setting names a built-in AV: who stands outside drives all the same."""
    return experiment(**({"bv": "swerve"} | changes))


def outcomes(name: str, tests: int = TESTS, *, counting: bool = False, **arguments: Any) -> tuple[Outcomes, ForeignAv]:
    run = hostile()
    av = opened(f"avs:{name}", run.odd, **({"batch": 64} | arguments))
    out, _ = av(run.setting, run.slots, SEED, 0, tests, counting)
    return out, av


def struck(one_in: int, tests: int = TESTS) -> list[int]:
    """Tests in which the AVs of `conftest.py` get into trouble."""
    found: list[int] = np.flatnonzero(seeds_of(SEED, np.arange(tests)) % one_in == 0).tolist()
    return found


def assert_same_but(ours: Outcomes, theirs: Outcomes, faults: list[int]) -> None:
    others = np.setdiff1d(np.arange(ours.code.size), faults)
    for name in Outcomes._fields:
        np.testing.assert_array_equal(getattr(ours, name)[others], getattr(theirs, name)[others])
    assert np.flatnonzero(ours.code == AV_FAULT).tolist() == faults


@pytest.mark.full
@pytest.mark.processes
def test_results_do_not_depend_on_batch_or_threads(avs: Path) -> None:  # noqa: ARG001
    run = hostile()
    digests = set()
    for batch, threads in ((1, 1), (37, 2), (256, 1)):
        av = opened("avs:Good", run.odd, batch=batch)
        tests = 60 if batch == 1 else TESTS
        if batch == 1:
            assert_same_but(outcomes("Good", tests)[0], av(run.setting, run.slots, SEED, 0, tests, False)[0], [])
            continue
        tally = simulate(run.setting, run.slots, seed=SEED, tests=TESTS, threads=threads, drive=av)
        digests.add((tally.digest.hexdigest(), tally.av_crashes, tally.decisions))
    assert len(digests) == 1


def test_seeds_name_tests() -> None:
    seeds = seeds_of(5, np.arange(1000))
    assert len(set(seeds.tolist())) == 1000
    assert (seeds >= 0).all()
    np.testing.assert_array_equal(seeds[300:400], seeds_of(5, np.arange(300, 400)))
    assert not np.isin(seeds_of(6, np.arange(1000)), seeds).any()


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "one_in", "what"),
    [
        ("Raises", 61, "raised"),
        ("Exits", 97, "ended"),
        pytest.param("Segfaults", 97, "ended", marks=pytest.mark.processes),
        ("Nan", 40, "answer"),
        ("BadOrder", 40, "answer"),
    ],
)
def test_a_fault_spoils_no_other_test(avs: Path, name: str, one_in: int, what: str) -> None:  # noqa: ARG001
    good, _ = outcomes("Good")
    bad, av = outcomes(name)
    # a test that crashed before the 21st decision never came to it
    culprits = [test for test in struck(one_in) if good.decisions[test] > 2]
    assert len(culprits) >= 2
    assert_same_but(bad, good, culprits)
    assert {(test, fault.what) for (_, test), fault in av.faults.items()} == {(test, what) for test in culprits}


@pytest.mark.full
@pytest.mark.processes
def test_a_hang_costs_its_own_test(avs: Path) -> None:  # noqa: ARG001
    good, _ = outcomes("Good")
    culprits = [test for test in struck(97) if good.decisions[test] > 2][:1]
    tests = culprits[0] + 1
    hung, av = outcomes("Hangs", tests, timeout=1.5, batch=8)
    assert_same_but(hung, outcomes("Good", tests)[0], culprits)
    assert av.faults[SEED, culprits[0]].message == "gave no answer within 1.5 s"


@pytest.mark.full
@pytest.mark.parametrize("name", ["Raises", "Nan"])
def test_histograms_leave_spoiled_tests_out(avs: Path, name: str) -> None:  # noqa: ARG001
    run = hostile()
    av = opened(f"avs:{name}", run.odd, batch=64)
    out, counts = av(run.setting, run.slots, SEED, 0, 120, True)
    spoiled = np.flatnonzero(out.code == AV_FAULT).tolist()
    assert spoiled
    good = opened("avs:Good", run.odd, batch=64)
    expected = np.zeros_like(counts.histograms)
    for test in range(120):
        if test not in spoiled:
            expected += good(run.setting, run.slots, SEED, test, 1, True)[1].histograms
    np.testing.assert_array_equal(counts.histograms, expected)


def test_a_fault_that_does_not_come_again_costs_nothing(avs: Path) -> None:  # noqa: ARG001
    flaky, av = outcomes("Flaky")
    assert Path("once").exists()
    assert_same_but(flaky, outcomes("Good")[0], [])
    assert not av.faults


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("AlwaysRaises", r"spoiled 2\d tests .*In test \d+ it raised ValueError\(always\)"),
        ("RaisesAtOnce", r"avs:RaisesAtOnce raised ZeroDivisionError\(at once\) .* at its first question"),
        ("WrongShape", r"expected \(64, 2\) at its first question; look closer with: cornerforge check-av"),
    ],
)
def test_an_av_that_never_works_ends_the_run(avs: Path, name: str, text: str) -> None:  # noqa: ARG001
    with pytest.raises(AvFaultError, match=text):
        outcomes(name)


def test_a_recording_is_what_happened(avs: Path) -> None:  # noqa: ARG001
    run = hostile()
    for name in ("Good", "Random"):
        av = opened(f"avs:{name}", run.odd, batch=64)
        recorder = ForeignRecorder(av, run.setting, run.odd)
        out, _ = av(run.setting, run.slots, SEED, 0, 40, False)
        crashed = np.flatnonzero(out.code == AV_CRASH)
        assert crashed.size > 3
        for test in crashed:
            crash = recorder.record(SEED, int(test)).crash
            assert crash is not None
            assert round(crash.time * 10) == out.frame[test]
            assert (crash.slot_a, crash.slot_b) == (out.slot_a[test], out.slot_b[test])


@pytest.mark.full
def test_a_deterministic_av_can_be_asked_again(avs: Path) -> None:  # noqa: ARG001
    run = hostile()
    digests = []
    for batch in (64, 16):
        recorder = ForeignRecorder(opened("avs:Good", run.odd, batch=batch), run.setting, run.odd)
        digests.append(scenario_digest(recorder.record(SEED, 7)))
    assert digests[0] == digests[1]
    assert opened("avs:Good", run.odd, batch=16).repeats(run.setting, run.slots, SEED, 7)
    assert not opened("avs:Random", run.odd, batch=16).repeats(run.setting, run.slots, SEED, 7)


def test_a_script_of_a_spoiled_test_is_refused(avs: Path) -> None:  # noqa: ARG001
    good, _ = outcomes("Good")
    test = next(t for t in struck(61) if good.decisions[t] > 2)
    run = hostile()
    with pytest.raises(AvFaultError, match=rf"raised ValueError\(on purpose\) .*in test {test}"):
        opened("avs:Raises", run.odd).script(run.setting, run.slots, SEED, test)


@pytest.mark.parametrize("arguments", [{"timeout": 0.0}, {"timeout": float("nan")}, {"batch": 0}])
def test_limits_are_checked(arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        opened("avs:Good", Odd(), **arguments)
