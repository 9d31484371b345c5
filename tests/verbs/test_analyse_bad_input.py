"""`cornerforge analyse` on libraries that are empty, tiny, all alike, damaged or mixed: a clear answer each time."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from reference.records import CaseRecord, append, case_record

from cornerforge import cli
from cornerforge._arrow import arrow_type
from cornerforge.library import CaseLibrary
from cornerforge.types import Scenario

Capture = pytest.CaptureFixture[str]
Change = Callable[[np.ndarray, int], np.ndarray]


def record_of(scenario: Scenario, test: int) -> CaseRecord:
    """A recorded crash as another test, whose acts were the likeliest."""
    likeliest = np.zeros(len(scenario.critical_bv))
    return case_record(replace(scenario, seed=0, test=test, shortfall=likeliest), trajectory_digest="0")


def library_of(path: Path, stored: Sequence[Scenario], n: int, change: Change = lambda history, _: history) -> Path:
    """A library of n cases made of recorded crashes, each history changed as wished."""
    odd = stored[0].odd
    library = CaseLibrary.create(path, {"seed": 0}, odd)
    records: list[CaseRecord] = []
    for test in range(n):
        record = record_of(stored[test % len(stored)], test)
        history = np.asarray(record.case["history"], np.float64).reshape(16, 2, 4)
        changed = pa.array([change(history.copy(), test).ravel()], arrow_type("float32[128]"))
        place = record.cases.schema.get_field_index("history")
        records.append(replace(record, cases=record.cases.set_column(place, record.cases.field(place), changed)))
    append(library, records, next_test=n, tests=n, crashes=n)
    return path


@pytest.fixture(scope="module")
def crashes(swerve_library: Path) -> list[Scenario]:
    library = CaseLibrary.open(swerve_library)
    return [library.scenario(name).scenario for name in library.scalars(["case_id"])["case_id"].to_pylist()[:20]]


def analysed(capsys: Capture, path: Path, *options: str) -> tuple[int, str, str]:
    status = cli.main(["analyse", str(path), "--json", "--quiet", *options])
    out, err = capsys.readouterr()
    return status, out, err


def test_an_empty_library_says_how_to_fill_it(tmp_path: Path, crashes: list[Scenario], capsys: Capture) -> None:
    CaseLibrary.create(tmp_path / "l", {"seed": 0}, crashes[0].odd)
    status, out, err = analysed(capsys, tmp_path / "l")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "holds no cases yet" in err
    assert "cornerforge generate" in err


@pytest.mark.parametrize("n", [1, 2, 9])
def test_few_cases_are_one_cluster_with_a_note(
    n: int, tmp_path: Path, crashes: list[Scenario], capsys: Capture
) -> None:
    status, out, _ = analysed(capsys, library_of(tmp_path / "l", crashes, n))
    found = json.loads(out)
    assert status == 0
    assert f"Only {n} case(s)" in found["note"]
    assert (found["cases"], found["majority"], found["rare"], found["eps"]) == (n, n, [], None)
    assert [one["size"] for one in found["clusters"]] == [n]


def test_identical_cases_are_one_cluster_with_a_note(tmp_path: Path, crashes: list[Scenario], capsys: Capture) -> None:
    status, out, _ = analysed(capsys, library_of(tmp_path / "l", crashes[:1], 40))
    found = json.loads(out)
    assert status == 0
    assert "same features" in found["note"]
    assert (found["majority"], found["minority"], len(found["clusters"])) == (40, 0, 1)
    assert found["explained_variance"] == [0.0, 0.0]


def test_two_kinds_of_identical_cases_are_two_clusters(
    tmp_path: Path, crashes: list[Scenario], capsys: Capture
) -> None:
    status, out, _ = analysed(capsys, library_of(tmp_path / "l", crashes[:2], 40))
    found = json.loads(out)
    assert status == 0
    assert "note" not in found
    assert sum(one["size"] for one in found["clusters"]) == found["cases"] == 40
    assert found["rare"] == []


def test_a_contact_that_is_no_number_is_named(tmp_path: Path, crashes: list[Scenario], capsys: Capture) -> None:
    def spoil(history: np.ndarray, test: int) -> np.ndarray:
        history[0, 1, 2] = np.nan if test == 7 else history[0, 1, 2]
        return history

    status, out, err = analysed(capsys, library_of(tmp_path / "l", crashes, 20, spoil))
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "history[7, 0] (the moment of contact) is not finite" in err
    assert "1 case(s) of 20" in err


def spoil_seconds(value: float) -> Change:
    """Write a value into the seconds from the third on of the first five cases."""

    def spoil(history: np.ndarray, test: int) -> np.ndarray:
        history[:, :, :] = history[0]
        history[2:, 1, 0] = value if test < 5 else history[2:, 1, 0]
        return history

    return spoil


def test_seconds_without_a_number_count_as_not_recorded(
    tmp_path: Path, crashes: list[Scenario], capsys: Capture
) -> None:
    status, out, _ = analysed(capsys, library_of(tmp_path / "l", crashes, 20, spoil_seconds(np.nan)), "--steps", "3")
    assert status == 0
    assert json.loads(out)["padded"] == 5


def test_an_infinite_value_is_named(tmp_path: Path, crashes: list[Scenario], capsys: Capture) -> None:
    status, out, err = analysed(capsys, library_of(tmp_path / "l", crashes, 20, spoil_seconds(np.inf)), "--steps", "3")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "history" in err
    assert "row 0 (case 0:0) is inf" in err


def test_more_seconds_than_any_case_has_are_padded_and_counted(
    tmp_path: Path, crashes: list[Scenario], capsys: Capture
) -> None:
    def cut(history: np.ndarray, _: int) -> np.ndarray:
        history[3:] = np.nan
        return history

    status, out, _ = analysed(capsys, library_of(tmp_path / "l", crashes, 20, cut), "--steps", "15")
    found = json.loads(out)
    assert status == 0
    assert (found["cases"], found["padded"], found["excluded"], len(found["features"])) == (20, 20, 0, 75)


@pytest.mark.parametrize("steps", ["0", "16", "-1"])
def test_a_history_longer_than_there_is_is_refused(
    steps: str, tmp_path: Path, crashes: list[Scenario], capsys: Capture
) -> None:
    status, out, err = analysed(capsys, library_of(tmp_path / "l", crashes, 3), "--steps", steps)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert f"steps = {steps} is out of range; allowed: from 1 to 15" in err


@pytest.mark.filterwarnings("default::cornerforge.library.shards.DamagedShardWarning")
def test_a_shard_of_another_schema_is_named_and_not_mixed_in(
    tmp_path: Path, crashes: list[Scenario], capsys: Capture
) -> None:
    """Cases with other columns in one of two shards: they are left out with a warning, never half read."""
    path = library_of(tmp_path / "l", crashes, 20)
    library = CaseLibrary.resume(path, {"seed": 0}, crashes[0].odd)
    more = [record_of(one, 20 + k) for k, one in enumerate(crashes)]
    append(library, more, next_test=40, tests=40, crashes=40)
    other = library_of(tmp_path / "other", crashes, 3)
    first, second = sorted(path.glob("*cases*.parquet")), sorted(other.glob("*cases*.parquet"))
    table = pq.read_table(second[0])
    pq.write_table(table.drop_columns(["history"]), first[1])
    status, out, err = analysed(capsys, path)
    assert (status, json.loads(out)["cases"]) == (0, 20)
    assert first[1].name in err
