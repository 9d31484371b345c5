"""An AV that is asked in this Python, with no process of its own: a double of `AvProcess` for tests of what it decides.

`AvInMemory` loads the AV and calls it as the AV's own process does (`worker.Server`), and takes its replies as bytes as
`AvProcess` does; only the socket and the process are missing. Modules of the AV are imported anew for each double, as
in a new process. What would stop or hold a process is turned into what the process gives: a sleep beyond the time limit
is "hung", at once; `sys.exit`, `os._exit`, `os.abort`, a signal to itself and whatever is no `Exception` is "ended".

Tests of processes as such stay with `AvProcess`: native crashes, endless loops, memory, other interpreters.
`test_av_in_memory.py` holds the two together.
"""

from __future__ import annotations

import importlib
import io
import itertools
import os
import sys
import sysconfig
import threading
import time
import traceback
import warnings
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import cornerforge
from cornerforge.foreign.interpreter import Confines
from cornerforge.foreign.process import AvProcess, _status
from cornerforge.foreign.protocol import LOAD, pack
from cornerforge.foreign.worker import Server

__all__ = ["AvInMemory", "patched"]

_HEAD = len(pack(LOAD, 0))
_one_at_a_time = threading.RLock()
_asked = threading.local()
_LIBRARIES = tuple(
    os.path.realpath(place)
    for place in {*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix, str(Path(cornerforge.__file__).parent)}
    if place
)
_sleep, _exit, _abort, _kill = time.sleep, os._exit, os.abort, os.kill


class _Dies(BaseException):
    """The AV would have ended its process.

    Args:
        status: Exit status; -N: signal N.
    """

    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status


class _Hangs(BaseException):
    """The AV would have taken longer than it may."""


def _is_asked() -> bool:
    """Is it an AV that runs in this thread now?"""
    return getattr(_asked, "until", None) is not None


def _sleeps(seconds: float) -> None:
    if _is_asked() and time.monotonic() + seconds > _asked.until:
        raise _Hangs
    _sleep(seconds)


def _exits(status: int) -> None:
    if _is_asked():
        raise _Dies(status)
    _exit(status)


def _aborts() -> None:
    if _is_asked():
        raise _Dies(-6)
    _abort()


def _kills(pid: int, sign: int) -> None:
    if _is_asked() and pid == os.getpid():
        raise _Dies(-int(sign))
    _kill(pid, sign)


class _Printed(io.TextIOBase):
    """Standard output or error: what the AV's thread writes is kept, all else goes where it went."""

    def __init__(self, other: Any, kept: list[str]) -> None:
        self._other, self._kept, self._thread = other, kept, threading.get_ident()

    def write(self, text: str) -> int:
        if threading.get_ident() != self._thread:
            return int(self._other.write(text))
        self._kept.append(text)
        return len(text)

    def flush(self) -> None:
        if threading.get_ident() != self._thread:
            self._other.flush()


@contextmanager
def _warnings_as_usual() -> Iterator[None]:
    """Let warnings be printed, or ignored, as Python does by itself; they are errors in tests."""

    def shown(
        message: Any, category: Any, filename: str, lineno: int, file: Any = None, line: str | None = None
    ) -> None:
        del file
        sys.stderr.write(warnings.formatwarning(message, category, filename, lineno, line))

    with warnings.catch_warnings():
        warnings.resetwarnings()
        for category in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", category)
        warnings.showwarning = shown
        yield


