"""Public functions say in one sentence what an argument may be; which type each has stands in its annotation only."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

import cornerforge
from cornerforge import ext, read_case_file
from cornerforge._options import Options, options_of
from cornerforge._options import verb as as_verb
from cornerforge._schema import meant
from cornerforge.errors import InputError
from cornerforge.verbs.drive_case import DriveCase
from cornerforge.verbs.options import COMMANDS


class NddModel:  # the name is enough: the module that has the class need not be loaded
    pass


ANY = meant("Anything of its type.")


class Asked(Options):
    """Do nothing."""

    place: Annotated[Path | str, ANY] = field(kw_only=False)
    tests: Annotated[int, ANY] = field(kw_only=False, default=1)
    share: Annotated[float, meant("A part.", low=0.0, high=2.0, unit="m")] = 0.0
    flag: Annotated[bool, ANY] = False
    names: Annotated[Sequence[str] | str, ANY] = ()
    files: Annotated[Sequence[Path | str], ANY] = ()
    model: Annotated[Path | NddModel | None, ANY] = None
    told: Annotated[Callable[[int], None] | None, ANY] = None
    lanes: Annotated[int | None, meant("So many.", low=2, high=6)] = None
    way: Annotated[str, meant("How.", choices=("up", "down"))] = "up"


@as_verb(Asked)
def verb(options: Asked) -> Asked:
    """Do nothing.

    Returns:
        What was given.
    """
    return options


@pytest.mark.parametrize(
    "given",
    [
        {"place": Path("a")},
        {"tests": np.int32(3)},
        {"share": np.float32(0.5)},
        {"share": 2},
        {"flag": np.True_},
        {"names": ["a", "b"]},
        {"names": ("a",)},
        {"names": "a"},
        {"names": np.array(["a", "b"])},
        {"model": object.__new__(NddModel)},
        {"model": None},
        {"told": print},
        {"files": [Path("a"), "b"]},
        {"way": "down"},
        {"lanes": 3},
    ],
)
def test_what_annotations_allow_is_handed_on(given: dict[str, Any]) -> None:
    found = verb(**{"place": "a", **given})
    assert all(getattr(found, name) is value for name, value in given.items())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"place": 3}, r"place = 3 is not allowed; give a path or text\."),
        ({"place": b"x"}, r"place = b'x' is not allowed"),
        ({"place": ""}, r'place = "" names no file or folder'),
        ({"place": "a\0b"}, r"'a\\x00b' is no name of a file"),
        ({"place": "\udcff"}, r"'\\udcff' is no UTF-8"),
        ({"tests": True}, r"tests = True is not allowed; give a whole number\."),
        ({"tests": 2.0}, r"tests = 2\.0 is not allowed"),
        ({"tests": None}, r"tests = None is not allowed"),
        ({"tests": "x" * 10_000}, r"tests = 'xx.{,200} is not allowed"),
        ({"share": "1"}, r"share = '1' is not allowed; give a number\."),
        ({"share": False}, r"share = False is not allowed"),
        ({"flag": 1}, r"flag = 1 is not allowed; give True or False\."),
        ({"names": [1]}, r"names = \[1\] is not allowed; give a list \(each entry text\) or text\."),
        ({"names": b"ab"}, r"names = b'ab' is not allowed"),
        ({"names": iter(["a"])}, r"names = <.*> is not allowed"),
        ({"model": np.zeros((2, 2))}, r"model = array.* is not allowed; give a path, NddModel or None\."),
        ({"told": 3}, r"told = 3 is not allowed; give a function or None\."),
        ({"files": ["a", ""]}, r'files = "" names no file or folder'),
        ({"share": 2.5}, r"share = 2\.5 m is out of range; allowed: 0\.0 to 2\.0 m\."),
        ({"share": float("nan")}, r"share = nan m is out of range"),
        ({"lanes": 7}, r"lanes = 7 is out of range; allowed: from 2 to 6\."),
        ({"way": "dwn"}, r'No way "dwn"'),
    ],
)
def test_anything_else_is_named_in_one_line(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}" if message.startswith(tuple(given)) else message) as caught:
        verb(**{"place": "a", **given})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("args", "given", "message"),
    [
        ((), {}, r"^verb\(\) missing a required argument: 'place'$"),
        (("a", 1, 2), {}, r"^verb\(\) too many positional arguments$"),
        (("a",), {"lane": 3}, r"^verb\(\) got an unexpected keyword argument 'lane'$"),
    ],
)
def test_other_arguments_are_refused_as_everywhere_in_python(args: Any, given: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        verb(*args, **given)


def test_the_docstring_tells_each_argument_with_its_range() -> None:
    said = inspect.getdoc(verb)
    assert said is not None
    assert said.startswith("Do nothing.\n\nArgs:\n    place: Anything of its type.\n")
    assert "    lanes: So many. From 2 to 6.\n" in said
    assert "    share: A part [m]. From 0 to 2.\n" in said
    assert said.endswith("Returns:\n    What was given.")


# --- the public functions ---

OTHER = ("engine", "read_case_file", "write_case_file")
VERBS = [name for name in cornerforge.__all__ if callable(getattr(cornerforge, name)) and name != "avs"]
CLASSES = {told.verb.partition(":")[2]: told.options for told in (*COMMANDS, *ext.commands())}
CLASSES["drive_case"] = DriveCase


def arguments(name: str) -> dict[str, str]:
    """Arguments of a verb and how they are annotated."""
    if name in OTHER:
        return {
            one.name: str(one.annotation) for one in inspect.signature(getattr(cornerforge, name)).parameters.values()
        }
    return {one.name: str(one.type) for one, _, _ in options_of(CLASSES[name])}


def right(annotation: str) -> Any:
    """Something of the right type, though there is no such file or case."""
    if "CaseFile" in annotation and "Path" not in annotation:
        return read_case_file(Path(__file__).parents[1] / "examples" / "cases" / "hard-braking.json")
    return ["x"] if "Sequence" in annotation else "x"


def without_default(name: str) -> dict[str, Any]:
    """A value of the right type for each argument that a verb must have."""
    parameters = inspect.signature(getattr(cornerforge, name)).parameters.values()
    must = (one for one in parameters if one.default is one.empty and one.kind is not one.VAR_KEYWORD)
    return {one.name: "aeb" if one.name == "suite" else right(str(one.annotation)) for one in must}


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_help_speaks_python(name: str) -> None:
    """Options are named as in Python, long lines are broken, defaults have names, and no number has half its digits."""
    call = getattr(cornerforge, name)
    said = (call.__doc__ or "").partition("    Args:")[2].partition("\n\n")[0]
    assert " --" not in said
    assert max(map(len, said.splitlines()), default=0) <= 100
    assert "e+18" not in said
    assert " at 0x" not in str(inspect.signature(call))


WRONG: tuple[Any, ...] = (object(), 1j, {}, b"x", lambda: None)


@pytest.mark.sampled(15)
@pytest.mark.parametrize("name", VERBS)
def test_each_argument_of_each_verb_is_looked_at(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is no number, text, list or path gets into none of them, and is refused before anything is written."""
    monkeypatch.chdir(tmp_path)
    for argument, annotation in arguments(name).items():
        for value in WRONG:
            if callable(value) and ("Progress" in annotation or "Callable" in annotation):
                continue
            with pytest.raises(InputError, match=f"^{argument} = .* is not allowed; give ") as caught:
                getattr(cornerforge, name)(**without_default(name) | {argument: value})
            assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", VERBS)
def test_there_are_no_other_keywords(name: str) -> None:
    with pytest.raises(TypeError, match=rf"^{name}\(\) got an unexpected keyword argument 'no_such'$"):
        getattr(cornerforge, name)(**without_default(name), no_such=1)
