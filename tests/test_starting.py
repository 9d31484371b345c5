"""What a start loads: what it does not need it does not wait for. (`--help` and `--version`: test_front_page.py.)"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from scipy.special import betaincinv

import cornerforge._jit
from cornerforge.rates import binomial_interval


def loaded_by(code: str, cwd: Path) -> set[str]:
    """Names of all modules after some code, in a process of its own."""
    code += "; import sys; print(*sorted(sys.modules), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=cwd)
    return set(done.stderr.splitlines()[-1].split())


def test_simulate_loads_what_drives_tests_and_no_more(tmp_path: Path) -> None:
    """Nothing slow of SciPy (0.4 s), nothing that reads libraries or trajectories, no results of other commands."""
    run = "from cornerforge.cli import main; assert main(['simulate', '--tests', '2', '--quiet']) == 0"
    loaded = loaded_by(run, tmp_path)
    assert {"numba", "cornerforge.verbs.simulate"} <= loaded
    packages = {
        "torch",
        "scipy.linalg",
        "scipy.special",
        "pyarrow",
        "rich",
        "sklearn",
        "matplotlib",
        "plotly",
        "jinja2",
        "duckdb",
    }
    assert not packages & loaded
    own = {
        "library",
        "ext.calibrate.fit",
        "ext.calibrate.readers",
        "results.whole",
        "results.retest",
        "library.filling",
    }
    assert not {f"cornerforge.{name}" for name in own} & loaded


@pytest.mark.full
def test_a_library_is_loaded_where_crashes_are_stored(tmp_path: Path) -> None:
    run = "import cornerforge; cornerforge.simulate(tests=2, out='crashes')"
    assert {"pyarrow", "cornerforge.library"} <= loaded_by(run, tmp_path)


@pytest.mark.parametrize("package", ["cornerforge", "cornerforge.results", "cornerforge.ndd", "cornerforge.sim"])
def test_a_package_loads_nothing_by_itself(package: str, tmp_path: Path) -> None:
    assert not {"numpy", "numba", "scipy", "pyarrow"} & loaded_by(f"import {package}", tmp_path)


def test_kernels_load_no_blas(tmp_path: Path) -> None:
    assert "scipy.linalg" not in loaded_by("import cornerforge._jit", tmp_path)


def test_somebody_elses_kernel_can_multiply_matrices() -> None:
    """Numba looks for BLAS when it compiles such a kernel, as it would without us."""
    assert cornerforge._jit.kernel is not None
    assert numba.np.linalg.ensure_blas.__module__ == "numba.np.linalg"
    product = numba.njit(lambda a, b: a @ b)
    a = np.arange(6.0).reshape(2, 3)
    assert (product(a, a.T.copy()) == a @ a.T).all()


def test_no_crash_gives_the_bits_of_the_beta_quantile() -> None:
    for confidence in (0.5, 0.9, 0.95, 0.99, 0.999999):
        upper = 1.0 - 0.5 * (1.0 - confidence)
        for tests in (*range(1, 300), 1000, 262_144, 10**6, 10**9):
            assert binomial_interval(0, tests, confidence) == (0.0, float(betaincinv(1, tests, upper)))
