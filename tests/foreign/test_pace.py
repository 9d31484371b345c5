"""How fast an AV answers decides how many worlds are asked about together, and how long they may take; no result."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign.opened_av import opened

import cornerforge
from cornerforge.errors import InputError
from cornerforge.experiment.counting import simulate_experiment
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.pace import Pace, announce, announced, choose_batch
from cornerforge.foreign.process import AvProcess
from cornerforge.foreign.session import context_of
from cornerforge.sim.outcome import Outcomes
from cornerforge.types import Odd

pytestmark = pytest.mark.usefixtures("in_memory")

SEED = 2


def noted(**seconds: float) -> Pace:
    """A pace that knows calls: `noted(w1=0.2, w256=0.5)`."""
    pace = Pace(5.0, 60.0)
    for name, each in seconds.items():
        pace.note(int(name[1:]), each)
    return pace


# --- the batch ---


@pytest.mark.parametrize(
    ("seconds_of", "batch"),
    [
        (lambda worlds: 1e-4 + 4e-7 * worlds, 256),  # array arithmetic
        (lambda worlds: 0.2 * worlds, 1),  # a planner that plans world by world
        (lambda worlds: 3.0 * worlds, 1),
        (lambda worlds: 0.2 + 1e-4 * worlds, 256),  # a large network
        (lambda worlds: 0.9, 256),  # noqa: ARG005
        (lambda worlds: 2.0 + 1e-3 * worlds, 256),
        (lambda worlds: 0.05 * -(-worlds // 8), 20),  # eight at a time
    ],
)
def test_more_worlds_are_asked_about_together_where_that_saves_time(
    seconds_of: Callable[[int], float], batch: int
) -> None:
    asked: list[int] = []

    def measured(worlds: int) -> float:
        asked.append(worlds)
        return seconds_of(worlds)

    found = choose_batch(measured)
    assert asked[0] == 1
    assert asked == sorted(set(asked))
    assert found == batch
    assert sum(map(seconds_of, asked)) < 10.0 * max(1.0, seconds_of(1))  # measuring must not take long itself


def test_no_more_worlds_than_are_wanted() -> None:
    assert choose_batch(lambda worlds: 1e-4 + 1e-7 * worlds, most=40) == 40


# --- time limits ---


def test_the_limit_of_one_world_is_the_one_that_was_asked_for() -> None:
    assert noted(w1=0.2).limit(1) == 5.0
    assert Pace(5.0, 60.0).limit(256) == 5.0


def test_many_worlds_may_take_what_they_usually_take_and_more() -> None:
    pace = noted(w1=0.2, w256=0.25)
    assert pace.limit(256) == 5.0 + 3 * 0.25  # not 256 times as long: this AV answers for all in one go
    assert pace.limit(2) == pace.limit(200) == pace.limit(256)
    assert noted(w1=0.2).limit(256) == pytest.approx(5.0 + 3 * 0.2 * 256)
    assert pace.limit(256, first=True) == 60.0 + 3 * 0.25
    assert Pace(90.0, 60.0).limit(1, first=True) == 90.0


def test_what_is_usual_follows_the_av() -> None:
    pace = noted(w8=0.1)
    for _ in range(200):
        pace.note(8, 0.4)
    assert pace.usual(8) == pytest.approx(0.4, rel=1e-3)
    assert pace.usual(0) == pace.usual(1) == pace.usual(8)


def test_a_forecast_follows_what_driving_took() -> None:
    """Twice as long as expected, then as expected, for long: the factor goes to 2 at once, and back by and by."""
    pace = Pace(1.0, 1.0)
    pace.note(64, 0.1)
    assert pace.slower is None
    expected = 1000 * pace.seconds_per_answer(64)
    pace.note_driven(1000, 2.0 * expected, 64)
    assert pace.slower == pytest.approx(2.0)
    for _ in range(50):
        pace.note_driven(1000, 0.9 * expected, 64)
    assert pace.slower == pytest.approx(1.0, abs=0.01)


def test_after_a_late_answer_many_worlds_have_more_time_once() -> None:
    pace = noted(w1=0.03, w256=0.5)
    for _ in range(9):
        pace.allow_more(256)
    assert pace.limit(256) == 5.0 + 3 * 5.0
    assert pace.limit(1) == 5.0


# --- spreading ---


def test_few_tests_of_a_slow_av_keep_all_processes_busy() -> None:
    slow = noted(w1=0.2)
    assert slow.range_size(512, 1, 12, 2, 130.0) == 1
    vectorised = noted(w1=0.2, w256=0.3)
    assert vectorised.range_size(512, 256, 12, 2, 130.0) == 6
    assert vectorised.range_size(512, 256, 10_000, 2, 130.0) == 256
    fast = noted(w1=1e-4, w256=2e-4)
    assert fast.range_size(512, 256, 10_000, 2, 130.0) == 512
    assert fast.range_size(512, 256, 400, 2, 130.0) == 200
    assert Pace(5.0, 60.0).range_size(512, 256, 12, 2, 130.0) == 512  # nothing is known


def test_a_slow_av_is_not_asked_about_more_worlds_than_there_are_tests() -> None:
    assert noted(w256=0.3).rows(256, 12) == 12
    assert noted(w256=2e-4).rows(256, 12) == 256  # it would have to be made anew for nothing


@pytest.mark.parametrize(
    ("batch", "processes", "threads", "worlds", "size"),
    [(None, None, 2, 512, 256), (None, 4, 2, 512, 128), (24, None, 2, 64, 22), (None, None, 2, 16, 8),
     (None, 1, 8, 512, 256), (None, 64, 2, 16, 1)],
)  # fmt: skip
@pytest.mark.usefixtures("avs")
def test_training_worlds_are_shared_by_all_processes(
    batch: int | None,
    processes: int | None,
    threads: int,
    worlds: int,
    size: int,
) -> None:
    av = opened("avs:Good", Odd(), batch=batch, processes=processes)
    assert av.group_size(512, 2) == -(-512 // max(processes or 1, -(-512 // (batch or 256))))  # it is fast
    av.pace.note(512, 9.0)
    av.pace.note(16, 9.0)
    assert av.group_size(worlds, threads) == size


# --- nothing of it is in a result ---


@pytest.mark.usefixtures("in_memory")
def test_a_trial_leaves_no_fault_behind(avs: Path) -> None:  # noqa: ARG001
    """Its tests are those that the work drives, so faults would count twice, or in tests that were not asked for."""
    run = experiment(av="avs:Raises", bv="swerve", takes_foreign=True)
    assert run.asked is not None
    assert run.seconds_of(2, decisions=1e7) > 0.0
    assert run.asked.pace.slower is not None, "nothing was tried"
    assert not run.faults
    assert run.asked._driven == 0


def outcomes(run_av: ForeignAv, tests: int) -> Outcomes:
    run = experiment(bv="swerve")
    return run_av(run.setting, run.slots, SEED, 0, tests, False)[0]


@pytest.mark.full
def test_a_measured_batch_gives_the_results_of_any_other(avs: Path) -> None:  # noqa: ARG001
    measured, one = opened("avs:Good", Odd()), opened("avs:Good", Odd(), batch=1)
    assert measured.batch > 1
    assert measured.pace.usual(measured.batch) > 0.0
    for ours, theirs in zip(outcomes(measured, 20), outcomes(one, 20), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_worlds_that_are_made_fewer_give_the_same_results(avs: Path) -> None:  # noqa: ARG001
    av = opened("avs:Counts", Odd(), batch=64)
    expected = outcomes(av, 9)
    av.pace.note(64, 1000.0)  # from now on it is taken to be slow
    with av.lend_session(9) as session:
        assert session.batch_size == 9
    with av.lend_session() as session:
        assert session.batch_size == 64
    for ours, theirs in zip(outcomes(av, 9), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


TIRED = """
import time
import numpy as np

