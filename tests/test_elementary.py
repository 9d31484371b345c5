"""The elementary functions of kernels against mpmath, in units in the last place; and that nothing else is called."""

from __future__ import annotations

import ast
import math
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from reference.elementary import plain_functions

import cornerforge._jit
from cornerforge._elementary import _F, _ODD, _QUARTER, SIN_COS_LIMIT, atan, exp, log, sin_cos

BOUND = 0.9
"""Ulp; what the docstrings promise."""
TINY = 5e-324
QUICK, SLOW = 8_000, 1_000_000

Function = Callable[[float], float]
Values = NDArray[np.float64]


def sine(x: float) -> float:
    return sin_cos(x)[0]


def cosine(x: float) -> float:
    return sin_cos(x)[1]


def ulps(found: float, true: mpmath.mpf) -> float:
    """How far off a number is, in units in the last place of the true value (at least 2^-1074)."""
    if true == 0:
        return 0.0 if found == 0.0 else math.inf
    _, exponent = mpmath.frexp(true)
    return float(mpmath.ldexp(abs(mpmath.mpf(found) - true), -max(int(exponent) - 53, -1074)))


def around(values: Values, reach: int = 3) -> Values:
    """Values and their neighbours among the numbers."""
    found = [values]
    for direction in (-math.inf, math.inf):
        near = values
        for _ in range(reach):
            near = np.nextafter(near, direction)
            found.append(near)
    return np.unique(np.concatenate(found))


