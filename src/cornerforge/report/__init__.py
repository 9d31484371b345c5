"""The report: self-contained HTML pages about a run, a library or a reproduction, made from their artefacts."""

from __future__ import annotations

from cornerforge.report.page import write_library_report, write_report
from cornerforge.report.r157 import R157Picture, check_r157_page, write_r157_page
from cornerforge.report.reproduction import write_reproduction

__all__ = [
    "R157Picture",
    "check_r157_page",
    "write_library_report",
    "write_r157_page",
    "write_report",
    "write_reproduction",
]
