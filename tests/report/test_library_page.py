"""The page of anything: a library of an adversary, of natural crashes, of an AV from outside; and of a run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from edited_files import edit_object, write_object
from html_page import Page

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import FileFormatError, InputError
from cornerforge.ndd import default_model_path, load_model, save_model
from cornerforge.report.artefacts import read_artefacts
from cornerforge.report.text import miles

pytestmark = pytest.mark.full


def test_the_page_of_an_adversarys_library(tmp_path: Path) -> None:
    filled = cornerforge.generate(policy="swerve", cases=40, out=tmp_path / "lib", seed=5)
    made = cornerforge.make_report(tmp_path / "lib", out=tmp_path / "page", seed=1)
    page = Page(Path(made.report))
    assert made.report == str(tmp_path / "page" / "report.html")
    assert "How often the adversary makes the AV crash" in page.text
    assert f"n = {filled.tests} drives" in page.text
    for absent in ("On the road", "Near misses", "How the adversary learned"):
        assert absent not in page.text
    known = {case["id"] for case in page.data("cases")}
    top = cornerforge.analyse(tmp_path / "lib", seed=1).value.top
    assert {case.case_id for case in top} <= known
    assert set(page.data("figures")) >= {"rates", "types", "map", "fault"}
    anchors = {attributes.get("id") for _, attributes in page.tags}
    links = [str(value)[1:] for _, attributes in page.tags for name, value in attributes.items() if name == "href"]
    assert [link for link in links if not link.startswith("case=") and link not in anchors] == []
    # Once more: the analysis is the same and is taken up. Another library's is not written over.
    assert cornerforge.make_report(tmp_path / "lib", out=tmp_path / "page", seed=1) == made
    cornerforge.generate(policy="swerve", cases=30, out=tmp_path / "other", seed=6)
    with pytest.raises(InputError, match="choose another place"):
        cornerforge.make_report(tmp_path / "other", out=tmp_path / "page", seed=1)


@pytest.mark.usefixtures("in_memory")
def test_the_page_of_natural_crashes_of_an_av_from_outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = (Path(__file__).parents[2] / "examples" / "my_av.py").read_text(encoding="utf-8")
    careless = source.replace("0.1 * room - 0.6 * closing", "0.05 * room - 0.1 * closing")
    assert careless != source
    (tmp_path / "careless.py").write_text(careless, encoding="utf-8")
    model = load_model(default_model_path())
    often = np.full(21, 0.05, dtype=np.float32)
    save_model(replace(model, overlook=0.1, overlook_conflict=0.1, lc_base=often), tmp_path / "m.npz")
    monkeypatch.chdir(tmp_path)
    rate = cornerforge.rate(
        av="careless:MyAv", odd="paper", lanes=2, model="m.npz", method="mc", max_tests=8_000, out="rate", seed=2
    )
    assert rate.av_crashes > 20
    assert rate.crashes_per_mile is not None
    assert main(["report", "rate", "--out", "page", "--avoidability", "20"]) == 0
    page = Page(tmp_path / "page" / "report.html")
    assert "careless:MyAv" in page.text
    assert (
        f"In natural traffic this AV touches another vehicle once in {miles(1.0 / rate.crashes_per_mile)}" in page.text
    )
    for absent in ("adversary makes the AV crash", "that the adversary caused", "Near misses"):
        assert absent not in page.text
    assert len(page.data("cases")) > 5
    assert not any(case["id"].startswith("natural/") for case in page.data("cases"))


def test_the_page_of_a_run_stays_where_it_is(run_folder: Path) -> None:
    made = cornerforge.make_report(run_folder)
    assert made.report == str(run_folder / "report.html")
    assert "How the adversary learned" in Page(Path(made.report)).text
    summary = json.loads((run_folder / "summary.json").read_text())
    del summary["generate"]
    write_object(run_folder / "summary.json", summary)
    with pytest.raises(FileFormatError, match=r"summary\.json: .nde, generate. are missing"):
        cornerforge.make_report(run_folder)


def test_what_has_no_page_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(tmp_path)]) == 2
    text = capsys.readouterr().err
    assert "is no folder of run or rate and no library" in text
    assert text.count("\n") == 1


def test_fewer_cases_than_were_analysed_are_refused(run_folder: Path) -> None:
    """A summary that somebody changed, with a checksum that fits."""
    made = json.loads((run_folder / "summary.json").read_text(encoding="utf-8"))["generate"]
    edit_object(run_folder / "summary.json", generate=made | {"cases": 7})
    with pytest.raises(FileFormatError, match=r'summary\.json: "generate\.cases" is 7, but \d+ were analysed'):
        read_artefacts(run_folder)
