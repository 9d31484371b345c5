"""Locks: an output place belongs to one call at a time, and whoever wants it meanwhile is told who has it.

A folder is locked by the file `.cornerforge.lock` in it, a single file by `.NAME.cornerforge.lock` beside it. The lock
is the operating system's, so that of a killed process is free at once; the file only says who holds it, in a line of
JSON. It is removed at the end. See docs/adr/0053-locks.md, also for file systems without such locks.
"""

from __future__ import annotations

import errno
import getpass
import itertools
import json
import os
import shlex
import socket
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cornerforge._files import below, check_way, reason
from cornerforge._words import spoken
from cornerforge.errors import OutputError

__all__ = ["claim_file", "claim_folder", "claims", "command_line", "is_lock", "lock_of"]

_NAME = ".cornerforge.lock"
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP}
"""What a file system says that has no locks."""
_TRIES, _PAUSE_S = 10, 0.02
"""Who only looks whether a lock is held, holds it for a moment: so wait before giving up."""
_LONGEST_COMMAND = 120
_LONGEST_LOCK = 1 << 20
_HALF_A_DAY_S = 43_200.0
_FAR = 1 << 30
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""How a lock is opened: a stranger's folder may hold a link, or a pipe that would be waited for, in its place."""


def is_lock(name: str) -> bool:
    """Say whether a file of this name is a lock, which is nobody's content.

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


# Claims of a call


@dataclass(frozen=True)
class _Scope:
    """What a call has claimed, and within which other call it runs."""

    outer: _Scope | None
    ends: ExitStack
    places: set[Path] = field(default_factory=set)

    def holds(self, place: Path) -> bool:
        """Say whether this call, or one around it, has claimed a place or a folder above it."""
        mine = place in self.places or not self.places.isdisjoint(place.parents)
        return mine or (self.outer is not None and self.outer.holds(place))


_SCOPE: ContextVar[_Scope | None] = ContextVar("claims", default=None)


@contextmanager
def claims() -> Iterator[None]:
    """Hold all that is claimed within, up to the end; a decorator of whatever writes an output.

    A call within it may claim what it holds. Another thread may not.
    """
    with ExitStack() as ends:
        token = _SCOPE.set(_Scope(_SCOPE.get(), ends))
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
    """Claim an output file likewise, with the files beside it that are named after it.

    Raises:
        OutputError: Another process or thread writes there, or its folder cannot be written.
    """
    _claim(path, is_folder=False)


def _claim(path: Path, *, is_folder: bool) -> None:
    scope, place = _SCOPE.get(), Path(os.path.realpath(path))
    if scope is not None and scope.holds(place):
        return
    check_way(lock_of(path, is_folder=is_folder))
    for above in place.parents:
        owner = _looked_up(lock_of(above, is_folder=True))
        if owner is not None:
            raise OutputError(f"{path} lies in {above}, which {owner.told()}; wait, or choose another place.")
    lock = _Lock(path, lock_of(place, is_folder=is_folder))
    with ExitStack() as ends:
        ends.callback(lock.release)
        lock.take()
        if scope is not None:
            if is_folder:
                ends.enter_context(below(os.path.abspath(path), str(place)))
            scope.ends.push(ends.pop_all())
            scope.places.add(place)


# One lock


@dataclass(frozen=True)
class _Owner:
    """Who holds a lock, as the lock file tells; empty where it tells nothing."""

    said: dict[str, Any]

    def told(self) -> str:
        """Say it in words."""
        pid, host, since, command = (self.said.get(name) for name in ("pid", "host", "since", "command"))
        if not isinstance(since, (int, float)):
            return "is being written by another process"
        is_here = (pid, host) == (os.getpid(), socket.gethostname())
        who = "another call in this process" if is_here else f"process {pid} on {host}"
        age = max(0.0, time.time() - since)
        at = time.strftime("%H:%M:%S" if age < _HALF_A_DAY_S else "%Y-%m-%d %H:%M:%S", time.localtime(since))
        words = " ".join(str(command).split())
        words = words if len(words) <= _LONGEST_COMMAND else f"{words[:_LONGEST_COMMAND]}..."
        return f"is being written by {who} since {at} ({spoken(age)}): {words}"

    def is_gone(self) -> bool:
        """Say whether the process has certainly ended: it ran on this machine, and runs no more."""
        pid = self.said.get("pid")
        if self.said.get("host") != socket.gethostname() or not isinstance(pid, int) or sys.platform == "win32":
            return False
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        except OSError:
            return False
        return bool(self.said.get("born") != _born(pid))  # if not, another process has its number


class _Lock:
    """A lock file: the system's lock on it decides or, on file systems without locks, the owner that it names."""

    def __init__(self, wanted: Path, file: Path) -> None:
        self._wanted, self._file = wanted, file
        self._held: int | None = None
        self._made: list[Path] = []
        self._advice = "wait, or choose another place."

    def take(self) -> None:
        """Take it, and write who holds it.

        Raises:
            OutputError: Another one holds it, or it cannot be written.
        """
        for left in reversed(range(_TRIES)):
            try:
                if self._is_taken():
                    self._sign()
                    return
            except OutputError:
                raise
            except OSError as error:
                raise OutputError(
                    f"Cannot write {self._wanted}: {reason(error)}; make room, or choose another place."
                ) from error
            if left:
                time.sleep(_PAUSE_S)
        raise OutputError(f"{self._wanted} {_read(self._file).told()}; {self._advice}")

    def release(self) -> None:
        """Remove the file and what folders were made for it, unless something is in them, and let others have it."""
        if self._held is not None:
            with suppress(OSError):
                if self._is_there():
                    self._file.unlink()  # before it is free, or it might be another's by then
            self._close()
            if sys.platform == "win32":  # where no open file can be removed
                with suppress(OSError):
                    self._file.unlink()
        for folder in reversed(self._made):
            with suppress(OSError):
                folder.rmdir()
        self._made = []

    def _close(self) -> None:
        if self._held is not None:
            os.close(self._held)
            self._held = None

    def _is_taken(self) -> bool:
        """Try once."""
        self._make_folder()
        is_new = True
        try:
            self._held = os.open(self._file, os.O_RDWR | os.O_CREAT | os.O_EXCL | _NO_LINK, 0o666)
        except FileExistsError:
            is_new = False
            try:
                self._held = os.open(self._file, os.O_RDWR | _NO_LINK)
            except FileNotFoundError:  # its owner has just removed it
                return False
            except OSError as error:
                if self._file.is_symlink():
                    raise self._refused() from error
                raise
            if not _is_plain(self._held):
                self._close()
                raise self._refused() from None
        except FileNotFoundError:  # and here the folder, which was empty
            return False
        is_mine = _system_lock(self._held)
        if is_mine is None:
            is_mine = is_new
            self._advice = f"wait, choose another place, or remove {self._file} if that process runs no more."
            if not is_new and _read(self._file).is_gone():
                self._file.unlink(missing_ok=True)
        if not is_mine or not self._is_there():
            self._close()
        return self._held is not None

    def _refused(self) -> OutputError:
        return OutputError(f"{self._file} is a link or no file, so it is no lock of cornerforge's; remove it.")

    def _make_folder(self) -> None:
        missing = list(itertools.takewhile(lambda folder: not folder.exists(), self._file.parents))
        for folder in reversed(missing):
            with suppress(FileExistsError):
                folder.mkdir()
                self._made.append(folder)

    def _is_there(self) -> bool:
        """Say whether the file that is held is the one that others find: its owner may have removed it meanwhile."""
        assert self._held is not None
        try:
            return os.path.samestat(self._file.lstat(), os.fstat(self._held))
        except FileNotFoundError:
            return False

    def _sign(self) -> None:
        """Write who holds it; on a full disk it is held all the same."""
        assert self._held is not None
        said = {
            "pid": os.getpid(), "host": socket.gethostname(), "user": _user(), "command": command_line(),
            "since": time.time(), "born": _born(os.getpid()),
        }  # fmt: skip
        with suppress(OSError):
            os.ftruncate(self._held, 0)
            os.write(self._held, json.dumps(said).encode() + b"\n")


