"""Pictures to scale, of recorded cases, roads and junctions: films, strips of snapshots, and how figures are saved.

Each has its module: `film`, `figure` for strips and charts, `picture` for a case's way out, `road`, `site`.
"""

from __future__ import annotations

__all__: list[str] = []

MODULES = ("figure", "film", "picture", "road", "site")
"""Modules from which other rooms import too."""
