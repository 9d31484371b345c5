"""Evidence for assessors: what was found of an AV, question by question, and its rates beside people's."""

from __future__ import annotations

__all__: list[str] = []

MODULES: tuple[str, ...] = ()
"""Modules from which other rooms import too."""
