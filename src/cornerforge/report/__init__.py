"""The report: one self-contained HTML page about a run, made from its artefacts."""

from __future__ import annotations

from cornerforge.report.page import write_report

__all__ = ["write_report"]
