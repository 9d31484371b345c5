"""The Python in which an AV's process runs: the simulator's own, or another one that the user names.

The process needs the standard library and NumPy only. Another interpreter finds this package, and nothing else of the
simulator's environment, by its folder.
"""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

from cornerforge.errors import InputError

__all__ = ["OLDEST_PYTHON", "check_interpreter", "environment", "worker_command"]

OLDEST_PYTHON = (3, 9)
"""Oldest Python in which an AV's process runs."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
_PROBE_SECONDS = 60.0
_PACKAGE = Path(__file__).parents[1]
# Any Python must be able to read both: no f-strings, and print with brackets and one argument.
_LOOK = """
import sys
sys.path[:] = [place for place in sys.path if place]
try:
    import numpy
    found = numpy.__version__
except Exception:
    found = "none"
print("cornerforge-python %d %d %s" % (sys.version_info[0], sys.version_info[1], found))
"""
_BEGIN = """
import sys
sys.path[:] = [place for place in sys.path if place]
import importlib.util
folder = sys.argv[1]
spec = importlib.util.spec_from_file_location(
    "cornerforge", folder + "/__init__.py", submodule_search_locations=[folder])
sys.modules["cornerforge"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules["cornerforge"])
from cornerforge.foreign.worker import main
main(*map(int, sys.argv[2:]))
"""


def environment(python: str | None) -> dict[str, str]:
    """Give the environment variables of an AV's process, in the interpreter `python`; None: the simulator's own."""
    variables = dict.fromkeys(_ONE_THREAD, "1") | dict(os.environ)
    if python is None:
        search = [str(_PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
        variables["PYTHONPATH"] = os.pathsep.join(search)
    return variables


def worker_command(python: str | None, *numbers: int) -> list[str]:
    """Give the command that starts an AV's process, with file numbers for `worker.main`.

    Raises:
        InputError: `python` is no interpreter in which it can run.
    """
    words = [str(number) for number in numbers]
    if python is None:
        return [sys.executable, "-P", "-m", "cornerforge.foreign.worker", *words]
    return [check_interpreter(python), "-c", _BEGIN, str(_PACKAGE), *words]


def check_interpreter(python: str) -> str:
    """Look whether an AV's process can run in an interpreter, and give its path.

    Raises:
        InputError: There is none of that name, it is too old, or it has no NumPy.
    """
    path = shutil.which(python)
    if path is None:
        why = "is a folder" if Path(python).is_dir() else "cannot be run" if Path(python).exists() else "is not there"
        raise InputError(
            f"av_python = {python!r} {why}; give the path of a Python interpreter, such as env/bin/python."
        )
    return _looked_at(path, os.environ.get("PYTHONPATH"))


@functools.lru_cache(maxsize=16)
def _looked_at(path: str, search: str | None) -> str:  # noqa: ARG001 - what is found depends on it
    try:
        answer = subprocess.run(
            [path, "-c", _LOOK],
            env=environment(path),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_PROBE_SECONDS,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        why = "it does not end" if isinstance(error, subprocess.TimeoutExpired) else error.strerror
        raise InputError(f"av_python = {path!r} is no Python interpreter: {why}.") from error
    printed = answer.stdout.decode(errors="replace")
    said = printed.partition("cornerforge-python ")[2].split()
    if len(said) < 3 or answer.returncode != 0:
        shown = " ".join((printed or answer.stderr.decode(errors="replace")).split())[:100] or "nothing"
        raise InputError(f"av_python = {path!r} is no Python interpreter: asked for its version, it printed {shown}.")
    version = int(said[0]), int(said[1])
    if version < OLDEST_PYTHON:
        raise InputError(
            f"av_python = {path!r} is Python {version[0]}.{version[1]}; an AV's process needs "
            f"{OLDEST_PYTHON[0]}.{OLDEST_PYTHON[1]} or later."
        )
    if said[2] == "none":
        raise InputError(
            f"av_python = {path!r} has no NumPy, which an AV's process needs; install it: {path} -m pip install numpy"
        )
    return path
