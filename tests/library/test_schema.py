from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cornerforge.library.schema import CASES, TRACKS, Column, schema_markdown

SUFFIX = {"m": "_m", "s": "_s", "m/s": "_mps", "m/s2": "_mps2", "rad": "_rad"}


@pytest.mark.parametrize("column", [*CASES, *TRACKS], ids=lambda column: column.name)
def test_a_name_ends_in_its_unit(column: Column) -> None:
    if column.unit in SUFFIX:
        assert column.name.endswith(SUFFIX[column.unit])
    else:
        assert not column.name.endswith(tuple(SUFFIX.values()))
    assert column.meaning.endswith(".")


@pytest.mark.parametrize(("columns", "kind"), [(CASES, "cases"), (TRACKS, "tracks")])
def test_files_carry_units_and_meanings(filled: Path, columns: tuple[Column, ...], kind: str) -> None:
    schema = pq.read_schema(filled / f"{kind}-000000.parquet")
    for column in columns:
        metadata = schema.field(column.name).metadata
        assert schema.field(column.name).type == column.type
        assert metadata[b"meaning"].decode() == column.meaning
        assert metadata.get(b"unit", b"").decode() == column.unit
    assert schema.metadata[b"cornerforge_schema_version"] == b"1"


def test_the_documentation_lists_every_column() -> None:
    rows = schema_markdown(TRACKS).splitlines()
    assert len(rows) == 2 + len(TRACKS)
    assert rows[5] == f"| `x_m` | list of float | m | {TRACKS[3].meaning} |"
    assert str(pa.float32()) == "float"
