"""What a folder holds, to show that work which is refused leaves it as it was."""

from __future__ import annotations

from pathlib import Path

__all__ = ["snapshot"]


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Everything below a folder: relative name to content (None for folders)."""
    return {
        path.relative_to(folder).as_posix(): None if path.is_dir() else path.read_bytes()
        for path in sorted(folder.rglob("*"))
    }
