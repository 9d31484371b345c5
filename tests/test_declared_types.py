"""Declared types: what does not fit one is named with its place, its value and what it must be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest

from cornerforge._schema import Closed, Hex, Share, Whole, check_fields, meant, parse, read, unit_of
from cornerforge.errors import FileFormatError, InputError


class Inner(Closed, frozen=True):
    kind: Literal["car", "truck"]
    hash: Hex | None = None

    def __post_init__(self) -> None:
        if self.kind == "truck" and self.hash is not None:
            raise InputError("A truck has no hash.")


@dataclass(frozen=True)
class Outer:
    count: Whole
    length: Annotated[float, meant("Of its box.", "m", 0.5, 30)] = 5.0
    lanes: Annotated[int, meant("Lanes.", "", 2, 6)] = 3
    inner: tuple[Inner, ...] = ()
    shares: dict[Literal["av", "bv"], Share] | None = None
    nested: dict[str, dict[str, list[Whole]]] | None = None

    def __post_init__(self) -> None:
        check_fields(self, "outer.", but=("lanes",) if self.lanes == 0 else ())


FINE = {"count": 1, "inner": [{"kind": "car", "hash": "0af"}, {"kind": "truck"}], "shares": {"av": 1}, "more": 1}


def test_what_fits_is_made_and_keys_without_a_field_are_passed_over() -> None:
    made = read(Outer, FINE, "x")
    assert made == Outer(1, inner=(Inner("car", "0af"), Inner("truck")), shares={"av": 1.0})
    assert isinstance(made.length, float)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": -1}, '"count" is -1; it must be a whole number of at least 0'),
        ({"count": True}, '"count" is True; it must be a whole number'),
        ({"count": ...}, '"count" is missing'),
        ({"length": 31}, '"length" is 31; it must be a number of at most 30.0'),
        ({"length": float("nan")}, '"length" is nan; it must be a number of at least 0.5'),
        ({"inner": {}}, '"inner" is {}; it must be a list'),
        ({"inner": [{"kind": "car"}, {}]}, '"inner[1].kind" is missing'),
        ({"inner": [{"kind": "car", "wheels": 4}]}, '"inner[0].wheels" is unknown'),
        ({"inner": [{"kind": "tram"}]}, "\"inner[0].kind\" is 'tram'; it must be one of car, truck"),
        ({"inner": [{"kind": "car", "hash": "0g"}]}, "\"inner[0].hash\" is '0g'; it must be a text of the form"),
        ({"inner": [{"kind": "car", "hash": "0a\n"}]}, "it must be a text of the form"),
        ({"inner": [{"kind": "truck", "hash": "0a"}]}, '"inner[0]": A truck has no hash'),
        ({"shares": {"road": 1}}, "\"shares\" holds 'road'; it must be a name that is known there"),
        ({"shares": {"av": 1, "bv": 2}}, '"shares.bv" is 2; it must be a number of at most 1.0'),
        ({"shares": {"av": 1, "bv": "2"}}, "\"shares.bv\" is '2'; it must be a number"),
        ({"nested": {"a": {}, "b c": {"d": [1, -1]}}}, '"nested.b c.d[1]" is -1; it must be a whole number'),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], message: str) -> None:
    content = {key: value for key, value in {**FINE, **changes}.items() if value is not ...}
    with pytest.raises(FileFormatError) as raised:
        read(Outer, content, "a.json", "make it again")
    assert str(raised.value).startswith("a.json: ")
    assert message in str(raised.value)
    assert str(raised.value).endswith("; make it again")


def test_what_is_no_object_is_told() -> None:
    with pytest.raises(FileFormatError, match=r"^a.json: it is \[1\]; it must be an object\.$"):
        read(Outer, [1], "a.json")


def test_numbers_from_python_are_held_to_the_same_ranges() -> None:
    assert unit_of(meant("Of its box.", "m")) == "m"
    with pytest.raises(InputError, match=r"outer\.length = 0\.1 m is out of range; allowed: 0\.5 to 30"):
        Outer(1, length=0.1)
    with pytest.raises(InputError, match=r"outer\.lanes = 7 is out of range"):
        Outer(1, lanes=7)
    assert Outer(1, lanes=0).lanes == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [('{"a": 1, "a": 2}', 'the key "a" is there twice'), ("[NaN]", "NaN is no number"), ("[1e999]", "is too large")],
)
def test_json_is_read_strictly(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse(text)
