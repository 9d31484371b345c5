"""The command line: parse arguments, call `pipeline`, print. Nothing is computed here, nothing heavy imported early."""

from __future__ import annotations

import io
import os
import sys
import traceback
import warnings
from contextlib import suppress
from typing import Any

import typer

# `--help` lists commands in the order in which these modules register them.
from cornerforge.cli import whole, driving, learning, cases, exchange, naturalistic  # isort: skip
from cornerforge._files import reason
from cornerforge._words import shown
from cornerforge.cli.config import Call, a_call
from cornerforge.cli.program import app
from cornerforge.errors import CornerForgeError, InputError, one_line

__all__ = ["app", "main"]

EXIT_BAD_INPUT, EXIT_INTERRUPTED, EXIT_PIPE = 2, 130, 141
"""Exit statuses. EXIT_PIPE: the reader of our output has gone; 128 + SIGPIPE, as a shell reports it."""
_COMMANDS = (whole, driving, learning, cases, exchange, naturalistic)
_KEEP_WITH_OUT = ("simulate", "rate")
"""Commands with --resume that keep something only with --out; the other commands with --resume always do."""


def _usage_message(error: Any) -> str:
    """Return Typer's message (it suggests the nearest command) in one line, and say how to get help."""
    path = error.ctx.command_path if error.ctx is not None else "cornerforge"
    return f"{' '.join(error.format_message().split())} (see: {path} --help)"


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    typer.echo(f"Warning: {one_line(str(message))}", err=True)


def _complain(message: object, *, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    typer.echo(f"cornerforge: {one_line(str(message))}", err=True)
    return EXIT_BAD_INPUT


def _goes_on(given: list[str], call: Call) -> bool:
    """Tell whether the call, when interrupted, can be resumed: only commands with --resume can."""
    command: Any = typer.main.get_command(app)
    for word in given:
        command = getattr(command, "commands", {}).get(word, command)
    if not any(parameter.name == "resume" for parameter in command.params):
        return False
    has_out = call.says("out") or any(word.partition("=")[0] == "--out" for word in given)
    return command.name not in _KEEP_WITH_OUT or has_out


def _check_words(given: list[str]) -> None:
    """Refuse words that are not UTF-8: a file name of this kind could be neither printed nor stored.

    Raises:
        InputError: A word is not UTF-8.
    """
    for word in given:
        try:
            word.encode()
        except UnicodeEncodeError as error:
            raise InputError(f"{word!a} is no UTF-8; rename the file, or choose another name.") from error


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
        with a_call() as call:
            status = _run(given, call)
        sys.stdout.flush()
    except BrokenPipeError:
        return _stop_printing()
    except SystemExit as left:  # Typer leaves with this when the reader has gone
        if not isinstance(left.__context__, BrokenPipeError):
            raise
        sys.stdout, sys.stderr = streams
        return _stop_printing()
    return status


def _run(given: list[str], call: Call) -> int:
    def debug() -> bool:
        return "--debug" in given or call.says("debug")

    usage_error: type[Exception] = typer.BadParameter.__mro__[1]  # Typer offers its base class under no name
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            _check_words(given)
            status = app(args=given, prog_name="cornerforge", standalone_mode=False)
        except CornerForgeError as error:
            return _complain(call.placed(str(error)), debug=debug())
        except usage_error as error:
            if type(error).__name__ == "NoArgsIsHelpError":  # Typer has printed the help
                return EXIT_BAD_INPUT
            return _complain(_usage_message(error), debug=debug())
        except BrokenPipeError:
            raise
        except OSError as error:  # what no reader or writer has put into words of its own
            named = "" if error.filename is None else f"{shown(str(error.filename))}: "
            return _complain(f"{named}{reason(error)}; remove it, or choose another place.", debug=debug())
        except typer.Abort as abort:
            if isinstance(abort.__cause__, EOFError):  # a file that ended early, not a person at the keyboard
                raise abort.__cause__ from None
            status = EXIT_INTERRUPTED
        except KeyboardInterrupt:
            status = EXIT_INTERRUPTED
    if status == EXIT_INTERRUPTED:  # this is also how Typer reports Ctrl-C
        kept = "; what was finished is kept" if _goes_on(given, call) else ""
        typer.echo(f"cornerforge: interrupted{kept}.", err=True)
    return status if isinstance(status, int) else 0
