"""Files that are whole or absent: they are written under another name in the same folder, then renamed.

Renaming is atomic for every process of the machine, so a kill leaves the old file or the new one. Nothing is fsynced:
a kill of the process does not lose what the operating system has taken, and files that must survive a loss of power
have checksums.

A folder may come from a stranger, with links in it: a part is made new, under a name that cannot be foreseen, and a
link in the file's own place is replaced, not followed.
"""

from __future__ import annotations

import errno
import functools
import os
import re
import secrets
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from cornerforge.errors import OutputError

__all__ = [
    "LARGEST",
    "LOOK",
    "PART",
    "append",
    "below",
    "check_regular",
    "check_way",
    "is_part_of",
    "read_bytes",
    "real_path",
    "reason",
    "remove_parts",
    "write_bytes",
    "writing",
]


PART = ".part"
"""How the name of a file ends that is being written, or that a killed process left."""
_ROOTS: ContextVar[frozenset[str]] = ContextVar("roots", default=frozenset())
_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
LOOK = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""How a file is opened to look at it: a link is not followed, and a pipe not waited for."""


def is_part_of(name: str, path: Path) -> bool:
    """Say whether a file of this name was begun to become `path`.

    >>> is_part_of(".summary.json.0f3c52b1.part", Path("out/summary.json"))
    True
    """
    return re.fullmatch(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\{PART}", name) is not None


def remove_parts(path: Path) -> None:
    """Remove what killed processes have begun to write of a file; parts of living processes and links stay."""
    _remove_dead(path, _parts_in(str(path.parent)))


@functools.lru_cache(maxsize=64)
def _parts_before(folder: str) -> list[str]:
    """List the parts in a folder when this process first wrote there: a folder of many files is not listed for each."""
    return _parts_in(folder)


def _parts_in(folder: str) -> list[str]:
    with suppress(FileNotFoundError):
        return [name for name in os.listdir(folder) if name.endswith(PART)]
    return []


def _remove_dead(path: Path, parts: list[str]) -> None:
    """Remove the parts that were to become `path` and that no process holds."""
    for name in parts:
        if is_part_of(name, path):
            with suppress(OSError):
                held = os.open(path.with_name(name), LOOK)
                try:
                    if stat.S_ISREG(os.fstat(held).st_mode) and _is_held(held):
                        path.with_name(name).unlink(missing_ok=True)
                finally:
                    os.close(held)


@contextmanager
def below(*roots: str) -> Iterator[None]:
    """Refuse, within, to write through links below these folders: the folder's author may have made them."""
    token = _ROOTS.set(_ROOTS.get().union(roots))
    try:
        yield
    finally:
        _ROOTS.reset(token)


def check_way(path: Path) -> None:
    """Check that no folder between an output folder and a file in it is a link.

    Raises:
        OutputError: One is.
    """
    parents = [Path(os.path.abspath(path)).parent]
    parents += parents[0].parents
    for root in _ROOTS.get():
        if Path(root) in parents:
            for folder in parents[: parents.index(Path(root))]:
                if folder.is_symlink():
                    raise OutputError(
                        f"Cannot write {path}: {folder} is a link, and within an output folder none is followed; "
                        "remove it, or name the folder that it leads to."
                    )


def _is_held(number: int) -> bool | None:
    """Lock an open part up to its closing; False: its process lives and has it. None: the file system has no locks."""
    try:
        import fcntl

        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:
        return None
    except OSError as error:
        return False if error.errno in (errno.EACCES, errno.EAGAIN) else None
    return True


def _new_part(path: Path) -> tuple[Path, int]:
    """Make a new file beside `path`, of a name that cannot be foreseen, and hold it."""
    while True:
        part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART}")
        with suppress(FileExistsError):
            held = os.open(part, _NEW, 0o666)
            if _is_held(held) is None:
                return part, held
            with suppress(FileNotFoundError):
                if os.path.samestat(part.lstat(), os.fstat(held)):
                    return part, held
            os.close(held)  # another process took it for a dead one's, before it was held


def reason(error: OSError) -> str:
    """Say why a file operation failed; errors of other libraries say it in their text only."""
    return error.strerror or str(error)


LARGEST = 1 << 31
"""Most bytes of a file that is read as a whole; none that cornerforge writes is as large."""


def real_path(path: Path) -> Path:
    """Resolve links and `..` as far as it goes; `Path.resolve` raises where links lead in a circle."""
    return Path(os.path.realpath(path))


def check_regular(path: Path) -> None:
    """Check that a path is a file with an end: reading a pipe waits for ever, and a device may never end.

    A file with holes may be larger than any memory, so there is a largest size too.

    Raises:
        OSError: It is not, is larger than `LARGEST`, or is not there.
    """
    found = path.stat()
    mode = found.st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    if found.st_size > LARGEST:
        raise OSError(errno.EFBIG, f"is larger than {LARGEST >> 20} MB", str(path))


def read_bytes(path: Path) -> bytes:
    """Read a regular file.

    Raises:
        OSError: It is not a regular file (`check_regular`), or cannot be read.
    """
    check_regular(path)
    return path.read_bytes()


@contextmanager
def writing(path: Path, what: str = "") -> Iterator[Path]:
    """Write a file whole or not at all: yield the name to write to, in the same folder, and rename it at the end.

    Args:
        path: Where the file shall be; its folder is made.
        what: What it is, for messages, for example "the policy".

    Raises:
        OutputError: The file cannot be written; nothing is left of it then.
    """
    part, held = None, None
    try:
        check_way(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        part, held = _new_part(path)
        yield part
        if sys.platform == "win32":  # where no open file can be renamed
            os.close(held)
            held = None
        os.replace(part, path)
        _remove_dead(path, _parts_before(str(path.parent)))
    except BaseException as error:
        if part is not None:
            with suppress(OSError):
                part.unlink()
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            named = f"{what} {path}" if what else str(path)
            raise OutputError(f"Cannot write {named}: {reason(error)}; make room, or choose another place.") from error
        raise
    finally:
        if held is not None:
            os.close(held)


def write_bytes(path: Path, content: bytes | memoryview, what: str = "") -> None:
    """Write a file of given content whole or not at all; as `writing`.

    Raises:
        OutputError: The file cannot be written; nothing is left of it then.
    """
    with writing(path, what) as part:
        part.write_bytes(content)


def append(path: Path, content: bytes) -> None:
    """Write at the end of a regular file, which is made if it is not there.

    Raises:
        OSError: It cannot be written, is no regular file, or has other names too (links).
    """
    check_way(path)
    number = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | LOOK, 0o666)
    with open(number, "ab") as file:
        found = os.fstat(number)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
            raise OSError(errno.EINVAL, "is a link, or no regular file", str(path))
        file.write(content)
