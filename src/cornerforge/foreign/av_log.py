"""Log of AVs from outside: what they print, and their whole tracebacks, in a file of limited size."""

from __future__ import annotations

import os
import tempfile
import threading
import weakref
from collections import OrderedDict
from contextlib import suppress
from pathlib import Path

from cornerforge._files import append, write_bytes

__all__ = ["MOST_BYTES", "AvLog", "latest_log"]

MOST_BYTES = 10_000_000
"""The file never gets longer; the last half of that is always kept."""
_MOST_TRACES = 100
_latest: list[Path] = []


def latest_log() -> Path | None:
    """Give the file that was named last, because an AV failed; None if there was none."""
    return _latest[-1] if _latest else None


def _tidy(state: dict[str, Path | None]) -> None:
    if (path := state["unnamed"]) is not None:
        with suppress(OSError):
            path.unlink()


class AvLog:
    """The log of one AV, which all its processes share.

    Nothing is written before there is something to write. Without a place of its own it is a temporary file, which is
    removed at the end unless it was named. A file that cannot be written is given up without a word: what an AV prints
    must not end a run.

    Args:
        most: Longest size of the file [bytes].
    """

    def __init__(self, most: int = MOST_BYTES) -> None:
        self._most = most
        self._left_out = f"cornerforge: earlier output is left out; this file holds {most:,} bytes or less\n".encode()
        self._lock = threading.Lock()
        self._place: Path | None = None
        self._path: Path | None = None
        self._is_broken = False
        self._traces: OrderedDict[str, str] = OrderedDict()
        self._state: dict[str, Path | None] = {"unnamed": None}
        weakref.finalize(self, _tidy, self._state)

    def keep_in(self, place: Path) -> None:
        """Write to the file `place` from now on, after what it holds; what was written before moves there.

        A log that has a place of its own stays there.
        """
        with self._lock:
            if self._place is not None:
                return
            before, self._place = self._path, place
            self._path, self._is_broken = None, False
            if before is None:
                return
            with suppress(OSError):
                self._append(before.read_bytes())
                before.unlink()
            self._state["unnamed"] = None

    def write(self, printed: bytes) -> None:
        """Add what an AV printed."""
        with self._lock:
            self._append(printed)

    def _append(self, printed: bytes) -> None:
        if self._is_broken or not printed:
            return
        try:
            path = self._path or self._opened()
            size = path.stat().st_size if path.exists() else 0
            if size + len(printed) > self._most:
                kept = ((path.read_bytes() if size else b"") + printed)[-(self._most // 2) :]
                whole = kept[kept.find(b"\n") + 1 :]  # whole lines; all of it if it is one line
                write_bytes(path, self._left_out + whole)
            else:
                append(path, printed)
        except OSError:
            self._is_broken = True

    def _opened(self) -> Path:
        if self._place is None:
            number, name = tempfile.mkstemp(prefix="cornerforge-av-", suffix=".log")
            os.close(number)
            self._path = self._state["unnamed"] = Path(name)
        else:
            self._path = self._place
        return self._path

    def note(self, how: str, trace: str) -> None:
        """Add a failure: how the AV failed, in a line, and its traceback."""
        with self._lock:
            is_new = how not in self._traces
            self._traces[how] = trace
            self._traces.move_to_end(how)
            if len(self._traces) > _MOST_TRACES:
                self._traces.popitem(last=False)
            self._append(f"cornerforge: the AV {how}\n{trace if is_new else ''}".encode(errors="backslashreplace"))

    def trace(self, how: str) -> str:
        """Give the traceback of a failure, "" if there is none."""
        with self._lock:
            return self._traces.get(how, "")

    def named(self) -> Path | None:
        """Give the file, to be named to the user; None if there is nothing in it."""
        with self._lock:
            if self._path is None or not self._path.exists():  # the AV may have removed it
                return None
            self._state["unnamed"] = None
            if self._path not in _latest[-1:]:
                _latest[:] = [self._path]
            return self._path

    def pointer(self) -> str:
        """Give the end of a message that names the file: "; its output and traceback: FILE", or "" without a file."""
        path = self.named()
        return "" if path is None else f"; what it printed: {path}"
