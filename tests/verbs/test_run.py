"""`run`: everything from one call, and on from where it was stopped."""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from folder_snapshot import snapshot

import cornerforge
from cornerforge._checksums import with_checksum
from cornerforge.errors import FileFormatError, InputError, OutputError, UnknownNameError
from cornerforge.experiment.output import code_hash, version
from cornerforge.experiment.policy_file import load_policy, policy_hash
from cornerforge.library import CaseLibrary
from cornerforge.report.artefacts import read_artefacts
from cornerforge.results import RunDone, as_json
from cornerforge.verbs.options.whole import Run

pytestmark = pytest.mark.full

run_module = importlib.import_module("cornerforge.verbs.run")

# Beyond replay_start of preset `fast`, so that it learns a little; enough to crash now and then.
TINY = run_module.Effort(
    nde_tests=600,
    natural_tests=600,
    natural_rhw=0.3,
    decisions=120_000,
    evaluation_tests=300,
    exposure_tests=200,
    cases=25,
)
STAGES = ("nde", "natural", "natural_cases", "train", "evaluate", "baselines", "exposure", "generate", "analyse")
ARTEFACTS = {
    "policy.safetensors", "training.json", "library", "analysis", "natural", "exposure.json", "summary.json",
    "report.html", "provenance.json", "stages",
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def tiny_effort() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(run_module.EFFORTS, "quick", TINY)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunDone]:
    folder = tmp_path_factory.mktemp("run") / "out"
    return folder, cornerforge.run(effort="quick", out=folder, seed=2)


def read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def same_result(summary: RunDone) -> str:
    """A summary without place and times."""

    def cut(value: Any) -> Any:
        if isinstance(value, dict):
            gone = ("out", "library", "report", "seconds", "cpu_seconds", "world_steps_per_second", "tests_per_second")
            return {key: cut(item) for key, item in value.items() if key not in gone}
        return [cut(item) for item in value] if isinstance(value, list) else value

    return json.dumps(cut(as_json(summary)), sort_keys=True)


def test_all_artefacts_are_there(finished: tuple[Path, RunDone]) -> None:
    folder, summary = finished
    assert {entry.name for entry in folder.iterdir()} == ARTEFACTS
    assert {entry.name for entry in (folder / "stages").iterdir()} == {f"{stage}.json" for stage in STAGES}
    files = {"analysis.json", "cases.parquet", "points.parquet", "provenance.json", "witnesses.parquet"}
    assert files == {e.name for e in (folder / "analysis").iterdir()}
    assert read(folder / "summary.json") == with_checksum(as_json(summary))
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.lower().startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")


def test_the_summary_is_of_what_was_asked_for(finished: tuple[Path, RunDone]) -> None:
    folder, summary = finished
    assert {"out", "nde", "train", "generate", "analyse", "seconds"} <= set(as_json(summary))
    assert summary.nde.tests == 600
    assert summary.train.tests == 300
    assert {"decisions", "seconds", "crashes_per_test", "interval95"} <= set(as_json(summary.train))
    assert {"cases", "tests", "crashes_per_test", "interval95", "seconds", "library"} <= set(as_json(summary.generate))
    assert summary.analyse is not None
    assert summary.generate.cases == summary.analyse.cases == len(CaseLibrary.open(folder / "library")) == 25
    assert [rate.name for rate in summary.baselines] == [
        "uniform",
        "uniform, bounded",
        "lane-changer",
        "lane-changer, bounded",
        "swerve",
        "swerve, bounded",
    ]


def test_provenance_names_all_that_decided(finished: tuple[Path, RunDone]) -> None:
    folder, _ = finished
    made = read(folder / "provenance.json")
    identity = made["identity"]
    assert (identity["seed"], identity["effort"], identity["av"]) == (2, "quick", "idm-mobil")
    assert (identity["code"], identity["cornerforge"]) == (code_hash(), version())
    assert identity["policy_hash"] == policy_hash(load_policy(folder / "policy.safetensors"))
    assert all(len(identity[key]) == 16 for key in ("av_hash", "model_hash", "config_hash"))
    assert identity["budget"] is None, "a likelihood budget, and there was none"
    assert made["seconds"] > 0.0