def hard_angles() -> Values:
    """Angles that nearly cancel against a multiple of pi / 2, the nearest of 333,772, and those halfway between two."""
    bits = 200
    quarter = int(mpmath.ldexp(mpmath.pi / 2, bits))
    n = np.arange(1, int(SIN_COS_LIMIT / (math.pi / 2)))
    near = n * (math.pi / 2)  # rounded; the number nearest to the multiple is this one or a neighbour
    candidates = np.concatenate([near, np.nextafter(near, 0.0), np.nextafter(near, math.inf)])
    apart = [
        abs(int(math.ldexp(x, 60)) * 2 ** (bits - 60) - int(k) * quarter)
        for x, k in zip(candidates, np.tile(n, 3), strict=True)
    ]
    nearest = candidates[np.argsort(np.array(apart, float))[:1000]]
    half = (n[:: n.size // 300] - 0.5) * (math.pi / 2)
    return around(np.concatenate([nearest, half, [0.7853981633974483, SIN_COS_LIMIT, 2.0**-27]]), 1)


class Case(NamedTuple):
    """A function, what it should be, where it is tried, and its hard places."""

    function: Function
    true: Callable[[mpmath.mpf], mpmath.mpf]
    ranges: tuple[tuple[float, float], ...]
    hard: Callable[[], Values]


def _hard_exp() -> Values:
    steps = (np.arange(-1075, 1025) + 0.5) * math.log(2.0)
    ends = [709.782712893384, -708.3964185322641, -745.1332191019411, -744.4400719213812, 0.0, 1e-300, -1e-300, TINY]
    points = around(np.concatenate([steps[(steps > -745.0) & (steps < 709.7)], ends]), 1)
    return points[points <= ends[0]]


def _hard_log() -> Values:
    seams = math.sqrt(0.5) * 2.0 ** np.arange(-1021, 1024.0)
    return np.abs(around(np.concatenate([seams, 2.0 ** np.arange(-1074, 1024.0), [TINY, 2.3e-308]]), 1)[1:])


def _hard_atan() -> Values:
    eighths = np.array([0.1875, 0.375, 0.625, 0.875, 1.0, 0.25, 0.5, 0.75])
    seams = np.concatenate([eighths, 1.0 / eighths, [8.0, 2.0**54, 2.0**53, 2.0**-27, TINY, 1.7e308]])
    return around(np.concatenate([seams, -seams]), 20)


CASES = {
    "exp": Case(exp, mpmath.exp, ((-1.0, 1.0), (-745.0, -708.0), (-708.0, 709.7)), _hard_exp),
    "log": Case(log, mpmath.log, ((0.0, 1.0), (0.5, 2.1), (2.1, 1e9)), _hard_log),
    "sin": Case(sine, mpmath.sin, ((-0.8, 0.8), (0.0, 6.3), (-1e3, 1e3), (-SIN_COS_LIMIT, SIN_COS_LIMIT)), hard_angles),
    "cos": Case(
        cosine, mpmath.cos, ((-0.8, 0.8), (0.0, 6.3), (-1e3, 1e3), (-SIN_COS_LIMIT, SIN_COS_LIMIT)), hard_angles
    ),
    "atan": Case(atan, mpmath.atan, ((-0.2, 0.2), (0.18, 1.01), (-6.0, -1.0), (-1e3, 1e3)), _hard_atan),
}


def sample(case: Case, n: int, seed: int) -> Values:
    """Uniform on each range, and as many whose size is log-uniform on the function's whole domain."""
    rng = np.random.default_rng(seed)
    per = n // (len(case.ranges) + 1)
    parts = [rng.uniform(low, high, per) for low, high in case.ranges]
    low, high = min(low for low, _ in case.ranges), max(high for _, high in case.ranges)
    size = 2.0 ** rng.uniform(-1074.0, math.log2(high) if case.function is not log else 1023.99, per)
    parts.append(size * rng.choice([-1.0, 1.0], per) if low < 0.0 else size)
    return np.concatenate(parts)


def worst(function: Function, true: Callable[[mpmath.mpf], mpmath.mpf], points: Values) -> tuple[float, float]:
    """The largest error [ulp], and where."""
    found = (0.0, math.nan)
    with mpmath.workprec(160):
        for x in points.tolist():
            found = max(found, (ulps(function(x), true(mpmath.mpf(x))), x))
    return found


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", CASES)
def test_errors_are_below_the_bound(name: str, seed: int) -> None:
    case = CASES[name]
    error, where = worst(case.function, case.true, sample(case, QUICK, seed))
    assert error < BOUND, f"{name}({where.hex()}) is {error} ulp off"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", CASES)
def test_errors_are_below_the_bound_at_hard_places(name: str) -> None:
    case = CASES[name]
    with mpmath.workprec(300):
        points = case.hard()
    assert points.size > 100
    error, where = worst(case.function, case.true, points)
    assert error < BOUND, f"{name}({where.hex()}) is {error} ulp off"


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_errors_are_below_the_bound_on_a_million_points(name: str, seed: int) -> None:
    case = CASES[name]
    error, where = worst(case.function, case.true, sample(case, SLOW, seed))
    print(f"{name}: at most {error:.4f} ulp, at {where.hex()}")
    assert error < BOUND, f"{name}({where.hex()}) is {error} ulp off"


def changed(values: tuple[float, ...], index: int) -> tuple[float, ...]:
    """A table with one entry off by 1e-9 of its value."""
    return (*values[:index], values[index] * (1.0 + 1e-9), *values[index + 1 :])


@pytest.mark.parametrize(
    ("name", "constants"),
    [
        ("exp", {"_F": changed(_F, 5)}),
        ("log", {"_ODD": changed(_ODD, 2)}),
        ("sin", {"_F": changed(_F, 7)}),
        ("cos", {"_F": changed(_F, 8)}),
        ("atan", {"_ODD": changed(_ODD, 3)}),
    ],
)
def test_a_slightly_wrong_coefficient_is_caught(name: str, constants: dict[str, object]) -> None:
    # Negative control; with nothing changed the same points pass.
    case = CASES[name]
    points = sample(case, 1000, 1)
    for given, limit in (({}, True), (constants, False)):
        plain = plain_functions(**given)
        one = {"sin": lambda x: plain.sin_cos(x)[0], "cos": lambda x: plain.sin_cos(x)[1]}  # noqa: B023
        function = one.get(name) or getattr(plain, name)
        assert (worst(function, case.true, points)[0] < BOUND) is limit


@pytest.mark.full
def test_an_angle_less_quarter_turns_needs_all_its_parts() -> None:
    # Negative control of the hard angles: without the last part of pi / 2 the nearest of them go wrong.
    plain = plain_functions(_QUARTER=(*_QUARTER[:3], 0.0))
    with mpmath.workprec(300):
        points = hard_angles()
    assert worst(lambda x: float(plain.sin_cos(x)[0]), mpmath.sin, points[::3])[0] > 100.0


INF, NAN = math.inf, math.nan


@pytest.mark.parametrize(
    ("function", "x", "value"),
    [
        (exp, 0.0, 1.0), (exp, -0.0, 1.0), (exp, TINY, 1.0), (exp, -TINY, 1.0), (exp, 1e-17, 1.0),
        (exp, INF, INF), (exp, -INF, 0.0), (exp, NAN, NAN), (exp, 709.8, INF), (exp, 1e300, INF), (exp, -746.0, 0.0),
        (exp, math.nextafter(709.782712893384, INF), INF), (exp, -745.1332191019412, 0.0), (exp, -745.0, TINY),
        (log, 1.0, 0.0), (log, 0.0, -INF), (log, -0.0, -INF), (log, -1.0, NAN), (log, -INF, NAN), (log, INF, INF),
        (log, NAN, NAN), (log, TINY, -744.4400719213812), (log, 1.7976931348623157e308, 709.782712893384),
        (sine, 0.0, 0.0), (sine, -0.0, -0.0), (sine, TINY, TINY), (sine, -1e-300, -1e-300), (cosine, 0.0, 1.0),
        (cosine, TINY, 1.0), (sine, INF, NAN), (cosine, -INF, NAN), (sine, NAN, NAN), (cosine, NAN, NAN),
        (sine, math.nextafter(SIN_COS_LIMIT, INF), NAN), (cosine, -1e300, NAN), (sine, math.pi, 1.2246467991473532e-16),
        (cosine, math.pi / 2, 6.123233995736766e-17),
        (atan, 0.0, 0.0), (atan, -0.0, -0.0), (atan, TINY, TINY), (atan, -TINY, -TINY), (atan, INF, math.pi / 2),
        (atan, -INF, -math.pi / 2), (atan, NAN, NAN), (atan, 1.0, math.pi / 4), (atan, 1e300, math.pi / 2),
    ],
)  # fmt: skip
def test_edge_values(function: Function, x: float, value: float) -> None:
    assert repr(function(x)) == repr(value)


def test_they_know_their_symmetries(seed: int) -> None:
    for x in sample(CASES["sin"], 3000, seed).tolist():
        assert sine(-x) == -sine(x) or x == 0.0
        assert cosine(-x) == cosine(x)
        assert atan(-x) == -atan(x)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("exp", -745.2, 709.8),
        ("exp", -0.4, 0.4),
        ("log", 0.0, 3.0),
        ("sin", -1.5707963, 1.5707963),
        ("atan", -9.0, 9.0),
    ],
)
def test_they_rise_where_they_should(name: str, low: float, high: float, seed: int) -> None:
    """Between numbers side by side, at random places and at all seams."""
    case = CASES[name]
    places = np.concatenate([np.random.default_rng(seed).uniform(low, high, 1500), case.hard()[:2000]])
    places = places[(places >= low) & (places <= high)]
    points = around(places, 5)
    values = np.array([case.function(x) for x in points.tolist()])
    falls = np.flatnonzero(np.diff(values) < 0.0)
    assert falls.size == 0, f"{name} falls after {points[falls[:3]]}"


