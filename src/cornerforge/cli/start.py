"""A command line: parse arguments, call a verb, print. Nothing is computed here, nothing heavy imported early."""

from __future__ import annotations

import errno
import traceback
import warnings
from collections.abc import Callable
from typing import Any

import typer

from cornerforge._files import reason
from cornerforge._words import shown
from cornerforge.cli import EXIT_INTERRUPTED
from cornerforge.cli.commands import add_command
from cornerforge.cli.config import Call, a_call
from cornerforge.cli.program import app
from cornerforge.errors import CornerForgeError, InputError, one_line
from cornerforge.ext import commands
from cornerforge.verbs.options import COMMANDS

__all__ = ["app", "run"]

EXIT_BAD_INPUT = 2
_KEEP_WITH_OUT = ("simulate", "rate")
"""Commands with --resume that keep something only with --out; the other commands with --resume always do."""


for _told in (*COMMANDS, *commands()):
    add_command(_told)


def _usage_message(error: Any) -> str:
    """Return Typer's message (it suggests the nearest command) in one line, and say how to get help."""
    path = error.ctx.command_path if error.ctx is not None else "cornerforge"
    return f"{' '.join(error.format_message().split())} (see: {path} --help)"


def _showing_once() -> Callable[..., None]:
    """Make a display of warnings that shows no text twice: a command of many stages asks for the same world often."""
    told = set[str]()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        text = one_line(str(message))
        if text not in told:
            told.add(text)
            typer.echo(f"Warning: {text}", err=True)

    return show


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


def run(given: list[str]) -> int:
    """Run a command line, and return its exit status: 0, 1, 2 or 130.

    Raises:
        BrokenPipeError: The reader of the output has gone.
    """
    with a_call() as call:
        return _run(given, call)


def _run(given: list[str], call: Call) -> int:
    def debug() -> bool:
        return "--debug" in given or call.says("debug")

    usage_error: type[Exception] = typer.BadParameter.__mro__[1]  # Typer offers its base class under no name
    with warnings.catch_warnings():
        warnings.showwarning = _showing_once()
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
            do = "make room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "remove it"
            return _complain(f"{named}{reason(error)}; {do}, or choose another place.", debug=debug())
        except typer.Abort as abort:
            if isinstance(abort.__cause__, EOFError):  # a file that ended early, not a person at the keyboard
                raise abort.__cause__ from None
            status = EXIT_INTERRUPTED
        except KeyboardInterrupt:
            status = EXIT_INTERRUPTED
    if status == EXIT_INTERRUPTED:  # this is also how Typer reports Ctrl-C
        kept = "; what was finished is kept: the same command with --resume goes on" if _goes_on(given, call) else ""
        typer.echo(f"cornerforge: interrupted{kept}.", err=True)
    return status if isinstance(status, int) else 0
