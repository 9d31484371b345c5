"""The naturalistic driving model: its tables, and by name what `cornerforge.ext.calibrate` fits it with.

Programs take the model and its fit here. Of the modules, `model` is the tables and their file, `grids` where their
entries lie, `initial` the law of traffic at the start of a test, `memory` how an acceleration depends on the last one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.ext.calibrate.fit import fit_model
    from cornerforge.ext.calibrate.layouts import DATA_FORMATS
    from cornerforge.ext.calibrate.readers import read_decisions
    from cornerforge.ext.calibrate.report import write_fit_report
    from cornerforge.ndd.model import NddModel, default_model_path, load_model, model_hash, save_model
    from cornerforge.results.naturalistic import FitReport

__all__ = [
    "DATA_FORMATS",
    "FitReport",
    "NddModel",
    "default_model_path",
    "fit_model",
    "load_model",
    "model_hash",
    "read_decisions",
    "save_model",
    "write_fit_report",
]

MODULES = ("grids", "initial", "memory", "model")
"""Modules from which other rooms import too."""

__getattr__ = door(
    "cornerforge",
    {
        "DATA_FORMATS": "ext.calibrate.layouts",
        "FitReport": "results.naturalistic",
        "NddModel": "ndd.model",
        "default_model_path": "ndd.model",
        "fit_model": "ext.calibrate.fit",
        "load_model": "ndd.model",
        "model_hash": "ndd.model",
        "read_decisions": "ext.calibrate.readers",
        "save_model": "ndd.model",
        "write_fit_report": "ext.calibrate.report",
    },
)
