"""The page of `retest`: is the new version better, and both versions side by side in the same cases, in step."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cornerforge.analysis.contact import impact_speed
from cornerforge.analysis.in_words import what_happened
from cornerforge.analysis.mechanism import contact_pose
from cornerforge.report import tables
from cornerforge.report.cases import SHOWN_S, case_data
from cornerforge.report.rendering import PLAYER, content_policy, environment, template, write_page
from cornerforge.report.text import sentence
from cornerforge.results.retest import Compared, Retested
from cornerforge.types import FRAME_S, Scenario

__all__ = ["AS_RECORDED", "NATURAL", "REACTING", "Pair", "check_page", "write_comparison"]

CASE_BYTES = 4_000_000
"""Room for trajectories on the page."""
AS_RECORDED, REACTING, NATURAL = "others as recorded", "others who react", "natural traffic"
"""The drives of a retest."""
_VERDICTS = {
    "worse": "it crashes more often (wrong at most 1 in 20 times)",
    "better": "it crashes less often (wrong at most 1 in 20 times)",
    "alike": "alike: within a factor of two (wrong at most 1 in 10 times)",
    "open": "not clear: too few tests end in a crash of one of the two only",
}
_HEADINGS = {"new": "New crashes", "still crashing": "Still crashing", "fixed": "Fixed"}


@dataclass(frozen=True)
class Pair:
    """A test as both versions drive it.

    Attributes:
        case: Case id, `seed:test`.
        kind: What became of it: "new", "still crashing" or "fixed".
        drive: How the others drive: AS_RECORDED, REACTING or NATURAL.
        old: Recording of the baseline; None: not stored, and its AV is not at hand.
        new: Recording of the AV.
    """

    case: str
    kind: str
    drive: str
    old: Scenario | None
    new: Scenario

    @property
    def crash(self) -> Scenario | None:
        """The recording that ends in a crash of the AV: the new version's, if both do."""
        return next((one for one in (self.new, self.old) if one is not None and one.partner is not None), None)

    @property
    def impact_mps(self) -> float:
        """Speed of AV and partner relative to each other at contact [m/s]; 0 without a crash."""
        return 0.0 if self.crash is None else float(impact_speed(contact_pose(self.crash)))


