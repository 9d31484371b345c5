"""The naturalistic driving model: trajectory readers, probability tables, their fit and their report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.ndd.fit import fit_model
    from cornerforge.ndd.layouts import DATA_FORMATS
    from cornerforge.ndd.model import NddModel, default_model_path, load_model, model_hash, save_model
    from cornerforge.ndd.readers import read_decisions
    from cornerforge.ndd.report import FitReport, write_fit_report

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

__getattr__ = door(
    "cornerforge.ndd",
    {
        "DATA_FORMATS": "layouts",
        "FitReport": "report",
        "NddModel": "model",
        "default_model_path": "model",
        "fit_model": "fit",
        "load_model": "model",
        "model_hash": "model",
        "read_decisions": "readers",
        "save_model": "model",
        "write_fit_report": "report",
    },
)
