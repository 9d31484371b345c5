"""Numbers of a result that was read that cannot all be true."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from cornerforge.results.analysis import Analysed, Avoidability, Judges, Prevented
from cornerforge.results.driving import CasesMade, NaturalRate, Simulated
from cornerforge.results.html import IN_INTERVAL

__all__ = ["contradiction"]

_ROUNDED = 1e-6
_NEVER_NEGATIVE = ("seconds", "miles", "per_test", "per_mile", "half_width", "reaction_s", "share")
"""Ends of names of numbers that are at least 0; a share is at most 1 too."""


def contradiction(result: Any) -> str | None:
    """Name the first number of a result that cannot be true, alone or beside another; None: there is none.

    >>> from cornerforge.results.analysis import ShareAtReaction
    >>> contradiction(ShareAtReaction(reaction_s=1.0, cases=1, share=0.5, interval95=(0.1, 0.2)))
    '"share" is 0.5 and "interval95" (0.1, 0.2)'
    """
    return next(_within(result, ""), None)


def _within(result: Any, place: str) -> Iterator[str]:
    """Find what contradicts itself in a result and in its parts."""
    if is_dataclass(result):
        yield from _of_intervals(result, place)
        for kind, rule in _RULES.items():
            if isinstance(result, kind):
                yield from (f'"{place}{said}' for said in rule(result))
        parts: Iterable[tuple[Any, Any]] = [(one.name, getattr(result, one.name)) for one in fields(result)]
        for name, part in parts:
            most = 1.0 + _ROUNDED if name.endswith("share") else math.inf
            if isinstance(part, float) and name.endswith(_NEVER_NEGATIVE) and (part < 0.0 or part > most):
                yield f'"{place}{name}" is {part}'
    elif isinstance(result, Mapping):
        parts = result.items()
    else:
        parts = enumerate(result) if isinstance(result, tuple) else ()
    for name, part in parts:
        yield from _within(part, f"{place}{name}.")


def _of_intervals(result: Any, place: str) -> Iterator[str]:
    for interval, names in IN_INTERVAL.items():
        found = getattr(result, interval, None)
        if found is None:
            continue
        low, high = found
        if low > high:
            yield f'"{place}{interval}" ends before it begins, {found}'
        name = next((name for name in names if hasattr(result, name)), None)
        value = None if name is None else getattr(result, name)
        if name is not None and (low < 0.0 or (name.endswith(("share", "chance")) and high > 1.0 + _ROUNDED)):
            yield f'"{place}{interval}" is {found}'
        if value is not None and not low * (1.0 - _ROUNDED) <= value <= high * (1.0 + _ROUNDED):
            yield f'"{place}{name}" is {value} and "{interval}" {found}'


def _parts(name: str, counts: Mapping[Any, int], whole: int, total: str = "cases") -> Iterator[str]:
    """Compare the parts that a whole falls into, each case in one, with the whole."""
    if sum(counts.values()) != whole:
        yield f'{name}" are {sum(counts.values())} together and "{total}" {whole}'


def _share(name: str, share: float, part: int, whole: int, total: str = "cases") -> Iterator[str]:
    """Compare a share with the counts that it is made of."""
    if part > whole or abs(share * whole - part) > 0.5:
        yield f'{name}" is {share} and the counts are {part} of {whole} {total}'


def _of_counted(found: Simulated | CasesMade) -> Iterator[str]:
    yield from _share("crashes_per_test", found.crashes_per_test, found.av_crashes, found.tests, "tests")


def _of_rate(found: NaturalRate) -> Iterator[str]:
    if found.method == "mc":
        yield from _share("crashes_per_test", found.crashes_per_test, found.av_crashes, found.tests, "tests")
        yield from _parts("crash_types", found.crash_types, found.av_crashes, "av_crashes")
        yield from _parts("mechanisms", found.mechanisms, found.av_crashes, "av_crashes")
    if abs(found.bv_crashes_per_test * found.plain_tests - found.bv_crashes) > 0.5:
        yield f'bv_crashes_per_test" is {found.bv_crashes_per_test} and "bv_crashes" {found.bv_crashes}'


def _of_avoidability(found: Avoidability) -> Iterator[str]:
    yield from _parts("labels", {**found.labels, "": found.not_judged}, found.cases)


def _of_prevented(found: Prevented) -> Iterator[str]:
    for name, one in {**{f"by.{name}": one for name, one in found.by.items()}, "any": found.any}.items():
        yield from _share(f"{name}.share", one.share, one.cases, found.cases)
        if one.by_braking > one.cases:
            yield f'{name}.by_braking" is {one.by_braking} and "cases" {one.cases}'


def _of_judges(found: Judges) -> Iterator[str]:
    names = found.both.keys()
    for table, rows in (("both", found.both), ("agreement", found.agreement)):
        for name in names:
            lacks = names - rows.get(name, {}).keys()
            if lacks:
                yield f'{table}.{name}.{min(lacks)}" is missing and "both" has it'
    if any(count > found.cases for row in found.both.values() for count in row.values()):
        yield f'both" has more than "cases", {found.cases}'
    for name, shares in {"avoidable": found.avoidable, "lead": (found.lead,), **found.prevented}.items():
        for one in shares:
            yield from _share(f"{name}.share", one.share, one.cases, found.cases)


def _of_analysed(found: Analysed) -> Iterator[str]:
    yield from _parts("majority, minority", {"majority": found.majority, "minority": found.minority}, found.cases)
    yield from _parts("clusters", {one.id: one.size for one in found.clusters}, found.cases)
    yield from _parts("crash_types", found.crash_types, found.cases)
    yield from _parts("striker", found.striker, found.cases)
    conducts = {} if found.own_doing is None else found.own_doing.conducts
    some: dict[str, Mapping[Any, int]] = {"fault": found.fault, "fault_rules": found.fault_rules, "conducts": conducts}
    for name, counts in some.items():
        if sum(counts.values()) > found.cases:
            yield f'{name}" are {sum(counts.values())} together and "cases" {found.cases}'
    for one in found.clusters:
        yield from _parts(f"clusters.{one.id}.crash_types", one.crash_types, one.size, "size")
    for name, quantiles in found.severity.items():
        if name.endswith("probability") and not all(0.0 <= value <= 1.0 for value in quantiles.values()):
            yield f'severity.{name}" is {quantiles}'


_RULES: dict[type, Any] = {
    Simulated: _of_counted,
    CasesMade: _of_counted,
    NaturalRate: _of_rate,
    Avoidability: _of_avoidability,
    Prevented: _of_prevented,
    Judges: _of_judges,
    Analysed: _of_analysed,
}
