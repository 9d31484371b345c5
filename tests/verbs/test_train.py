"""`train`: one policy, whole or absent, that says how it was made; when that was stands beside it."""

from __future__ import annotations

import importlib
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folder_snapshot import snapshot

import cornerforge
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.experiment.policy_file import Policy, load_policy, policy_hash, save_policy
from cornerforge.library import CaseLibrary
from cornerforge.ndd.model import default_model_path, load_model, save_model
from cornerforge.results import Trained, as_json
from cornerforge.verbs.train import load_timed_policy

pytestmark = pytest.mark.full

KNOWN = {
    "decisions", "seconds", "crashes_per_test", "interval95", "tests", "out", "baselines", "policy_hash", "reward",
    "avoidable_per_test", "avoidable_interval95", "striking_share", "striking_interval95",
}  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Trained]:
    path = tmp_path_factory.mktemp("train") / "new" / "p.safetensors"
    return path, cornerforge.train(out=path, decisions=2000, tests=200, seed=4)


def test_summary_and_file_agree(trained: tuple[Path, Trained]) -> None:
    path, summary = trained
    assert set(as_json(summary)) >= KNOWN
    policy = load_policy(path)
    assert summary.policy_hash == policy_hash(policy)
    assert summary.decisions == policy.about["decisions"] == 2048  # whole iterations of 512 worlds
    assert policy.about["seed"] == 4
    baselines = summary.baselines
    assert [b.name for b in baselines] == [
        "nobody", "uniform", "uniform, bounded", "lane-changer", "lane-changer, bounded", "swerve", "swerve, bounded",
    ]  # fmt: skip
    for rate in (summary, *baselines):
        assert rate.avoidable_per_test is not None
        assert rate.avoidable_interval95 is not None
        low, high = rate.avoidable_interval95
        assert 0.0 <= low <= rate.avoidable_per_test <= rate.crashes_per_test
        assert rate.avoidable_per_test <= high
    swerve = baselines[5]
    assert swerve.crashes_per_test > 0.5
    assert swerve.avoidable_per_test is not None
    assert 0.0 < swerve.avoidable_per_test < swerve.crashes_per_test
    assert baselines[0].crashes_per_test == 0.0
    assert baselines[0].striking_share is None
    assert sorted(entry.name for entry in path.parent.iterdir()) == ["p.provenance.json", "p.safetensors"]


def test_the_same_training_gives_the_same_bytes(trained: tuple[Path, Trained], tmp_path: Path) -> None:
    """However long it took: times stand in the provenance beside the policy."""
    path, summary = trained
    cornerforge.train(out=tmp_path / "q.safetensors", decisions=2000, tests=200, seed=4, threads=1)
    assert (tmp_path / "q.safetensors").read_bytes() == path.read_bytes()
    made = json.loads((path.parent / "p.provenance.json").read_text(encoding="utf-8"))
    assert made["seconds"] == summary.seconds
    assert made["identity"]["seed"] == 4
    curve: Any = load_policy(path).about["curve"]
    timed: Any = load_timed_policy(path).about["curve"]
    assert [point["seconds"] for point in curve] == [None] * len(curve)
    assert [point["seconds"] for point in timed] == made["point_seconds"]
    assert sorted(made["point_seconds"]) == made["point_seconds"]
    assert 0.0 < made["point_seconds"][-1] <= made["seconds"]


