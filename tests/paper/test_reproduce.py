"""`reproduce`: what an item compares with what, what is kept, and what a resumed call does again."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folder_snapshot import snapshot

import cornerforge
from cornerforge.adversary.config import PRESETS
from cornerforge.drivers.policy import n_weights
from cornerforge.errors import InputError, OutputError, UnknownNameError
from cornerforge.experiment.counting import simulate_experiment
from cornerforge.experiment.policy_file import Policy, load_policy, save_policy
from cornerforge.experiment.setting import experiment
from cornerforge.ext.paper import bench as bench_module
from cornerforge.ext.paper import clusters, examples, figure3, figure7
from cornerforge.ext.paper.bench import Adversary, Bench, ReproduceEffort, keep, library_of, pooled
from cornerforge.ext.paper.figure2 import seconds_to_yield
from cornerforge.ext.paper.matrix import adversaries
from cornerforge.ext.paper.reproduce import ITEMS
from cornerforge.ext.paper.reproduction import RENDERERS
from cornerforge.ext.paper.table1 import TABLE1
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.rates import binomial_interval
from cornerforge.results import Reproduced, as_json
from cornerforge.sim.statistics import EXPOSURE
from cornerforge.verbs.train import EVALUATION_TESTS, load_timed_policy
from cornerforge.world_options import WorldOptions

pytestmark = pytest.mark.full

# Too short to learn anything (replay_start is 16,384): the yields are those of random weights.
TINY = ReproduceEffort(
    decisions=1_024, bounded_decisions=1_024, seeds=2, trained_on=("idm-mobil",), rewards=("crash",), tests=96,
    natural_tests=200, typed=10, miles=1.0, cases=12,
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def tiny_effort() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(bench_module.REPRODUCE_EFFORTS, "quick", TINY)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Reproduced]:
    folder = tmp_path_factory.mktemp("reproduce") / "out"
    return folder, cornerforge.reproduce(effort="quick", out=folder, seed=3)


def item(result: Reproduced, name: str) -> dict[str, Any]:
    return as_json(next(found for found in result.items if found.id == name))


def row(result: Reproduced, name: str, what: str) -> dict[str, Any]:
    return next(found for found in item(result, name)["rows"] if found["what"] == what)


def read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


# --- the whole ---


def test_every_item_has_what_the_interface_promises(finished: tuple[Path, Reproduced]) -> None:
    _, result = finished
    assert [found.id for found in result.items] == list(ITEMS)
    for found in map(as_json, result.items):
        assert {"id", "paper", "ours", "interval"} <= set(found)
        for part in [found, *found["rows"]]:
            ours, interval = part["ours"], part["interval"]
            if interval is not None:
                assert interval[0] <= ours <= interval[1], part
        assert found["rows"]
    json.dumps(as_json(result), allow_nan=False)


def test_the_folder_holds_page_figures_numbers_and_policies(finished: tuple[Path, Reproduced]) -> None:
    folder, result = finished
    names = {entry.name for entry in folder.iterdir()}
    assert {"index.html", "items.json", "provenance.json", "figures", "policies", "parts", "items"} <= names
    figures = {entry.name for entry in (folder / "figures").iterdir()}
    # Random weights crash too rarely for libraries of their own; `test_figures_of_a_library` has one.
    drawn = set(RENDERERS) - {"figure6", "figure7", "figure8", "figure9", "figure10", "figure11"}
    assert {f"{name}.{ending}" for name in drawn for ending in ("png", "svg")} <= figures
    kinds = {entry.name for entry in (folder / "policies").iterdir()}
    free, bounded = (f"idm-mobil.crash.{kind}" for kind in ("free", "bounded"))
    assert kinds == {
        f"{kind}.{k}.{ending}"
        for kind in (free, bounded) for k in (0, 1) for ending in ("safetensors", "provenance.json")
    }  # fmt: skip
    for k in (0, 1):  # Figure 2 draws over time, which the policies themselves do not tell
        path = folder / "policies" / f"{free}.{k}.safetensors"
        curves: Any = [load(path).about["curve"] for load in (load_policy, load_timed_policy)]
        assert all(point["seconds"] is None for point in curves[0])
        assert all(point["seconds"] > 0.0 for point in curves[1])
    assert [found["id"] for found in read(folder / "items.json")["items"]] == [found.id for found in result.items]
    identity = read(folder / "provenance.json")["identity"]
    assert (identity["seed"], identity["effort"]) == (3, "quick")
    assert set(identity["avs"]) >= {"idm-mobil"}


def test_trainings_of_a_kind_have_seeds_of_their_own(finished: tuple[Path, Reproduced]) -> None:
    folder, _ = finished
    both = [load_policy(folder / "policies" / f"idm-mobil.crash.free.{k}.safetensors") for k in (0, 1)]
    assert [policy.about["seed"] for policy in both] == [3, 4]
    assert not np.array_equal(both[0].weights, both[1].weights)


def test_numbers_are_those_of_simulate(finished: tuple[Path, Reproduced]) -> None:
    """A cell of the matrix is a plain evaluation minus a natural rate, nothing else."""
    folder, result = finished
    cells = read(folder / "items" / "matrix.json")["result"]["data"]["cells"]
    swerve = next(c for c in cells if (c["key"], c["av"]) == ("swerve.free", "idm-mobil"))
    run = experiment(bv="swerve")
    tally, _ = simulate_experiment(run, tests=TINY.tests, seed=3, first=EVALUATION_TESTS)
    assert swerve["crashes"] == tally.av_crashes
    assert 0 <= swerve["avoidable"] <= swerve["crashes"]
    assert swerve["typed"] == sum(swerve["crash_types"].values()) == min(TINY.typed, tally.av_crashes)
    natural = row(result, "matrix", "natural traffic against idm-mobil")["ours"]
    net = row(result, "matrix", "swerve.free against idm-mobil")["ours"]
    assert net == pytest.approx(tally.av_crashes / TINY.tests - natural)
    avoidable = row(result, "matrix", "avoidable crashes, swerve.free against idm-mobil")["ours"]
    assert avoidable == swerve["avoidable"] / TINY.tests


def test_the_papers_two_cells_are_the_surrogate_and_the_rl_av(finished: tuple[Path, Reproduced]) -> None:
    _, result = finished
    rows = item(result, "matrix")["rows"]
    assert item(result, "matrix")["paper"] in (0.286, 0.10)
    said = {found["what"]: found["paper"] for found in rows if found["paper"] is not None}
    assert said["idm-mobil.crash.free against idm-mobil"] == 0.286
    assert said["natural traffic against idm-mobil"] == 1e-6
    assert set(said) <= {
        "idm-mobil.crash.free against idm-mobil", "idm-mobil.crash.free against rl", "natural traffic against idm-mobil"
    }  # fmt: skip


def test_figure3_drives_the_miles_that_it_promises(finished: tuple[Path, Reproduced]) -> None:
    _, result = finished
    for name in ("natural", "adversary", "bounded adversary"):
        assert row(result, "figure3", f"miles of the AV, {name}")["ours"] >= TINY.miles


# --- going on ---


def test_a_finished_folder_is_not_computed_again(
    finished: tuple[Path, Reproduced], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, result = finished

    def never(*_: object, **__: object) -> None:
        raise AssertionError("computed again")

    for name in ("learn", "drive_tests", "simulate_experiment"):
        monkeypatch.setattr(bench_module, name, never)
    monkeypatch.setattr(figure3.runner, "simulate_chunks", never)
    before = snapshot(folder / "items") | snapshot(folder / "policies")
    again = cornerforge.reproduce(effort="quick", out=folder, seed=3, resume=True)
    assert again.items == result.items
    assert snapshot(folder / "items") | snapshot(folder / "policies") == before


def test_one_item_is_made_again_of_kept_policies(
    finished: tuple[Path, Reproduced], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, result = finished
    (folder / "items" / "figure5.json").unlink()
    monkeypatch.setattr(bench_module, "learn", lambda *_, **__: pytest.fail("trained again"))
    again = cornerforge.reproduce(effort="quick", out=folder, seed=3, figures=["figure5"], resume=True)
    assert [found.id for found in again.items] == ["figure5"]
    assert item(again, "figure5")["rows"] == item(result, "figure5")["rows"]
    # The page goes on showing the others.
    assert [found["id"] for found in read(folder / "items.json")["items"]] == list(ITEMS)


def test_another_seed_or_place_is_refused(finished: tuple[Path, Reproduced], tmp_path: Path) -> None:
    folder, _ = finished
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.reproduce(effort="quick", out=folder, seed=3)
    with pytest.raises(InputError, match="seed = 3, not 4"):
        cornerforge.reproduce(effort="quick", out=folder, seed=4, resume=True)
    with pytest.raises(UnknownNameError, match="figure2"):
        cornerforge.reproduce(effort="quick", out=tmp_path / "new", figures=["figur2"])
    with pytest.raises(UnknownNameError, match="standard"):
        cornerforge.reproduce(effort="medium", out=tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_what_was_made_of_something_else_is_made_again(tmp_path: Path) -> None:
    made = []

    def work(value: int) -> dict[str, Any]:
        made.append(value)
        return {"value": value}

    path = tmp_path / "part.json"
    assert keep(path, {"code": "a"}, lambda: work(1)) == {"value": 1}
    assert keep(path, {"code": "a"}, lambda: work(2)) == {"value": 1}
    assert keep(path, {"code": "b"}, lambda: work(3)) == {"value": 3}
    assert made == [1, 3]


def test_a_policy_of_other_settings_is_trained_again(tmp_path: Path) -> None:
    learned = Adversary("learned", bounded=False, trained_on="idm-mobil", reward="crash")

    def bench(size: ReproduceEffort) -> Bench:
        return Bench(tmp_path, size, WorldOptions(), seed=0, threads=1, progress=lambda *_: None)

    first = bench(TINY).policy(learned)
    assert np.array_equal(bench(TINY).policy(learned).weights, first.weights)
    longer = bench(replace(TINY, decisions=2_048)).policy(learned)
    assert (first.about["decisions"], longer.about["decisions"]) == (1_024, 2_048)


# --- libraries ---

SWERVE = Adversary("swerve", bounded=False)


@pytest.fixture(scope="module")
def swerving(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A bench whose adversary crashes the AV often, so that its library is soon filled."""
    size = replace(TINY, cases=60, typed=12)
    folder = tmp_path_factory.mktemp("swerving")
    return Bench(folder, size, WorldOptions(), seed=5, threads=None, progress=lambda *_: None)


