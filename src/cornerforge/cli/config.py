"""`--config FILE`: options of a command from a TOML file, and what a call was given in the end.

Keys of the file are the long names of options, with `-` or `_`. Keys at the top are for the command that reads the
file; those of the world, `seed` and `threads` may be there also where that command has no such option, so that commands
share a file. A table with a command's name holds options of that command alone. What stands in the file is meant as
seen from the file's folder: paths, and modules of `av`.
"""

from __future__ import annotations

import difflib
import importlib
import inspect
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, fields
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any, get_args, get_origin

import typer

from cornerforge._schema import allowed_types
from cornerforge.cli.retired import RETIRED
from cornerforge.errors import FileFormatError, InputError, UnknownNameError
from cornerforge.world_options import WorldOptions

__all__ = ["Call", "a_call", "read_config", "this_call"]

_NEVER = {"config", "help"}
"""Options that a file cannot give."""
_SHARED = {"seed", "threads", *(one.name.replace("_", "-") for one in fields(WorldOptions))}
"""Options that may stand at the top for other commands than the one that reads the file."""
_NUMBER_OR_WORD = {"avoidability"}
"""Options of text in which a number is usual."""
_MAY_NAME_FILES, _ENDINGS = {"bv", "policy", "road"}, (".json", ".onnx", ".safetensors", ".zip")
"""Options of text that name a file where the text has such an ending."""
_LONGEST = 1_000_000
"""Most characters of a file; one such as /dev/zero has no end."""
_WORDS = {
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    str: "text in quotes",
    Path: "text in quotes",
}


@dataclass
class Call:
    """A call of a command that takes --config: its parsed options, and the file, if one was given.

    Attributes:
        context: Typer's context of the command; None until it is parsed, and for commands without --config.
        file: The file, as it was named.
        text: What it holds.
        given: Its options for this command, by parameter name.
    """

    context: typer.Context | None = None
    file: Path | None = None
    text: str = ""
    given: dict[str, Any] = field(default_factory=dict)

    def says(self, name: str) -> bool:
        """Tell whether the file gives a value other than false for a parameter."""
        return bool(self.given.get(name))

    def stated(self) -> dict[str, Any]:
        """Return what output folders keep of the call: options in effect, by long name, and the file with its text."""
        if self.context is None:
            return {}
        known = _options(self.context.command)
        values = {name: self.context.params.get(one.name) for name, one in known.items()}
        stated: dict[str, Any] = {"options": {name: _plain(value) for name, value in values.items()}}
        if self.file is not None:
            stated["config"] = {"file": str(self.file), "text": self.text}
        return stated

    def _from_file(self, name: str) -> bool:
        """Tell whether the value in effect of a parameter is the file's."""
        source = None if self.context is None else self.context.get_parameter_source(name)
        return source is not None and source.name == "DEFAULT_MAP"

    def placed(self, message: str) -> str:
        """Put the file before a message on a value that stands there, such as `lanes = 99 is out of range`."""
        values = {name: value for name, value in self.given.items() if self._from_file(name)}
        if self.file is None or not values:
            return message
        av = str(values.get("av", ""))
        if ":" in av and message.startswith(f"No module {av.partition(':')[0].partition('.')[0]}"):
            folder = self.file.parent.resolve()
            looked = "" if folder == Path.cwd() else f"{folder}, "
            return f"{self.file}: {message.replace('; looked in ', f'; looked in {looked}', 1)}"
        words = [word for value in values.values() for word in (value if isinstance(value, list) else [value])]
        named = message.partition(" = ")[0] in values
        quoted = message.startswith("No ") and any(isinstance(w, str) and f' "{w}"' in message for w in words)
        return f"{self.file}: {message}" if named or quoted else message

    @contextmanager
    def finding_modules(self) -> Iterator[None]:
        """Let the AV's process find modules beside the file, if the file names the AV as `module:Class`.

        Raises:
            InputError: A module of that name would be found elsewhere first.
        """
        av = self.given.get("av", "") if self._from_file("av") else ""
        if self.file is None or ":" not in av or _names_file(av):
            yield
            return
        folder = self.file.parent.resolve()
        _check_module(av, folder, self.file)
        from cornerforge.foreign.loaders import looking_in

        with looking_in(folder):
            yield


