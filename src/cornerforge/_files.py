"""Files that are whole or absent: they are written under another name in the same folder, then renamed.

Renaming is atomic for every process of the machine, so a kill leaves the old file or the new one. Nothing is fsynced:
a kill of the process does not lose what the operating system has taken, and files that must survive a loss of power
have checksums.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cornerforge.errors import OutputError

__all__ = ["LARGEST", "check_regular", "part_of", "read_bytes", "real_path", "reason", "write_bytes", "writing"]


def part_of(path: Path) -> Path:
    """Make the name under which a file is written; a part that a kill left behind is overwritten by the next try.

    >>> part_of(Path("out/summary.json")).name
    '.summary.json.part'
    """
    return path.with_name(f".{path.name}.part")


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
        OSError: It is none (`check_regular`), or cannot be read.
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
    part = part_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        os.replace(part, path)
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            named = f"{what} {path}" if what else str(path)
            raise OutputError(f"Cannot write {named}: {reason(error)}; make room, or choose another place.") from error
        raise


def write_bytes(path: Path, content: bytes | memoryview, what: str = "") -> None:
    """Write a file of given content whole or not at all; as `writing`.

    Raises:
        OutputError: The file cannot be written; nothing is left of it then.
    """
    with writing(path, what) as part:
        part.write_bytes(content)
