"""The command line: parse arguments, call `pipeline`, print. Nothing is computed here, nothing heavy imported early."""

from __future__ import annotations

import sys
import traceback
import warnings
from typing import Any

import typer

# `--help` lists commands in the order in which these modules register them.
from cornerforge.cli import whole, driving, learning, cases, naturalistic  # isort: skip
from cornerforge.cli.program import app
from cornerforge.errors import CornerForgeError

__all__ = ["app", "main"]

EXIT_BAD_INPUT, EXIT_INTERRUPTED = 2, 130
_COMMANDS = (whole, driving, learning, cases, naturalistic)


def _usage_message(error: Any) -> str:
    """Typer's message (it suggests the nearest command) in one line, with where help is."""
    path = error.ctx.command_path if error.ctx is not None else "cornerforge"
    # Typer has no message, only the help, for a call without a command.
    message = " ".join(error.format_message().split()) or "A command is missing."
    return f"{message} (see: {path} --help)"


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    typer.echo(f"Warning: {message}", err=True)


def _complain(message: object, *, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    typer.echo(f"cornerforge: {message}", err=True)
    return EXIT_BAD_INPUT


def _goes_on(given: list[str]) -> bool:
    """Whether the command that was called has --resume: only such ones keep anything before they end."""
    command: Any = typer.main.get_command(app)
    for word in given:
        command = getattr(command, "commands", {}).get(word, command)
    return any(parameter.name == "resume" for parameter in command.params)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status (see the interface: 0, 1, 2 or 130)."""
    given = sys.argv[1:] if arguments is None else arguments
    debug = "--debug" in given
    usage_error: type[Exception] = typer.BadParameter.__mro__[1]  # Typer offers its base class under no name
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            status = app(args=given, prog_name="cornerforge", standalone_mode=False)
        except CornerForgeError as error:
            return _complain(error, debug=debug)
        except usage_error as error:
            return _complain(_usage_message(error), debug=debug)
        except OSError as error:  # a full disk, a file without permission: the text names the file
            return _complain(error, debug=debug)
        except (KeyboardInterrupt, typer.Abort):
            status = EXIT_INTERRUPTED
    if status == EXIT_INTERRUPTED:  # this is also how Typer reports Ctrl-C
        kept = "; what was finished is kept" if _goes_on(given) else ""
        typer.echo(f"cornerforge: interrupted{kept}.", err=True)
    return status if isinstance(status, int) else 0
