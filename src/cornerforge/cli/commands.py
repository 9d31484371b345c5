"""Commands made of verbs: each option of a verb becomes an option or an argument of its command."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterable
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer
from msgspec import Meta

from cornerforge._options import Command, Options, options_of
from cornerforge._schema import allowed_types, meant, shown_of
from cornerforge.cli.config import read_config
from cornerforge.cli.output import EXIT_GATE, Bars, run_command
from cornerforge.cli.program import command_class, epilog, group_of, panel_of
from cornerforge.errors import printable

__all__ = ["add_command"]


def _completing(words: tuple[str, ...]) -> Callable[[str], list[str]] | None:
    """Make what a shell asks when it completes a value: the words that begin like it; None without words."""

    def complete(incomplete: str) -> list[str]:  # Typer asks for this name
        places = {("av",): "drivers.avs:AVS", ("odd",): "types:ODDS"}
        known: Iterable[str] = _found(places[words]) if words in places else words
        return [name for name in known if name.startswith(incomplete)]

    return complete if words else None


class _General(Options):
    """Options that commands have besides those of their verbs."""

    config: Annotated[
        Path | None,
        meant(
            "TOML file with these options by their long names (lanes = 4). An option on the command line wins, also "
            "--no-NAME for a flag NAME = true. Paths in the file, and a module of its av, are looked for from its "
            "folder.",
            metavar="FILE",
        ),
    ] = None
    engine: Annotated[
        str,
        meant(
            "Where it is computed: threads of this machine, or ray, a cluster. Does not change results.",
            near=("threads", "ray"),
        ),
    ] = "threads"
    address: Annotated[str | None, meant("Of a Ray cluster, HOST:PORT or auto; without it one is started here.")] = None
    out: Annotated[Path | None, meant("New file for the object that --json prints.")] = None
    quiet: Annotated[bool, meant("No text and no progress bars.")] = False
    as_json: Annotated[bool, meant("Print exactly one JSON object on standard output.", name="--json")] = False
    debug: Annotated[bool, meant("Show the traceback of an error.")] = False


def _type_of(hint: Any) -> Any:
    """Choose the type that the command line reads: the first one named.

    >>> from collections.abc import Sequence
    >>> _type_of(Sequence[Path | str] | None), _type_of(str | int)
    (list[pathlib.Path], <class 'str'>)
    """
    first = next(kind for kind in allowed_types(hint) if kind is not type(None))
    return first if get_origin(first) is None else list[allowed_types(get_args(first)[0])[0]]  # type: ignore[misc]


def _parameter(one: Field[Any], hint: Any, said: Meta) -> inspect.Parameter:
    """Make an option a parameter that Typer makes an option or an argument of."""
    kind, option = _type_of(hint), shown_of(said)
    is_list, required = get_origin(kind) is list, one.default is MISSING
    default = inspect.Parameter.empty if required else None if is_list else one.default
    shown_default: Any = option.get("default") or not (required or default is None)
    metavar, names = option.get("metavar"), [option.get("name", f"--{one.name.replace('_', '-')}")]
    names += [option["also"]] if "also" in option else []
    text = said.description or ""
    if said.ge is not None and said.le is not None and said.le < 1e9:
        text = f"{text.rstrip('.')}; {said.ge:g} to {said.le:g}."
    if not one.kw_only:
        shown = typer.Argument(metavar=metavar, help=text, show_default=shown_default)
    elif kind is bool:
        shown = typer.Option(names[0], help=text, metavar="")  # help would else show a value for it
    else:
        first = one.name == "config"
        shown = typer.Option(
            *names, metavar=metavar, help=text, show_default=shown_default,
            autocompletion=_completing(option.get("choices") or option.get("near", ())),
            is_eager=first, callback=read_config if first else None,
        )  # fmt: skip
    annotated: Any = Annotated  # made here, not written down, so mypy must not read it as a type
    annotation = annotated[kind if required or not (is_list or default is None) else kind | None, shown]
    return inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _found(place: str) -> Any:
    """Give what "module:name" names, below cornerforge."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(f"cornerforge.{module}"), name)


def add_command(told: Command) -> None:
    """Make a command of what is told of it."""
    shown = [option for option in options_of(told.options) if not shown_of(option[2]).get("hidden")]
    own = {option[0].name: _parameter(*option) for option in shown}
    leave = {*own} if told.spreads else {*own, "engine", "address"}
    general = [_parameter(*option) for option in options_of(_General) if option[0].name not in leave]
    watched = any(one.name == "progress" for one in fields(told.options))

    def command(**given: Any) -> None:
        wanted = {name: given[name] for name in own if given[name] is not None and given[name] != []}

        def work(bars: Bars, tell: Callable[[Any], None]) -> Any:
            more = {"progress": bars} if watched else {"up": tell} if told.early else {}
            return _found(told.verb)(**wanted, **more)

        result = run_command(
            work, lambda result: _found(told.says)(result), as_json=given["as_json"], quiet=given["quiet"],
            out=None if "out" in own else given["out"], stages=told.stages, early=told.early,
            at=(given.get("engine", "threads"), given.get("address"), given.get("threads")),
        )  # fmt: skip
        failure = _found(told.fails)(result) if told.fails else None
        if failure is not None:
            if failure:
                typer.echo(printable(failure), err=True)
            raise typer.Exit(EXIT_GATE)

    parameters = [*own.values(), *general]
    name = told.verb.partition(":")[2]
    command.__name__, command.__doc__ = name, inspect.cleandoc(told.options.__doc__ or "")
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in parameters}  # Typer reads both
    many = tuple(shown_of(said).get("name", f"--{one.name}") for one, _, said in shown if "many" in shown_of(said))
    group, _, word = (told.name or name.replace("_", "-")).rpartition(" ")
    panel = None if group else panel_of(word)
    group_of(group).command(word, cls=command_class(many), epilog=epilog(told.examples), rich_help_panel=panel)(command)
