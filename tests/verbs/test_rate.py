"""`rate`: brute force that can be stopped, and says what it knows."""

from __future__ import annotations

import importlib
import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from folder_snapshot import snapshot

import cornerforge
from cornerforge._checksums import with_checksum
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.experiment.setting import experiment
from cornerforge.library import CaseLibrary
from cornerforge.ndd import default_model_path, load_model, save_model
from cornerforge.rates import binomial_interval
from cornerforge.rates.monte_carlo import Block, MonteCarlo, relative_half_width
from cornerforge.results import NaturalRate, as_json
from cornerforge.world_options import WorldOptions

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Looks at nobody's intentions, among drivers who change lanes often and overlook one neighbour in fifty.

    So it crashes often enough to be counted in a test.
    """
    path = tmp_path_factory.mktemp("reckless") / "reckless.npz"
    often = np.full(21, 0.2, dtype=np.float32)
    save_model(replace(load_model(default_model_path()), overlook=0.02, overlook_conflict=0.02, lc_base=often), path)
    return {"av": "idm-mobil-blind", "odd": "paper", "seed": 3, "model": path}


def untimed(summary: NaturalRate) -> NaturalRate:
    plain = replace(summary.effort.plain, cpu_seconds=0.0)
    effort = replace(summary.effort, plain=plain)
    return replace(summary, seconds=0.0, cpu_seconds=0.0, tests_per_second=None, effort=effort)


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.import_module("cornerforge.rates.plain"), "_BLOCK", 2_000)


def test_rate_counts_what_simulate_counts(world: dict[str, Any], tmp_path: Path) -> None:
    found = cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "r")
    tally = cornerforge.simulate(**world, tests=6_000)
    for key in ("tests", "av_crashes", "bv_crashes", "crashes_per_test", "interval95", "miles"):
        assert getattr(found, key) == getattr(tally, key), key
    assert found.av_crashes > 0, "this world must crash, or the test shows nothing"
    assert found.effective_sample_size == 6_000
    library = CaseLibrary.open(tmp_path / "r" / "library")
    assert len(library) == found.av_crashes == library.crashes
    assert library.tests == 6_000
    replayed = cornerforge.replay(tmp_path / "r" / "library", "all", check=True)
    assert replayed.identical


def test_resuming_gives_what_an_unbroken_run_gives(world: dict[str, Any], tmp_path: Path) -> None:
    whole = cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "whole")
    cornerforge.rate(**world, max_tests=4_000, target_rhw=0.001, out=tmp_path / "parts")
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "parts")
    parts = cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "parts", resume=True)
    assert untimed(parts) == untimed(whole)
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
    counts = MonteCarlo().plus(Block(10, 1, 100, 4_000_000, 1.5, 2.5, (3, 7), "ab"))
    assert (counts.seconds, counts.cpu_seconds, counts.miles) == (1.5, 2.5, pytest.approx(2.4855, rel=1e-4))
    assert MonteCarlo.from_json(counts.to_json()) == counts
    with pytest.raises(FileFormatError):
        MonteCarlo.from_json({"tests": 3})
    with pytest.raises(FileFormatError, match="contradict"):
        MonteCarlo.from_json({**counts.to_json(), "av_crashes": 5})
    for crashed in ([7, 3], [3, 3], [3, 10], [-1, 3]):
        with pytest.raises(FileFormatError, match=r"contradict|at least 0"):
            MonteCarlo.from_json({**counts.to_json(), "crashed": crashed})


@pytest.mark.parametrize(("name", "value"), [("max_tests", 0), ("target_rhw", 0.0), ("seed", -1), ("method", "magic")])
def test_bad_numbers_are_refused_before_anything_is_written(
    world: dict[str, Any], tmp_path: Path, name: str, value: object
) -> None:
    with pytest.raises(InputError, match=name):
        cornerforge.rate(**{**world, "out": tmp_path / "r", name: value})
    assert not (tmp_path / "r").exists()


def test_a_part_of_a_block_does_not_change_what_a_longer_run_gives(world: dict[str, Any], tmp_path: Path) -> None:
    """3,000 tests are one block and a half; the run to 6,000 has the digest of one without the stop."""
    whole = cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001)
    part = cornerforge.rate(**world, max_tests=3_000, target_rhw=0.001, out=tmp_path / "r")
    assert (part.tests, part.state) == (3_000, "max_tests")
    assert json.loads((tmp_path / "r" / "counts.json").read_text())["tests"] == 2_000
    assert untimed(cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "r", resume=True)) == (
        untimed(whole)
    )
    library = CaseLibrary.open(tmp_path / "r" / "library")
    assert (len(library), library.tests, library.crashes) == (whole.av_crashes, 6_000, whole.av_crashes)


def test_types_mechanisms_and_bv_miles_are_told(world: dict[str, Any], tmp_path: Path) -> None:
    found = cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "r")
    n = found.av_crashes
    assert sum(found.crash_types.values()) == sum(found.mechanisms.values()) == n
    # BVs overlook it, and it does not see who enters its target lane from two lanes over
    assert found.mechanisms["bv-side"] + found.mechanisms["same-lane-opposite-sides"] >= 0.6 * n
    assert all(0 <= value <= n for value in vars(found.crash_circumstances).values())
    assert json.loads((tmp_path / "r" / "rate.json").read_text()) == with_checksum(as_json(found))
    columns, rows = CaseLibrary.open(tmp_path / "r" / "library").query(
        "select mechanism, count(*) from cases group by mechanism order by mechanism"
    )
    assert columns[0] == "mechanism"
    assert dict(rows) == {name: count for name, count in found.mechanisms.items() if count}
    assert found.interval95_bv_crashes_per_bv_mile is not None
    assert found.bv_crashes_per_bv_mile is not None
    low, high = found.interval95_bv_crashes_per_bv_mile
    assert low <= found.bv_crashes_per_bv_mile <= high
    assert found.bv_miles == pytest.approx(6_000 * 9.2, rel=0.15)  # some 37 BVs for a quarter of a mile each
    assert found.bv_miles_estimate.relative_error is not None
    assert found.bv_miles_estimate.relative_error < 0.01


def test_many_crashes_go_into_several_shards(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.import_module("cornerforge.rates.plain"), "_SHARD_CASES", 1)
    monkeypatch.setattr(importlib.import_module("cornerforge.rates.plain"), "_STORE_SECONDS", 0.0)
    found = cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "r")
    library = CaseLibrary.open(tmp_path / "r" / "library")
    assert len(list((tmp_path / "r" / "library").glob("cases-*.parquet"))) == len(library) == found.av_crashes
    assert library.finished


def test_the_librarys_files_do_not_depend_on_when_it_is_saved(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = importlib.import_module("cornerforge.rates.plain")
    monkeypatch.setattr(module, "_SHARD_CASES", 4)
    monkeypatch.setattr(module, "_BLOCK", 1_000)
    for name, seconds in (("often", 0.0), ("once", 1e9)):
        monkeypatch.setattr(module, "_STORE_SECONDS", seconds)
        cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / name)
    often, once = (snapshot(tmp_path / name / "library") for name in ("often", "once"))
    assert sum(name.startswith("cases-") for name in once) > 1
    assert often == once


def test_progress_tells_crashes_and_ends_at_the_total(world: dict[str, Any]) -> None:
    told: list[tuple[str, float, float]] = []
    found = cornerforge.rate(
        **world, max_tests=6_000, target_rhw=0.001, progress=lambda *what: told.append((what[0], what[1], what[2]))
    )
    rates = [what for what in told if what[0].startswith("rate (")]
    assert rates[0] == ("rate (0 crashes)", 0, 6_000)
    assert rates[-1] == (f"rate ({found.av_crashes} crashes)", 6_000, 6_000)
    assert [done for _, done, _ in rates] == sorted(done for _, done, _ in rates)


SCRIPT = """
import importlib, sys
module = importlib.import_module("cornerforge.rates.plain")
module._BLOCK, module._STORE_SECONDS = 500, 1.0
from cornerforge.cli import main
sys.exit(main(sys.argv[1:]))
"""


def stopped(model: Path, out: Path, how: signal.Signals, blocks: int) -> tuple[int, str]:
    """Start `rate` in a process of its own and stop it when some blocks are saved."""
    command = f"rate --av idm-mobil-blind --odd paper --seed 3 --model {model} --max-tests 10000000 --threads 1"
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, *command.split(), "--out", str(out), "--resume"],
        stderr=subprocess.PIPE,
        text=True,
    )
    for _ in range(1200):
        saved = out / "counts.json"
        if saved.exists() and json.loads(saved.read_text())["tests"] >= 500 * blocks:
            break
        time.sleep(0.1)
    process.send_signal(how)
    _, text = process.communicate(timeout=60)
    return process.returncode, text


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_a_kill_and_an_interrupt_lose_only_the_block_in_progress(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.import_module("cornerforge.rates.plain"), "_BLOCK", 500)
    out = tmp_path / "r"
    assert stopped(world["model"], out, signal.SIGKILL, 3)[0] == -signal.SIGKILL
    kept = json.loads((out / "counts.json").read_text())["tests"]
    status, text = stopped(world["model"], out, signal.SIGINT, kept // 500 + 3)
    *stages, last = text.splitlines()
    assert (status, last) == (
        130,
        "cornerforge: interrupted; what was finished is kept: the same command with --resume goes on.",
    ), text
    assert all(line.startswith("stage ") for line in stages), text
    stopped_at = json.loads((out / "rate.json").read_text())
    assert stopped_at["state"] == "interrupted"
    assert stopped_at["tests"] == json.loads((out / "counts.json").read_text())["tests"] >= kept + 1_500
    tests = stopped_at["tests"] + 1_000
    resumed = cornerforge.rate(**world, max_tests=tests, target_rhw=0.001, out=out, resume=True)
    assert untimed(resumed) == untimed(cornerforge.rate(**world, max_tests=tests, target_rhw=0.001))
    assert cornerforge.replay(out / "library", "all", check=True).identical


def test_an_interrupt_before_a_finished_block_is_saved_loses_nothing(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = importlib.import_module("cornerforge.rates.plain")
    monkeypatch.setattr(module, "_BLOCK", 500)
    write, asked = module.write_json, []

    def interrupted_once(path: Path, content: Any) -> None:
        asked.append(path.name)
        if asked == ["counts.json"] * 3:
            raise KeyboardInterrupt
        write(path, content)

    monkeypatch.setattr(module, "write_json", interrupted_once)
    with pytest.raises(KeyboardInterrupt):
        cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001, out=tmp_path / "r")
    saved, told = (json.loads((tmp_path / "r" / name).read_text())["tests"] for name in ("counts.json", "rate.json"))
    assert saved == told == 1_500


def test_the_text_for_people_names_what_dominates(world: dict[str, Any]) -> None:
    from cornerforge.verbs.sentences.rates import rate_lines

    found = cornerforge.rate(**world, max_tests=6_000, target_rhw=0.001)
    text = "\n".join(rate_lines(found))
    for part in ("all tests are done", "per BV-mile", "sideswipe", "[same-lane-opposite-sides]", "core-hours"):
        assert part in text
    # 6,000 tests are too few for 0.1 %: the square of how much too wide the interval is.
    assert found.relative_half_width is not None
    (need,) = [line for line in rate_lines(found) if "needs about --max-tests" in line]
    assert int(need.split()[-1]) == pytest.approx(6_000 * (found.relative_half_width / 0.001) ** 2, rel=0.05)
    assert not [line for line in rate_lines(replace(found, target_rhw=1e9)) if "needs about" in line]
    nothing = replace(found, av_crashes=0, mechanism_rates={}, relative_half_width=None, bv_crashes_per_bv_mile=None)
    assert "no crash yet" in "\n".join(rate_lines(nothing))
    assert not [line for line in rate_lines(nothing) if "Mechanisms" in line]


def test_where_traffic_stops_crashes_are_counted() -> None:
    # trees would have to learn for hours what is dangerous there
    why = importlib.import_module("cornerforge.verbs.rate")._why_counting
    none_yet = SimpleNamespace(av_crashes=0, half_width=lambda: None)
    stops: list[dict[str, Any]] = [{"traffic": "queue"}, {"traffic": "dense"}, {"road": "on-ramp"}]
    flows: list[dict[str, Any]] = [{}, {"road": "curves"}]
    for world in stops:
        assert "learned anew" in why(experiment(WorldOptions(**world)), none_yet, 0.3)
    for world in flows:
        assert why(experiment(WorldOptions(**world)), none_yet, 0.3) is None
