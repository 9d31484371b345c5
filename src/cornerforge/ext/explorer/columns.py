"""The table of all cases, one row a case: what libraries and analyses say of each, and what follows from that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.analysis.variety import crash_cells
from cornerforge.counterfactual import OWN_MANOEUVRES
from cornerforge.errors import InputError
from cornerforge.ext.explorer.sources import Analysis, Source
from cornerforge.ext.explorer.words import VALUES, label_of
from cornerforge.fields import HISTORY_SHAPE
from cornerforge.report.artefacts import per_billion_miles
from cornerforge.types import CLASSES

__all__ = ["CaseTable", "case_table"]

_HIDDEN = ("history", "critical_bv_action", "trajectory_digest", "seed")
_MOST_NAMES = 1_000
"""A column with more different texts than this is no category."""
_LEAD_S, _SLIVER = 1.0, 1e-6
"""The reaction time with which reports tell a share of avoidable crashes first."""

_SERVER: dict[str, tuple[str, str]] = {
    "source": ("", "The library that the case is from."),
    "prevention": ("", "Would a reference driver in the AV's place have prevented it, and how?"),
    "way_out": ("", "Had the AV a way out, and how fast would it have had to react?"),
    "often": ("crashes per billion miles", "How often crashes happen that this case stands for; null: not natural."),
    "role": ("", "Why the analysis says to look at it."),
    "striker": ("", "Whose front struck, or whose motion closed the gap."),
    "side": ("", "Face of the AV that was touched."),
}
"""Unit and meaning of the columns made here."""
_MEANT: dict[str, tuple[str, str]] = {
    "pc1": ("", "First principal component of the last second before the crash, in the plane of its own source."),
    "pc2": ("", "Second principal component, likewise."),
    "group": ("", "Whether it lies in a dense region of that plane."),
    "cluster": ("", "Its cluster in that plane; each source has its own."),
    "crash_type": ("", "Which faces of the two vehicles met, and how they stood."),
    "mechanism": ("", "What the two vehicles did before the crash."),
    "at_start": ("", "The crash came less than 4 s after the start of the test."),
    "weight": ("crashes per test", "Crashes per test that the case stands for."),
    "log_prob_policy": ("", "ln P(critical BV's actions) under the policy."),
    "policy": ("", "Hash of the policy that drove the test."),
}
"""Unit and meaning of the columns for which files give none."""
_FIRST = (
    "source", "case_id", "mechanism", "crash_type", "prevention", "way_out", "striker", "side", "fault", "fault_rule",
    "conduct", "impact_speed_mps", "av_injury_probability", "often", "role", "cluster", "pc1", "pc2",
)  # fmt: skip


@dataclass(frozen=True)
class CaseTable:
    """All cases.

    Attributes:
        columns: All known columns as /api/about tells them: `name`, `label`, `type` (number, integer, category, flag or
            text), `unit` ("" for none), `meaning`, `source` (library, analysis or server), and of a category `values`,
            words for each name in the order in which they are shown.
        table: Columns in that order; categories are dictionaries, numbers float64, integers int32. S rows.
        rows: The row of each case, by source and id.
    """

    columns: tuple[dict[str, Any], ...]
    table: pa.Table
    rows: Mapping[tuple[str, str], int]

    def stream(self, names: Sequence[str]) -> bytes:
        """Write columns as an Arrow IPC stream of one batch, after `source` and `case_id`.

        Raises:
            InputError: No column has this name.
        """
        known = self.table.column_names
        for name in names:
            if name not in known:
                raise InputError(f"There is no column {name[:80]!r}; /api/about lists them.")
        chosen = self.table.select(list(dict.fromkeys(["source", "case_id", *names])))
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, chosen.schema) as writer:
            writer.write_table(chosen)
        return bytes(sink.getvalue())

    def first_of(self, source: str) -> str:
        """Give the id of a source's first case."""
        return next(case for name, case in self.rows if name == source)

    def plain(self) -> pa.Table:
        """Give the table with texts instead of categories, for SQL: any text can be compared with those."""
        kinds = [pa.string() if pa.types.is_dictionary(field.type) else field.type for field in self.table.schema]
        fields = [pa.field(name, kind) for name, kind in zip(self.table.column_names, kinds, strict=True)]
        return self.table.cast(pa.schema(fields))

    def row(self, index: int) -> dict[str, Any]:
        """Give all that is known of one case; None for null."""
        values: dict[str, Any] = self.table.slice(index, 1).to_pylist()[0]
        return values