def _looked_up(file: Path) -> _Owner | None:
    """Say who holds a lock; None: nobody."""
    try:
        looked = os.open(file, os.O_RDONLY | _NO_LINK)
    except OSError:
        return None
    try:
        if not _is_plain(looked):
            return None
        is_free, owner = _system_lock(looked, shared=True), _read(file)
    finally:
        os.close(looked)
    return None if is_free or (is_free is None and owner.is_gone()) else owner


def _is_plain(number: int) -> bool:
    """Say whether an open file is a regular one, and has no other name."""
    found = os.fstat(number)
    return stat.S_ISREG(found.st_mode) and found.st_nlink <= 1  # 0: its owner has just removed it


def _read(file: Path) -> _Owner:
    try:
        number = os.open(file, os.O_RDONLY | _NO_LINK)
        with open(number, "rb") as opened:
            said = json.loads(opened.read(_LONGEST_LOCK)) if _is_plain(number) else None
    except (OSError, ValueError):
        said = None
    return _Owner(said if isinstance(said, dict) else {})


def _system_lock(number: int, *, shared: bool = False) -> bool | None:
    """Lock an open file, up to its closing; False: another one has locked it, None: the file system has no locks."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(number, _FAR, os.SEEK_SET)  # a locked byte cannot be read, so it is none of the text
            msvcrt.locking(number, msvcrt.LK_NBLCK, 1)
            os.lseek(number, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(number, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return None
        if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
            return False
        raise
    return True


def _user() -> str | None:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a number without a name
        return None


def _born(pid: int) -> int | None:
    """Tell when a process began, in the kernel's ticks; None where that cannot be known."""
    try:
        return int(Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return None
