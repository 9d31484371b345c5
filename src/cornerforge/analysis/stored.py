"""The table of judged cases that an analysis wrote, as its readers take it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa

from cornerforge._table_checks import read_parquet
from cornerforge.errors import FileFormatError
from cornerforge.results.reading import open_json

__all__ = ["CASES_FILE", "read_cases_of"]

CASES_FILE = "cases.parquet"
"""Name of the table: one row for each case, with all its measures."""


def read_cases_of(folder: Path, command: str, columns: Sequence[str] | None = None, *, fewer: bool = False) -> pa.Table:
    """Read the table of an analysis, and compare with its `analysis.json`, if there is one, how many cases it holds.

    Args:
        folder: Folder of the analysis.
        command: What writes it again, for messages.
        columns: Columns to read; None: all.
        fewer: Leave out those that the table lacks, instead of refusing it.

    Raises:
        FileFormatError: The table is missing, damaged or changed, lacks a column, or holds more or fewer cases.
    """
    file, said = folder / CASES_FILE, folder / "analysis.json"
    table = read_parquet(file, command, columns, fewer=fewer)
    if said.exists():
        cases = open_json(said, command).values.get("cases")
        if cases != table.num_rows:
            raise FileFormatError(
                f"{file} holds {table.num_rows} cases, {said.name} beside it says {cases}; write both again with: "
                f"{command}"
            )
    return table
