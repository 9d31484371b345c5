"""Options of verbs, declared once: Python's signatures, checks, commands, config files and docs are made of them.

A verb has a frozen dataclass with its options as fields, in a module that is light to import, because `--help` needs
it. The annotation of a field says its type and, in `meant`, what it means and which values it may have.

    class Simulate(WorldOptions, Seeded, Watched):
        '''Drive tests and count crashes.'''

        tests: Annotated[int, meant("Tests to drive.", low=1, high=10**12)] = 10_000

    @verb(Simulate)
    def simulate(options: Simulate) -> Simulated: ...

and `simulate(tests=1000)` is a call. A `Command` says how the command of the same name is made.
"""

from __future__ import annotations

import functools
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import Field, dataclass, fields
from typing import Annotated, Any, Concatenate, ParamSpec, TypeVar, cast, get_args

from msgspec import Meta

from cornerforge._locks import claims
from cornerforge._schema import Declared, check_value, hints_of, meant, shown_of, unit_of
from cornerforge.work.progress import NO_PROGRESS, Progress

__all__ = [
    "Command", "LongWork", "Options", "Resumable", "Seeded", "Threaded", "Watched", "made_of",
    "options_of", "verb",
]  # fmt: skip

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")
OPTIONS = TypeVar("OPTIONS", bound="Options")


class Options(Declared):
    """Options of a verb, or some that several verbs share; checked when they are made.

    Raises:
        InputError: A value is of another type than its annotation says, or out of range.
    """

    def __post_init__(self) -> None:
        """Check all values."""
        kind: Any = type(self)
        for name, hint in hints_of(kind).items():
            check_value(name, getattr(self, name), hint)


class Watched(Options):
    """Work that tells how far it is."""

    progress: Annotated[Progress, meant("Told how far it is.", hidden=True)] = NO_PROGRESS


class Seeded(Options):
    """Work that draws random numbers."""

    seed: Annotated[int, meant("Names the random numbers; same seed, same results.", low=0, high=2**63 - 1)] = 0


class Threaded(Options):
    """Work of several threads."""

    threads: Annotated[int | None, meant("Threads; all cores by default. Does not change results.")] = None


class LongWork(Seeded, Threaded, Watched):
    """Long work: random, on all cores, watched."""


class Resumable(Options):
    """Work that can be stopped and goes on."""

    resume: Annotated[bool, meant("Go on with what is there.")] = False


# What a class of options says


def options_of(options: type[Options]) -> Iterator[tuple[Field[Any], Any, Meta]]:
    """Give each option of a class: its field, its type, and its meaning; the class's own options first."""
    known = {one.name: one for one in fields(options)}
    hints = hints_of(cast("Any", options))
    for kind in options.__mro__:
        for name in inspect.get_annotations(kind):
            if name in known:
                yield known.pop(name), *get_args(hints[name])


def _in_words(said: Meta) -> str:
    """Say what an option means, with its unit, its values and its range."""
    option, unit = shown_of(said), unit_of(said)
    text = re.sub("--([a-z-]+)", lambda found: found[1].replace("-", "_"), said.description or "")
    first, _, rest = text.partition(". ")
    parts = [f"{first.rstrip('.')} [{unit}]. {rest}".rstrip() if unit else text]
    if "choices" in option:
        parts.append(f"One of {', '.join(option['choices'])}.")
    if said.ge is not None:
        most = "2^63 - 1" if said.le == 2**63 - 1 else said.le and f"{said.le:g}"
        parts.append(f"From {said.ge:g} to {most}." if most else f"At least {said.ge:g}.")
    return " ".join([*parts, *([option["more"]] if "more" in option else [])])


# Verbs and commands


@dataclass(frozen=True)
class Command:
    """Parts that a command is made of.

    Attributes:
        options: Class of the verb's options; its docstring is the help of the command.
        verb: Function of the verb, as "module:function" below cornerforge.
        says: Function that writes a result for people, in the same form.
        examples: One or two command lines that run as written, for the end of its help. They may use what
            `cornerforge run --effort quick --out out/demo` and `cornerforge init my-av` leave.
        name: Words of the command, such as "suite build"; "" for the name of the function.
        fails: Function of the result, in the same form: None where all is well, else what to say on standard error ("":
            nothing) before the program ends with status 1.
        stages: It may take minutes; without a terminal, each finished stage is reported in a line.
        spreads: It takes --engine and --address.
        early: The verb lasts until it is interrupted, and gives its result to `up` when it has begun.
    """

    options: type[Options]
    verb: str
    says: str
    examples: tuple[str, ...]
    name: str = ""
    fails: str = ""
    stages: bool = False
    spreads: bool = False
    early: bool = False


def verb(options: Callable[P, OPTIONS], *, writes: bool = True) -> Callable[[Callable[[OPTIONS], R]], Callable[P, R]]:
    """Make a verb of a function of options: it takes them as keywords, and they are checked.

    Args:
        options: The class of its options.
        writes: It claims its output places, up to its end.

    Raises:
        InputError: A value is not allowed.
        TypeError: An option is unknown or missing.
    """

    def of(function: Callable[[OPTIONS], R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            given = _made(options, function, args, kwargs)
            if not writes:
                return function(given)
            with claims():
                return function(given)

        kind: Any = options
        call.__doc__ = _documented(function.__doc__ or "", kind)
        call.__signature__ = _signature(kind, inspect.signature(function))  # type: ignore[attr-defined]
        return call

    return of


def made_of(
    options: Callable[P, OPTIONS],
) -> Callable[[Callable[[S, OPTIONS], None]], Callable[Concatenate[S, P], None]]:
    """Let a class be made of options that are given as keywords: for its `__init__(self, options)`.

    Raises:
        InputError, TypeError: As for `verb`.
    """

    def of(function: Callable[[S, OPTIONS], None]) -> Callable[Concatenate[S, P], None]:
        def call(self: S, /, *args: P.args, **kwargs: P.kwargs) -> None:
            function(self, _made(options, function, args, kwargs))

        return call

    return of


def _made(options: Callable[P, OPTIONS], of: Callable[..., Any], args: Any, kwargs: Any) -> OPTIONS:
    """Make options of what a function was called with; what is missing or unknown is told in Python's words."""
    try:
        inspect.signature(options).bind(*args, **kwargs)
    except TypeError as error:
        raise TypeError(f"{of.__qualname__}() {error}") from None
    return options(*args, **kwargs)


def _signature(options: type[Options], of: inspect.Signature) -> inspect.Signature:
    """Return the signature of a verb for people: its own options first, each with its type alone."""
    made = inspect.signature(options).parameters
    shown = [
        made[one.name].replace(annotation=kind, default=_named(made[one.name].default))
        for one, kind, _ in options_of(options)
    ]
    return of.replace(parameters=sorted(shown, key=lambda one: one.kind))


class _Name(str):
    """A text that `help` shows without quotes."""

    __repr__ = str.__str__


def _named(default: Any) -> Any:
    """Give the name of a function that is a default; other defaults are shown as they are."""
    return _Name(default.__name__) if inspect.isfunction(default) else default


def _documented(docstring: str, options: type[Options]) -> str:
    """Put the options into the docstring of a verb, before what it returns."""
    inside = textwrap.TextWrapper(100, " " * 8, " " * 12, break_on_hyphens=False)
    lines = [inside.fill(f"{one.name}: {_in_words(said)}") for one, _, said in options_of(options)]
    head, returns, rest = docstring.partition("    Returns:")
    return "\n".join([head.rstrip(), "", "    Args:", *lines, "", returns + rest]) if lines else docstring