def case_table(sources: Sequence[tuple[Source, Analysis | None]]) -> CaseTable:
    """Put the cases of several sources one below the other; where a source lacks a column it is null."""
    parts = [_part(source, analysis) for source, analysis in sources]
    told: dict[str, tuple[pa.Field, str]] = {}
    for part in parts:
        for name, (field, source, _) in part.items():
            told.setdefault(name, (field, source))
    order = [name for name in _FIRST if name in told] + [name for name in told if name not in _FIRST]
    columns, arrays = [], []
    for name in order:
        field, source = told[name]
        chunks: list[Any] = []
        for part in parts:
            values = part[name][2].cast(field.type) if name in part else pa.nulls(_rows(part), field.type)
            chunks += values.chunks if isinstance(values, pa.ChunkedArray) else [values]
        column, values = _served(name, field, source, pa.chunked_array(chunks, field.type))
        columns.append(column)
        arrays.append(values)
    table = pa.Table.from_arrays(arrays, names=order)
    names = [name for (source, _), part in zip(sources, parts, strict=True) for name in [source.name] * _rows(part)]
    keys = zip(names, table["case_id"].to_pylist(), strict=True)
    return CaseTable(tuple(columns), table, {key: row for row, key in enumerate(keys)})


_Part = dict[str, tuple[pa.Field, str, Any]]
"""Columns of one source by name: the file's words on each, "library", "analysis" or "server", and its values."""


def _rows(part: _Part) -> int:
    return len(part["case_id"][2])


def _part(source: Source, analysis: Analysis | None) -> _Part:
    cases = source.cases
    wanted = [name for name in cases.columns if name not in _HIDDEN]
    table = cases.scalars([*wanted, "history"])
    ids = table["case_id"]
    part: _Part = {name: (table.schema.field(name), "library", table[name]) for name in wanted}
    if "bv_kind" in part:
        kinds = pa.array([kind.name for kind in CLASSES])
        part["bv_kind"] = (pa.field("bv_kind", pa.string(), metadata={"meaning": "Class of the crash partner."}),
                           "library", pc.take(kinds, part["bv_kind"][2]))  # fmt: skip
    if analysis is not None:
        judged = analysis.cases
        if not judged["case_id"].equals(ids):  # mostly it is in the library's order
            judged = judged.take(pc.index_in(ids, value_set=judged["case_id"].combine_chunks()).combine_chunks())
        for field in judged.schema:
            if field.name not in part and not pa.types.is_nested(field.type):
                values = judged[field.name].combine_chunks()
                if field.name == "cluster":
                    field, values = pa.field("cluster", pa.string()), pc.cast(values, pa.string())
                part[field.name] = (field, "analysis", values)
    part.pop("source", None)  # a library's own column of this name: here it says from which library a case is
    for name, values in _derived(source, analysis, table, part).items():
        part.setdefault(name, (pa.field(name, values.type), "server", values))
    return part


def _derived(source: Source, analysis: Analysis | None, table: pa.Table, part: _Part) -> dict[str, pa.Array]:
    """Make the columns of `_SERVER`, and `crash_type` where no file says it."""
    n = table.num_rows
    made: dict[str, pa.Array] = {"source": pa.array([source.name] * n, pa.string())}
    if source.weights is not None:
        per_mile = per_billion_miles(source.cases)
        weights = [source.weights.get(case) for case in table["case_id"].to_pylist()]
        made["often"] = pa.array([None if w is None else w * per_mile for w in weights], pa.float64())
    made |= _cells(source, table)
    if analysis is None:
        return made
    label, react, began = (_values(part, name) for name in ("avoidability", "time_to_react_s", "manoeuvre"))
    if label is not None and react is not None and began is not None:
        made["way_out"] = pa.array([_way_out(*of_case) for of_case in zip(label, react, began, strict=True)])
    roles = _roles(analysis)
    made["role"] = pa.array([roles.get(case, "none") for case in table["case_id"].to_pylist()], pa.string())
    return made


