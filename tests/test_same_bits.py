"""The same bits under other C libraries, processors, vector extensions and levels of optimisation.

What is compared is made by `bits_of_this_machine.py` in processes of their own. The cases are compared with a file as
well, so that every machine that runs this test is compared with the one that wrote it.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from bits_of_this_machine import recorded_cases

import cornerforge

WORKER = Path(__file__).with_name("bits_of_this_machine.py")
GOLDEN = Path(__file__).parent / "golden" / "recorded_cases.txt"
OLD_LIBRARY = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX512F"}
"""The C library takes its functions for processors without fused multiply-adds."""
MACHINES = {
    "generic": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "without-vectors": {"NUMBA_CPU_FEATURES": "-avx,-avx2,-avx512f,-fma"},
    "little-optimised": {"NUMBA_OPT": "1"},
    "generic-and-old-library": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", **OLD_LIBRARY},
}
QUICK, SLOW = 3_000, 60_000

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(
        platform.machine() not in ("x86_64", "AMD64") or platform.libc_ver()[0] != "glibc",
        reason="names processors of x86-64 and tunables of the GNU C library",
    ),
]


def bits(*arguments: str, surroundings: dict[str, str] | None = None, cache: Path | None = None) -> tuple[str, str]:
    """What the worker prints in these surroundings: the line on the C library, and the rest."""
    paths = (Path(cornerforge.__file__).parents[1], WORKER.parent)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths)), **(surroundings or {})}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    command = [sys.executable, str(WORKER), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    library, _, rest = done.stdout.partition("\n")
    return library, rest


def test_recorded_cases_are_those_of_the_file(golden: Callable[[str, str], None]) -> None:
    golden(GOLDEN.name, recorded_cases())


def test_another_c_library_changes_no_bit() -> None:
    assert bits("tests", str(QUICK), surroundings=OLD_LIBRARY)[1] == bits("tests", str(QUICK))[1]
    assert bits("cases", surroundings=OLD_LIBRARY)[1] == GOLDEN.read_text(encoding="utf-8")


def test_the_other_c_library_is_another() -> None:
    # Negative control: what the library itself gives differs, so the test above does compare two libraries.
    here, there = bits("functions"), bits("functions", surroundings=OLD_LIBRARY)
    if here[0] == there[0]:
        pytest.skip("this processor or C library knows one set of functions only")
    assert here[1] == there[1]


@pytest.mark.parametrize("name", MACHINES)
def test_other_machines_compute_the_same_functions(name: str, tmp_path: Path) -> None:
    assert bits("functions", surroundings=MACHINES[name], cache=tmp_path)[1] == bits("functions")[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*MACHINES, "old-library"])
def test_other_machines_drive_the_same_tests(name: str, tmp_path: Path) -> None:
    """All kernels are compiled anew for each: minutes."""
    surroundings = MACHINES.get(name, OLD_LIBRARY)
    assert bits("tests", str(SLOW), surroundings=surroundings, cache=tmp_path)[1] == bits("tests", str(SLOW))[1]
    assert bits("cases", surroundings=surroundings, cache=tmp_path)[1] == GOLDEN.read_text(encoding="utf-8")
