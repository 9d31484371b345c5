"""Identity of the code: results of different code are never mixed, neither in files nor between machines."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

__all__ = ["code_hash"]


@cache
def code_hash() -> str:
    """Hash the package's Python sources as they are at the first call (SHA-256, first 16 hex digits)."""
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
