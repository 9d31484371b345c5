"""The page as a whole: self-contained, true to the library, safe against names, and clear about what is missing."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import html
import json
import math
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from edited_files import edit_object, write_object
from html_page import Page, browse, needs_browser
from plain_results import plain_result

from cornerforge import analyse
from cornerforge._table_checks import write_parquet
from cornerforge.analysis.flaw import FLAWS
from cornerforge.analysis.in_words import avoidance_in_words
from cornerforge.errors import FileFormatError, MissingExtraError, OutputError
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.library import CaseLibrary, DamagedShardWarning
from cornerforge.report import page, write_report
from cornerforge.report.artefacts import Summary
from cornerforge.report.judged import CaseJudgement, _way_in_words, read_case_judgements, verdict
from cornerforge.report.text import capital, plain, sentence, share
from cornerforge.results import RunDone, Simulated, as_json
from cornerforge.results.analysis import PARTS
from cornerforge.results.learning import Baseline
from cornerforge.types import FRAME_S

ALL = [
    "summary.json",
    "training.json",
    "exposure.json",
    "analysis/analysis.json",
    "analysis/points.parquet",
    "analysis/cases.parquet",
    "analysis/witnesses.parquet",
    "provenance.json",
]


def change(file: Path, **values: Any) -> None:
    """Set top-level keys of a JSON file."""
    edit_object(file, **values)


@pytest.mark.full
def test_the_page_fetches_nothing(run_folder: Path) -> None:
    file = write_report(run_folder)
    made = Page(file)
    links = [
        value
        for tag, attributes in made.tags
        for name, value in attributes.items()
        if name in ("src", "href", "srcset", "data", "action", "poster", "background") and tag != "svg"
    ]
    assert links
    assert all(link is not None and link.startswith("#") for link in links)
    assert "url(" not in made.style
    assert "@import" not in made.style
    assert file.stat().st_size < 10_000_000
    assert page.CASE_BYTES < 4_000_000, "beside plotly (4.9 MB) and points there is room for no more"


@pytest.mark.full
def test_only_the_scripts_of_the_page_may_run(run_folder: Path) -> None:
    made = Page(write_report(run_folder))
    policy = next(a["content"] for tag, a in made.tags if tag == "meta" and a.get("http-equiv"))
    digests = {
        "'sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() + "'"
        for name, script in made.scripts
        if name is None
    }
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    sources = re.search(r"script-src ([^;]*)", policy)
    assert sources is not None
    assert set(sources[1].split()) == digests
    assert len(digests) == 2


def _box(vehicle: dict[str, Any], frame: int, less: float = 0.0) -> Box:
    pose = (vehicle[key][frame - vehicle["from"]] for key in ("x", "y", "h"))
    return Box._make((*pose, vehicle["length"] - less, vehicle["width"] - less))


def _touches(case: dict[str, Any], frame: int) -> bool:
    av, partner = (case["vehicles"][index] for index in (0, case["partner"]))
    return bool(boxes_overlap(_box(av, frame), _box(partner, frame)))


@pytest.mark.full
def test_boxes_touch_at_the_crash_and_not_before(run_folder: Path) -> None:
    cases = Page(write_report(run_folder)).data("cases")
    assert len(cases) > 5
    for case in cases:
        assert case["crash"] == case["frames"] - 1
        assert _touches(case, case["crash"])
        assert not any(_touches(case, frame) for frame in range(case["crash"]))
        assert case["ttcPlane"][case["crash"]] == 0.0


def analysis_of(run_folder: Path) -> dict[str, Any]:
    return dict(json.loads((run_folder / "analysis" / "analysis.json").read_text(encoding="utf-8")))


def test_every_typical_rare_and_top_case_is_there(run_folder: Path) -> None:
    analysis = analysis_of(run_folder)
    made = Page(write_report(run_folder))
    wanted = {case for cluster in analysis["clusters"] for case in cluster["typical"]} | set(analysis["rare"])
    wanted |= {case["case_id"] for case in analysis["value"]["top"]}
    cases = made.data("cases")
    assert {case["id"] for case in cases} == wanted
    buttons = [int(a["data-index"] or -1) for tag, a in made.tags if a.get("class") == "case"]
    assert buttons == list(range(len(cases)))
    kinds = {case["type"] for case in cases}
    assert kinds <= {plain(name) for name in analysis["crash_types"]}
    assert sorted(case["top"] for case in cases if case["top"]) == list(range(1, 11))


def test_the_top_is_a_table_that_plays(run_folder: Path) -> None:
    top = analysis_of(run_folder)["value"]["top"]
    made = Page(write_report(run_folder))
    links = [a for tag, a in made.tags if tag == "a" and a.get("class") == "play"]
    assert [link["data-case"] for link in links[1:]] == [case["case_id"] for case in top]
    assert links[0]["data-case"] == top[0]["case_id"], "the one to watch first"
    text = " ".join(made.text.split())
    assert "the mean of four parts" in text
    valued = text[text.index("Crashes of most value") : text.index("Who broke a rule of RSS?")]
    assert not re.search("once in|natural drivers do", valued), "no rate of a kind is made of one sequence's likelihood"
    for case in top:
        parts = " ".join(f"{case[name]:.2f}" for name in ("value", *PARTS))
        assert f"case {case['case_id']} {parts} {plain(case['crash_type'])}" in text
        happened, way = case["text"].split(";")[:2]
        assert f"{capital(plain(sentence(happened)))} {plain(way).strip()}" in text.replace("  ", " ")
    widths = [a["style"] for tag, a in made.tags if a.get("class") == "bar"]
    assert widths == [f"--part: {round(100 * case[name])}%" for case in top for name in PARTS]


@pytest.mark.full
def test_the_first_sentence_says_what_the_av_does_wrong(run_folder: Path) -> None:
    own = analysis_of(run_folder)["own_doing"]
    made = Page(write_report(run_folder))
    text = " ".join(made.text.split())
    assert own["text"] in text
    assert own["flaws"], "the run shows no flaw, so this tests nothing"
    assert text.index(f"It {FLAWS[own['flaws'][0]['flaw']]} In ") < text.index("Cases to watch")


def test_what_a_careful_driver_prevents_is_one_number(run_folder: Path) -> None:
    careful = analysis_of(run_folder)["prevented"]["careful"]
    text = " ".join(Page(write_report(run_folder)).text.split())
    assert f"Would a careful driver have prevented it? {share(careful['share'])} (95 %:" in text
    assert "at least one of four" not in text


def test_a_braking_verdict_names_models_only_if_some_brake_in_time() -> None:
    told = CaseJudgement("bv", "rule x", 2.0, None, None, None, "nobody", "by braking", "brakes-late", 1.4, None)
    assert verdict(told).endswith("A careful driver would have prevented it by braking.")
    assert "by braking, as fsm would." in verdict(dataclasses.replace(told, prevented_by="fsm"))


def test_a_verdict_tells_the_own_doing_of_the_av() -> None:
    known = CaseJudgement("bv", "rule x", 2.0, None, None, None, None, None, "brakes-late", 1.4, None)
    assert "own doing, from 1.4 s before contact: it brakes for a vehicle ahead more than 0.8 s" in verdict(known)


@pytest.mark.full
def test_shares_stand_with_their_intervals(run_folder: Path) -> None:
    analysis = analysis_of(run_folder)
    known, grid = analysis["avoidability"], analysis["coverage"]
    made = Page(write_report(run_folder))
    text = " ".join(made.text.split())
    lead = analysis["judges"]["lead"]
    low, high = (share(value) for value in lead["interval95"])
    assert (
        "An AV that reacts 1.0 s after the manoeuvre began that led to the crash had a way out in "
        f"{share(lead['share'])} of n = 60 cases (95 %: {low} to {high})"
    ) in text
    shares = {one["reaction_s"]: share(one["share"]) for one in analysis["judges"]["avoidable"]}
    assert f"{shares[0.5]} with 0.50 s, {shares[0.75]} with 0.75 s" in text
    assert f"with perfect foresight, so with 0 s, {shares[0.0]}." in text
    assert shares[0.0] == share(known["avoidable_share"])
    assert "Judges against each other" in text
    low, high = (share(value) for value in grid["unseen_kind_interval95"])
    assert f"kind not seen yet: {share(grid['unseen_kind_chance'])} (95 %: {low} to {high})" in text
    figures = made.data("figures")
    assert figures["fault"]["data"][0]["x"][1] == pytest.approx(100 * analysis["fault"]["bv"] / 60)
    assert figures["discovery"]["data"][0]["y"][-1] == len(grid["cells"])


@pytest.mark.full
def test_every_empty_kind_is_visible(run_folder: Path) -> None:
    grid = analysis_of(run_folder)["coverage"]
    made = Page(write_report(run_folder))
    cells = [a for tag, a in made.tags if tag == "td" and a.get("title")]
    empty = [a["title"] for a in cells if (a.get("class") or "").endswith("none")]
    assert empty == [name.replace(" | ", ", ") + ": 0" for name in grid["empty"]]
    filled = {a["title"] for a in cells} - set(empty)
    assert filled == {f"{name.replace(' | ', ', ')}: {n}" for name, n in grid["cells"].items()}


def _state(vehicle: dict[str, Any], frame: int) -> list[float]:
    return [vehicle[key][frame - vehicle["from"]] for key in ("x", "y", "h", "v")]


@pytest.mark.full
def test_the_way_out_leaves_the_recording_and_touches_nobody(run_folder: Path) -> None:
    cases = [case for case in Page(write_report(run_folder)).data("cases") if case["wayOut"]]
    assert len(cases) > 5
    for case in cases:
        way, av = case["wayOut"], case["vehicles"][0]
        assert way["from"] + len(way["x"]) == case["frames"]
        assert _state(way, way["from"]) == pytest.approx(_state(av, way["from"]), abs=2e-3)
        for frame in range(way["from"], case["frames"]):
            for other in case["vehicles"][1:]:
                if 0 <= frame - other["from"] < len(other["x"]) and other["x"][frame - other["from"]] is not None:
                    # Positions on the page are rounded to a millimetre.
                    assert not boxes_overlap(_box(way, frame, 4e-3), _box(other, frame, 4e-3))


@pytest.mark.full
def test_verdicts_say_what_the_analysis_found(run_folder: Path) -> None:
    rows = {row["case_id"]: row for row in pq.read_table(run_folder / "analysis" / "cases.parquet").to_pylist()}
    for case in Page(write_report(run_folder)).data("cases"):
        row = rows[case["id"]]
        assert case["verdict"].startswith(
            {"av": "The AV broke", "bv": "The other vehicle broke", "both": "Both broke", "none": "No rule"}[
                row["fault"]
            ]
        )
        assert (row["avoidability"] == "unavoidable") == ("Unavoidable" in case["verdict"])
        if row["latest_any_s"] is not None:
            assert f"{row['latest_any_s']:.1f} s before contact" in case["verdict"]


@pytest.mark.full
def test_one_time_for_the_last_way_out(run_folder: Path) -> None:
    """Column, sentence, verdict, picture and player, for every case: once nine of the top ten had two."""
    rows = pq.read_table(run_folder / "analysis" / "cases.parquet").to_pylist()
    judged = read_case_judgements(run_folder / "analysis", [row["case_id"] for row in rows], "cornerforge analyse")
    library = CaseLibrary.open(run_folder / "library")
    avoidable, by_a_later_kind = 0, 0
    for row in rows:
        known, latest = judged[row["case_id"]], row["latest_any_s"]
        assert known.latest_s == latest
        if latest is None:
            assert known.way_out is None
            continue
        assert known.way_out is not None
        scenario = library.scenario(row["case_id"]).scenario
        assert scenario.crash is not None
        # the player's outline of the AV leaves the recording at that moment
        frame = round((scenario.crash.time - latest) / FRAME_S)
        assert known.way_out.begin_s == latest
        assert known.way_out.x[0] == pytest.approx(scenario.x[frame, 0], abs=1e-3)
        assert row["time_to_react_s"] == pytest.approx(row["manoeuvre_begin_s"] - latest, abs=1e-9)
        if row["avoidability"] in ("unavoidable", "undecided"):
            continue
        said = [avoidance_in_words(row["avoidability"], latest), _way_in_words(known)]
        assert [re.findall(r"last way out (?:began )?([0-9.]+) s before contact", one) for one in said] == 2 * [
            [f"{latest:.1f}"]
        ]
        avoidable += 1
        kinds = [row[f"latest_{kind}_s"] for kind in ("braking", "steering") if row[f"latest_{kind}_s"] is not None]
        by_a_later_kind += latest < min(kinds, default=math.inf)
    assert avoidable > 20
    assert by_a_later_kind > 0, "no case tells the latest of all from the latest of one kind"
    top = {one["case_id"]: one["text"] for one in analysis_of(run_folder)["value"]["top"]}
    for row in rows:
        if row["case_id"] in top and row["avoidability"] not in ("unavoidable", "undecided"):
            assert top[row["case_id"]].endswith(f"last way out {row['latest_any_s']:.1f} s before contact")


@pytest.mark.parametrize(
    ("label", "manoeuvre", "latest", "words"),
    [
        ("unavoidable", 1.0, None, "no way out in the time looked at"),
        ("unavoidable", 1.0, 1.5, "began 1.5 s before contact, before the manoeuvre"),
        ("unavoidable", 1.0, 0.5, "began 0.5 s before contact, within its reaction time"),
        ("undecided", 1.0, None, "not all could be tried"),
        ("by combination", 1.0, 0.5, "by braking and steering together; its last way out began 0.5 s before contact"),
        (None, None, None, r"(rule x, 2.0 s before contact)."),
    ],
)
def test_a_verdict_tells_the_kinds_of_no_way_out_apart(
    label: str | None, manoeuvre: float | None, latest: float | None, words: str
) -> None:
    known = CaseJudgement("bv", "rule x", 2.0, label, manoeuvre, latest, None, None, "none", None, None)
    assert words in verdict(known)


@pytest.mark.full
def test_without_a_search_for_ways_out_the_page_says_so(run_folder: Path) -> None:
    shutil.rmtree(run_folder / "analysis")
    analyse(run_folder / "library", out=run_folder / "analysis", avoidability="none")
    made = Page(write_report(run_folder))
    assert "No case has a value" in made.text
    assert "Nobody looked for ways out" in made.text
    assert "avoidability" not in made.data("figures")
    assert all(case["wayOut"] is None and "AV could" not in case["verdict"] for case in made.data("cases"))


@pytest.mark.parametrize("key", ["fault", "fault_rules", "severity", "avoidability", "value", "coverage"])
def test_an_analysis_by_an_earlier_version_is_named_with_its_command(run_folder: Path, key: str) -> None:
    file = run_folder / "analysis" / "analysis.json"
    values = analysis_of(run_folder)
    del values[key]
    write_object(file, values)
    command = re.escape(f"cornerforge analyse {run_folder / 'library'} --out {run_folder / 'analysis'}")
    with pytest.raises(FileFormatError, match=f'"{key}" is missing; write the file again with: {command}'):
        write_report(run_folder)


@pytest.mark.parametrize(
    ("key", "inner", "value", "message"),
    [
        ("fault", "road", 1, "\"fault\" holds 'road'; it must be a name that is known"),
        (
            "value",
            "top",
            [{"case_id": "0:1", "value": 1.2}],
            r'"value\.top\[0\]\.value" is 1\.2; it must be a number of at most 1',
        ),
        (
            "coverage",
            "discovery_curve",
            [[1.0, 1.0], [2.0]],
            r'"coverage\.discovery_curve\[1\]" is \[2\.0\]; it must be a list of length 2',
        ),
        ("coverage", "discovery_curve", [[1.0, None]], r'"coverage\.discovery_curve\[0\]\[1\]" is None'),
    ],
)
def test_a_wrong_judgement_is_named(run_folder: Path, key: str, inner: str, value: object, message: str) -> None:
    change(run_folder / "analysis" / "analysis.json", **{key: analysis_of(run_folder)[key] | {inner: value}})
    with pytest.raises(FileFormatError, match=message):
        write_report(run_folder)


def test_a_missing_column_of_the_cases_is_named(run_folder: Path) -> None:
    file = run_folder / "analysis" / "cases.parquet"
    pq.write_table(pq.read_table(file).drop_columns(["fault_rule"]), file)
    with pytest.raises(FileFormatError, match=r"cases\.parquet lacks the column\(s\) fault_rule; .*--out"):
        write_report(run_folder)


def test_numbers_of_the_adversary_are_those_of_the_artefacts(run_folder: Path) -> None:
    text = " ".join(Page(write_report(run_folder)).text.split())
    # 0.25 / 4.5e-6 and the opposite ends of the intervals: 0.2 / 8.5e-6, 0.3 / 2.1e-6
    assert "56,000 times as many crashes per drive as natural traffic (from 24,000 to 140,000" in text
    assert "0.25 crashes per drive (95 %: 0.20 to 0.30; n = 240 drives)" in text


def test_no_natural_crash_is_a_bound(run_folder: Path) -> None:
    """One bound for one quantity: the end of its interval, at every place, and no "more than" that is rounded up."""
    nde = plain_result(Simulated, tests=2_000_000, interval95=(0.0, 1.84e-6), crashes_per_mile=0.0, miles=497_000.0)
    change(run_folder / "summary.json", nde=as_json(nde))
    made = Page(write_report(run_folder))
    text = " ".join(made.text.split())
    assert "At least 100,000 times as many crashes per drive" in text  # 0.2 / 1.84e-6 = 108 696
    assert "natural traffic2,000,0000below 1.8 × 10⁻⁶0 to 1.8 × 10⁻⁶below 7.4 × 10⁻⁶" in text
    bound = made.data("figures")["rates"]["data"][1]
    assert bound["x"] == [1.84e-6]
    assert bound["text"] == ["no crash seen: below 1.8 × 10⁻⁶"]
    assert bound["marker"]["symbol"] == "triangle-left"


@pytest.mark.full
def test_natural_kinds_and_cases_come_first(natural_run_folder: Path) -> None:
    found = Page(write_report(natural_run_folder))
    told = json.loads((natural_run_folder / "summary.json").read_text(encoding="utf-8"))["natural_cases"]
    cases = found.data("cases")
    natural = [case for case in cases if case["id"].startswith("natural/")]
    assert cases[: len(natural)] == natural
    assert [case["order"] for case in natural] == list(range(len(natural)))
    assert natural[0]["watchFirst"]
    assert sum(case["watchFirst"] for case in cases) == 1
    assert {f"natural/{top['case_id']}" for top in told["value"]["top"]} <= {case["id"] for case in natural}
    assert all(case["critical"] == [] for case in natural), "nobody is controlled in natural traffic"
    linked = [attrs["data-case"] for _, attrs in found.tags if "data-case" in attrs]
    assert linked[1 : 1 + len(told["value"]["top"])] == [f"natural/{top['case_id']}" for top in told["value"]["top"]]
    share = told["natural"]["mechanisms"]["bv-side"]["share"]
    assert share == pytest.approx(16 / 30)
    text = " ".join(found.text.split())
    assert "A vehicle beside the AV changes into its lane and touches its side53.3 %" in text
    assert "a serious injury in the AV (MAIS 3 or more)" in text


def test_names_cannot_break_out(run_folder: Path) -> None:
    nasty = "</script><img src=x onerror=alert(1)>"
    baseline = plain_result(Baseline, name=nasty, tests=10, crashes_per_test=0.1, interval95=(0.0, 0.4))
    change(run_folder / "summary.json", av=nasty, baselines=[as_json(baseline)])
    change(run_folder / "provenance.json", command=nasty)
    made = Page(write_report(run_folder))
    assert not any(tag == "img" for tag, _ in made.tags)
    assert nasty in made.text
    assert len(made.scripts) == 4
    assert made.data("figures")["rates"]["data"][0]["y"][1].startswith("&lt;/script&gt;")


@pytest.mark.parametrize("name", ALL)
def test_a_missing_artefact_is_named_with_its_command(run_folder: Path, name: str) -> None:
    (run_folder / name).unlink()
    with pytest.raises(
        FileFormatError, match=rf"{re.escape(name)} is missing; write it with: cornerforge (run|analyse)"
    ):
        write_report(run_folder)


@pytest.mark.parametrize("name", ALL)
def test_a_damaged_artefact_is_named(run_folder: Path, name: str) -> None:
    content = (run_folder / name).read_bytes()
    (run_folder / name).write_bytes(content[: len(content) // 2])
    with pytest.raises(FileFormatError, match=re.escape(name)):
        write_report(run_folder)


def test_a_missing_library_is_named(run_folder: Path) -> None:
    shutil.rmtree(run_folder / "library")
    with pytest.raises(FileFormatError, match="library"):
        write_report(run_folder)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("summary.json", {"av": None}, r'"av" is None; it must be a text'),
        ("summary.json", {"av": 3}, r'"av" is 3; it must be a text'),
        (
            "training.json",
            {"points": [{"decisions": "many"}]},
            r"""points\[0\]\.decisions" is 'many'; it must be a whole number""",
        ),
        ("analysis/analysis.json", {"rare": [1]}, r'"rare\[0\]" is 1; it must be a text'),
    ],
)
def test_a_wrong_value_is_named(run_folder: Path, name: str, values: dict[str, Any], message: str) -> None:
    change(run_folder / name, **values)
    with pytest.raises(FileFormatError, match=message):
        write_report(run_folder)


