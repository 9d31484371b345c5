"""AVs that are programs: what they are told, how they answer, and what each mistake of theirs costs."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from foreign.opened_av import opened

import cornerforge
from cornerforge.errors import AvFaultError, InputError
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.process import AvProcess
from cornerforge.foreign.session import context_of
from cornerforge.sim import simulate
from cornerforge.types import Odd

pytestmark = pytest.mark.full

PACKAGE = Path(cornerforge.__file__).parent
SOURCE = Path(__file__).parents[2] / "examples" / "planner.c"

# A program and a class with one law. The program may also fail, in one test of so many, after a second.
LAW = """
def law(own, others):
    a = min(max(0.3 * (30.0 - own["vx"]), -3), 1)
    ahead = [o for o in others if o["x"] > own["x"] and abs(o["y"] - own["y"]) < 2.5]
    if ahead:
        a = min(a, 0.1 * (ahead[0]["x"] - own["x"] - 7 - 1.5 * own["vx"]) + 0.6 * (ahead[0]["vx"] - own["vx"]))
    return [a, 0]
"""
PROGRAM = """
import json, os, sys, threading, time
mode = sys.argv[1] if len(sys.argv) > 1 else "good"
seeds = {}
say = lambda content: print(json.dumps(content), flush=True)
for line in sys.stdin:
    said = json.loads(line)
    kind = said["type"]
    if kind == "hello":
        if mode == "dies at once": sys.exit(4)
        if mode == "greets": print("Planner 1.2 is ready", flush=True)
        if mode == "greets later": threading.Timer(0.5, print, ["so slow"], {"flush": True}).start()
        say({"type": "hello", **json.loads(os.environ.get("HELLO", "{}"))})
    elif kind == "setup":
        if mode == "hangs in setup":
            open("hanging", "w").close()
            while True: pass
        say({"type": "ready"})
    elif kind == "reset":
        seeds[said["world"]] = said["seed"]
    else:
        w = said["world"]
        answer = {"world": w, "answer": law(said["own"], said["others"])}
        if said["time"] > 0.95 and seeds[w] % 7 == 0:
            if mode == "garbage": print("debug: x = 3", flush=True)
            if mode == "exits": sys.exit(3)
            if mode == "kills itself": os.kill(os.getpid(), 11)
            if mode == "half a line": print('{"world":', end="", flush=True); os._exit(0)
            if mode == "another world": answer["world"] = 9999
            if mode == "twice": say(answer)
            if mode == "shape": answer["answer"] = [1, 0, 0]
            if mode == "words": answer["answer"] = ["brake", 0]
            if mode == "nan": answer["answer"] = [float("nan"), 0]
            if mode == "order": answer["answer"] = [0, 2]
            if mode == "nothing": del answer["answer"]
            if mode == "error": answer = {"world": w, "error": "no way out"}
            if mode == "array": answer = [1, 2]
            if mode == "floods":
                while True: print("debug: x = 3", flush=True)
            if mode == "hangs": time.sleep(60)
        say(answer)
"""
TWIN = """
from dataclasses import asdict
class Twin:
    memory = False
    def plan(self, scene):
        return law(asdict(scene.own), [asdict(o) for o in scene.others])
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The working directory, with `twins:Twin` and the program of the same law; the start of its --av."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "program.py").write_text(LAW + PROGRAM, encoding="utf-8")
    (tmp_path / "twins.py").write_text(LAW + TWIN, encoding="utf-8")
    return f"cmd: {sys.executable} program.py"


