"""Driver models: parameters and kernels that map what a vehicle faces to an acceleration, a gain or an action."""

from __future__ import annotations

__all__: list[str] = []
