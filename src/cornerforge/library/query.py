"""SQL over the cases, by DuckDB without access to anything else on the machine."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

from cornerforge.errors import InputError, MissingExtraError

__all__ = ["run_sql"]


def run_sql(cases: pa.Table, sql: str) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Answer one SELECT over the table `cases`.

    The statement sees the table only: it cannot read or write a file, load an extension, see a Python variable, or
    change the settings that say so. One thread, so that sums of floats do not depend on the machine.

    Args:
        cases: The table.
        sql: One SELECT (or EXPLAIN, DESCRIBE, SUMMARIZE) statement in DuckDB's dialect.

    Returns:
        Column names, and rows as tuples of Python values (None for null).

    Raises:
        MissingExtraError: DuckDB is not installed.
        InputError: The statement is wrong, does something else than ask, or asks for what is forbidden.
    """
    try:
        import duckdb
    except ModuleNotFoundError as error:
        raise MissingExtraError("duckdb", "query") from error

    shut: dict[str, str | bool | int | float | list[str]] = {
        "enable_external_access": "false",
        "python_enable_replacements": "false",
        "temp_directory": "",
        "threads": "1",
    }
    with duckdb.connect(":memory:", config=shut) as connection:
        connection.register("cases", cases)
        connection.execute("SET lock_configuration = true")
        try:
            statements = connection.extract_statements(sql)
            asks = (duckdb.StatementType.SELECT, duckdb.StatementType.EXPLAIN)
            if len(statements) != 1 or statements[0].type not in asks:
                raise InputError(
                    f'A query is one SELECT statement over the table "cases"; this is not: {sql.strip()!r}.'
                )
            answer = connection.execute(statements[0])
            return [str(column[0]) for column in answer.description or ()], answer.fetchall()
        except (duckdb.InterruptException, RuntimeError) as error:
            # On Ctrl-C, which DuckDB takes from Python. Some of its own errors are RuntimeErrors too.
            if "interrupted" in str(error).lower():
                raise KeyboardInterrupt from error
            raise
        except duckdb.Error as error:
            raise InputError(f"The query cannot be answered: {str(error).splitlines()[0]}") from error