def test_a_library_is_filled_once_and_again_when_it_is_gone(swerving: Bench) -> None:
    filled = library_of(swerving, SWERVE)
    assert filled is not None
    assert len(filled.open()) == filled.cases == 60
    before = filled.open().history()[1]
    stamp = (filled.folder / "manifest.json").stat().st_mtime_ns
    assert library_of(swerving, SWERVE) == filled
    assert (filled.folder / "manifest.json").stat().st_mtime_ns == stamp
    shutil.rmtree(filled.folder)
    again = library_of(swerving, SWERVE)
    assert again is not None
    assert np.array_equal(again.open().history()[1], before, equal_nan=True)


def test_figures_of_a_library_count_every_case_and_can_be_drawn(swerving: Bench) -> None:
    found = {
        "figure7": figure7.compute(swerving, {"unbounded": SWERVE}),
        "figure8": clusters.compute(swerving, SWERVE),
        "figure9": examples.compute(swerving, SWERVE),
        "figure6": examples.compute_types(swerving, (SWERVE,)),
    }
    for name, finding in found.items():
        content = json.loads(json.dumps(finding.as_json(), allow_nan=False))
        for part in content["rows"]:
            if part["interval"] is not None:
                assert part["interval"][0] <= part["ours"] <= part["interval"][1], part
        assert RENDERERS[name](content["data"])
    periods = found["figure7"].data["worlds"][0]["periods"]
    assert [panel["steps"] for panel in periods] == [1, 2, 3, 5, 7, 9, 12, 15]
    for panel in periods:
        assert len(panel["points"]["majority"]) + len(panel["points"]["minority"]) == panel["cases"] == 60
    groups = found["figure8"].data["clusters"]
    assert sum(group["size"] for group in groups) == 60
    assert {group["letter"][0] for group in groups if group["group"] == "majority"} == {"A"}
    shown = found["figure9"].data["examples"]
    assert [example["letter"] for example in shown] == [group["letter"] for group in groups]
    of_types = found["figure6"].data["examples"]
    counted = [part for part in found["figure6"].rows[1:] if part.ours]
    assert len(of_types) == len(counted) >= 2
    assert found["figure6"].headline.ours == len(of_types)
    assert sum(float(part.ours) for part in counted if part.ours is not None) == 60
    for example in shown + of_types:
        contact = example["moments"][-1]
        assert contact["before"] == 0.0
        assert contact["bv"] is not None
        larger = [Box._make(contact[who])._replace(length=5.01, width=2.01) for who in ("av", "bv")]
        assert boxes_overlap(*larger)


