"""The straight road: lanes, distances along it, and that nobody else computes with x."""

from __future__ import annotations

import ast
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


def is_position(node: ast.expr) -> bool:
    """Is it `something.x`, `something["x"]`, or an entry of it?"""
    if isinstance(node, ast.Attribute):
        return node.attr in ALONG
    if isinstance(node, ast.Subscript):
        return (isinstance(node.slice, ast.Constant) and node.slice.value in ALONG) or is_position(node.value)
    return False


def arithmetic_on_positions(source: str) -> list[int]:
    """Lines that add to or subtract from a position along the road."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            if is_position(node.left) or is_position(node.right):
                found.append(node.lineno)
        elif isinstance(node, ast.AugAssign) and is_position(node.target):
            found.append(node.lineno)
    return sorted(found)


def test_only_the_road_computes_with_x() -> None:
    """`geometry.py` may: its boxes lie in a plane, wherever the road goes."""
    package = Path(cornerforge.__file__).parent
    allowed = [package / "geometry.py", *(package / "road").glob("*.py")]
    assert arithmetic_on_positions("a = v[j].x - v[i].x\nv[i].x += 1\nb = r['x'][0] + 2\nc = v.y - w.y\n") == [1, 2, 3]
    found = [
        f"{path.relative_to(package)}:{line}"
        for path in sorted(package.rglob("*.py"))
        if path not in allowed
        for line in arithmetic_on_positions(path.read_text(encoding="utf-8"))
    ]
    assert found == [], "ask cornerforge.road (ahead_by, gap, along) instead"