def test_cosine_falls_from_0_to_pi(seed: int) -> None:
    points = around(np.random.default_rng(seed).uniform(0.0, math.pi, 1500), 5)
    assert np.all(np.diff([cosine(x) for x in points[points <= math.pi].tolist()]) <= 0.0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", CASES)
def test_compiled_and_as_plain_python_they_give_the_same_bits(name: str, seed: int) -> None:
    plain = plain_functions()
    case = CASES[name]
    for x in [*sample(case, 2000, seed).tolist(), *case.hard()[::7].tolist()]:
        if name in ("sin", "cos"):
            assert repr(plain.sin_cos(x)) == repr(sin_cos(x))
        else:
            assert repr(getattr(plain, name)(x)) == repr(case.function(x)), x


# What the machine runs

EXACT = {"sqrt", "floor", "ceil", "copysign", "fabs", "rint", "sign", "isnan"}
"""Functions that IEEE 754 defines to the last bit; some are instructions, some calls."""
NO_FUNCTIONS = {
    "inf", "nan", "pi", "zeros", "uint64", "int64", "float64", "float32", "uint32", "int32", "int8", "uint8", "bool_",
}  # fmt: skip


def _foreign_names(source: str) -> list[str]:
    """What kernels of a source take from `math` and `numpy` that is not exact, and powers."""
    found = []
    for node in ast.walk(ast.parse(source)):
        decorators = [getattr(each, "id", "") for each in getattr(node, "decorator_list", [])]
        if not {"kernel", "inlined_kernel"} & set(decorators):
            continue
        for statement in node.body:  # type: ignore[attr-defined]
            for part in ast.walk(statement):
                if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
                    if part.value.id in ("math", "np") and part.attr not in EXACT | NO_FUNCTIONS:
                        found.append(f"{part.value.id}.{part.attr}")
                elif isinstance(part, ast.BinOp) and isinstance(part.op, ast.Pow):
                    found.append("**")
    return found


def test_kernels_take_only_exact_functions_from_elsewhere() -> None:
    """The remainder of floats (`%`) is exact too, as C defines it."""
    package = Path(cornerforge._jit.__file__).parent
    sources = [path for path in package.rglob("*.py") if "kernel\ndef " in path.read_text()]
    assert len(sources) > 30
    assert {path.name: names for path in sources if (names := _foreign_names(path.read_text()))} == {}


def test_a_library_function_in_a_kernel_is_seen() -> None:
    source = "@kernel\ndef f(x):\n    return math.exp(x) + np.arctan(x) ** 2.5 + math.sqrt(x)\n"
    assert sorted(_foreign_names(source)) == ["**", "math.exp", "np.arctan"]


ASSEMBLY = """
import math
import numba
from numba import float64
from cornerforge import _elementary

@numba.njit({options})
def all_of_them(x):
    s, c = _elementary.sin_cos(x)
    return _elementary.exp(x) * _elementary.log(x) + s * c * _elementary.atan(x){more}

all_of_them.compile((float64,))
print(all_of_them.inspect_asm((float64,)))
"""
FUSED = re.compile(r"\bvfn?m(add|sub)")
CALLED = re.compile(r"\b(exp|log|pow|sin|cos|sincos|tan|atan|atan2|fma)\b(@PLT)?")


def _assembly(tmp_path: Path, options: str = "", more: str = "") -> str:
    environment = {
        "NUMBA_CPU_NAME": "haswell",  # has fused multiply-adds
        "NUMBA_CPU_FEATURES": "+avx2,+fma",
        "NUMBA_CACHE_DIR": str(tmp_path),
        "PYTHONPATH": str(Path(__file__).parents[1] / "src"),
    }
    done = subprocess.run(
        [sys.executable, "-c", ASSEMBLY.format(options=options, more=more)],
        capture_output=True, text=True, check=True, env=environment,
    )  # fmt: skip
    return done.stdout


@pytest.mark.full
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads x86-64 assembly")
def test_nothing_is_fused_or_called(tmp_path: Path) -> None:
    """On a processor that could; negative controls: licence to fuse, and one function of the C library."""
    assert "mulsd" in (code := _assembly(tmp_path))
    assert not FUSED.search(code)
    assert not CALLED.search(code)
    assert FUSED.search(_assembly(tmp_path, "fastmath=True"))
    assert CALLED.search(_assembly(tmp_path, more=" + math.sin(x)"))