def test_shares_of_kinds_are_those_of_all_cases(swerving: Bench) -> None:
    """The paper's kinds and what it does not name make up the whole."""
    rows = [part for part in examples.compute(swerving, SWERVE).rows if not part.what.startswith("cluster ")]
    assert sum(float(part.ours) for part in rows if part.ours is not None) == pytest.approx(1.0)


def test_without_crashes_there_is_a_reason_and_no_number(finished: tuple[Path, Reproduced]) -> None:
    _, result = finished
    for name in ("figure6", "figure7", "figure8", "figure9", "figure10", "figure11"):
        found = item(result, name)
        if not (finished[0] / "libraries").exists():
            assert found["ours"] is None
            assert "yield is too low" in found["note"]


# --- single items ---


def test_table1_is_the_papers() -> None:
    found = TABLE1.compute(None)  # type: ignore[arg-type]
    table = [(part.what, part.paper, part.ours) for part in found.rows[:8]]
    assert table == [
        ("mini-batch size", 16, 16),
        ("replay memory size", 1e6, 1_000_000),
        ("discount factor", 1, 1.0),
        ("learning rate", 1e-6, 1e-6),
        ("initial exploration", 1, 1.0),
        ("final exploration", 0.1, 0.1),
        ("replay start size", 5000, 5000),
        ("target network update", 1000, 1000),
    ]
    assert (found.headline.paper, found.headline.ours) == (8, 8)


