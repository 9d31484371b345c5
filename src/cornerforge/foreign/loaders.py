"""Loading an AV from the text that a user writes behind --av; runs in the AV's own process."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import sys
import traceback
from pathlib import Path
from typing import Any

from cornerforge.errors import FileFormatError, InputError, UnknownNameError
from cornerforge.foreign.drivers import Driver, driver_of
from cornerforge.foreign.programs import Program, ProgramDriver, is_program

__all__ = ["is_foreign", "load_av", "source_hash"]

FILE_KINDS = (".onnx", ".zip")
_METHODS = "act(view), plan(scene) or predict(observation)"


def is_foreign(spec: str) -> bool:
    """Does this name an AV that is not built in: `module:Class`, `cmd: PROGRAM`, or an `.onnx` or `.zip` file?

    >>> is_foreign("my_av:MyAv"), is_foreign("cmd: ./planner"), is_foreign("net.onnx"), is_foreign("idm-mobil")
    (True, True, True, False)
    """
    return ":" in spec or spec.lower().endswith(FILE_KINDS)


def source_hash(*parts: bytes) -> str:
    """Compute SHA-256 (first 16 hex digits) over all that decides how an AV drives."""
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def load_av(spec: str) -> tuple[Driver, dict[str, str]]:
    """Load the AV that a text names, ready to be asked; return it and its `kind` and `hash`.

    Raises:
        InputError: There is nothing of that name, or it is no AV.
        FileFormatError: A file is missing, damaged, or of the wrong shapes.
        MissingExtraError: The library that reads such a file is not installed.
    """
    if is_program(spec):
        program = Program(spec)
        return ProgramDriver(program), {"kind": "program", "hash": source_hash(*program.hash_parts)}
    if not spec.lower().endswith(FILE_KINDS):
        return _load_class(spec)
    path = Path(spec)
    if not path.is_file():
        raise FileFormatError(f"No AV file {spec} (looked in {Path.cwd()}).")
    content = path.read_bytes()
    about = {"kind": path.suffix[1:].lower(), "hash": source_hash(content)}
    if about["kind"] == "onnx":
        from cornerforge.foreign.onnx_file import OnnxAv

        return driver_of(OnnxAv(spec, content)), about
    from cornerforge.foreign.sb3_file import sb3_av

    return driver_of(sb3_av(spec, content)), about


def _load_class(spec: str) -> tuple[Driver, dict[str, str]]:
    name, _, attribute = spec.partition(":")
    if not name or not all(part.isidentifier() for part in name.split(".")) or not attribute.isidentifier():
        raise InputError(f'"{spec}" names no AV; write it as package.module:Class, such as my_av:MyAv.')
    module = _import(spec, name)
    if attribute not in vars(module):
        known = [key for key, value in vars(module).items() if inspect.isclass(value) and not key.startswith("_")]
        raise UnknownNameError(f"class in module {name}", attribute, known)
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
    about = {"kind": "class", "hash": source_hash(made.__qualname__.encode(), source)}
    if not callable(getattr(av, "act", None)) and not callable(getattr(av, "plan", None)):
        from cornerforge.foreign.policies import PolicyDriver

        return PolicyDriver(av), about | {"kind": "policy"}
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


def _place(error: BaseException) -> str:
    """Name file and line of the user's code that raised an exception, if any."""
    frames = [f for f in traceback.extract_tb(error.__traceback__)[1:] if "importlib" not in f.filename]
    return f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
