"""The simulator: worlds of one AV and many BVs in compiled kernels; it knows no file, no learner and no plot."""

from __future__ import annotations

__all__: list[str] = []
