"""What verbs return: frozen dataclasses whose fields say their unit and meaning, and are the keys of `--json`.

A field's name is its key, and the order of fields is that of the keys; a class that is made of others has the fields of
the last of its bases first. What `--json` prints is made of them by `as_json`, docs/results-json.md by
`results_markdown`.
"""

from __future__ import annotations

from cornerforge.results.analysis import Analysed, Avoidability, Cluster, ClusterChoice, Coverage, TopCase, ValueFound
from cornerforge.results.avs import AvAbout, AvCheck, AvChecked, Avs, AvSpeed
from cornerforge.results.cases import (
    CaseMedians,
    CaseSize,
    MedianSize,
    NaturalPlausibility,
    Plausibility,
    PlausibilityRow,
    PlausibilityRun,
    Queried,
    Replayed,
    ShrunkCase,
    ShrunkLibrary,
    Varied,
    VarietyRow,
)
from cornerforge.results.driving import (
    BvMilesEstimate,
    CrashCircumstances,
    Distributions,
    Filled,
    NaturalRate,
    Quantity,
    Simulated,
)
from cornerforge.results.learning import Baseline, Learned, LearnedPolicy, Trained, TrainedAv
from cornerforge.results.naturalistic import (
    BadRows,
    FitTraffic,
    FitVariant,
    HeldOutScore,
    NddFitted,
    NddImported,
    NddShown,
    PublishedFree,
    ShownCounts,
    ShownFollowing,
    ShownFreeFlow,
    ShownInitial,
    ShownLaneChanges,
    ShownOrigin,
    ShownQuantiles,
    ShownSpeeds,
    ShownSupport,
)
from cornerforge.results.rates import Rate, Yield
from cornerforge.results.stating import as_json, from_json, results_markdown
from cornerforge.results.whole import RunDone, RunTrained

__all__ = [
    "VERBS",
    "Analysed",
    "AvAbout",
    "AvCheck",
    "AvChecked",
    "AvSpeed",
    "Avoidability",
    "Avs",
    "BadRows",
    "Baseline",
    "BvMilesEstimate",
    "CaseMedians",
    "CaseSize",
    "Cluster",
    "ClusterChoice",
    "Coverage",
    "CrashCircumstances",
    "Distributions",
    "Filled",
    "FitTraffic",
    "FitVariant",
    "HeldOutScore",
    "Learned",
    "LearnedPolicy",
    "MedianSize",
    "NaturalPlausibility",
    "NaturalRate",
    "NddFitted",
    "NddImported",
    "NddShown",
    "Plausibility",
    "PlausibilityRow",
    "PlausibilityRun",
    "PublishedFree",
    "Quantity",
    "Queried",
    "Rate",
    "Replayed",
    "RunDone",
    "RunTrained",
    "ShownCounts",
    "ShownFollowing",
    "ShownFreeFlow",
    "ShownInitial",
    "ShownLaneChanges",
    "ShownOrigin",
    "ShownQuantiles",
    "ShownSpeeds",
    "ShownSupport",
    "ShrunkCase",
    "ShrunkLibrary",
    "Simulated",
    "TopCase",
    "Trained",
    "TrainedAv",
    "ValueFound",
    "Varied",
    "VarietyRow",
    "Yield",
    "as_json",
    "from_json",
    "results_markdown",
]

VERBS: dict[str, type] = {
    "run": RunDone,
    "simulate": Simulated,
    "rate": NaturalRate,
    "avs": Avs,
    "check-av": AvChecked,
    "train": Trained,
    "train-av": TrainedAv,
    "generate": Filled,
    "analyse": Analysed,
    "shrink": ShrunkLibrary,
    "replay": Replayed,
    "query": Queried,
    "variety": Varied,
    "plausibility": Plausibility,
    "ndd show": NddShown,
    "ndd import": NddImported,
    "ndd fit": NddFitted,
}
"""Commands, and the classes of their results."""
