"""Workers: processes that run inputs. One that hangs or crashes is ended, which is the outcome of its input."""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import multiprocessing as mp
import os
import resource
import signal
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest.mock import patch

__all__ = ["Worker"]

_WALL_S = 120.0
"""An input that waits longer hangs; longer than it may compute, because on a busy machine everything waits."""
_PREPARE_S = 1800.0
"""Compiling what was not used before, at most."""
_ADDRESSES = 24 * 2**30


@contextlib.contextmanager
def _small() -> Iterator[None]:
    """Runs and trees as small as the seeds', so that they can be gone on with."""
    import importlib

    from fuzz.seeds import TINY_RUN
    from small_trees import small_trees

    run = importlib.import_module("cornerforge.verbs.run")
    with patch.dict(run.EFFORTS, quick=run.Effort(**TINY_RUN)), small_trees():
        yield


def _work(pipe: Connection, seeds: Path, room: Path, stacks: Path) -> None:
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    os.environ["COLUMNS"] = "200"
    with stacks.open("w", encoding="utf-8") as file:
        faulthandler.register(signal.SIGUSR1, file=file, all_threads=False)
        faulthandler.enable(file=file)
        import typer.main
        from fuzz.judge import Judge, Outcome

        made_once = functools.cache(typer.main.get_command)  # the same each time, and slow to make
        judge = Judge(seeds, room)
        with _small(), patch.object(typer.main, "get_command", made_once):
            while True:
                one = pipe.recv()
                if one is None:
                    return
                try:
                    judge.prepare(one)
                    pipe.send(None)
                    pipe.send(judge.run(one))
                except LookupError as error:
                    pipe.send(Outcome("stale", repr(error)))
                except Exception as error:
                    import traceback

                    pipe.send(Outcome("broken", "".join(traceback.format_exception(error)[-3:])))


class Worker:
    """A process that runs one input after the other.

    Args:
        seeds: Where seeds are kept.
        room: Folder for the inputs.
        number: Of the worker.
        cpu_s: An input that computes longer hangs [s]; compiling what was not prepared takes up to 40 s.
    """

    def __init__(self, seeds: Path, room: Path, number: int, *, cpu_s: float = 60.0) -> None:
        self._limit = cpu_s
        self._seeds, self._room, self._number = seeds, room, number
        self._process: mp.process.BaseProcess | None = None
        self._pipe: Any = None

    def run(self, one: dict[str, Any]) -> tuple[str, str]:
        """Run an input and return its outcome and what more there is to say."""
        if self._process is None:
            self._start()
        self._pipe.send(one)
        try:
            if not self._pipe.poll(_PREPARE_S):
                return self._given_up("broken")
            found = self._pipe.recv()
            if found is None:
                begun, cpu = time.monotonic(), self._cpu()
                while not self._pipe.poll(1.0):
                    if self._cpu() - cpu > self._limit or time.monotonic() - begun > _WALL_S:
                        return self._given_up("hang")
                found = self._pipe.recv()
            return found.what, found.detail
        except (EOFError, OSError):
            assert self._process is not None
            self._process.join(5)
            code, stack = self._process.exitcode, self._read_stack()
            self.stop()
            return "traceback", f"the process ended ({code}) at {stack}"

    def _given_up(self, what: str) -> tuple[str, str]:
        stack = self._stack()
        self.stop()
        return what, f"took too long at {stack}"

    def _cpu(self) -> float:
        """CPU time of the process so far [s]."""
        assert self._process is not None
        fields = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> None:
        """End the process and all that it started."""
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            assert self._process.pid is not None
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self._pipe.close()
        self._process = None

    def _start(self) -> None:
        context = mp.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        stacks = self._room / f"stacks-{self._number}"
        self._process = context.Process(target=_work, args=(theirs, self._seeds, self._room, stacks), daemon=True)
        self._process.start()
        theirs.close()

    def _stack(self) -> str:
        """Ask the process where it is."""
        assert self._process is not None
        with contextlib.suppress(ProcessLookupError):
            assert self._process.pid is not None
            os.kill(self._process.pid, signal.SIGUSR1)
            time.sleep(0.5)
        return self._read_stack()

    def _read_stack(self) -> str:
        lines = (self._room / f"stacks-{self._number}").read_text(encoding="utf-8").splitlines()
        return next((line.strip() for line in lines if "/cornerforge/" in line), "no frame of ours")
