"""The functions behind the commands: each takes names and files, and returns the object that the command prints."""

from __future__ import annotations

__all__: list[str] = []
