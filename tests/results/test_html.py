"""Results in notebooks: what a reader of the tables reads, and that texts of users stay texts."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any

import pyarrow as pa
import pytest
from plain_results import plain_result

from cornerforge import results
from cornerforge.errors import InputError
from cornerforge.results import NaturalRate, Queried, Simulated
from cornerforge.results.analysis import Analysed, FlawShown, OwnDoing
from cornerforge.results.driving import KindRate, ModelUncertainty
from cornerforge.results.html import Result
from cornerforge.results.retest import Compared

HOSTILE = "<script>alert(1)</script> & \u202eevil"


class Tables(HTMLParser):
    """Rows of the outermost table as texts, its parts unfolded within their cells; tags that do not match fail."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.seen: set[str] = set()
        self._open: list[str] = []
        self.feed(html)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen |= {tag, *(name for name, _ in attrs)}
        if tag == "br":
            return
        self._open.append(tag)
        if self._open.count("table") == 1 and tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            if self._open.count("table") == 1:
                self.rows[-1].append("")
            else:
                self.rows[-1][-1] += " | "

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self._open):
            self.rows[-1][-1] += data


def read(result: Any) -> dict[str, list[str]]:
    """The rows of a result's table, by their first cell."""
    return {row[0]: row[1:] for row in Tables(result._repr_html_()).rows}


def test_a_rate_has_its_unit_its_interval_and_what_it_is_counted_over() -> None:
    found = plain_result(
        Simulated, tests=20_000, crashes_per_test=0.1178, interval95=(0.11336303, 0.12234839), miles=4861.4,
        crashes_per_mile=0.48464, interval95_per_mile=(0.46638, 0.50334), seconds=1.5, tests_per_second=13_000.0,
    )  # fmt: skip
    rows = read(found)
    assert rows[""] == ["value", "95 % interval", "n"]
    assert rows["crashes_per_test"] == ["0.1178 per test", "0.1134 to 0.1223", "20,000 tests"]
    assert rows["crashes_per_mile"] == ["0.4846 per mile", "0.4664 to 0.5033", "4,861 miles"]
    assert rows["tests"] == ["20,000", "", ""]
    assert not {"interval95", "seconds", "tests_per_second", "distributions"} & set(rows)


def test_what_is_not_known_is_no_number() -> None:
    rows = read(plain_result(NaturalRate, crashes_per_mile=None, doubts=("few crashes",), interval95=(0.0, 0.5)))
    assert rows["crashes_per_mile"] == ["–", "", ""]
    assert rows["crashes_per_test"] == ["0 per test", "0 to 0.5", "0 tests"]
    assert rows["doubts"][0] == "few crashes"
    assert rows["crash_types"][0] == "none"


def test_an_interval_stands_beside_what_it_is_of_or_alone() -> None:
    compared = plain_result(Compared, rate_difference=-0.02, interval95=(-0.03, -0.01), tests=7)
    assert read(compared)["rate_difference"] == ["-0.02 per test", "-0.03 to -0.01", "7 tests"]
    uncertain = read(plain_result(ModelUncertainty, cv=0.5, cv_interval95=(0.25, 1.0), interval95=(0.0, 1e-6)))
    assert uncertain["cv"] == ["0.5", "0.25 to 1", ""]
    assert uncertain["interval95"] == ["0 to 1e-06", "", ""]  # its middle is the rate, which is no field here


def test_parts_of_a_result_unfold_with_their_intervals() -> None:
    flaw = FlawShown(flaw="brakes-late", cases=9, share=0.9, interval95=(0.5, 0.99), typical=("0:1", "0:2"))
    told = plain_result(Analysed, own_doing=OwnDoing(text="It brakes late.", flaws=(flaw,), conducts={"none": 1}))
    shown = read(told)["own_doing"][0]
    assert "It brakes late." in shown
    assert "brakes-late | 9 | 0.9 (0.5 to 0.99) | 0:1, 0:2" in shown
    kind = KindRate(crashes=3, crashes_per_test=3e-6, interval95=(1e-6, 9e-6))
    rate = plain_result(NaturalRate, mechanism_rates={HOSTILE: kind})
    assert "alert(1)</script> & \\u202eevil | 3 | 3e-06 per test (1e-06 to 9e-06)" in read(rate)["mechanism_rates"][0]


def test_texts_of_users_stay_texts() -> None:
    tables = Tables(plain_result(Simulated, av=HOSTILE, bv=(HOSTILE,), library='"><img src=x onerror=y>')._repr_html_())
    said = {row[0]: row[1] for row in tables.rows}
    assert said["av"] == said["bv"] == HOSTILE.replace("\u202e", "\\u202e")
    assert said["library"] == '"><img src=x onerror=y>'
    assert not {"script", "img", "onerror"} & tables.seen
    asked = Queried(columns=(HOSTILE,), rows=((HOSTILE,),))._repr_html_()
    assert Tables(asked).rows == [[HOSTILE.replace("\u202e", "\\u202e")]] * 2


@pytest.mark.parametrize("name", sorted(name for name in results.__all__ if name[0].isupper()))
def test_every_result_is_a_table(name: str) -> None:
    kind = getattr(results, name)
    assert issubclass(kind, Result)
    assert len(Tables(plain_result(kind)._repr_html_()).rows) >= 1


def test_long_answers_are_cut_and_say_so() -> None:
    rows = Tables(Queried(columns=("a",), rows=tuple((n,) for n in range(1234)))._repr_html_()).rows
    assert len(rows) == 1 + 20 + 1
    assert rows[-1] == ["… and 1,214 more"]


def test_an_answer_is_a_table_of_arrow_and_of_pandas() -> None:
    asked = Queried(columns=("n", "x", "name", "n"), rows=((1, 0.5, "a", True), (2, None, None, False)))
    table = asked.to_arrow()
    assert table.column_names == ["n", "x", "name", "n"]
    assert [one.type for one in table.columns] == [pa.int64(), pa.float64(), pa.string(), pa.bool_()]
    assert table.column(1).to_pylist() == [0.5, None]
    assert asked.to_pandas().shape == (2, 4)
    assert Queried(columns=("a", "b"), rows=()).to_arrow().column_names == ["a", "b"]
    with pytest.raises(InputError, match=r"^The column 'big' is no column of Arrow: "):
        Queried(columns=("big",), rows=((2**63,),)).to_arrow()
    with pytest.raises(InputError, match="mixed"):
        Queried(columns=("mixed",), rows=((1,), ("a",))).to_arrow()
