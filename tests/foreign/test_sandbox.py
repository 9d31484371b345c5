"""An AV behind walls: no network, nothing written but its scratch, no process outside; and limits of memory."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import CornerForgeError, InputError
from cornerforge.foreign import interpreter
from cornerforge.foreign.interpreter import Confines
from cornerforge.foreign.process import AvProcess
from cornerforge.foreign.session import context_of
from cornerforge.types import Odd

pytestmark = pytest.mark.full

NOBODY = np.zeros(0, np.int64)
WALLS = Confines(sandbox=True)
TRIES = """
import ctypes, errno, json, os, signal, socket, subprocess, sys, tempfile
import numpy as np

def tried(what, *arguments):
    try:
        return str(what(*arguments))
    except OSError as error:
        return errno.errorcode.get(error.errno, str(error))
def connects(kind, place):
    with socket.socket(kind, socket.SOCK_STREAM) as one:
        one.settimeout(3)
        one.connect(place)
    return "connected"
def writes(path):
    with open(path, "w") as file:
        file.write("x")
    return "written"
def mounts():
    if ctypes.CDLL(None, use_errno=True).mount(None, b"/", None, ctypes.c_ulong(32 | 4096), None):
        raise OSError(ctypes.get_errno(), "")
    return "mounted"

class Av:
    def __init__(self):
        about = json.loads(os.environ["ABOUT"])
        found = {
            "outside": tried(connects, socket.AF_INET, ("192.0.2.1", 80)),
            "host": tried(connects, socket.AF_INET, ("127.0.0.1", about["port"])),
            "unix": tried(connects, socket.AF_UNIX, about["unix"]),
            "here": tried(writes, "here"),
            "package": tried(writes, os.path.join(about["package"], "x")),
            "home": tried(writes, os.path.join(about["home"], "x")),
            "host's tmp": tried(os.listdir, about["elsewhere"]),
            "tmp": tried(writes, "/tmp/x") if about["is_hidden"] else "written",
            "scratch": tried(lambda: tempfile.NamedTemporaryFile().name),
            "kill": tried(os.kill, about["pid"], 0),
            "mount": tried(mounts) if tempfile.gettempdir() == "/dev/shm" else "",
            "devices": sorted(set(os.listdir("/dev")) - set(about["devices"]))[:3],
            "processes": len([name for name in os.listdir("/proc") if name.isdigit()]),
            "child": subprocess.run([sys.executable, "-c", "print('child')"], capture_output=True).stdout.decode(),
        }
        raise ValueError("FOUND " + json.dumps(found))
    def act(self, view):
        return np.zeros((len(view), 2))