def test_what_the_page_shows_of_a_run_are_its_fields() -> None:
    known = {one.name for one in dataclasses.fields(RunDone)}
    assert {one.name for one in dataclasses.fields(Summary)} - known == {"adversary"}


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("pc1", float("nan"), "pc1"),
        ("case_id", None, "case_id"),
    ],
)
def test_a_wrong_point_is_named(run_folder: Path, column: str, value: object, message: str) -> None:
    file = run_folder / "analysis" / "points.parquet"
    rows = pq.read_table(file).to_pylist()
    rows[0][column] = value
    write_parquet(file, pa.Table.from_pylist(rows))
    with pytest.raises(FileFormatError, match=rf"points\.parquet.*{message}"):
        write_report(run_folder)


def test_cases_that_the_library_lost_are_said(run_folder: Path) -> None:
    change(run_folder / "analysis" / "analysis.json", rare=["0:99999"])
    made = Page(write_report(run_folder))
    assert "Not in the library, so not shown: 0:99999." in made.text


def test_a_damaged_shard_leaves_a_page_without_cases(run_folder: Path) -> None:
    for shard in (run_folder / "library").glob("*.parquet"):
        shard.unlink()
    with pytest.warns(DamagedShardWarning) as told:
        file = write_report(run_folder)
    texts = [str(one.message) for one in told]
    assert not any("Case " in text for text in texts), "each file is named, not each of its cases"
    made = Page(file)
    assert made.data("cases") == []
    assert "No case can be played" in made.text