class Av:
    def act(self, view):
        driving = int(np.count_nonzero(view[:, 0, 0]))
        self.calls = getattr(self, 'calls', 0) + 1
        if driving > 1 and self.calls > 9:
            time.sleep(60)
        return np.zeros((len(view), 2))
"""


@pytest.mark.full
def test_what_is_too_slow_for_many_worlds_is_said_and_costs_no_test(avs: Path) -> None:
    (avs / "tired.py").write_text(TIRED, encoding="utf-8")
    av = opened("tired:Av", Odd(), batch=4, timeout=1.0)
    said: list[str] = []
    with announced(said.append):
        out = outcomes(av, 3)
    assert av.faults == {}
    assert (out.decisions > 0).all()
    assert len(said) == 1
    assert "gave no answer within 1 s for 3 worlds; these tests are driven again one by one" in said[0]
    announce("nobody listens any more")
    assert len(said) == 1


@pytest.mark.parametrize(
    "asked", [{"av_batch": 0}, {"av_batch": 65_537}, {"av_processes": 0}, {"av_processes": 1025}, {"av_timeout": 0.0}]
)
def test_numbers_are_checked(asked: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"^{next(iter(asked))} = .* is out of range"):
        experiment(av="avs:Good", takes_foreign=True, **asked)


# --- nothing is left behind ---

OWNER = """
import sys
import numpy as np
from cornerforge.foreign.process import AvProcess
from cornerforge.foreign.session import context_of
from cornerforge.types import Odd

