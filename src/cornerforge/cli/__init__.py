"""The command line. Its first page and the version come without Typer, all else from `start`."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from cornerforge._doors import door
from cornerforge.cli.front import front_page

if TYPE_CHECKING:
    from cornerforge.cli.start import app

__all__ = ["app", "main"]

__getattr__ = door("cornerforge.cli", {"app": "start"})

EXIT_INTERRUPTED = 130
EXIT_PIPE = 141
"""Exit status when the reader of our output has gone: 128 + SIGPIPE, as a shell reports it."""


def _open_closed_streams() -> None:
    """Open each closed standard stream (`2>&-`) to the null device.

    Otherwise the next file opened would take the number of a closed stream and receive its output.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "r" if number == 0 else "w", encoding="utf-8", closefd=False))  # noqa: SIM115


def _stop_printing() -> int:
    """Send both streams to the null device after the reader has gone, so that the end of the program is silent too."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, io.UnsupportedOperation):
            stream.flush()
            continue
        with suppress(OSError, io.UnsupportedOperation):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return EXIT_PIPE


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status: 0, 1, 2, 130; 141 when the reader of the output has gone."""
    _open_closed_streams()
    given = sys.argv[1:] if arguments is None else arguments
    streams = sys.stdout, sys.stderr
    try:
        status = _status(given)
        sys.stdout.flush()
    except BrokenPipeError:
        return _stop_printing()
    except SystemExit as left:  # Typer leaves with this when the reader has gone
        if not isinstance(left.__context__, BrokenPipeError):
            raise
        sys.stdout, sys.stderr = streams
        return _stop_printing()
    return status


@contextmanager
def _loading() -> Iterator[None]:
    """Let Ctrl-C end the process at once: amid an import its exception may be lost, or end in others' tracebacks."""

    def leave(*_: object) -> None:
        os.write(2, b"cornerforge: interrupted.\n")
        os._exit(EXIT_INTERRUPTED)

    alone = threading.current_thread() is threading.main_thread()
    if (
        not alone or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):  # nothing to stop, or told not to
        yield
        return
    signal.signal(signal.SIGINT, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _status(given: list[str]) -> int:
    page = front_page(given)
    if page is None:
        with _loading():
            from cornerforge.cli.start import run

        return run(given)
    sys.stdout.write(page)
    return 0