class _World:
    """What a process has of its own: its modules and where it looks for them, and the AV."""

    def __init__(self) -> None:
        self.server = Server()
        self.status: int | None = None
        self._modules: dict[str, ModuleType] = {}
        search = os.environ.get("PYTHONPATH", "").split(os.pathsep)
        self._places = [os.getcwd(), *map(os.path.abspath, filter(None, search))]

    @contextmanager
    def entered(self, kept: list[str]) -> Iterator[None]:
        """Let this thread be the process."""
        with _one_at_a_time:
            path, writes, streams = sys.path[:], sys.dont_write_bytecode, (sys.stdout, sys.stderr)
            hidden = {name: sys.modules[name] for name in self._modules if name in sys.modules}
            sys.modules.update(self._modules)
            known = len(sys.modules)
            sys.path[:0] = self._places
            sys.dont_write_bytecode = True  # the same name may be another AV's a moment later
            sys.stdout, sys.stderr = (_Printed(stream, kept) for stream in streams)
            try:
                yield
            finally:
                sys.stdout, sys.stderr = streams
                sys.dont_write_bytecode = writes
                if sys.path[len(self._places) :] != path:  # it has added places
                    added = [place for place in sys.path if place not in path and place not in self._places]
                    self._places[:0] = added
                sys.path[:] = path
                for name in list(itertools.islice(reversed(sys.modules), max(0, len(sys.modules) - known))):  # the new
                    if _is_own(sys.modules[name]):
                        self._modules[name] = sys.modules[name]
                for name in self._modules:
                    sys.modules.pop(name, None)
                sys.modules.update(hidden)

    def close(self) -> None:
        """End the AV."""
        self.server.close()


def _is_own(module: ModuleType) -> bool:
    """Is a module the AV's own, and of no library?"""
    file = getattr(module, "__file__", None)
    return file is not None and not os.path.realpath(file).startswith(_LIBRARIES)


class AvInMemory(AvProcess):
    """One AV in this process; all else is as in `AvProcess`."""

    def _start(self) -> None:
        assert self._confines.python is None, "another interpreter needs a process"
        self._world = _World()
        self._finalizer = weakref.finalize(self, self._world.close)

    def _exchange(self, question: bytes, timeout: float) -> tuple[bytes, int, bytearray]:
        if not self._finalizer.alive:
            raise OSError(9, "Bad file descriptor")
        kept = list[str]()
        try:
            with self._world.entered(kept):
                reply = self._reply(question, timeout)
        finally:
            if kept:
                self.log.write("".join(kept).encode(errors="backslashreplace"))
        return reply[:1], int.from_bytes(reply[1:9], "little"), bytearray(reply[_HEAD:])

    def _reply(self, question: bytes, timeout: float) -> bytes:
        """Give the frame that comes back.

        Raises:
            TimeoutError, EOFError: None does.
        """
        _asked.until = until = time.monotonic() + timeout
        if question[:1] == LOAD:
            importlib.invalidate_caches()  # its files may have been written a moment ago
        try:
            with _warnings_as_usual():
                reply = self._world.server.reply(
                    question[:1], int.from_bytes(question[1:9], "little"), bytearray(question[_HEAD:])
                )
        except (KeyboardInterrupt, pytest.fail.Exception):
            raise
        except _Hangs as hangs:
            raise TimeoutError from hangs
        except _Dies as dies:
            self._world.status = dies.status
            raise EOFError from dies
        except SystemExit as ends:
            code = 0 if ends.code is None else ends.code
            self._world.status = code & 255 if isinstance(code, int) else 1
            if not isinstance(code, int):
                print(code, file=sys.stderr)
            raise EOFError from ends
        except BaseException as error:
            self._world.status = 1
            traceback.print_exception(error)
            raise EOFError from error
        finally:
            _asked.until = None
        if time.monotonic() > until:
            raise TimeoutError
        assert reply is not None
        return reply

    def _how_it_ended(self) -> str:
        return f"ended its process ({_status(self._world.status)})"


@contextmanager
def patched() -> Iterator[None]:
    """Ask the AVs of this Python in memory, as long as the block runs; what needs a process still gets one."""

    def made(spec: str, *, confines: Confines = Confines(), **arguments: Any) -> AvProcess:  # noqa: B008
        needs_one = confines.python is not None
        return (AvProcess if needs_one else AvInMemory)(spec, confines=confines, **arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "sleep", _sleeps)
        patch.setattr(os, "_exit", _exits)
        patch.setattr(os, "abort", _aborts)
        patch.setattr(os, "kill", _kills)
        patch.setattr("cornerforge.foreign.driver.AvProcess", made)
        yield