def test_a_stop_at_the_end_loses_no_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The policy comes last: where it is, nothing is missing, since a resumed command only measures it."""
    verb, path = importlib.import_module("cornerforge.verbs.train"), tmp_path / "p.safetensors"

    def stopped(policy: Policy, place: Path) -> None:
        save_policy(policy, place)
        raise KeyboardInterrupt

    monkeypatch.setattr(verb, "save_policy", stopped)
    with pytest.raises(KeyboardInterrupt):
        cornerforge.train(out=path, decisions=512, tests=64)
    assert cornerforge.train(out=path, decisions=512, tests=64, resume=True).kept
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["p.provenance.json", "p.safetensors"]


def test_a_policy_of_old_keeps_the_times_that_it_carries(trained: tuple[Path, Trained], tmp_path: Path) -> None:
    policy = load_policy(trained[0])
    curve: Any = policy.about["curve"]
    old = replace(policy, about={**policy.about, "curve": [{**point, "seconds": 7.5} for point in curve]})
    save_policy(old, tmp_path / "old.safetensors")
    assert load_timed_policy(tmp_path / "old.safetensors").about == old.about
    # What lies beside it tells of a training of another length.
    shutil.copy(trained[0].parent / "p.provenance.json", tmp_path / "old.provenance.json")
    longer = replace(old, about={**old.about, "curve": [*curve, *curve]})
    save_policy(longer, tmp_path / "old.safetensors")
    assert load_timed_policy(tmp_path / "old.safetensors").about == longer.about


def test_a_budget_is_stored_and_kept_to(tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    summary = cornerforge.train(out=path, budget=4.0, decisions=600, tests=200, seed=4)
    assert (summary.bounded, summary.budget) == (True, 4.0)
    policy = load_policy(path)
    assert (policy.bounded, policy.budget) == (True, 4.0)
    again = cornerforge.train(out=path, budget=4.0, decisions=600, tests=200, seed=4, resume=True)
    assert again.kept is True
    with pytest.raises(OutputError, match="another budget"):
        cornerforge.train(out=path, budget=5.0, decisions=600, seed=4, resume=True)


def test_a_policy_is_not_overwritten(trained: tuple[Path, Trained]) -> None:
    path, _ = trained
    before = snapshot(path.parent)
    with pytest.raises(OutputError, match="exists already"):
        cornerforge.train(out=path, decisions=2000, seed=4)
    assert snapshot(path.parent) == before


def test_resume_keeps_the_policy_of_the_same_command(trained: tuple[Path, Trained]) -> None:
    path, summary = trained
    before = snapshot(path.parent)
    again = cornerforge.train(out=path, decisions=2000, tests=200, seed=4, resume=True)
    assert again.kept is True
    assert snapshot(path.parent) == before
    assert replace(again, kept=False, seconds=0.0) == replace(summary, seconds=0.0)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"seed": 5}, "seed"),
        ({"bounded": True}, "bounded"),
        ({"budget": 5.0}, "bounded"),
        ({"decisions": 9}, "train"),
        ({"lanes": 4}, "odd"),
        ({"reward": "striking"}, "train"),
    ],
)
def test_resume_refuses_the_policy_of_another_command(
    changes: dict[str, int], named: str, trained: tuple[Path, Trained]
) -> None:
    path, _ = trained
    before = snapshot(path.parent)
    arguments = {"decisions": 2000, "seed": 4} | changes
    with pytest.raises(OutputError, match=f"another {named}"):
        cornerforge.train(out=path, resume=True, **arguments)  # type: ignore[arg-type]
    assert snapshot(path.parent) == before


def test_resume_refuses_a_damaged_policy(trained: tuple[Path, Trained], tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    path.write_bytes(trained[0].read_bytes()[:1000])
    with pytest.raises(FileFormatError, match="damaged"):
        cornerforge.train(out=path, decisions=2000, seed=4, resume=True)
    assert path.stat().st_size == 1000


def interrupt(stage: str, done: float, total: float) -> None:  # noqa: ARG001
    raise KeyboardInterrupt


def stop_amid_training(stage: str, done: float, total: float) -> None:
    if stage == "train" and done < total:
        raise KeyboardInterrupt


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a training that was stopped half way; read only."""
    folder = tmp_path_factory.mktemp("stopped")
    with pytest.raises(KeyboardInterrupt):
        cornerforge.train(out=folder / "p.safetensors", decisions=30_000, seed=4, progress=stop_amid_training)
    assert [entry.name for entry in folder.iterdir()] == ["p.safetensors.checkpoint"]
    return folder


def test_a_stopped_training_goes_on_to_the_same_policy(stopped: Path, tmp_path: Path) -> None:
    unbroken = cornerforge.train(out=tmp_path / "unbroken.safetensors", decisions=30_000, tests=200, seed=4)
    folder = Path(shutil.copytree(stopped, tmp_path / "copy"))
    stages: list[float] = []
    resumed = cornerforge.train(
        out=folder / "p.safetensors", decisions=30_000, tests=200, seed=4, resume=True,
        progress=lambda stage, done, _: stages.append(done) if stage == "train" else None,
    )  # fmt: skip
    assert stages == [30_208]  # the point before was reached before the stop
    assert replace(resumed, seconds=0.0, out="") == replace(unbroken, seconds=0.0, out="")
    assert sorted(entry.name for entry in folder.iterdir()) == ["p.provenance.json", "p.safetensors"]


def test_without_resume_an_unfinished_training_is_not_overwritten(stopped: Path) -> None:
    before = snapshot(stopped)
    with pytest.raises(OutputError, match="unfinished training; go on with --resume"):
        cornerforge.train(out=stopped / "p.safetensors", decisions=30_000, seed=4)
    assert snapshot(stopped) == before


@pytest.mark.parametrize(
    ("changes", "named"),
    [({"seed": 5}, "seed = 4, not 5"), ({"bounded": True}, "bounded = False, not True"),
     ({"budget": 3.0}, "bounded = False, not True"),
     ({"decisions": 9}, r"train\.decisions = 30000, not 9"), ({"lanes": 4}, r"odd\.n_lanes = 3, not 4"),
     ({"preset": "paper"}, r"train\.preset = 'fast', not 'paper'")],
)  # fmt: skip
def test_resume_refuses_the_checkpoint_of_another_command(
    changes: dict[str, object], named: str, stopped: Path
) -> None:
    before = snapshot(stopped)
    arguments = {"decisions": 30_000, "seed": 4} | changes
    with pytest.raises(InputError, match=named):
        cornerforge.train(out=stopped / "p.safetensors", resume=True, **arguments)  # type: ignore[arg-type]
    assert snapshot(stopped) == before


