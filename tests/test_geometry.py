from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cornerforge import geometry

LENGTH, WIDTH, LANE = 5.0, 2.0, 4.0
Polygon = list[tuple[float, float]]
Pose = tuple[float, float, float]


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


POSE = st.tuples(number(-6.0, 6.0), number(-6.0, 6.0), number(-math.pi, math.pi))
STATE = st.tuples(number(0.0, 24.0), number(-4.0, 4.0), number(-6.0, 6.0))
"""Lateral position, speed, acceleration."""


def overlap(a: Pose, b: Pose, length: float = LENGTH, width: float = WIDTH) -> bool:
    return geometry.boxes_overlap(geometry.Box(*a, length, width), geometry.Box(*b, length, width))


def rectangle(pose: Pose, length: float, width: float) -> Polygon:
    x, y, heading = pose
    turn = complex(math.cos(heading), math.sin(heading))
    corners = [complex(sx * length, sy * width) / 2.0 * turn for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return [(x + corner.real, y + corner.imag) for corner in corners]


def common_area(subject: Polygon, window: Polygon) -> float:
    """Area shared by two convex polygons: clip one at every edge of the other (Sutherland and Hodgman 1974)."""
    polygon = subject
    for (ax, ay), (bx, by) in zip(window, window[1:] + window[:1], strict=True):
        side = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in polygon]
        kept: Polygon = []
        for k, (x, y) in enumerate(polygon):
            (px, py), before, now = polygon[k - 1], side[k - 1], side[k]
            if (before > 0.0) != (now > 0.0):
                share = before / (before - now)
                kept.append((px + share * (x - px), py + share * (y - py)))
            if now > 0.0:
                kept.append((x, y))
        polygon = kept
    closed = zip(polygon, polygon[1:] + polygon[:1], strict=True)
    return 0.5 * sum(x * v - u * y for (x, y), (u, v) in closed)


def test_overlap_is_that_of_the_polygons(seed: int) -> None:
    # Many poses near contact; a hair's breadth around touching is left open by growing and shrinking both boxes.
    rng = np.random.default_rng(seed)
    hair = 1e-6
    found = []
    for _ in range(4000):
        distance, direction = rng.uniform(1.5, 5.5), rng.uniform(-math.pi, math.pi)
        a = (0.0, 0.0, float(rng.uniform(-1.6, 1.6)))
        b = (distance * math.cos(direction), distance * math.sin(direction), float(rng.uniform(-1.6, 1.6)))
        found.append(overlap(a, b))
        size = (LENGTH + hair, WIDTH + hair) if found[-1] else (LENGTH - hair, WIDTH - hair)
        assert (common_area(rectangle(a, *size), rectangle(b, *size)) > 0.0) == found[-1], (a, b)
    assert 0.2 < np.mean(found) < 0.8  # both answers are tried


@given(POSE, POSE)
def test_overlap_is_symmetric_and_mirrored(a: Pose, b: Pose) -> None:
    hair = 1e-6
    inside, outside = overlap(a, b, LENGTH - hair, WIDTH - hair), overlap(a, b, LENGTH + hair, WIDTH + hair)
    assume(inside == outside)
    mirrored = [(x, 12.0 - y, -heading) for x, y, heading in (a, b)]
    turned = [(-x, -y, heading) for x, y, heading in (a, b)]
    assert overlap(b, a) == overlap(mirrored[0], mirrored[1]) == overlap(turned[0], turned[1]) == overlap(a, b)


@given(POSE, number(0.0, 2.0 * math.pi), number(0.0, 50.0), number(-math.pi, math.pi))
def test_never_beyond_the_reach(a: Pose, direction: float, further: float, heading: float) -> None:
    distance = math.hypot(LENGTH, WIDTH) + 1e-9 + further
    b = (a[0] + distance * math.cos(direction), a[1] + distance * math.sin(direction), heading)
    assert not overlap(a, b)


def test_touching_edges_do_not_count() -> None:
    assert not overlap((0.0, 2.0, 0.0), (LENGTH, 2.0, 0.0))
    assert not overlap((0.0, 2.0, 0.0), (1.0, 2.0 + WIDTH, 0.0))
    assert overlap((0.0, 2.0, 0.0), (math.nextafter(LENGTH, 0.0), 2.0, 0.0))
    assert overlap((0.0, 2.0, 0.0), (1.0, math.nextafter(2.0 + WIDTH, 0.0), 0.0))


def test_a_heading_can_make_and_break_contact() -> None:
    beside = (0.0, 2.4, 0.0)
    assert not overlap((0.0, 0.0, 0.0), beside)
    assert overlap((0.0, 0.0, 0.3), beside)
    assert overlap((0.0, 0.0, 0.0), (4.9, 0.0, 0.0))
    assert not overlap((0.0, 0.0, math.pi / 2), (4.9, 0.0, 0.0))


@given(STATE, number(0.0, 24.0), number(0.5, 10.0))
def test_quintic_joins_both_ends(state: tuple[float, float, float], y_end: float, duration: float) -> None:
    path = geometry.quintic(*state, y_end, duration)
    assert geometry.path_at(path, 0.0) == pytest.approx(state, abs=1e-12)
    assert geometry.path_at(path, duration) == pytest.approx((y_end, 0.0, 0.0), abs=1e-6)


