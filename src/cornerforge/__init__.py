"""cornerforge: how an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.

This package has the verbs of the command line as functions of the same names. Each returns what `--json` prints, most
of them as a dataclass of `cornerforge.results`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.ext.calibrate.naturalistic import ndd_fit, ndd_import
    from cornerforge.ext.calibrate.show import ndd_show
    from cornerforge.ext.calibrate.site_fit import site_fit
    from cornerforge.ext.calibrate.site_validating import site_validate
    from cornerforge.ext.calibrate.validating import ndd_validate
    from cornerforge.ext.explorer.serve import serve
    from cornerforge.ext.interchange.export import export
    from cornerforge.ext.interchange.from_data import cases_from_data
    from cornerforge.ext.interchange.import_cases import import_cases
    from cornerforge.ext.interchange.roads import road_check, road_import, road_show
    from cornerforge.ext.interchange.sites import site_check, site_import, site_show
    from cornerforge.ext.paper.reproduce import reproduce
    from cornerforge.ext.pictures.figure import figure
    from cornerforge.ext.studies.plausibility import plausibility
    from cornerforge.ext.studies.suite import suite_build
    from cornerforge.ext.studies.suite_run import r157, suite_run
    from cornerforge.ext.studies.variety import variety
    from cornerforge.library.case_file import read_case_file, write_case_file
    from cornerforge.verbs.analyse import analyse
    from cornerforge.verbs.avs import avs
    from cornerforge.verbs.cases import query, replay
    from cornerforge.verbs.check_av import check_av
    from cornerforge.verbs.drive_case import drive_case
    from cornerforge.verbs.generate import generate
    from cornerforge.verbs.init import init
    from cornerforge.verbs.make_report import make_report
    from cornerforge.verbs.rate import rate
    from cornerforge.verbs.retest import retest
    from cornerforge.verbs.run import run
    from cornerforge.verbs.shrink import shrink
    from cornerforge.verbs.simulate import simulate
    from cornerforge.verbs.train import train
    from cornerforge.verbs.train_av import train_av
    from cornerforge.work import engine

__all__ = [
    "__version__", "analyse", "avs", "cases_from_data", "check_av", "drive_case", "engine", "export", "figure",
    "generate", "import_cases", "init", "make_report", "migrate", "ndd_fit", "ndd_import", "ndd_show", "ndd_validate",
    "plausibility", "query", "r157", "rate", "read_case_file", "replay", "reproduce", "retest", "road_check",
    "road_import", "road_show", "run", "serve", "shrink", "simulate", "site_check", "site_fit", "site_import",
    "site_show", "site_validate", "suite_build", "suite_run", "train", "train_av", "variety", "verify",
    "write_case_file",
]  # fmt: skip

__version__ = "0.1.0"

__getattr__ = door(
    "cornerforge",
    {
        "analyse": "verbs.analyse",
        "avs": "verbs.avs",
        "cases_from_data": "ext.interchange.from_data",
        "check_av": "verbs.check_av",
        "drive_case": "verbs.drive_case",
        "engine": "work",
        "export": "ext.interchange.export",
        "figure": "ext.pictures.figure",
        "generate": "verbs.generate",
        "import_cases": "ext.interchange.import_cases",
        "init": "verbs.init",
        "make_report": "verbs.make_report",
        "migrate": "verbs.migrate",
        "ndd_fit": "ext.calibrate.naturalistic",
        "ndd_import": "ext.calibrate.naturalistic",
        "ndd_show": "ext.calibrate.show",
        "ndd_validate": "ext.calibrate.validating",
        "plausibility": "ext.studies.plausibility",
        "query": "verbs.cases",
        "r157": "ext.studies.suite_run",
        "rate": "verbs.rate",
        "read_case_file": "library.case_file",
        "replay": "verbs.cases",
        "reproduce": "ext.paper.reproduce",
        "retest": "verbs.retest",
        "road_check": "ext.interchange.roads",
        "road_import": "ext.interchange.roads",
        "road_show": "ext.interchange.roads",
        "site_check": "ext.interchange.sites",
        "site_fit": "ext.calibrate.site_fit",
        "site_import": "ext.interchange.sites",
        "site_show": "ext.interchange.sites",
        "site_validate": "ext.calibrate.site_validating",
        "run": "verbs.run",
        "serve": "ext.explorer.serve",
        "shrink": "verbs.shrink",
        "simulate": "verbs.simulate",
        "suite_build": "ext.studies.suite",
        "suite_run": "ext.studies.suite_run",
        "train": "verbs.train",
        "train_av": "verbs.train_av",
        "variety": "ext.studies.variety",
        "verify": "verbs.verify",
        "write_case_file": "library.case_file",
    },
)


def __dir__() -> list[str]:
    """List what this package offers, also what is not loaded yet."""
    return __all__
