"""The process in which a foreign AV runs: it loads the AV, asks it, and reports in one line what went wrong.

It is started as `python -m cornerforge.foreign.worker FD LIFELINE`; the simulator is at the other end of that socket
and of that pipe. Nothing of the simulator is imported here.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import threading
import time
import traceback
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge.foreign.interface import VIEW_SHAPE, Av, AvContext
from cornerforge.foreign.protocol import ACT, ANSWER, FAILED, LOAD, SETUP, pack, pack_json, receive, unpack_json

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["main", "numbers_of"]


class _UnusableError(Exception):
    """The AV's answer is no array of numbers of the right shape."""


def numbers_of(answer: Any, batch: int) -> NDArray[np.float64]:
    """Turn an AV's answer into float64 (batch, 2).

    Raises:
        _UnusableError: The answer is no array of real numbers of that shape.
    """
    try:
        array = np.asarray(answer)
    except (TypeError, ValueError, RuntimeError) as error:
        raise _UnusableError(f"act returned a {type(answer).__name__} that is no array ({error})") from error
    if array.dtype.kind not in "fiu":
        raise _UnusableError(f"act returned an array of type {array.dtype}; allowed: real numbers")
    if array.shape != (batch, 2):
        raise _UnusableError(f"act returned an array of shape {array.shape}; expected ({batch}, 2)")
    return np.ascontiguousarray(array, dtype=np.float64)


def _where(error: BaseException) -> str:
    """Name file and line of the AV's own code that raised an exception."""
    frames = traceback.extract_tb(error.__traceback__)[1:]
    return f" ({os.path.basename(frames[-1].filename)}:{frames[-1].lineno})" if frames else ""


def _described(error: BaseException) -> str:
    text = " ".join(str(error).split())[:300]
    return f"{type(error).__name__}({text}){_where(error)}"


def _remembers(av: Any) -> bool:
    """May the AV remember what it saw in a test? Without a `reset` of its own it could not forget it either."""
    return getattr(type(av), "reset", Av.reset) is not Av.reset


def _act(av: Any, context: AvContext, body: bytearray) -> bytes:
    fresh = int(np.frombuffer(body, np.int64, 1)[0])
    worlds = np.frombuffer(body, np.int64, fresh, 8).copy()
    seeds = np.frombuffer(body, np.int64, fresh, 8 + 8 * fresh).copy()
    view = np.frombuffer(body, np.float32, offset=8 + 16 * fresh).reshape(context.batch, *VIEW_SHAPE)
    if fresh and hasattr(av, "reset"):
        av.reset(worlds, seeds)
    return numbers_of(av.act(view), context.batch).tobytes()


def _serve(connection: socket.socket) -> None:
    """Answer the simulator's messages until it closes the connection."""
    av: Any = None
    context: AvContext | None = None
    while True:
        kind, body = receive(connection)
        try:
            if kind == LOAD:
                from cornerforge.foreign.loaders import load_av

                av, about = load_av(unpack_json(body)["av"])
                reply = pack_json(ANSWER, about | {"remembers": "yes" if _remembers(av) else "no"})
            elif kind == SETUP:
                context = AvContext(**unpack_json(body))
                if hasattr(av, "setup"):
                    av.setup(context)
                reply = pack(ANSWER)
            elif kind == ACT and context is not None:
                reply = pack(ANSWER, _act(av, context, body))
            else:
                return
        except _UnusableError as error:
            reply = pack_json(FAILED, {"what": "answer", "message": str(error)})
        except Exception as error:  # whatever the user's code raises is reported and must not end this process
            from cornerforge.errors import CornerForgeError

            if isinstance(error, CornerForgeError):
                reply = pack_json(FAILED, {"what": "refused", "message": str(error), "error": type(error).__name__})
            else:
                reply = pack_json(FAILED, {"what": "raised", "message": _described(error)})
        connection.sendall(reply)


def _leave_with(parent: int) -> None:
    """End this process when its parent is gone; `_watch` ends one that holds the interpreter's lock."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


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
    with socket.socket(fileno=fd) as connection:
        try:
            _serve(connection)
        except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
            return


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
