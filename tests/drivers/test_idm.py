from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.drivers.idm import IdmNumbers, IdmParams, desired_gap, free_acceleration, idm_acceleration
from cornerforge.errors import InputError

P = IdmNumbers(*dataclasses.astuple(IdmParams()))
"""a 2, b 4, s0 5, T 1.5, v0 35, strongest braking 4."""
SPEED = st.floats(0.0, 40.0)
GAP = st.floats(-10.0, 300.0)
RATE = st.floats(-20.0, 20.0)


def test_numbers_have_the_fields_of_the_parameters() -> None:
    assert IdmNumbers._fields == tuple(field.name for field in dataclasses.fields(IdmParams))


@given(SPEED, st.floats(0.1, 10.0), st.floats(0.1, 12.0), st.floats(1.0, 80.0))
def test_a_free_road_is_an_infinite_gap_to_the_bit(speed: float, most: float, braking: float, wished: float) -> None:
    p = P._replace(max_acceleration=most, max_braking=braking, desired_speed=wished)
    assert free_acceleration(speed, p).hex() == idm_acceleration(speed, math.inf, 0.0, p).hex()


@pytest.mark.parametrize(
    ("speed", "gap", "range_rate", "expected"),
    [
        (0.0, math.inf, 0.0, 2.0),  # standing, free road: full acceleration
        (35.0, math.inf, 0.0, 0.0),  # at the desired speed
        (17.5, math.inf, 0.0, 2.0 * (1.0 - 0.5**4)),
        (20.0, 35.0, 0.0, -2.0 * (4.0 / 7.0) ** 4),  # at the desired gap 5 + 1.5 * 20 the gap term is 1
        (20.0, 70.0, 0.0, 2.0 * (1.0 - (4.0 / 7.0) ** 4 - 0.25)),
        (28.0, 94.0, 0.0, 2.0 * (1.0 - 0.8**4 - 0.25)),
        (0.0, 10.0, 0.0, 2.0 * (1.0 - 0.25)),  # standing: only the standstill gap
        (0.0, 5.0, 0.0, 0.0),
        (40.0, math.inf, 0.0, 2.0 * (1.0 - (8.0 / 7.0) ** 4)),  # faster than it wants
    ],
)
def test_by_hand(speed: float, gap: float, range_rate: float, expected: float) -> None:
    assert idm_acceleration(speed, gap, range_rate, P) == pytest.approx(expected, abs=1e-12)


def test_desired_gap_by_hand() -> None:
    assert desired_gap(20.0, 0.0, P) == pytest.approx(35.0)
    assert desired_gap(20.0, -5.0, P) == pytest.approx(35.0 + 20.0 * 5.0 / (2.0 * math.sqrt(8.0)))
    assert desired_gap(20.0, 30.0, P) == 5.0  # a lead that runs away asks for no more than the standstill gap
    assert desired_gap(0.0, -5.0, P) == 5.0


@pytest.mark.parametrize("gap", [0.1, 0.0, -3.0, -math.inf])
def test_no_room_means_the_hardest_braking(gap: float) -> None:
    assert idm_acceleration(20.0, gap, 0.0, P) == -4.0
    assert idm_acceleration(0.0, gap, 0.0, P) == -4.0


@given(SPEED, GAP, RATE)
def test_within_limits(speed: float, gap: float, range_rate: float) -> None:
    assert -4.0 <= idm_acceleration(speed, gap, range_rate, P) <= 2.0


@given(SPEED, GAP, RATE, st.floats(0.0, 50.0), st.floats(0.0, 5.0))
def test_more_room_or_a_faster_lead_never_brakes_harder(
    speed: float, gap: float, range_rate: float, room: float, faster: float
) -> None:
    here = idm_acceleration(speed, gap, range_rate, P)
    assert idm_acceleration(speed, gap + room, range_rate, P) >= here
    assert idm_acceleration(speed, gap, range_rate + faster, P) >= here
    assert idm_acceleration(speed, math.inf, 0.0, P) >= here


def test_following_settles_at_the_equilibrium_gap() -> None:
    # v = v_lead, a = 0: gap = s* / sqrt(1 - (v / v0)^4)
    speed, gap, lead = 20.0, 80.0, 25.0
    for _ in range(20_000):
        a = idm_acceleration(speed, gap, lead - speed, P)
        gap += (lead - speed) * 0.02
        speed += a * 0.02
    assert speed == pytest.approx(lead, abs=1e-6)
    assert gap == pytest.approx(42.5 / math.sqrt(1.0 - (25.0 / 35.0) ** 4), rel=1e-6)


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(IdmParams)])
@pytest.mark.parametrize("value", [-1.0, math.nan, 1e6])
def test_parameters_are_checked(field: str, value: float) -> None:
    with pytest.raises(InputError, match=f"idm.{field} = "):
        IdmParams(**{field: value})
