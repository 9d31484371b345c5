"""The functions behind the commands: each takes names and files, and returns the object that the command prints."""

from __future__ import annotations

from cornerforge.pipeline.analyse import analyse
from cornerforge.pipeline.avs import avs
from cornerforge.pipeline.cases import query, replay
from cornerforge.pipeline.check_av import check_av
from cornerforge.pipeline.generate import generate
from cornerforge.pipeline.naturalistic import ndd_fit, ndd_import
from cornerforge.pipeline.plausibility import plausibility
from cornerforge.pipeline.rate import rate
from cornerforge.pipeline.run import run
from cornerforge.pipeline.show import ndd_show
from cornerforge.pipeline.shrink import shrink
from cornerforge.pipeline.simulate import simulate
from cornerforge.pipeline.train import train
from cornerforge.pipeline.train_av import train_av
from cornerforge.pipeline.validate import ndd_validate
from cornerforge.pipeline.variety import variety

__all__ = [
    "analyse",
    "avs",
    "check_av",
    "generate",
    "ndd_fit",
    "ndd_import",
    "ndd_show",
    "ndd_validate",
    "plausibility",
    "query",
    "rate",
    "replay",
    "run",
    "shrink",
    "simulate",
    "train",
    "train_av",
    "variety",
]