def test_times_of_the_training_are_in_the_provenance_only(finished: tuple[Path, RunDone]) -> None:
    folder, summary = finished
    points = read(folder / "training.json")["points"]
    times = read(folder / "provenance.json")["point_seconds"]
    assert [point["seconds"] for point in points] == [None] * len(points)
    assert len(times) == len(points) > 0
    assert 0.0 < times[-1] <= summary.train.seconds + 1e-3
    training = read_artefacts(folder).training
    assert training is not None
    assert [point.seconds for point in training.points] == times
    assert "point_seconds" not in as_json(summary.train)


def test_the_likelihood_budget_is_in_the_identity() -> None:
    """The name of the effort once stood in its place."""

    def identity(**changes: Any) -> dict[str, Any]:
        named: dict[str, Any] = run_module._ByEffort(Run(**{"effort": "quick", "budget": 5.0, **changes})).identity()
        return named

    first = identity()
    assert (first["effort"], first["budget"], first["bounded"]) == ("quick", 5.0, True)
    for changes in ({"budget": 6.0}, {"reward": "own-fault"}, {"lanes": 4}):
        assert identity(**changes)["config_hash"] != first["config_hash"]
    assert identity(seed=3)["config_hash"] == first["config_hash"]


def test_a_run_is_for_a_reward(tmp_path: Path) -> None:
    found = cornerforge.run(effort="quick", out=tmp_path / "run", reward="preventable:fsm", seed=3)
    assert found.reward == "preventable:fsm"
    assert found.train.paid_per_test is not None
    assert all(one.paid_per_test is not None for one in found.baselines)
    assert read(tmp_path / "run" / "training.json")["config"]["reward"] == "preventable:fsm"


@pytest.mark.parametrize("budget", [5, 5.0])
def test_a_number_is_a_likelihood_budget(budget: Any, finished: tuple[Path, RunDone]) -> None:
    with pytest.raises(InputError, match="with bounded = False, not True"):
        cornerforge.run(budget=budget, out=finished[0], seed=2, resume=True)


def test_exposure_counts_agree_with_themselves(finished: tuple[Path, RunDone]) -> None:
    exposure = read(finished[0] / "exposure.json")
    assert set(exposure["quantities"]) == {"bbd_front", "bbd_rear", "ttc_front", "ttc_rear"}
    for quantity in exposure["quantities"].values():
        assert len(quantity["nde"]) == len(quantity["adversary"]) == len(quantity["edges"]) - 1
        assert sum(quantity["nde"]) > 0


def test_a_second_resume_does_nothing_again(finished: tuple[Path, RunDone]) -> None:
    folder, summary = finished
    stages: set[str] = set()
    before = snapshot(folder)
    again = cornerforge.run(effort="quick", out=folder, seed=2, resume=True, progress=lambda name, *_: stages.add(name))
    assert stages <= {"report"}
    assert replace(again, seconds=0.0) == replace(summary, seconds=0.0)
    changed = {name for name, content in snapshot(folder).items() if before[name] != content}
    assert changed <= {"summary.json", "provenance.json", "report.html"}


RATE = "rate (0 crashes)"


@pytest.mark.parametrize("stage", [RATE, "train", "exposure", "generate"])
def test_a_run_that_was_stopped_goes_on_to_the_same_result(
    stage: str, finished: tuple[Path, RunDone], tmp_path: Path
) -> None:
    wanted = stage

    def stop(stage: str, done: float, total: float) -> None:  # noqa: ARG001
        if stage == wanted:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cornerforge.run(effort="quick", out=tmp_path / "out", seed=2, progress=stop)
    before = {entry.name: entry.read_bytes() for entry in (tmp_path / "out" / "stages").iterdir()}
    assert f"{'natural' if stage == RATE else stage}.json" not in before
    assert before
    resumed = cornerforge.run(effort="quick", out=tmp_path / "out", seed=2, resume=True)
    assert same_result(resumed) == same_result(finished[1])
    after = {entry.name: entry.read_bytes() for entry in (tmp_path / "out" / "stages").iterdir()}
    assert {name: after[name] for name in before} == before  # finished stages were not done again
    ours, theirs = (CaseLibrary.open(f / "library").scalars() for f in (tmp_path / "out", finished[0]))
    assert ours.equals(theirs)


