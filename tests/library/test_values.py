"""Values that a library cannot hold, written with all checksums right: they are refused, with column, row and rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from edited_files import rewrite_shard
from reference.records import append, case_record

from cornerforge.errors import FileFormatError
from cornerforge.library import CaseLibrary
from cornerforge.types import ODDS, Scenario

ROW = 1


def rewrite(folder: Path, kind: str, change: Callable[[pa.Table], pa.Table]) -> None:
    rewrite_shard(folder, 1, kind, change)


def set_cell(column: str, value: Any) -> Callable[[pa.Table], pa.Table]:
    """Give one row of a column another value; a function is given the old one."""

    def change(table: pa.Table) -> pa.Table:
        values = table.column(column).to_pylist()
        values[ROW] = value(values[ROW]) if callable(value) else value
        place = table.column_names.index(column)
        return table.set_column(place, table.field(column), pa.array(values, table.field(column).type))

    return change


def put(index: int, value: Any) -> Callable[[list[Any]], list[Any]]:
    return lambda values: [value if i == index else one for i, one in enumerate(values)]


CASES: list[tuple[str, Any, str]] = [
    ("test", -1, "at least 0|0 to"),
    ("crash_time_s", math.nan, "0 to"),
    ("crash_time_s", 1e308, "0 to"),
    ("bv_slot", 0, "1 to"),
    ("av_speed_mps", math.inf, "-100 to 200 m/s"),
    ("relative_heading_rad", 4.0, "-3.14159 to 3.14159"),
    ("n_vehicles", 1, "2 to"),
    ("log_prob_nde", 0.5, "at most 0"),
    ("log_prob_nde", -math.inf, "at most 0"),
    ("min_ttc_s", -1.0, "at least 0"),
    ("min_ttc_s", math.inf, "at least 0"),
    ("log_prob_policy", None, "a number"),
    ("critical_bv_action", put(0, 33), "-1 to 32"),
    ("history", put(0, 1e9), "-100000 to 100000"),
    ("bv_length_m", 0.0, "0.1 to 100 m"),
    ("bv_kind", 4, "0 to 3"),
    ("trajectory_digest", None, "missing"),
]
TRACKS: list[tuple[str, Any, str]] = [
    ("n_frames", 0, "at least 1"),
    ("x_m", put(5, math.inf), "-100000 to 100000 m"),
    ("y_m", put(5, 1e30), "-100000 to 100000 m"),
    ("speed_mps", put(5, 1e6), "-100 to 200"),
    ("target_lane", put(5, 64), "-1 to 63"),
    ("length_m", put(0, -5.0), "0.1 to 100 m"),
    ("action", put(0, 40), "-1 to 32"),
    ("decision_log_prob_nde", put(1, 1.0), "at most 0"),
]


def refused(kind: str, must: str) -> str:
    """The pattern of the message."""
    return f'{kind}-000001.parquet: "[a-z0-9_]+"(\\[\\d+\\])? of row .*({must})'


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("column", "value", "must"), CASES, ids=[f"{row[0]}-{i}" for i, row in enumerate(CASES)])
def test_an_impossible_value_of_a_case_is_refused(filled: Path, column: str, value: Any, must: str) -> None:
    rewrite(filled, "cases", set_cell(column, value))
    library = CaseLibrary.open(filled)
    with pytest.raises(FileFormatError, match=refused("cases", must)) as told:
        library.scenario("7:13")
    assert "\n" not in str(told.value)
    assert [text.split()[0] for text in library.verify()] == ["cases-000001.parquet"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("column", "value", "must"), TRACKS, ids=[f"{row[0]}-{i}" for i, row in enumerate(TRACKS)])
def test_an_impossible_trajectory_is_refused(filled: Path, column: str, value: Any, must: str) -> None:
    rewrite(filled, "tracks", set_cell(column, value))
    library = CaseLibrary.open(filled)
    with pytest.raises(FileFormatError, match=refused("tracks", must)) as told:
        list(library.shards())
    assert "\n" not in str(told.value)
    assert [text.split()[0] for text in library.verify()] == ["tracks-000001.parquet"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["cases", "tracks"])
@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.drop_columns(["case_id"]),
        lambda t: t.slice(1),
        lambda t: pa.concat_tables([t, t.slice(0, 1)]),
        lambda t: t.set_column(0, "case_id", pa.array(range(t.num_rows))),
        lambda t: t.append_column("more", pa.array(range(t.num_rows))),
    ],
    ids=["no ids", "a row less", "a row more", "ids as numbers", "a column more"],
)
def test_another_table_is_refused(filled: Path, kind: str, change: Callable[[pa.Table], pa.Table]) -> None:
    rewrite(filled, kind, change)
    with pytest.raises(FileFormatError, match=f"{kind}-000001"):
        list(CaseLibrary.open(filled).shards())


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, 1e308])
def test_an_own_number_may_be_anything(filled: Path, value: float) -> None:
    rewrite(filled, "cases", set_cell("log_prob_policy", value))
    assert CaseLibrary.open(filled).verify() == []


@pytest.mark.parametrize("value", [None, 0.0, math.nan, math.inf, 1e6])
def test_the_size_of_an_av_is_a_size(
    tmp_path: Path, identity: dict[str, Any], make_scenario: Callable[[int], Scenario], value: float | None
) -> None:
    library = CaseLibrary.create(tmp_path / "lib", identity, ODDS["default"])
    for tests in ([1, 2], [3, 4]):
        cases = [case_record(make_scenario(test), extra={"av_length_m": 4.5}) for test in tests]
        append(library, cases, next_test=tests[-1] + 1, tests=tests[-1] + 1, crashes=tests[-1])
    rewrite(tmp_path / "lib", "cases", set_cell("av_length_m", value))
    with pytest.raises(FileFormatError, match=refused("cases", "0.1 to 100 m")):
        CaseLibrary.open(tmp_path / "lib").sizes()


def test_a_column_alone_is_checked_too(filled: Path) -> None:
    rewrite(filled, "cases", set_cell("av_lane", 127))
    with pytest.raises(FileFormatError, match='"av_lane" of row 1 is 127'):
        CaseLibrary.open(filled).scalars(["av_lane"])


def test_a_changed_cell_is_named_where_only_the_manifest_was_made_anew(filled: Path) -> None:
    def change(table: pa.Table) -> pa.Table:
        return set_cell("crash_time_s", lambda v: v + 1e-9)(table)

    path = filled / "cases-000001.parquet"
    pq.write_table(change(pq.read_table(path)), path)
    with pytest.warns(UserWarning, match="has been changed in the column crash_time_s, row 1"):
        assert CaseLibrary.open(filled).scalars(["test"]).num_rows == 3
