"""Labels of a contact at a site: time to collision of boxes that go on straight, extremes of motion, jumps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from cornerforge.fields import BODY, FRAME_FIELDS
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.sim.site.contact import most_at_site, never_jumps, shortest_at_site
from cornerforge.types import CAR, FRAME_S, PERSON

BODIES = np.dtype([(body.name, body.recorded.lstrip("<")) for body in BODY], align=True)
STEP = 0.01


def bodies(kind: int = CAR) -> NDArray[np.void]:
    made = np.zeros(2, BODIES)
    made["length"], made["width"] = (5.0, 0.6 if kind == PERSON else 4.0), (2.0, 0.6 if kind == PERSON else 1.8)
    made["kind"] = CAR, kind
    return made


def frames(
    av: list[tuple[float, float, float, float]], other: list[tuple[float, float, float, float]]
) -> NDArray[np.void]:
    """Frames of two: x, y, speed, heading of each, a frame a row."""
    made = np.zeros((len(av), 2), FRAME_FIELDS)
    for column, rows in enumerate((av, other)):
        for name, values in zip(("x", "y", "speed", "heading"), zip(*rows, strict=True), strict=True):
            made[name][:, column] = values
    made["present"] = 1
    return made


def ttc(av: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> float:
    return float(shortest_at_site(frames([av] * 2, [other] * 2), 1, 2, bodies()))


def test_two_that_meet_head_on() -> None:
    assert ttc((0.0, 0.0, 5.0, 0.0), (24.5, 0.0, 5.0, math.pi)) == pytest.approx((24.5 - 4.5) / 10.0)


def test_two_that_part_or_pass_never_meet() -> None:
    assert math.isnan(ttc((0.0, 0.0, 5.0, 0.0), (-20.0, 0.0, 5.0, math.pi)))
    assert math.isnan(ttc((0.0, 0.0, 5.0, 0.0), (30.0, 2.0, 5.0, math.pi)))


def test_it_is_that_of_boxes_moved_in_small_steps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    met = grazed = 0
    for _ in range(200):
        av = 0.0, 0.0, float(rng.uniform(0.0, 10.0)), float(rng.uniform(-4.0, 4.0))
        other = (*rng.uniform(-20.0, 20.0, 2).tolist(), float(rng.uniform(0.0, 10.0)), float(rng.uniform(-4.0, 4.0)))
        found = ttc(av, other)
        sizes = (5.0, 2.0), (4.0, 1.8)
        driven = next((
            k * STEP for k in range(round(6.0 / STEP))
            if boxes_overlap(*(Box(
                one[0] + k * STEP * one[2] * math.cos(one[3]), one[1] + k * STEP * one[2] * math.sin(one[3]), one[3],
                *size) for one, size in zip((av, other), sizes, strict=True)))
        ), math.nan)  # fmt: skip
        if math.isnan(driven):
            grazed += not (math.isnan(found) or found > 6.0 - 2.0 * STEP)
            continue
        met += 1
        assert driven - STEP - 1e-9 <= found <= driven + 1e-9
    assert met > 20
    assert grazed <= 2, "touches that are shorter than a step"


def test_a_turn_gives_speed_times_turn_across() -> None:
    """Round a circle of 10 m at 5 m/s: 2.5 m/s2, also where the heading passes pi."""
    turns = [math.pi - 0.1 + 0.05 * k for k in range(6)]
    ring = [(10.0 * math.sin(a), -10.0 * math.cos(a), 5.0, (a + math.pi) % (2 * math.pi) - math.pi) for a in turns]
    made = frames(ring, [(0.0, 0.0, 0.0, 0.0)] * 6)
    assert most_at_site(made, 5, 0, bodies()) == pytest.approx((0.0, 0.0, 2.5))
    assert never_jumps(made, 5, 0)


def test_a_person_has_no_extremes_but_may_not_jump() -> None:
    walk = [(0.0, 0.0, 0.0, 0.0), (0.15, 0.0, 1.5, 0.0), (0.3, 0.0, 1.5, 0.0)]
    made = frames([(50.0, 0.0, 0.0, 0.0)] * 3, walk)
    assert all(math.isnan(value) for value in most_at_site(made, 2, 1, bodies(PERSON)))
    assert never_jumps(made, 2, 1)
    made["x"][2, 1] = 0.15 + 1.5 * FRAME_S + 0.1
    assert not never_jumps(made, 2, 1)
