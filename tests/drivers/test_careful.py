"""Reference drivers: against the published verdicts where they lie, and against what can be computed by hand."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest

from cornerforge.drivers.careful import CAREFUL, Threat, braking_demanded, braking_of, crashes_at_cut_ins, own_reaction
from cornerforge.errors import InputError, UnknownNameError

VERDICTS = Path(__file__).parents[3] / "shared" / "data" / "r157" / "cut_in.csv.gz"
COLUMN = {"cc-human": "crash_cc_human", "reg157": "crash_reg157", "rss-brake": "crash_rss", "fsm": "crash_fsm"}


@pytest.mark.skipif(not VERDICTS.exists(), reason="the verdicts are no part of the repository")
@pytest.mark.parametrize("driver", CAREFUL)
def test_it_crashes_where_the_public_implementation_does(driver: str) -> None:
    with gzip.open(VERDICTS, "rt", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    ego, other, gap, across, crash = (
        np.array([float(row[name]) for row in rows])
        for name in ("ego_kmh", "cut_in_kmh", "gap_m", "lateral_speed_mps", COLUMN[driver])
    )
    found = crashes_at_cut_ins(driver, ego / 3.6, other / 3.6, gap, across)
    assert crash.mean() > 0.05
    assert (found == (crash == 1)).mean() >= 0.995


CRASHES = {
    (130, 70, 0.5): (20, 10, 3, 0),
    (130, 70, 1.0): (20, 14, 7, 9),
    (130, 70, 1.6): (21, 15, 9, 10),
    (130, 100, 0.7): (11, 6, 3, 1),
    (130, 40, 1.3): (29, 30, 17, 20),
    (90, 40, 1.0): (16, 10, 5, 6),
    (90, 10, 0.9): (26, 23, 11, 14),
}
"""Speeds of both [km/h], lateral speed [m/s] -> in how many of the gaps 1, 3, ..., 119 m the public implementation says
that each driver crashes."""


@pytest.mark.parametrize("case", CRASHES)
def test_it_crashes_as_often_as_the_public_implementation_says(case: tuple[int, int, float]) -> None:
    ego, other, across = case
    found = [crashes_at_cut_ins(name, ego / 3.6, other / 3.6, np.arange(1.0, 120.0, 2.0), across) for name in CAREFUL]
    np.testing.assert_allclose([one.sum() for one in found], CRASHES[case], atol=1)


def test_a_vehicle_that_never_comes_over_is_no_danger() -> None:
    assert not crashes_at_cut_ins("fsm", 36.0, 3.0, [1.0, 20.0], 0.0).any()


def test_when_danger_is_seen() -> None:
    """By the sentences of the regulation and of the papers, for one closing speed of 10 m/s."""
    codes = CAREFUL

    def sees(driver: str, gap: float, aside: float, towards: float = 0.0) -> bool:
        return braking_demanded(codes[driver], 30.0, 0.0, Threat(gap, gap + 10.0, aside, towards, 20.0)) > 0.0

    assert sees("cc-human", 19.9, 0.0)
    assert not sees("cc-human", 20.1, 0.0)
    assert not sees("cc-human", 5.0, 0.1)
    enough = 10.0 * (10.0 / 12.0 + 0.45)
    assert sees("reg157", enough - 0.1, 0.5)
    assert not sees("reg157", enough + 0.1, 0.5)
    assert not sees("reg157", 5.0, 0.6)
    along = 30 * 0.75 + 0.5 * 3 * 0.75**2 + (30 + 2.25) ** 2 / 12 - 20**2 / 12
    assert sees("rss-brake", along - 0.1, 0.5)
    assert not sees("rss-brake", along + 0.1, 0.5)
    across = 0.3 + 0.5 * 0.75 * 0.75 + 0.75**2 / 2  # it stands still sideways
    assert sees("rss-brake", 10.0, across - 0.01)
    assert not sees("rss-brake", 10.0, across + 0.01)
    assert sees("fsm", 10.0, 1.0, towards=1.0)  # there in 1 s, passed in 2 s
    assert not sees("fsm", 10.0, 3.0, towards=1.0)
    assert not sees("fsm", 10.0, 1.0, towards=-1.0)


def test_how_they_brake() -> None:
    def course(driver: str, demanded: float) -> list[float]:
        a, found = 0.0, []
        for k in range(20):
            a = braking_of(CAREFUL[driver], 0.1 * k, demanded, a, 0.1, own_reaction(CAREFUL[driver]))
            found.append(a)
        return found

    hardest = 0.774 * 9.81
    human = course("cc-human", hardest)
    assert human[:8] == [-0.4] * 8
    np.testing.assert_allclose(np.diff(human[7:13]), -1.265, atol=1e-12)
    assert human[-1] == -hardest
    assert course("reg157", 6.0)[:6] == [0.0, 0.0, 0.0, 0.0, -6.0, -6.0]
    assert course("rss-brake", hardest)[:8] == [0.0] * 8
    assert course("fsm", 4.5)[-1] == -4.5
    assert braking_of(CAREFUL["fsm"], 3.0, 0.0, -4.5, 0.1, 0.75) == 0.0, "when danger is over it holds its speed"


def test_bad_input_is_named() -> None:
    with pytest.raises(UnknownNameError, match="cc-human"):
        crashes_at_cut_ins("cc-humen", 1.0, 1.0, 1.0, 1.0)
    with pytest.raises(InputError, match="gap must be finite and at least 0"):
        crashes_at_cut_ins("fsm", 1.0, 1.0, [1.0, -1.0], 1.0)
    with pytest.raises(InputError, match="do not match"):
        crashes_at_cut_ins("fsm", [1.0, 2.0], 1.0, [1.0, 1.0, 1.0], 1.0)
