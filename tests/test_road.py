"""The straight road: lanes, distances along it, and that nobody else computes with x."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cornerforge
from cornerforge.road import straight
from cornerforge.sim.world import VEHICLE

LANE = 4.0


@pytest.mark.parametrize(("y", "lane"), [(0.0, 0), (3.999, 0), (4.0, 1), (-0.001, -1), (12.0, 3)])
def test_lane_of(y: float, lane: int) -> None:
    assert straight.lane_of(y, LANE) == lane


@given(st.integers(0, 5), st.floats(2.5, 6.0))
def test_a_lane_holds_its_centre(lane: int, lane_width: float) -> None:
    assert straight.lane_of(straight.lane_centre(lane, lane_width), lane_width) == lane


@pytest.mark.parametrize(
    ("y", "target", "lanes"),
    [
        (2.0, 0, {0}),
        (3.5, 0, {0, 1}),
        (2.0, 1, {0, 1}),
        (0.5, 0, {0}),
        (6.0, 0, {0, 1}),
        (3.0, 0, {0, 1}),
        (11.5, 2, {2, 3}),
    ],
)
def test_lane_bits(y: float, target: int, lanes: set[int]) -> None:
    assert straight.lane_bits(y, 1.0, target, LANE) == sum(1 << lane for lane in lanes)


def vehicles() -> np.ndarray:
    """A truck behind a car behind a motorcycle."""
    v = np.zeros(3, dtype=VEHICLE)
    v["x"] = 100.0, 120.0, 131.0
    v["length"] = 16.5, 5.0, 2.2
    v["width"] = 2.55, 2.0, 0.8
    return v


def test_distances_by_hand() -> None:
    v = vehicles()
    assert straight.ahead_by(v, 0, 1) == 20.0
    assert straight.ahead_by(v, 1, 0) == -20.0
    assert straight.gap(v, 0, 1) == pytest.approx(20.0 - 8.25 - 2.5)
    assert straight.gap(v, 1, 2) == pytest.approx(11.0 - 2.5 - 1.1)
    assert straight.half_widths(v, 0, 2) == pytest.approx(1.675)
    assert straight.along(np.array([1.0, 2.0]), 3.0).tolist() == [2.0, 1.0]


ALONG = {"x", "x_held"}
"""Names of a position along the road."""


WRAPPERS = {"float", "abs", "np.abs", "np.asarray", "np.array"}
"""Calls that give a position back, if they are given one."""
PLANE = {
    "drivers/rails.py": "plans manoeuvres on a straight road",
    "counterfactual/search.py": "bounds how far the AV can get, to leave out recorded vehicles that it cannot reach",
    "counterfactual/braking.py": "moves boxes in a plane beside recorded ones",
    "sim/traffic.py": "fills a straight road, see docs/design.md",
}
"""Modules that compute with local names of positions, and why they may."""
AT_SITE = re.compile(r"(^|[/_])site[/_.]")
"""Names of files and folders about sites, where there is no road to go along."""


def is_position(node: ast.expr, names: set[str]) -> bool:
    """Is it `something.x`, `something["x"]`, an entry or a part of it, or a name that was assigned from it?"""
    if isinstance(node, ast.Attribute):
        return node.attr in ALONG
    if isinstance(node, ast.Name):
        return node.id in names
    if isinstance(node, ast.Call):
        return ast.unparse(node.func) in WRAPPERS and any(is_position(one, names) for one in node.args)
    if isinstance(node, ast.Subscript):
        return (isinstance(node.slice, ast.Constant) and node.slice.value in ALONG) or is_position(node.value, names)
    return False


def own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """All nodes of a scope without those of functions within it."""
    for child in ast.iter_child_nodes(scope):
        yield child
        if not isinstance(child, ast.FunctionDef):
            yield from own_nodes(child)


def names_of_positions(scope: ast.AST) -> set[str]:
    """Arguments called as a position, and local names assigned from one, directly or through other names."""
    arguments = scope.args.args if isinstance(scope, ast.FunctionDef) else []
    names = {argument.arg for argument in arguments} & ALONG
    before = -1
    while len(names) > before:
        before = len(names)
        for node in own_nodes(scope):
            if not isinstance(node, ast.Assign):
                continue
            for target in node.targets:
                pairs = [(target, node.value)]
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    pairs = list(zip(target.elts, node.value.elts, strict=True))
                names |= {one.id for one, value in pairs if isinstance(one, ast.Name) and is_position(value, names)}
    return names


def arithmetic_on_positions(source: str, *, follow_names: bool = True) -> list[int]:
    """Lines that add to or subtract from a position along the road."""
    found = []
    tree = ast.parse(source)
    for scope in (tree, *(node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))):
        names = names_of_positions(scope) if follow_names else set()
        for node in own_nodes(scope):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
                if is_position(node.left, names) or is_position(node.right, names):
                    found.append(node.lineno)
            elif isinstance(node, ast.AugAssign) and is_position(node.target, names):
                found.append(node.lineno)
    return sorted(found)


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("a = v[j].x - v[i].x\nv[i].x += 1\nb = r['x'][0] + 2\nc = v.y - w.y\n", [1, 2, 3]),
        ("def f(v):\n    x = v[0].x\n    return x - 1\n", [3]),
        ("def f(v):\n    a = v.x\n    b = a[2:]\n    b -= 1\n", [4]),
        ("def f(v):\n    return float(v['x'][0]) - 50\n", [2]),
        ("def f(v):\n    x = v['x']\n    return np.abs(x[:, None] - x)\n", [3]),
        ("def f(v):\n    a, b = v.x, v.y\n    return b - 1, a - 1\n", [3]),
        ("def f(x):\n    return x + 1\n", [2]),
        ("def f(v):\n    a = v.x\n\ndef g(a):\n    return a - 1\n", []),
    ],
)
def test_the_rule_sees_arithmetic_on_positions(source: str, lines: list[int]) -> None:
    assert arithmetic_on_positions(source) == lines


def test_only_the_road_computes_with_x() -> None:
    """`geometry.py` may: its boxes lie in a plane; in `_elementary.py` x is any number.

    `ext/interchange/` and the cases in `library/` may too: files of other tools hold places in a plane, and what they
    tell moves there. So may what is named after sites: there x and y are a plane, and routes turn in it.
    """
    package = Path(cornerforge.__file__).parent
    allowed = [package / "geometry.py", package / "_elementary.py", *(package / "road").glob("*.py")]
    allowed += (package / "ext" / "interchange").glob("*.py")
    allowed += [package / "library" / "case_file.py", package / "library" / "out_case.py"]
    allowed += [path for path in package.rglob("*.py") if AT_SITE.search(path.relative_to(package).as_posix())]
    found, excepted = [], set()
    for path in sorted(package.rglob("*.py")):
        name, source = path.relative_to(package).as_posix(), path.read_text(encoding="utf-8")
        if path in allowed:
            continue
        if name in PLANE and arithmetic_on_positions(source):
            excepted.add(name)
        found += [f"{name}:{line}" for line in arithmetic_on_positions(source, follow_names=name not in PLANE)]
    assert found == [], "ask cornerforge.road (ahead_by, gap, along) instead"
    assert excepted == set(PLANE), "an exception that is needed no more"