@pytest.fixture(scope="session")
def planner(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The example in C, compiled; its --av."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    out = tmp_path_factory.mktemp("c") / "planner"
    subprocess.run(
        [compiler, "-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-o", out, SOURCE, "-lm"], check=True, timeout=60
    )
    return f"cmd: {out}"


def test_the_example_in_c_drives_and_passes_check_av(planner: str) -> None:
    assert len(SOURCE.read_text(encoding="utf-8").splitlines()) < 45
    driven = cornerforge.simulate(av=planner, tests=150, seed=1)
    assert (driven.tests, driven.av_faults) == (150, 0)
    assert driven.av_crashes < 5
    checked = cornerforge.check_av(av=planner, tests=8)
    assert checked.passed, checked.checks
    assert {check.verdict for check in checked.checks} == {"ok"}
    assert (checked.kind, checked.log) == ("program", None)
    assert [speed.worlds for speed in checked.speed] == [1, 64, 256]


def test_its_cases_replay(planner: str, tmp_path: Path) -> None:
    filled = cornerforge.generate(policy="swerve", av=planner, cases=8, out=tmp_path / "lib")
    assert filled.cases == 8
    assert cornerforge.replay(tmp_path / "lib", "all", check=True).identical is True


@pytest.mark.usefixtures("in_memory")
def test_it_drives_as_a_class_of_the_same_law(program: str) -> None:
    outside = cornerforge.simulate(av=program, tests=40, seed=3)
    assert outside.digest == cornerforge.simulate(av="twins:Twin", tests=40, seed=3).digest


LONG = """
def long(own):
    return [[0.05 * k, own["x"] + own["vx"] * 0.05 * k, own["y"], 0.0, own["vx"]] for k in range(100)]
"""
LONG_PROGRAM = """
import json, sys
for line in sys.stdin:
    said = json.loads(line)
    answer = {"hello": {"type": "hello", "answers": "trajectory", "objects": None}, "setup": {"type": "ready"}}
    if said["type"] == "scene":
        print(json.dumps({"world": said["world"], "answer": long(said["own"])}), flush=True)
    elif said["type"] != "reset":
        print(json.dumps(answer[said["type"]]), flush=True)
"""
LONG_TWIN = """
class Twin:
    answers, objects = "trajectory", None
    def plan(self, scene):
        return long({"x": scene.own.x, "y": scene.own.y, "vx": scene.own.vx})
"""


@pytest.mark.usefixtures("in_memory")
def test_neither_side_waits_for_the_other_when_lines_are_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A batch of questions and one of answers are each some times what a pipe holds (64 kB)."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "long.py").write_text(LONG + LONG_PROGRAM, encoding="utf-8")
    (tmp_path / "long_twin.py").write_text(LONG + LONG_TWIN, encoding="utf-8")
    digests = {
        cornerforge.simulate(av=av, tests=64, threads=1).digest
        for av in (f"cmd: {sys.executable} long.py", "long_twin:Twin")
    }
    assert len(digests) == 1


@pytest.mark.usefixtures("in_memory")
def test_a_program_with_threads_may_answer_in_any_order(program: str, tmp_path: Path) -> None:
    (tmp_path / "threads.py").write_text(
        (LAW + PROGRAM)
        .replace("        say(answer)\n", "        threading.Timer(0.002 * (5 - w % 5), say, [answer]).start()\n")
        .replace("say = lambda content: print(json.dumps(content), flush=True)", SAYS_ALONE),
        encoding="utf-8",
    )
    mixed = cornerforge.simulate(av=f"cmd: {sys.executable} threads.py", tests=8, threads=1)
    assert mixed.av_faults == 0
    assert mixed.digest == cornerforge.simulate(av=program, tests=8, threads=1).digest


SAYS_ALONE = """
lock = threading.Lock()
def say(content):
    with lock:
        print(json.dumps(content), flush=True)
"""


@pytest.mark.usefixtures("in_memory")
def test_results_do_not_depend_on_batches_or_threads(planner: str) -> None:
    run = experiment(av=planner, takes_foreign=True)
    digests = set()
    for batch, threads in ((1, 1), (7, 2), (64, 1)):
        av = opened(planner, Odd(), batch=batch)
        digests.add(simulate(run.setting, run.slots, seed=5, tests=30, threads=threads, drive=av).digest.hexdigest())
        av.close()
    assert len(digests) == 1


@pytest.mark.usefixtures("in_memory")
@pytest.mark.parametrize(
    ("mode", "what", "text"),
    [
        pytest.param(
            "garbage",
            "answer",
            r"printed a line that is no JSON object: 'debug: x = 3'; text for people belongs on",
            marks=pytest.mark.processes,
        ),
        pytest.param("floods", "answer", r"no JSON object: 'debug: x = 3'", marks=pytest.mark.processes),
        ("array", "answer", r"no JSON object: '\[1, 2\]'"),
        pytest.param("exits", "ended", r"ended its program \(exit status 3\)$", marks=pytest.mark.processes),
        ("kills itself", "ended", r"ended its program \(signal SIGSEGV\)"),
        pytest.param(
            "half a line",
            "ended",
            r"\(exit status 0\); it had begun the line '\{\"world\":'",
            marks=pytest.mark.processes,
        ),
        ("another world", "answer", r"answered for world 9999, which was not asked: '\{"),
        ("twice", "answer", r"(line that nothing had asked for|answered twice).*'\{\"world\": \d+, \"answer\""),
        ("shape", "answer", r"returned an array of shape \(3,\); expected \(2\): '\{\"world\""),
        ("words", "answer", r"array of type <U.*real numbers.*brake"),
        ("nan", "answer", r"answered with NaN"),
        ("order", "answer", r"lane order other than -1, 0 and 1"),
        ("nothing", "answer", r'neither "answer" nor "error"'),
        ("error", "raised", r"reported: no way out"),
    ],
)
def test_a_mistake_costs_its_tests_only(program: str, mode: str, what: str, text: str) -> None:
    good = experiment(av="twins:Twin", takes_foreign=True)
    bad = experiment(av=f"{program} '{mode}'", takes_foreign=True)
    spoiled = simulate(bad.setting, bad.slots, seed=0, tests=12, threads=1, drive=bad.drive)
    faults = bad.faults
    assert 0 < spoiled.av_faults == len(faults) < 8
    for fault in faults.values():
        assert fault.what == what
        assert re.search(text, fault.message), fault.message
        assert "\n" not in fault.message
    untouched = next(test for test in range(12) if (0, test) not in faults)
    np.testing.assert_array_equal(bad.recorder().record(0, untouched).y, good.recorder().record(0, untouched).y)
    bad.rest()


def test_a_program_that_hangs_is_stopped(program: str) -> None:
    run = experiment(av=f"{program} hangs", takes_foreign=True, av_timeout=1.0)
    tally = simulate(run.setting, run.slots, seed=0, tests=2, threads=1, drive=run.drive)
    assert tally.av_faults == len(run.faults)
    for fault in run.faults.values():
        assert (fault.what, fault.message) == ("hung", "gave no answer within 1 s")


def wait_until(holds: Callable[[], bool]) -> None:
    """Wait until something holds, a minute at most."""
    for _ in range(600):
        if holds():
            return
        time.sleep(0.1)
    assert holds()


def processes_with(text: str) -> list[int]:
    """Processes whose command line holds a text."""
    found = []
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = place.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:  # it has ended
            continue
        if text in command and "defunct" not in command:
            found.append(int(place.parent.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="there is no /proc to look into")
def test_the_program_ends_with_its_owner(program: str, tmp_path: Path) -> None:
    marked = f"{program} good {tmp_path}/mark"
    process = AvProcess(marked, timeout=20.0, first_timeout=20.0)
    assert len(processes_with(f"{tmp_path}/mark")) == 1
    process.close()
    wait_until(lambda: not processes_with(f"{tmp_path}/mark"))


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="there is no /proc to look into")
def test_a_program_that_hangs_ends_with_a_simulator_that_is_killed(program: str, tmp_path: Path) -> None:
    mark = f"{tmp_path}/mark"
    asks = (
        "import sys, numpy as np\n"
        "from cornerforge.foreign.process import AvProcess\n"
        "from cornerforge.foreign.session import context_of\n"
        "from cornerforge.types import Odd\n"
        "AvProcess(sys.argv[1], timeout=60.0, first_timeout=60.0).setup(context_of(Odd(), batch=1, seed=0))\n"
    )
    marked = f"{program} 'hangs in setup' {mark}"
    with subprocess.Popen(
        [sys.executable, "-c", asks, marked], env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)}
    ) as simulator:
        try:
            wait_until(lambda: (tmp_path / "hanging").exists())
            assert processes_with(f"program.py hangs in setup {mark}")
        finally:
            simulator.kill()
    wait_until(lambda: not processes_with(mark))