process = AvProcess("stuck:Av", timeout=900.0, first_timeout=900.0)
process.setup(context_of(Odd(), batch=1, seed=0))
print(process._process.pid, flush=True)
process.act(np.ones((1, 13, 8), np.float32), np.zeros(0, np.int64), np.zeros(0, np.int64))
"""
STUCK = """
import ctypes
import subprocess

class Av:
    def act(self, view):
        child = subprocess.Popen(['sleep', '1000'])
        with open('pids', 'w') as file:
            file.write(str(child.pid))
        ctypes.PyDLL(None).sleep(1000)  # holds the interpreter's lock
"""


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"  # dead, but its new parent has not looked yet


def wait_until(found: Callable[[], bool]) -> bool:
    for _ in range(600):
        if found():
            return True
        time.sleep(0.1)
    return False


@pytest.mark.full
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads the state of processes from /proc")
def test_an_av_that_hangs_in_native_code_does_not_outlive_a_killed_simulator(avs: Path) -> None:
    (avs / "stuck.py").write_text(STUCK, encoding="utf-8")
    source = str(Path(cornerforge.__file__).parents[1])
    with subprocess.Popen(
        [sys.executable, "-c", OWNER],
        stdout=subprocess.PIPE,
        text=True,
        cwd=avs,
        env={**os.environ, "PYTHONPATH": source},
    ) as owner:
        assert owner.stdout is not None
        av = int(owner.stdout.readline())
        assert wait_until(lambda: (avs / "pids").exists() and (avs / "pids").read_text() != "")
        child = int((avs / "pids").read_text())
        assert is_alive(av)
        assert is_alive(child)
        owner.send_signal(signal.SIGKILL)
        owner.wait()
    assert wait_until(lambda: not is_alive(av))
    assert wait_until(lambda: not is_alive(child))


@pytest.mark.processes
def test_the_watcher_goes_with_the_av(avs: Path) -> None:  # noqa: ARG001
    process = AvProcess("avs:Good", timeout=20.0, first_timeout=20.0)
    process.setup(context_of(Odd(), batch=1, seed=0))
    group = process._process.pid
    process.close()

    def is_empty() -> bool:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        return False

    assert wait_until(is_empty)


# --- the options ---


@pytest.mark.full
@pytest.mark.processes
def test_all_processes_drive_where_there_are_few_tests(avs: Path) -> None:
    """Each process leaves a file with its name."""
    (avs / "leaves.py").write_text(
        "import os\nimport time\nimport numpy as np\nclass Av:\n    def act(self, view):\n"
        "        open(f'pid-{os.getpid()}', 'w').close()\n        time.sleep(0.002 * (view[:, 0, 0] > 0).sum())\n"
        "        return np.zeros((len(view), 2))\n",
        encoding="utf-8",
    )  # fmt: skip
    run = experiment(av="leaves:Av", bv="swerve", takes_foreign=True, av_processes=3)
    simulate_experiment(run, tests=6, seed=SEED, threads=1)
    run.rest()
    assert len(list(avs.glob("pid-*"))) == 3


@pytest.mark.full
@pytest.mark.processes
def test_the_number_of_processes_changes_no_result(avs: Path) -> None:  # noqa: ARG001
    found = []
    for processes, batch in ((1, None), (3, 2)):
        run = experiment(av="avs:Good", bv="swerve", takes_foreign=True, av_processes=processes, av_batch=batch)
        tally, _ = simulate_experiment(run, tests=40, seed=SEED, threads=2)
        found.append((tally.digest.hexdigest(), tally.av_crashes, tally.tests))
    assert found[0] == found[1]
