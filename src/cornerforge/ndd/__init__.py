"""The naturalistic driving model: trajectory readers, probability tables, their fit and their report."""

from __future__ import annotations

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
