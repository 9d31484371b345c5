"""The process in which a foreign AV runs: it loads the AV, asks it, and reports in one line what went wrong.

It is started as `python -m cornerforge.foreign.worker FD LIFELINE`; the simulator is at the other end of that socket
and of that pipe. Nothing of the simulator is imported here: it may be another Python, which has the standard library
and NumPy only (`cornerforge.foreign.interpreter`). What the AV prints goes to the standard streams, of which the
simulator makes a file.
"""

from __future__ import annotations

import faulthandler
import json
import os
import select
import signal
import socket
import sys
import threading
import time
import warnings

import numpy as np

from cornerforge.foreign.drivers import Driver, EndedError, UnusableError, WrongAvError, described, traced
from cornerforge.foreign.interface import AvContext
from cornerforge.foreign.protocol import ACT, ANSWER, FAILED, LOAD, SETUP, pack, pack_json, receive, unpack_json

__all__ = ["main"]


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


def _serve(connection: socket.socket) -> None:
    """Answer the simulator's messages until it closes the connection."""
    driver: Driver | None = None
    is_set_up = False
    while True:
        kind, body = receive(connection)
        try:
            if kind == LOAD:
                from cornerforge.foreign.loaders import load_av

                if driver is not None:
                    driver.close()
                driver, is_set_up = None, False
                driver, about = load_av(unpack_json(body)["av"])
                reply = pack_json(ANSWER, about | driver.about)
            elif kind == SETUP and driver is not None:
                driver.setup(AvContext(**unpack_json(body)))
                is_set_up = True
                reply = pack(ANSWER)
            elif kind == ACT and driver is not None and is_set_up:
                reply = pack(ANSWER, _act(driver, body))
            else:
                return
        except UnusableError as error:
            reply = pack_json(FAILED, {"what": "answer", "message": str(error)})
        except EndedError as error:
            reply = pack_json(FAILED, {"what": "ended", "message": str(error)})
        except WrongAvError as error:
            reply = pack_json(
                FAILED, {"what": "refused", "message": f"The AV is none: {error}.", "error": "InputError"}
            )
        except Exception as error:  # whatever the user's code raises is reported and must not end this process
            from cornerforge.errors import CornerForgeError

            if isinstance(error, CornerForgeError):
                how = {"what": "refused", "message": str(error), "error": type(error).__name__}
                if error.__cause__ is not None:
                    how["trace"] = traced(error.__cause__)
            else:
                how = {"what": "raised", "message": described(error), "trace": traced(error)}
            reply = pack_json(FAILED, how)
        connection.sendall(reply)


def _leave_with(parent: int) -> None:
    """End this process, and what it started, when its parent is gone.

    `_watch` ends one that holds the interpreter's lock.
    """
    while os.getppid() == parent:
        time.sleep(1.0)
    os.killpg(0, signal.SIGKILL)  # it leads a group of its own (`process.AvProcess`)


def _watch(lifeline: int) -> None:
    """Start a process that ends this one, and all that it starts, when the simulator is gone.

    A thread of this process cannot: an AV that hangs in native code may hold the interpreter's lock. The simulator has
    the other end of the pipe `lifeline`, which closes when it ends, however it ends.
    """
    av = os.getpid()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # a matrix library may have threads; the child uses none
        child = os.fork()
    if child != 0:
        os.close(lifeline)
        return
    try:
        os.closerange(0, lifeline)
        os.closerange(lifeline + 1, 1024)
        poll = select.poll()
        poll.register(lifeline, select.POLLIN)
        while os.getppid() == av:
            if poll.poll(1000.0):
                os.killpg(0, signal.SIGKILL)
    finally:
        os._exit(0)


def main(fd: int, lifeline: int) -> None:
    """Serve on the socket `fd`, as long as the other end of the pipe `lifeline` is open."""
    _watch(lifeline)
    threading.Thread(target=_leave_with, args=(os.getppid(),), daemon=True).start()
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


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
