"""The simulator's end of a foreign AV: it starts the AV's process, asks it with a time limit, and ends it."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
import weakref
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import AvFaultError, CornerForgeError, FileFormatError, InputError
from cornerforge.foreign.pace import Pace
from cornerforge.foreign.protocol import ACT, FAILED, LOAD, SETUP, pack, pack_json, receive, unpack_json

if TYPE_CHECKING:
    from cornerforge.foreign.interface import AvContext

__all__ = ["DEFAULT_TIMEOUT", "FIRST_TIMEOUT", "AvFailureError", "AvProcess"]

DEFAULT_TIMEOUT = 5.0
"""Longest time that an AV may take for one answer [s]."""
FIRST_TIMEOUT = 60.0
"""Longest time for loading an AV, for setting it up, and for its first answer [s], each."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


class AvFailureError(Exception):
    """The AV did not answer as it should.

    Args:
        what: "raised", "answer", "hung" or "ended".
        message: Rest of a sentence that begins with the AV's name.
    """

    def __init__(self, what: str, message: str) -> None:
        super().__init__(message)
        self.what = what


def _end(process: subprocess.Popen[bytes], connection: socket.socket, lifeline: int) -> None:
    """End a process and all processes that it started."""
    connection.close()
    os.close(lifeline)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    with suppress(subprocess.TimeoutExpired):
        process.wait(timeout=5.0)


class AvProcess:
    """One process with one AV in it. After an AvFailureError call `renew`; where that fails, make another process.

    Args:
        spec: The AV, as behind --av.
        timeout: Longest time for the answer in one world [s].
        first_timeout: Longest time for loading, for setting up, and for the first answer [s], each.
        pace: What is known of the AV's speed, with these limits; None: nothing.

    Attributes:
        about: The AV's `kind` and `hash`, and what `drivers.Driver.about` says of it.

    Raises:
        InputError, FileFormatError: `spec` names no AV.
        AvFaultError: The process ended or hung while the AV was loaded.
    """

    def __init__(self, spec: str, *, timeout: float, first_timeout: float, pace: Pace | None = None) -> None:
        self._spec = spec
        self._pace = pace or Pace(timeout, first_timeout)
        self._first_timeout = self._pace.first_timeout
        self._batch = 0
        self._is_first = True
        ours, theirs = socket.socketpair()
        package = Path(__file__).parents[2]
        search = [str(package), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = dict.fromkeys(_ONE_THREAD, "1") | dict(os.environ) | {"PYTHONPATH": os.pathsep.join(search)}
        their_end, lifeline = os.pipe()
        try:
            with theirs:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-m", "cornerforge.foreign.worker", str(theirs.fileno()), str(their_end)],
                    stdin=subprocess.DEVNULL,
                    stdout=sys.stderr.fileno() if _has_file(sys.stderr) else subprocess.DEVNULL,
                    pass_fds=[theirs.fileno(), their_end],
                    start_new_session=True,
                    env=environment,
                )
        except BaseException:
            os.close(lifeline)
            raise
        finally:
            os.close(their_end)
        self._connection = ours
        self._finalizer = weakref.finalize(self, _end, self._process, ours, lifeline)
        try:
            self.about: dict[str, str] = unpack_json(self._ask(pack_json(LOAD, {"av": spec}), self._first_timeout))
        except AvFailureError as failure:
            self.close()
            raise AvFaultError(f"The AV {spec} {failure} while it was loaded.") from failure

    def setup(self, context: AvContext) -> None:
        """Tell the AV its world.

        Raises:
            AvFaultError: The AV failed in its `setup`.
        """
        self._batch = context.batch
        self._is_first = True
        try:
            self._ask(pack_json(SETUP, asdict(context)), self._first_timeout)
        except AvFailureError as failure:
            self.close()
            raise AvFaultError(f"The AV {self._spec} {failure} in setup.") from failure

    def renew(self, context: AvContext) -> bool:
        """Make the AV anew in the same process, after it raised or gave no usable answer; False if that fails."""
        if not self._finalizer.alive:
            return False
        try:
            self._ask(pack_json(LOAD, {"av": self._spec}), self._first_timeout)
            self.setup(context)
        except (AvFailureError, CornerForgeError):
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
        frame = pack(ACT, head.tobytes(), worlds.tobytes(), seeds.tobytes(), np.ascontiguousarray(view).tobytes())
        driving = int(np.count_nonzero(view[:, 0, 0]))
        begun = time.perf_counter()
        body = self._ask(frame, self._pace.limit(driving, first=self._is_first), driving)
        if not self._is_first:  # the first answer may take longer: libraries are loaded, code is compiled
            self._pace.note(driving, time.perf_counter() - begun)
        self._is_first = False
        said = int(np.frombuffer(body, np.int64, 1)[0])
        failed = json.loads(bytes(body[8 : 8 + said])) if said else {}
        answers = np.frombuffer(bytes(body[8 + said :]) if said else body, dtype=np.float64, offset=0 if said else 8)
        shape = (self._batch, -1, 5) if self.about["form"] == "trajectory" else (self._batch, 2)
        return answers.reshape(shape), {int(b): (what, how) for b, (what, how) in failed.items()}

    def close(self) -> None:
        """End the process."""
        self._finalizer()

    def _ask(self, frame: bytes, timeout: float, driving: int = 1) -> bytearray:
        self._connection.settimeout(timeout)
        try:
            self._connection.sendall(frame)
            kind, body = receive(self._connection)
        except TimeoutError as error:
            self.close()
            together = f" for {driving} worlds" if driving > 1 else ""
            raise AvFailureError("hung", f"gave no answer within {timeout:.3g} s{together}") from error
        except (EOFError, BrokenPipeError, ConnectionResetError) as error:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=2.0)
            status = self._process.returncode
            self.close()
            raise AvFailureError("ended", f"ended its process ({_status(status)})") from error
        except BaseException:  # an interrupt: a late answer would be taken for the answer to the next question
            self.close()
            raise
        if kind != FAILED:
            return body
        failed = unpack_json(body)
        if failed["what"] == "refused":
            self.close()
            raise (FileFormatError if failed["error"] == "FileFormatError" else InputError)(failed["message"])
        verb = "gave no usable answer:" if failed["what"] == "answer" else "raised"
        raise AvFailureError(failed["what"], f"{verb} {failed['message']}")


def _status(code: int | None) -> str:
    if code is None:
        return "it closed its connection"
    if code < 0:
        with suppress(ValueError):
            return f"signal {signal.Signals(-code).name}"
    return f"exit status {code}"


def _has_file(stream: object) -> bool:
    try:
        stream.fileno()  # type: ignore[attr-defined]
    except (AttributeError, OSError, ValueError):
        return False
    return True
