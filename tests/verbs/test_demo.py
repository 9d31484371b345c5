"""What `make demo` leaves behind, asked and shown as its reader does: explorer, page, SQL and files for other tools."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from html_page import Page

import cornerforge
from cornerforge.analysis.mechanism import MECHANISMS, mechanism_of
from cornerforge.ext.explorer import serve
from cornerforge.ext.explorer.driving import Driving
from cornerforge.ext.explorer.exhibit import Exhibit
from cornerforge.library import CaseLibrary

pytestmark = pytest.mark.full

LIBRARIES = {"natural": ("natural/weighted", "natural/analysis"), "adversary": ("library", "analysis")}
"""Source -> its library and analysis within the run's folder."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the demo's first command; its natural crashes are of trees, as of an AV that seldom crashes."""
    out = tmp_path_factory.mktemp("demo") / "out"
    cornerforge.run(effort="quick", out=out)
    return out


@pytest.fixture(scope="module")
def exhibit(demo: Path) -> Iterator[Exhibit]:
    found = serve._sources(demo)
    made = Exhibit("run", [(one.source, one.analysis) for one in found], Driving((), found[0].source))
    yield made
    made.close()


def test_the_explorer_tells_natural_crashes_and_how_often_they_happen(exhibit: Exhibit) -> None:
    assert [(one["name"], one["natural"]) for one in exhibit.about()["sources"]] == [
        ("natural", True), ("adversary", False),
    ]  # fmt: skip
    table = exhibit.table.plain()
    natural = [row for row in table.select(["source", "often", "mechanism"]).to_pylist() if row["source"] == "natural"]
    assert natural
    assert all(row["often"] > 0.0 for row in natural)
    assert any(card["often"].lower().startswith("once in") for card in exhibit.about()["start"])


def test_every_case_can_be_asked_for_what_led_to_it(demo: Path, exhibit: Exhibit) -> None:
    """In SQL on the analysis and in the explorer, whatever made the case; it is what the recording shows."""
    shown = exhibit.table.plain().select(["source", "case_id", "mechanism"]).to_pylist()
    for source, (library, analysis) in LIBRARIES.items():
        told = dict(cornerforge.query(demo / analysis, "select case_id, mechanism from cases").rows)
        cases = CaseLibrary.open(demo / library)
        assert set(told.values()) <= set(MECHANISMS)
        assert len(told) == len(cases) > 0
        for case in cases.scenarios(list(told)[:20]):
            assert told[case.scalars["case_id"]] == mechanism_of(case.scenario).name
        assert {row["case_id"]: row["mechanism"] for row in shown if row["source"] == source} == told


def test_the_page_says_how_often_and_names_the_cases_of_both(demo: Path) -> None:
    page = Page(demo / "report.html")
    words = " ".join(page.text.split())
    assert re.search(r"once in [\d.,]+ (thousand |million |billion )?miles", words, re.IGNORECASE)
    ids = [case["id"] for case in page.data("cases")]
    assert any(name.startswith("natural/") for name in ids)
    assert any(not name.startswith("natural/") for name in ids)


@pytest.mark.parametrize("source", LIBRARIES)
@pytest.mark.parametrize("to", ["csv", "parquet", "json", "openscenario", "commonroad"])
def test_a_case_of_each_is_exported(demo: Path, tmp_path: Path, source: str, to: str) -> None:
    library, analysis = LIBRARIES[source]
    case = pq.read_table(demo / analysis / "cases.parquet", columns=["case_id"])["case_id"][0].as_py()
    done = cornerforge.export(demo / library, [case], to=to, out=tmp_path / "out")
    assert all((tmp_path / "out" / name).stat().st_size > 0 for name in done.files)
