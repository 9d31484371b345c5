"""`simulate`: the same outcome for any threads, rates with units and intervals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cornerforge
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.library import CaseLibrary
from cornerforge.results import Simulated
from cornerforge.results.driving import Quantity
from cornerforge.sim import runner
from cornerforge.sim.statistics import TTC_LIMITS

QUANTILES = ["1", "5", "25", "50", "75", "95", "99"]


def without_times(result: Simulated) -> Simulated:
    return replace(result, seconds=0.0, world_steps_per_second=0.0, tests_per_second=0.0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("bv", ["nde", "idm", "uniform", "lane-changer", "swerve"])
def test_the_result_does_not_depend_on_threads(bv: str) -> None:
    one, two = (cornerforge.simulate(tests=700, bv=bv, seed=3, threads=n, stats=True) for n in (1, 2))
    assert without_times(one) == without_times(two)
    assert one.digest != cornerforge.simulate(tests=700, bv=bv, seed=4).digest


def test_counting_changes_nothing() -> None:
    plain = cornerforge.simulate(tests=600, bv="swerve")
    counted = cornerforge.simulate(tests=600, bv="swerve", stats=True)
    assert counted.distributions is not None
    assert without_times(plain) == without_times(replace(counted, distributions=None))


def test_rates_fit_together() -> None:
    r = cornerforge.simulate(tests=1000, bv="swerve", seed=1)
    assert r.tests == 1000
    assert r.crashes_per_test == r.av_crashes / 1000
    assert r.interval95[0] < r.crashes_per_test < r.interval95[1]
    assert r.crashes_per_mile == pytest.approx(r.av_crashes / r.miles)
    per_mile = [bound * 1000 / r.miles for bound in r.interval95]
    assert r.interval95_per_mile == pytest.approx(per_mile)
    assert 0.0 < r.miles < 1000 * 410.0 / 1609.344  # a test is 400 m and at most one substep more
    assert len(r.digest) == 64


def test_no_crash_is_no_proof_of_safety() -> None:
    r = cornerforge.simulate(tests=500, seed=0)
    assert r.av_crashes == 0
    assert r.interval95 == (0.0, pytest.approx(1.0 - 0.025 ** (1.0 / 500)))
    assert r.miles == pytest.approx(500 * 400.0 / 1609.344, rel=0.01)


def test_statistics_have_the_promised_shape() -> None:
    found = cornerforge.simulate(tests=300, stats=True).distributions
    assert found is not None
    for name in ("speed", "gap", "time_gap", "range_rate", "acceleration"):
        quantity: Quantity = getattr(found, name)
        assert quantity.n > 1000
        assert quantity.mean is not None
        assert quantity.sd is not None
        assert quantity.sd > 0.0
        quantiles = quantity.quantiles
        assert list(quantiles) == QUANTILES
        assert list(quantiles.values()) == sorted(quantiles.values())
        assert quantiles["1"] <= quantity.mean <= quantiles["99"]
    assert list(found.ttc_share_below) == [f"{limit:g}" for limit in TTC_LIMITS]
    shares = [found.ttc_share_below[limit] for limit in ("3", "5", "10", "20")]
    below = [share for share in shares if share is not None]
    assert shares == below == sorted(below)
    assert 0.0 <= below[0] <= below[-1] <= 1.0
    assert found.lane_changes_per_mile is not None
    assert found.lane_changes_per_mile > 0.0


@pytest.mark.parametrize("lanes", [2, 4, 6])
def test_other_numbers_of_lanes(lanes: int) -> None:
    r = cornerforge.simulate(tests=60, lanes=lanes, stats=True)
    assert r.tests == 60
    assert r.digest != cornerforge.simulate(tests=60).digest


@pytest.mark.sampled(1)
@pytest.mark.parametrize("bv", ["swerve", "uniform", "nde"])  # most, few and no tests crash
def test_out_stores_the_crashes_that_are_counted(bv: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = cornerforge.simulate(tests=600, bv=bv, seed=2, stats=True)
    # each test is driven once: nothing may be driven for the counts alone
    driven: list[int] = []
    drive_range = runner.drive_range

    def count(*arguments: Any) -> None:
        driven.append(arguments[-1].code.size)
        drive_range(*arguments)

    monkeypatch.setattr(runner, "drive_range", count)
    told: set[str] = set()
    stored = cornerforge.simulate(
        tests=600, bv=bv, seed=2, stats=True, out=tmp_path / "library", progress=lambda stage, *_: told.add(stage)
    )
    assert (told, sum(driven)) == ({"store"}, 0)
    assert (stored.cases, stored.library) == (plain.av_crashes, str(tmp_path / "library"))
    assert without_times(replace(stored, cases=None, library=None)) == without_times(plain)
    library = CaseLibrary.open(tmp_path / "library")
    assert (library.tests, library.crashes, len(library)) == (600, plain.av_crashes, plain.av_crashes)
    assert library.finished


@pytest.mark.full
def test_more_tests_go_on_in_the_same_library(tmp_path: Path) -> None:
    cornerforge.simulate(tests=200, bv="swerve", out=tmp_path / "a")
    two = cornerforge.simulate(tests=500, bv="swerve", out=tmp_path / "a", resume=True)
    one = cornerforge.simulate(tests=500, bv="swerve", out=tmp_path / "b")
    columns = ["case_id", "trajectory_digest"]
    again = cornerforge.simulate(tests=500, bv="swerve", out=tmp_path / "a", resume=True)
    assert without_times(again) == without_times(replace(one, library=str(tmp_path / "a")))
    assert without_times(two) == without_times(again)
    first, second = (CaseLibrary.open(tmp_path / name) for name in "ab")
    assert first.scalars(columns).equals(second.scalars(columns))
    assert (first.tests, first.crashes) == (second.tests, second.crashes)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tests": 0}, "tests = 0"),
        ({"tests": 10, "seed": -1}, "seed = -1"),
        ({"tests": 10, "seed": 2**63}, "seed"),
        ({"tests": 10, "threads": 0}, "threads = 0"),
        ({"tests": 10, "lanes": 7}, "lanes = 7"),
        ({"tests": 10, "bounded": True}, "bounded"),
    ],
)
def test_what_is_out_of_range_is_refused(arguments: dict[str, int], message: str, tmp_path: Path) -> None:
    for out in (None, tmp_path / "library"):
        with pytest.raises(InputError, match=message):
            cornerforge.simulate(**arguments, out=out)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "near"),
    [({"av": "idm-mobl"}, "idm-mobil"), ({"bv": "unifom"}, "uniform"), ({"odd": "swif"}, "swift")],
)
def test_unknown_names_suggest_the_nearest(arguments: dict[str, str], near: str) -> None:
    with pytest.raises(UnknownNameError, match=f'Did you mean "{near}"'):
        cornerforge.simulate(tests=10, **arguments)  # type: ignore[arg-type]
