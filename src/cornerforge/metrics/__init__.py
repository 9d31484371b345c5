"""Measures of a traffic situation and of an impact: small pure, vectorised functions.

All take arrays (or numbers) that broadcast against each other, in SI units, and return a new array. NaN raises an
error: it would silently drop out of every histogram. An absent lead is a distance of +inf.
Most functions have their module's name: import them from here, or as `from cornerforge.metrics.ttc import ttc`.
"""

from __future__ import annotations

from cornerforge.metrics.bbd import bbd
from cornerforge.metrics.delta_v import delta_v
from cornerforge.metrics.drac import drac
from cornerforge.metrics.injury import crash_mode, injury_probability
from cornerforge.metrics.pet import pet
from cornerforge.metrics.rss import rss_lateral, rss_longitudinal, rss_margin
from cornerforge.metrics.thw import thw
from cornerforge.metrics.ttc import ttc

__all__ = [
    "bbd",
    "crash_mode",
    "delta_v",
    "drac",
    "injury_probability",
    "pet",
    "rss_lateral",
    "rss_longitudinal",
    "rss_margin",
    "thw",
    "ttc",
]
