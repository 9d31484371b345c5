"""Tables of all that is known of each case: measures, fault, avoidability, value (docs/case-columns.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from cornerforge._arrow import arrow_field, arrow_type
from cornerforge.analysis.avoidability import AVOIDABILITY_SCHEMA, AvoidParams, avoidability_table, problems_of
from cornerforge.analysis.conduct import CONDUCT_COLUMNS, NO_CONDUCT, conduct_of
from cornerforge.analysis.fault import FAULT_COLUMNS, assign_fault
from cornerforge.analysis.measures import MEASURES, measure_cases
from cornerforge.analysis.mechanism import MECHANISMS, mechanism_of
from cornerforge.analysis.prevented import PREVENTED_COLUMNS, prevented_at, prevention_of
from cornerforge.analysis.site_case import KINDS_AT_SITES
from cornerforge.analysis.value import (
    PARTS,
    Value,
    avoidability_part,
    novelty_part,
    severity_part,
    value_of,
)
from cornerforge.fields import SHORTFALL, Field
from cornerforge.recordings import recordings_of_tracks
from cornerforge.types import Odd, Scenario

__all__ = ["MECHANISM", "VALUE_COLUMNS", "CaseTable", "ShardReading", "read_shards", "values_of", "with_mechanism"]

_WITNESS = [name for name in AVOIDABILITY_SCHEMA.names if name.startswith("witness_")]

_SHARE = (0.0, 1.0 + 1e-9)
"""Range of a share, with room for rounding."""

VALUE_COLUMNS: tuple[Field, ...] = (
    Field("value_own_doing", "float64", "", "1 where the AV did something wrong, else 0 (docs/adr/0069).", _SHARE),
    Field("value_avoidability", "float64", "", "Time to react over 2 s, 0 to 1; null: not looked at.", _SHARE,
          nullable=True),
    Field("value_severity", "float64", "", "1 + log10 P(MAIS 3+ in the AV) / 3, of a person struck that of "
          "AIS 4+; 0 to 1.", _SHARE),
    Field("value_novelty", "float64", "", "Share of the other cases that lie in denser company, 0 to 1.", _SHARE),
    Field("value", "float64", "", "Mean of the four, 0 to 1; null: one of them is not known.", _SHARE, nullable=True),
)  # fmt: skip
"""Columns that `values_of` adds."""

MECHANISM = Field(
    "mechanism",
    "string",
    "",
    f"What led to it: {', '.join(MECHANISMS)}; at a site: {', '.join(KINDS_AT_SITES)} (`analysis.mechanism`).",
)
"""Column that `with_mechanism` adds."""


@dataclass(frozen=True)
class CaseTable:
    """One row a case.

    Attributes:
        table: Columns of `MEASURES`, `FAULT_COLUMNS`, `CONDUCT_COLUMNS`, `PREVENTED_COLUMNS`, `AVOIDABILITY_SCHEMA`
            (null where it was not looked for) and `fields.SHORTFALL` (null where the library lacks it), after
            `case_id`.
        witnesses: `AVOIDABILITY_SCHEMA` for the cases that were looked at, with the ways out.
        reacting: Cases among these that reference drivers would have prevented had they reacted faster or more slowly,
            as `prevented_at` says it.
    """

    table: pa.Table
    witnesses: pa.Table
    reacting: NDArray[np.bool_]


@dataclass(frozen=True)
class ShardReading:
    """How to read each shard.

    Attributes:
        odd: Road and rules of the library.
        look_at: Ids of the cases to judge for avoidability.
        params: What the AV may do.
        threads: Size of the pool; does not change the result.
    """

    odd: Odd
    look_at: frozenset[str]
    params: AvoidParams
    threads: int


def _numbers(table: pa.Table, name: str) -> NDArray[np.float64]:
    values = table.column(name).to_numpy(zero_copy_only=False)
    return np.array(values, dtype=np.float64)


def read_shards(shards: Iterable[tuple[pa.Table, pa.Table]], reading: ShardReading) -> Iterable[CaseTable]:
    """Read measures, fault and avoidability of a library, shard after shard; only one shard's motion is in memory.

    Args:
        shards: Cases and tracks of each (`CaseLibrary.shards`).
        reading: How to read them.

    Yields:
        A part for each shard, in order.
    """
    for cases, tracks in shards:
        recordings = recordings_of_tracks(cases, tracks)
        columns: dict[str, Any] = (
            dict(measure_cases(recordings, odd=reading.odd)) | assign_fault(recordings, odd=reading.odd).columns()
        )
        problems = problems_of(recordings, cases.column("bv_slot").to_pylist(), reading.odd)
        prevention = prevention_of(recordings, problems, reading.odd, reading.params, threads=reading.threads)
        conduct = conduct_of(recordings, reading.odd, prevention)
        slow = conduct.slow if reading.odd.site is None else conduct.slow & prevention.prevented.any(axis=1)
        columns |= conduct.columns() | prevention.columns(slow, conduct.begun)
        wanted = pc.is_in(cases.column("case_id"), value_set=pa.array(sorted(reading.look_at), pa.string()))
        seen, moved = cases.filter(wanted), tracks.filter(wanted)
        witnesses = avoidability_table(seen, moved, reading.odd, reading.params, threads=reading.threads)
        given = [problem for problem, chosen in zip(problems, wanted.to_pylist(), strict=True) if chosen]
        reacting = prevented_at(
            recordings_of_tracks(seen, moved), given, reading.odd, reading.params, threads=reading.threads
        )
        ids = cases.column("case_id")
        place = pc.index_in(ids, value_set=witnesses.column("case_id").combine_chunks())
        fields = [pa.field("case_id", pa.string())]
        arrays: list[Any] = [ids.combine_chunks()]
        for column in (*MEASURES, *FAULT_COLUMNS, *CONDUCT_COLUMNS, *PREVENTED_COLUMNS):
            fields.append(arrow_field(column))
            arrays.append(pa.array(columns[column.name], arrow_type(column.type), from_pandas=True))
        for name in AVOIDABILITY_SCHEMA.names[1:]:
            if name not in _WITNESS:
                fields.append(AVOIDABILITY_SCHEMA.field(name))
                arrays.append(witnesses.column(name).combine_chunks().take(place.combine_chunks()))
        for column in SHORTFALL:
            fields.append(arrow_field(column))
            arrays.append(cases.column(column.name).combine_chunks())
        yield CaseTable(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), witnesses, reacting)


def with_mechanism(table: pa.Table, cases: Iterable[tuple[str, Scenario]]) -> pa.Table:
    """Put beside each case of a table of `read_shards` how its crash came about.

    Args:
        table: S rows.
        cases: Name and recording of the same cases, in any order.
    """
    known = {name: mechanism_of(scenario).name for name, scenario in cases}
    names = [known[case] for case in table.column("case_id").to_pylist()]
    return table.add_column(1, arrow_field(MECHANISM), pa.array(names, arrow_type(MECHANISM.type)))


def _mechanisms(table: pa.Table) -> list[str | None]:
    """Read what led to each case; nothing where `with_mechanism` has not told."""
    known = MECHANISM.name in table.column_names
    return table.column(MECHANISM.name).to_pylist() if known else [None] * table.num_rows


def values_of(
    table: pa.Table, points: NDArray[np.float64], weights: dict[str, float] | None = None
) -> tuple[pa.Table, Value]:
    """Value the cases, and put the parts of the value beside the columns that they are made of.

    Args:
        table: Table of `read_shards`, S rows.
        points: The cases in the plane of the analysis, shape (S, 2).
        weights: Weights of the parts (`value_of`).

    Returns:
        The table with `VALUE_COLUMNS`, and the values.

    Raises:
        InputError: The weights are not right.
    """
    looked = np.array(pc.is_valid(table.column("avoidability")).to_numpy(zero_copy_only=False), np.bool_)
    time_to_react = _numbers(table, "time_to_react_s")
    time_to_react[looked & np.isnan(time_to_react)] = -np.inf
    on_foot = np.array([str(name).startswith("person-") for name in _mechanisms(table)], np.bool_)
    hurt = np.where(on_foot, _numbers(table, "bv_injury_probability"), _numbers(table, "av_injury_probability"))
    value = value_of(
        {
            "own_doing": [float(name != NO_CONDUCT) for name in table.column("conduct").to_pylist()],
            "avoidability": avoidability_part(time_to_react),
            "severity": severity_part(hurt),
            "novelty": novelty_part(points),
        },
        weights,
    )
    for column, values in zip(VALUE_COLUMNS, [*(value.parts[name] for name in PARTS), value.score], strict=True):
        table = table.append_column(arrow_field(column), pa.array(values, arrow_type(column.type), from_pandas=True))
    return table, value
