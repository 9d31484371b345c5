"""The first screen: what it says in each situation, and that its numbers are those of the rest of the page."""

from __future__ import annotations

import itertools
import json
import re
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from edited_files import write_object
from html_page import CHROMIUM, Page, browse, needs_browser
from plain_results import plain_result

from cornerforge._table_checks import write_parquet
from cornerforge.analysis.flaw import FLAWS
from cornerforge.analysis.prevented import PREVENTION
from cornerforge.report import front, write_report
from cornerforge.report.artefacts import Summary, read_artefacts
from cornerforge.report.front import Front, front_of
from cornerforge.report.kinds import kind_in_words
from cornerforge.report.page import known_of
from cornerforge.report.road import road_rate
from cornerforge.report.text import miles, rate, share
from cornerforge.results import NaturalRate, Simulated, as_json


def told(page: Page) -> str:
    """The text of a page with single spaces."""
    return " ".join(page.text.split())


def summary_of(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the summary of a run."""
    file = folder / "summary.json"
    values = json.loads(file.read_text(encoding="utf-8"))
    change(values)
    write_object(file, values)


def judge(folder: Path, prevention: str) -> None:
    """Give all natural cases of a run the same judgement."""
    file = folder / "natural" / "analysis" / "cases.parquet"
    table = pq.read_table(file)
    n = table.num_rows
    table = table.set_column(table.column_names.index("prevention"), "prevention", pa.array([prevention] * n))
    write_parquet(file, table)


def front_in(folder: Path) -> Front:
    return front_of(known_of(read_artefacts(folder)))


@pytest.mark.full
def test_the_case_to_watch_first_is_of_the_most_frequent_kind_that_a_careful_driver_prevents(
    natural_run_folder: Path,
) -> None:
    known = known_of(read_artefacts(natural_run_folder))
    assert known.cases is not None
    assert known.kinds is not None
    sums: dict[str, float] = {}
    prevented = np.isin(known.cases.prevention, PREVENTION[:2])
    for kind, weight, counts in zip(known.cases.mechanism, known.cases.weight, prevented, strict=True):
        sums[kind] = sums.get(kind, 0.0) + weight * counts
    most = max(sums, key=lambda kind: sums[kind])
    assert 0.0 < sums[most] < known.cases.weight.sum()
    look = front_of(known).look
    assert look is not None
    row = known.cases.case_id.index(look.case_id)
    assert known.cases.mechanism[row] == most
    assert prevented[row]
    assert look.is_natural
    assert look.title == kind_in_words(most)
    assert look.often == f"once in {miles(known.kinds.mechanisms[most].miles_between)}"
    assert "that a careful driver would have prevented; in this case" in look.why
    page = Page(write_report(natural_run_folder))
    first = [case for case in page.data("cases") if case["watchFirst"]]
    assert [case["id"] for case in first] == [f"natural/{look.case_id}"]
    assert f"Watch this first {look.title}" in told(page)
    assert f"This kind of crash happens {look.often} (95 %:" in told(page)


def test_how_many_of_a_kind_are_prevented_is_said_with_their_own_rate(natural_run_folder: Path) -> None:
    known = known_of(read_artefacts(natural_run_folder))
    assert known.cases is not None
    assert known.kinds is not None
    rows = np.flatnonzero(
        np.array(known.cases.mechanism) == max(known.kinds.mechanisms, key=known.cases.mechanism.count)
    )
    two = np.full(known.cases.prevention.shape, "nobody", "U40")
    two[rows[:2]] = PREVENTION[:2]
    look = front_of(replace(known, cases=replace(known.cases, prevention=two))).look
    assert look is not None
    kind = known.kinds.mechanisms[known.cases.mechanism[rows[0]]]
    part = kind.miles_between * kind.crashes_per_test / known.cases.weight[rows[:2]].sum()
    assert rows.size == kind.cases > 2
    assert f"That is 2 of these {kind.cases} crashes: once in {miles(part)} (95 %:" in look.why


def test_where_the_av_began_it_it_says_so(natural_run_folder: Path) -> None:
    judge(natural_run_folder, PREVENTION[1])
    found = front_in(natural_run_folder)
    assert found.look is not None
    assert found.look.is_natural
    assert found.look.why.endswith("in this case by not beginning what the AV began.")
    assert found.answers[2].short == "In 100 % of them"
    assert "(95 %: 88.4 to 100 %; n = 30 natural crashes;" in found.answers[2].text
    assert "0 % by braking, 100 % by leaving out what the AV began." in found.answers[2].text


def test_where_nobody_prevents_it_says_so(natural_run_folder: Path) -> None:
    judge(natural_run_folder, "nobody")
    found = front_in(natural_run_folder)
    assert found.look is not None
    assert found.look.why.endswith("A careful driver would have prevented none.")
    assert found.answers[2].short == "None of them"


def test_without_natural_crashes_it_shows_the_most_valuable_of_the_adversary(run_folder: Path) -> None:
    known = known_of(read_artefacts(run_folder))
    top = known.analysis.value.top[0]
    found = front_of(known)
    assert found.look is not None
    assert (found.look.case_id, found.look.is_natural, found.look.often) == (top.case_id, False, "")
    assert "how often it happens is not known" in found.look.why
    flaw = known.analysis.own_doing.flaws[0] if known.analysis.own_doing is not None else None
    assert flaw is not None
    assert found.answers[0].short == f"It {FLAWS[flaw.flaw]}"
    assert f"{flaw.cases} of n = 60" in found.answers[0].text
    assert "crashes that an adversary caused" in found.answers[0].text
    assert found.answers[1].short == f"Once in {miles(1 / 1.8e-5)}"
    assert known.analysis.judges is not None
    lead = known.analysis.judges.lead
    assert known.analysis.prevented is not None
    assert known.analysis.prevented.careful is not None
    assert found.answers[2].short == f"In {share(known.analysis.prevented.careful.share)} of them"
    assert f"led to it began could have avoided {100 * lead.share:.1f} % (" in found.answers[2].text
    assert "n = 60 crashes that an adversary caused" in found.answers[2].text
    only = front_of(replace(known, road=None))
    assert only.answers[1].short == "Not known"
    assert "An adversary made these crashes" in only.answers[1].text
    assert only.look is not None
    assert only.look.why.startswith("No natural crash is known.")


def test_without_a_judgement_it_says_that_nobody_looked(run_folder: Path) -> None:
    known = known_of(read_artefacts(run_folder))
    bare = replace(known.analysis, judges=None, prevented=None, own_doing=None)
    found = front_of(replace(known, analysis=bare))
    assert [answer.short for answer in found.answers][::2] == ["Nobody has looked", "Nobody has looked"]
    braking = front_of(replace(known, analysis=replace(known.analysis, judges=None)))
    assert "% by braking, " in braking.answers[2].text
    ways = front_of(replace(known, analysis=replace(known.analysis, prevented=None)))
    assert ways.answers[2].short.endswith("could have been avoided")


def test_no_crash_in_so_many_miles(run_folder: Path) -> None:
    nde = plain_result(Simulated, tests=2_000_000, interval95=(0.0, 1.84e-6), crashes_per_mile=0.0, miles=497_000.0)
    summary_of(run_folder, lambda values: values.update(nde=as_json(nde)))
    answer = front_in(run_folder).answers[1]
    assert answer.short == "No crash seen in 500 thousand miles"
    # 497 000 / (2e6 * 1.84e-6) = 135 054, of which no more is known than 130 thousand
    assert answer.text == "so less than once in 130 thousand miles (95 %; 0 crashes in n = 2,000,000 simulated drives)."
    text = told(Page(write_report(run_folder)))
    assert text.count("less than once in 130 thousand miles") == 2, "in front and in its section"


def test_one_rate_everywhere(natural_run_folder: Path) -> None:
    text = told(Page(write_report(natural_run_folder)))
    # 1 / 1.2e-6 miles, 1 / 2e-6, 1 / 4e-7
    often = "Once in 500 thousand miles to 2.5 million miles it touches another vehicle in natural traffic"
    assert often in text, "a rate in doubt is told as its interval"
    assert "(95 %; best estimate: once in 830 thousand miles; from n = " in text
    assert (
        "In natural traffic this AV touches another vehicle once in 830 thousand miles "
        "(95 %: 500 thousand miles to 2.5 million" in text
    )
    assert "all crashes30100 %830 thousand miles500 thousand miles to 2.5 million miles" in text
    assert text.count("n = 150,000 drives that branch where danger rises, which tell as much as 30 crashes") == 2
    assert text.count("it rests on 30 effective trees, fewer than 300") == 1
    assert "Not to be trusted yet: why" in text
    known = known_of(read_artefacts(natural_run_folder))
    kinds = known.kinds
    assert kinds is not None
    for kind in kinds.mechanisms.values():
        assert kind.miles_between == pytest.approx(kinds.all.miles_between / kind.share, rel=1e-9)
        assert miles(kind.miles_between) in text
    judged = pq.read_table(natural_run_folder / "natural" / "analysis" / "cases.parquet")
    chance = np.asarray(judged["av_injury_probability"], np.float64)
    assert known.cases is not None
    weight = dict(zip(known.cases.case_id, known.cases.weight, strict=True))
    weights = np.array([weight[name] for name in judged["case_id"].to_pylist()])
    serious = 1.2 * float((weights * chance).sum() / weights.sum())
    assert kinds.serious_injuries.miles_between == pytest.approx(1e6 / serious, rel=1e-9)
    assert f"by delta-v): {' '.join(rate(serious, 2).split())} per million miles (95 %: " in text


@pytest.mark.parametrize(
    ("natural", "plain", "expected"),
    [
        (0.0, 0.0, "natural"),
        (3e-7, 0.0, "natural"),
        (0.0, 1e-4, "plain"),
        (3e-7, 1e-4, "natural"),
    ],
)
def test_the_rate_is_the_better_known_of_the_two(natural: float, plain: float, expected: str) -> None:
    def ends(rate: float) -> tuple[float, float]:
        return (rate / 2, 2 * rate) if rate else (0.0, 1e-5)

    trees = plain_result(
        NaturalRate, method="splitting", tests=300_000, plain_tests=300_000, crashes_per_test=natural,
        interval95=ends(natural), crashes_per_mile=4 * natural, miles=75_000.0, effective_sample_size=30,
    )  # fmt: skip
    counted = plain_result(
        Simulated, tests=200_000, crashes_per_test=plain, interval95=ends(plain), crashes_per_mile=4 * plain,
        miles=50_000.0,
    )  # fmt: skip
    summary = Summary(av="x", nde=counted, natural=trees)
    assert summary.natural_rate is (trees if expected == "natural" else counted)
    road = road_rate(summary)
    assert road is not None
    rate = natural if expected == "natural" else plain
    assert road.miles == (pytest.approx(1 / (4 * rate)) if rate else None)
    assert road.low == pytest.approx(0.25 / ends(rate)[1])
    assert road_rate(Summary(av="x")) is None


def test_a_share_with_weights_is_that_of_the_road(natural_run_folder: Path) -> None:
    known = known_of(read_artefacts(natural_run_folder))
    assert known.cases is not None
    some = np.arange(known.cases.weight.size) < 3
    cases = replace(known.cases, prevention=np.where(some, PREVENTION[0], PREVENTION[4]))
    weight = np.where(some, 1e-9, 1e-8)
    heavy = replace(cases, weight=weight)
    share = front._natural_share(heavy, some)
    assert share.share == pytest.approx(weight[some].sum() / weight.sum())
    assert share.low <= share.share <= share.high
    assert f"{100 * share.share:.1f} % by braking, " in front_of(replace(known, cases=heavy)).answers[2].text


def test_it_fits_without_private_words(natural_run_folder: Path) -> None:
    found = front_in(natural_run_folder)
    assert found.look is not None
    words = [found.look.title, found.look.why, *(f"{one.question} {one.short} {one.text}" for one in found.answers)]
    assert all(len(text) < 420 for text in words), "the first screen holds no more"
    for private in ("BV", "NDE", "yield", "nats", "shard", "library", "ODD", "trees"):
        assert not [text for text in words if re.search(rf"\b{private}\b", text)], private


@pytest.mark.full
def test_everything_has_a_name(natural_run_folder: Path) -> None:
    page = Page(write_report(natural_run_folder))
    text = write_report(natural_run_folder).read_text(encoding="utf-8")
    canvases = [attributes for tag, attributes in page.tags if tag == "canvas"]
    assert len(canvases) > 10
    assert all(one.get("aria-label") or one.get("aria-hidden") == "true" for one in canvases)
    assert all(
        one.get("aria-label") for tag, one in page.tags if tag == "input" or one.get("role") in ("img", "region")
    )
    buttons = re.findall(r"<button[^>]*>(.*?)</button>", text, flags=re.S)
    names = [re.sub(r"<[^>]*>", "", inner).strip() for inner in buttons]
    assert len(names) > 10
    assert all(names)
    assert [tag for tag, _ in page.tags if tag == "h1"] == ["h1"]
    headings = [int(tag[1]) for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
    assert all(after <= before + 1 for before, after in itertools.pairwise(headings))


def test_paper_shows_no_controls_but_every_doubt(run_folder: Path) -> None:
    style = Page(write_report(run_folder)).style
    paper = style[style.index("@media print") :]
    hidden = re.search(r"([^{}]*)\{ display: none; \}", paper[paper.index("nav") - 4 :])
    assert hidden is not None
    gone = {one.strip() for one in hidden[1].split(",")}
    assert {"nav", ".controls", "button.big"} <= gone
    assert ".doubt" not in gone
    assert "break-inside: avoid" in paper


PLAYS = """
const look = document.getElementById("look-play"), seen = [];
const note = () => seen.push(look.getAttribute("aria-label").split(":")[0]);
const space = () => document.body.dispatchEvent(new KeyboardEvent("keydown", { key: " ", bubbles: true }));
note(); look.click(); note(); space(); note(); document.getElementById("look-road").click(); note();
const paper = () => {
  const svg = document.querySelector('[data-figure="own"] .main-svg');
  const page = getComputedStyle(document.documentElement).getPropertyValue("--page").trim();
  return [page, Math.round(svg.getBoundingClientRect().width)];
};
const before = paper();
window.dispatchEvent(new Event("beforeprint"));
const during = paper();
window.dispatchEvent(new Event("afterprint"));
const player = document.getElementById("play").textContent;
document.body.dataset.seen = JSON.stringify({ seen, player, before, during, after: paper() });
"""


@needs_browser
def test_the_first_picture_plays_and_paper_is_white_and_narrow(natural_run_folder: Path, tmp_path: Path) -> None:
    file = write_report(natural_run_folder)
    # The policy forbids foreign scripts, so it goes for the sake of the script that clicks.
    text = re.sub(r"<meta http-equiv[^>]*>", "", file.read_text(encoding="utf-8"))
    file.write_text(text.replace("</body>", f"<script>{PLAYS}</script></body>"), encoding="utf-8")
    document = browse(file.as_uri(), tmp_path / "profile")
    found = re.search(r"data-seen='([^']*)'|data-seen=\"([^\"]*)\"", document)
    assert found is not None
    seen = json.loads((found[1] or found[2]).replace("&quot;", '"'))
    assert seen["seen"] == ["Play", "Pause", "Play", "Pause"], "by its button, by Space, by the picture"
    assert seen["player"] == "Play", "Space is for the picture in sight"
    assert seen["before"][0] != "#ffffff"
    assert seen["during"] == ["#ffffff", 688]
    assert seen["after"][0] == seen["before"][0]


@needs_browser
def test_it_prints(natural_run_folder: Path, tmp_path: Path) -> None:
    file, pdf = write_report(natural_run_folder), tmp_path / "page.pdf"
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--virtual-time-budget=3000", f"--print-to-pdf={pdf}", file.as_uri()]
    subprocess.run(command, capture_output=True, timeout=120, check=True)
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF-")
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", content)) <= 14
