"""The simulator's end of a foreign AV: it starts the AV's process, asks it with a time limit, and ends it."""

from __future__ import annotations

import glob
import json
import os
import re
import secrets
import signal
import socket
import struct
import subprocess
import threading
import time
import weakref
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import AvFaultError, CornerForgeError, FileFormatError, InputError, one_line, printable
from cornerforge.foreign.av_log import AvLog
from cornerforge.foreign.interface import ANSWERS
from cornerforge.foreign.interpreter import MARK, USUAL, Confines, environment, worker_command
from cornerforge.foreign.networks import Reading
from cornerforge.foreign.pace import Pace
from cornerforge.foreign.protocol import (
    ACT,
    ANSWER,
    FAILED,
    LOAD,
    SETUP,
    JunkError,
    pack,
    receive,
    unpack_json,
)
from cornerforge.foreign.scene import COLUMNS

if TYPE_CHECKING:
    from cornerforge.foreign.interface import AvContext

_LENGTH = COLUMNS.index("length")

__all__ = ["DEFAULT_TIMEOUT", "FIRST_TIMEOUT", "AvFailureError", "AvProcess"]

DEFAULT_TIMEOUT = 5.0
"""Longest time that an AV may take for one answer [s]."""
FIRST_TIMEOUT = 60.0
"""Longest time for loading an AV, for setting it up, and for its first answer [s], each."""
_END_SECONDS = 15.0
"""Time for an AV's keeper to end all that is left [s]; it gives up before."""
_LONGEST_LINE = 1000
_POSE = 5
_ABOUT = {
    "kind": "class|policy|program|onnx|zip", "hash": "[0-9a-f]{16}", "form": "view|" + "|".join(ANSWERS),
    "objects": r"|-1|\d{1,9}", "remembers": "yes|no", "read": "[ -~]{0,500}", "maker": "[ -~]{0,500}",
}  # fmt: skip
"""What a process says of its AV when it is loaded, and what is allowed."""
_SAID = struct.Struct("=q")
_VERBS = {"answer": "gave no usable answer: ", "raised": "raised ", "ended": ""}


def _said(text: str) -> str:
    r"""Write what an AV says in one line, of 1000 characters or less.

    >>> _said("to the\nplanner\x1b[2J")
    'to the planner\\x1b[2J'
    """
    line = one_line(" ".join(text[:10_000].split()))
    return line if len(line) <= _LONGEST_LINE else line[: _LONGEST_LINE - 3] + "..."


class AvFailureError(Exception):
    """The AV did not answer as it should.

    Args:
        what: "raised", "answer", "hung" or "ended".
        message: Rest of a sentence that begins with the AV's name.
        trace: The AV's own traceback, if it raised.
    """

    def __init__(self, what: str, message: str, trace: str = "") -> None:
        super().__init__(message)
        self.what, self.trace = what, trace
        if trace:
            self.add_note(f"The AV's own traceback:\n{trace}")


def _keep_printed(printed: int, log: AvLog) -> None:
    """Put what comes through a pipe into the log, until its other ends are closed."""
    with suppress(OSError):
        while content := os.read(printed, 1 << 16):
            log.write(content)
    os.close(printed)


def _end(
    process: subprocess.Popen[bytes],
    connection: socket.socket,
    line: socket.socket,
    printing: threading.Thread,
    mark: str,
) -> None:
    """End a process and all processes that it started, and wait until its last words are kept."""
    connection.close()
    line.close()
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)  # the AV may have stopped its keeper
    with suppress(subprocess.TimeoutExpired):
        process.wait(timeout=_END_SECONDS)
    if process.returncode != 0:  # its keeper was ended or stopped, or could not end all
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=_END_SECONDS)
        _end_marked(mark)
    if printing is not threading.current_thread():  # where memory is tidied, it may be
        printing.join(1.0)


def _end_marked(mark: str) -> None:
    """End all processes in whose environment a mark is, where the system tells (Linux)."""
    known = f"{MARK}={mark}".encode()
    for _ in range(100):
        found = False
        for place in glob.glob("/proc/[0-9]*/environ"):
            with suppress(OSError), open(place, "rb") as file:
                if known in file.read().split(b"\0"):
                    found = True
                    os.kill(int(place.split("/")[2]), signal.SIGKILL)
        if not found:
            return
        time.sleep(0.01)


