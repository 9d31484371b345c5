"""Delta-v and injury: conservation laws, published values, order of the curves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.errors import InputError
from cornerforge.metrics import crash_mode, delta_v, injury_probability
from cornerforge.metrics.injury import CRASH_MODES

MPH = 0.44704
AHEAD, LEFT, RIGHT, BEHIND = 0.0, math.pi / 2.0, -math.pi / 2.0, math.pi

speeds = st.floats(0.0, 80.0)
masses = st.floats(100.0, 40_000.0)
shares = st.floats(0.0, 1.0)
frictions = st.floats(0.0, 2.0)


def odds(probability: float) -> float:
    return probability / (1.0 - probability)


@pytest.mark.parametrize(
    ("closing", "sliding", "own", "other", "restitution", "friction", "expected"),
    [
        (10.0, 0.0, 1.0, 1.0, 0.0, 0.5, (5.0, 0.0)),
        (10.0, 0.0, 1.0, 1.0, 1.0, 0.5, (10.0, 0.0)),  # equal balls exchange their velocities
        (10.0, 0.0, 1.0, 3.0, 0.0, 0.5, (7.5, 0.0)),
        (10.0, 0.0, 3.0, 1.0, 0.0, 0.5, (2.5, 0.0)),
        (0.0, 0.0, 1.0, 1.0, 0.5, 0.5, (0.0, 0.0)),
        (1.0, 10.0, 1.0, 1.0, 0.0, 0.5, (0.5, 0.25)),  # they go on sliding
        (1.0, 10.0, 1.0, 1.0, 0.0, 0.0, (0.5, 0.0)),
        (1.0, 0.3, 1.0, 1.0, 0.0, 0.5, (0.5, 0.15)),  # they stop sliding
        (1.0, 10.0, 1.0, 1.0, 0.0, math.inf, (0.5, 5.0)),  # they stick together
        (0.0, 10.0, 1.0, 1.0, 0.0, math.inf, (0.0, 0.0)),  # nobody presses
    ],
)
def test_an_impact_by_hand(
    closing: float, sliding: float, own: float, other: float, restitution: float, friction: float,
    expected: tuple[float, float],
) -> None:  # fmt: skip
    changes = delta_v(closing, sliding, own, other, restitution, friction)
    assert changes == pytest.approx(expected)


@given(closing=speeds, sliding=speeds, own=masses, other=masses, restitution=shares, friction=frictions)
def test_momentum_is_kept_and_friction_stops_sliding_at_most(
    closing: float, sliding: float, own: float, other: float, restitution: float, friction: float
) -> None:
    mine = np.array(delta_v(closing, sliding, own, other, restitution, friction))
    others = np.array(delta_v(closing, sliding, other, own, restitution, friction))
    assert own * mine == pytest.approx(other * others)
    # Together they take the closing speed away and add the parting one; and of the sliding speed no more than there is.
    across, along = mine + others
    assert across == pytest.approx((1.0 + restitution) * closing)
    assert along <= sliding * (1.0 + 1e-12)
    slides_on = along < sliding * (1.0 - 1e-9) - 1e-300  # the smallest numbers have no half
    if slides_on:
        assert along == pytest.approx(friction * across)


@given(closing=speeds, sliding=speeds, own=masses, other=masses, restitution=shares, friction=frictions)
def test_energy_is_never_won(
    closing: float, sliding: float, own: float, other: float, restitution: float, friction: float
) -> None:
    mine = np.array(delta_v(closing, sliding, own, other, restitution, friction))
    others = np.array(delta_v(closing, sliding, other, own, restitution, friction))
    left = np.array([closing, sliding]) - mine - others
    assert np.hypot(*left) <= math.hypot(closing, sliding) * (1.0 + 1e-12) + 1e-300


@given(
    closing=speeds, sliding=speeds, extra=st.floats(0.1, 50.0), own=masses, other=masses,
    restitution=st.floats(0.0, 0.9), friction=frictions,
)  # fmt: skip
def test_delta_v_grows_with_speed_bounce_friction_and_the_others_mass(
    closing: float, sliding: float, extra: float, own: float, other: float, restitution: float, friction: float
) -> None:
    def size(*impact: float) -> float:
        return float(np.hypot(*delta_v(*impact)))

    value = size(closing, sliding, own, other, restitution, friction) * (1.0 - 1e-12)
    assert size(closing + extra, sliding, own, other, restitution, friction) > value
    assert size(closing, sliding + extra, own, other, restitution, friction) >= value
    assert size(closing, sliding, own, other + extra, restitution, friction) >= value
    assert size(closing, sliding, own, other, restitution + 0.1, friction) >= value
    assert size(closing, sliding, own, other, restitution, friction + extra) >= value
    assert size(closing, sliding, own + extra, other, restitution, friction) * (1.0 - 1e-12) <= value / (1.0 - 1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1.0,), "closing_speed = -1.0 is out of range"),
        ((1.0, -2.0), "sliding_speed = -2.0 is out of range"),
        ((1.0, 0.0, 0.0), "mass = 0.0 is out of range"),
        ((1.0, 0.0, 1.0, -2.0), "other_mass = -2.0 is out of range"),
        ((1.0, 0.0, 1.0, 1.0, 1.1), "A restitution is out of range"),
        ((1.0, 0.0, 1.0, 1.0, 0.0, -0.1), "friction = -0.1 is out of range"),
        ((math.nan,), "closing_speed is NaN"),
        ((math.inf,), "closing_speed = inf is out of range"),
        ((1.0, 0.0, 1.0, math.inf), "other_mass = inf is out of range"),
        ((1.0, 0.0, 1.0, 1.0, 0.0, -math.inf), "friction = -inf is out of range"),
    ],
)
def test_bad_impacts_are_refused(arguments: tuple[float, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        delta_v(*arguments)


@pytest.mark.parametrize(
    ("direction", "intercept", "slope"),
    [(AHEAD, -6.9774, 0.1620), (BEHIND, -8.0329, 0.1793)],
)
@pytest.mark.parametrize("mph", [0.0, 10.0, 25.0, 40.0, 60.0])
def test_frontal_and_rear_are_the_published_curves(
    direction: float, intercept: float, slope: float, mph: float
) -> None:
    expected = 1.0 / (1.0 + math.exp(-(intercept + slope * mph)))
    assert injury_probability(mph * MPH, direction) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("direction", "percent"), [(LEFT, 83.8), (RIGHT, 47.8)])
def test_sides_stand_to_frontal_as_published_at_30_mph(direction: float, percent: float) -> None:
    front, side = (float(injury_probability(30.0 * MPH, angle)) for angle in (AHEAD, direction))
    assert odds(side) / odds(front) == pytest.approx(odds(percent / 100.0) / odds(0.389), rel=1e-12)


def test_rear_stands_to_frontal_about_as_published_at_30_mph() -> None:
    # Two independent sources: Wang's two curves give 0.58, Augenstein's two numbers 0.39. Same order, same size.
    front, rear = (float(injury_probability(30.0 * MPH, angle)) for angle in (AHEAD, BEHIND))
    assert 0.39 < odds(rear) / odds(front) < 1.0


@given(change=speeds, extra=st.floats(0.01, 20.0), direction=st.floats(-10.0, 10.0))
def test_a_harder_blow_is_never_less_dangerous(change: float, extra: float, direction: float) -> None:
    weak, hard = float(injury_probability(change, direction)), float(injury_probability(change + extra, direction))
    assert 0.0 < weak <= hard <= 1.0
    assert weak < hard or weak > 1.0 - 1e-12  # a curve that has come to its end rises by less than a number can hold


@given(change=st.floats(0.01, 80.0))
def test_near_side_is_worst_and_the_driver_sits_on_the_left(change: float) -> None:
    near, far, front = (float(injury_probability(change, angle)) for angle in (LEFT, RIGHT, AHEAD))
    assert near > far > front


def test_a_blow_of_nothing_has_no_side() -> None:
    near, far, front = (float(injury_probability(0.0, angle)) for angle in (LEFT, RIGHT, AHEAD))
    assert near == far == front


@given(direction=st.floats(-math.pi, math.pi), turns=st.integers(-3, 3))
def test_modes_mirror_and_do_not_count_turns(direction: float, turns: int) -> None:
    mode = int(crash_mode(direction))
    edge = abs(abs(math.cos(direction)) - math.sqrt(0.5)) < 1e-9 or abs(math.sin(direction)) < 1e-9
    if not edge:
        assert int(crash_mode(direction + 2.0 * math.pi * turns)) == mode
        assert int(crash_mode(-direction)) == {1: 2, 2: 1}.get(mode, mode)


def test_every_mode_occurs_and_45_degrees_are_lengthwise() -> None:
    degrees = np.array([0.0, 45.0, -45.0, 45.01, -45.01, 134.99, -134.99, 135.0, -135.0, 180.0])
    names = [CRASH_MODES[mode] for mode in crash_mode(np.radians(degrees))]
    assert names == ["frontal"] * 3 + ["near side", "far side"] * 2 + ["rear"] * 3


def test_bad_blows_are_refused() -> None:
    with pytest.raises(InputError, match=r"delta_v = -1\.0 m/s is negative"):
        injury_probability(-1.0, 0.0)
    with pytest.raises(InputError, match=r"force_direction\[\] = inf is not finite"):
        injury_probability(1.0, np.inf)
