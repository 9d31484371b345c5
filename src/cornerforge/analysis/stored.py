"""Tables that an analysis wrote, as its readers take them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa

from cornerforge._table_checks import read_parquet
from cornerforge.errors import FileFormatError
from cornerforge.results.reading import open_json

__all__ = ["CASES_FILE", "read_analysed"]

CASES_FILE = "cases.parquet"
"""Name of the table with all measures of each case."""
_OF_EACH_CASE = (CASES_FILE, "points.parquet")


def read_analysed(file: Path, command: str, columns: Sequence[str] | None = None, *, fewer: bool = False) -> pa.Table:
    """Read a table of an analysis.

    If it has a row for each case, the `analysis.json` beside it says how many there must be, if it is there.

    Args:
        file: The table.
        command: What writes it again, for messages.
        columns: Columns to read; None: all.
        fewer: Leave out those that the table lacks, instead of refusing it.

    Raises:
        FileFormatError: The table is missing, damaged or changed, lacks a column, or holds more or fewer cases.
    """
    said = file.with_name("analysis.json")
    table = read_parquet(file, command, columns, fewer=fewer)
    if file.name in _OF_EACH_CASE and said.exists():
        cases = open_json(said, command).values.get("cases")
        if cases != table.num_rows:
            raise FileFormatError(
                f"{file} holds {table.num_rows} cases, {said.name} beside it says {cases}; write both again with: "
                f"{command}"
            )
    return table