class AvProcess:
    """One process with one AV in it. After an AvFailureError call `renew`; where that fails, make another process.

    Args:
        spec: The AV, as behind --av.
        timeout: Longest time for the answer in one world [s].
        first_timeout: Longest time for loading, for setting up, and for the first answer [s], each.
        pace: What is known of the AV's speed, with these limits; None: nothing.
        confines: In what it runs.
        log: Where what it prints is kept; None: in a log of this process.
        reading: What is said of a network that its file does not say.

    Attributes:
        log: Likewise.
        about: What `load_av` and `drivers.Driver.about` say of the AV.

    Raises:
        InputError, FileFormatError: `spec` names no AV.
        AvFaultError: The process ended or hung while the AV was loaded.
    """

    def __init__(
        self,
        spec: str,
        *,
        timeout: float,
        first_timeout: float,
        pace: Pace | None = None,
        confines: Confines = USUAL,
        log: AvLog | None = None,
        reading: Reading = Reading(),  # noqa: B008 - it is frozen
    ) -> None:
        self._spec, self._reading = spec, reading
        self._pace = pace or Pace(timeout, first_timeout)
        self._first_timeout = self._pace.first_timeout
        self._batch = 0
        self._is_first = True
        self.log = AvLog() if log is None else log
        confines.check()  # before anything is opened
        self._confines = confines
        self._question = 0
        self._start()
        try:
            self.about = self._load()
        except AvFailureError as failure:
            self.close()
            raise AvFaultError(f"The AV {spec} {failure} while it was loaded{self.log.pointer()}") from failure
        except JunkError as error:
            disturbed = self._junk(error)
            raise AvFaultError(f"The AV {spec} {disturbed} while it was loaded{self.log.pointer()}") from disturbed
        except CornerForgeError as error:
            self.close()
            if trace := self.log.trace(str(error)):
                error.add_note(f"The AV's own traceback:\n{trace}")
            raise

    def _start(self) -> None:
        """Start the process, with a socket over which it is asked.

        Raises:
            InputError: It cannot run as it is to.
        """
        if not hasattr(os, "killpg"):
            raise InputError("An AV from outside runs in a process group of its own, which this system does not have.")
        mark = secrets.token_hex(8)
        ours, theirs = socket.socketpair()
        line, keepers = socket.socketpair()
        printed, print_to = os.pipe()
        try:
            with theirs, keepers:
                self._process = subprocess.Popen(
                    worker_command(self._confines, theirs.fileno(), keepers.fileno()),
                    stdin=subprocess.DEVNULL,
                    stdout=print_to,
                    stderr=print_to,
                    pass_fds=[theirs.fileno(), keepers.fileno()],
                    start_new_session=True,
                    env=environment(self._confines, mark),
                )
        except BaseException:
            os.close(printed)
            ours.close()
            line.close()
            raise
        finally:
            os.close(print_to)
        self._printing = threading.Thread(target=_keep_printed, args=(printed, self.log), daemon=True)
        self._printing.start()
        self._connection = ours
        self._line = line
        self._finalizer: weakref.finalize[..., AvProcess] = weakref.finalize(
            self, _end, self._process, ours, line, self._printing, mark
        )

    def _load(self) -> dict[str, str]:
        """Let the process load its AV, and give what it says of it.

        Raises:
            AvFailureError, CornerForgeError: There is none.
            JunkError: What it says cannot be.
        """
        asked = json.dumps({"av": self._spec} | asdict(self._reading)).encode()
        said = unpack_json(self._ask(LOAD, self._first_timeout, asked))
        about = {key: said.get(key) for key in _ABOUT}
        wrong = [key for key, allowed in _ABOUT.items() if not re.fullmatch(allowed, str(about[key]))]
        if wrong or not all(isinstance(value, str) for value in about.values()) or len(said) != len(about):
            raise JunkError(f"it says of the AV {_said(str(said))}")
        return {key: str(value) for key, value in about.items()}

    def setup(self, context: AvContext) -> None:
        """Tell the AV its world.

        Raises:
            AvFaultError: The AV failed in its `setup`.
        """
        self._batch = context.batch
        self._is_first = True
        try:
            self._ask(SETUP, self._first_timeout, json.dumps(context.stated()).encode())
        except AvFailureError as failure:
            self.close()
            raise AvFaultError(f"The AV {self._spec} {failure} in setup{self.log.pointer()}") from failure

    def renew(self, context: AvContext) -> bool:
        """Make the AV anew in the same process, after it raised or gave no usable answer; False if that fails."""
        if not self._finalizer.alive:
            return False
        try:
            if self._load() != self.about:
                self.close()  # its files have changed
                return False
            self.setup(context)
        except (AvFailureError, CornerForgeError, JunkError):
            self.close()
            return False
        return True

    def act(
        self, view: NDArray[Any], worlds: NDArray[np.int64], seeds: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], dict[int, tuple[str, str]]]:
        """Reset `worlds`, if there are any, and ask for the AV's answers to what it sees, as the AV gave them.

        Returns:
            (B, 2), or poses (B, M, 5); the worlds in which it failed, though not in others, and what and how.

        Raises:
            AvFailureError: There is no usable answer.
        """
        head = np.array([worlds.size], dtype=np.int64)
        parts = head.tobytes(), worlds.tobytes(), seeds.tobytes(), np.ascontiguousarray(view).tobytes()
        driving = int(np.count_nonzero(view[:, 0, 0 if self.about["form"] == "view" else _LENGTH]))
        begun = time.perf_counter()
        body = self._ask(ACT, self._pace.limit(driving, first=self._is_first), *parts, driving=driving)
        if not self._is_first:  # the first answer may take longer: libraries are loaded, code is compiled
            self._pace.note(driving, time.perf_counter() - begun)
        self._is_first = False
        try:
            return self._read(body)
        except (JunkError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise self._junk(error) from error

    def _read(self, body: bytearray) -> tuple[NDArray[np.float64], dict[int, tuple[str, str]]]:
        """Read the reply to a question.

        Raises:
            JunkError, ValueError, TypeError, KeyError, AttributeError: It is of the wrong form.
        """
        if len(body) < _SAID.size:
            raise JunkError(f"a reply of {len(body)} bytes")
        (said,) = _SAID.unpack_from(body)
        begin = _SAID.size + said
        if not _SAID.size <= begin <= len(body):
            raise JunkError(f"a reply of {len(body)} bytes that begins with {said}")
        told = unpack_json(body[_SAID.size : begin]) if said else {"failed": {}, "traces": {}}
        failed = {int(b): (str(what), _said(str(how))) for b, (what, how) in told["failed"].items()}
        traces = {_said(str(how)): printable(str(trace)) for how, trace in told["traces"].items()}
        if not all(0 <= b < self._batch for b in failed):
            raise JunkError(f"failures in worlds {sorted(failed)} of {self._batch}")
        for how in dict.fromkeys(how for _, how in failed.values()):
            self.log.note(how, traces.get(how, ""))
        shape = (self._batch, -1, _POSE) if self.about["form"] == "trajectory" else (self._batch, 2)
        return np.frombuffer(bytes(body[begin:]), dtype=np.float64).reshape(shape), failed

    def _junk(self, error: Exception) -> AvFailureError:
        """Give up a process that does not keep to the protocol: what it says next means nothing."""
        self.close()
        return AvFailureError("ended", f"disturbed the socket through which it is asked ({_said(str(error))})")

    def close(self) -> None:
        """End the process."""
        self._finalizer()

    def _ask(self, kind: bytes, timeout: float, *parts: bytes, driving: int = 1) -> bytearray:
        self._question += 1
        try:
            kind, number, body = self._exchange(pack(kind, self._question, *parts), timeout)
            if kind not in (ANSWER, FAILED) or number != self._question:
                raise JunkError(f"a message of kind {kind!r} for question {number}, to question {self._question}")
        except TimeoutError as error:
            self.close()
            together = f" for {driving} worlds" if driving > 1 else ""
            raise AvFailureError("hung", f"gave no answer within {timeout:.3g} s{together}") from error
        except (EOFError, BrokenPipeError, ConnectionResetError) as error:
            how = self._how_it_ended()
            self.close()
            raise AvFailureError("ended", how) from error
        except JunkError as error:
            raise self._junk(error) from error
        except BaseException:  # an interrupt: a late answer would be taken for the answer to the next question
            self.close()
            raise
        if kind != FAILED:
            return body
        try:
            failed = unpack_json(body)
            what, message, trace = str(failed["what"]), _said(str(failed["message"])), str(failed.get("trace", ""))
            how = message if what == "refused" else _VERBS[what] + message
        except (JunkError, KeyError) as error:
            raise self._junk(error) from error
        trace = printable(trace)
        self.log.note(how, trace)
        if what == "refused":
            self.close()
            raise (FileFormatError if failed.get("error") == "FileFormatError" else InputError)(message)
        raise AvFailureError(what, how, trace)

    def _exchange(self, question: bytes, timeout: float) -> tuple[bytes, int, bytearray]:
        """Send a frame, and wait for the one that comes back: kind, number, body.

        Raises:
            TimeoutError: None came in time [s].
            EOFError, BrokenPipeError, ConnectionResetError: The process has ended.
            JunkError: What came is no frame.
        """
        until = time.monotonic() + timeout
        self._connection.settimeout(timeout)
        self._connection.sendall(question)
        return receive(self._connection, until, self._line)

    def _how_it_ended(self) -> str:
        """Say how the process ended, as its keeper says."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=2.0)
        try:
            self._line.setblocking(False)
            said = json.loads(self._line.recv(1000))
        except (OSError, ValueError):  # nothing was said
            if self._process.returncode is None:
                return "ended its process (it closed its connection)"
            return f"ended its process (and the one that keeps it: {_status(self._process.returncode)})"
        if said["is_full"]:
            return f"took more than {self._confines.gigabytes:.3g} GB of memory (--av-memory)"
        return f"ended its process ({_status(said['status'])})"


def _status(code: int | None) -> str:
    if code is None:
        return "it does not say how"
    if code < 0:
        with suppress(ValueError):
            return f"signal {signal.Signals(-code).name}"
    return f"exit status {code}"
