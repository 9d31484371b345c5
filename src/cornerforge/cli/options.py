"""Options that several commands share: the same name, type and help everywhere."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import Field, fields
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

from cornerforge.cli.config import read_config
from cornerforge.world_options import REWARD_NAMES, WorldOptions

__all__ = [
    "Acting", "Address", "Config", "DataFormat", "Debug", "Engine", "Json", "JsonFile",
    "Library", "Quiet", "Resume", "Reward", "Seed", "Threads", "World", "completing", "flag", "takes_world",
]  # fmt: skip


def flag(name: str, text: str) -> Any:
    """An option without a value; help would else show one for it."""
    return typer.Option(name, help=text, metavar="")


def completing(*names: str) -> Callable[[str], list[str]]:
    """Make what a shell asks when it completes the value of an option: the names that begin like it."""

    def complete(incomplete: str) -> list[str]:  # Typer asks for this name
        return [name for name in names if name.startswith(incomplete)]

    return complete


def complete_av(incomplete: str) -> list[str]:
    """Complete the name of a built-in AV."""
    from cornerforge.drivers.avs import AVS

    return completing(*AVS)(incomplete)


def complete_odd(incomplete: str) -> list[str]:
    """Complete the name of an ODD."""
    from cornerforge.types import ODDS

    return completing(*ODDS)(incomplete)


Seed = Annotated[int, typer.Option(help="Names the random numbers; same seed, same results.")]
Threads = Annotated[
    int | None, typer.Option(help="Threads; all cores by default. Does not change results.", show_default=False)
]
Engine = Annotated[
    str,
    typer.Option(
        help="Where it is computed: threads of this machine, or ray, a cluster. Does not change results.",
        autocompletion=completing("threads", "ray"),
    ),
]
Address = Annotated[
    str | None,
    typer.Option(help="Of a Ray cluster, HOST:PORT or auto; without it one is started here.", show_default=False),
]
Quiet = Annotated[bool, flag("--quiet", "No text and no progress bars.")]
Json = Annotated[bool, flag("--json", "Print exactly one JSON object on standard output.")]
Debug = Annotated[bool, flag("--debug", "Show the traceback of an error.")]
JsonFile = Annotated[
    Path | None, typer.Option("--out", help="New file for the object that --json prints.", show_default=False)
]
Acting = Annotated[
    str,
    typer.Option(
        help="How a policy acts: greedy, or softmax:T to draw by exp(Q / T).",
        autocompletion=completing("greedy", "softmax"),
    ),
]
DataFormat = Annotated[
    str | None,
    typer.Option(
        "--format",
        help="ngsim, pairs, tracks, tgsim or highd; told from the columns by default.",
        show_default=False,
        autocompletion=completing("ngsim", "pairs", "tracks", "tgsim", "highd"),
    ),
]
Config = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        is_eager=True,
        callback=read_config,
        help="TOML file with these options by their long names (lanes = 4). An option on the command line wins, also "
        "--no-NAME for a flag NAME = true. Paths in the file, and a module of its av, are looked for from its folder.",
        show_default=False,
    ),
]
Resume = Annotated[bool, flag("--resume", "Go on with what is there.")]
Reward = Annotated[
    str,
    typer.Option(
        help=f"Crashes of the AV that are paid for: {', '.join(REWARD_NAMES)}; crash: all. preventable:DRIVER and "
        "preventable-by-braking:DRIVER name the reference driver, cc-human by default.",
        autocompletion=completing(*REWARD_NAMES),
    ),
]
Library = Annotated[Path, typer.Argument(metavar="LIB", help="A case library.", show_default=False)]
World: TypeAlias = Any
"""What `takes_world` hands to a command: the options of the world by name, for `**world` of a verb."""
_KINDS: dict[str, Any] = {
    "av": str, "odd": str, "lanes": int | None, "model": Path | None, "bounded": bool, "budget": float | None,
    "av_timeout": float, "av_batch": int | None, "av_processes": int | None, "av_python": str | None,
    "av_memory": float | None,
}  # fmt: skip
_COMPLETED = {"av": complete_av, "odd": complete_odd}


def _option(one: Field[Any]) -> inspect.Parameter:
    """A field of `WorldOptions` as a parameter that Typer makes an option of."""
    name, text = f"--{one.name.replace('_', '-')}", one.metadata["help"]
    if _KINDS[one.name] is bool:
        shown = flag(name, text)
    else:
        completed = _COMPLETED.get(one.name)
        shown = typer.Option(name, help=text, show_default=one.default is not None, autocompletion=completed)
    annotated: Any = Annotated  # made here, not written down, so mypy must not read it as a type
    kind = annotated[_KINDS[one.name], shown]
    return inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=kind)


def takes_world(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command these options of `WorldOptions`, where its parameter `world` stands."""
    options = [_option(one) for one in fields(WorldOptions) if one.name in names]

    def with_options(command: Callable[..., None]) -> Callable[..., None]:
        def run(**given: Any) -> None:
            world = {name: given.pop(name) for name in names}
            command(**given, world=world)

        usual = inspect.signature(command, eval_str=True).parameters.values()
        own = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in usual]
        place = [one.name for one in own].index("world")
        parameters = [*own[:place], *options, *own[place + 1 :]]
        run.__name__, run.__doc__ = command.__name__, command.__doc__
        # Typer reads both.
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {one.name: one.annotation for one in parameters}
        return run

    return with_options