def test_the_page_stays_small_and_says_what_it_left_out(run_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "CASE_BYTES", 60_000)
    made = Page(write_report(run_folder))
    cases = made.data("cases")
    assert 0 < sum(len(json.dumps(case, separators=(",", ":"))) for case in cases) < 62_000
    assert "Left out to keep the page small" in made.text


@pytest.mark.parametrize(("module", "package"), [("plotly.offline", "plotly"), ("jinja2", "jinja2")])
def test_a_missing_extra_names_its_install_command(
    run_folder: Path, monkeypatch: pytest.MonkeyPatch, module: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"needs {package}.*cornerforge\[report\]"):
        write_report(run_folder)


def test_a_page_that_cannot_be_written_is_an_error(run_folder: Path) -> None:
    (run_folder / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"Cannot write .*report\.html"):
        write_report(run_folder)


@needs_browser
def test_a_browser_draws_the_page_without_complaint(run_folder: Path, tmp_path: Path) -> None:
    file = write_report(run_folder)
    case = Page(file).data("cases")[3]
    document = browse(f"{file.as_uri()}#case={case['id']}&t=crash", tmp_path / "profile")
    assert f'id="case-title" aria-live="polite">{case["title"]}<' in document
    assert 'id="read-before">0.0 s<' in document
    assert 'id="read-plane">0.00 s<' in document
    assert len(re.findall(r'class="[^"]*js-plotly-plot', document)) == 15


