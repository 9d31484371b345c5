"""Studies on top of the core: UN R157, suites of cases, plausibility, variety, model uncertainty."""

from __future__ import annotations

__all__: list[str] = []
