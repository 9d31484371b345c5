"""The report: self-contained HTML pages about a run, a library or a reproduction, made from their artefacts."""

from __future__ import annotations

from cornerforge.report.page import write_library_report, write_report
from cornerforge.report.reproduction import write_reproduction

__all__ = ["write_library_report", "write_report", "write_reproduction"]
