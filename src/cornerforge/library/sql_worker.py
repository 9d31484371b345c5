"""The process in which SQL is answered: it can be killed, DuckDB alone cannot always be stopped.

Run as a file, so that it starts at once: it imports DuckDB, Arrow and the standard library only. On its standard input
it gets a table, then statements; it writes that it is ready, then an answer to each. Its memory is limited twice: by
DuckDB itself, and by the operating system, since some of DuckDB's functions do not count theirs. The operating system
lets it write no byte into a file, though it could still make an empty one: that is left to DuckDB, which is told to
open none. It ends by itself if the asking process was killed: at once when the other end of its standard input closes,
and in any case at its own deadline, which the operating system keeps.
"""

from __future__ import annotations

import contextlib
import decimal
import json
import os
import select
import signal
import struct
import sys
import threading
from collections.abc import Iterator
from typing import IO, Any

__all__ = ["main", "read_message", "write_message"]

_HEADER = struct.Struct("<Q")
_ANSWER = 2**18
"""Bytes of an answer for each megabyte of memory, a quarter: the asking process holds it too."""


def read_message(stream: IO[bytes]) -> bytes | None:
    """Read one message; None at the end of the stream, or where it breaks off."""
    head = stream.read(_HEADER.size)
    if len(head) < _HEADER.size:
        return None
    (size,) = _HEADER.unpack(head)
    content = stream.read(size)
    return content if len(content) == size else None


def write_message(stream: IO[bytes], content: bytes | memoryview) -> None:
    """Write one message."""
    stream.write(_HEADER.pack(len(content)))
    stream.write(content)
    stream.flush()


def _limit(megabytes: int) -> None:
    """Let the process take so much more memory, and write nothing into files; where the system can limit that."""
    with contextlib.suppress(ImportError, OSError, ValueError, StopIteration):
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        with open("/proc/self/status", encoding="ascii") as status:
            line = next(line for line in status if line.startswith("VmData"))
        most = (int(line.split()[1]) + 1024 * megabytes) * 1024
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _plain(value: object) -> float | str:
    """Give what JSON lacks: of an exact decimal the nearest number, of times, bytes and the like the text."""
    return float(value) if isinstance(value, decimal.Decimal) else str(value)


def _due(seconds: float) -> None:
    """Let the operating system end the process after so many seconds in any case; 0: never."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _end_with_who_asks() -> None:
    """End the process when its standard input is closed; DuckDB works on beside this thread."""
    if hasattr(select, "poll"):
        left = select.poll()
        left.register(sys.stdin.fileno(), 0)  # 0: notices the end only, not statements
        left.poll()
        os._exit(1)


def _answers(table: Any, megabytes: int, seconds: float) -> Iterator[bytes]:
    import duckdb

    shut: dict[str, str | bool | int | float | list[str]] = {
        "enable_external_access": "false",
        "python_enable_replacements": "false",
        "temp_directory": "",
        "threads": "1",
        "memory_limit": f"{megabytes}MB",
    }
    asks = (duckdb.StatementType.SELECT, duckdb.StatementType.EXPLAIN)
    with duckdb.connect(":memory:", config=shut) as connection:
        connection.register("cases", table)
        connection.execute("SET lock_configuration = true")
        _limit(megabytes + megabytes // 2)
        yield b"ready"
        while (sql := read_message(sys.stdin.buffer)) is not None:
            answer: tuple[Any, ...]
            _due(seconds)
            try:
                statements = connection.extract_statements(sql.decode())
                if len(statements) != 1 or statements[0].type not in asks:
                    answer = ("no question",)
                else:
                    found = connection.execute(statements[0])
                    names = [str(column[0]) for column in found.description or ()]
                    answer = ("answer", names, found.fetchall())
            except (MemoryError, duckdb.OutOfMemoryException):
                answer = ("memory",)
            except Exception as error:  # some of DuckDB's errors are RuntimeErrors, ValueErrors, SystemErrors
                said = str(error).partition("\n\n")[0] or type(error).__name__  # below it stands the statement again
                line = " ".join(part for part in said.splitlines() if not part.startswith("Did you mean"))
                if "Catalog Error: Table with name" in line:
                    line += ' The table is "cases".'
                answer = ("memory",) if "bad_alloc" in line else ("error", line)
            try:
                content = json.dumps(answer, default=_plain).encode()
            except MemoryError:
                content = b""
            except (TypeError, ValueError, RecursionError):
                content = b'["error", "one of the values cannot be written down."]'
            del answer
            _due(0.0)
            yield content if 0 < len(content) < megabytes * _ANSWER else b'["memory"]'


def main() -> None:
    """Answer until the standard input ends."""
    import pyarrow as pa

    # Ctrl-C in a terminal reaches all its processes; the first one ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "SIGALRM"):
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
    table = read_message(sys.stdin.buffer)
    if table is not None:
        threading.Thread(target=_end_with_who_asks, daemon=True).start()
        for content in _answers(pa.ipc.open_stream(table).read_all(), int(sys.argv[1]), float(sys.argv[2])):
            write_message(sys.stdout.buffer, content)


if __name__ == "__main__":
    main()
