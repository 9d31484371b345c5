"""Extensions that only some users need, a folder each; the core imports none of it.

A new command stands in the `options` of its folder, and the folder in `ROOMS`.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator

from cornerforge._options import Command

__all__ = ["ROOMS", "commands"]

ROOMS = ("studies", "interchange", "calibrate", "explorer", "pictures", "paper")
"""Folders with commands, in the order in which help lists them."""


def commands() -> Iterator[Command]:
    """Give all commands of the folders; of each only its module `options` is imported."""
    for room in ROOMS:
        yield from importlib.import_module(f"cornerforge.ext.{room}.options").COMMANDS
