"""Kernels are compiled whole: what is called from Python once, what it calls only as parts of it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cornerforge._jit
from cornerforge._jit import announce_compiling, inlined_kernel, kernel

CACHED = """
import numpy as np
from cornerforge.geometry import boxes_overlap
boxes_overlap(0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 5.0, 2.0)
print(sum(boxes_overlap.stats.cache_hits.values()), sum(boxes_overlap.stats.cache_misses.values()))
"""


@inlined_kernel
def _doubled(values, i):
    return 2.0 * values[i]


@kernel
def _first(values):
    return _doubled(values, 0) + 1.0


@kernel
def _chosen(values, i):
    if i > 7:
        raise ValueError("no such value")
    return _doubled(values, i) - _doubled(values, 1)


@kernel
def _all(values, i):
    return _first(values) * _chosen(values, i)


def _versions(function: Any) -> tuple[int, int]:
    """How often it was compiled as a program, and as a part of one."""
    return len(function.overloads), len(function._part.overloads)


def test_a_program_calls_its_parts_and_python_calls_any_of_them() -> None:
    """Three levels, one part reached on two ways: values as by hand, wherever the call comes from."""
    values = np.array([3.0, 5.0, 11.0])

    assert _all(values, 2) == (2 * 3.0 + 1.0) * (2 * 11.0 - 2 * 5.0)
    assert _versions(_all) == (1, 0)
    for part in (_first, _chosen, _doubled):
        assert _versions(part) == (0, 1), "no machine code of its own, and one version for 0, 1 and i"

    assert _first(values) == 7.0
    assert _doubled(values, 1) == 10.0
    assert _first(values.astype(np.float32)) == 7.0


def test_a_part_that_raises_reaches_python() -> None:
    """The exception comes out of the program that the part is in."""
    with pytest.raises(ValueError, match="no such value"):
        _all(np.ones(3), 8)


def test_compiling_is_announced_once() -> None:
    """Said when the first kernel is compiled, not for those after it and not for what is there."""
    said = []
    announce_compiling(lambda: said.append("compiling"))

    assert said == []
    _first(np.ones(3, np.int64))
    _doubled(np.ones(3, np.int64), 0)
    assert said == ["compiling"]


def test_every_kernel_is_in_the_name_of_the_cache() -> None:
    """Otherwise an edit of it would go on with stale machine code."""
    package = Path(cornerforge._jit.__file__).parent
    counted = {path for pattern in cornerforge._jit._SOURCES for path in package.glob(pattern)}
    defining = {path for path in package.rglob("*.py") if re.search(r"^@(inlined_)?kernel$", path.read_text(), re.M)}
    assert len(defining) > 20
    assert defining <= counted


def test_machine_code_is_kept_for_the_next_process(tmp_path: Path) -> None:
    """The second process reads what the first compiled."""
    seen = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", CACHED], capture_output=True, text=True, check=True,
            env={"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[1] / "src")},
        )  # fmt: skip
        seen.append(done.stdout.split())
    assert seen == [["0", "1"], ["1", "0"]]
