"""`rate`: brute force that can be stopped, and says what it knows."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

import cornerforge
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.library import CaseLibrary
from cornerforge.rates import binomial_interval
from cornerforge.rates.monte_carlo import MonteCarlo, relative_half_width

# Looks at nobody's intentions, on the paper's quick lane changes: it crashes often enough to be counted in a test.
WORLD: dict[str, Any] = {"av": "idm-mobil-blind", "odd": "paper", "seed": 3}


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.import_module("cornerforge.pipeline.rate"), "_BLOCK", 2_000)


def test_rate_counts_what_simulate_counts(tmp_path: Path) -> None:
    found = cornerforge.rate(**WORLD, max_tests=6_000, target_rhw=0.001, out=tmp_path / "r")
    tally = cornerforge.simulate(**WORLD, tests=6_000)
    for key in ("tests", "av_crashes", "bv_crashes", "crashes_per_test", "interval95", "miles"):
        assert found[key] == tally[key], key
    assert found["av_crashes"] > 0, "this world must crash, or the test shows nothing"
    assert found["effective_sample_size"] == 6_000
    library = CaseLibrary.open(tmp_path / "r" / "library")
    assert len(library) == found["av_crashes"] == library.crashes
    assert library.tests == 6_000
    replayed = cornerforge.replay(tmp_path / "r" / "library", "all", check=True)
    assert replayed["identical"]


def test_resuming_gives_what_an_unbroken_run_gives(tmp_path: Path) -> None:
    whole = cornerforge.rate(**WORLD, max_tests=6_000, target_rhw=0.001, out=tmp_path / "whole")
    cornerforge.rate(**WORLD, max_tests=4_000, target_rhw=0.001, out=tmp_path / "parts")
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.rate(**WORLD, max_tests=6_000, target_rhw=0.001, out=tmp_path / "parts")
    parts = cornerforge.rate(**WORLD, max_tests=6_000, target_rhw=0.001, out=tmp_path / "parts", resume=True)
    timing = {"seconds", "tests_per_second"}
    assert {k: v for k, v in parts.items() if k not in timing} == {k: v for k, v in whole.items() if k not in timing}
    ids = [CaseLibrary.open(tmp_path / name / "library").history()[0] for name in ("whole", "parts")]
    assert ids[0] == ids[1]


def test_it_stops_when_the_interval_is_narrow_enough() -> None:
    counts = MonteCarlo(tests=1_000, av_crashes=50, crashed=tuple(range(50)))
    low, high = binomial_interval(50, 1_000)
    width = relative_half_width(low, high, 0.05)
    assert width is not None
    assert counts.is_enough(width)
    assert not counts.is_enough(0.99 * width)
    assert not MonteCarlo(tests=1_000).is_enough(10.0)


def test_counts_survive_their_file_and_refuse_another() -> None:
    counts = MonteCarlo().plus(
        tests=10, bv_crashes=1, world_steps=100, millimetres=4_000_000, seconds=1.5, crashed=(3, 7), digest="ab"
    )
    assert MonteCarlo.from_json(counts.to_json()) == counts
    with pytest.raises(FileFormatError):
        MonteCarlo.from_json({"tests": 3})
    with pytest.raises(FileFormatError, match="contradict"):
        MonteCarlo.from_json({**counts.to_json(), "av_crashes": 5})


@pytest.mark.parametrize(("name", "value"), [("max_tests", 0), ("target_rhw", 0.0), ("seed", -1), ("method", "magic")])
def test_bad_numbers_are_refused_before_anything_is_written(tmp_path: Path, name: str, value: object) -> None:
    with pytest.raises(InputError, match=name):
        cornerforge.rate(**{**WORLD, "out": tmp_path / "r", name: value})
    assert not (tmp_path / "r").exists()
