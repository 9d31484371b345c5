"""`rate --method splitting` and `is`: weighted tests give the rate that counting gives, or say they are in doubt."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import FileFormatError, InputError
from cornerforge.library import CaseLibrary
from cornerforge.rates import binomial_interval
from cornerforge.rates.branching import danger
from cornerforge.rates.splitting import pick
from cornerforge.results import NaturalRate
from cornerforge.verbs.rate import rate_without_copies

pytestmark = pytest.mark.full

SIGMAS = 5.0
"""A right estimate is further off with a chance of 6e-7."""


@pytest.fixture(scope="module")
def world(reckless_model: Path) -> dict[str, Any]:
    """A world in which the AV often crashes, in several ways."""
    return {"av": "idm-mobil", "odd": "paper", "seed": 3, "model": reckless_model, "lanes": 2}


@pytest.fixture(autouse=True)
def small(small_trees: None, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001 - it patches
    """A rate may rest on few trees."""
    monkeypatch.setattr(importlib.import_module("cornerforge.rates.splitting"), "LEAST_TREES", 2_000)


def untimed(found: NaturalRate) -> NaturalRate:
    nothing = replace(
        found.effort, **{name: replace(cost, cpu_seconds=0.0) for name, cost in vars(found.effort).items()}
    )
    return replace(
        found, seconds=0.0, cpu_seconds=0.0, tests_per_second=None, acceleration=0.0, effort=nothing, reason=""
    )


@pytest.mark.slow
@pytest.mark.parametrize(("method", "most"), [("splitting", 20_000), ("is", 60_000)])
def test_weighted_tests_and_counting_agree(world: dict[str, Any], tmp_path: Path, method: str, most: int) -> None:
    counted = cornerforge.rate(**world, method="mc", max_tests=40_000, target_rhw=0.001)
    found = cornerforge.rate(**world, method=method, max_tests=most, target_rhw=0.001, out=tmp_path / "r")
    assert (found.method, found.state, found.doubts) == (method, "max_tests", ())
    assert found.tests == most - 4_000 - 500
    sd_counted = (counted.crashes_per_test / counted.tests) ** 0.5
    assert found.relative_half_width_90 is not None
    sd = found.relative_half_width_90 * found.crashes_per_test / 1.645
    assert abs(found.crashes_per_test - counted.crashes_per_test) < SIGMAS * np.hypot(sd, sd_counted)
    low, high = found.interval95
    assert low < found.crashes_per_test - 1.96 * sd < found.crashes_per_test + 1.96 * sd < high

    # Kinds sum up to the rate, and those that count are those that counting finds.
    for kinds, by_counting in (
        (found.crash_type_rates, counted.crash_type_rates),
        (found.mechanism_rates, counted.mechanism_rates),
    ):
        assert sum(kind.crashes_per_test for kind in kinds.values()) == pytest.approx(found.crashes_per_test)
        for name, kind in by_counting.items():
            width = kind.interval95[1] - kind.interval95[0]
            own = kinds[name].interval95[1] - kinds[name].interval95[0] if name in kinds else 0.0
            apart = abs(kind.crashes_per_test - (kinds[name].crashes_per_test if name in kinds else 0.0))
            assert apart < SIGMAS * np.hypot(width, own) / (2 * 1.96), name

    # The library holds cases that replay, and whose weights sum up to the rate.
    library = CaseLibrary.open(tmp_path / "r" / "weighted")
    assert len(library) == sum(found.crash_types.values()) > 50
    assert cornerforge.replay(tmp_path / "r" / "weighted", "all", check=True).identical
    weight = library.scalars(["weight"])["weight"].to_numpy()
    assert weight.sum() == pytest.approx(found.crashes_per_test)

    # An analysis of it gives each kind the rate that the run gave it.
    natural = cornerforge.analyse(tmp_path / "r" / "weighted", avoidability="none").natural
    assert natural is not None
    for by_cases, of_run in (
        (natural.crash_types, found.crash_type_rates),
        (natural.mechanisms, found.mechanism_rates),
    ):
        assert {name: kind.crashes_per_test for name, kind in by_cases.items()} == pytest.approx(
            {name: kind.crashes_per_test for name, kind in of_run.items()}
        )

    # What everything took is told.
    assert (found.effort.plain.tests, found.effort.teaching.tests, found.effort.estimation.tests) == (
        4_000,
        500,
        most - 4_500,
    )
    parts = [cost.cpu_seconds for cost in vars(found.effort).values()]
    assert found.cpu_seconds == pytest.approx(sum(parts), abs=0.01)
    assert found.plain_tests == 4_000


def test_resuming_gives_what_an_unbroken_run_gives(world: dict[str, Any], tmp_path: Path) -> None:
    given = {**world, "method": "splitting", "target_rhw": 0.001}
    whole = cornerforge.rate(**given, max_tests=6_500, threads=1, out=tmp_path / "whole")
    cornerforge.rate(**given, max_tests=5_250, out=tmp_path / "parts")  # one block and a half
    assert [path.name for path in sorted((tmp_path / "parts" / "trees").iterdir())] == ["000000.npz"]
    parts = cornerforge.rate(**given, max_tests=6_500, out=tmp_path / "parts", resume=True)
    assert untimed(parts) == untimed(whole)
    ids = [CaseLibrary.open(tmp_path / name / "weighted").scalars(["case_id"]) for name in ("whole", "parts")]
    assert ids[0] == ids[1]


def test_damaged_files_are_told_and_counted_crashes_stay(world: dict[str, Any], tmp_path: Path) -> None:
    given, out = {**world, "target_rhw": 0.001, "out": tmp_path / "r"}, tmp_path / "r"
    cornerforge.rate(**given, max_tests=2_000)
    counted = len(CaseLibrary.open(out / "library"))
    cornerforge.rate(**given, max_tests=5_000, resume=True)
    assert len(CaseLibrary.open(out / "library")) == counted
    for name in ("taught.npz", "trees/000000.npz"):
        whole = (out / name).read_bytes()
        for content in (whole[: len(whole) // 2], b"", b"nothing of ours"):
            (out / name).write_bytes(content)
            with pytest.raises(FileFormatError, match=f"{name} is damaged"):
                cornerforge.rate(**given, max_tests=5_500, resume=True)
        (out / name).write_bytes(whole)
    cornerforge.rate(**given, max_tests=5_500, resume=True)


def test_few_trees_are_in_doubt_and_the_exit_status_says_so(
    world: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["rate", "--method", "splitting", "--max-tests", "5000", "--seed", "3", "--odd", "paper", "--lanes", "2"]
    assert main([*words, "--model", str(world["model"])]) == 1
    said = capsys.readouterr()
    assert said.err.strip().splitlines()[-1].startswith("Not to be trusted yet: it rests on ")
    assert int(said.err.split("--max-tests ")[1].split()[0]) > 5_000
    assert "A touch once in " in said.out
    assert " trees of tests), " in said.out.splitlines()[0]


def test_no_crash_leaves_the_bound_of_the_plain_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody is reckless here, and nothing is learned or explored."""
    teaching = importlib.import_module("cornerforge.rates.teaching")
    monkeypatch.setattr(teaching, "_EXPLORE_LATER", 0.0)
    monkeypatch.setattr(teaching, "shipped_network", lambda: danger.untaught(1e-6))
    found = cornerforge.rate(method="splitting", max_tests=5_000, seed=1)
    assert (found.state, found.crashes_per_test, found.crash_types["sideswipe"]) == ("no crash", 0.0, 0)
    assert (found.interval95, found.tests) == (binomial_interval(0, 4_000), 4_000)
    assert len(found.doubts) == 1


