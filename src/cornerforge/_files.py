"""Files that are whole or absent: written under another name beside their place, then renamed.

Renaming is atomic for every process of the machine, so a kill leaves the old file or the new one. Nothing is fsynced: a
kill of the process does not lose what the kernel has taken, and what must survive a loss of power has checksums.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cornerforge.errors import OutputError

__all__ = ["part_of", "reason", "writing"]


def part_of(path: Path) -> Path:
    """The name under which a file is written; what a kill leaves of it is overwritten by the next try.

    >>> part_of(Path("out/summary.json")).name
    '.summary.json.part'
    """
    return path.with_name(f".{path.name}.part")


def reason(error: OSError) -> str:
    """Why a file operation failed; errors of other libraries carry it in their text only."""
    return error.strerror or str(error)


@contextmanager
def writing(path: Path, what: str = "") -> Iterator[Path]:
    """Write a file whole or not at all: gives the name to write to, beside its place, and renames it at the end.

    Args:
        path: Where the file shall be; its folder is made.
        what: What it is, for messages, such as "the policy".

    Raises:
        OutputError: It cannot be written; nothing is left of it then.
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
