from __future__ import annotations

import math

import numpy as np
import pytest

from cornerforge._checks import check_finite, check_in, check_integer, check_is_json, check_number
from cornerforge._words import shown
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


@pytest.mark.parametrize("value", [10**400, -(10**400)])
def test_numbers_of_hundreds_of_digits_are_out_of_range(value: int) -> None:
    with pytest.raises(InputError, match=r"share = .* is out of range; allowed: 0\.0 to 1\.0\."):
        check_number("share", value, low=0.0, high=1.0)
    with pytest.raises(InputError, match=r"tests = .* is out of range; allowed: from 1 to 5\."):
        check_integer("tests", value, low=1, high=5)


class Unwritable:
    def __repr__(self) -> str:
        raise RuntimeError


def test_a_value_is_shown_in_few_words() -> None:
    assert shown(np.zeros((2, 2))) == "array([[0., 0.], [0., 0.]])"
    assert "Unwritable" in shown(Unwritable())
    assert shown(10**5000) == "<int>"
    assert len(shown("x" * 10**6)) < 200


def test_what_json_holds_is_copied() -> None:
    about = {"seed": 1, "curve": [{"loss": 0.5}], "name": "ä", "none": None}
    assert check_is_json("about", about) == about
    assert check_is_json("about", about) is not about


@pytest.mark.parametrize(
    ("about", "message"),
    [
        (None, "about = None is not a dictionary"),
        ([("a", 1)], "about = .* is not a dictionary"),
        ({1: 2}, "about = {1: 2} is not a dictionary with texts as keys"),
        ({"a": object()}, r"about\['a'\] = .* cannot be kept as JSON"),
        ({"a": math.nan}, r"about\['a'\] = nan cannot be kept as JSON"),
        ({"a": {"b": [math.inf]}}, r"about\['a'\] = .* cannot be kept as JSON"),
        ({"a": np.float32(1.0)}, r"about\['a'\] = .* cannot be kept as JSON"),
        ({"a": b"x"}, r"about\['a'\] = b'x' cannot be kept as JSON"),
        ({"a": "\udcff"}, r"about\['a'\] = .* cannot be kept as JSON"),
        ({"a": {(1, 2): 3}}, r"about\['a'\] = .* cannot be kept as JSON"),
    ],
)
def test_what_json_cannot_hold_is_named(about: object, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}") as caught:
        check_is_json("about", about)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_what_holds_itself_is_no_json() -> None:
    about: dict[str, object] = {}
    about["a"] = about
    with pytest.raises(InputError, match="cannot be kept as JSON"):
        check_is_json("about", about)


def test_a_message_is_one_line_that_can_be_printed() -> None:
    """Names in it come from users and files: line ends, escapes of terminals, halves of characters, any length."""
    said = str(CornerForgeError("no file a\nb\x1b[31m\udcff\0 ä 道"))
    assert said == r"no file a\nb\x1b[31m\udcff\x00 ä 道"
    long = str(UnknownNameError("AV", "x" * 10**6, ["idm-mobil"]))
    assert len(long) <= 2_000
    assert long.startswith('No AV "xxx')
    assert long.endswith("Known: idm-mobil.")
