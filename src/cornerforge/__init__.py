"""cornerforge: how an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.

This package has the verbs of the command line as functions of the same names. Each returns what `--json` prints, most
of them as a dataclass of `cornerforge.results`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.execution import engine
    from cornerforge.interchange.case_file import read_case_file, write_case_file
    from cornerforge.paper.reproduce import reproduce
    from cornerforge.pipeline.analyse import analyse
    from cornerforge.pipeline.avs import avs
    from cornerforge.pipeline.case_files import drive_case
    from cornerforge.pipeline.cases import query, replay
    from cornerforge.pipeline.check_av import check_av
    from cornerforge.pipeline.export import export
    from cornerforge.pipeline.figure import figure
    from cornerforge.pipeline.from_data import cases_from_data
    from cornerforge.pipeline.generate import generate
    from cornerforge.pipeline.import_cases import import_cases
    from cornerforge.pipeline.init import init
    from cornerforge.pipeline.make_report import make_report
    from cornerforge.pipeline.naturalistic import ndd_fit, ndd_import
    from cornerforge.pipeline.plausibility import plausibility
    from cornerforge.pipeline.r157 import r157
    from cornerforge.pipeline.rate import rate
    from cornerforge.pipeline.retest import retest
    from cornerforge.pipeline.run import run
    from cornerforge.pipeline.serve import serve
    from cornerforge.pipeline.show import ndd_show
    from cornerforge.pipeline.shrink import shrink
    from cornerforge.pipeline.simulate import simulate
    from cornerforge.pipeline.suite import suite_build
    from cornerforge.pipeline.train import train
    from cornerforge.pipeline.train_av import train_av
    from cornerforge.pipeline.validate import ndd_validate
    from cornerforge.pipeline.variety import variety

__all__ = [
    "__version__",
    "analyse",
    "avs",
    "cases_from_data",
    "check_av",
    "drive_case",
    "engine",
    "export",
    "figure",
    "generate",
    "import_cases",
    "init",
    "make_report",
    "migrate",
    "ndd_fit",
    "ndd_import",
    "ndd_show",
    "ndd_validate",
    "plausibility",
    "query",
    "r157",
    "rate",
    "read_case_file",
    "replay",
    "reproduce",
    "retest",
    "run",
    "serve",
    "shrink",
    "simulate",
    "suite_build",
    "train",
    "train_av",
    "variety",
    "verify",
    "write_case_file",
]

__version__ = "0.1.0"

__getattr__ = door(
    "cornerforge",
    {
        "analyse": "pipeline.analyse",
        "avs": "pipeline.avs",
        "cases_from_data": "pipeline.from_data",
        "check_av": "pipeline.check_av",
        "drive_case": "pipeline.case_files",
        "engine": "execution",
        "export": "pipeline.export",
        "figure": "pipeline.figure",
        "generate": "pipeline.generate",
        "import_cases": "pipeline.import_cases",
        "init": "pipeline.init",
        "make_report": "pipeline.make_report",
        "migrate": "pipeline.migrate",
        "ndd_fit": "pipeline.naturalistic",
        "ndd_import": "pipeline.naturalistic",
        "ndd_show": "pipeline.show",
        "ndd_validate": "pipeline.validate",
        "plausibility": "pipeline.plausibility",
        "query": "pipeline.cases",
        "r157": "pipeline.r157",
        "rate": "pipeline.rate",
        "read_case_file": "interchange.case_file",
        "replay": "pipeline.cases",
        "reproduce": "paper.reproduce",
        "retest": "pipeline.retest",
        "run": "pipeline.run",
        "serve": "pipeline.serve",
        "shrink": "pipeline.shrink",
        "simulate": "pipeline.simulate",
        "suite_build": "pipeline.suite",
        "train": "pipeline.train",
        "train_av": "pipeline.train_av",
        "variety": "pipeline.variety",
        "verify": "pipeline.verify",
        "write_case_file": "interchange.case_file",
    },
)
