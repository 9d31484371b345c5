"""Classes that hold the result of each command, and the content of each file of a run."""

from __future__ import annotations

from cornerforge.results.analysis import Analysed
from cornerforge.results.avs import AvChecked, Avs
from cornerforge.results.cases import Plausibility, Queried, Replayed, ShrunkLibrary, Varied
from cornerforge.results.driving import Filled, NaturalRate, Simulated
from cornerforge.results.from_data import CasesFromData
from cornerforge.results.imported import ImportedCases
from cornerforge.results.learning import Trained, TrainedAv, TrainingCurve
from cornerforge.results.naturalistic import NddFitted, NddImported, NddShown
from cornerforge.results.r157 import Regulated
from cornerforge.results.reproduction import Reproduced
from cornerforge.results.retest import Retested
from cornerforge.results.suite import SuiteBuilt
from cornerforge.results.validation import NddValidated
from cornerforge.results.whole import (
    Exported,
    Exposure,
    Figured,
    Initialised,
    Migrated,
    Reported,
    RunDone,
    Served,
    Verified,
)

__all__ = ["FILES", "VERBS"]

VERBS: dict[str, type] = {
    "init": Initialised,
    "report": Reported,
    "serve": Served,
    "figure": Figured,
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
    "retest": Retested,
    "suite build": SuiteBuilt,
    "export": Exported,
    "import": ImportedCases,
    "cases from-data": CasesFromData,
    "r157": Regulated,
    "query": Queried,
    "verify": Verified,
    "migrate": Migrated,
    "variety": Varied,
    "plausibility": Plausibility,
    "ndd show": NddShown,
    "ndd import": NddImported,
    "ndd fit": NddFitted,
    "ndd validate": NddValidated,
    "reproduce": Reproduced,
}
"""Commands, and the classes of their results."""

FILES: dict[str, type] = {"exposure.json": Exposure, "training.json": TrainingCurve}
"""Files in the folder of `run` that no command prints, and the classes that they hold."""
