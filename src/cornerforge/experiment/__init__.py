"""The experiment: an AV, a road, a model and controllers, found by name, checked, and identified."""

from __future__ import annotations

__all__: list[str] = []
