"""The ledger of the tests: what each one costs, how much of it is compiling, and how many processes it starts.

`make ledger` runs the tests with `--ledger FILE`: each process of pytest writes a line of JSON a test, and
docs/test-ledger.md is made of these lines at the end.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pytest

__all__ = ["Ledger", "Row", "table"]

_STARTS = {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn"}
"""Audit events of Python that mean a new process; `subprocess.Popen` names its own fork or spawn as itself alone."""
_SHOWN_S = 5.0


@dataclass
class Row:
    """Cost of one test, of what it sets up included.

    Attributes:
        test: Its node id.
        seconds: Wall-clock time [s].
        compiling: Time of it in Numba's compiler, in this process [s].
        entries: Kernels that Python called and that had to be compiled.
        processes: Processes started by this one.
        processes_cpu: Processor time of the processes that ended within the test [s].
    """

    test: str
    seconds: float = 0.0
    compiling: float = 0.0
    entries: list[str] = field(default_factory=list)
    processes: int = 0
    processes_cpu: float = 0.0


class Ledger:
    """Pytest plugin that writes one row a test."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._row = Row("")
        sys.addaudithook(self._heard)
        from numba.core import event

        outer = self
        depth = 0
        since = 0.0

        class Compiles(event.Listener):
            def on_start(self, event: Any) -> None:
                nonlocal depth, since
                if depth == 0:
                    since = time.perf_counter()
                    outer._row.entries.append(event.data["dispatcher"].py_func.__qualname__)
                depth += 1

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                nonlocal depth
                depth -= 1
                if depth == 0:
                    outer._row.compiling += time.perf_counter() - since

        event.register("numba:compile", Compiles())

    def _heard(self, name: str, _: tuple[Any, ...]) -> None:
        if name in _STARTS:
            self._row.processes += 1

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._row = row = Row(item.nodeid)
        began, children = time.perf_counter(), sum(os.times()[2:4])
        try:
            return (yield)
        finally:
            row.seconds = time.perf_counter() - began
            row.processes_cpu = sum(os.times()[2:4]) - children
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(row)) + "\n")


def table(rows: list[Row], heading: str) -> str:
    """Make the page of the ledger: sums, kernels, files, and the tests that last longest."""
    parts = [
        "# The ledger of the tests",
        "Made by `make ledger`; not edited. Seconds are of one worker of two; what a test sets up for others is its "
        "own. Compiling is that of pytest's own processes; `CPU of processes` is what programs started by a test took, "
        "compiling included, as far as they ended within it.",
        heading,
        _rows(
            ["tests", "seconds", "of them compiling", "processes", "CPU of processes [s]"],
            [[len(rows), *_sums(rows)]],
        ),
    ]
    entries: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        for name in row.entries:
            entries[name].append(row.compiling / len(row.entries))
    ranked = sorted(entries.items(), key=lambda pair: -sum(pair[1]))
    small = [sum(each) for _, each in ranked if sum(each) < 1.0]
    parts += [
        "## Kernels that tests compile",
        f"{len(entries)} kernels. A test that compiles several shares its time evenly between them; those below a "
        "second are summed.",
        _rows(
            ["kernel", "times", "seconds"],
            [
                *([f"`{name}`", len(each), f"{sum(each):.1f}"] for name, each in ranked if sum(each) >= 1),
                [f"{len(small)} others", "", f"{sum(small):.1f}"],
            ],
        ),
    ]  # fmt: skip
    files: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        files[row.test.partition("::")[0]].append(row)
    by_cost = sorted(files.items(), key=lambda pair: -sum(r.seconds for r in pair[1]))
    head = ["seconds", "of them compiling", "processes", "CPU of processes [s]"]
    parts += [
        "## Files",
        _rows(["file", "tests", *head], [[f"`{name}`", len(each), *_sums(each)] for name, each in by_cost]),
        f"## Tests of {_SHOWN_S:g} s or more",
        _rows(
            ["test", *head, "kernels compiled"],
            [
                [f"`{_short(r.test)}`", *_sums([r]), ", ".join(f"`{e}`" for e in sorted({*r.entries}))]
                for r in sorted(rows, key=lambda r: -r.seconds)
                if r.seconds >= _SHOWN_S
            ],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _short(test: str) -> str:
    name = test.removeprefix("tests/").replace("|", "\\|")
    return name if len(name) <= 120 else name[:117] + "..."


def _sums(rows: list[Row]) -> list[str]:
    return [
        f"{sum(r.seconds for r in rows):.1f}",
        f"{sum(r.compiling for r in rows):.1f}",
        str(sum(r.processes for r in rows)),
        f"{sum(r.processes_cpu for r in rows):.1f}",
    ]


def _rows(head: list[str], rows: list[list[Any]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


if __name__ == "__main__":
    source, target, told = sys.argv[1:]
    lines = [line for part in sorted(Path(source).glob("*.jsonl")) for line in part.read_text("utf-8").splitlines()]
    Path(target).write_text(table([Row(**json.loads(line)) for line in lines], told), encoding="utf-8")
