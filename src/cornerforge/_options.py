"""Options of verbs, declared once: Python's signatures, checks, commands, config files and docs are made of them.

A verb has a frozen dataclass with its options as fields, in a module that is light to import, because `--help` needs
it. The annotation of a field says its type and, in an `Option`, what it means and which values it may have.

    @dataclass(frozen=True, kw_only=True)
    class Simulate(WorldOptions, Seeded, Watched):
        '''Drive tests and count crashes.'''

        tests: Annotated[int, Option("Tests to drive.", low=1, high=10**12)] = 10_000

    @verb(Simulate)
    def simulate(options: Simulate) -> Simulated: ...

and `simulate(tests=1000)` is a call. A `Command` says how the command of the same name is made.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, dataclass, fields
from typing import Annotated, Any, Concatenate, ParamSpec, TypeVar, cast, get_args, get_type_hints

from cornerforge._arguments import allowed_types, check_value, is_several
from cornerforge._checks import check_in, check_integer, check_number
from cornerforge._locks import claims
from cornerforge.work.progress import NO_PROGRESS, Progress

__all__ = [
    "Command", "LongWork", "Option", "Options", "Resumable", "Seeded", "Threaded", "Watched", "is_required", "made_of",
    "options_of", "verb",
]  # fmt: skip

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")
OPTIONS = TypeVar("OPTIONS", bound="Options")


@dataclass(frozen=True)
class Option:
    """Meaning of an option, and which values it may have.

    Attributes:
        help: One or two sentences, for help pages and docstrings.
        more: Further sentences for docstrings alone.
        low, high: Range of a number, ends allowed; None: no bound, or the verb checks it.
        unit: Unit of a number, "" for none.
        choices: All values of a text; empty: any.
        near: Words that a shell offers where `choices` are not all; ("av",) and ("odd",) stand for those names.
        name: Name on the command line, with its dashes; "" for the field's name.
        metavar: What stands for the value in help; "" for its type.
        default: What help says is the default, where the value None does not tell.
        also: A second name on the command line, with its dashes; "" for none.
        many: The words after it on the command line belong to it too, up to the next option.
        hidden: For Python only, as `progress`.
    """

    help: str
    more: str = ""
    low: float | None = None
    high: float | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()
    near: tuple[str, ...] = ()
    name: str = ""
    metavar: str = ""
    default: str = ""
    also: str = ""
    many: bool = False
    hidden: bool = False

    def in_words(self) -> str:
        """Say what it means, with its unit, its values and its range."""
        text = f"{self.help.rstrip('.')} [{self.unit}]." if self.unit else self.help
        if self.choices:
            text += f" One of {', '.join(self.choices)}."
        if self.low is not None:
            text += f" At least {self.low:g}." if self.high is None else f" From {self.low:g} to {self.high:g}."
        return f"{text} {self.more}" if self.more else text


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a verb, or some that several verbs share; checked when they are made.

    Raises:
        InputError: A value is of another type than its annotation says, or out of range.
    """

    def __post_init__(self) -> None:
        kind: Any = type(self)
        for name, hint in _hints(kind).items():
            _check(name, getattr(self, name), hint)


@dataclass(frozen=True, kw_only=True)
class Watched(Options):
    """Work that tells how far it is."""

    progress: Annotated[Progress, Option("Told how far it is.", hidden=True)] = NO_PROGRESS


@dataclass(frozen=True, kw_only=True)
class Seeded(Options):
    """Work that draws random numbers."""

    seed: Annotated[int, Option("Names the random numbers; same seed, same results.", low=0, high=2**63 - 1)] = 0


@dataclass(frozen=True, kw_only=True)
class Threaded(Options):
    """Work of several threads."""

    threads: Annotated[int | None, Option("Threads; all cores by default. Does not change results.")] = None


@dataclass(frozen=True, kw_only=True)
class LongWork(Seeded, Threaded, Watched):
    """Long work: random, on all cores, watched."""


@dataclass(frozen=True, kw_only=True)
class Resumable(Options):
    """Work that can be stopped and goes on."""

    resume: Annotated[bool, Option("Go on with what is there.")] = False


# What a class of options says


@functools.cache
def _hints(options: Any) -> dict[str, Any]:
    return get_type_hints(options, include_extras=True)


def options_of(options: type[Options]) -> Iterator[tuple[Field[Any], Any, Option]]:
    """Give each option of a class: its field, its type, and its meaning; the class's own options first."""
    known = {one.name: one for one in fields(options)}
    hints = _hints(cast("Any", options))
    for kind in options.__mro__:
        for name in inspect.get_annotations(kind):
            if name in known:
                hint = hints[name]
                yield known.pop(name), get_args(hint)[0], _option_of(hint)


def _option_of(hint: Any) -> Option:
    """Give the `Option` of an annotation."""
    return next(one for one in get_args(hint) if isinstance(one, Option))


def is_required(one: Field[Any]) -> bool:
    """Tell whether an option has no default."""
    return one.default is MISSING and one.default_factory is MISSING


def _check(name: str, value: Any, hint: Any) -> None:
    check_value(name, value, hint)
    option, kinds = _option_of(hint), allowed_types(hint)
    whole = any(int in (kind, *get_args(kind)) for kind in kinds)
    entries: list[Any] = list(value) if is_several(value) else [value]
    for one in entries:
        if option.choices and one is not None:
            check_in(name, one, option.choices)
        if option.low is None or one is None:
            continue
        if whole:
            check_integer(name, one, low=int(option.low), high=None if option.high is None else int(option.high))
        else:
            high = math.inf if option.high is None else option.high
            check_number(name, one, low=option.low, high=high, unit=option.unit)


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
        call.__signature__ = inspect.signature(options).replace(  # type: ignore[attr-defined]
            return_annotation=inspect.signature(function).return_annotation
        )
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


def _documented(docstring: str, options: type[Options]) -> str:
    """Put the options into the docstring of a verb, before what it returns."""
    lines = [f"        {one.name}: {option.in_words()}" for one, _, option in options_of(options)]
    head, returns, rest = docstring.partition("    Returns:")
    return "\n".join([head.rstrip(), "", "    Args:", *lines, "", returns + rest]) if lines else docstring
