"""Cases of other people's tools: writers and readers of their formats, and the case file of one's own.

Writers take an `OutCase`, readers give `MovingCase`s; both are in `cases.py`. Nothing here knows libraries, analyses or
AVs: `verbs/` gets the facts of a case and drives.
"""

from __future__ import annotations

__all__: list[str] = []