def test_resume_refuses_a_damaged_checkpoint(stopped: Path, tmp_path: Path) -> None:
    name = "p.safetensors.checkpoint"
    (tmp_path / name).write_bytes((stopped / name).read_bytes()[:-1])
    before = snapshot(tmp_path)
    with pytest.raises(FileFormatError, match=r"damaged .* remove it to begin again"):
        cornerforge.train(out=tmp_path / "p.safetensors", decisions=30_000, seed=4, resume=True)
    assert snapshot(tmp_path) == before


def test_a_kill_between_policy_and_checkpoint_leaves_no_checkpoint_for_long(
    trained: tuple[Path, Trained], tmp_path: Path
) -> None:
    out = tmp_path / "p.safetensors"
    with pytest.raises(KeyboardInterrupt):
        cornerforge.train(out=out, decisions=2000, seed=4, progress=interrupt)
    out.write_bytes(trained[0].read_bytes())
    assert cornerforge.train(out=out, decisions=2000, tests=200, seed=4, resume=True).kept is True
    assert snapshot(tmp_path) == {"p.safetensors": trained[0].read_bytes()}


@pytest.mark.parametrize(
    "arguments",
    [{"decisions": 0}, {"minutes": 0.0}, {"minutes": float("nan")}, {"preset": "fats"}, {"seed": -1}, {"av": "x"},
     {"reward": "crush"}, {"delay": -1.0}, {"budget": -1.0}, {"budget": float("nan")}, {"budget": 1e9},
     {"tests": 0}, {"threads": 0}, {"learner": "poo"}, {"learner": "ppo", "preset": "paper"}],
)  # fmt: skip
def test_wrong_arguments_make_nothing(arguments: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        cornerforge.train(out=tmp_path / "new" / "p.safetensors", **{"decisions": 600} | arguments)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_a_policy_of_ppo_drives_wherever_policies_drive(tmp_path: Path) -> None:
    """As it learned to, it draws its actions; greedily it is another driver; its cases happen again."""
    path = tmp_path / "p.safetensors"
    summary = cornerforge.train(out=path, learner="ppo", decisions=20_000, tests=200, seed=4)
    assert (summary.learner, summary.preset) == ("ppo", "fast")
    policy = load_policy(path)
    assert policy.head == "softmax"
    assert policy.about["train"]["learner"] == "ppo"  # type: ignore[index]
    assert summary.updates > 0
    drawn = cornerforge.simulate(bv=path, tests=300).digest
    again, greedy = (cornerforge.simulate(bv=path, tests=300, acting=acting).digest for acting in ("learned", "greedy"))
    assert drawn == again != greedy
    cornerforge.generate(policy=path, cases=5, out=tmp_path / "library")
    library = CaseLibrary.open(tmp_path / "library")
    assert library.identity["acting"] == "learned"
    assert max(library.scalars(["log_prob_policy"])["log_prob_policy"].to_pylist()) < 0.0
    assert cornerforge.replay(tmp_path / "library", "all", check=True).identical is True


def test_time_alone_ends_a_training_of_minutes(tmp_path: Path) -> None:
    summary = cornerforge.train(out=tmp_path / "p.safetensors", minutes=0.02, tests=10, seed=4)
    policy = load_policy(tmp_path / "p.safetensors")
    assert policy.about["train"]["decisions"] == 10**12  # type: ignore[index]
    assert 512 <= summary.decisions < 10**8


def test_a_model_that_allows_everything_cannot_bound(tmp_path: Path) -> None:
    model = load_model(default_model_path())
    following = (model.following + 1e-6) / (model.following + 1e-6).sum(axis=-1, keepdims=True)
    free = (model.free + 1e-6) / (model.free + 1e-6).sum(axis=-1, keepdims=True)
    save_model(replace(model, following=following.astype(np.float32), free=free.astype(np.float32)), tmp_path / "m.npz")
    before = snapshot(tmp_path)
    with pytest.raises(InputError, match=r"m\.npz calls no acceleration impossible"):
        cornerforge.train(out=tmp_path / "p.safetensors", decisions=600, bounded=True, model=tmp_path / "m.npz")
    assert snapshot(tmp_path) == before


def test_a_place_that_cannot_be_written_is_found_before_training(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    for out in (tmp_path / "file" / "p.safetensors", tmp_path, tmp_path / ("x" * 300)):
        with pytest.raises(OutputError):
            cornerforge.train(out=out, decisions=10**9)
    assert snapshot(tmp_path) == {"file": b"mine"}
