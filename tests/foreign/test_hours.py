"""`run --hours`: what fits is chosen by the clock, stored when chosen, and said with what it could not find."""

from __future__ import annotations

import html
import importlib
import itertools
import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cornerforge
from cornerforge.errors import CornerForgeError
from cornerforge.foreign.pace import announced
from cornerforge.library import CaseLibrary
from cornerforge.results import RunDone, as_json
from cornerforge.verbs.options.whole import Run
from cornerforge.work.stages import Stages

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("in_memory")]

spend = importlib.import_module("cornerforge.verbs.spend")
run_module = importlib.import_module("cornerforge.verbs.run")
EXAMPLE = Path(__file__).parents[2] / "examples" / "my_av.py"
HOURS = 0.003


@pytest.fixture
def second_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that goes on by a second each time somebody looks: every portion takes one."""
    seconds = itertools.count()
    monkeypatch.setattr(spend, "_clock", lambda: float(next(seconds)))


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, second_hand: None) -> None:  # noqa: ARG001
    monkeypatch.setattr(spend, "_MOST_PORTION", 48)
    monkeypatch.setattr(spend, "_SAMPLE", 8)
    monkeypatch.setattr(spend, "_MOST_CASES", 60)
    monkeypatch.setattr(spend, "_DECISIONS_PER_SECOND", 1.0)  # the shortest training


def text_of(page: str) -> str:
    """What people read on a page, without its scripts."""
    body = re.sub(r"<(script|style)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", "", body)).split())


def timeless(done: RunDone) -> dict[str, Any]:
    """What does not depend on how long work took."""

    def cut(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: cut(v) for k, v in value.items() if "second" not in k and k not in ("out", "report", "library")}
        return [cut(v) for v in value] if isinstance(value, list) else value

    found: dict[str, Any] = cut(as_json(done))
    return found


# --- portions ---


def plan(**changes: Any) -> Any:
    usual = spend.Plan(
        stand_in="idm-mobil", decisions=1000, trees=0, baselines=0, answer_seconds=0.2, batch=1, processes=2,
        tests_per_second=0.1, training_seconds=1e6, seconds=5.0,
    )  # fmt: skip
    return replace(usual, **changes)


def portion(first: int, tests: int, seconds: float, crashed: tuple[int, ...] = (), *, faults: int = 0) -> Any:
    return spend.Portion(
        first=first, tests=tests, seconds=seconds, cpu_seconds=0.0, av_faults=faults, bv_crashes=0, decisions=13,
        millimetres=400_000 * tests, digest="d", frames=130, bv_millimetres=1, crashed=crashed, strikes=0, avoidable=0,
        exposure={"bbd_front": (tests, 0)},
    )  # fmt: skip


def test_portions_end_in_time_and_follow_the_speed(tmp_path: Path) -> None:
    """0.1 tests/s were expected, 0.04 came."""
    found = spend.in_portions(
        Stages(tmp_path),
        "x",
        plan(),
        until=1000.0,
        spent=100.0,
        most=9,
        drive=lambda first, n: portion(first, n, n / 0.04),
    )
    assert [p.first for p in found] == [0, *itertools.accumulate(p.tests for p in found)][:-1]
    assert 100.0 + sum(p.seconds for p in found) <= 1000.0
    assert 1000.0 - 100.0 - sum(p.seconds for p in found) < 8 / 0.04  # for the smallest portion there was no time left


def test_one_portion_is_driven_though_the_time_is_over(tmp_path: Path) -> None:
    found = spend.in_portions(
        Stages(tmp_path), "x", plan(), until=10.0, spent=100.0, most=9, drive=lambda first, n: portion(first, n, 900.0)
    )
    assert [p.tests for p in found] == [8]


def test_portions_end_when_more_are_of_no_use(tmp_path: Path) -> None:
    found = spend.in_portions(
        Stages(tmp_path), "x", plan(), until=1e6, spent=0.0, most=3,
        drive=lambda first, n: portion(first, n, 1.0, (first,)),
    )  # fmt: skip
    assert len(found) == 3


@pytest.mark.parametrize("share", [1.0, 0.5, 0.02])
def test_a_fast_av_that_crashes_often_does_not_fill_the_library_with_more_than_is_of_use(
    tmp_path: Path, share: float
) -> None:
    """Its first portion once was the largest: 24,167 cases, and minutes to judge them, where 3,000 are enough."""
    found = spend.in_portions(
        Stages(tmp_path), "x", plan(tests_per_second=20_000.0), until=1e6, spent=0.0, most=3000,
        drive=lambda first, n: portion(first, n, n / 20_000.0, tuple(range(first, first + int(share * n)))),
    )  # fmt: skip
    assert 3000 <= sum(len(p.crashed) for p in found) <= 3100
    assert len(found) < 30


def test_stored_portions_are_not_driven_again_and_decide_the_next(tmp_path: Path) -> None:
    def stopped(first: int, n: int) -> Any:
        if first > 200:
            raise KeyboardInterrupt
        return portion(first, n, n / 0.3)

    arguments: dict[str, Any] = {"until": 4000.0, "spent": 0.0, "most": 9}
    with pytest.raises(KeyboardInterrupt):
        spend.in_portions(Stages(tmp_path / "a"), "x", plan(), drive=stopped, **arguments)
    driven: list[int] = []

    def on(first: int, n: int) -> Any:
        driven.append(first)
        return portion(first, n, n / 0.3)

    resumed = spend.in_portions(Stages(tmp_path / "a"), "x", plan(), drive=on, **arguments)
    assert min(driven) > 200
    assert resumed == spend.in_portions(Stages(tmp_path / "b"), "x", plan(), drive=on, **arguments)


# --- words ---


def natural(crashes: int = 0, tests: int = 90) -> Any:
    class Rate:
        method, av_crashes, plain_tests, doubts = "mc", crashes, tests, ()

    return Rate


def test_what_was_not_found_is_said_with_its_bound() -> None:
    said = spend._not_found(plan(), [portion(0, 300, 1.0)], natural(), 0.25)
    assert said[0] == "0 crashes in 300 tests of the adversary: fewer than 1.2 % of such tests end in one (95 %)."
    assert "0 crashes in 90 natural tests: fewer than one in 30 tests, or in 7.5 miles (rule of three, 95 %)" in said[1]
    assert "to see one in 100,000 tests would take about 35 days of counting" in said[1]
    assert "learned against idm-mobil, not against this AV, which would take about 12 days" in said[2]
    assert len(said) == 4


def test_tests_that_the_av_spoiled_do_not_count() -> None:
    said = spend._not_found(plan(), [portion(0, 310, 1.0, faults=10)], natural(), 0.25)
    assert said[0].startswith("0 crashes in 300 tests")


def test_nothing_is_said_of_what_was_found() -> None:
    found = [portion(0, 300, 1.0, tuple(range(150)))]
    assert spend._not_found(plan(stand_in=None, baselines=500), found, natural(20), 0.25) == ()
    (few,) = spend._not_found(plan(stand_in=None, baselines=500), found, natural(3), 0.25)
    assert few == "The natural rate rests on 3 crashes: its interval is wide."


# --- the whole job ---


def test_a_slow_av_is_driven_by_an_adversary_that_learned_against_a_stand_in(
    avs: Path, small: None  # noqa: ARG001
) -> None:  # fmt: skip
    done = cornerforge.run(av="avs:Accelerates", hours=HOURS, out="out", seed=3, threads=2)
    assert done.spending is not None
    assert (done.spending.stand_in, done.effort) == ("idm-mobil", "0.003 h")
    portions = [json.loads(path.read_text()) for path in sorted(Path("out/stages").glob("attack-*.json"))]
    tests = sum(p["tests"] for p in portions)
    crashed = [test for p in portions for test in p["crashed"]]
    assert done.generate.cases == len(crashed) == len(CaseLibrary.open(Path("out/library"))) > 10
    assert done.generate.tests == done.train.tests == done.spending.parts[2].tests == tests
    page = text_of(Path("out/report.html").read_text(encoding="utf-8"))
    assert "learned against the stand-in idm-mobil, not against this AV" in page
    assert all(text in page for text in done.spending.not_found)
    natural_tests = sum(json.loads(p.read_text())["tests"] for p in Path("out/stages").glob("natural-0*.json"))
    assert done.natural.plain_tests == done.nde.tests == natural_tests
    assert (done.natural.method, done.natural.reason) == ("mc", "as many tests as fitted into the time")

    plain = cornerforge.simulate(av="avs:Accelerates", bv="out/policy.safetensors", tests=tests, seed=3)
    assert plain.av_crashes == len(crashed)
    by_hand = cornerforge.simulate(av="avs:Accelerates", tests=natural_tests, seed=3)
    assert (by_hand.av_crashes, by_hand.bv_crashes) == (done.natural.av_crashes, done.natural.bv_crashes)
    assert by_hand.miles == done.natural.miles
    assert cornerforge.make_report("out").report == "out/report.html"


def test_a_slow_av_has_a_page_after_ten_minutes_unless_an_effort_is_asked_for(
    avs: Path, small: None, monkeypatch: pytest.MonkeyPatch  # noqa: ARG001
) -> None:  # fmt: skip
    monkeypatch.setattr(run_module, "FIRST_PAGE_HOURS", HOURS)
    with announced((said := list[str]()).append):
        done = cornerforge.run(av="avs:Accelerates", out="out", seed=3, threads=2)
    assert done.effort == "0.003 h"
    assert re.search(
        r"quick effort would take about .* as --hours 0\.003 does\. For all of it: --effort quick", said[0]
    )
    monkeypatch.setattr(run_module, "FIRST_PAGE_HOURS", 100.0)
    again = cornerforge.run(av="avs:Accelerates", out="out", seed=3, threads=2, resume=True)
    assert timeless(again) == timeless(done), "the speed is not asked about again"
    job = run_module._ByEffort(Run(av="avs:Accelerates", out="other", effort="quick"))
    monkeypatch.setattr(run_module, "FIRST_PAGE_HOURS", HOURS)
    assert job.first_hours() is None


def test_a_run_that_was_stopped_goes_on_the_same_way(avs: Path, small: None) -> None:  # noqa: ARG001
    calls = []

    def stop(stage: str, done: float, total: float) -> None:  # noqa: ARG001
        calls.append(stage)
        if stage.startswith("cases") and sum(one.startswith("cases") for one in calls) == 4:
            raise KeyboardInterrupt

    arguments: dict[str, Any] = {"av": "avs:Accelerates", "hours": HOURS, "seed": 3, "threads": 2}
    with pytest.raises(KeyboardInterrupt):
        cornerforge.run(out="a", progress=stop, **arguments)
    kept = {path.name: path.read_bytes() for path in Path("a/stages").iterdir()}
    assert "plan.json" in kept
    assert "train.json" in kept
    shutil.copytree("a", "b")
    shutil.rmtree("b/library")  # as if it had been stopped earlier in the portion
    for path in Path("b/stages").glob("attack-*.json"):
        path.unlink()
    first, second = (cornerforge.run(out=out, resume=True, **arguments) for out in ("a", "b"))
    assert {name: Path("a/stages", name).read_bytes() for name in kept} == kept
    assert timeless(first) == timeless(second)
    again = cornerforge.run(out="a", resume=True, **arguments)
    assert timeless(again) == timeless(first)
    for changes in ({"hours": 0.004}, {"stand_in": "rss-cautious"}, {"seed": 4}):
        with pytest.raises(CornerForgeError):
            cornerforge.run(out="a", resume=True, **{**arguments, **changes})


@pytest.mark.processes
def test_a_page_says_that_nothing_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: None  # noqa: ARG001
) -> None:  # fmt: skip
    shutil.copy(EXAMPLE, tmp_path)
    monkeypatch.chdir(tmp_path)
    done = cornerforge.run(av="my_av:MyAv", hours=HOURS, budget=0.0, out="out", seed=3)
    assert done.generate.cases == 0
    assert done.analyse is None
    assert done.spending is not None
    page = text_of(Path("out/report.html").read_text(encoding="utf-8"))
    assert "my_av:MyAv did not crash" in page
    assert done.spending.not_found[0].startswith(f"0 crashes in {done.train.tests:,} tests of the adversary: fewer")
    assert all(text in page for text in done.spending.not_found)
    shutil.rmtree("out/library")  # the page is made of the summary alone
    Path("out/report.html").unlink()
    cornerforge.make_report("out")
    assert text_of(Path("out/report.html").read_text(encoding="utf-8")) == page


def test_a_built_in_av_needs_no_stand_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: None  # noqa: ARG001
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    done = cornerforge.run(hours=HOURS, out="out", threads=2)
    assert done.spending is not None
    assert (done.spending.stand_in, done.spending.answer_seconds, done.spending.batch) == (None, None, None)
    # So short a training may find no crash; those that it finds are all kept.
    portions = [json.loads(path.read_text()) for path in Path("out/stages").glob("attack-*.json")]
    assert done.generate.tests == sum(p["tests"] for p in portions) > 0
    assert done.generate.cases == done.generate.av_crashes


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"hours": 0.0}, "hours = 0.0 h is out of range"),
        ({"hours": float("nan")}, "hours = nan"),
        ({"hours": 1.0, "effort": "quick"}, "effort = quick and hours = 1 exclude each other"),
        ({"stand_in": "rl"}, "stand_in = 'rl' has no effect without hours"),
        ({"hours": 1.0, "stand_in": "my:Av"}, "stand_in = 'my:Av' is not built in"),
        ({"hours": 1.0, "stand_in": "no-such"}, "no-such"),
    ],
)
def test_wrong_arguments_make_no_folder(tmp_path: Path, arguments: dict[str, Any], text: str) -> None:
    with pytest.raises(CornerForgeError, match=text):
        cornerforge.run(out=tmp_path / "out", **arguments)
    assert not (tmp_path / "out").exists()


def test_what_the_av_is_asked_with_does_not_stop_its_stand_in(tmp_path: Path) -> None:
    """FINDINGS 4.2: --av-memory and --av-python are for AVs from outside, and the stand-in is built in."""
    options = Run(av=f"{EXAMPLE}:MyAv", av_memory=4.0, av_python=sys.executable, hours=HOURS, out=tmp_path / "run")
    job = spend._ByClock(options, HOURS)
    assert job.mask.av.name == "idm-mobil"
    assert job.world.av_memory == 4.0