def test_table1_tells_a_preset_that_is_not_the_papers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "paper", replace(PRESETS["paper"], batch=32))
    found = TABLE1.compute(None)  # type: ignore[arg-type]
    assert (found.headline.paper, found.headline.ours) == (8, 7)


def some_policy_with(curve: list[dict[str, Any]]) -> Policy:
    shape = PRESETS["fast"].network
    return Policy(np.zeros(n_weights(shape), np.float32), shape, False, {"curve": curve, "decisions": 9, "updates": 1})


def point(seconds: float, tests: int, share: float | None) -> dict[str, Any]:
    return {
        "decisions": int(seconds * 100), "seconds": seconds, "updates": 0, "epsilon": 0.5, "loss": None,
        "tests": tests, "crashes_per_test": share,
    }  # fmt: skip


def test_time_to_the_papers_yield_is_that_of_the_first_point_that_has_it() -> None:
    curve = [point(1.0, 0, None), point(2.0, 50, 0.20), point(3.0, 50, 0.30), point(4.0, 50, 0.22)]
    assert seconds_to_yield(some_policy_with(curve)) == 3.0
    assert seconds_to_yield(some_policy_with(curve), 0.31) is None
    assert seconds_to_yield(some_policy_with([])) is None


def test_a_policy_of_the_paper_preset_adds_a_curve(finished: tuple[Path, Reproduced], tmp_path: Path) -> None:
    """And leaves the policies that are there alone; without it, the kept Figure 2 stays on the page."""
    folder, _ = finished
    path = tmp_path / "paper.safetensors"
    save_policy(some_policy_with([point(2.0, 50, 0.2), point(3.0, 50, 0.3)]), path)
    result = cornerforge.reproduce(
        effort="quick", out=folder, seed=3, figures=["figure2"], paper_policy=path, resume=True
    )
    ours = row(result, "figure2", "the same with preset paper (Table 1)")
    assert ours["paper"] == 0.286
    assert 0.0 <= ours["ours"] <= 1.0
    cornerforge.reproduce(effort="quick", out=folder, seed=3, figures=["table1"], resume=True)
    kept = next(found for found in read(folder / "items.json")["items"] if found["id"] == "figure2")
    assert [curve["name"] for curve in kept["data"]["curves"]][-1] == "preset paper (Table 1)"


