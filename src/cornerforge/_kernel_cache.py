"""The cache of kernels' machine code: its folders, and what happens to files that are damaged or cannot be written.

A file's name holds the hash of all that its machine code was made of (`_kernel_content`), of the types of its
arguments, the processor, Numba, LLVM and Python. So a file is right wherever its name is asked for: folders may be
shared by checkouts, kept by CI, shipped and read-only.

A program must start wherever Python starts: with a read-only package, without a home folder, on a full disk. Kernels
are then compiled for this run only. A damaged file is dropped and its kernel compiled again.
"""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import llvmlite.binding  # type: ignore[import-untyped]
import numba
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from cornerforge._files import read_bytes, writing
from cornerforge._kernel_content import content_hash
from cornerforge._kernel_parts import load_shared, shared_of

__all__ = ["SHIPPED", "KernelCache", "PartStore", "cache_folder", "read_folders", "shipped_targets", "target"]

_UNUSED_DAYS = 30.0
_TOUCH_DAYS = 1.0
_DAY = 86400.0
_TOLD: list[str] = []
_FOLDER = "kernels"
_ENDING = ".nbc"
_FORM = 2
"""Version of what a file holds."""
SHIPPED = {
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sahf", "sse4.2"),
    "generic": (),
}
"""Processors that a wheel may hold machine code for, by LLVM's names, with the features of each that are asked for."""
_PACKAGE = Path(__file__).parent


@functools.cache
def cache_folder() -> str:
    """Find the folder in which machine code is kept: the first of `_places` that can be written; "" if none can."""
    for base in _places():
        folder = base / _FOLDER
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return str(folder)
    return ""


def read_folders() -> list[Path]:
    """List the folders to search for machine code: folders that could be written before, then the package's."""
    return [*(base / _FOLDER for base in _places()), _PACKAGE / _FOLDER]


def _places() -> Iterator[Path]:
    """Yield the one that NUMBA_CACHE_DIR names, if it is set; else the user's cache, then the package's."""
    wished = os.environ.get("NUMBA_CACHE_DIR")
    if wished:
        yield Path(wished)
        return
    named = os.environ.get("XDG_CACHE_HOME")
    if named:
        yield Path(named) / "cornerforge"
    else:
        with contextlib.suppress(RuntimeError):  # a user without a home
            yield Path.home() / ".cache" / "cornerforge"
    yield _PACKAGE / "__pycache__"


@functools.cache
def _remove_unused(folder: Path) -> None:
    """Delete machine code that no program has used for a month: its sources or its installation are gone."""
    limit = time.time() - _UNUSED_DAYS * _DAY
    for file in folder.glob(f"*{_ENDING}"):
        with contextlib.suppress(OSError):  # another process may remove it too
            if file.stat().st_mtime < limit:
                file.unlink()


def _mark_as_used(file: Path) -> None:
    """Set the file's time, the time of its last use; at most once a day."""
    with contextlib.suppress(OSError):
        if file.stat().st_mtime < time.time() - _TOUCH_DAYS * _DAY:
            os.utime(file)


@functools.cache
def target() -> str:
    """Tell what machine code is made by and for: processor, Numba, LLVM, level of optimisation and Python."""
    from numba.core.registry import cpu_target

    return _told(*cpu_target.target_context.codegen().magic_tuple())


def _told(system: str, processor: str, features: str) -> str:
    optimised = numba.config.OPT  # type: ignore[attr-defined]
    made_by = f"{_FORM} {numba.__version__} {llvmlite.__version__} {optimised} {sys.implementation.cache_tag}"
    return f"{system} {processor} {features} {made_by}"


@functools.cache
def shipped_targets() -> list[str]:
    """List the targets of machine code in the package that runs on this processor, the quickest first."""
    if not (_PACKAGE / _FOLDER).is_dir():
        return []
    from numba.core.registry import cpu_target

    system = cpu_target.target_context.codegen().magic_tuple()[0]
    has = llvmlite.binding.get_host_cpu_features()
    return [_told(system, name, "") for name, needs in SHIPPED.items() if all(has.get(one) for one in needs)]


