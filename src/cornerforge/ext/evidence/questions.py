"""The ten questions of an assessor, and the clauses that ask them (docs/adr/0082-evidence.md)."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["QUESTIONS", "Question"]


class Question(NamedTuple):
    """A question, and the clauses that ask it."""

    asks: str
    clauses: tuple[str, ...]


_EU = "Regulation (EU) 2022/1426:"
_UNR = "UN Regulation on ADS (draft),"
_GTR = "UN GTR on ADS (draft),"
_34505 = "ISO 34505:2025,"
_21448 = "ISO 21448:2022,"
_R157 = "UN Regulation 157,"

QUESTIONS = (
    Question(
        "In which operational design domain was it tested, and what of it was not?",
        (
            f"{_EU} Annex II 1.1.1, 3.1.4; Annex III Part 1 1.1, 2.1; Part 2 3.3.3; Part 4 3.2.6.3 (a)",
            f"{_UNR} 8.3.2.1.1, 8.3.2.1.2 (coverage) [account]",
            f"{_34505} 5.2, 5.4 (set of scenarios; scenarios and ODD) [contents]",
        ),
    ),
    Question(
        "How often do the scenarios happen on the road?",
        (
            f"{_EU} Article 2 (19), (20); Annex III Part 1 2.3, 2.4, Appendix 1 points 1, 5",
            f"{_R157} 5.1.1 (reasonably foreseeable)",
            f"{_34505} 1 (frequency as a criterion)",
        ),
    ),
    Question(
        "How critical are they?",
        (
            f"{_EU} Article 2 (32); Annex III Part 1 1.3.2, 1.4.1, 1.4.2 (TTC at a cut-in); Part 3 8.8",
            f"{_R157} 5.2.5",
            f"{_GTR} 4.1.3 (critical situations) [account]",
            f"{_34505} 1 (criticality as a criterion)",
        ),
    ),
    Question(
        "How complex are they?",
        (
            f"{_34505} 1 (complexity as a criterion); 5 (evaluation of scenarios) [contents]",
            f"{_EU} Annex III Part 2 3.5.5.3 (iii) (challenging scenarios)",
        ),
    ),
    Question(
        "How often does it crash, how badly, and how sure is that?",
        (
            f"{_EU} Annex I 17.7.5 (uncertainty); Annex II 7.1, 7.1.1 and its footnote (an indicative 1e-7 fatalities "
            "per hour); Annex III Part 2 3.5.5.4.1 (a), (b)",
            f"{_UNR} 6.1.2.1 [account]",
            f"{_GTR} 3.2 (no unreasonable risk) [account]",
            f"{_21448} 6.5 (acceptance criteria), Annex C [contents]",
            "UL 4600, 16.1.1.6.1 [account]",
        ),
    ),
    Question(
        "Would a competent and careful driver have crashed?",
        (
            f"{_EU} Annex II 1.1.3, 7.1.1; Annex III Part 1 1.4.1, 1.4.2",
            f"{_R157} 5.1.1, 5.2.5; its guidance on a careful driver, Annex 4 Appendix 3, is Annex 3 since the 01 "
            "series [account]",
            f"{_UNR} 3.2.3 (b) [account]",
        ),
    ),
    Question(
        "How were hazards searched that were not known, and how many may be left?",
        (
            f"{_EU} Annex III Part 1 2.1, 2.4; Part 2 3.5.5.2 (b); Part 5 2.3 (c)",
            f"{_21448} 4.2.2 (four areas of scenarios), 7.3 (triggering conditions) [contents]; 9 to 11 *",
            f"{_34505} 5.2 (set of scenarios) [contents]",
        ),
    ),
    Question(
        "Why is the simulation to be believed?",
        (
            f"{_EU} Annex III Part 4 1.4, 3.1, 3.2.5.2 to 3.2.6.4, 3.3.2 to 3.3.5, 3.4.2 to 3.4.5.9; Part 2 4.2",
            f"{_R157} Annex 4 4.2",
            f"{_GTR} 5.2.1, 6.2.1 (test environments) [account]",
            "ISO 34502:2022, Annex F [contents]",
            "UL 4600, 13.2.1 [account]",
        ),
    ),
    Question(
        "Can each claim be traced and made again?",
        (
            f"{_EU} Annex II 8.2.1, 9.4; Annex III Part 2 3.1.1, 6.1; Part 3 7; Part 4 3.2.1 to 3.2.3.2, 4.2 to 4.5",
            f"{_GTR} 5.2.1, 6.3 (safety case) [account]",
            f"{_UNR} 8.3.3.1.1 [account]",
        ),
    ),
    Question(
        "What was not tested, and is the new version better than the one before?",
        (
            f"{_EU} Annex III Part 1 1.1; Part 2 4.2 and Part 3 8 (approval may not rest on simulation alone)",
            f"{_UNR} 7.3.2.14, 8.3.3.1 (confirmatory tests) [account]",
            f"{_34505} 7, 8 [contents]",
        ),
    ),
)
"""Clauses without a mark were read in the document's own text. [contents]: only its contents page was; [account]: what
committees or others say of it; *: named from memory."""
