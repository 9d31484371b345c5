"""Surroundings of an AV's process: the simulator's own Python or another one, and how much memory.

The process needs the standard library and NumPy only. Another interpreter finds this package, and nothing else of the
simulator's environment, by its folder.
"""

from __future__ import annotations

import functools
import json
import os
import shlex
import shutil
import subprocess
import sys
import weakref
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cornerforge._checks import check_number
from cornerforge.errors import InputError

__all__ = ["AT_WORK", "MARK", "OLDEST_PYTHON", "USUAL", "Confines", "check_interpreter", "environment", "in_use",
           "worker_command"]  # fmt: skip

OLDEST_PYTHON = (3, 9)
"""Oldest Python in which an AV's process runs."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
MARK = "CORNERFORGE_AV"
"""Environment variable by which the processes of an AV are known."""
_LEAST_GB, _MOST_GB = 0.25, 1e6
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
from cornerforge.foreign.keeper import main
main(sys.argv[2])
"""


@dataclass(frozen=True)
class Confines:
    """Surroundings of an AV's process.

    Attributes:
        python: Interpreter; None: the simulator's own.
        memory: Memory that it may take with all that it starts [GB], 0.25 or more; None: half of the machine's.
    """

    python: str | None = None
    memory: float | None = None

    def check(self) -> None:
        """Check what can be checked before an AV's process is started.

        Raises:
            InputError: There is no such interpreter, or too little memory.
        """
        if self.memory is not None:
            check_number("av_memory", self.memory, low=_LEAST_GB, high=_MOST_GB, unit="GB")
        if self.python is not None:
            check_interpreter(self.python)

    def options(self) -> str:
        """Write it as options of the command line, with a blank before each."""
        python = "" if self.python is None else f" --av-python {shlex.quote(self.python)}"
        memory = "" if self.memory is None else f" --av-memory {self.memory:g}"
        return python + memory

    @property
    def gigabytes(self) -> float:
        """Memory that the AV may take [GB]."""
        return _half_of_the_machine() if self.memory is None else self.memory


USUAL = Confines()
"""The simulator's own Python, half of the machine's memory."""
AT_WORK: weakref.WeakKeyDictionary[object, tuple[str, Confines]] = weakref.WeakKeyDictionary()
"""Names of the AVs from outside that are at work, and in what they run, by the objects that ask them."""


def in_use() -> dict[str, dict[str, Any]]:
    """Say in what the AVs from outside run that are at work, by their names; JSON-compatible."""
    return {
        spec: {"memory_gb": round(one.gigabytes, 3), "python": one.python or sys.executable}
        for spec, one in list(AT_WORK.values())
    }


@functools.cache
def _half_of_the_machine() -> float:
    """Give half of the memory that the machine has, or that its container may take [GB]."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with suppress(OSError, ValueError):
        whole = min(whole, int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii")))
    return max(_LEAST_GB, 0.5 * whole / 1e9)


def environment(confines: Confines, mark: str = "") -> dict[str, str]:
    """Give the environment variables of an AV's process; by `mark` it is known."""
    variables = dict.fromkeys(_ONE_THREAD, "1") | dict(os.environ) | {MARK: mark}
    if confines.python is None:
        search = [str(_PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
        variables["PYTHONPATH"] = os.pathsep.join(search)
    return variables


def worker_command(confines: Confines, connection: int, line: int) -> list[str]:
    """Give the command that starts an AV's process.

    Args:
        confines: In what it runs.
        connection, line: File numbers for `keeper.main`.

    Raises:
        InputError: It cannot run in that.
    """
    python = sys.executable if confines.python is None else check_interpreter(confines.python)
    how = {"socket": connection, "line": line, "memory": int(1e9 * confines.gigabytes)}
    return [python, "-c", _BEGIN, str(_PACKAGE), json.dumps(how)]


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
            env=environment(Confines(path)),
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
