"""The page of evidence: its numbers are those of the run, its gaps are named, and foreign results are refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from edited_files import write_object
from plain_results import plain_result

import cornerforge
from cornerforge.errors import FileFormatError, InputError
from cornerforge.ext.evidence.kinds import complexity
from cornerforge.ext.evidence.material import SHIPPED, Checks
from cornerforge.ext.evidence.odd import odd_as_tested
from cornerforge.ext.evidence.questions import QUESTIONS
from cornerforge.ndd.model import default_model_path, load_model, model_hash
from cornerforge.perception import Perception
from cornerforge.recordings import recordings_of
from cornerforge.results import NaturalRate, Regulated, as_json, from_json
from cornerforge.results.driving import Cost, ModelUncertainty
from cornerforge.results.evidence import Evidence
from cornerforge.results.stating import from_file
from cornerforge.types import Crash, Odd, Scenario


def three_vehicles(brakes: float, leaves: float, far: float) -> Scenario:
    """A rear-end crash: slot 1 ahead of the AV brakes, slot 2 leaves its lane by `leaves` at `far` m ahead."""
    frames, n = 61, 3
    time = np.linspace(0.0, 6.0, frames)
    x = np.stack([30.0 * time, 40.0 + 24.0 * time, far + 30.0 * time], axis=1)
    y = np.full((frames, n), 5.49)
    y[:, 2] += leaves * np.clip(time - 2.0, 0.0, 1.0)
    acceleration = np.zeros((frames, n))
    acceleration[30:, 1] = brakes
    speed = np.tile([30.0, 24.0, 30.0], (frames, 1))
    return Scenario(
        seed=0, test=1, odd=Odd(), slot=np.arange(n, dtype=np.int16), x=x, y=y, speed=speed,
        heading=np.zeros((frames, n)), acceleration=acceleration, target_lane=np.ones((frames, n), np.int8),
        present=np.ones((frames, n), np.bool_), action=np.full((7, n), -1, np.int8),
        critical_bv=np.ones(7, np.int16), log_prob_nde=np.zeros(7), crash=Crash(6.0, 0, 1), shortfall=np.zeros(7),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("brakes", "leaves", "far", "involved", "acts"),
    [
        (0.0, 0.0, 60.0, 2, 0),
        (-2.5, 0.0, 60.0, 2, 1),
        (-2.5, 3.66, 60.0, 3, 2),
        (-2.5, 0.9, 60.0, 2, 1),
        (-2.5, 3.66, 150.0, 2, 1),
    ],
)
def test_who_takes_part_is_counted_by_hand(brakes: float, leaves: float, far: float, involved: int, acts: int) -> None:
    found = complexity(recordings_of(three_vehicles(brakes, leaves, far)))
    assert (found[0].tolist(), found[1].tolist()) == ([involved], [acts])


def evidence(folder: Path, beside: tuple[Path, ...] = ()) -> tuple[Evidence, str]:
    made = cornerforge.make_report(folder, evidence=True, beside=beside)
    assert made.evidence is not None
    assert made.evidence_data is not None
    data: dict[str, Any] = json.loads(Path(made.evidence_data).read_text(encoding="utf-8"))
    data.pop("sha256")
    return from_json(Evidence, data), Path(made.evidence).read_text(encoding="utf-8")


def test_each_question_has_an_answer_or_says_why_not(natural_run_folder: Path) -> None:
    found, page = evidence(natural_run_folder)
    assert [one.number for one in found.answers] == list(range(1, 11))
    for one in found.answers:
        assert one.asked_by
        assert one.covered == bool(one.findings)
        assert one.covered or (one.answer.startswith("Not covered, because ") and one.not_covered)
        assert all(claim.how and claim.command for claim in one.findings)
        assert one.answer.split("'")[0] in page
    assert "complian" not in page.lower()


def test_a_clause_that_was_not_read_is_marked_and_the_page_says_how(natural_run_folder: Path) -> None:
    """What ISO sells was not at hand but for clause 1, nor the UN's drafts; the EU's law was."""
    clauses = [clause for question in QUESTIONS for clause in question.clauses]
    for clause in clauses:
        marked = [mark for mark in ("[contents]", "[account]", "*") if mark in clause]
        if clause.startswith("Regulation (EU)"):
            assert not marked
        elif "(draft)" in clause:
            assert marked == ["[account]"]
        elif clause.startswith("ISO"):
            assert "[contents]" in marked or clause.split(", ")[1].startswith("1 (")
    assert all(any(one.startswith("Regulation (EU)") for one in question.clauses) for question in QUESTIONS)
    _, page = evidence(natural_run_folder)
    assert all(mark in page for mark in ("[contents]", "[account]", "with * are named from memory", "2026/481"))


def test_its_numbers_are_those_of_the_run(natural_run_folder: Path) -> None:
    found, _ = evidence(natural_run_folder)
    summary = json.loads((natural_run_folder / "summary.json").read_text(encoding="utf-8"))
    often = found.answers[4].findings[0]
    per_mile, ends = summary["natural"]["crashes_per_mile"], summary["natural"]["interval95_per_mile"]
    assert often.value == pytest.approx(1e6 * per_mile)
    assert often.interval95 == pytest.approx([1e6 * end for end in ends])
    assert sum(one.per_million_miles for one in found.kinds) == pytest.approx(1e6 * per_mile)
    assert sum(one.cases for one in found.kinds) == 30
    assert any("not to be trusted" in gap.lower() for gap in found.answers[4].not_covered)
    assert found.answers[6].findings[0].value == summary["generate"]["crashes_per_test"]


def drawn_rate(av: str) -> NaturalRate:
    cost = Cost(tests=1, cpu_seconds=1.0)
    spread = plain_result(
        ModelUncertainty, draws=20, cv=0.5, cv_interval95=(0.3, 0.9), interval95=(1e-7, 9e-7),
        interval95_per_mile=(4e-7, 3.6e-6), cost=cost,
    )  # fmt: skip
    return replace(
        plain_result(
            NaturalRate, av=av, method="splitting", crashes_per_test=3e-7, interval95=(1e-7, 5e-7),
            crashes_per_mile=1.2e-6, interval95_per_mile=(4e-7, 2e-6),
        ),
        model_uncertainty=spread,
    )  # fmt: skip


def test_drawn_models_beside_give_an_interval_of_chance_and_model(natural_run_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "rate").mkdir()
    write_object(tmp_path / "rate" / "rate.json", as_json(drawn_rate("idm-mobil")))
    found, _ = evidence(natural_run_folder, (tmp_path / "rate",))
    (claim,) = [one for one in found.answers[4].findings if one.covers == "chance and model"]
    assert claim.interval95 == pytest.approx((0.4, 3.6))
    assert str(tmp_path / "rate" / "rate.json") in found.files


def test_a_suite_beside_is_told_and_people_are_held_against_serious_injuries(
    natural_run_folder: Path, tmp_path: Path
) -> None:
    suite = plain_result(
        Regulated, suite="aeb", av="idm-mobil", scenarios=477, failed=130, failed_but_prevented_by_all=3
    )
    write_object(tmp_path / "suite.json", as_json(suite))
    found, _ = evidence(natural_run_folder, (tmp_path / "suite.json",))
    assert any("fails in 130 of 477 scenarios of the suite aeb" in one.said for one in found.answers[5].findings)
    assert not any("suite run aeb" in gap for gap in found.answers[5].not_covered)
    assert any("suite run r157" in gap for gap in found.answers[5].not_covered)
    serious = next(one for one in found.answers[4].findings if "MAIS 3" in one.said)
    phoenix = next(one for one in found.answers[4].findings if "freeways of Phoenix" in one.said)
    assert serious.value is not None
    assert phoenix.value == pytest.approx(serious.value / 0.7, rel=0.2)  # as so many whole events as give its interval
    germany = next(one for one in found.answers[4].findings if "freeways of Germany" in one.said)
    assert phoenix.value is not None
    assert germany.value == pytest.approx(phoenix.value * 0.7 / 0.011646)


def test_serious_injuries_stand_beside_the_indicative_criterion_of_the_eu(natural_run_folder: Path) -> None:
    """1e-7 per hour with a confidence of 95 %: 3.0e7 hours without a death; 40 m/s are 89.5 miles per hour."""
    found, _ = evidence(natural_run_folder)
    serious, hourly = (next(one for one in found.answers[4].findings if what in one.said) for what in ("MAIS 3", "EU"))
    assert serious.value is not None
    assert serious.interval95 is not None
    assert hourly.value == pytest.approx(serious.value * 1e-6 * 89.477, rel=1e-4)
    assert hourly.interval95 == pytest.approx([end * 1e-6 * 89.477 for end in serious.interval95], rel=1e-4)
    assert "3.0 × 10⁷ hours without a death, at that speed 2.7 billion miles" in hourly.said


def test_results_of_another_av_and_no_results_are_refused(natural_run_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "rate").mkdir()
    write_object(tmp_path / "rate" / "rate.json", as_json(drawn_rate("rss-cautious")))
    with pytest.raises(InputError, match="of rss-cautious, the run of idm-mobil"):
        evidence(natural_run_folder, (tmp_path / "rate",))
    with pytest.raises(InputError, match="holds none of"):
        evidence(natural_run_folder, (tmp_path / "empty",))
    (tmp_path / "retest.json").write_text("[1]")
    with pytest.raises(FileFormatError, match=r"retest\.json"):
        evidence(natural_run_folder, (tmp_path / "retest.json",))
    with pytest.raises(InputError, match="give both"):
        cornerforge.make_report(natural_run_folder, beside=(tmp_path,))


def test_what_is_not_in_the_simulator_is_said_to_be_untested() -> None:
    rows = {row.attribute: row.driven for row in odd_as_tested(Odd(truck_share=0.1))}
    assert rows["Perception of the AV"].startswith("perfect")
    seen = {row.attribute: row.driven for row in odd_as_tested(Odd(perception=Perception(latency=0.2)))}
    assert seen["Perception of the AV"] == "imperfect, by a stated law: latency=0.2"
    assert "trucks (10.0 %)" in rows["Vehicles"]
    assert rows["Weather and visibility"] == rows["Light"] == ""


def test_the_shipped_checks_are_of_the_shipped_model() -> None:
    """Else run `make validation`."""
    shipped = from_file(Checks, Path(str(SHIPPED)), "make validation")
    assert shipped.model_hash == model_hash(load_model(default_model_path()))
    assert sum(fact.within is not None for fact in shipped.facts) > 100
