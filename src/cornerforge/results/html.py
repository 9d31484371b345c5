"""Results as notebooks show them: tables of names, values with their units, 95 % intervals, and what these are of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from html import escape
from itertools import islice
from typing import Any

from cornerforge._schema import Declared, hints_of, unit_of
from cornerforge.errors import printable

__all__ = ["IN_INTERVAL", "Result", "html_of", "html_table"]

IN_INTERVAL = {
    "interval95": ("crashes_per_test", "share", "avoidable_share"),
    "interval95_per_mile": ("crashes_per_mile",),
    "interval95_miles": ("miles_between",),
    "avoidable_interval95": ("avoidable_per_test",),
    "striking_interval95": ("striking_share",),
    "paid_interval95": ("paid_per_test",),
    "unseen_kind_interval95": ("unseen_kind_chance",),
    "interval95_bv_crashes_per_bv_mile": ("bv_crashes_per_bv_mile",),
}
"""By interval: the number that it is of, the first of these that a result has."""
_COUNTED_OVER = {"per test": "tests", "per mile": "miles", "per BV-mile": "bv_miles"}
_BY_CLOCK = ("seconds", "per_second")
_UNIT_BESIDE, _UNIT_IN_NAME = "`unit`", "as its name says"
_WORDS, _FEW = 10, 3
_STYLE = "<style>.cornerforge :is(caption, th, td) { text-align: left }</style>"


class Result(Declared):
    """Result of a verb, or a part of one."""

    def _repr_html_(self) -> str:
        """Write a table for notebooks; times by the clock are left out, so that the same work shows the same."""
        rows = ((f'<span title="{html_of(meaning)}">{name}</span>', *cells) for name, meaning, *cells in _stated(self))
        return _STYLE + html_table(("", "value", "95 % interval", "n"), rows, _headline(self), most=10**6)


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str, most: int = 20) -> str:
    """Write a table.

    Args:
        head: Names of the columns, as text; "" for none.
        rows: Cells, as HTML.
        caption: Text above it.
        most: Rows that are shown; a last one says how many more there are.
    """
    given = iter(rows)
    lines = ["".join(f"<td>{cell}</td>" for cell in row) for row in islice(given, most)]
    if more := sum(1 for _ in given):
        lines.append(f'<td colspan="{len(head)}">… and {more:,} more</td>')
    names = "".join(f"<th>{html_of(name)}</th>" for name in head)
    body = f"<thead><tr>{names}</tr></thead><tbody>{''.join(f'<tr>{line}</tr>' for line in lines)}</tbody>"
    return f'<table class="cornerforge"><caption>{html_of(caption)}</caption>{body}</table>'


def html_of(value: Any, unit: str = "") -> str:
    """Write a value as HTML: numbers with four digits and their unit, texts escaped, parts of a result to unfold.

    >>> html_of(0.117812, "per test"), html_of(20000), html_of("<b>"), html_of(None), html_of(True)
    ('0.1178 per test', '20,000', '&lt;b&gt;', '–', 'yes')
    """
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        shown = f"{value:,}" if isinstance(value, int) else f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"
        return f"{shown} {html_of(unit)}".rstrip()
    if isinstance(value, Result):
        return _folded(_headline(value), value._repr_html_())
    if isinstance(value, (Mapping, tuple, list)):
        return _several(value, unit)
    return escape(printable(str(value)))


def _headline(result: Result) -> str:
    return (type(result).__doc__ or type(result).__name__).partition("\n")[0]


def _folded(summary: str, content: str, unfolded: str = "") -> str:
    return f"<details{unfolded}><summary>{html_of(summary)}</summary>{content}</details>"


def _several(values: Mapping[Any, Any] | Sequence[Any], unit: str) -> str:
    pairs = list(values.items()) if isinstance(values, Mapping) else [("", value) for value in values]
    if not pairs:
        return "none"
    if all(isinstance(value, Result) for _, value in pairs):
        head = ["", *(name for name, *_ in _stated(pairs[0][1]))]
        rows = ([html_of(name), *map(_in_one, _stated(value))] for name, value in pairs)
        table = html_table(head, rows, _headline(pairs[0][1]))
        return _folded(f"{len(pairs):,}", table, " open" if len(pairs) <= _FEW else "")
    shown = [
        f"{html_of(name)}: {html_of(value, unit)}" if name != "" else html_of(value, unit) for name, value in pairs
    ]
    apart = "<br>" if isinstance(pairs[0][1], Mapping) else ", "
    return apart.join(shown[:_WORDS]) + (f", … ({len(shown):,} in all)" if len(shown) > _WORDS else "")


def _in_one(stated: Sequence[str]) -> str:
    _, _, value, interval, _ = stated
    return f"{value} ({interval})" if interval else value


def _stated(result: Result) -> Iterator[tuple[str, str, str, str, str]]:
    """Give name, meaning, and as HTML value, interval and number of each field; "" for what it does not have."""
    kind: Any = type(result)
    interval_of = {name: one.name for one in fields(kind) if (name := _quantity_of(one.name, result))}
    for one in fields(kind):
        value = getattr(result, one.name)
        if one.name in interval_of.values() or one.name.endswith(_BY_CLOCK) or (value is None and one.default is None):
            continue
        said = hints_of(kind)[one.name].__metadata__[-1]
        unit = unit_of(said)
        unit = getattr(result, "unit", "") if unit == _UNIT_BESIDE else "" if unit == _UNIT_IN_NAME else unit
        interval = getattr(result, interval_of.get(one.name, ""), None)
        over = getattr(result, _COUNTED_OVER.get(unit, ""), None)
        n = "" if interval is None or over is None else f"{html_of(over)} {_COUNTED_OVER[unit]}"
        value_is_interval = "interval" in one.name and isinstance(value, (tuple, list))
        shown = _from_to(value) if value_is_interval else html_of(value, unit)
        yield one.name, said.description or "", shown, "" if interval is None else _from_to(interval), n


def _quantity_of(interval: str, result: Result) -> str | None:
    """Name the field that an interval is of; None: it is no interval, or of no field of this result."""
    if "interval" not in interval:
        return None
    names = (*IN_INTERVAL.get(interval, ()), "rate_difference", interval.removesuffix("_interval95"))
    return next((name for name in names if name != interval and hasattr(result, name)), None)


def _from_to(interval: Sequence[float]) -> str:
    return f"{html_of(interval[0])} to {html_of(interval[1])}"
