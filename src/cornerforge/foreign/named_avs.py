"""Record of the AVs from outside that this user has named, and where: a library cannot start another one.

A library says which AV made it, and an AV from outside is code. Who sends a library could write any command there. So
an AV is started for a library only if the user has named it before, in the same folder: on a command line, in a config
or in Python. The names are kept in a file of the user, as a browser keeps the hosts that it knows.
"""

from __future__ import annotations

import contextlib
import json
import os
import shlex
from collections.abc import Iterator
from pathlib import Path

from cornerforge._files import writing
from cornerforge.errors import InputError, OutputError
from cornerforge.foreign.spec import AvSpec

__all__ = ["check_named", "remember"]

_HERE: set[str] = set()
"""What was named in this process: for users without a home, and homes that cannot be written."""


def _file() -> Path | None:
    """Name the file of names; None for a user without a home."""
    with contextlib.suppress(RuntimeError):
        state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
        return Path(state) / "cornerforge" / "named-avs"
    return None


def _line(spec: str) -> str:
    return json.dumps([os.getcwd(), spec])


def _known() -> Iterator[str]:
    yield from _HERE
    file = _file()
    if file is not None:
        with contextlib.suppress(OSError, UnicodeDecodeError):
            yield from file.read_text(encoding="utf-8").splitlines()


def remember(spec: str) -> None:
    """Keep that the user has named an AV from outside in this folder."""
    line = _line(spec)
    if line in _known():
        return
    _HERE.add(line)
    file = _file()
    if file is not None:
        lines = dict.fromkeys([*_known(), line])
        with contextlib.suppress(OutputError), writing(file) as part:
            part.write_text("".join(f"{one}\n" for one in lines), encoding="utf-8")


def check_named(spec: str, library: Path) -> None:
    """Check that the user has named an AV before a library lets it start, unless it is built in.

    Raises:
        InputError: It is from outside and was not named in this folder.
    """
    if AvSpec(spec).is_outside and _line(spec) not in _known():
        raise InputError(
            f"{library} was made by an AV from outside, {spec!r}, which you have not named in this folder, so it is "
            f"not started. If you trust it: cornerforge check-av {shlex.quote(spec)}, then again."
        )
