"""Driver models: what a vehicle does, given what it sees."""

from __future__ import annotations

__all__: list[str] = []
