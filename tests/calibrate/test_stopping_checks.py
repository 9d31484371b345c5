"""Checks of `ndd validate` on traffic that stops and merges."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cornerforge.experiment.setting import experiment
from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.stopping import compare_merges, compare_queues


def reading_of(factor: float) -> Any:
    """A file of following decisions with I-80's quartiles of gaps, times a factor: standing, and at 3 to 8 m/s."""
    rng = np.random.default_rng(1)
    gaps = [np.exp(rng.normal(np.log(m), np.log(top / m) / 0.6745, 3000)) for m, top in ((3.02, 4.09), (10.05, 13.88))]
    gap = np.concatenate(gaps) * factor
    speed = np.concatenate([np.full(3000, 0.1), rng.uniform(3.0, 8.0, 3000)])
    zero = np.zeros(gap.size)
    decisions = Decisions(speed, gap, zero, zero, zero.astype(np.int64), zero.astype(np.bool_))
    return SimpleNamespace(decisions=decisions, layout=SimpleNamespace(kind="pairs"))


@pytest.mark.parametrize(("factor", "within"), [(1.0, True), (2.0, False), (0.4, False)])
def test_gaps_in_a_queue_are_held_against_recorded_ones(factor: float, within: bool) -> None:
    rows = compare_queues(experiment(), ["file"], [reading_of(factor)])
    assert len(rows) == 6
    assert {row.within for row in rows} == {within}
    for row in rows:
        assert row.found is not None
        assert row.interval95 is not None
        assert row.interval95[0] < row.found < row.interval95[1]


def test_a_model_without_slow_rows_has_no_queue() -> None:
    run = experiment()
    assert compare_queues(replace(run, model=replace(run.model, slow=None)), ["file"], [reading_of(1.0)]) == []


def test_drivers_merge_near_the_begin_and_few_are_late() -> None:
    place, late = compare_merges(experiment(), ["file"], [reading_of(1.0)])
    assert place.within
    assert place.n > 500
    assert late.found is not None
    assert late.found < 0.06
    assert late.interval95 is not None
