"""The program that commands register with."""

from __future__ import annotations

from collections.abc import Container
from itertools import chain
from typing import Annotated, Any

import typer
import typer.core

from cornerforge import __version__
from cornerforge._words import shown
from cornerforge.cli.retired import retired_among
from cornerforge.errors import InputError

__all__ = ["app", "command_class", "epilog", "group_of", "panel_of"]


def _flags_without_value(options: list[Any]) -> list[Any]:
    """Let help show no value for options that take none, those too that Typer adds."""
    for option in options:
        if getattr(option, "is_flag", False):
            option.metavar = ""
    return options


_IDLE = {"seed": (0, 2**63 - 1), "threads": (1, 1024)}
"""Options that every command takes, with their ranges, so that scripts need not know which commands draw or compute."""


def _without_idle(words: list[str], known: Container[str]) -> list[str]:
    """Take `--seed N` and `--threads N` out of the words for a command that does not know them: they have no effect.

    Raises:
        InputError: What stands there is no number in its range.
    """
    left = list(words)
    for name, (low, high) in _IDLE.items():
        for word in [] if name in known else words:
            option, equals, value = word.partition("=")
            if option == f"--{name}":
                from cornerforge._checks import check_integer

                place = left.index(word)
                told = value if equals else next(iter(left[place + 1 : place + 2]), "")
                if not told.removeprefix("-").isdecimal():
                    raise InputError(f"{name} = {shown(told)} is not a whole number; allowed: from {low} to {high}.")
                check_integer(name, int(told), low=low, high=high)
                del left[place : place + (1 if equals else 2)]
    return left


def _with_each(words: list[str], option: str) -> list[str]:
    """Write an option before each of the words that belong to it.

    >>> _with_each(["--figure", "a", "b", "--seed", "1"], "--figure")
    ['--figure', 'a', '--figure', 'b', '--seed', '1']
    """
    found: list[str] = []
    belongs = False
    for place, word in enumerate(words):
        if word.startswith("-"):
            belongs = word == option
        elif belongs and words[place - 1] != option:
            found.append(option)
        found.append(word)
    return found


class _Command(typer.core.TyperCommand):
    many: tuple[str, ...] = ()
    """Options to which all words belong that follow, up to the next option."""

    def get_params(self, ctx: Any) -> Any:
        return _flags_without_value(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not ctx.resilient_parsing:
            told = retired_among(args)
            if told is not None:
                raise InputError(told)
            args = _without_idle(args, {one.name for one in self.params})
            for option in self.many:
                args = _with_each(args, option)
        return super().parse_args(ctx, args)

    def make_parser(self, ctx: Any) -> Any:
        """Take `--no-NAME` too for each flag that a config file could set; help of --config says so."""
        parser = super().make_parser(ctx)
        if any(one.name == "config" for one in self.params):
            flags: list[Any] = [one for one in self.params if getattr(one, "is_flag", False)]
            for one in flags:
                opposite = f"--no-{one.opts[0].removeprefix('--')}"
                parser.add_option(obj=one, opts=[opposite], dest=one.name, action="store_const", const=False)
        return parser


_PANELS = {
    "Start": ("run", "simulate", "train", "rate", "analyse", "retest"),
    "Your own AV": ("init", "check-av", "avs", "train-av", "r157", "suite"),
    "Cases": (
        "generate", "report", "serve", "replay", "query", "shrink", "figure", "export", "import", "cases", "verify",
        "migrate",
    ),
    "Data and studies": ("ndd", "road", "site", "variety", "plausibility", "reproduce"),
}  # fmt: skip
"""Commands on the first page, in its order."""


class _Group(typer.core.TyperGroup):
    def get_params(self, ctx: Any) -> Any:
        return _flags_without_value(super().get_params(ctx))


class _Program(_Group):
    def list_commands(self, ctx: Any) -> list[str]:
        """List the commands in the order of the first page."""
        return sorted(super().list_commands(ctx), key=[*chain(*_PANELS.values())].index)


def panel_of(name: str) -> str | None:
    """Name the panel of the first page on which a command stands; None for commands of a group."""
    return next((panel for panel, names in _PANELS.items() if name in names), None)


def epilog(examples: tuple[str, ...]) -> str:
    """Write the end of a help page: a line for each example."""
    return "\n".join(["Example:" if len(examples) == 1 else "Examples:", *examples])


app = typer.Typer(
    name="cornerforge",
    help="How an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.",
    epilog=epilog(("cornerforge run --effort quick --out out/demo", "cornerforge init my-av")),
    cls=_Program,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_GROUPS = {"": app}
for _name, _help, _example in (
    ("ndd", "The naturalistic driving model.", "ndd show"),
    (
        "suite", "Tests for every version of an AV: few cases of many, or a regulation's scenarios.",
        "suite run aeb --av idm-mobil --out out/aeb",
    ),
    ("road", "Roads: curves, ramps, exits, lane drops, and roads from files.", "road show on-ramp"),
    ("site", "Junctions from files: routes, right of way, signals, crosswalks.", "site show mcity-signal"),
    ("cases", "Cases made of recorded traffic.", "cases from-data trajectories.csv --out out/moments"),
):  # fmt: skip
    _GROUPS[_name] = typer.Typer(
        cls=_Group, no_args_is_help=True, help=_help, epilog=epilog((f"cornerforge {_example}",))
    )
    app.add_typer(_GROUPS[_name], name=_name, rich_help_panel=panel_of(_name))


def command_class(many: tuple[str, ...]) -> type[_Command]:
    """Give the class of a command some of whose options take all words that follow."""
    return type("_ManyWords", (_Command,), {"many": many}) if many else _Command


def group_of(name: str) -> typer.Typer:
    """Give the program that holds the commands of a group; "" for the program itself."""
    return _GROUPS[name]


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
