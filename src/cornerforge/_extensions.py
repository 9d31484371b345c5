"""Parts of `cornerforge.ext` that the core asks for by name, so that it imports nothing of it."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["extension"]

_PARTS = {
    "evidence": "evidence.page", "films": "pictures.picture", "model draws": "studies.model_draws",
    "players": "pictures.player",
}  # fmt: skip


def extension(part: str) -> Any:
    """Give the module of a part.

    Those are "evidence" (`report`), "films" (`replay`), "model draws" (`rate`) and "players" (cases in notebooks).
    """
    return importlib.import_module(f"cornerforge.ext.{_PARTS[part]}")
