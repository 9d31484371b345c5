"""`analyse` on a real library: what it writes, that numbers agree with each other, and that threads change nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import cornerforge
from cornerforge import cli
from cornerforge.analysis.avoidability import AVOIDABILITY_SCHEMA, LABELS
from cornerforge.analysis.stored import CASE_COLUMNS, POINT_COLUMNS
from cornerforge.analysis.value import PARTS
from cornerforge.drivers.careful import CAREFUL
from cornerforge.errors import InputError, OutputError
from cornerforge.results import Analysed, as_json

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def analysed(swerve_library: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Analysed, Path]:
    out = tmp_path_factory.mktemp("analysed") / "out"
    return cornerforge.analyse(swerve_library, out=out, avoidability=40, seed=3, threads=2), out


def test_every_case_has_its_row(analysed: tuple[Analysed, Path]) -> None:
    summary, out = analysed
    cases, points = pq.read_table(out / "cases.parquet"), pq.read_table(out / "points.parquet")
    assert cases.column("case_id").to_pylist() == points.column("case_id").to_pylist()
    assert cases.num_rows == summary.cases
    assert cases.column_names == [column.name for column in CASE_COLUMNS]
    assert points.column_names == [column.name for column in POINT_COLUMNS]
    for name in cases.column_names[len(POINT_COLUMNS) :]:
        assert (cases.schema.field(name).metadata or {}).get(b"meaning"), f"{name} says what it is"
    assert summary.prevented is not None
    said = [names.split(", ") for names in cases.column("prevented_by").to_pylist()]
    assert summary.prevented.cases == len(said)
    held = cases.column("held_speed_prevents").to_pylist()
    assert summary.prevented.held == sum(held)
    for name, one in summary.prevented.by.items():
        kept = [enough for names, enough in zip(said, held, strict=True) if name in names]
        assert (one.cases, one.by_braking) == (len(kept), kept.count(False))
    assert list(summary.prevented.by) == list(CAREFUL)
    assert sum(summary.fault.values()) == sum(summary.fault_rules.values()) == summary.cases
    speed, of_av, of_bv = (
        cases.column(name).to_numpy() for name in ("impact_speed_mps", "av_delta_v_mps", "bv_delta_v_mps")
    )
    np.testing.assert_allclose(of_av, of_bv, rtol=1e-9)  # equal masses
    assert (2.0 * of_av <= speed * (1.0 + 1e-9)).all()  # plastic; less where they go on sliding


def test_drawn_cases_make_the_shares_and_outstanding_ones_are_looked_at_too(
    analysed: tuple[Analysed, Path],
) -> None:
    summary, out = analysed
    seen = summary.avoidability
    assert seen is not None
    assert seen.cases == sum(seen.labels.values()) == 40
    ways = 40 - seen.labels["unavoidable"] - seen.labels["undecided"]
    assert seen.avoidable_share == ways / 40
    assert seen.interval95[0] <= ways / 40 <= seen.interval95[1]
    cases = pq.read_table(out / "cases.parquet").to_pydict()
    looked = {name for name, label in zip(cases["case_id"], cases["avoidability"], strict=True) if label is not None}
    outstanding = set(summary.rare).union(*(one.typical for one in summary.clusters))
    assert outstanding <= looked
    assert len(looked) <= 40 + len(outstanding)
    assert {label for label in cases["avoidability"] if label} <= set(LABELS)
    witnesses = pq.read_table(out / "witnesses.parquet").to_pydict()
    assert set(witnesses["case_id"]) == looked
    for label, way in zip(witnesses["avoidability"], witnesses["witness_x_m"], strict=True):
        assert way is not None or label in ("unavoidable", "undecided")
    assert summary.coverage.cases == 40


def test_the_top_is_the_top_and_says_why(analysed: tuple[Analysed, Path]) -> None:
    summary, out = analysed
    cases = pq.read_table(out / "cases.parquet").to_pydict()
    rows = {name: row for row, name in enumerate(cases["case_id"])}
    values = [value for value in cases["value"] if value is not None]
    top = summary.value.top
    assert [one.value for one in top] == sorted(values, reverse=True)[:10]
    for one in top:
        row = rows[one.case_id]
        assert one.value == pytest.approx(np.mean([getattr(one, name) for name in PARTS]))
        assert all(getattr(one, name) == cases[f"value_{name}"][row] for name in PARTS)
        assert one.fault == cases["fault"][row]
        label = cases["avoidability"][row]
        if label in ("unavoidable", "undecided"):
            assert one.text.split("; ")[1].startswith(("unavoidable", "no way"))
            continue
        assert f"avoidable {'by' if label != 'by both' else 'by braking or steering'}" in one.text
        assert one.text.endswith(f"last way out {cases['latest_any_s'][row]:.1f} s before contact")
        assert "miles" not in one.text


def test_the_same_for_any_threads_and_another_draw_for_another_seed(
    swerve_library: Path, analysed: tuple[Analysed, Path], tmp_path: Path
) -> None:
    def timeless(summary: Analysed) -> str:
        return json.dumps(as_json(replace(summary, seconds={})))

    again = cornerforge.analyse(swerve_library, out=tmp_path / "again", avoidability=40, seed=3, threads=1)
    assert timeless(again) == timeless(analysed[0])
    for name in ("cases", "points", "witnesses"):
        assert (tmp_path / "again" / f"{name}.parquet").read_bytes() == (analysed[1] / f"{name}.parquet").read_bytes()
    other = cornerforge.analyse(swerve_library, avoidability=40, seed=4, threads=2)
    assert other.fault == again.fault
    assert other.coverage != again.coverage


def test_a_slower_av_avoids_no_more(swerve_library: Path) -> None:
    """The same draw; each case's label allows the less the later the AV may begin."""
    fast, slow = (
        cornerforge.analyse(swerve_library, avoidability=40, reaction=reaction, threads=2).avoidability
        for reaction in (0.0, 1.5)
    )
    assert slow is not None
    assert fast is not None
    assert slow.labels["unavoidable"] > fast.labels["unavoidable"]