class Nested(Av):
    def __init__(self):
        code = (
            "from cornerforge.foreign import interpreter, process\\n"
            "interpreter._walls = lambda: []\\n"
            "confines = interpreter.Confines(sandbox=True)\\n"
            "process.AvProcess('tries:Good', timeout=60.0, first_timeout=60.0, confines=confines)\\n"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        raise ValueError("FOUND " + done.stderr.splitlines()[-1])
class Good(Av):
    def __init__(self):
        pass
"""


def walls() -> bool:
    """Does this system make walls?"""
    try:
        WALLS.check()
    except InputError:
        return False
    return True


needs_walls = pytest.mark.skipif(not walls(), reason="this system makes no walls for its users")


@pytest.fixture
def tries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with an AV that tries to get out, and what it may try it on."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tries.py").write_text(TRIES, encoding="utf-8")
    elsewhere = Path(os.environ.get("TMPDIR", "/tmp")) / f"cornerforge-elsewhere-{os.getpid()}"
    elsewhere.mkdir()
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_UNIX) as unix:
        unix.bind(str(elsewhere / "socket"))
        unix.listen()
        about = {
            "port": server.getsockname()[1], "unix": str(elsewhere / "socket"), "pid": os.getpid(),
            "package": str(Path(cornerforge.__file__).parent), "home": str(Path.home()), "elsewhere": str(elsewhere),
            "devices": ["fd", "full", "null", "random", "shm", "stderr", "stdin", "stdout", "tty", "urandom", "zero"],
            "is_hidden": not str(tmp_path).startswith("/tmp/") or tmp_path.parent != Path("/tmp"),
        }  # fmt: skip
        monkeypatch.setenv("ABOUT", json.dumps(about))
        yield tmp_path
    shutil.rmtree(elsewhere)


def found_by(confines: Confines) -> dict[str, Any]:
    """What the AV that tries to get out finds."""
    with pytest.raises(InputError, match="FOUND") as refusal:
        AvProcess("tries:Av", timeout=60.0, first_timeout=60.0, confines=confines)
    text = str(refusal.value)
    found: dict[str, Any] = json.loads(text[text.index("{") : text.rindex("}") + 1])
    return found


@needs_walls
def test_nothing_gets_out(tries: Path) -> None:
    found = found_by(WALLS)
    assert found.pop("outside") in ("ENETUNREACH", "ENETDOWN")
    assert found.pop("host") == "ECONNREFUSED"
    assert found.pop("unix") == "ENOENT"
    assert found.pop("host's tmp") == "ENOENT"
    assert (found.pop("here"), found.pop("package"), found.pop("home")) == ("EROFS",) * 3
    assert found.pop("tmp") == "written"
    assert found.pop("scratch").startswith("/dev/shm/")
    assert found.pop("kill") == "ESRCH"
    assert found.pop("mount") == "EPERM"
    assert [name for name in found.pop("devices") if not str(name).startswith(("nvidia", "dri", "kfd"))] == []
    assert found.pop("processes") <= 3
    assert found == {"child": "child\n"}
    assert sorted(path.name for path in tries.iterdir() if path.suffix != ".log") == ["tries.py"]


def test_without_walls_it_may_do_what_its_user_may(tries: Path) -> None:
    """The trials above find what is there: nothing of them fails by itself."""
    found = found_by(Confines())
    assert (found["host"], found["unix"], found["here"]) == ("connected", "connected", "written")
    assert found["kill"] == "None"
    (tries / "here").unlink()
    for place in ("package", "home"):
        if found[place] == "written":
            (Path(json.loads(os.environ["ABOUT"])[place]) / "x").unlink()


@needs_walls
def test_its_results_are_the_same(tries: Path, capsys: pytest.CaptureFixture[str]) -> None:
    free, walled = (cornerforge.simulate(av="tries:Good", tests=8, av_sandbox=on) for on in (False, True))
    assert free.digest == walled.digest
    assert (
        main(["simulate", "--av", "tries:Good", "--tests", "4", "--av-sandbox", "--av-memory", "2", "--out", "lib"])
        == 0
    )
    made = json.loads((tries / "lib" / "provenance.json").read_text(encoding="utf-8"))
    assert made["avs_from_outside"]["tries:Good"] == {"sandbox": True, "memory_gb": 2.0, "python": sys.executable}
    capsys.readouterr()
    assert main(["check-av", "tries:Good", "--tests", "2"]) in (0, 1)
    assert "sandbox off: it may do what you may (--av-sandbox); memory: " in capsys.readouterr().out


@needs_walls
def test_walls_that_fail_only_when_it_starts_are_one_line(tries: Path) -> None:  # noqa: ARG001
    """Behind walls there can be no further ones."""
    with pytest.raises(InputError, match=r"FOUND .*InputError: The AV's process cannot be started: new namespaces: "):
        AvProcess("tries:Nested", timeout=60.0, first_timeout=60.0, confines=WALLS)


@needs_walls
def test_a_program_drives_behind_walls(tries: Path) -> None:
    source = Path(__file__).parents[2] / "examples" / "planner.c"
    if shutil.which("cc") is None or not source.exists():
        pytest.skip("there is no C compiler")
    subprocess.run(["cc", "-O2", "-o", tries / "planner", source, "-lm"], check=True)
    process = AvProcess("cmd: ./planner", timeout=20.0, first_timeout=20.0, confines=WALLS)
    process.setup(context_of(Odd(), batch=1, seed=0))
    assert process.about["kind"] == "program"
    process.close()


def test_where_there_are_no_walls_it_does_not_run(tries: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    monkeypatch.setattr(interpreter, "_tried", lambda command: f"{Path(command[0]).name} says no")
    monkeypatch.setattr("shutil.which", lambda name: f"/bin/{name}")
    interpreter._walls.cache_clear()
    with pytest.raises(
        InputError, match=r"av_sandbox: this system makes no walls .* bubblewrap fails \(bwrap says no\)"
    ):
        AvProcess("tries:Good", timeout=20.0, first_timeout=20.0, confines=WALLS)
    monkeypatch.setattr("shutil.which", lambda name: None)  # noqa: ARG005
    with pytest.raises(InputError, match=r"bubblewrap \(bwrap\) is not installed"):
        cornerforge.simulate(av="tries:Good", tests=1, av_sandbox=True)
    interpreter._walls.cache_clear()


@needs_walls
@pytest.mark.skipif(shutil.which("bwrap") is None, reason="bubblewrap is not installed")
def test_bubblewrap_does_it_where_the_system_does_not(tries: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    tried = interpreter._tried
    monkeypatch.setattr(interpreter, "_tried", lambda command: "no" if command[0] == sys.executable else tried(command))
    interpreter._walls.cache_clear()
    try:
        found = found_by(WALLS)
    finally:
        interpreter._walls.cache_clear()
    assert found["host"] == "ECONNREFUSED"
    assert (found["here"], found["package"], found["home"]) == ("EROFS",) * 3
    assert (found["unix"], found["host's tmp"], found["tmp"]) == ("ENOENT", "ENOENT", "written")
    assert found["child"] == "child\n"


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"av_memory": 0.1}, "av_memory = 0.1 GB is out of range"),
        ({"av_memory": float("nan")}, "av_memory = nan"),
        ({"av": "idm-mobil", "av_memory": 2.0}, "av_memory is for AVs that are not built in"),
        ({"av": "idm-mobil", "av_sandbox": True}, "av_sandbox is for AVs that are not built in"),
    ],
)
def test_options_are_checked(tries: Path, options: dict[str, object], text: str) -> None:  # noqa: ARG001
    with pytest.raises(InputError, match=text):
        cornerforge.simulate(**({"av": "tries:Good", "tests": 1} | options))  # type: ignore[arg-type]


def test_a_network_that_asks_for_much_memory_is_one_line(tries: Path) -> None:
    """An ONNX file of some hundred bytes whose tensor takes 16 GB."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    size = helper.make_tensor("size", onnx.TensorProto.INT64, [2], [1 << 16, 1 << 16])
    nodes = [
        helper.make_node("ConstantOfShape", ["size"], ["big"]),
        helper.make_node("ReduceSum", ["big"], ["sum"], keepdims=0),
        helper.make_node("Flatten", ["view"], ["flat"], axis=1),
        helper.make_node("ReduceMean", ["flat"], ["mean"], axes=[1], keepdims=1),
        helper.make_node("Add", ["mean", "sum"], ["one"]),
        helper.make_node("Concat", ["one", "one"], ["out"], axis=1),
    ]
    graph = helper.make_graph(
        nodes, "big", [helper.make_tensor_value_info("view", kind, ["B", 13, 8])],
        [helper.make_tensor_value_info("out", kind, ["B", 2])], [size],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    (tries / "big.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(CornerForgeError) as failure:
        cornerforge.simulate(av="big.onnx", tests=1, av_memory=2.0)
    said = str(failure.value)
    assert "big.onnx" in said
    assert "\n" not in said
