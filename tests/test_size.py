"""Lines of the source by folder: a folder's budget may fall, and rises only with a line in an ADR (ADR 59)."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
