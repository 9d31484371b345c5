from __future__ import annotations

import math

import numpy as np
import pytest

from cornerforge._checks import check_finite, check_in, check_integer, check_number
from cornerforge.errors import CornerForgeError, InputError, UnknownNameError


@pytest.mark.parametrize("value", [1, 5, np.int64(3)])
def test_integers_inside_pass_as_int(value: int) -> None:
    result = check_integer("tests", value, low=1, high=5)
    assert result == value
    assert type(result) is int


@pytest.mark.parametrize("value", [0, 6, True, 2.0, "3", None, math.nan])
def test_other_integers_are_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"tests = .* from 1 to 5\.") as caught:
        check_integer("tests", value, low=1, high=5)  # type: ignore[arg-type]
    assert repr(value) in str(caught.value)


def test_integer_without_upper_limit() -> None:
    assert check_integer("seed", 10**30, low=0) == 10**30
    with pytest.raises(InputError, match=r"seed = -1 is out of range; allowed: at least 0\."):
        check_integer("seed", -1, low=0)


@pytest.mark.parametrize("value", [0, 1.5, np.float32(0.5), np.int16(2)])
def test_numbers_inside_pass_as_float(value: float) -> None:
    result = check_number("odd.lane_width", value, low=0.0, high=2.0, unit="m")
    assert result == value
    assert type(result) is float


@pytest.mark.parametrize("value", [-0.1, 2.1, math.nan, math.inf, -math.inf, "1", None, True])
def test_other_numbers_are_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"^odd\.lane_width = .*; allowed: 0\.0 to 2\.0 m\.$"):
        check_number("odd.lane_width", value, low=0.0, high=2.0, unit="m")  # type: ignore[arg-type]


def test_names() -> None:
    assert check_in("format", "csv", ("csv", "parquet")) == "csv"
    with pytest.raises(UnknownNameError, match=r'No format "parket". Did you mean "parquet"\?'):
        check_in("format", "parket", ("csv", "parquet"))
    with pytest.raises(UnknownNameError, match=r'No format "zzz". Known: csv, parquet\.'):
        check_in("format", "zzz", ("csv", "parquet"))


def test_finite_names_the_first_place_and_counts() -> None:
    values = np.zeros((2, 3))
    check_finite("speed", values)
    values[1, 0] = math.nan
    values[1, 2] = -math.inf
    with pytest.raises(InputError, match=r"speed\[1, 0\] = nan is not finite \(2 such"):
        check_finite("speed", values)


def test_errors_can_be_caught_as_ours_or_as_pythons() -> None:
    for kind in (CornerForgeError, ValueError):
        with pytest.raises(kind):
            check_integer("tests", 0, low=1)
