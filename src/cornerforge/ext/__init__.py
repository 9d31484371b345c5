"""Extensions that only some users need, a folder each; the core imports none of it."""

from __future__ import annotations

__all__: list[str] = []