_CALL: ContextVar[Call] = ContextVar("call")


@contextmanager
def a_call() -> Iterator[Call]:
    """Begin a call of the program; `read_config` fills it in, `this_call` gives it."""
    call = Call()
    token = _CALL.set(call)
    try:
        yield call
    finally:
        _CALL.reset(token)


def this_call() -> Call:
    """Return the call that runs; an empty one outside of `a_call`."""
    return _CALL.get(Call())


def read_config(context: typer.Context, file: Path | None) -> Path | None:
    """Take options from the file where the command line gives none; the callback of --config, run before other options.

    Raises:
        InputError: The file is missing, or a key or value in it is not right; the message names the file.
        FileFormatError: It is no TOML.
    """
    if context.resilient_parsing:
        return file
    call = this_call()
    call.context = context
    if file is not None:
        call.file, call.text = file, _text_of(file)
        call.given = _options_of_file(file, call.text, context)
        context.default_map = call.given
    return file


def _text_of(file: Path) -> str:
    try:
        with file.open(encoding="utf-8-sig") as opened:
            text = opened.read(_LONGEST + 1)
    except FileNotFoundError as error:
        raise InputError(f"No config file {file}; cornerforge init DIR writes one.") from error
    except OSError as error:
        raise InputError(f"The config file {file} cannot be read: {error.strerror or error}.") from error
    except UnicodeDecodeError as error:
        raise FileFormatError(f"The config file {file} is no UTF-8 text.") from error
    if len(text) > _LONGEST:
        raise FileFormatError(f"The config file {file} is longer than {_LONGEST:,} characters; name another file.")
    return text


