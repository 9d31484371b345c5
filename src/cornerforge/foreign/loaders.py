"""Loading an AV from the text that a user writes behind --av; runs in the AV's own process."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cornerforge.errors import FileFormatError, InputError, UnknownNameError
from cornerforge.foreign.drivers import Driver, driver_of
from cornerforge.foreign.edge_cases import sample_views
from cornerforge.foreign.networks import ACTIONS, Reading
from cornerforge.foreign.normalised import statistics_for
from cornerforge.foreign.programs import Program, ProgramDriver, is_program

__all__ = ["FILE_KINDS", "from_folder", "load_av", "looking_in", "source_hash", "split_file"]

FILE_KINDS = (".onnx", ".zip")
"""Endings of files that are AVs from outside."""
_BUILT_IN_FILES = (".safetensors",)
_METHODS = "act(view), plan(scene) or predict(observation)"


def split_file(spec: str) -> tuple[str, str]:
    """Split the name of an AV into its file, "" if it names none, and the rest.

    >>> split_file("avs/my_av.py:MyAv"), split_file("net.onnx"), split_file("my_av:MyAv")
    (('avs/my_av.py', ':MyAv'), ('net.onnx', ''), ('', 'my_av:MyAv'))
    """
    if is_program(spec):
        return "", spec
    file, colon, name = spec.rpartition(":")
    if colon and file.lower().endswith(".py"):
        return file, f":{name}"
    is_file = not colon and spec.lower().endswith((*FILE_KINDS, *_BUILT_IN_FILES))
    return (spec, "") if is_file else ("", spec)


def from_folder(spec: str, folder: Path) -> str:
    """Name an AV as seen from here that is named as seen from a folder: only names of files differ.

    >>> from_folder("my_av.py:MyAv", Path("/avs")), from_folder("my_av:MyAv", Path("/avs"))
    ('/avs/my_av.py:MyAv', 'my_av:MyAv')
    """
    file, rest = split_file(spec)
    return f"{folder / file}{rest}" if file else spec


def source_hash(*parts: bytes) -> str:
    """Compute SHA-256 (first 16 hex digits) over all that decides how an AV drives."""
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


@contextmanager
def looking_in(folder: Path) -> Iterator[None]:
    """Let processes of an AV that start meanwhile look for modules in a folder first."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(folder), *filter(None, [before])])
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before


def load_av(spec: str, reading: Reading = Reading()) -> tuple[Driver, dict[str, str]]:  # noqa: B008 - it is frozen
    """Load the AV that a text names, ready to be asked.

    Args:
        spec: The text behind --av.
        reading: What is said of a network that its file does not say.

    Returns:
        The AV, and its `kind`, its `hash`, how a network was `read`, and how far it is from its `maker`'s answers.

    Raises:
        InputError: There is nothing of that name, or it is no AV; or it is not clear what a network's numbers are.
        FileFormatError: A file is missing, damaged, or of the wrong shapes.
        MissingExtraError: The library that reads such a file is not installed.
    """
    if not is_program(spec) and spec.lower().endswith(FILE_KINDS):
        return _load_network(spec, reading)
    if is_program(spec):
        program = Program(spec)
        driver: Driver = ProgramDriver(program)
        about = {"kind": "program", "hash": source_hash(*program.hash_parts)}
    else:
        driver, about = _load_class(spec, reading)
    idle = reading.options() if about["kind"] != "policy" or reading.statistics else ""
    if idle:
        raise InputError(f"{spec} says itself what it sees and answers; leave out{idle}.")
    return driver, about | {"read": "", "maker": ""}


def _load_network(spec: str, reading: Reading) -> tuple[Driver, dict[str, str]]:
    path = Path(spec)
    if not path.is_file():
        raise FileFormatError(f"No AV file {spec} (looked in {Path.cwd()}).")
    content, said, why, maker = path.read_bytes(), reading.actions, "", ""
    statistics = statistics_for(reading.statistics, path)
    parts = [content, *([statistics.content] if statistics else []), *([said.encode()] if said else [])]
    if path.suffix.lower() == ".onnx":
        from cornerforge.foreign.onnx_file import OnnxAv, files_of_weights

        av: Any = OnnxAv(path, content, said, statistics)
        parts += [file.read_bytes() for file in files_of_weights(path, content)]
        why = av.why and f" ({av.why})"
    else:
        from cornerforge.foreign.sb3_file import Sb3Av

        if said:
            raise InputError(f"{spec} says itself what its actions are; leave out --av-actions.")
        av = Sb3Av(spec, content, statistics)
        maker = av.compared(sample_views()) if reading.compares else ""
    driver = driver_of(av)
    driver.about["remembers"] = "yes" if av.frames > 1 else "no"
    read = f"{ACTIONS[av.actions][0]}{why}; sees {'one view' if av.frames == 1 else f'the last {av.frames} views'}"
    read += ", divided by usual sizes as in Driving-v0" if av.scaled else ""
    read += f", normalised by {ascii(statistics.path.name)[1:-1][:200]}" if statistics else ", not normalised"
    return driver, {"kind": path.suffix[1:].lower(), "hash": source_hash(*parts), "read": read, "maker": maker}


