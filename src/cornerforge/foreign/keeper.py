"""The process that keeps an AV's process: it starts it within limits, and lets nothing of it live on.

The AV's process is its child. All that the AV starts is below it, also what leaves its session and loses its parents
(Linux). When the AV's process ends, the simulator ends, however it ends, or memory runs out, all of that is ended, and
the simulator is told how the AV's process ended. Needs the standard library only: it is small, and has one thread.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import select
import signal
import socket
import time
from contextlib import suppress

from cornerforge.foreign.protocol import FAILED, pack_json, receive

__all__ = ["main"]

_LOOK_SECONDS = 0.25
"""Time between two looks at the memory [s]."""
_SWEEP_SECONDS = 10.0
_DEATH_SIGNAL, _ADOPT = 1, 36


def main(text: str) -> None:
    """Start an AV's process and keep it; only that process returns.

    Args:
        text: JSON: file numbers of the `socket` over which the AV is asked and of the `line` over which the simulator
            is told, which closes when it ends; `memory` of the AV [bytes].
    """
    how = json.loads(text)
    line, memory = int(how["line"]), int(how["memory"])
    _prctl(_ADOPT, 1)
    try:
        _become_kept(line, memory)
    except OSError as error:
        _refuse(how["socket"], error)
    with suppress(OSError), open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
        file.write("1000")  # the system's choice where its memory runs out
    os.close(line)
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _limit(memory)
    from cornerforge.foreign.worker import main as serve

    serve(int(how["socket"]))


def _prctl(what: int, value: int) -> None:
    """Set something of this process, where there is such a thing."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(what, ctypes.c_ulong(value), *[ctypes.c_ulong(0)] * 3)


def _become_kept(line: int, memory: int) -> None:
    """Go on as the child that is kept; the parent keeps it, and ends."""
    keeper = os.getpid()
    child = os.fork()
    if child:
        try:
            _keep(child, line, memory)
        finally:
            os._exit(1)
    _prctl(_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != keeper:  # it has ended already
        os._exit(1)


def _keep(child: int, line: int, memory: int) -> None:
    """Wait until the child or the simulator ends, or memory runs out; end all that is left, and say how it ended."""
    for other in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(other, signal.SIG_IGN)
    os.closerange(0, line)
    os.closerange(line + 1, 4096)
    wake, woken = os.pipe()
    os.set_blocking(wake, False)
    os.set_blocking(woken, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
    poll = select.poll()
    poll.register(line, select.POLLIN)
    poll.register(wake, select.POLLIN)
    is_full, status = False, _reaped(child)
    while status is None and not is_full:
        ready = dict(poll.poll(1000.0 * _LOOK_SECONDS if memory else None))
        if line in ready:
            break
        if wake in ready:
            with suppress(BlockingIOError):
                os.read(wake, 4096)
        status = _reaped(child)
        is_full = memory > 0 and _is_over(memory, _below(os.getpid()))
    status, is_swept = _swept(child, status)
    said = json.dumps({"status": status, "is_full": is_full}).encode()
    with suppress(OSError), socket.socket(fileno=line) as to:
        to.send(said)
    os._exit(0 if is_swept else 1)


def _swept(child: int, status: int | None) -> tuple[int | None, bool]:
    """End all that is below this process; give the exit status of `child`, and whether nothing is left."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    deadline = time.monotonic() + _SWEEP_SECONDS
    try:
        while time.monotonic() < deadline:
            for pid in [child] * (status is None) + _below(os.getpid()):
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
            ended = _reaped(child, all_must_end=True)
            status = ended if status is None else status
            time.sleep(0.001)
    except ChildProcessError:
        return status, True
    return status, False


def _reaped(child: int, *, all_must_end: bool = False) -> int | None:
    """Take note of all children that have ended; give the exit status of `child` (-N: signal N), if it is among them.

    Raises:
        ChildProcessError: There are none any more, and `all_must_end`.
    """
    status = None
    try:
        while True:
            pid, how = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return status
            if pid == child:
                status = os.WEXITSTATUS(how) if os.WIFEXITED(how) else -os.WTERMSIG(how)
    except ChildProcessError:
        if all_must_end and status is None:
            raise
        return status


def _below(pid: int) -> list[int]:
    """List all processes that a process has started, directly or not, where the system tells (Linux)."""
    found, waiting = list[int](), [pid]
    while waiting:
        one = waiting.pop()
        with suppress(OSError):
            for task in os.listdir(f"/proc/{one}/task"):
                with suppress(OSError):
                    waiting += map(int, _read(f"/proc/{one}/task/{task}/children").split())
        found.append(one)
    return found[1:]


def _read(path: str) -> str:
    with open(path, encoding="ascii") as file:
        return file.read()


def _is_over(memory: int, pids: list[int]) -> bool:
    """Do processes hold more memory than so much [bytes]? What several share counts once."""
    resident = proportional = 0
    page = os.sysconf("SC_PAGE_SIZE")
    for pid in pids:
        with suppress(OSError):
            resident += page * int(_read(f"/proc/{pid}/statm").split()[1])
    if resident <= memory:
        return False
    for pid in pids:
        with suppress(OSError):
            proportional += 1024 * int(_read(f"/proc/{pid}/smaps_rollup").partition("\nPss:")[2].split()[0])
    return proportional > memory


def _limit(memory: int) -> None:
    """Limit the memory that this process can ask for [bytes]."""
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    memory = memory if most == resource.RLIM_INFINITY else min(memory, most)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))


def _refuse(fd: int, error: OSError) -> None:
    """Tell the simulator why there is no AV, and end."""
    with socket.socket(fileno=fd) as connection:
        _, number, _ = receive(connection)
        message = f"The AV's process cannot be started: {error.strerror}."
        connection.sendall(pack_json(FAILED, number, {"what": "refused", "message": message, "error": "InputError"}))
    os._exit(0)
