from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from cornerforge._arrow import arrow_type
from cornerforge.fields import CASES, TRACKS, Field
from cornerforge.library.schema import RAILS_TRACKS

SUFFIX = {"m": "_m", "s": "_s", "m/s": "_mps", "m/s2": "_mps2", "rad": "_rad"}


@pytest.mark.parametrize("column", [*CASES, *TRACKS], ids=lambda column: column.name)
def test_a_name_ends_in_its_unit(column: Field) -> None:
    if column.unit in SUFFIX:
        assert column.name.endswith(SUFFIX[column.unit])
    else:
        assert not column.name.endswith(tuple(SUFFIX.values()))
    assert column.meaning.endswith(".")


@pytest.mark.parametrize(("columns", "kind"), [(CASES, "cases"), (TRACKS, "tracks")])
def test_files_carry_units_and_meanings(filled: Path, columns: tuple[Field, ...], kind: str) -> None:
    schema = pq.read_schema(filled / f"{kind}-000000.parquet")
    for column in columns:
        metadata = schema.field(column.name).metadata
        assert schema.field(column.name).type == arrow_type(column.type)
        assert metadata[b"meaning"].decode() == column.meaning
        assert metadata.get(b"unit", b"").decode() == column.unit
    assert schema.metadata[b"cornerforge_schema_version"] == b"1"


def schema_markdown(columns: tuple[Field, ...]) -> str:
    rows = [
        f"| `{c.name}` | {c.type} | {c.unit} | {c.allowed} | {c.meaning.replace('|', chr(92) + '|')} |" for c in columns
    ]
    return "\n".join(["| column | type | unit | allowed | meaning |", "| --- | --- | --- | --- | --- |", *rows])


def test_the_documentation_is_made_of_the_code(golden: Callable[[str, str], None]) -> None:
    """docs/library-columns.md."""
    lines = [
        "# Columns of a case library", "",
        "A shard is two Parquet files with the same rows in the same order. `cornerforge query` asks the first.",
        "A library may have columns of its own besides. This page is made from the code (`make golden`).", "",
        "## cases-NNNNNN.parquet", "", schema_markdown(CASES), "",
        "Where policies drive, also `log_prob_policy` (ln P of the critical BV's actions under the policy, 0 when it",
        "acts greedily) and `policy` (hash of the policy that drove the test).", "",
        "## tracks-NNNNNN.parquet", "", schema_markdown(RAILS_TRACKS), "",
        "`start` only where cases are scripted, `rails` only where their other vehicles are on rails.",
    ]  # fmt: skip
    golden("../../docs/library-columns.md", "\n".join([*lines, ""]))


def test_the_documentation_lists_every_column() -> None:
    rows = schema_markdown(TRACKS).splitlines()
    assert len(rows) == 2 + len(TRACKS)
    place = [column.name for column in TRACKS].index("x_m")
    assert rows[2 + place] == f"| `x_m` | list of float32 | m | -100000 to 100000 | {TRACKS[place].meaning} |"
