"""Results as text for people, a function for each verb."""

from __future__ import annotations

__all__: list[str] = []