STEPS = """
document.getElementById("player").scrollIntoView({ behavior: "instant" });
const seen = [];
const note = () => seen.push(location.hash + " " + document.getElementById("play").textContent);
const press = (key) => { document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true })); note(); };
press("ArrowLeft"); press("ArrowLeft"); press("ArrowRight"); press(" "); press(" ");
document.querySelectorAll("button.case")[2].click(); note();
document.getElementById("to-crash").click(); note();
document.querySelector('[data-figure="map"]').emit("plotly_click", { points: [{ customdata: ID }] }); note();
document.querySelectorAll("a.play")[2].click(); note();
document.body.dataset.seen = JSON.stringify(seen);
"""


@needs_browser
def test_keys_buttons_and_the_map_drive_the_player(run_folder: Path, tmp_path: Path) -> None:
    file = write_report(run_folder)
    cases = Page(file).data("cases")
    # The policy forbids foreign scripts, so it goes for the sake of the script that presses the keys.
    text = re.sub(r"<meta http-equiv[^>]*>", "", file.read_text(encoding="utf-8"))
    steps = STEPS.replace("ID", json.dumps(cases[5]["id"]))
    file.write_text(text.replace("</body>", f"<script>{steps}</script></body>"), encoding="utf-8")
    found = re.search(r'data-seen="([^"]*)"', browse(file.as_uri(), tmp_path / "profile"))
    assert found is not None
    seen = json.loads(html.unescape(found[1]))

    def at(index: int, time: str) -> str:
        return f"#case={cases[index]['id']}&t={time}"

    place = {case["top"]: index for index, case in enumerate(cases)}
    best = place[1]  # the page opens with the case to watch first, here the most valuable
    end = cases[best]["first"] + cases[best]["crash"]
    before, before_that = (f"{(end - k) * 0.1:.1f}" for k in (1, 2))
    assert seen[:5] == [
        f"{at(best, before)} Play",
        f"{at(best, before_that)} Play",
        f"{at(best, before)} Play",
        f"{at(best, before)} Pause",
        f"{at(best, before)} Play",
    ]
    assert seen[5:8] == [f"{at(2, '0.0')} Pause", f"{at(2, 'crash')} Play", f"{at(5, '0.0')} Play"]
    assert seen[8:] == [f"{at(place[2], '0.0')} Pause"]
