"""Values that a library cannot hold, written with all checksums right: they are refused, with column, row and rule."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from edited_files import edit_object

from cornerforge._table_checks import with_checks
from cornerforge.errors import FileFormatError
from cornerforge.fields import BODY
from cornerforge.library import CaseLibrary, case_record
from cornerforge.library.tables import ROW_GROUP
from cornerforge.library.values import ShardFacts, cases_fault
from cornerforge.types import ODDS, Scenario

ROW = 1


def rewrite(folder: Path, kind: str, change: Callable[[pa.Table], pa.Table]) -> None:
    """Change the table of the second shard, and make all checksums anew."""
    path = folder / f"{kind}-000001.parquet"
    pq.write_table(with_checks(change(pq.read_table(path))), path, row_group_size=ROW_GROUP)
    shards = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["shards"]
    content = path.read_bytes()
    shards[1][f"{kind}_file"] |= {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    edit_object(folder / "manifest.json", shards=shards)


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
    ("seed", 8, "seed of the library's run"),
    ("test", 10, "ascending"),
    ("test", -1, "at least 0|0 to"),
    ("case_id", "7:99", "seed:test"),
    ("crash_time_s", math.nan, "0 to"),
    ("crash_time_s", 1e308, "0 to"),
    ("crash_time_s", 9000.0, "time limit"),
    ("duration_s", 3.0, "crash_time_s"),
    ("bv_slot", 0, "1 to"),
    ("av_speed_mps", math.inf, "-100 to 200 m/s"),
    ("av_speed_mps", lambda v: v + 1.0, "difference|speed"),
    ("impact_speed_difference_mps", lambda v: -v, "bv_speed_mps - av_speed_mps"),
    ("relative_heading_rad", 4.0, "-3.14159 to 3.14159"),
    ("relative_lat_m", lambda v: v + 0.5, "difference of y"),
    ("n_vehicles", 1, "2 to"),
    ("n_decisions", 99, "one for each second"),
    ("n_impossible", 99, "at most n_decisions"),
    ("log_prob_nde", 0.5, "at most 0"),
    ("log_prob_nde", -math.inf, "at most 0"),
    ("log_prob_nde", None, "missing where n_impossible is above 0, and there alone"),
    ("min_ttc_s", -1.0, "at least 0"),
    ("min_ttc_s", math.inf, "at least 0"),
    ("log_prob_policy", None, "a number"),
    ("critical_bv_action", [0], "one for each decision"),
    ("critical_bv_action", put(0, 33), "-1 to 32"),
    ("history", put(0, 1e9), "-100000 to 100000"),
    ("bv_length_m", 0.0, "0.1 to 100 m"),
    ("bv_kind", 3, "0 to 2"),
    ("n_implausible", 99, "at most n_decisions"),
    ("trajectory_digest", None, "missing"),
    ("av_max_braking_mps2", None, "there, in a crash after 0.3 s"),
]
TRACKS: list[tuple[str, Any, str]] = [
    ("case_id", "7:99", "same row of the cases"),
    ("n_frames", 0, "at least 1"),
    ("n_frames", 30, "until crash_time_s"),
    ("slot", put(0, 1), "the AV's 0 first"),
    ("slot", lambda v: v[::-1], "the AV's 0 first"),
    ("slot", [], "the AV's 0 first"),
    ("slot", lambda v: [0, *(one + 10 for one in v[1:])], "crash partner"),
    ("x_m", lambda v: v[:-1], "n_frames for each vehicle"),
    ("x_m", put(5, math.inf), "-100000 to 100000 m"),
    ("x_m", put(5, math.nan), "finite where the vehicle is present"),
    ("y_m", put(5, 1e30), "-100000 to 100000 m"),
    ("speed_mps", put(5, 1e6), "-100 to 200"),
    ("speed_mps", lambda v: [one + 1.0 for one in v], "av_speed_mps of the case"),
    ("target_lane", put(5, 9), "-1 to 5"),
    ("target_lane", put(5, 5), "a lane of the road"),
    ("present", put(5, False), "finite where|true of the AV"),
    ("length_m", put(0, -5.0), "0.1 to 100 m"),
    ("width_m", [], "one for each vehicle"),
    ("action", put(0, 40), "-1 to 32"),
    ("action", lambda v: v * 2, "one for each decision of each vehicle"),
    ("critical_bv", put(1, 77), "an index into slot"),
    ("critical_bv", [], "one for each decision"),
    ("decision_log_prob_nde", put(1, 1.0), "at most 0"),
    ("decision_log_prob_nde", [], "one for each decision"),
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


@pytest.mark.parametrize(
    ("lacking", "is_early"),
    [
        (["length_m"], False),
        (["kind", "change_time_s"], False),
        (["change_time_s"], True),
        ([one.column.name for one in BODY], True),
    ],
    ids=["one", "two", "early", "earlier"],
)
def test_only_what_early_libraries_lack_together_may_be_missing(
    filled: Path, lacking: list[str], is_early: bool
) -> None:
    rewrite(filled, "tracks", lambda table: table.drop_columns(lacking))
    library = CaseLibrary.open(filled)
    if is_early:
        assert library.verify() == []
        assert sum(len(cases) for cases, _ in library.shards()) == len(library)
        return
    with pytest.raises(FileFormatError, match=f'tracks-000001.parquet: it lacks the column "{min(lacking)}"'):
        list(library.shards())


def test_a_policy_is_named_by_its_hash(filled: Path) -> None:
    library = CaseLibrary.open(filled)
    facts = ShardFacts(7, library.odd, 0, 99)
    for text, fault in (
        ("0123456789abcdef", None),
        ("1e999", "\"policy\" of row 0 is '1e999'; it must be 16 hex digits"),
    ):
        table = pa.table({"policy": [text], "log_prob_policy": [0.0]})
        assert cases_fault(table, facts) == fault


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["cases", "tracks"])
@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.drop_columns(["case_id"]),
        lambda t: t.slice(1),
        lambda t: pa.concat_tables([t, t.slice(0, 1)]),
        lambda t: t.set_column(0, "case_id", pa.array(range(t.num_rows))),
        lambda t: t.take(list(range(t.num_rows))[::-1]),
    ],
    ids=["no ids", "a row less", "a row more", "ids as numbers", "turned round"],
)
def test_another_table_is_refused(filled: Path, kind: str, change: Callable[[pa.Table], pa.Table]) -> None:
    rewrite(filled, kind, change)
    with pytest.raises(FileFormatError, match=f"{kind}-000001"):
        list(CaseLibrary.open(filled).shards())


@pytest.mark.parametrize(
    ("whole", "possible", "implausible", "fine"),
    [
        (2.0, 2.0, 0, True),
        (math.inf, 2.0, 1, True),
        (math.inf, 2.0, 0, False),
        (3.0, 2.0, 0, False),
        (3.0, 2.0, 1, False),
    ],
)
def test_a_shortfall_is_that_of_its_parts(
    filled: Path, whole: float, possible: float, implausible: int, *, fine: bool
) -> None:
    values = {"shortfall_nats": whole, "possible_shortfall_nats": possible, "n_implausible": implausible}

    def change(table: pa.Table) -> pa.Table:
        for column, value in values.items():
            table = set_cell(column, value)(table)
        return table

    rewrite(filled, "cases", change)
    told = CaseLibrary.open(filled).verify()
    assert told == [] if fine else re.search("inf where n_implausible is above 0", told[0])


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
        library.append(cases, next_test=tests[-1] + 1, tests=tests[-1] + 1, crashes=tests[-1])
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
