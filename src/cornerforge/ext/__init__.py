"""Extensions that only some users need, a folder each; the core imports none of it.

A new command stands in the `options` of its folder, and the folder in `ROOMS`.
"""

from __future__ import annotations

__all__ = ["ROOMS"]

ROOMS = ("studies", "interchange", "calibrate", "explorer", "pictures", "paper")
"""Folders with commands, in the order in which help lists them."""
