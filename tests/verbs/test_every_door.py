"""A case is the same case whichever command made it, and every one says how natural its acts were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import cornerforge
from cornerforge.errors import FileFormatError
from cornerforge.fields import CASES, SHORTFALL
from cornerforge.library import CaseLibrary
from cornerforge.library.shards import encode_tables

pytestmark = pytest.mark.full

NAMES = [column.name for column in CASES]
BLIND = """
import numpy as np

class Av:
    "Holds 33 m/s and heeds nobody: crashes in natural traffic now and then."
    def act(self, view):
        return np.stack([np.clip(2.0 * (33.0 - view[:, 0, 3]), -3.0, 2.0), np.zeros(len(view))], axis=1)
"""
TESTS = 512


@pytest.fixture
def blind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "blind.py").write_text(BLIND, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return "blind:Av"


def cases_of(library: Path) -> pa.Table:
    return CaseLibrary.open(library).scalars(NAMES)


def assert_says_it(cases: pa.Table) -> None:
    """No column of the three is null, and an impossible act has no finite shortfall."""
    whole, possible, n = (cases.column(field.name) for field in SHORTFALL)
    assert whole.null_count == possible.null_count == n.null_count == 0
    whole, possible, n = (np.array(column.to_pylist()) for column in (whole, possible, n))
    np.testing.assert_array_equal(whole, np.where(n > 0, np.inf, possible))
    assert (possible >= 0.0).all()
    assert np.isfinite(possible).all()


def test_natural_crashes_of_a_foreign_av(blind: str, tmp_path: Path) -> None:
    """By `rate`, which records each crash again, and by `simulate --out`: the same rows."""
    cornerforge.rate(av=blind, max_tests=TESTS, out=tmp_path / "rate", seed=4)
    cornerforge.simulate(av=blind, tests=TESTS, out=tmp_path / "stored", seed=4)
    rated, stored = cases_of(tmp_path / "rate" / "library"), cases_of(tmp_path / "stored")
    assert stored.num_rows > 20
    assert repr(rated.to_pylist()) == repr(stored.to_pylist())
    assert_says_it(stored)
    natural = np.array(stored.column("shortfall_nats").to_pylist())
    assert (natural[np.isfinite(natural)] > 0.0).any()


def test_cases_of_an_adversary(swerve_library: Path, blind: str, tmp_path: Path) -> None:
    assert_says_it(cases_of(swerve_library))
    cornerforge.generate(policy="swerve", av=blind, cases=10, out=tmp_path / "foreign", seed=5)
    foreign = cases_of(tmp_path / "foreign")
    assert_says_it(foreign)
    assert min(foreign.column("n_implausible").to_pylist()) > 0, "swerve does what no attentive driver does"


def test_a_shrunk_case(swerve_library: Path, tmp_path: Path) -> None:
    case = CaseLibrary.open(swerve_library).scalars(["case_id"])["case_id"][0].as_py()
    cornerforge.shrink(swerve_library, [case], out=tmp_path / "small")
    assert_says_it(cases_of(tmp_path / "small"))


def test_a_library_of_an_early_version_is_refused_with_what_to_do(swerve_library: Path, tmp_path: Path) -> None:
    """No other number silently takes the place of what it lacks."""
    source = CaseLibrary.open(swerve_library)
    made = CaseLibrary.create(tmp_path / "old", source.identity, source.odd)
    ((cases, tracks),) = source.shards()
    shard = encode_tables(cases.drop_columns([field.name for field in SHORTFALL]), tracks)
    made.append_shard(shard, next_test=source.next_test, tests=source.tests, crashes=source.crashes)
    with pytest.raises(
        FileFormatError, match=r"of another version: it lacks .* cornerforge migrate OLD --out NEW"
    ) as told:
        cornerforge.analyse(tmp_path / "old", out=tmp_path / "analysis", avoidability="none")
    assert "FileFormatError" not in str(told.value)
