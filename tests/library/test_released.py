"""A library that was given up with nothing in it leaves its place to the corrected command."""

from __future__ import annotations

from pathlib import Path

import pytest

import cornerforge
from cornerforge.errors import InputError
from cornerforge.library import filling


def test_an_adversary_too_weak_leaves_the_folder_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filling, "_MAX_TESTS_PER_CASE", 20)
    out = tmp_path / "library"
    with pytest.raises(InputError, match=r"0 of 2 cases after .* tests"):
        cornerforge.generate(policy="lane-changer", cases=2, bounded=True, budget=0.0, out=out)
    assert not out.exists()
    assert cornerforge.generate(policy="swerve", cases=2, out=out).cases == 2