@pytest.mark.parametrize(
    ("hello", "text"),
    [
        ('{"answers":"wish"}', r'says answers = "wish"; allowed: lane, curvature, steering, trajectory'),
        ('{"objects":-1}', "says objects = -1; allowed: a number from 0 on"),
        ('{"objects":true}', "says objects = true"),
        ('{"memory":0}', "says memory = 0; allowed: true or false"),
        ('{"answer":"lane"}', "has 'answer'; allowed: type, answers, objects, memory"),
        ('{"type":"hi"}', 'did not say hello, such as .*; it printed \'{"type": "hi"}'),
    ],
)
def test_what_it_says_of_itself_is_checked(
    program: str, monkeypatch: pytest.MonkeyPatch, hello: str, text: str
) -> None:
    monkeypatch.setenv("HELLO", hello)
    with pytest.raises(InputError, match=text):
        AvProcess(program, timeout=20.0, first_timeout=20.0)


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        ("cmd:", "names no program"),
        ("cmd: ./gone --flag", r"No program ./gone for the AV cmd: ./gone --flag; looked in"),
        ("cmd: ./text", r"No program ./text .* may not be run \(chmod \+x\)"),
        ("cmd: ./empty", "cannot be started: Exec format error"),
        ("cmd: ./planner 'x", "cannot be read as words of a shell: No closing quotation"),
        ("cmd: echo hello there", "did not say hello.* it printed 'hello there'"),
    ],
)
def test_what_is_no_program_is_refused(program: str, tmp_path: Path, spec: str, text: str) -> None:  # noqa: ARG001
    (tmp_path / "text").write_text("no program", encoding="utf-8")
    (tmp_path / "empty").write_bytes(b"\x7fELF")
    (tmp_path / "empty").chmod(0o755)
    with pytest.raises(InputError, match=text) as refusal:
        AvProcess(spec, timeout=20.0, first_timeout=20.0)
    assert "\n" not in str(refusal.value)


