"""Locks: an output place belongs to one call at a time, and another call is told which process has it.

A folder is locked by the file `.cornerforge.lock` in it, a single file by `.NAME.cornerforge.lock` beside it, with the
package `filelock`. The lock is the operating system's, so a killed process loses its locks at once; its file only says
which process holds it, for messages, and is removed at the end. See docs/adr/0053-locks.md.
"""

from __future__ import annotations

import errno
import os
import shlex
import socket
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from cornerforge._files import LOOK, below, check_way, reason
from cornerforge.errors import OutputError

__all__ = ["claim_file", "claim_folder", "claims", "command_line", "is_lock", "lock_of"]

_NAME = ".cornerforge.lock"
_TRIES, _WAIT_S = 10, 0.2
"""Retries and pause. Checking a lock takes it for a moment, so one failure does not mean that another call has it."""
_LONGEST = 120
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}
"""Errors of a file system without locks; there the existence of the file decides (`filelock.SoftFileLock`)."""
_SCOPE: ContextVar[tuple[ExitStack, set[Path]] | None] = ContextVar("claims", default=None)
"""Releases at the end of this call, and the places that it, or a call around it, has claimed."""


def is_lock(name: str) -> bool:
    """Say whether a file of this name is a lock, which is no content.

    >>> is_lock(lock_of(Path("out"), is_folder=True).name), is_lock(lock_of(Path("p.npz"), is_folder=False).name)
    (True, True)
    """
    return name.endswith(_NAME)


def lock_of(path: Path, *, is_folder: bool) -> Path:
    """Name the lock file of an output place."""
    return path / _NAME if is_folder else path.with_name(f".{path.name}{_NAME}")


def command_line() -> str:
    """Return the command line of this process, or of the Python program that calls cornerforge."""
    name = Path(sys.argv[0]).name if sys.argv else ""
    return shlex.join(["cornerforge" if name in ("", "__main__.py") else name, *sys.argv[1:]])


@contextmanager
def claims() -> Iterator[None]:
    """Hold all that is claimed within, up to the end; a decorator of functions that write an output.

    A call within it may claim what it holds. Another thread may not.
    """
    around = _SCOPE.get()
    with ExitStack() as ends:
        token = _SCOPE.set((ends, set(around[1]) if around else set()))
        try:
            yield
        finally:
            _SCOPE.reset(token)


def claim_folder(folder: Path) -> None:
    """Claim an output folder with all in it, up to the end of `claims`; outside of one, only check that it is free.

    Args:
        folder: It is made; if nothing is in it at the end, it is removed.

    Raises:
        OutputError: Another process or thread writes there, or it cannot be written.
    """
    _claim(folder, is_folder=True)


def claim_file(path: Path) -> None:
    """Claim an output file in the same way, with the files beside it that are named after it.

    Raises:
        OutputError: Another process or thread writes there, or its folder cannot be written.
    """
    _claim(path, is_folder=False)


def _claim(path: Path, *, is_folder: bool) -> None:
    scope, place = _SCOPE.get(), Path(os.path.realpath(path))
    if scope is not None and not scope[1].isdisjoint((place, *place.parents)):
        return
    check_way(lock_of(path, is_folder=is_folder))
    for above in place.parents:
        with ExitStack() as briefly:
            holder = _holder_above(lock_of(above, is_folder=True), briefly)
        if holder:
            raise OutputError(f"{path} lies in {above}, which {holder}")
    file = lock_of(place, is_folder=is_folder)
    with ExitStack() as ends:
        try:
            holder = _lock(file, ends)
        except OSError as error:
            if os.path.lexists(file) and not _is_plain(file.lstat()):
                raise OutputError(
                    f"{file} is a link or no file, so it is no lock of cornerforge's; remove it."
                ) from error
            raise OutputError(f"Cannot write {path}: {reason(error)}; make room, or choose another place.") from error
        if holder:
            raise OutputError(f"{path} {holder}")
        if scope is not None:
            if is_folder:
                ends.enter_context(below(os.path.abspath(path), str(place)))
            scope[0].push(ends.pop_all())
            scope[1].add(place)


def _holder_above(file: Path, briefly: ExitStack) -> str:
    """Say which process holds the lock of a folder above; no lock, or another user's, is ignored."""
    with suppress(OSError):
        return _lock(file, briefly) if os.path.lexists(file) else ""
    return ""


def _lock(file: Path, ends: ExitStack) -> str:
    """Take a lock, up to the end of `ends`, which also removes its file and the folders that were made for it.

    Returns:
        Which process holds it, and what to do; "" if it is taken now.

    Raises:
        OSError: It cannot be written, or is a link or no file.
    """
    from filelock import BaseFileLock, FileLock, SoftFileLock, Timeout  # importing it takes 40 ms

    lock: BaseFileLock = FileLock(file, timeout=_WAIT_S, thread_local=False, fallback_to_soft=False, on_acquired=_sign)
    for left in reversed(range(_TRIES)):
        for folder in [folder for folder in file.parents if not folder.exists()][::-1]:
            ends.callback(_tried, folder.rmdir)
        try:
            lock.acquire(poll_interval=0.02)
        except Timeout:
            until = f", or remove {file} if that process runs no more" if isinstance(lock, SoftFileLock) else ""
            return f"{_told(file)}; wait, or choose another place{until}."
        except FileNotFoundError:  # another call has removed the folder, in which it left nothing
            if not left:
                raise
        except FileExistsError:
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR)) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS or isinstance(lock, SoftFileLock):
                raise
            if file.lstat().st_size == 0:  # made for a lock that cannot be had
                _tried(file.unlink)
            lock = SoftFileLock(file, timeout=_WAIT_S, thread_local=False)
        else:
            break
    ends.callback(lock.release)
    ends.callback(_tried, file.unlink)  # before it is free, or it might be another's by then
    return ""


def _tried(remove: Callable[[], None]) -> None:
    with suppress(OSError):
        remove()


def _is_plain(found: os.stat_result) -> bool:
    """Say whether this is of a regular file that has no other name."""
    return stat.S_ISREG(found.st_mode) and found.st_nlink <= 1


def _sign(number: int) -> None:
    """Write into an open lock which process holds it; on a full disk it is held all the same.

    Raises:
        OSError: It is no regular file, or has other names too (links).
    """
    if not _is_plain(os.fstat(number)):
        raise OSError(errno.EINVAL, "is a link, or no regular file")
    words = " ".join(command_line().split())
    said = f"{os.getpid()}\n{socket.gethostname()}\n{time.strftime('%Y-%m-%d %H:%M:%S')}\n{words}\n"
    with suppress(OSError):
        os.ftruncate(number, 0)
        os.write(number, said.encode(errors="replace"))


def _told(file: Path) -> str:
    """Say which process holds a lock, as its file tells; `filelock` itself writes two or three lines, `_sign` four."""
    said: list[str] = []
    with suppress(OSError), open(os.open(file, LOOK), "rb") as opened:
        if _is_plain(os.fstat(opened.fileno())):
            said = opened.read(1 << 16).decode(errors="replace").splitlines()
    if len(said) < 2:
        return "is being written by another process"
    is_here = said[:2] == [str(os.getpid()), socket.gethostname()]
    process = "another call in this process" if is_here else f"process {said[0]} on {said[1]}"
    return f"is being written by {process}{f' since {said[2]}: {said[3][:_LONGEST]}' if len(said) > 3 else ''}"
