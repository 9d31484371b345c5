from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.drivers.idm import IdmNumbers, IdmParams, idm_acceleration
from cornerforge.drivers.mobil import NO_CHANGE, MobilNumbers, MobilParams, mobil_gain
from cornerforge.errors import InputError

IDM = IdmNumbers(*dataclasses.astuple(IdmParams()))
PLAIN = MobilNumbers(*dataclasses.astuple(MobilParams()))
POLITE = MobilNumbers(0.5, 0.2, 2.0)
FREE = (math.inf, 25.0)


def gain(
    lead: tuple[float, float] = FREE,
    rear: tuple[float, float] = FREE,
    now: float = -1.0,
    rear_now: float = 0.0,
    mobil: MobilNumbers = PLAIN,
) -> float:
    """Of a subject at 25 m/s."""
    return mobil_gain(25.0, now, lead, rear, rear_now, IDM, mobil)


def test_numbers_have_the_fields_of_the_parameters() -> None:
    assert MobilNumbers._fields == tuple(field.name for field in dataclasses.fields(MobilParams))


def test_an_empty_lane_gains_the_free_acceleration() -> None:
    assert gain() == pytest.approx(2.0 * (1.0 - (5.0 / 7.0) ** 4) + 1.0)
    assert gain(now=2.0 * (1.0 - (5.0 / 7.0) ** 4)) == pytest.approx(0.0)


@pytest.mark.parametrize(
    "neighbours",
    [
        {"lead": (0.0, 40.0)},  # touching, however fast the lead
        {"lead": (-3.0, 40.0)},
        {"rear": (0.0, 0.0)},  # touching, though the rear stands
        {"rear": (-5.0, 0.0)},
        {"lead": (10.0, 25.0)},  # the subject would have to brake hard
        {"rear": (10.0, 25.0)},  # the new follower would
        {"rear": (60.0, 40.0)},  # it is far but comes fast
        {"lead": (60.0, 10.0)},  # the new lead is far but slow
    ],
)
def test_unsafe_changes_are_refused(neighbours: dict[str, tuple[float, float]]) -> None:
    assert gain(**neighbours) == NO_CHANGE  # type: ignore[arg-type]


def test_safe_up_to_the_imposed_braking() -> None:
    # The gap at which a follower of equal speed brakes with exactly 2 m/s2: (42.5 / gap)^2 = 2 - (25 / 35)^4.
    limit = 42.5 / math.sqrt(2.0 - (25.0 / 35.0) ** 4)
    assert idm_acceleration(25.0, limit, 0.0, IDM) == pytest.approx(-2.0)
    for side in ("lead", "rear"):
        assert gain(**{side: (limit * 1.001, 25.0)}) > NO_CHANGE  # type: ignore[arg-type]
        assert gain(**{side: (limit * 0.999, 25.0)}) == NO_CHANGE  # type: ignore[arg-type]


def test_politeness_minds_the_new_follower_only() -> None:
    rear = (45.0, 25.0)
    after = idm_acceleration(25.0, 45.0, 0.0, IDM)
    plain, polite = gain(rear=rear, rear_now=0.5), gain(rear=rear, rear_now=0.5, mobil=POLITE)
    assert polite - plain == pytest.approx(0.5 * (after - 0.5))
    assert gain(rear=rear, rear_now=0.5) == gain()  # politeness 0: a safe follower does not count
    assert gain(rear_now=0.5, mobil=POLITE) == gain()  # nobody behind


@given(st.floats(1.0, 200.0), st.floats(0.0, 40.0), st.floats(0.0, 100.0))
def test_more_room_ahead_never_gains_less(gap: float, speed: float, room: float) -> None:
    assert gain(lead=(gap + room, speed)) >= gain(lead=(gap, speed))


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(MobilParams)])
@pytest.mark.parametrize("value", [-1.0, math.nan, 1e6])
def test_parameters_are_checked(field: str, value: float) -> None:
    with pytest.raises(InputError, match=f"mobil.{field} = "):
        MobilParams(**{field: value})
