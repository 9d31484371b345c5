"""The process in which a foreign AV runs: it loads the AV, asks it, and reports in one line what went wrong.

`cornerforge.foreign.keeper` starts it; the simulator is at the other end of its socket. Nothing of the simulator is
imported here: it may be another Python, which has the standard library and NumPy only
(`cornerforge.foreign.interpreter`). What the AV prints goes to the standard streams; the simulator makes a file of it.
"""

from __future__ import annotations

import faulthandler
import json
import os
import socket
import sys

import numpy as np

from cornerforge.foreign.drivers import Driver, EndedError, UnusableError, WrongAvError, described, traced
from cornerforge.foreign.interface import AvContext
from cornerforge.foreign.protocol import ACT, ANSWER, FAILED, LOAD, SETUP, pack, pack_json, receive, unpack_json

__all__ = ["Server", "main"]


def _act(driver: Driver, body: bytearray) -> bytes:
    fresh = int(np.frombuffer(body, np.int64, 1)[0])
    worlds = np.frombuffer(body, np.int64, fresh, 8).copy()
    seeds = np.frombuffer(body, np.int64, fresh, 8 + 8 * fresh).copy()
    if fresh:
        driver.reset(worlds, seeds)
    answers = driver.answer(driver.seen(memoryview(body)[8 + 16 * fresh :]))
    told = {"failed": driver.failed, "traces": driver.traces}
    failed = json.dumps(told).encode() if driver.failed else b""
    return np.int64(len(failed)).tobytes() + failed + answers.tobytes()


class Server:
    """Answers the simulator's messages with the AV that they name."""

    def __init__(self) -> None:
        self._driver: Driver | None = None
        self._is_set_up = False

    def close(self) -> None:
        """Give up the AV."""
        if self._driver is not None:
            self._driver.close()
        self._driver, self._is_set_up = None, False

    def reply(self, kind: bytes, number: int, body: bytearray) -> bytes | None:
        """Make the reply to a message; None: it cannot be one of the simulator's."""
        try:
            if kind == LOAD:
                from cornerforge.foreign.loaders import load_av
                from cornerforge.foreign.networks import Reading

                self.close()
                said = unpack_json(body)
                self._driver, about = load_av(said.pop("av"), Reading(**said))
                return pack_json(ANSWER, number, about | self._driver.about)
            if kind == SETUP and self._driver is not None:
                self._driver.setup(AvContext.of_stated(unpack_json(body)))
                self._is_set_up = True
                return pack(ANSWER, number)
            if kind == ACT and self._driver is not None and self._is_set_up:
                return pack(ANSWER, number, _act(self._driver, body))
        except UnusableError as error:
            return pack_json(FAILED, number, {"what": "answer", "message": str(error)})
        except EndedError as error:
            return pack_json(FAILED, number, {"what": "ended", "message": str(error)})
        except WrongAvError as error:
            return pack_json(
                FAILED, number, {"what": "refused", "message": f"The AV is none: {error}.", "error": "InputError"}
            )
        except Exception as error:  # whatever the user's code raises is reported and must not end this process
            from cornerforge.errors import CornerForgeError

            if isinstance(error, CornerForgeError):
                how = {"what": "refused", "message": str(error), "error": type(error).__name__}
                if error.__cause__ is not None:
                    how["trace"] = traced(error.__cause__)
            else:
                how = {"what": "raised", "message": described(error), "trace": traced(error)}
            return pack_json(FAILED, number, how)
        return None


def _serve(connection: socket.socket) -> None:
    """Answer the simulator's messages until it closes the connection."""
    server = Server()
    while (reply := server.reply(*receive(connection))) is not None:
        connection.sendall(reply)


def main(fd: int) -> None:
    """Serve on the socket `fd`, until the simulator closes it."""
    sys.path.insert(0, os.getcwd())
    faulthandler.enable()
    for stream in (sys.stdout, sys.stderr):  # what is printed is not lost when the process ends, and never an error
        stream.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
    with socket.socket(fileno=fd) as connection:
        connection.set_inheritable(False)
        try:
            _serve(connection)
        except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
            return