def test_pooled_covers_every_seed() -> None:
    def judged(crashes: int, low: float, high: float) -> dict[str, Any]:
        return {
            "crashes_per_test": crashes / 10, "interval95": [low, high], "tests": 10, "crashes": crashes, "typed": 2,
            "avoidable": crashes // 2, "struck": 1,
            "crash_types": {"sideswipe": 2, "angle": 0}, "strikers": {"av": 1, "bv": 1},
        }  # fmt: skip

    both = pooled([judged(4, 0.1, 0.7), judged(6, 0.3, 0.9)])
    assert both["crashes_per_test"] == pytest.approx(0.5)
    assert both["interval95"] == (0.1, 0.9)
    assert (both["tests"], both["crashes"], both["typed"], both["avoidable"]) == (20, 10, 4, 5)
    assert both["avoidable_per_test"] == pytest.approx(0.25)
    assert both["avoidable_interval95"] == (binomial_interval(2, 10)[0], binomial_interval(3, 10)[1])
    assert both["crash_types"] == {"sideswipe": 4, "angle": 0}


def test_adversaries_cover_plain_and_learned_free_and_bounded(tmp_path: Path) -> None:
    bench = Bench(tmp_path, TINY, WorldOptions(), seed=0, threads=1, progress=lambda *_: None)
    found = list(adversaries(bench))
    assert len({adversary.key for adversary in found}) == len(found)
    assert sum(adversary.bounded for adversary in found) * 2 == len(found)
    assert {a.trained_on for a in found if a.name == "learned"} == {"idm-mobil"}


def test_the_matrix_has_an_av_from_outside_as_the_same_av_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A column of its own beside the built-in ones; its cells are those of the AV of the same law."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "outside.py").write_text(
        "import numpy as np\n\nclass Still:\n    def act(self, view):\n        return np.zeros((len(view), 2))\n",
        encoding="utf-8",
    )
    size = replace(TINY, tests=60, natural_tests=100, typed=5)
    bench = Bench(
        tmp_path / "out", size, WorldOptions(), seed=0, threads=1, progress=lambda *_: None,
        more_avs=["outside:Still", "idm-mobil"],
    )  # fmt: skip
    assert bench.avs[0] == "idm-mobil"
    assert bench.avs[-1] == "outside:Still"
    assert bench.avs.count("idm-mobil") == 1
    assert bench.trained_on == ("idm-mobil",)
    judged = bench.judged(Adversary("swerve", bounded=False), "outside:Still")
    run = experiment(av="outside:Still", bv="swerve", takes_foreign=True)
    tally, _ = simulate_experiment(run, tests=60, seed=0, first=EVALUATION_TESTS, threads=1)
    assert judged["crashes"] == tally.av_crashes > 10
    assert judged["avoidable"] <= judged["crashes"]
    assert judged["typed"] == 5
    assert bench.natural("outside:Still")["tests"] == 100
    assert (tmp_path / "out" / "parts" / "natural.outside-Still.json").exists()
    run.rest()


