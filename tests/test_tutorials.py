"""Two tutorials are done as they stand there, with fewer decisions and cases; the outputs must be as the pages say."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from pages_as_run import ROOT, Smaller, missing_lines, steps_of, walk

pytestmark = pytest.mark.full

FIRST_RUN = ROOT / "docs" / "tutorial-first-run.md"
OWN_AV = ROOT / "docs" / "tutorial-your-own-av.md"


# What of an output depends on how many tests were driven and which cases were found.
LOOSE = {
    r"^(Nothing was found that is this AV's own doing).*": r"\1...",
    r"digest \w+": "digest ...",
    r"^Cluster 0 .*": "Cluster 0 (...): typical ...",
    r"^Rare: .*": "Rare: ...",
    r"^At fault \(RSS\): .*": "At fault (RSS): ...",
    r"^(Ways out of .*: ).*": r"\1...",
    r"^(  \d\.\d\d: \d+:\d+: ).*": r"\1...",
    r"^(?:av|bv|both)\t.*": "...",
}


def number(text: str, before: str) -> float:
    """The number that follows some words."""
    found = re.search(re.escape(before) + r"([\d,.e+-]*\d)", text)
    assert found, f"{before!r} is not in: {text}"
    return float(found[1].replace(",", ""))


# --- the mechanism ---


def test_a_page_is_read_as_steps() -> None:
    page = (
        "Save this as `a.py`:\n\n```python\nx = 1\n```\n\n```sh\none\ntwo\n```\n\n```\nout 1\n```\n\n```\nother\n```\n"
    )
    saved, ran = steps_of(page)
    assert (saved.name, saved.text) == ("a.py", "x = 1\n")
    assert (ran.commands, ran.output) == (("one", "two"), ("out 1",))


def test_an_output_is_held_to_its_words_not_to_its_numbers() -> None:
    printed = "12 cases in lib: 0.5 crashes\nmore\nRare: 0:7, 0:8\n"
    assert not missing_lines(("200 cases in lib: 0.489 crashes", "...", "Rare: 0:1, ..."), printed)
    assert missing_lines(("200 tests in lib: 0.489 crashes",), printed)
    assert missing_lines(("Rare: 0:1, ...", "more"), printed) == ["more"]  # in another order


# --- the pages ---


def test_the_first_run_is_as_its_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:

    def the_first_case() -> str:
        found = json.loads((tmp_path / "analysis" / "analysis.json").read_text(encoding="utf-8"))
        return str(found["value"]["top"][0]["case_id"])

    smaller: Smaller = {
        "--decisions 1000000": "--decisions 200000 --tests 512", "--cases 500": "--cases 40", "0:151": the_first_case,
    }  # fmt: skip
    done = walk(FIRST_RUN, tmp_path, smaller, LOOSE, monkeypatch, capsys)
    assert {status for status, _ in done.values()} == {0}
    natural = done["cornerforge simulate --tests 20000"][1]
    assert "idm-mobil, nde: 0 crashes per test (95 % interval 0 to 0.000184, 20,000 tests)" in natural
    swerve = done["cornerforge simulate --bv swerve --tests 2000"][1]
    page = FIRST_RUN.read_text(encoding="utf-8")
    for printed in (natural, swerve):  # the same bits on every machine
        assert re.findall(r"digest \w+", printed)[0] in page
    assert number(swerve, "swerve: ") > 0.6
    analysis = json.loads((tmp_path / "analysis" / "analysis.json").read_text(encoding="utf-8"))
    assert analysis["cases"] >= 40
    assert (tmp_path / "page" / "report.html").stat().st_size > 100_000
    assert (tmp_path / "case.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("in_memory")
def test_the_own_av_is_the_example_and_a_forgotten_reset_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    smaller: Smaller = {
        "--tests 2048": "--tests 128", "--decisions 200000 --tests 1024": "--decisions 100000 --tests 256",
        "--cases 200": "--cases 40",
    }  # fmt: skip
    done = walk(OWN_AV, tmp_path, smaller, LOOSE, monkeypatch, capsys)
    assert (tmp_path / "my_av.py").read_bytes() == (ROOT / "examples" / "my_av.py").read_bytes()
    statuses = {command: status for command, (status, _) in done.items()}
    assert set(statuses.values()) == {0}
    assert "FAIL" not in done["cornerforge check-av calm_av:CalmAv"][1]
    assert number(done["cornerforge simulate --av my_av:MyAv --bv swerve --tests 2048"][1], "swerve: ") > 0.5
    assert (tmp_path / "page" / "report.html").stat().st_size > 100_000
