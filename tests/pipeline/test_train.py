"""`train`: one file, whole or absent, that says how it was made."""

from __future__ import annotations

from pathlib import Path

import pytest
from folder_snapshot import snapshot

from cornerforge import pipeline
from cornerforge.adversary.policy_file import load_policy, policy_hash
from cornerforge.errors import FileFormatError, InputError, OutputError

KNOWN = {"decisions", "seconds", "crashes_per_test", "interval95", "tests", "out", "baselines", "policy_hash"}


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    path = tmp_path_factory.mktemp("train") / "new" / "p.safetensors"
    return path, pipeline.train(out=path, decisions=2000, tests=200, seed=4)


def test_summary_and_file_agree(trained: tuple[Path, dict[str, object]]) -> None:
    path, summary = trained
    assert set(summary) >= KNOWN
    policy = load_policy(path)
    assert summary["policy_hash"] == policy_hash(policy)
    assert summary["decisions"] == policy.about["decisions"] == 2048  # whole iterations of 512 worlds
    assert policy.about["seed"] == 4
    assert [b["name"] for b in summary["baselines"]] == ["uniform", "lane-changer", "swerve"]  # type: ignore[attr-defined]
    assert [entry.name for entry in path.parent.iterdir()] == ["p.safetensors"]


def test_a_policy_is_not_overwritten(trained: tuple[Path, dict[str, object]]) -> None:
    path, _ = trained
    before = snapshot(path.parent)
    with pytest.raises(OutputError, match="exists already"):
        pipeline.train(out=path, decisions=2000, seed=4)
    assert snapshot(path.parent) == before


def test_resume_keeps_the_policy_of_the_same_command(trained: tuple[Path, dict[str, object]]) -> None:
    path, summary = trained
    before = snapshot(path.parent)
    again = pipeline.train(out=path, decisions=2000, tests=200, seed=4, resume=True)
    assert again["kept"] is True
    assert snapshot(path.parent) == before
    assert {**again, "kept": False, "seconds": 0} == {**summary, "seconds": 0}


@pytest.mark.parametrize(
    ("changes", "named"),
    [({"seed": 5}, "seed"), ({"bounded": True}, "bounded"), ({"decisions": 9}, "train"), ({"lanes": 4}, "odd")],
)
def test_resume_refuses_the_policy_of_another_command(
    changes: dict[str, int], named: str, trained: tuple[Path, dict[str, object]]
) -> None:
    path, _ = trained
    before = snapshot(path.parent)
    arguments = {"decisions": 2000, "seed": 4} | changes
    with pytest.raises(OutputError, match=f"another {named}"):
        pipeline.train(out=path, resume=True, **arguments)  # type: ignore[arg-type]
    assert snapshot(path.parent) == before


def test_resume_refuses_a_damaged_policy(trained: tuple[Path, dict[str, object]], tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    path.write_bytes(trained[0].read_bytes()[:1000])
    with pytest.raises(FileFormatError, match="damaged"):
        pipeline.train(out=path, decisions=2000, seed=4, resume=True)
    assert path.stat().st_size == 1000


@pytest.mark.parametrize(
    "arguments",
    [{"decisions": 0}, {"minutes": 0.0}, {"minutes": float("nan")}, {"preset": "fats"}, {"seed": -1}, {"av": "x"},
     {"tests": 0}, {"threads": 0}],
)  # fmt: skip
def test_wrong_arguments_make_nothing(arguments: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        pipeline.train(out=tmp_path / "new" / "p.safetensors", **{"decisions": 600} | arguments)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_found_before_training(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    for out in (tmp_path / "file" / "p.safetensors", tmp_path, tmp_path / ("x" * 300)):
        with pytest.raises(OutputError):
            pipeline.train(out=out, decisions=10**9)
    assert snapshot(tmp_path) == {"file": b"mine"}
