"""Without what only POSIX has all modules are imported, and the core runs; AVs from outside are refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
EXAMPLE = HERE.parent / "examples" / "my_av.py"
NEED_ALL = {"cornerforge.foreign.keeper", "cornerforge.foreign.worker"}
"""Parts of the process of an AV from outside, which is not started there."""
IMPORT_ALL = f"""
import importlib, pkgutil, sys, cornerforge
for one in pkgutil.walk_packages(cornerforge.__path__, "cornerforge."):
    if one.name not in {NEED_ALL} and not one.name.endswith("__main__"):
        importlib.import_module(one.name)
assert "fcntl" not in sys.modules
"""
LINES = (
    "simulate --av flawed-brakes-late --tests 500 --out lib",
    "analyse lib",
    "query lib 'select count(*) as n from cases'",
    "report lib --out page",
    "replay lib all --check",
    "train --decisions 4096 --tests 64 --out p.safetensors",
    "generate --policy p.safetensors --av flawed-brakes-late --cases 5 --out made",
    "rate --av flawed-brakes-late --max-tests 1000 --out rated",
)


def run(*words: str, where: Path) -> subprocess.CompletedProcess[str]:
    paths = [str(HERE / "without_posix"), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    return subprocess.run([sys.executable, *words], cwd=where, env=environment, capture_output=True, text=True)


def test_all_modules_are_imported(tmp_path: Path) -> None:
    done = run("-W", "ignore", "-c", IMPORT_ALL, where=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.full
def test_the_core_runs(tmp_path: Path) -> None:
    program = "import shlex, sys; from cornerforge.cli import main; sys.exit(main(shlex.split(sys.argv[1])))"
    for line in LINES:
        done = run("-c", program, line, where=tmp_path)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    assert (tmp_path / "page" / "report.html").stat().st_size > 1_000_000


def test_an_av_from_outside_is_refused_in_one_line(tmp_path: Path) -> None:
    done = run("-m", "cornerforge", "check-av", f"{EXAMPLE}:MyAv", where=tmp_path)
    assert (done.returncode, done.stderr) == (
        2,
        "cornerforge: An AV from outside runs in a process group of its own, which this system does not have.\n",
    )
