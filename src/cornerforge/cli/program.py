"""The program that commands register with."""

from __future__ import annotations

import typer

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
