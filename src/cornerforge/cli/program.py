"""The program that commands register with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer
import typer.core

from cornerforge import __version__

__all__ = ["app", "cases", "command", "ndd", "suite"]

F = TypeVar("F", bound=Callable[..., None])


def _flags_without_value(options: list[Any]) -> list[Any]:
    """Let help show no value for options that take none, those too that Typer adds."""
    for option in options:
        if getattr(option, "is_flag", False):
            option.metavar = ""
    return options


class _Command(typer.core.TyperCommand):
    def get_params(self, ctx: Any) -> Any:
        return _flags_without_value(super().get_params(ctx))

    def make_parser(self, ctx: Any) -> Any:
        """Take `--no-NAME` too for each flag that a config file could set; help of --config says so."""
        parser = super().make_parser(ctx)
        if any(one.name == "config" for one in self.params):
            flags: list[Any] = [one for one in self.params if getattr(one, "is_flag", False)]
            for one in flags:
                opposite = f"--no-{one.opts[0].removeprefix('--')}"
                parser.add_option(obj=one, opts=[opposite], dest=one.name, action="store_const", const=False)
        return parser


class _Group(typer.core.TyperGroup):
    def get_params(self, ctx: Any) -> Any:
        return _flags_without_value(super().get_params(ctx))


def _epilog(examples: tuple[str, ...]) -> str:
    """Write the end of a help page: a line for each example."""
    return "\n".join(["Example:" if len(examples) == 1 else "Examples:", *examples])


app = typer.Typer(
    name="cornerforge",
    help="How an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.",
    epilog=_epilog(("cornerforge run --effort quick --out out/demo", "cornerforge init my-av")),
    cls=_Group,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
ndd = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    help="The naturalistic driving model.",
    epilog=_epilog(("cornerforge ndd show",)),
)
app.add_typer(ndd, name="ndd")
suite = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    help="Small sets of cases to test every version of an AV with.",
    epilog=_epilog(("cornerforge suite build out/demo/library --out out/suite",)),
)
app.add_typer(suite, name="suite")
cases = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    help="Cases made of recorded traffic.",
    epilog=_epilog(("cornerforge cases from-data trajectories.csv --out out/moments",)),
)
app.add_typer(cases, name="cases")


def command(*examples: str, name: str | None = None, of: typer.Typer = app) -> Callable[[F], F]:
    """Make a function a command of the program.

    Args:
        examples: One or two command lines that run as written, shown at the end of its help. They may use what
            `cornerforge run --effort quick --out out/demo` and `cornerforge init my-av` leave.
        name: Its name; the function's by default.
        of: The group that it belongs to.
    """
    return of.command(name, cls=_Command, epilog=_epilog(examples))


def _say_version(context: typer.Context, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
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