def _load_class(spec: str, reading: Reading) -> tuple[Driver, dict[str, str]]:
    file, rest = split_file(spec)
    if file:
        return _class_of(spec, _import_file(spec, Path(file)), Path(file).name, rest[1:], reading)
    name, _, attribute = spec.partition(":")
    if not name or not all(part.isidentifier() for part in name.split(".")) or not attribute.isidentifier():
        raise InputError(
            f'"{spec}" names no AV; write it as package.module:Class, such as my_av:MyAv, or my_av.py:MyAv.'
        )
    return _class_of(spec, _import(spec, name), f"module {name}", attribute, reading)


def _class_of(spec: str, module: Any, place: str, attribute: str, reading: Reading) -> tuple[Driver, dict[str, str]]:
    if attribute not in vars(module):
        own = {key: value for key, value in vars(module).items() if inspect.isclass(value) and not key.startswith("_")}
        known = [key for key, value in own.items() if value.__module__ == module.__name__] or list(own)
        if not known:
            raise InputError(f'No class "{attribute}" in {place}, which has none.')
        raise UnknownNameError(f"class in {place}", attribute, known)
    made = vars(module)[attribute]
    if not callable(made):
        raise InputError(
            f"{spec} is a {type(made).__name__}, not a class; name a class with a method {_METHODS}, or a function "
            "without arguments that gives one of these."
        )
    if inspect.isclass(made) and not _has_method(made):
        raise InputError(f"{spec} is no AV: it has no method {_METHODS}; see examples/my_av.py.")
    try:
        av = made()
    except Exception as error:  # the user must mend whatever the user's code raises
        raise InputError(f"{spec} cannot be made: {type(error).__name__}({error}){_place(error)}.") from error
    if not _has_method(av):
        raise InputError(f"{spec} gave a {type(av).__name__}, which is no AV: it has no method {_METHODS}.")
    file = getattr(sys.modules.get(made.__module__), "__file__", None)
    source = Path(file).read_bytes() if file else b""
    said = [reading.actions.encode()] if reading.actions else []
    about = {"kind": "class", "hash": source_hash(made.__qualname__.encode(), source, *said)}
    if not callable(getattr(av, "act", None)) and not callable(getattr(av, "plan", None)):
        from cornerforge.foreign.policies import PolicyDriver

        return PolicyDriver(av, reading.actions), about | {"kind": "policy"}
    return driver_of(av, made), about


def _has_method(av: Any) -> bool:
    return any(callable(getattr(av, name, None)) for name in ("act", "plan", "predict"))


def _import(spec: str, name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        parents = {name.rsplit(".", k)[0] for k in range(name.count(".") + 1)}
        if error.name in parents:
            raise InputError(
                f"No module {error.name} for the AV {spec}; looked in {Path.cwd()} and where Python finds packages."
            ) from error
        raise InputError(f"Importing {name} for the AV {spec} failed: {error}{_place(error)}.") from error
    except Exception as error:  # see above
        what = f"{type(error).__name__}({' '.join(str(error).split())})"
        raise InputError(f"Importing {name} for the AV {spec} failed: {what}{_place(error)}.") from error


def _import_file(spec: str, file: Path) -> Any:
    """Import a file, whatever other modules are called; what lies beside it is found.

    Raises:
        FileFormatError: There is none.
        InputError: It cannot be imported.
    """
    if not file.is_file():
        raise FileFormatError(f"No AV file {file} for the AV {spec} (looked in {Path.cwd()}).")
    path = file.resolve()
    name = path.stem if path.stem not in sys.modules else f"av_file_{path.stem}"
    made = importlib.util.spec_from_file_location(name, path)
    if made is None or made.loader is None:
        raise InputError(f"{file} is no Python file, so it holds no AV {spec}.")
    sys.path.insert(0, str(path.parent))
    module = importlib.util.module_from_spec(made)
    sys.modules[name] = module
    try:
        made.loader.exec_module(module)
    except Exception as error:  # see above
        del sys.modules[name]  # half a module: a second try would take it for the whole one
        what = f"{type(error).__name__}({' '.join(str(error).split())})"
        raise InputError(f"Importing {file} for the AV {spec} failed: {what}{_place(error)}.") from error
    return module


def _place(error: BaseException) -> str:
    """Name file and line of the user's code that raised an exception, if any."""
    frames = [f for f in traceback.extract_tb(error.__traceback__)[1:] if "importlib" not in f.filename]
    return f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
