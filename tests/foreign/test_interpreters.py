"""An AV in another Python: what its process needs there, and interpreters in which it cannot run."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import FileFormatError, InputError
from cornerforge.foreign import interpreter
from cornerforge.foreign.interpreter import OLDEST_PYTHON, Confines, check_interpreter
from cornerforge.foreign.process import AvProcess

pytestmark = pytest.mark.full

PACKAGE = Path(cornerforge.__file__).parent
OWN = (
    "import sys, numpy as np\n"
    "import only_there  # is nowhere but in the AV's own environment\n"
    "class Own:\n"
    "    def act(self, view):\n"
    "        a = np.clip(0.3 * (30.0 - view[:, 0, 3]), -3, 1)\n"
    "        return np.stack([a, np.zeros(len(view))], axis=1)\n"
    "class Planner:\n"
    "    memory = False\n"
    "    def plan(self, scene):\n"
    "        return min(max(0.3 * (np.float32(30.0) - np.float32(scene.own.vx)), -3), 1), 0\n"
    "class Policy:\n"
    "    def predict(self, observation, deterministic=True):\n"
    "        return np.array([0.25 if observation[0, 3] < 30 else 0.0, 0.0]), None\n"
)


@pytest.fixture(scope="session")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Python of its own, with NumPy and without cornerforge and all else that the simulator needs."""
    folder = tmp_path_factory.mktemp("other")
    venv.create(folder / "env", symlinks=True, with_pip=False)
    python = folder / "env" / "bin" / "python"
    packages = Path(
        subprocess.check_output(
            [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], text=True
        ).strip()
    )
    place = Path(np.__file__).parents[1]
    for name in ("numpy", "numpy.libs"):
        if (place / name).is_dir():
            (packages / name).symlink_to(place / name)
    (packages / "only_there.py").write_text("", encoding="utf-8")
    return python


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    return tmp_path


def test_it_drives_in_an_interpreter_that_has_numpy_only(other: Path, own: Path) -> None:
    for package in ("numba", "cornerforge"):
        there = subprocess.run([other, "-c", f"import {package}"], cwd="/", capture_output=True, check=False)
        assert there.returncode == 1
    with pytest.raises(InputError, match="No module named 'only_there'"):
        cornerforge.simulate(av="own:Own", tests=1)
    first, second = (
        cornerforge.simulate(av=f"own:{name}", av_python=str(other), tests=30) for name in ("Own", "Planner")
    )
    assert first.av_faults == second.av_faults == 0
    assert first.digest == second.digest
    assert cornerforge.simulate(av="own:Policy", av_python=str(other), tests=10).av_faults == 0
    (own / "only_there.py").write_text("", encoding="utf-8")
    assert cornerforge.simulate(av="own:Own", tests=30).digest == first.digest


def test_libraries_do_not_remember_it_and_replay_takes_it(other: Path, own: Path) -> None:
    made = cornerforge.simulate(av="own:Own", av_python=str(other), tests=60, out=own / "lib", bv="swerve")
    assert made.cases
    identity = json.loads((own / "lib" / "provenance.json").read_text(encoding="utf-8"))["identity"]
    assert not any(str(other) in str(value) for value in identity.values())
    assert cornerforge.replay(own / "lib", "all", check=True, av_python=str(other)).identical is True
    with pytest.raises(InputError, match="only_there"):
        cornerforge.replay(own / "lib", "all")


def test_check_av_takes_it(other: Path, own: Path, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: ARG001
    assert main(["check-av", "own:Own", "--av-python", str(other), "--tests", "4"]) == 0
    assert capsys.readouterr().out.startswith("own:Own (class, ")


def script(folder: Path, text: str) -> str:
    path = folder / "script"
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("echo hello", "is no Python interpreter: asked for its version, it printed hello"),
        ("exit 3", "is no Python interpreter: asked for its version, it printed nothing"),
        ("echo cornerforge-python 3 8 1.24.4", r"is Python 3.8; an AV's process needs 3.9 or later"),
        ("echo cornerforge-python 2 7 none", r"is Python 2.7; an AV's process needs 3.9 or later"),
        ("echo cornerforge-python 3 12 none", r"has no NumPy, .* install it: \S+ -m pip install numpy"),
    ],
)
def test_interpreters_in_which_it_cannot_run_are_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as refusal:
        check_interpreter(script(tmp_path, text))
    assert "\n" not in str(refusal.value)


def test_an_environment_without_numpy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONPATH", raising=False)
    venv.create(tmp_path / "bare", symlinks=True, with_pip=False)
    with pytest.raises(InputError, match="has no NumPy"):
        check_interpreter(str(tmp_path / "bare" / "bin" / "python"))


def test_what_is_no_file_to_run_is_named(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("text", encoding="utf-8")
    (tmp_path / "damaged").write_bytes(b"\x7fELF")
    (tmp_path / "damaged").chmod(0o755)
    for name, said in (
        ("gone", "is not there"),
        ("", "is a folder"),
        ("text", "cannot be run"),
        ("damaged", "is no Python interpreter: Exec format error"),
    ):
        with pytest.raises(InputError, match=said):
            check_interpreter(str(tmp_path / name))


def test_a_built_in_av_takes_none() -> None:
    with pytest.raises(InputError, match="av_python is for AVs that are not built in; idm-mobil is"):
        cornerforge.simulate(tests=1, av_python=sys.executable)


def test_what_its_process_may_import_reads_as_the_oldest_python() -> None:
    """The modules that an AV's process loads read as the oldest Python, and call nothing newer."""
    for name in ("__init__", "_doors", "_checks", "errors", "types"):
        ast.parse((PACKAGE / f"{name}.py").read_text(encoding="utf-8"), feature_version=OLDEST_PYTHON)
    for path in (PACKAGE / "foreign").glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        runs_there = path.stem in (
            "__init__", "drivers", "interface", "loaders", "networks", "policies", "programs", "protocol", "scene",
            "sb3_file", "onnx_file", "worker",
        )  # fmt: skip
        if not runs_there:
            continue
        ast.parse(path.read_text(encoding="utf-8"), feature_version=OLDEST_PYTHON)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "zip":
                assert not any(word.arg == "strict" for word in node.keywords), f"{path.name}:{node.lineno}"
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                assert node.func.attr not in ("add_note", "pairwise"), f"{path.name}:{node.lineno}"


def test_its_process_imports_numpy_and_the_standard_library_only(tmp_path: Path) -> None:
    """All modules that a process loads, of all forms that need no library of their own."""
    looked = (
        "import sys; before = set(sys.modules)\n"
        "import cornerforge.foreign.worker, cornerforge.foreign.loaders, cornerforge.foreign.policies\n"
        "names = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
        "print(sorted(names - set(sys.stdlib_module_names) - {'cornerforge', 'numpy'}))\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", looked],
        env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == "[]"


def test_files_need_their_libraries_there(other: Path, own: Path) -> None:
    (own / "net.onnx").write_bytes(b"no network")
    with pytest.raises((InputError, FileFormatError), match="onnxruntime"):
        AvProcess("net.onnx", timeout=20.0, first_timeout=60.0, confines=Confines(str(other)))


def test_it_is_looked_at_once(tmp_path: Path) -> None:
    count = tmp_path / "count"
    python = script(tmp_path, f"echo x >> {count}\necho cornerforge-python 3 12 2.0.0")
    for _ in range(3):
        check_interpreter(python)
    assert count.read_text(encoding="utf-8") == "x\n"
    interpreter._looked_at.cache_clear()