@pytest.mark.parametrize(
    ("changes", "named"), [({"seed": 3}, "seed"), ({"bounded": True}, "bounded"), ({"lanes": 4}, "lanes")]
)
def test_a_folder_of_another_run_is_refused_by_name(
    changes: dict[str, int], named: str, finished: tuple[Path, RunDone]
) -> None:
    before = snapshot(finished[0])
    with pytest.raises(InputError, match=f"with {named} = "):
        cornerforge.run(out=finished[0], resume=True, **{"effort": "quick", "seed": 2} | changes)  # type: ignore[arg-type]
    assert snapshot(finished[0]) == before


def test_another_size_under_the_same_name_is_refused(
    finished: tuple[Path, RunDone], monkeypatch: pytest.MonkeyPatch
) -> None:
    larger = run_module.Effort(
        nde_tests=700,
        natural_tests=700,
        natural_rhw=0.3,
        decisions=120_000,
        evaluation_tests=300,
        exposure_tests=200,
        cases=25,
    )
    monkeypatch.setitem(run_module.EFFORTS, "quick", larger)
    with pytest.raises(InputError, match="config_hash"):
        cornerforge.run(effort="quick", out=finished[0], seed=2, resume=True)


def test_without_resume_nothing_is_touched(finished: tuple[Path, RunDone]) -> None:
    before = snapshot(finished[0])
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.run(effort="quick", out=finished[0], seed=2)
    assert snapshot(finished[0]) == before


def test_a_damaged_stage_is_named(finished: tuple[Path, RunDone], tmp_path: Path) -> None:
    folder = tmp_path / "out"
    (folder / "stages").mkdir(parents=True)
    (folder / "provenance.json").write_bytes((finished[0] / "provenance.json").read_bytes())
    for damaged in ('{"half', '{"rate": {"tests": 3}}', '{"rate": 3}', '{"rates": {}}'):
        (folder / "stages" / "nde.json").write_text(damaged, encoding="utf-8")
        with pytest.raises(FileFormatError, match=r"nde\.json"):
            cornerforge.run(effort="quick", out=folder, seed=2, resume=True)


@pytest.mark.parametrize("resume", [False, True])
def test_a_folder_of_something_else_is_not_touched(resume: bool, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match=r"notes\.txt"):
        cornerforge.run(effort="quick", out=tmp_path, resume=resume)
    assert snapshot(tmp_path) == {"notes.txt": b"mine"}


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [({"effort": "quik"}, UnknownNameError), ({"seed": -1}, InputError), ({"seed": 2**32}, InputError),
     ({"av": "idm-mobl"}, UnknownNameError), ({"lanes": 9}, InputError), ({"threads": 0}, InputError)],
)  # fmt: skip
def test_wrong_arguments_make_no_folder(arguments: dict[str, Any], kind: type[Exception], tmp_path: Path) -> None:
    with pytest.raises(kind):
        cornerforge.run(out=tmp_path / "out", **{"effort": "quick"} | arguments)
    assert not list(tmp_path.iterdir())


def test_natural_crashes_are_analysed_and_stand_first_on_the_page(
    reckless_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(run_module.EFFORTS, "quick", replace(TINY, natural_tests=20_000))
    found = cornerforge.run(effort="quick", out=tmp_path / "out", seed=2, odd="paper", lanes=2, model=reckless_model)
    assert found.natural.crashes_per_test > 0.0
    assert found.natural_cases is not None
    assert found.natural_cases.natural is not None
    assert found.natural_cases.purpose == "road"
    assert found.natural_cases.natural.all.crashes_per_test == pytest.approx(found.natural.crashes_per_test)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    first = found.natural_cases.value.top[0].case_id
    assert f'data-case="natural/{first}"' in page
    assert found.natural_cases.prevented is not None
    assert found.natural_cases.prevented.careful is not None
    assert found.natural_cases.prevented.careful.cases == 0
    assert "A careful driver would have prevented none." in page
    assert page.index("<h2>On the road</h2>") < page.index("<h2>Crashes of most value that the adversary caused</h2>")
