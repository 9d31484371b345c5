"""Columns of a library and of its analysis fit together in every row that is written; no reader looks again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from artefacts import artefact
from library_relations import ANALYSIS, RELATIONS, analysed_rows, broken, rows_of

from cornerforge.analysis.stored import read_analysed
from cornerforge.library import CaseLibrary
from cornerforge.results import Analysed
from cornerforge.results.stating import from_file


def check(library: CaseLibrary) -> None:
    """All rows, and that tests ascend within what the manifest says of the shards."""
    found = list(rows_of(library))
    assert len(found) == len(library) > 0
    assert [broken(row) for row in found] == [[]] * len(found)
    tests = [row.c["test"] for row in found]
    assert tests == sorted(set(tests))
    assert tests[-1] < library.next_test
    assert {row.c["seed"] for row in found} == {library.identity["seed"]}


@pytest.mark.full
@pytest.mark.parametrize(
    ("seeds", "place"),
    [("library", "lib"), ("case-file", "imported/library"), ("rate", "rate/library"), ("run", "run/library")],
)
def test_all_rows_of_a_real_library_fit_together(seeds: str, place: str) -> None:
    check(CaseLibrary.open(artefact(seeds) / place))


@pytest.mark.full
def test_all_rows_of_an_analysis_fit_together_and_with_its_summary() -> None:
    place = artefact("analysed")
    folder = place / "lib-analysis"
    rows = list(analysed_rows(folder, CaseLibrary.open(place / "lib").odd))
    assert [broken(row, ANALYSIS) for row in rows] == [[]] * len(rows)
    found = from_file(Analysed, folder / "analysis.json", "")
    assert found.cases == len(rows) == len({row.c["case_id"] for row in rows})
    assert read_analysed(folder / "points.parquet", "").num_rows == found.cases
    counts: dict[str, Mapping[Any, int]] = {
        "crash_type": found.crash_types,
        "fault": found.fault,
        "cluster": {one.id: one.size for one in found.clusters},
        "conduct": {} if found.own_doing is None else found.own_doing.conducts,
    }
    for column, said in counts.items():
        there = [row.c[column] for row in rows]
        assert {key: n for key, n in said.items() if n} == {key: there.count(key) for key in there}
    assert sum(found.fault_rules.values()) == found.majority + found.minority == found.cases
    assert set(found.features) == set(found.loadings)
    assert {len(one) for one in found.loadings.values()} == {len(found.explained_variance)} == {2}
    low, high = found.coverage.unseen_kind_interval95
    assert low <= found.coverage.unseen_kind_chance <= high
    assert sum(found.coverage.cells.values()) == found.coverage.cases


def put(index: int, value: Any) -> Callable[[list[Any]], list[Any]]:
    return lambda values: [value if i == index else one for i, one in enumerate(values)]


BREAKS: list[tuple[str, Any]] = [
    ("crash_time_s", 9000.0), ("duration_s", 3.0), ("av_speed_mps", lambda v: v + 1.0), ("n_decisions", 99),
    ("impact_speed_difference_mps", lambda v: -v), ("relative_lat_m", lambda v: v + 0.5), ("n_impossible", 99),
    ("log_prob_nde", None), ("critical_bv_action", [0]), ("n_implausible", 99), ("av_max_braking_mps2", None),
    ("physically_plausible", lambda v: not v), ("shortfall_nats", 1e9), ("trajectory_digest", "x"),
    ("n_vehicles", 999), ("case_id", "7:99"), ("n_frames", 30), ("slot", lambda v: v[::-1]),
    ("x_m", put(5, float("nan"))), ("speed_mps", lambda v: [one + 1.0 for one in v]), ("target_lane", put(5, 5)),
    ("present", put(5, False)), ("width_m", []), ("action", lambda v: v * 2), ("critical_bv", put(1, 77)),
    ("decision_log_prob_nde", []),
]  # fmt: skip


@pytest.mark.parametrize(("column", "value"), BREAKS, ids=[column for column, _ in BREAKS])
def test_a_row_that_does_not_fit_is_seen(filled: Path, column: str, value: Any) -> None:
    """A control of the relations; by hand: these cases know no shortfall, so that is made."""
    library = CaseLibrary.open(filled)
    check(library)
    row = next(rows_of(library))
    row = row._replace(c={**row.c, "shortfall_nats": 2.0, "possible_shortfall_nats": 2.0, "n_implausible": 0})
    assert broken(row) == []
    is_track = column in row.t and column != "case_id"
    columns = row.t if is_track else row.c
    columns = {**columns, column: value(columns[column]) if callable(value) else value}
    told = broken(row._replace(t=columns) if is_track else row._replace(c=columns))
    assert any(f'"{column}"' in one for one in told), told
    assert column in {one.column for one in RELATIONS}
