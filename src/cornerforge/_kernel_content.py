"""Content of a kernel: its own code and that of all kernels it calls, with the constants that they read.

Machine code is kept under a hash of this content, so it holds for every checkout, branch and installation in which the
kernel is the same, and an edit concerns exactly the kernels that reach it. Hashed is Python's compiled code: comments,
docstrings and times of change are no part of it.
"""

from __future__ import annotations

import dis
import enum
import hashlib
import types
from collections.abc import Iterator
from typing import Any

import numpy as np
from numba.core import types as numba_types

__all__ = ["content_hash", "functions_reached"]

_OWN: dict[types.FunctionType, tuple[str, list[Any]]] = {}
"""Function that was asked for -> the hash of its content, and the functions that it calls."""
_PLAIN = (int, float, complex, str, bytes, type(None), type(Ellipsis), np.generic, np.dtype, numba_types.Type)


def content_hash(kernel: Any) -> str:
    """Hash all that a kernel reaches (SHA-256, hex).

    Args:
        kernel: As `_jit.kernel` made it.

    Raises:
        TypeError: A function reads a global of a type without readable content.
    """
    return hashlib.sha256("\n".join(sorted(set(functions_reached(kernel).values()))).encode()).hexdigest()


def functions_reached(kernel: Any) -> dict[Any, str]:
    """Map a kernel, and all kernels and functions that it reaches, to the hash of what stands in each itself.

    Raises:
        TypeError: As `content_hash`.
    """
    found: dict[Any, str] = {}
    waiting = [kernel]
    while waiting:
        one = waiting.pop()
        if one in found:
            continue
        function = getattr(one, "py_func", one)
        if function not in _OWN:
            _OWN[function] = _own(function)
        own, calls = _OWN[function]
        how = type(getattr(one, "_part", None)).__name__  # how its callers get it
        found[one] = f"{own} {how} {sorted(getattr(one, 'targetoptions', {}).items())}"
        waiting += calls
    return found


def _own(function: types.FunctionType) -> tuple[str, list[Any]]:
    """Hash what stands in a function, and list what it calls."""
    calls: list[Any] = []
    digest = hashlib.sha256()
    cells = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))

    def tell(*words: object) -> None:
        for word in words:
            digest.update(f"{word}\0".encode())

    def tell_value(name: str, value: Any) -> None:
        told = _told(value, calls)
        if told is not None:
            tell(name, told)
        elif name in set(_globals_loaded(function.__code__)):
            raise TypeError(
                f"The kernel {function.__module__}.{function.__qualname__} reads {name}, of the type "
                f"{type(value).__name__}, whose content _kernel_content cannot tell."
            )

    def tell_code(code: types.CodeType) -> None:
        tell(code.co_code.hex(), code.co_names, code.co_varnames, code.co_freevars, code.co_argcount, code.co_flags)
        tell(code.co_exceptiontable.hex())
        skip = 1 if code.co_consts and code.co_consts[0] is function.__doc__ else 0
        for value in code.co_consts[skip:]:
            tell_code(value) if isinstance(value, types.CodeType) else tell(_told(value, calls))
        for name in code.co_names:
            value = function.__globals__.get(name)
            if isinstance(value, types.ModuleType) and value.__name__.partition(".")[0] == "cornerforge":
                for attribute in sorted({*code.co_names} & vars(value).keys()):
                    tell_value(f"{name}.{attribute}", getattr(value, attribute))
            elif name in function.__globals__:
                tell_value(name, value)

    tell(function.__module__, function.__qualname__)
    tell_code(function.__code__)
    for name, cell in cells.items():
        tell_value(name, cell.cell_contents)
    for value in (function.__defaults__ or (), sorted((function.__kwdefaults__ or {}).items())):
        tell_value("defaults", tuple(value))
    return digest.hexdigest(), calls


def _told(value: Any, calls: list[Any]) -> str | None:
    """Tell a constant as a text that changes with its content, and add called functions to `calls`, or None."""
    if isinstance(value, _PLAIN) and not isinstance(value, enum.Enum):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    if isinstance(value, tuple | list | frozenset):
        parts = [_told(one, calls) for one in (sorted(value, key=repr) if isinstance(value, frozenset) else value)]
        return None if None in parts else f"{type(value).__qualname__} {parts}"
    if isinstance(value, enum.Enum):
        return f"{type(value).__qualname__} {value.name} {value.value!r}"
    if hasattr(value, "py_func"):
        calls.append(value)
        return f"kernel {value.py_func.__module__}.{value.py_func.__qualname__}"
    if isinstance(getattr(value, "_defn", None), types.FunctionType):  # an intrinsic: how Numba types and lowers it
        calls.append(value._defn)
        return f"intrinsic {value._defn.__qualname__}"
    if isinstance(value, types.FunctionType) and value.__module__.partition(".")[0] == "cornerforge":
        calls.append(value)
        return f"function {value.__module__}.{value.__qualname__}"
    if isinstance(value, type):
        return f"type {value.__module__}.{value.__qualname__} {getattr(value, '_fields', '')}"
    if isinstance(value, types.ModuleType):
        return f"module {value.__name__}"
    if isinstance(value, np.ufunc) or callable(value):
        return f"callable {getattr(value, '__module__', '')}.{getattr(value, '__qualname__', repr(type(value)))}"
    return None


def _globals_loaded(code: types.CodeType) -> Iterator[str]:
    """Yield the names of globals and cells that code loads; `co_names` has names of attributes too."""
    for one in dis.get_instructions(code):
        if one.opname in ("LOAD_GLOBAL", "LOAD_DEREF", "LOAD_CLOSURE"):
            yield str(one.argval)
    for value in code.co_consts:
        if isinstance(value, types.CodeType):
            yield from _globals_loaded(value)
