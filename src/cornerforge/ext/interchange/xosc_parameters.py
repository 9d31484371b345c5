"""Parameters and catalogs of OpenSCENARIO files: what stands in their place is put there before anything is read.

A value is "$name", or an expression "${...}" of numbers, parameters, + - * / %, brackets, the functions round, floor,
ceil, sqrt, pow, sign, abs, min and max, and not, and, or.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NoReturn

from cornerforge.errors import DataError, FileFormatError, InputError
from cornerforge.ext.interchange.xml_input import Element, read_xml

__all__ = ["ROOT", "Catalogs", "put_parameters", "safe_path"]

ROOT = "OpenSCENARIO"
_DEEPEST = 50
"""Parameters that refer to parameters, and brackets in brackets."""
_LONGEST = 2000
_MOST_CATALOGS = 50
_MOST_COPIED = 500_000
"""Elements taken from catalogs."""
_TOKEN = re.compile(r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|(\$?[A-Za-z_][\w.\-]*)|(.))")
_NAME = re.compile(r"\$([A-Za-z_][\w.\-]*)")
_FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "round": (1, lambda x: math.floor(x + 0.5)),
    "floor": (1, math.floor),
    "ceil": (1, math.ceil),
    "sqrt": (1, math.sqrt),
    "abs": (1, abs),
    "sign": (1, lambda x: (x > 0.0) - (x < 0.0)),
    "pow": (2, math.pow),
    "min": (2, min),
    "max": (2, max),
}


def put_parameters(element: Element, *, given: Mapping[str, str] | None = None, outer: _Scope | None = None) -> None:
    """Replace all references to parameters in an element and below it.

    Args:
        element: Its own declarations and those of its parts hold for what stands in them.
        given: Values given to its own declarations from outside.
        outer: Parameters that hold around it.

    Raises:
        DataError: A parameter is not declared, refers to itself, or an expression cannot be computed.
    """
    declared = element.child("ParameterDeclarations")
    scope = outer or _Scope(None, {})
    if declared is not None and declared.children:
        own = {part.string("name"): part.string("value") for part in declared.all("ParameterDeclaration")}
        scope = _Scope(outer, {name: (given or {}).get(name, value) for name, value in own.items()})
        for name in own:
            scope.value(name, declared)
    for name, text in element.attributes.items():
        if "$" in text:
            try:
                element.attributes[name] = scope.put(text, element)
            except DataError:
                if name != "name":  # what things are called moves nothing
                    raise
    for child in element.children:
        if child is not declared:
            put_parameters(child, outer=scope)


class _Scope:
    """Parameters that hold somewhere, each computed once."""

    def __init__(self, outer: _Scope | None, raw: Mapping[str, str]) -> None:
        self.outer, self.raw = outer, raw
        self.known: dict[str, str] = {}
        self.asked: set[str] = set()

    def value(self, name: str, element: Element) -> str:
        """Value of a parameter."""
        while name not in self.raw and self.outer is None and "." in name:  # "$a.b" is a followed by text
            name = name.rpartition(".")[0]
        if name not in self.raw:
            if self.outer is None:
                element.fault(f'parameter "{name[:40]}" is not declared')
            return self.outer.value(name, element)
        if name not in self.known:
            if name in self.asked or len(self.asked) > _DEEPEST:
                element.fault(f'parameter "{name[:40]}" refers to itself, or through more than {_DEEPEST} others')
            self.asked.add(name)
            self.known[name] = self.put(self.raw[name], element)
            self.asked.remove(name)
        return self.known[name]

    def put(self, text: str, element: Element) -> str:
        """Value of a text with references."""
        text = text.strip()
        if "$" not in text:
            return text
        if len(text) > _LONGEST:
            element.fault(f"an expression has {len(text):,} characters; up to {_LONGEST:,} are read")
        if text.startswith("${") and text.endswith("}"):
            return _Expression(text[2:-1], lambda name: self.value(name, element), element).value()
        if _NAME.fullmatch(text):
            return self.value(text[1:], element)
        return element.fault(f'"{text[:40]}" is neither a parameter ($name) nor an expression (${{...}})')


class _Expression:
    """Computes one expression, by descent."""

    def __init__(self, text: str, parameter: Callable[[str], str], element: Element) -> None:
        self.tokens: list[str] = [next(filter(None, found.groups())) for found in _TOKEN.finditer(text.strip())]
        self.text, self.parameter, self.element = text, parameter, element
        self.next = self.depth = 0

    def value(self) -> str:
        try:
            result = self._or()
            if self.next < len(self.tokens):
                self._fail()
            if isinstance(result, str):
                return result
            if isinstance(result, bool):
                return "true" if result else "false"
            if not math.isfinite(result):
                self._fail()
            return str(int(result)) if float(result).is_integer() and abs(result) < 1e15 else repr(float(result))
        except (ArithmeticError, ValueError, TypeError) as error:
            if isinstance(error, DataError):
                raise
            self._fail()

    def _fail(self) -> NoReturn:
        self.element.fault(
            f'expression "{self.text[:60].strip()}" cannot be computed; + - * / %, brackets, not, and, or, '
            f"{', '.join(_FUNCTIONS)} can"
        )

    def _take(self, *wanted: str) -> str | None:
        if self.next < len(self.tokens) and self.tokens[self.next] in wanted:
            self.next += 1
            return self.tokens[self.next - 1]
        return None

    def _or(self) -> float | bool | str:
        result = self._and()
        while self._take("or"):
            other = self._and()
            result = _truth(result) or _truth(other)
        return result

    def _and(self) -> float | bool | str:
        result = self._sum()
        while self._take("and"):
            other = self._sum()
            result = _truth(result) and _truth(other)
        return result

    def _sum(self) -> float | bool | str:
        result = self._product()
        while sign := self._take("+", "-"):
            other = _number(self._product())
            result = _number(result) + (other if sign == "+" else -other)
        return result

    def _product(self) -> float | bool | str:
        result = self._single()
        while sign := self._take("*", "/", "%"):
            a, b = _number(result), _number(self._single())
            result = a * b if sign == "*" else a / b if sign == "/" else math.fmod(a, b)
        return result

    def _single(self) -> float | bool | str:
        self.depth += 1
        if self.depth > _DEEPEST or self.next >= len(self.tokens):
            self._fail()
        result = self._atom()
        self.depth -= 1
        return result

    def _atom(self) -> float | bool | str:
        if self._take("-"):
            return -_number(self._single())
        if self._take("+"):
            return _number(self._single())
        if self._take("not"):
            return not _truth(self._single())
        if self._take("("):
            result = self._or()
            if not self._take(")"):
                self._fail()
            return result
        token = self.tokens[self.next]
        self.next += 1
        if token in _FUNCTIONS:
            return self._function(token)
        if token.startswith("$"):
            return _literal(self.parameter(token[1:]))
        if token in ("true", "false"):
            return token == "true"
        return float(token)

    def _function(self, name: str) -> float:
        count, function = _FUNCTIONS[name]
        if not self._take("("):
            self._fail()
        values = [_number(self._or())]
        while self._take(","):
            values.append(_number(self._or()))
        if not self._take(")") or len(values) != count:
            self._fail()
        return float(function(*values))


def _literal(text: str) -> float | bool | str:
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


def _number(value: float | bool | str) -> float:
    if isinstance(value, (bool, str)):
        raise TypeError
    return value


def _truth(value: float | bool | str) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


def safe_path(scenario: Path, stated: str, element: Element) -> Path:
    """Find a file or folder that a scenario names, below the folder above its own and nowhere else.

    Scenarios of others name roads and catalogs by "../xodr/road.xodr"; what lies farther off, or on another machine,
    is not opened.

    Raises:
        DataError: It lies elsewhere.
    """
    base = scenario.resolve().parent
    try:
        found = (base / stated.replace("\\", "/")).resolve()
    except (OSError, ValueError, RuntimeError):
        element.fault(f'"{stated[:80]}" is no path')
    if "://" in stated or not found.is_relative_to(base.parent):
        element.fault(
            f'"{stated[:80]}" lies outside {base.parent.name or base.parent}/; roads and catalogs are read from the '
            "folder of the scenario, the one above it, and what lies in them. Copy it there"
        )
    return found


class Catalogs:
    """Looks up what scenarios refer to in catalogs.

    Args:
        scenario: The scenario's file.
        top: Its outermost element, parameters put.
    """

    def __init__(self, scenario: Path, top: Element) -> None:
        self.scenario, self.top = scenario, top
        self.read: dict[Path, Element | FileFormatError | None] = {}
        self.copied = 0

    def entry(self, reference: Element) -> Element:
        """Find the entry that a CatalogReference names, with its parameters put.

        Raises:
            DataError: There is none, or its folder lies elsewhere.
            FileFormatError: The catalog's file is damaged.
        """
        catalog, entry = reference.string("catalogName"), reference.string("entryName")
        locations = self.top.child("CatalogLocations")
        folders = [
            safe_path(self.scenario, folder.string("path"), folder)
            for location in (locations.children if locations is not None else ())
            for folder in location.all("Directory")
        ]
        for folder in folders:
            for part in self._catalogs(folder, catalog):
                for found in part.children:
                    if found.attributes.get("name") == entry:
                        return self._own(found, reference)
        return reference.fault(f'no entry "{entry[:40]}" in a catalog "{catalog[:40]}" of its CatalogLocations')

    def _catalogs(self, folder: Path, name: str) -> Iterator[Element]:
        """The catalogs of a name in a folder: first that in the file of the same name, then those in other files."""
        try:
            files = sorted(folder.glob("*.xosc"))[:_MOST_CATALOGS] if folder.is_dir() else []
        except OSError as error:
            raise InputError(f"Cannot read {folder}: {error.strerror}.") from error
        for file in sorted(files, key=lambda file: file.stem != name):
            found = self._read(file)
            if isinstance(found, FileFormatError) and file.stem == name:
                raise found
            if isinstance(found, Element) and found.attributes.get("name") == name:
                yield found

    def _read(self, file: Path) -> Element | FileFormatError | None:
        """The catalog in a file; None: it holds none; or why it cannot be read, for others may lie there too."""
        if file not in self.read:
            try:
                self.read[file] = read_xml(file, root=ROOT, what="an OpenSCENARIO file").child("Catalog")
            except FileFormatError as error:
                self.read[file] = error
        return self.read[file]

    def _own(self, found: Element, reference: Element) -> Element:
        self.copied += found.size
        if self.copied > _MOST_COPIED:
            reference.fault("what the scenario takes from catalogs is too much")
        copy = _copied(found)
        assignments = reference.child("ParameterAssignments")
        given = {
            part.string("parameterRef").lstrip("$"): part.string("value")
            for part in (assignments.all("ParameterAssignment") if assignments is not None else ())
        }
        put_parameters(copy, given=given)
        return copy


def _copied(element: Element) -> Element:
    return Element(
        element.tag,
        dict(element.attributes),
        element.line,
        element.file,
        [_copied(c) for c in element.children],
        element.text,
    )