def exposure(samples: list[list[int]], miles: float) -> figure3._Exposure:
    """A world whose blocks all have these samples of the first quantity (2 m bins)."""
    grid = EXPOSURE[0]
    one = np.zeros((len(EXPOSURE), grid.bins), dtype=np.int64)
    for value, count in samples:
        one[0, int(value // grid.width)] += count
    every = np.repeat(one[None], figure3.BLOCKS, axis=0)
    return figure3._Exposure(every, np.full(figure3.BLOCKS, 100), np.full(figure3.BLOCKS, miles), 20)


def test_median_and_near_seconds_of_hand_made_counts() -> None:
    """Of 10 samples 4 lie in 8-10 m and 6 in 20-22 m: the median is a sixth into the latter; 4 are below 10 m."""
    world = exposure([[8, 4], [20, 6]], miles=0.5)
    median, spread = figure3._jackknifed(world, 0, "median")
    assert median == pytest.approx(20.0 + 2.0 / 6.0)
    assert spread == pytest.approx(0.0, abs=1e-12)  # all blocks are alike
    near, _ = figure3._jackknifed(world, 0, "near")
    assert near == pytest.approx(4 / 0.5)


def test_jackknife_of_a_mean_per_mile_is_the_textbook_standard_error() -> None:
    """With equal miles the quantity is a mean over blocks, whose standard error is sd / sqrt(blocks)."""
    world = exposure([[8, 0]], miles=1.0)
    counts = np.arange(figure3.BLOCKS)
    world.samples[:, 0, 0] = counts
    value, spread = figure3._jackknifed(world, 0, "near")
    assert value == pytest.approx(counts.mean())
    assert spread == pytest.approx(counts.std(ddof=1) / math.sqrt(figure3.BLOCKS))


def test_a_median_beyond_the_grid_is_no_number() -> None:
    far, _ = figure3._jackknifed(exposure([[8, 1], [121, 5]], miles=1.0), 0, "median")
    none, _ = figure3._jackknifed(exposure([[8, 0]], miles=1.0), 0, "median")
    assert math.isinf(far)
    assert math.isnan(none)
    shown = figure3._row("median", (far, 0.0), EXPOSURE[0], "m", 1.0)
    assert shown.ours is None
    assert "beyond 120 m" in shown.note


def test_none_seen_is_no_proof_of_none() -> None:
    """Of no event in 50 miles the exact upper end is 3.69 events: a jackknife over blocks without any would say 0."""
    none = figure3._jackknifed(exposure([[20, 6]], miles=2.5), 0, "near")
    assert none == (0.0, 0.0)
    row = figure3._row("near", none, EXPOSURE[0], "s per mile", 50.0)
    assert row.interval == pytest.approx((0.0, 3.6889 / 50.0), rel=1e-4)
    assert "none seen" in row.note


def test_no_ratio_where_natural_traffic_has_none() -> None:
    row = figure3._ratio_row("near", "above 1", (3.0, 0.1), (0.0, 0.0))
    assert (row.ours, row.interval) == (None, None)
    assert "natural traffic has none" in row.note
    row = figure3._ratio_row("near", "above 1", (3.0, 0.3), (1.0, 0.0))
    assert row.ours == pytest.approx(3.0)
    assert row.interval == pytest.approx((3.0 * math.exp(-0.196), 3.0 * math.exp(0.196)))
