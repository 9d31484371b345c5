"""The case library: recorded corner cases in versioned Parquet shards, with resume, SQL and checked reading."""

from __future__ import annotations

from cornerforge.library.shards import DamagedShardWarning
from cornerforge.library.store import CaseLibrary, StoredCase

__all__ = ["CaseLibrary", "DamagedShardWarning", "StoredCase"]
