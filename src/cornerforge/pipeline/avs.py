"""`avs`: the AVs that are built in."""

from __future__ import annotations

from typing import Any

from cornerforge.drivers.avs import AVS

__all__ = ["avs"]


def avs() -> dict[str, Any]:
    """List the built-in AVs.

    Returns:
        The object that `cornerforge avs --json` prints: `avs`, each with `name` and `about`.
    """
    return {"avs": [{"name": model.name, "about": model.about} for model in AVS.values()]}