def _options_of_file(file: Path, text: str, context: typer.Context) -> dict[str, Any]:
    """Check a whole file, and return its options for the command of `context`, by parameter name."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"{file} is no TOML: {error}; text stands in quotes.") from error
    commands = dict(_commands(context.find_root().command))
    here = context.command_path.partition(" ")[2]
    own = _options(commands[here])
    at_top: dict[str, Any] = {}
    tables: dict[str, dict[str, Any]] = {}
    for key, value in content.items():
        if isinstance(value, dict) and key not in own:
            tables |= _tables(key, value, commands, file)
        else:
            at_top[key] = value
    for_others = {key for key in at_top if key.replace("_", "-") in _SHARED - own.keys()}
    found = _checked({key: value for key, value in at_top.items() if key not in for_others}, here, commands, file)
    for name, table in tables.items():
        checked = _checked(table, name, commands, file)
        if name == here:
            found |= checked
    return found


def _tables(key: str, value: dict[str, Any], commands: Mapping[str, Any], file: Path) -> dict[str, dict[str, Any]]:
    """Take a table apart: options of the command `key`, or the tables of the commands below it, such as `[ndd.fit]`."""
    if key in commands:
        return {key: value}
    below = {f"{key} {name}": table for name, table in value.items()}
    if not any(name.startswith(f"{key} ") for name in commands):
        raise InputError(f"{file}: {UnknownNameError('command or option', key, commands)}")
    for name, table in below.items():
        if name not in commands or not isinstance(table, dict):
            raise InputError(f"{file}: {UnknownNameError('command with --config', name, commands)}")
    return below


def _commands(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """All commands that take --config, by their words."""
    for name, child in getattr(command, "commands", {}).items():
        words = f"{path} {name}".strip()
        yield from _commands(child, words)
        if any(one.name == "config" for one in child.params):
            yield words, child


def _options(command: Any) -> dict[str, Any]:
    """Parameters of a command that a file can give, by long name without dashes."""
    options = (one for one in command.params if one.param_type_name == "option" and not getattr(one, "hidden", False))
    named = {opt.removeprefix("--"): one for one in options for opt in one.opts if opt.startswith("--")}
    return {name: one for name, one in named.items() if name not in _NEVER}


def _checked(table: dict[str, Any], here: str, commands: Mapping[str, Any], file: Path) -> dict[str, Any]:
    """Check names and types of options for a command; return the values by parameter name."""
    command = commands[here]
    known = _options(command)
    kinds = inspect.signature(command.callback, eval_str=True).parameters
    found: dict[str, Any] = {}
    for key, value in table.items():
        name = key.replace("_", "-")
        if name not in known:
            raise InputError(f"{file}: {_unknown(key, here, commands)}")
        parameter = known[name].name
        if parameter in found:
            raise InputError(f"{file}: {name} stands there twice, with - and with _; remove one.")
        found[parameter] = _value(name, value, kinds[parameter].annotation, file)
    return found


def _unknown(key: str, here: str, commands: Mapping[str, Any]) -> str:
    """Say that a key is no option of a command, and what was meant: one of its options, or one of another command."""
    name = key.replace("_", "-")
    if name in RETIRED:
        return f"{key} is gone since 0.2: {RETIRED[name]}."
    if name in _NEVER:
        return f"{key} can be said on the command line only; remove it."
    own = _options(commands[here])
    if not difflib.get_close_matches(name, own, n=1, cutoff=0.75):
        for words, command in commands.items():
            near = difflib.get_close_matches(name, _options(command), n=1, cutoff=0.75)
            if near:
                return (
                    f'{here} has no option "{key}". If you mean {near[0]} of {words}, put it below a line '
                    f"[{words.replace(' ', '.')}], at the end of the file."
                )
    return str(UnknownNameError(f"option of {here}", key, own))


def _value(name: str, value: Any, annotation: Any, file: Path) -> Any:
    """Check the type of a value, and turn paths to where they lie as seen from the file."""
    kind = allowed_types(annotation)[0]
    if get_origin(kind) is list:
        (kind,) = get_args(kind)
        return [_one(name, one, kind, file) for one in (value if isinstance(value, list) else [value])]
    return _one(name, value, kind, file)


def _one(name: str, value: Any, kind: Any, file: Path) -> Any:
    allowed: tuple[type, ...] = {int: (int,), float: (int, float), bool: (bool,)}.get(kind, (str,))
    if kind is str and name in _NUMBER_OR_WORD:
        allowed = (str, int, float)
    if not isinstance(value, allowed) or (isinstance(value, bool) and kind is not bool):
        words = f"{_WORDS[kind]} or a number" if len(allowed) == 3 else _WORDS[kind]
        raise InputError(f"{file}: {name} = {_spoken(value)} is not of the right type; give {words}.")
    if kind not in (str, Path):
        return value
    text = str(value)
    if name == "av":
        return _av_beside(text, file.parent)
    names_file = kind is Path or (name in _MAY_NAME_FILES and ":" not in text and text.endswith(_ENDINGS))
    return str(file.parent / text) if names_file else text


def _names_file(av: str) -> bool:
    from cornerforge.foreign.loaders import split_file

    return split_file(av)[0] != ""


def _av_beside(av: str, folder: Path) -> str:
    from cornerforge.foreign.loaders import from_folder

    return from_folder(av, folder)


def _spoken(value: Any) -> str:
    """Write a value as it stands in TOML, as far as people care."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def _plain(value: Any) -> Any:
    """Make a value of an option fit for JSON."""
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, Path) else value


def _check_module(av: str, folder: Path, file: Path) -> None:
    """Check that the AV's process, which looks in the current folder and beside cornerforge first, finds ours.

    Raises:
        InputError: It would find another module of the same name.
    """
    name = av.partition(":")[0].partition(".")[0]
    importlib.invalidate_caches()
    ours = PathFinder.find_spec(name, [str(folder)])
    if ours is None:
        return
    for place in (Path.cwd(), Path(__file__).parents[2]):
        other = PathFinder.find_spec(name, [str(place)])
        if other is None or _place(other) == _place(ours) or (other.loader is None and ours.loader is not None):
            continue
        raise InputError(
            f'{file}: av = "{av}" could mean {_place(ours)} or {_place(other)}; start the program in {folder}, or '
            "rename one of them."
        )


def _place(spec: ModuleSpec) -> Path:
    """Return the file of a module, or the folder of a package without `__init__.py`."""
    place = spec.origin if spec.has_location and spec.origin else next(iter(spec.submodule_search_locations or [""]))
    return Path(place).resolve()
