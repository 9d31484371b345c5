from __future__ import annotations

import dataclasses
import math
from typing import get_type_hints

import numpy as np
import pytest

from cornerforge._schema import unit_of
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.types import (
    ACCELERATIONS,
    ACTION_ACCELERATIONS,
    ACTION_HOLD,
    ACTION_LEFT,
    ACTION_RIGHT,
    ACTION_SIDES,
    ACTIONS,
    N_ACTIONS,
    ODDS,
    Odd,
    Scenario,
    odd_named,
)

NUMBERS = [
    "lane_width",
    "vehicle_length",
    "vehicle_width",
    "max_speed",
    "lane_change_duration",
    "max_lateral_acceleration",
    "test_length",
    "time_limit",
    "av_start",
    "traffic_length",
]


def test_numbers_given_as_whole_ones_are_floats() -> None:
    """Kernels would be compiled once more for them."""
    whole = Odd(test_length=400, max_jerk=10)
    assert (type(whole.test_length), type(whole.max_jerk)) == (float, float)


def test_the_33_actions() -> None:
    assert {ACTION_LEFT, ACTION_RIGHT} == {0, 1}
    assert 2 + ACCELERATIONS.size == N_ACTIONS == 33
    assert [f"{a:.1f}" for a in ACCELERATIONS[[0, 1, 20, 30]]] == ["-4.0", "-3.8", "0.0", "2.0"]
    # each is the number that its decimal stands for, so that files and comparisons agree
    assert all(float(f"{a:.1f}") == a for a in ACCELERATIONS)


def test_one_table_says_what_an_action_is() -> None:
    assert [ACTIONS[k].name for k in (ACTION_LEFT, ACTION_RIGHT, 2, 3, ACTION_HOLD, 32)] == [
        "change to the left", "change to the right", "-4.0 m/s²", "-3.8 m/s²", "+0.0 m/s²", "+2.0 m/s²",
    ]  # fmt: skip
    assert ACTION_SIDES.tolist() == [1, -1] + 31 * [0], "files hold the indices, so their order is for ever"
    assert ACTION_ACCELERATIONS.tolist() == [0.0, 0.0, *ACCELERATIONS.tolist()]
    assert ACTION_HOLD == 22
    assert len({action.name for action in ACTIONS}) == N_ACTIONS


@pytest.mark.parametrize("name", sorted(ODDS))
def test_odds_are_named(name: str) -> None:
    assert odd_named(name).name == name


def test_an_unknown_odd_names_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r'No ODD "swif"\. Did you mean "swift"\?'):
        odd_named("swif")


def test_the_papers_odd_decides_once_a_second() -> None:
    assert ODDS["paper"].av_substeps == 10
    assert ODDS["paper"].lane_change_duration == 1.0
    assert ODDS["default"] == Odd()


@pytest.mark.parametrize("field", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 1e9])
def test_an_odd_refuses_numbers_out_of_range(field: str, value: float) -> None:
    with pytest.raises(InputError, match=f"odd.{field} = "):
        dataclasses.replace(Odd(), **{field: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [math.nan, -math.inf, -1.0, 0.0, 1e9])
def test_a_limit_of_jerk_is_a_number_in_range_or_none(value: float) -> None:
    assert Odd(max_jerk=math.inf).max_jerk == math.inf
    with pytest.raises(InputError, match=r"odd\.max_jerk = "):
        Odd(max_jerk=value)


@pytest.mark.parametrize(("field", "value"), [("n_lanes", 1), ("n_lanes", 7), ("av_substeps", 0), ("av_substeps", 11)])
def test_an_odd_refuses_counts_out_of_range(field: str, value: int) -> None:
    with pytest.raises(InputError, match=str(value)):
        dataclasses.replace(Odd(), **{field: value})  # type: ignore[arg-type]


def test_all_fields_with_a_dimension_state_their_unit() -> None:
    stated = {name for name, kind in get_type_hints(Odd, include_extras=True).items() if unit_of(kind.__metadata__[0])}
    assert stated == {*NUMBERS, "slower_right", "max_jerk", "road_at"}
    assert {f.name for f in dataclasses.fields(Scenario) if "unit" in f.metadata} == {
        "x",
        "y",
        "speed",
        "heading",
        "acceleration",
        "length",
        "width",
        "change_time",
        "signals_s",
        "shortfall",
        "excess",
    }


def test_data_is_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Odd().n_lanes = 4  # type: ignore[misc]
    assert np.isfinite(ACCELERATIONS).all()
