"""Judges of crashes against each other, and reaction times: against the judges asked one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import cornerforge
from cornerforge.analysis.avoidability import AvoidParams, problems_of
from cornerforge.analysis.prevented import REACTIONS_S, prevented_at, prevention_of
from cornerforge.drivers.careful import CAREFUL
from cornerforge.library import CaseLibrary
from cornerforge.rates.judges import has_way_out, judges_of
from cornerforge.recordings import recordings_of_tracks
from cornerforge.results import Analysed

pytestmark = pytest.mark.full

CASES = 120


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("judges")
    cornerforge.generate(out=folder / "lib", cases=CASES, policy="swerve", seed=7, threads=1)
    return folder


@pytest.fixture(scope="module")
def analysed(library: Path) -> Analysed:
    return cornerforge.analyse(library / "lib", out=library / "analysis", avoidability="all", threads=2)


def test_shares_by_reaction_time_are_those_of_analyses_with_it(library: Path, analysed: Analysed) -> None:
    """From one search: the share with a delay is what a search with that delay finds."""
    assert analysed.judges is not None
    shares = {one.reaction_s: one.share for one in analysed.judges.avoidable}
    assert list(shares) == list(REACTIONS_S)
    assert len(set(shares.values())) == len(shares), "the delays make no difference here"
    for delay in (0.0, 0.5, 1.0, 1.5):
        again = cornerforge.analyse(library / "lib", avoidability="all", reaction=delay, threads=2)
        assert again.avoidability is not None
        assert again.avoidability.labels["undecided"] == 0
        assert shares[delay] == again.avoidability.avoidable_share
        assert again.judges is not None
        assert again.judges.lead.reaction_s == (delay or 1.0)
        assert again.judges.lead.share == shares[delay or 1.0]


def test_drivers_at_reaction_times(library: Path, analysed: Analysed) -> None:
    [(cases, tracks)] = CaseLibrary.open(library / "lib").shards()
    odd = CaseLibrary.open(library / "lib").odd
    recordings = recordings_of_tracks(cases, tracks)
    problems = problems_of(recordings, cases.column("bv_slot").to_pylist(), odd)
    own = prevention_of(recordings, problems, odd, AvoidParams()).prevented
    each = prevented_at(recordings, problems, odd, AvoidParams(), threads=2)
    assert each.shape == (CASES, len(REACTIONS_S), len(CAREFUL))
    for name in ("cc-human", "rss-brake", "fsm"):
        k = CAREFUL[name]
        np.testing.assert_array_equal(each[:, REACTIONS_S.index(0.75), k], own[:, k])
    k = CAREFUL["reg157"]
    at_its_own = prevention_of(recordings, problems, odd, AvoidParams(), reaction_s=0.35).prevented
    np.testing.assert_array_equal(at_its_own[:, k], own[:, k])
    assert (each[:, 0] != each[:, -1]).any(), "nobody is helped by reacting at once"
    assert analysed.judges is not None
    for name, shares in analysed.judges.prevented.items():
        assert [one.cases for one in shares] == each[:, :, CAREFUL[name]].sum(axis=0).tolist()
        for one in shares:
            assert one.share == one.cases / CASES
            assert one.interval95[0] <= one.share <= one.interval95[1]


def test_agreement_is_that_of_the_columns(library: Path, analysed: Analysed) -> None:
    rows = pq.read_table(library / "analysis" / "cases.parquet").to_pylist()
    found = analysed.judges
    assert found is not None
    assert found.cases == CASES
    says = {name: [name in row["prevented_by"].split(", ") for row in rows] for name in CAREFUL}
    says["holding the speed"] = [row["held_speed_prevents"] for row in rows]
    times = [row["time_to_react_s"] for row in rows]
    says |= {f"way out after {after} s": [t is not None and t >= after for t in times] for after in (0.75, 1)}
    assert set(says) == set(found.agreement) == set(found.both)
    for a, first in says.items():
        for b, second in says.items():
            assert found.both[a][b] == sum(x and y for x, y in zip(first, second, strict=True))
            same = sum(x == y for x, y in zip(first, second, strict=True))
            assert found.agreement[a][b] == pytest.approx(same / CASES)
    assert min(min(row.values()) for row in found.agreement.values()) < 0.9, "judges that never differ compare nothing"


def test_a_way_out_counts_from_its_reaction_time_on() -> None:
    times = np.array([np.nan, -0.4, 0.0, 0.7, 0.8, 1.0, 3.1])
    other = np.zeros(times.size, np.bool_)
    assert has_way_out(times, other, 0.0).tolist() == [False, False, True, True, True, True, True]
    assert has_way_out(times, other, 0.75).tolist() == [False, False, False, False, True, True, True]
    assert has_way_out(times, other, 1.0).tolist() == [False, False, False, False, False, True, True]
    assert has_way_out(times, ~other, 1.0).tolist() == has_way_out(times, other, 0.0).tolist()


def test_without_cases_there_is_nothing_to_compare() -> None:
    none = np.zeros(0, np.bool_)
    assert judges_of(np.zeros(0), none, {"fsm": none}, none, np.zeros((0, len(REACTIONS_S), 1), np.bool_)) is None
    analysed = {"cc-human": np.array([True]), "fsm": np.array([False])}
    reacting = np.zeros((1, len(REACTIONS_S), 2), np.bool_)
    found = judges_of(np.array([0.5]), np.array([False]), analysed, np.array([True]), reacting)
    assert found is not None
    assert found.agreement["cc-human"]["fsm"] == 0.0
    assert found.both["cc-human"]["holding the speed"] == 1
