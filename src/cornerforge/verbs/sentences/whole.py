"""Results of whole jobs as text: `init`, `run`, `report`."""

from __future__ import annotations

import shlex
from pathlib import Path

from cornerforge.results import Initialised, Reported, RunDone
from cornerforge.verbs.sentences.analysis import wrong_text
from cornerforge.verbs.sentences.numbers import ABANDONED, fault_text, paid_text, rate_text
from cornerforge.verbs.sentences.rates import doubt_text, miles_text

__all__ = ["init_text", "report_text", "run_text"]


def init_text(found: Initialised) -> str:
    """Write what was made, and how to go on."""
    folder = Path(found.files[0]).parent
    enter = "" if folder == Path() else f"cd {shlex.quote(str(folder))} && "
    return f"Wrote {', '.join(found.files)}. Go on: {enter}cornerforge run --config cornerforge.toml"


def run_text(found: RunDone) -> str:
    """Write what the AV does wrong, how often it crashes, what the adversary reaches, and where the report is."""
    doubt = doubt_text(found.natural, f"cornerforge rate --out {found.out}/natural --resume, in the same world, ")
    sorted_ = found.analyse
    kinds = "" if sorted_ is None else f"{len(sorted_.clusters)} clusters, {len(sorted_.rare)} rare cases; "
    return "\n".join(
        [
            *wrong_text(found.natural_cases, sorted_),
            rate_text(found.natural, "Natural traffic"),
            *miles_text(found.natural),
            *([] if doubt is None else [doubt]),
            rate_text(found.train, "Adversary") + paid_text(found.train, found.reward),
            *fault_text(found.train.av_faults, ABANDONED),
            f"{found.generate.cases:,} cases in {found.generate.library}; {kinds}{found.seconds:.0f} s",
            *(() if found.spending is None else (f"Not found: {text}" for text in found.spending.not_found)),
            f"Report: {found.report}",
        ]
    )


def report_text(found: Reported) -> str:
    """Write where the page is."""
    evidence = "" if found.evidence is None else f"\nEvidence: {found.evidence}; as data: {found.evidence_data}"
    return f"Report: {found.report}{evidence}"