def test_without_a_look_nothing_has_a_value(swerve_library: Path) -> None:
    summary = cornerforge.analyse(swerve_library, avoidability="none")
    assert summary.avoidability is None
    assert summary.value.top == ()
    assert summary.coverage.cases == summary.cases
    assert list(summary.coverage.axes) == ["crash type", "impact speed"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"avoidability": "some"}, 'a number of cases, "all" or "none"'),
        ({"avoidability": -1}, "avoidability"),
        ({"reaction": 6.0}, "reaction"),
        ({"reaction": -0.1}, "reaction"),
    ],
)
def test_what_is_refused(wrong: dict[str, Any], message: str, swerve_library: Path) -> None:
    with pytest.raises(InputError, match=message):
        cornerforge.analyse(swerve_library, **wrong)


def test_another_analysis_does_not_overwrite(
    swerve_library: Path, analysed: tuple[Analysed, Path]
) -> None:  # fmt: skip
    with pytest.raises((InputError, OutputError), match="reaction"):
        cornerforge.analyse(swerve_library, out=analysed[1], avoidability=40, seed=3, reaction=0.5)


def test_the_command_line_tells_it(swerve_library: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["analyse", str(swerve_library), "--avoidability", "20", "--quiet", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["avoidability"]["cases"] == 20
    assert cli.main(["analyse", str(swerve_library), "--avoidability", "20"]) == 0
    text = capsys.readouterr().out
    for words in (
        "At fault (RSS): ",
        "would have prevented (by braking): cc-human ",
        "Avoidable: ",
        "95 % interval",
        "Kinds: ",
        "Worth a look first",
    ):
        assert words in text


def test_the_columns_are_documented(golden) -> None:
    """docs/case-columns.md is made of what the code says."""
    lines = [
        "# Columns of an analysis", "",
        "`cornerforge analyse LIB --out DIR` writes `cases.parquet`, one row a case, with the columns below; the first",
        f"{len(POINT_COLUMNS)} are those of `points.parquet`. `witnesses.parquet` holds the ways out of the cases that",
        "were looked at. Reading checks types, ranges, and the counts of `analysis.json`. This page is made from the",
        "code (`make golden`).", "",
        "| column | unit | meaning |", "| --- | --- | --- |",
    ]  # fmt: skip
    lines += [f"| `{c.name}` | {c.unit} | {c.meaning} |" for c in CASE_COLUMNS]
    lines += ["", "## witnesses.parquet", "", "| column | unit | meaning |", "| --- | --- | --- |"]
    lines += [_row(field) for field in AVOIDABILITY_SCHEMA]
    golden("../../docs/case-columns.md", "\n".join([*lines, ""]))


def _row(field: pa.Field) -> str:
    about = {key.decode(): value.decode() for key, value in field.metadata.items()}
    return f"| `{field.name}` | {about.get('unit', '')} | {about['meaning']} |"