def test_a_program_that_dies_at_once_is_named(program: str) -> None:
    with pytest.raises(AvFaultError, match=r"ended its program \(exit status 4\) while it was loaded"):
        AvProcess(f"{program} 'dies at once'", timeout=20.0, first_timeout=20.0)


def test_what_it_prints_beside_its_answers_is_quoted(program: str) -> None:
    with pytest.raises(InputError, match=r"did not say hello.* it printed 'Planner 1.2 is ready'"):
        AvProcess(f"{program} greets", timeout=20.0, first_timeout=20.0)
    process = AvProcess(f"{program} 'greets later'", timeout=20.0, first_timeout=20.0)
    time.sleep(1.5)
    with pytest.raises(AvFaultError, match=r"printed a line that nothing had asked for: 'so slow' in setup"):
        process.setup(context_of(Odd(), batch=2, seed=0))


def test_its_hash_is_that_of_program_arguments_and_script(program: str, tmp_path: Path) -> None:
    def hashed(spec: str) -> str:
        process = AvProcess(spec, timeout=20.0, first_timeout=20.0)
        process.close()
        return process.about["hash"]

    first = hashed(program)
    assert first == hashed(program)
    assert first != hashed(f"{program} good")
    with (tmp_path / "program.py").open("a", encoding="utf-8") as file:
        file.write("# another\n")
    assert first != hashed(program)


def test_an_av_that_becomes_another_one_ends_the_run(program: str, tmp_path: Path) -> None:
    av = opened(program, Odd(), batch=4)
    with (tmp_path / "program.py").open("a", encoding="utf-8") as file:
        file.write("# another\n")
    with pytest.raises(
        AvFaultError, match=r"is not the one that drove before: it was [0-9a-f]{16} with answers by lane"
    ):
        av.new_session(4).process()
    av.close()


def test_the_example_session_of_the_docs_is_what_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that keeps all lines: they have the keys, in the order, that docs/av-programs.md shows."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "keeps.py").write_text(
        "import sys\nout = open('said.txt', 'w')\n"
        "for line in sys.stdin:\n"
        "    out.write(line); out.flush()\n"
        '    if \'hello\' in line: print(\'{"type":"hello","objects":2}\', flush=True)\n'
        "    elif 'setup' in line: print('{\"type\":\"ready\"}', flush=True)\n"
        "    elif 'scene' in line: print('{\"world\":%s,\"answer\":[0,0]}'"
        " % line.split('\"world\":')[1].split(',')[0], flush=True)\n",
        encoding="utf-8",
    )
    cornerforge.simulate(av=f"cmd: {sys.executable} keeps.py", tests=1)
    said = [json.loads(line) for line in (tmp_path / "said.txt").read_text(encoding="utf-8").splitlines()]
    text = (Path(__file__).parents[2] / "docs" / "av-programs.md").read_text(encoding="utf-8")
    shown = [json.loads(line[2:]) for line in re.findall(r"^> .*$", text, re.MULTILINE)]
    for kind in ("hello", "setup", "reset", "scene"):
        ours = next(one for one in said if one["type"] == kind)
        theirs = next(one for one in shown if one["type"] == kind)
        assert list(ours) == list(theirs), kind
        if kind == "scene":
            assert list(ours["own"]) == list(theirs["own"])
            assert all(list(other) == list(ours["own"]) for other in theirs["others"])
            assert len(ours["others"]) <= 2
    assert os.path.getsize(tmp_path / "said.txt") > 1000
