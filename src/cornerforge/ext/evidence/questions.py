"""The ten questions of an assessor, and the clauses that ask them (docs/adr/0082-evidence.md)."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["QUESTIONS", "Question"]


class Question(NamedTuple):
    """A question, and the clauses that ask it."""

    asks: str
    clauses: tuple[str, ...]


_EU = "Regulation (EU) 2022/1426"
_ADS = "UN Regulation and GTR on ADS (drafts of 2026)"
_34505 = "ISO 34505:2025"
_R157 = "UN Regulation 157"

QUESTIONS = (
    Question(
        "In which operational design domain was it tested, and what of it was not?",
        (f"{_34505}, 5.4 (scenarios and ODD)", f"{_ADS}, 8.3.2.1.2 (coverage)", f"{_EU}, Annex III Part 1 *"),
    ),
    Question(
        "How often do the scenarios happen on the road?",
        (f"{_34505}, 1 (frequency as a criterion)", "ISO 34502:2022, reasonably foreseeable scenarios *"),
    ),
    Question(
        "How critical are they?",
        (f"{_34505}, 1 (criticality as a criterion)", f"{_R157}, Annex 4 Appendix 3 *"),
    ),
    Question("How complex are they?", (f"{_34505}, 1 (complexity as a criterion)",)),
    Question(
        "How often does it crash, how badly, and how sure is that?",
        (f"{_EU}, Annex II 7.1.1 (acceptance criteria) *", "ISO 21448:2022, validation targets *", f"{_ADS}, 6.1.2.1"),
    ),
    Question(
        "Would a competent and careful driver have crashed?",
        (f"{_ADS}, 3.2.3 (b)", f"{_R157}, Annex 4 Appendix 3 *", f"{_EU}, Annex III Part 1 Appendix 1 *"),
    ),
    Question(
        "How were hazards searched that were not known, and how many may be left?",
        ("ISO 21448:2022, unknown hazardous scenarios *", f"{_34505}, 5.2 (set of scenarios)"),
    ),
    Question(
        "Why is the simulation to be believed?",
        (f"{_EU}, Annex III Part 4 (credibility of the toolchain) *", f"{_ADS}, testing and credibility framework"),
    ),
    Question(
        "Can each claim be traced and made again?",
        (f"{_EU}, Annex III Part 4 (management of models and releases) *", f"{_34505}, 1 (traceable test cases)"),
    ),
    Question(
        "What was not tested, and is the new version better than the one before?",
        (f"{_ADS}, 8.3.3.1 (confirmatory tests)", f"{_34505}, 1 (optimized sets of prioritized cases)"),
    ),
)
"""A clause with * is named from memory, not read; the others were read in part, in accounts of committees and
publishers."""
