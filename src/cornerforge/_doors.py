"""Doors of packages that load a name on its first use, so that importing a package stays light."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["door"]


def door(package: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """Make the `__getattr__` of a package: it gives each name from the module that holds it.

    Args:
        package: Full name of the package.
        places: The names that it gives, each with its module below the package; "" for a name that is a module itself.

    Raises:
        AttributeError: The name that is asked for is not among them.
    """

    def load(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(f"{package}.{places[name] or name}")
        return getattr(module, name) if places[name] else module

    return load
