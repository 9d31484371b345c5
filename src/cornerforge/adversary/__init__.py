"""The adversary: how the BV nearest to the AV learns to make it crash."""

from __future__ import annotations

__all__: list[str] = []
