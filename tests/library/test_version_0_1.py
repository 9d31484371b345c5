"""A library of version 0.1 (commit 13dca06: `generate --policy swerve --cases 12 --seed 3`), read and migrated."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge._checksums import NoChecksumWarning
from cornerforge.errors import FileFormatError
from cornerforge.library import CaseLibrary

OLD = Path(__file__).parent / "version_0_1"
FIRST = "38632621c336e1c28a02d0323240a728d8eda9e0e6df9e00f388ca32f2b1d819"
"""Digest of its first case, as version 0.1 printed it."""


def test_it_is_read_with_a_note() -> None:
    with pytest.warns(NoChecksumWarning, match=r"manifest\.json carries no checksum"):
        library = CaseLibrary.open(OLD)
    assert len(library) == 12
    assert library.verify() == []
    first = library.scenario("3:0")
    assert first.scalars["trajectory_digest"] == FIRST
    assert first.scalars["bv_length_m"] is None
    with pytest.warns(NoChecksumWarning):
        count = cornerforge.query(OLD, "select count(*) from cases where bv_kind = 0")
    assert count.rows == ((12,),)


@pytest.mark.filterwarnings("ignore::cornerforge._checksums.NoChecksumWarning")
def test_it_is_migrated(tmp_path: Path) -> None:
    found = cornerforge.migrate(OLD, out=tmp_path / "new")
    assert (found.cases, found.made_by) == (12, "0.1.0")
    old = CaseLibrary.open(OLD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        new = CaseLibrary.open(tmp_path / "new")
        assert new.verify() == []
        assert cornerforge.verify(tmp_path / "new").without_checksum == ()
    assert (new.identity, new.odd, new.tests, new.crashes, new.finished) == (
        old.identity, old.odd, old.tests, old.crashes, old.finished,
    )  # fmt: skip
    assert new.scalars().equals(old.scalars())
    for theirs, ours in zip(old.scenarios(["3:0", "3:5"]), new.scenarios(["3:0", "3:5"]), strict=True):
        np.testing.assert_array_equal(ours.scenario.x, theirs.scenario.x)
        np.testing.assert_array_equal(ours.history, theirs.history)
        assert set(ours.scenario.length) == {5.0}
    assert json.loads((tmp_path / "new" / "provenance.json").read_text(encoding="utf-8"))["made_by"] == "0.1.0"


@pytest.mark.filterwarnings("ignore::cornerforge._checksums.NoChecksumWarning")
def test_a_damaged_one_is_not_migrated(tmp_path: Path) -> None:
    for file in OLD.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    content = bytearray((tmp_path / "tracks-000000.parquet").read_bytes())
    content[5000] ^= 1
    (tmp_path / "tracks-000000.parquet").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"tracks-000000\.parquet has been changed"):
        cornerforge.migrate(tmp_path, out=tmp_path / "new")
    assert not (tmp_path / "new").exists()
