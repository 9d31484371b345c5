"""The page docs/results-json.md: what commands print with `--json`, from the types of results."""

from __future__ import annotations

import importlib
import inspect
import types
from collections.abc import Iterator, Mapping
from dataclasses import Field, fields, is_dataclass
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from cornerforge import ext
from cornerforge._schema import unit_of
from cornerforge.results.learning import TrainingCurve
from cornerforge.results.whole import Exposure
from cornerforge.verbs.options import COMMANDS

__all__ = ["FILES", "UNIONS", "classes_of_results", "results_markdown"]

FILES: dict[str, type] = {"exposure.json": Exposure, "training.json": TrainingCurve}
"""Files in the folder of `run` that no command prints, and the classes that they hold."""

UNIONS = (Union, types.UnionType)
"""Origins of `A | B`; the first is that of a union with a Literal."""


def classes_of_results() -> dict[str, type]:
    """The class of each command's result, by the command's words: what its verb says that it returns."""
    found: dict[str, type] = {}
    for told in (*COMMANDS, *ext.commands()):
        module, _, name = told.verb.partition(":")
        function = inspect.unwrap(getattr(importlib.import_module(f"cornerforge.{module}"), name))
        found[told.name or name.replace("_", "-")] = get_type_hints(function, localns={told.options.__name__: Any})[
            "return"
        ]
    return found


def _may_be_missing(one: Field[Any]) -> bool:
    return one.default is None


_WORDS = {int: "integer", float: "number", str: "string", bool: "true or false", type(None): "null", Any: "any value"}


def _in_words(kind: Any) -> str:
    """Describe a field's type in JSON; results within it by name, with a link to their tables."""
    arguments = get_args(kind)
    if get_origin(kind) in UNIONS:
        return " or ".join(map(_in_words, arguments))
    if is_dataclass(kind):
        name = getattr(kind, "__name__", "")
        return f"[{name}](#{name.lower()})"
    if get_origin(kind) is tuple:
        if arguments[-1] is Ellipsis:
            return f"list of {_in_words(arguments[0])}"
        return f"[{', '.join(map(_in_words, arguments))}]"
    if get_origin(kind) is dict:
        return f"object of {_in_words(arguments[1])} by name"
    return _WORDS[str if get_origin(kind) is Literal else kind]


def _parts(kind: Any) -> Iterator[Any]:
    """Find the results within a type, outermost first."""
    if is_dataclass(kind):
        yield kind
        for inner in get_type_hints(kind).values():
            yield from _parts(inner)
    for argument in get_args(kind):
        yield from _parts(argument)


def _table(kind: Any) -> list[str]:
    hints, meant = get_type_hints(kind), get_type_hints(kind, include_extras=True)
    rows = [
        f"| `{one.name}` | {_in_words(_type_of(one, hints))}{', may be missing' if _may_be_missing(one) else ''} "
        f"| {unit_of(said)} | {said.description} |"
        for one in fields(kind)
        for said in meant[one.name].__metadata__[-1:]
    ]
    return ["| key | type | unit | meaning |", "| --- | --- | --- | --- |", *rows, ""]


def _type_of(one: Field[Any], hints: Mapping[str, Any]) -> Any:
    """Give a field's type, without None if a None is left out."""
    kind = hints[one.name]
    return get_args(kind)[0] if _may_be_missing(one) else kind


def results_markdown(verbs: Mapping[str, Any], files: Mapping[str, Any]) -> str:
    """Write the page docs/results-json.md: a table for each verb and file, and one for each result within others.

    Args:
        verbs: A verb's name to its result's dataclass.
        files: A file's name to the dataclass that it holds; no file of a verb's own result.
    """
    lines = [
        "# What commands print with `--json`", "",
        "One object a command. From Python it is a dataclass of `cornerforge.results` whose attributes are the keys",
        "(`simulate(tests=1000).crashes_per_test`), and `cornerforge.results.as_json` makes the object of it. Lists",
        "are tuples there, and a key that may be missing is None. After the commands stand files of a run that no",
        "command prints. This page is made from the code (`make golden`).", "",
    ]  # fmt: skip
    stated = {**verbs, **files}
    for verb, kind in stated.items():
        lines += [f"## `{verb}`", "", f"`{kind.__name__}`: {kind.__doc__.splitlines()[0]}", "", *_table(kind)]
    inner = dict.fromkeys(part for kind in stated.values() for part in _parts(kind))
    own = set(stated.values())
    for part in inner:
        if part not in own:
            lines += [f"### {part.__name__}", "", part.__doc__.splitlines()[0], "", *_table(part)]
    page = "\n".join(lines)
    for verb, kind in verbs.items():  # they stand under the verb's name
        page = page.replace(f"](#{kind.__name__.lower()})", f"](#{verb.replace(' ', '-')})")
    return page
