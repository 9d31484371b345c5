"""AVs that do what no AV should: it is contained, named in one line and counted, and nothing of theirs lives on."""

from __future__ import annotations

import gc
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from foreign.hostile_avs import BASE, FAULTS, HANGS, HARMLESS, left_behind, module

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import CornerForgeError
from cornerforge.foreign.interpreter import Confines
from cornerforge.foreign.process import AvFailureError, AvProcess
from cornerforge.foreign.session import context_of
from cornerforge.types import Odd

pytestmark = pytest.mark.full

NOBODY = np.zeros(0, np.int64)
needs_proc = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="only there all is found that lives on")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to work in; in the end no process lives that was started there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    yield tmp_path
    assert left_behind(tmp_path) == []


def started(timeout: float = 20.0, confines: Confines = Confines(memory=1.0)) -> AvProcess:  # noqa: B008
    process = AvProcess("hostile:Av", timeout=timeout, first_timeout=max(timeout, 3.0), confines=confines)
    process.setup(context_of(Odd(), batch=4, seed=0))
    return process


def views() -> np.ndarray:
    view = np.zeros((4, 13, 8), np.float32)
    view[:, 0] = 1.0, 400.0, 6.0, 25.0, 0.0, 0.0, 1.0, 0.0
    return view


@needs_proc
@pytest.mark.parametrize("name", HARMLESS)
def test_what_does_no_harm_costs_no_test(here: Path, name: str) -> None:
    (here / "hostile.py").write_text(module(HARMLESS[name], "act"), encoding="utf-8")
    process = started()
    for _ in range(3):
        np.testing.assert_array_equal(process.act(views(), NOBODY, NOBODY)[0], [[-1.0, 0.0]] * 4)
    process.close()
    assert process._process.returncode is not None
    if "children" in name:
        assert (here / "alive").read_text().split() != []
    kept = process.log.named()
    assert kept is None or not kept.exists() or kept.stat().st_size <= 10_000_000


@needs_proc
def test_its_processes_end_with_the_call_and_not_when_memory_is_tidied(here: Path) -> None:
    (here / "hostile.py").write_text(module(HARMLESS["children"], "import"), encoding="utf-8")
    gc.disable()
    try:
        cornerforge.simulate(tests=4, av="hostile:Av")
        assert (here / "alive").read_text().split() != []
        assert left_behind(here) == []
    finally:
        gc.enable()


@needs_proc
@pytest.mark.parametrize("name", FAULTS)
def test_what_fails_a_question_is_named(here: Path, name: str) -> None:
    code, text = FAULTS[name]
    (here / "hostile.py").write_text(module(code, "act"), encoding="utf-8")
    process = started(timeout=200.0)
    if name == "stops its parent":  # which may be seen by the time alone
        process._is_first, process._pace.timeout = False, 5.0
    with pytest.raises(AvFailureError, match=text) as failure:
        process.act(views(), NOBODY, NOBODY)
    said = str(failure.value)
    assert "\n" not in said
    assert said.isprintable()
    assert len(said) < 1200
    process.close()
    assert process._process.returncode is not None


@needs_proc
@pytest.mark.parametrize("name", HANGS)
def test_what_hangs_is_ended_in_time(here: Path, name: str) -> None:
    (here / "hostile.py").write_text(module(HANGS[name], "act"), encoding="utf-8")
    process = started()
    process._is_first = False
    process._pace.timeout = 2.0
    begun = time.monotonic()
    with pytest.raises(AvFailureError, match="gave no answer within 2 s") as failure:
        process.act(views(), NOBODY, NOBODY)
    assert failure.value.what == "hung"
    assert time.monotonic() - begun < 200.0  # they last 1000 s and more


@needs_proc
@pytest.mark.parametrize("where", ["import", "__init__", "setup"])
@pytest.mark.parametrize(
    "name",
    ["exit", "_exit", "segfault", "junk", "closes all", "KeyboardInterrupt", "BaseException", "numpy",
     "children and an end", "a name", "recursion"],
)  # fmt: skip
def test_what_fails_before_the_first_question_is_named(here: Path, where: str, name: str) -> None:
    (here / "hostile.py").write_text(module(FAULTS[name][0], where), encoding="utf-8")
    with pytest.raises(CornerForgeError) as failure:
        started()
    said = str(failure.value)
    assert "hostile" in said
    assert "\n" not in said
    assert said.isprintable()


@needs_proc
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_lives_on_after_a_simulator_that_is_ended(here: Path, sign: signal.Signals) -> None:
    (here / "hostile.py").write_text(module(HANGS["children"], "act"), encoding="utf-8")
    source = str(Path(cornerforge.__file__).parents[1])
    command = [sys.executable, "-m", "cornerforge", "simulate", "--av", "hostile:Av", "--tests", "9"]
    with subprocess.Popen(
        command, env={**os.environ, "PYTHONPATH": source}, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as simulator:
        assert wait_until(lambda: left_behind(here) != [] or simulator.poll() is not None)
        assert simulator.poll() is None
        simulator.send_signal(sign)
        _, said = simulator.communicate()
    assert b"Traceback" not in said
    assert wait_until(lambda: left_behind(here) == [])


def wait_until(found: Callable[[], bool]) -> bool:
    for _ in range(1200):
        if found():
            return True
        time.sleep(0.1)
    return False


STRUCK = """
class Av:
    def setup(self, context):
        self.seeds, self.calls = (np.zeros(context.batch, np.int64) for _ in range(2))
    def reset(self, worlds, seeds):
        self.seeds[worlds] = seeds
        self.calls[worlds] = 0
    def act(self, view):
        self.calls += 1
        if ((view[:, 0, 0] == 1) & (self.seeds % 40 == 0) & (self.calls == 21)).any():
            live_on()
            os._exit(5)
        return brake(view)
"""


@pytest.mark.slow
@needs_proc
def test_tests_that_it_spoils_are_named_and_counted(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "hostile.py").write_text(BASE + STRUCK, encoding="utf-8")
    assert main(["simulate", "--av", "hostile:Av", "--tests", "120", "--json", "--out", "lib"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["av_faults"] > 0
    assert told["tests"] + told["av_faults"] == 120
    log = (here / "lib" / "av.log").read_text(encoding="utf-8")
    assert log.count("the AV ended its process (exit status 5)\n") >= told["av_faults"]
    assert (here / "alive").read_text().split() != []
    assert left_behind(here) == []
