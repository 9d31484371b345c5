"""Public functions say in one sentence what an argument may be; which type each has stands in its annotation only."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
import pytest

import cornerforge
from cornerforge import read_case_file, world_options
from cornerforge._arguments import checked
from cornerforge.errors import InputError

if TYPE_CHECKING:
    from cornerforge.ndd.model import NddModel


class Own(TypedDict, total=False):
    lanes: int


@checked
def verb(  # what it returns is what it was given, so that nothing is changed on the way
    place: Path | str,
    tests: int = 1,
    *,
    share: float = 0.0,
    flag: bool = False,
    names: Sequence[str] | str = (),
    model: Path | NddModel | None = None,
    told: Callable[[int], None] | None = None,
    free=None,
    **own: Unpack[Own],
) -> dict[str, Any]:
    given = {"place": place, "tests": tests, "share": share, "flag": flag, "names": names}
    return {**given, "model": model, "told": told, "free": free, **own}


class NddModel:  # type: ignore[no-redef]  # the name is enough: the module that has the class need not be loaded
    pass


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
        {"free": object()},
        {"lanes": 3},
    ],
)
def test_what_annotations_allow_is_handed_on(given: dict[str, Any]) -> None:
    found = verb(**{"place": "a", **given})
    assert all(found[name] is value for name, value in given.items())


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
    ],
)
def test_anything_else_is_named_in_one_line(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}" if message.startswith(tuple(given)) else message) as caught:
        verb(**{"place": "a", **given})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("args", "given", "message"),
    [
        ((), {}, "missing 1 required positional argument: 'place'"),
        (("a", 1, 2), {}, "takes from 1 to 2 positional arguments but 3 were given"),
        (("a",), {"lane": 3}, r"^verb\(\) got an unexpected keyword argument 'lane'$"),
    ],
)
def test_other_arguments_are_refused_in_the_words_of_python(args: Any, given: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        verb(*args, **given)


# --- the public functions ---

VERBS = [name for name in cornerforge.__all__ if callable(getattr(cornerforge, name)) and name != "avs"]


def arguments(name: str) -> dict[str, str]:
    """Arguments of a verb and how they are annotated."""
    found: dict[str, str] = {}
    for one in inspect.signature(getattr(cornerforge, name)).parameters.values():
        if one.kind is one.VAR_KEYWORD:
            keywords = getattr(world_options, one.annotation[len("Unpack[") : -1])
            found |= {key: told.__forward_arg__ for key, told in keywords.__annotations__.items()}
        else:
            found[one.name] = one.annotation
    return found


def right(annotation: str) -> Any:
    """Something of the right type, though there is no such file or case."""
    if annotation == "CaseFile":
        return read_case_file(Path(__file__).parents[1] / "examples" / "cases" / "hard-braking.json")
    return {"int": 1, "Sequence[Path | str]": ["x"]}.get(annotation, "x")


def without_default(name: str) -> dict[str, Any]:
    """A value of the right type for each argument that a verb must have."""
    parameters = inspect.signature(getattr(cornerforge, name)).parameters.values()
    must = (one for one in parameters if one.default is one.empty and one.kind is not one.VAR_KEYWORD)
    return {one.name: right(one.annotation) for one in must}


WRONG: tuple[Any, ...] = (object(), 1j, {}, b"x", lambda: None)


@pytest.mark.sampled(15)
@pytest.mark.parametrize("name", VERBS)
def test_each_argument_of_each_verb_is_looked_at(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is no number, text, list or path gets into none of them, and is refused before anything is written."""
    monkeypatch.chdir(tmp_path)
    for argument, annotation in arguments(name).items():
        for value in WRONG:
            if callable(value) and (annotation == "Progress" or "Callable" in annotation):
                continue
            with pytest.raises(InputError, match=f"^{argument} = .* is not allowed; give ") as caught:
                getattr(cornerforge, name)(**without_default(name) | {argument: value})
            assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", VERBS)
def test_there_are_no_other_keywords(name: str) -> None:
    with pytest.raises(TypeError, match=rf"^{name}\(\) got an unexpected keyword argument 'no_such'$"):
        getattr(cornerforge, name)(**without_default(name), no_such=1)
