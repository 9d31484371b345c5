"""The program that commands register with."""

from __future__ import annotations

from typing import Annotated

import typer

from cornerforge import __version__

__all__ = ["app", "ndd"]

app = typer.Typer(
    name="cornerforge",
    help="How an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
ndd = typer.Typer(no_args_is_help=True, help="The naturalistic driving model.")
app.add_typer(ndd, name="ndd")


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cornerforge {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version and exit.", metavar="", is_eager=True, callback=_say_version),
    ] = False,
) -> None:
    pass
