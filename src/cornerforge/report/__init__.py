"""The report: self-contained HTML pages about a run or a library, made from their artefacts."""

from __future__ import annotations

from cornerforge.report.page import write_library_report, write_report

__all__ = ["write_library_report", "write_report"]
