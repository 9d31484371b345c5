"""SQL over the cases, by DuckDB without access to anything else on the machine, with little time and memory."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import Any

import pyarrow as pa

from cornerforge._checks import check_integer, check_number
from cornerforge.errors import InputError, MissingExtraError
from cornerforge.library.sql_worker import read_message, write_message

__all__ = ["MEGABYTES", "SECONDS", "Asker", "run_sql"]

SECONDS = 10.0
"""Longest time that an answer may take [s]."""
MEGABYTES = 512
"""Most memory that DuckDB may use for it."""
_GRACE_S = 1.0
"""Time beyond the deadline after which the process ends by itself if no other has stopped it [s]."""
_STOPPED = "The query was stopped, because what answers it is ending."
_LONGEST = 500
"""Most characters of a message that come from the statement."""


class Asker:
    """Answers statements over the table `cases`, one at a time.

    A statement sees the table only: it cannot read or write a file, load an extension, see a Python variable, or change
    the settings that say so. One thread, so that sums of floats do not depend on the machine. It is answered in a
    process of its own, which is killed when the time is up, since DuckDB does not stop in the middle of some functions;
    the next statement then starts another.

    Args:
        cases: The table.
        seconds: Longest time for an answer [s], 0.1 to 86,400.
        megabytes: Most memory that DuckDB may use for it, 16 to 1,048,576; the process gets half as much again for what
            DuckDB does not count.

    Raises:
        InputError: A limit is out of range.
        MissingExtraError: DuckDB is not installed.
    """

    def __init__(self, cases: pa.Table, *, seconds: float = SECONDS, megabytes: int = MEGABYTES) -> None:
        if importlib.util.find_spec("duckdb") is None:
            raise MissingExtraError("duckdb", "query")
        self._cases = cases
        self._seconds = check_number("seconds", seconds, low=0.1, high=86_400.0, unit="s")
        self._megabytes = check_integer("megabytes", megabytes, low=16, high=2**20)
        self._lock, self._starting, self._closed = threading.Lock(), threading.Lock(), False
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Asker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process and all questions, waiting ones too; later questions are not answered."""
        with self._starting:
            self._closed = True
            if self._process is not None:
                self._process.kill()
        with self._lock:
            self._end()

    def _end(self) -> None:
        """End the process; the next question starts another."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):  # what was not sent yet
                        stream.close()
            process.wait()

    def ask(self, sql: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Answer one SELECT (or EXPLAIN, DESCRIBE, SUMMARIZE) statement in DuckDB's dialect.

        Returns:
            Column names, and rows as tuples of what JSON has: numbers, texts, true and false, None for null, lists,
            and dicts; exact decimals are the nearest number, times and the like their text.

        Raises:
            InputError: The statement is wrong, does something else than ask, asks for what is forbidden, or needs too
                much time or memory; or `close` was called.
        """
        with self._lock:
            try:
                return self._ask(sql)
            except BaseException as error:  # Ctrl-C too: what is half read is of no use to the next question
                if not isinstance(error, InputError):
                    self._end()
                raise

    def _ask(self, sql: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        late = threading.Event()
        try:
            statement = sql.encode()
        except UnicodeEncodeError as error:
            raise InputError(f"The query is no UTF-8: character {error.start + 1} is {sql[error.start]!a}.") from None

        def stop(process: subprocess.Popen[bytes]) -> None:
            late.set()
            process.kill()

        process = self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        timer = threading.Timer(self._seconds, stop, [process])
        timer.daemon = True
        timer.start()
        try:
            with contextlib.suppress(BrokenPipeError):
                write_message(process.stdin, statement)
            content = read_message(process.stdout)
        finally:
            timer.cancel()
        if content is None:
            self._end()
            raise InputError(_STOPPED if self._closed else self._slow() if late.is_set() else self._big())
        try:
            kind, *told = json.loads(content)
        except (TypeError, ValueError, RecursionError):
            self._end()
            raise InputError("The query cannot be answered: its answer is not whole.") from None
        if kind == "no question":
            raise InputError(
                f'A query is one SELECT statement over the table "cases"; this is not: {sql.strip()[:_LONGEST]!r}.'
            )
        if kind == "memory":
            self._end()  # its memory is not freed
            raise InputError(self._big())
        if kind == "error":
            raise InputError(f"The query cannot be answered: {told[0][:_LONGEST]}")
        names, rows = told
        return names, [tuple(row) for row in rows]

    def _slow(self) -> str:
        return f"The query takes more than {self._seconds:g} s, so it was stopped; ask for less, or allow more seconds."

    def _big(self) -> str:
        return (
            f"The query needs more than {self._megabytes} MB of memory, so it was stopped; ask for less, or allow more "
            "megabytes."
        )

    def _started(self) -> subprocess.Popen[bytes]:
        """Give the process, started and with its table."""
        if self._process is not None and self._process.poll() is None:
            return self._process
        self._end()
        worker = Path(__file__).with_name("sql_worker.py")
        # -P: the modules beside the file are no modules of its Python.
        command = [sys.executable, "-P", str(worker), str(self._megabytes), str(self._seconds + _GRACE_S)]
        with self._starting:
            if self._closed:
                raise InputError(_STOPPED)
            process = self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, self._cases.schema) as writer:
            writer.write_table(self._cases)
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            write_message(process.stdin, memoryview(sink.getvalue()))
        # It says when it is ready, so that the time for an answer is no time for starting.
        if process.stdout is None or read_message(process.stdout) is None:
            self._end()
            raise InputError(_STOPPED if self._closed else self._big())
        return process


def run_sql(
    cases: pa.Table, sql: str, *, seconds: float = SECONDS, megabytes: int = MEGABYTES
) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Answer one statement over the table `cases`, with the arguments, results and errors of `Asker`."""
    with Asker(cases, seconds=seconds, megabytes=megabytes) as asker:
        return asker.ask(sql)