def test_auto_says_what_it_chose(world: dict[str, Any]) -> None:
    few = cornerforge.rate(**world, max_tests=2_000)
    assert (few.method, "too few" in few.reason) == ("mc", True)
    often = cornerforge.rate(**world, max_tests=20_000, target_rhw=0.2)
    assert (often.method, "plain tests" in often.reason) == ("mc", True)
    rare = cornerforge.rate(max_tests=5_000, seed=1)
    assert (rare.method, rare.reason) == ("splitting", "4,000 plain tests had 0 crashes, so counting would take longer")
    for without_copies, like in (
        (rate_without_copies(**world, max_tests=20_000, target_rhw=0.2), often),
        (rate_without_copies(max_tests=5_000, seed=1), rare),
    ):
        assert without_copies.reason == like.reason
        assert without_copies.method == ("is" if like is rare else "mc")
    with pytest.raises(InputError, match="too few to learn what"):
        cornerforge.rate(**world, method="splitting", max_tests=2_000)


def test_picked_weights_sum_up_to_all_in_the_mean() -> None:
    rng = np.random.default_rng(0)
    weights = np.where(rng.random(3000) < 0.3, np.exp(rng.normal(0.0, 2.0, 3000)), 0.0)
    sums, odd, sizes = [], [], []
    for _ in range(400):
        which, stands_for = pick(weights, 100, rng)
        assert (np.diff(which) > 0).all()
        assert (stands_for >= weights[which]).all()
        sums.append(stands_for.sum())
        odd.append(stands_for[which % 2 == 1].sum())
        sizes.append(which.size)
    for drawn, true in ((sums, weights.sum()), (odd, weights[1::2].sum()), (sizes, 100.0)):
        assert abs(np.mean(drawn) - true) < SIGMAS * np.std(drawn) / np.sqrt(len(drawn)) + 1e-9


@pytest.mark.parametrize("method", ["splitting", "is"])
@pytest.mark.usefixtures("in_memory")
def test_an_av_from_outside(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    source = (Path(__file__).parents[2] / "examples" / "my_av.py").read_text(encoding="utf-8")
    careless = source.replace("0.1 * room - 0.6 * closing", "0.05 * room - 0.1 * closing")
    assert careless != source
    (tmp_path / "careless.py").write_text(careless, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    given = {**world, "av": "careless:MyAv", "target_rhw": 0.001}
    counted = cornerforge.rate(**given, method="mc", max_tests=10_000)
    found = cornerforge.rate(**given, method=method, max_tests=8_000, out="r")
    assert (found.method, found.state) == (method, "max_tests")
    assert counted.av_crashes > 30
    assert found.relative_half_width_90 is not None
    sd = np.hypot(
        found.relative_half_width_90 * found.crashes_per_test / 1.645,
        np.sqrt(counted.crashes_per_test / counted.tests),
    )
    assert abs(found.crashes_per_test - counted.crashes_per_test) < SIGMAS * sd
    assert cornerforge.rate(**given, method=method, max_tests=8_000, out="r", resume=True).digest == found.digest
    again = cornerforge.replay("r/weighted", "all", check=True)
    assert again.identical
    assert again.cases == len(CaseLibrary.open(Path("r/weighted"))) >= 15
    assert cornerforge.analyse("r/weighted", out="a").cases == again.cases
