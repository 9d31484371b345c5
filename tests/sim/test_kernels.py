"""What all kernels keep to: few arguments, so that a reader can hold them in mind."""

from __future__ import annotations

import importlib
import pkgutil

import cornerforge
from cornerforge._kernel_parts import KernelDispatcher

MOST = 8


def kernels() -> dict[str, KernelDispatcher]:
    """All kernels of the package, by their full name."""
    found = {}
    for module in pkgutil.walk_packages(cornerforge.__path__, prefix="cornerforge."):
        if module.name.endswith("__main__"):
            continue
        for name, value in vars(importlib.import_module(module.name)).items():
            if isinstance(value, KernelDispatcher) and value.py_func.__module__ == module.name:
                found[f"{module.name}.{name}"] = value
    return found


def test_no_kernel_takes_more_than_eight_arguments() -> None:
    found = kernels()
    assert len(found) > 150
    wide = {name: k.py_func.__code__.co_argcount for name, k in found.items() if k.py_func.__code__.co_argcount > MOST}
    assert not wide, f"put what belongs together into a NamedTuple: {wide}"
