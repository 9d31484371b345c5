"""Analysis of crashes: features, projection, clusters, crash types, typical and rare cases.

Works on plain arrays and Arrow tables; knows no library. Only `avoidability` and `shrink` drive: they ask the simulator
what else could have happened. Clustering needs scikit-learn (the extra "analysis").
"""

from __future__ import annotations

from cornerforge.analysis.analyse import Analysis, analyse
from cornerforge.analysis.crash_types import CRASH_TYPES, STRIKERS, CrashTypes, classify_crashes
from cornerforge.analysis.features import Features, crash_features
from cornerforge.analysis.variety import Variety, crash_cells, unseen_chance, variety_of

__all__ = [
    "CRASH_TYPES",
    "STRIKERS",
    "Analysis",
    "CrashTypes",
    "Features",
    "Variety",
    "analyse",
    "classify_crashes",
    "crash_cells",
    "crash_features",
    "unseen_chance",
    "variety_of",
]
