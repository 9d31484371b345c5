"""Reading of results: what is written comes back, and what a file has wrong is named with its place."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from results_page import UNIONS

from cornerforge import results
from cornerforge._schema import Whole, read
from cornerforge.errors import FileFormatError
from cornerforge.results import Analysed, Simulated, as_json, from_json
from cornerforge.results.analysis import FAULTS
from cornerforge.results.stating import from_file

CLASSES = [thing for name in results.__all__ if isinstance(thing := getattr(results, name), type)]
KINDS = [pytest.param(kind, id=kind.__name__) for kind in CLASSES]
SCALARS: dict[Any, st.SearchStrategy[Any]] = {
    Any: st.none() | st.booleans() | st.integers(0) | st.text(),
    NoneType: st.none(),
    bool: st.booleans(),
    float: st.floats(allow_nan=False, allow_infinity=False),
    int: st.integers(0, 2**60),  # sums of a few stay below 2^63
    str: st.text(max_size=5),
}


def drawn(kind: Any) -> st.SearchStrategy[Any]:
    """Values of a field's type that a file may hold, within its range."""
    origin, arguments = get_origin(kind), get_args(kind)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return st.builds(kind, **{name: drawn(one) for name, one in get_type_hints(kind, include_extras=True).items()})
    if origin is Annotated:
        ranges = [one for one in kind.__metadata__ if one.ge is not None]
        if not ranges:
            return drawn(kind.__origin__)
        return st.floats(ranges[0].ge, ranges[0].le) if kind.__origin__ is float else SCALARS[int]
    if origin in UNIONS:
        return st.one_of(*map(drawn, arguments))
    if origin is Literal:
        return st.sampled_from(arguments)
    if origin is dict:
        return st.dictionaries(drawn(arguments[0]), drawn(arguments[1]), max_size=2)
    if origin is tuple and arguments[-1] is Ellipsis:
        return st.lists(drawn(arguments[0]), max_size=2).map(tuple)
    return st.tuples(*map(drawn, arguments)) if origin is tuple else SCALARS[kind]


def made_of(kind: type, content: Any) -> Any:
    return read(kind, content, "made.json", "write the file again with: cornerforge make")


LARGE = settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large], max_examples=20)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", KINDS)
@LARGE
@given(data=st.data())
def test_a_result_comes_back_from_its_file(kind: type, data: st.DataObject) -> None:
    made = data.draw(drawn(kind))
    text = json.dumps(as_json(made), allow_nan=False)
    assert made_of(kind, json.loads(text)) == made == from_json(kind, json.loads(text))
    assert json.dumps(as_json(from_json(kind, json.loads(text)))) == text


def wrong_for(kind: Any) -> Any:
    """A value of JSON that no field of this type may hold; None where any value may stand."""
    if kind is Any:
        return None
    return 7 if bool in (kind, *get_args(kind)) else True


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", KINDS)
@LARGE
@given(data=st.data())
def test_each_field_that_is_missing_or_of_another_type_is_named(kind: type, data: st.DataObject) -> None:
    content = as_json(data.draw(drawn(kind)))
    for one in dataclasses.fields(kind):
        less = {key: value for key, value in content.items() if key != one.name}
        if one.default is dataclasses.MISSING:
            with pytest.raises(FileFormatError, match=f'^made.json: "{one.name}" is missing; .*: cornerforge make$'):
                made_of(kind, less)
        else:
            made_of(kind, less)
        wrong = wrong_for(get_type_hints(kind)[one.name])
        if wrong is not None:
            with pytest.raises(FileFormatError, match=f'^made.json: "{one.name}" is .*; .*: cornerforge make$'):
                made_of(kind, {**content, one.name: wrong})


COUNTED = {
    "tests": 4, "crashes_per_test": 0.25, "interval95": [0.0, 0.8], "crashes_per_mile": None,
    "interval95_per_mile": None, "miles": 1, "av_crashes": 1, "av_faults": 0, "bv_crashes": 0, "seconds": 0.5,
    "world_steps": 3, "world_steps_per_second": 6.0, "tests_per_second": 8.0, "digest": "ab",
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tests": -1}, '"tests" is -1; it must be a whole number of at least 0'),
        ({"tests": 1.5}, '"tests" is 1.5; it must be a whole number'),
        ({"tests": 2**63}, '"tests" is 9223372036854775808; it must be a whole number of at most'),
        ({"tests": None}, '"tests" is None; it must be a whole number'),
        ({"tests": True}, '"tests" is True; it must be a whole number'),
        ({"miles": "far"}, "\"miles\" is 'far'; it must be a number"),
        ({"miles": 10**400}, '"miles": Number out of range'),
        ({"crashes_per_test": 1.5}, '"crashes_per_test" is 1.5; it must be a number of at most 1'),
        ({"crashes_per_test": float("nan")}, '"crashes_per_test" is nan; it must be a number'),
        ({"interval95": [0.0]}, '"interval95" is [0.0]; it must be a list of length 2'),
        ({"interval95": [0.0, None]}, '"interval95[1]" is None; it must be a number'),
        ({"interval95": {}}, '"interval95" is {}; it must be a list'),
        ({"digest": 3}, '"digest" is 3; it must be a text'),
        ({"distributions": {"speed": {"unit": 1}}}, '"distributions.speed.unit" is 1; it must be a text'),
        ({"distributions": []}, '"distributions" is []; it must be an object or null'),
    ],
)
def test_what_is_wrong_is_named_with_its_place(changes: dict[str, Any], message: str) -> None:
    assert made_of(Simulated, COUNTED).crashes_per_test == 0.25
    with pytest.raises(FileFormatError, match=re.escape(message)):
        made_of(Simulated, COUNTED | changes)


def test_names_are_those_of_the_type() -> None:
    @dataclasses.dataclass(frozen=True)
    class Blamed:
        fault: dict[Literal["av", "bv"], Whole]
        one: Literal["av", "bv"] | None

    Blamed.__annotations__ = {"fault": dict[Literal["av", "bv"], Whole], "one": Literal["av", "bv"] | None}
    assert made_of(Blamed, {"fault": {"bv": 2}, "one": None}) == Blamed({"bv": 2}, None)
    with pytest.raises(FileFormatError, match="\"fault\" holds 'road'; it must be a name"):
        made_of(Blamed, {"fault": {"road": 2}, "one": "av"})
    with pytest.raises(FileFormatError, match="\"one\" is 'road'; it must be one of av, bv"):
        made_of(Blamed, {"fault": {}, "one": "road"})
    assert get_args(get_args(get_type_hints(Analysed)["fault"])[0]) == FAULTS


def test_keys_of_other_versions_are_passed_over() -> None:
    assert made_of(Simulated, COUNTED | {"more": 1}) == made_of(Simulated, COUNTED)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "is missing; write it with"),
        ("{", "is damaged, it cannot be read"),
        ("[]", "holds no JSON object"),
        ('{"miles": NaN}', "is damaged, it cannot be read"),
    ],
)
def test_a_file_that_is_no_object_is_named(text: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=rf"a\.json {message}.*: cornerforge make"):
        from_file(Simulated, path, "cornerforge make")