def _values(part: _Part, name: str) -> list[Any] | None:
    if name not in part:
        return None
    values: list[Any] = part[name][2].to_pylist()
    return values


def _way_out(label: str | None, react: float | None, began: str | None) -> str:
    if label is None:
        return "not looked for"
    if label == "undecided":
        return "undecided"
    if react is None or react != react:
        return "none"
    if react < -_SLIVER:
        return "with foresight"
    if began in OWN_MANOEUVRES:
        return "by leaving it out"
    return "after 1 s" if react >= _LEAD_S - _SLIVER else "with a faster reaction"


def _roles(analysis: Analysis) -> dict[str, str]:
    found = analysis.found
    roles = dict.fromkeys((case for cluster in found.clusters for case in cluster.typical), "typical")
    roles |= dict.fromkeys(found.rare, "rare")
    return roles | dict.fromkeys((top.case_id for top in found.value.top), "worth a look")


def _cells(source: Source, table: pa.Table) -> dict[str, pa.Array]:
    """Classify each crash: type, side and striker; nothing if a contact cannot be told."""
    if table.num_rows == 0:
        return {}
    odd = source.cases.odd
    flat = table["history"].combine_chunks().flatten().to_numpy()
    pose = flat.reshape(-1, *HISTORY_SHAPE)[:, 0].astype(np.float64)

    def size(name: str, of_car: float) -> NDArray[np.float64]:
        partner = table[name].to_numpy()
        return np.stack([np.full(partner.size, of_car), partner], axis=1)

    length, width = size("bv_length_m", odd.vehicle_length), size("bv_width_m", odd.vehicle_width)
    try:
        index, cells = crash_cells(pose, vehicle_length=length, vehicle_width=width)
    except InputError:
        return {}
    parts = [cell.split(" | ") for cell in cells]
    return {
        name: pa.DictionaryArray.from_arrays(pa.array(index, pa.int16()), pa.array([cell[k] for cell in parts]))
        .cast(pa.string())
        for k, name in enumerate(("crash_type", "side", "striker"))
    }  # fmt: skip


def _served(name: str, field: pa.Field, source: str, values: pa.ChunkedArray) -> tuple[dict[str, Any], Any]:
    """Bring a column to one of the served types."""
    unit, meaning = _SERVER.get(name) or _MEANT.get(name) or _said(field)
    array = values.combine_chunks()
    kind, more = "number", dict[str, Any]()
    if pa.types.is_boolean(array.type):
        kind = "flag"
    elif pa.types.is_string(array.type):
        kind, array, words = _texts(name, array)
        more = {"values": words} if kind == "category" else {}
    elif pa.types.is_integer(array.type):
        try:
            kind, array = "integer", array.cast(pa.int32())
        except pa.ArrowInvalid:
            array = array.cast(pa.float64())
    else:
        array = array.cast(pa.float64())
        array = pc.if_else(pc.is_nan(array), pa.scalar(None, pa.float64()), array)
    told = {
        "name": name, "label": label_of(name), "type": kind, "unit": unit, "meaning": meaning, "source": source,
    }  # fmt: skip
    return told | more, array


def _said(field: pa.Field) -> tuple[str, str]:
    about = field.metadata or {}
    unit, meaning = (about.get(key, b"").decode(errors="replace") for key in (b"unit", b"meaning"))
    return unit, meaning


def _texts(name: str, array: pa.Array) -> tuple[str, pa.Array, dict[str, str]]:
    """Make a category of a text column with few different values: in their usual order, or by number, or by name."""
    found = [value for value in pc.unique(array).to_pylist() if value is not None]
    if name == "case_id" or len(found) > _MOST_NAMES:
        return "text", array, {}
    usual = VALUES.get(name) or (dict.fromkeys(CRASH_TYPES.values(), "") if name == "crash_type" else {})
    place: Callable[[str], tuple[int, int, str]] = lambda value: (  # noqa: E731
        list(usual).index(value) if value in usual else len(usual),
        int(value) if value.isdecimal() else 0,
        value,
    )
    ordered = sorted(found, key=place)
    codes = pc.index_in(array, value_set=pa.array(ordered, pa.string())).cast(pa.int16())
    words = {value: usual.get(value) or value for value in ordered}
    return "category", pa.DictionaryArray.from_arrays(codes, pa.array(ordered, pa.string())), words
