"""Measures of a traffic situation: one pure, vectorised function a file.

All take arrays (or numbers) that broadcast against each other, in SI units, and return a new float64 array. NaN is
refused: it would go through and silently fall out of every histogram. An absent lead is a distance of +inf.
Each function has its module's name: import it from here, or as `from cornerforge.metrics.ttc import ttc`.
"""

from __future__ import annotations

from cornerforge.metrics.bbd import bbd
from cornerforge.metrics.drac import drac
from cornerforge.metrics.thw import thw
from cornerforge.metrics.ttc import ttc

__all__ = ["bbd", "drac", "thw", "ttc"]
