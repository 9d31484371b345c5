"""Pictures of a recorded case, to scale: films, strips of snapshots, and how figures are saved for print.

Each has its module: `film`, and `figure` for strips and charts.
"""

from __future__ import annotations

__all__: list[str] = []

MODULES = ("figure", "film")
"""Modules from which other rooms import too."""
