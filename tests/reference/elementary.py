"""The functions of `cornerforge._elementary` as plain Python: the same lines, never compiled.

To the last bit there is one way only to compute them, so they are not written a second time here; they are compared
with mpmath in `tests/test_elementary.py`. What is plain here is how they run: the interpreter rounds each operation on
its own, as IEEE 754 says, and fuses, reorders and vectorises nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType, SimpleNamespace
from typing import Any

from cornerforge import _elementary

__all__ = ["atan", "exp", "log", "plain_functions", "sin_cos"]


def plain_functions(**changed: object) -> SimpleNamespace:
    """The functions as plain Python.

    Args:
        changed: Constants of the module to be replaced; for negative controls.
    """
    scope: dict[str, Any] = dict(vars(_elementary))
    scope |= changed
    for name, value in vars(_elementary).items():
        if hasattr(value, "py_func"):
            scope[name] = FunctionType(value.py_func.__code__, scope, name)
    return SimpleNamespace(**{name: scope[name] for name in _elementary.__all__})


_plain = plain_functions()
exp: Callable[[float], float] = _plain.exp
log: Callable[[float], float] = _plain.log
atan: Callable[[float], float] = _plain.atan
sin_cos: Callable[[float], tuple[float, float]] = _plain.sin_cos