def check_page() -> None:
    """Check, before long work, that the page can be made.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    environment()


def write_comparison(file: Path, result: Retested, pairs: Sequence[Pair], rule: str, made: Mapping[str, Any]) -> Path:
    """Write the page, which opens from disk and asks nothing from the network.

    Args:
        file: The page.
        result: What the retest found.
        pairs: Tests to play, in reading order; tests without room at the end are left out, and the page says so.
        rule: How they were chosen, in words.
        made: How the result was made, JSON-compatible.

    Returns:
        The path of the page.

    Raises:
        MissingExtraError: jinja2 is not installed.
        OutputError: The page cannot be written.
    """
    pages = environment()
    from markupsafe import Markup

    cases, left = _cases(pairs)
    scripts = [template(PLAYER)]
    page: str = pages.get_template("comparison.html.j2").render(
        result=result,
        answer=_answer(result),
        parts=_parts(result),
        verdicts=_VERDICTS,
        cases=cases,
        at_site=any("site" in one["new"] for one in cases),
        groups={heading: [one for one in cases if one["kind"] == kind] for kind, heading in _HEADINGS.items()},
        rule=rule,
        left=left,
        provenance=tables.provenance_table(made),
        version=made["cornerforge"],
        # Marked as safe are our own files, nothing else.
        style=Markup(template("report.css")),
        scripts=[Markup(script) for script in scripts],
        policy=content_policy(scripts),
    )
    return write_page(page, file)


def _answer(result: Retested) -> str:
    """Say in one sentence whether the new version is better."""
    words = {part.verdict for part in (result.natural, result.reacting) if part is not None}
    if result.got_worse:
        if "worse" in words:
            return "No: it crashes more often."
        return "No: it crashes where the old version did not." if result.new_crashes else "No: it fails in a case."
    if "better" in words:
        return "Yes, in these tests: it crashes less often."
    if "alike" in words:
        return "Neither better nor worse: they crash about as often, within a factor of two."
    if words - {None}:
        return "Not clear yet: too few tests end in a crash of one of the two only."
    return "These cases alone cannot tell: they were picked because an AV crashed in them."


def _parts(result: Retested) -> list[tuple[str, Compared]]:
    """The drives of the retest that there are, the most telling first."""
    named = [
        ("In natural traffic", result.natural),
        ("In all tests of the library, others who react", result.reacting),
        ("In the stored cases, others as recorded", result.recorded),
    ]
    return [(name, part) for name, part in named if part is not None]


def _cases(pairs: Sequence[Pair]) -> tuple[list[dict[str, Any]], int]:
    """The pairs that fit on the page as JSON values, and how many do not."""
    kept: list[dict[str, Any]] = []
    size = 0
    for pair in pairs:
        data = _pair_data(pair)
        size += len(json.dumps(data, separators=(",", ":")))
        if size > CASE_BYTES and kept:
            break
        kept.append(data | {"order": len(kept)})
    return kept, len(pairs) - len(kept)


def _pair_data(pair: Pair) -> dict[str, Any]:
    """Data of a pair for the player: both recordings on one clock, and what happened in words."""
    sides = {"old": pair.old, "new": pair.new}
    shown = {side: scenario for side, scenario in sides.items() if scenario is not None}
    # One clock: both begin with the same frame, so that at most SHOWN_S of the shorter one are kept.
    first = max(0, min(len(one.x) for one in shown.values()) - 1 - round(SHOWN_S / FRAME_S))
    crash = pair.crash
    partner = None if crash is None or crash.crash is None else crash.crash.slot_b
    data = {side: _side(pair.case, scenario, first, partner) for side, scenario in shown.items()}
    for side, other in (("old", "new"), ("new", "old")):
        if side in data and other in data:
            data[side]["wayOut"] = data[other]["vehicles"][0]  # drawn as an outline
    contacts = [one["crash"] for one in data.values() if one["crash"] is not None]
    happened = "" if crash is None else sentence(what_happened(crash))
    ends = {side: _end(scenario) for side, scenario in sides.items()}
    return {
        "id": pair.case if pair.drive != NATURAL else f"natural/{pair.case}",
        "kind": pair.kind,
        "drive": pair.drive,
        "title": f"Case {pair.case}: {pair.kind} ({pair.drive})",
        "verdict": f"{happened[:1].upper()}{happened[1:]}." if happened else "",
        "happened": happened,
        "impact": round(pair.impact_mps, 1),
        "ends": ends,
        "dt": FRAME_S,
        "first": first,
        "frames": max(one["frames"] for one in data.values()),
        "crash": min(contacts, default=None),
        "old": data.get("old"),
        "new": data["new"],
    }


def _side(case: str, scenario: Scenario, first: int, partner: int | None) -> dict[str, Any]:
    """One version's recording, with the other version's crash partner in its colour and no controlled vehicle."""
    data = case_data(case, scenario, first=first)
    slots = [vehicle["slot"] for vehicle in data["vehicles"]]
    if data["partner"] < 0:
        data |= {"crash": None, "partner": slots.index(partner) if partner in slots else -1}
    return data | {"critical": [], "action": [], "p_nde": [], "ttc": [], "ttcPlane": []}


def _end(scenario: Scenario | None) -> str:
    """Say how a version's test ended."""
    if scenario is None:
        return "did not crash; its drive is not stored"
    crash = scenario.crash
    if crash is None:
        return "does not crash"
    if crash.slot_a != 0:
        return (
            f"does not crash; BV {crash.slot_a} and BV {crash.slot_b} do after {crash.time:.1f} s, which ends the test"
        )
    return f"crashes with BV {crash.slot_b} after {crash.time:.1f} s"
