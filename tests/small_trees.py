"""Small parts of a rate by trees, so that it takes seconds: a network that was taught little changes no rate."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import Any
from unittest.mock import patch

__all__ = ["SMALL", "small_trees"]

SMALL: dict[str, dict[str, Any]] = {
    "rates.teaching": {"_EXPLORING": 200, "_ROUNDS": (300,), "TEACHING_TREES": 500, "_PILOT": 200, "_STEPS": 150},
    "rates.plain": {"_BLOCK": 2_000},
    "verbs.rate": {"PLAIN_TESTS": 4_000, "TREES": 500},
    "rates.splitting": {"TREES": 500, "LEAST_TREES": 1_000},
}
"""What each module takes instead of its own numbers."""


@contextmanager
def small_trees() -> Iterator[None]:
    """Take the small numbers within this block."""
    with ExitStack() as stack:
        for module, numbers in SMALL.items():
            stack.enter_context(patch.multiple(import_module(f"cornerforge.{module}"), **numbers))
        yield