@given(STATE, number(0.0, 24.0), number(0.5, 10.0))
def test_path_speed_and_acceleration_are_derivatives(
    state: tuple[float, float, float], y_end: float, duration: float
) -> None:
    path = geometry.quintic(*state, y_end, duration)
    polynomial = np.polynomial.Polynomial(path)
    for t in np.linspace(0.0, duration, 7):
        expected = [polynomial(t), polynomial.deriv(1)(t), polynomial.deriv(2)(t)]
        assert geometry.path_at(path, float(t)) == pytest.approx(expected, rel=1e-9, abs=1e-6)


@given(STATE, number(0.0, 24.0), number(0.5, 10.0))
def test_peak_acceleration_is_that_of_a_fine_grid(
    state: tuple[float, float, float], y_end: float, duration: float
) -> None:
    path = geometry.quintic(*state, y_end, duration)
    polynomial = np.polynomial.Polynomial(path).deriv(2)
    t = np.linspace(0.0, duration, 2001)
    fine = float(np.abs(polynomial(t)).max())
    # Between two grid points the acceleration rises by at most step^2 / 8 times its second derivative.
    missed = (t[1] ** 2) / 8.0 * float(np.abs(polynomial.deriv(2)(t)).max())
    assert fine - 1e-9 <= geometry.path_peak_acceleration(path, duration) + 1e-9 * fine
    assert geometry.path_peak_acceleration(path, duration) <= fine + missed + 1e-9 * (1.0 + fine)


@given(STATE, number(0.0, 24.0), number(0.5, 10.0), number(1.0, 10.0))
def test_plan_ends_at_rest_below_the_bound(
    state: tuple[float, float, float], y_end: float, duration: float, bound: float
) -> None:
    path, planned = geometry.plan_path(*state, y_end, duration, bound)
    assert planned >= duration
    assert geometry.path_at(path, planned) == pytest.approx((y_end, 0.0, 0.0), abs=1e-5)
    if planned < 8.0 * duration:
        assert geometry.path_peak_acceleration(path, planned) <= max(bound, abs(state[2])) + 2e-9
    if planned > duration:  # it grew only because the shorter one was too hard
        shorter = geometry.quintic(*state, y_end, planned / 1.1)
        assert geometry.path_peak_acceleration(shorter, planned / 1.1) > bound


def test_plan_of_an_ordinary_lane_change() -> None:
    path, duration = geometry.plan_path(2.0, 0.0, 0.0, 6.0, 4.0, 4.0)
    assert duration == 4.0
    # From rest to rest: 10 s^3 - 15 s^4 + 6 s^5; its peaks are known (Takahashi et al. 1989).
    assert geometry.path_at(path, 2.0)[:2] == pytest.approx((4.0, 1.875 * 4.0 / 4.0))
    assert geometry.path_peak_acceleration(path, 4.0) == pytest.approx(10.0 / math.sqrt(3.0) * 4.0 / 16.0)


def test_staying_is_a_path_too() -> None:
    path, duration = geometry.plan_path(2.0, 0.0, 0.0, 2.0, 4.0, 4.0)
    assert (path, duration) == ((2.0, 0.0, 0.0, 0.0, 0.0, 0.0), 4.0)
    assert geometry.path_peak_acceleration(path, duration) == 0.0


@given(STATE, number(0.0, 24.0), number(0.5, 10.0))
def test_a_mirrored_plan_is_the_mirror_of_the_plan(
    state: tuple[float, float, float], y_end: float, duration: float
) -> None:
    y, speed, acceleration = state
    path, planned = geometry.plan_path(y, speed, acceleration, y_end, duration, 4.0)
    mirrored, also_planned = geometry.plan_path(-y, -speed, -acceleration, -y_end, duration, 4.0)
    assert also_planned == planned
    assert mirrored == tuple(-c for c in path)


def test_boxes_of_two_sizes_overlap_as_their_polygons_do(seed: int) -> None:
    """A truck, a car, a motorcycle, and whatever lies between, against Sutherland and Hodgman's common area."""
    rng = np.random.default_rng(seed)
    hair = 1e-6
    found = []
    for _ in range(2000):
        a, b = ((*rng.uniform(-9.0, 9.0, 2), rng.uniform(-math.pi, math.pi)) for _ in range(2))
        sizes = [(rng.uniform(2.0, 17.0), rng.uniform(0.7, 2.6)) for _ in range(2)]
        area = [
            common_area(rectangle(a, sizes[0][0] + h, sizes[0][1] + h), rectangle(b, sizes[1][0] + h, sizes[1][1] + h))
            for h in (-hair, hair)
        ]
        if area[0] == 0.0 and area[1] > 0.0:
            continue
        touches = geometry.boxes_overlap(geometry.Box._make((*a, *sizes[0])), geometry.Box._make((*b, *sizes[1])))
        assert touches == (area[0] > 0.0)
        assert touches == geometry.boxes_overlap(
            geometry.Box._make((*b, *sizes[1])), geometry.Box._make((*a, *sizes[0]))
        )
        found.append(touches)
    assert 400 < sum(found) < 1600
