"""The explorer: a page in the browser that shows all cases of a run or a library, and the server behind it.

It reads what a run left. What drives (reference drivers, other AVs) is given to it by the layer above, as `Driving`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.ext.explorer.exhibit import Driving, Exhibit, Ghost
    from cornerforge.ext.explorer.server import Door, open_door, serve_exhibit
    from cornerforge.ext.explorer.sources import FILES, Analysis, Source, read_analysis

__all__ = [
    "FILES",
    "Analysis",
    "Door",
    "Driving",
    "Exhibit",
    "Ghost",
    "Source",
    "open_door",
    "read_analysis",
    "serve_exhibit",
]

FOR_PROGRAMS = ()
"""Nothing here is promised to programs of others; `cornerforge.serve` is."""

__getattr__ = door(
    "cornerforge.ext.explorer",
    {
        "FILES": "sources",
        "Analysis": "sources",
        "Door": "server",
        "Driving": "exhibit",
        "Exhibit": "exhibit",
        "Ghost": "exhibit",
        "Source": "sources",
        "open_door": "server",
        "read_analysis": "sources",
        "serve_exhibit": "server",
    },
)
