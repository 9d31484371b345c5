"""Pictures of a recorded case, to scale: films, strips of snapshots, and how figures are saved for print."""

from __future__ import annotations

__all__: list[str] = []
