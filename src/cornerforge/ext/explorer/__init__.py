"""The explorer: a page in the browser that shows all cases of a run or a library, and the server behind it."""

from __future__ import annotations

__all__: list[str] = []