class KernelCache:
    """The cached files of one kernel, as Numba's dispatcher asks for them; no fault in them ends the program."""

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel

    @property
    def cache_path(self) -> str:
        """Folder in which machine code is kept."""
        return cache_folder()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read the kernel's machine code; None if it is absent or damaged."""
        target_context.refresh()

        def rebuilt(kept: Any) -> Any:
            shared, names, result = kept
            load_shared(shared)
            target_context.codegen()._engine._defined_symbols.update(names)
            return CompileResult._rebuild(target_context, *result)

        files = [folder / self._name(sig, target()) for folder in read_folders()]
        files += [_PACKAGE / _FOLDER / self._name(sig, one) for one in shipped_targets()]
        return _read(files, rebuilt)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the kernel's machine code; where that fails, warn once."""
        _write(self._name(sig, target()), lambda: (shared_of(data.library), *_without_bitcode(data)))

    def flush(self) -> None:
        """Do nothing: newly compiled code has another name, or the same content."""

    def _name(self, sig: Any, made_for: str) -> str:
        return _name_of(self._kernel, sig, made_for)


class PartStore:
    """The cached files of one part, the form in which kernels call a kernel (`_kernel_parts`)."""

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel

    def load(self, args: tuple[Any, ...]) -> Any:
        """Read the part and the parts that it calls; None if it is absent or damaged."""
        files = [folder / self._name(args) for folder in read_folders()]
        return _read(files, lambda kept: self._kernel._part.thaw(args, kept))

    def save(self, args: tuple[Any, ...], frozen: Any) -> None:
        """Write the part; where that fails, warn once."""
        _write(self._name(args), lambda: frozen)

    def _name(self, args: tuple[Any, ...]) -> str:
        return _name_of(self._kernel, f"part {args}", _told(target().partition(" ")[0], "", ""))


def _name_of(kernel: Any, sig: Any, made_for: str) -> str:
    """Name a file: the kernel, for people, and the hash of all that its code depends on."""
    function = kernel.py_func
    told = f"{content_hash(kernel)} {sig} {made_for}"
    digest = hashlib.sha256(told.encode()).hexdigest()[:32]
    name = re.sub(r"[^\w.]", "", f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}")
    return f"{name[:100]}-{digest}{_ENDING}"


def _read(files: list[Path], rebuilt: Callable[[Any], Any]) -> Any:
    """Rebuild the first of some files that exists, and drop damaged ones; None if none is left."""
    for file in files:
        try:
            content = read_bytes(file)
        except FileNotFoundError:
            continue
        except OSError:
            _drop(file)
            continue
        try:
            found = rebuilt(pickle.loads(_checked(content)))
        except Exception:  # damaged bytes, read as a pickle, can raise anything
            _drop(file)
            continue
        _mark_as_used(file)
        return found
    return None


def _write(name: str, kept: Callable[[], Any]) -> None:
    """Keep something in the folder for machine code; where that fails, warn once."""
    folder = cache_folder()
    if not folder:
        return
    content = dumps(kept())
    try:
        with writing(Path(folder) / name) as part:
            part.write_bytes(hashlib.sha256(content).digest() + content)
    except OSError as error:
        cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
        _warn_once(folder, cause.strerror or str(cause))
    _remove_unused(Path(folder))


def _without_bitcode(result: Any) -> tuple[list[str], tuple[Any, ...]]:
    """Return the names that a program defines, and the program as Numba reduces it, but for its bitcode.

    Bitcode is two thirds of a file, and for linking: kernels link parts, never what was read from disk.
    """
    linked = result.library._get_module_for_linking()
    names = [
        one.name for group in (linked.functions, linked.global_variables) for one in group if not one.is_declaration
    ]
    (name, kind, (code, _)), *rest = result._reduce()
    return names, ((name, kind, (code, llvmlite.binding.parse_assembly("").as_bitcode())), *rest)


def _checked(content: bytes) -> bytes:
    """Return what was kept: half a file must not become half a program.

    Raises:
        ValueError: The checksum is another.
    """
    if hashlib.sha256(content[32:]).digest() != content[:32]:
        raise ValueError("the checksum is another")
    return content[32:]


def _drop(file: Path) -> None:
    with contextlib.suppress(OSError):
        file.unlink()


def _warn_once(place: str, why: str) -> None:
    """Warn that machine code cannot be kept in a folder, once in a process."""
    if _TOLD:
        return
    _TOLD.append(place)
    warnings.warn(
        f"Machine code cannot be kept in {place} ({why}), so the next start compiles it again; make room, or name "
        "another folder in NUMBA_CACHE_DIR.",
        stacklevel=3,
    )
