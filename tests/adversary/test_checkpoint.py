"""A training that was stopped ends where one without the stop ends, to the bit."""

from __future__ import annotations

import errno
import functools
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from folder_snapshot import snapshot
from safetensors import safe_open
from safetensors.numpy import save_file

from cornerforge._checksums import write_tensors
from cornerforge.adversary import ppo
from cornerforge.adversary.checkpoint import CheckpointFile, TrainingState
from cornerforge.adversary.config import PRESETS, TrainConfig
from cornerforge.adversary.replay import BalancedMemory
from cornerforge.adversary.train import CurvePoint, TrainResult, train_adversary
from cornerforge.adversary.worlds.drive_bv import Transitions
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment

Unbroken = Callable[[TrainConfig], TrainResult]

# 120 iterations, points of the curve at 50, 100 and 120; the memory is full from 64 on, so its ring has gone round.
TINY = replace(
    PRESETS["fast"], width=16, batch=32, replay_size=4096, replay_start=256, worlds=64, decisions_per_update=16,
    target_update=7, epsilon_decisions=2000, decisions=120 * 64,
)  # fmt: skip
PLAIN = replace(TINY, optimiser="sgd", learning_rate=0.05, final_learning_rate=0.01)
LATE = replace(TINY, replay_start=4096)
"""Learns only after the first point: what is kept there holds an optimiser that has seen nothing."""
PPO = replace(ppo.PRESETS["fast"], width=16, batch=512, rollout=24, worlds=64, decisions=120 * 64)
"""It learns in iterations 25, 49 and so on, so that a stop after 50 leaves two decisions of each world noted."""
IDENTITY: dict[str, object] = {"seed": 3, "lanes": (1, 2)}


@pytest.fixture(scope="module")
def world() -> Experiment:
    return experiment(bv="uniform")


@pytest.fixture(scope="module")
def unbroken(world: Experiment) -> Unbroken:
    """The result of a training without a stop; made once for each configuration."""
    return functools.cache(lambda config: go(world, config))


def go(
    world: Experiment, config: TrainConfig, checkpoint: CheckpointFile | None = None, *, threads: int = 2,
    progress: Callable[[CurvePoint], None] | None = None,
) -> TrainResult:  # fmt: skip
    return train_adversary(
        world.setting, world.slots, config, seed=3, threads=threads, progress=progress, checkpoint=checkpoint
    )


def timeless(result: TrainResult) -> list[dict[str, object]]:
    return [asdict(point) | {"seconds": 0} for point in result.curve]


def assert_same(result: TrainResult, unbroken: TrainResult) -> None:
    assert result.weights.tobytes() == unbroken.weights.tobytes()
    assert timeless(result) == timeless(unbroken)
    assert (result.decisions, result.updates) == (unbroken.decisions, unbroken.updates)


def stop_at(decisions: int) -> Callable[[CurvePoint], None]:
    def stop(point: CurvePoint) -> None:
        if point.decisions == decisions:
            raise KeyboardInterrupt

    return stop


@pytest.fixture
def stopped(world: Experiment, tmp_path: Path) -> Path:
    """The checkpoint of a training that was stopped after 50 iterations."""
    path = tmp_path / "p.checkpoint"
    with pytest.raises(KeyboardInterrupt):
        go(world, TINY, CheckpointFile(path, IDENTITY), progress=stop_at(3200))
    return path


@pytest.mark.sampled(2)
@pytest.mark.parametrize("config", [TINY, PLAIN, LATE, PPO], ids=["adam", "sgd", "late", "ppo"])
@pytest.mark.parametrize("decisions", [3200, 6400, 7680])
def test_a_stopped_training_goes_on_to_the_same_weights(
    config: TrainConfig, decisions: int, world: Experiment, unbroken: Unbroken, tmp_path: Path
) -> None:
    checkpoint = CheckpointFile(tmp_path / "new" / "p.checkpoint", IDENTITY)
    with pytest.raises(KeyboardInterrupt):
        go(world, config, checkpoint, progress=stop_at(decisions))
    assert [entry.name for entry in (tmp_path / "new").iterdir()] == ["p.checkpoint"]
    told: list[CurvePoint] = []
    result = go(world, config, checkpoint, threads=1, progress=told.append)
    assert_same(result, unbroken(config))
    assert [p.decisions for p in told] == [d for d in (3200, 6400, 7680) if d > decisions]
    seconds = [point.seconds for point in result.curve]
    assert seconds == sorted(seconds)  # time counts on


def test_a_training_stopped_again_and_again_goes_on_to_the_same_weights(
    world: Experiment, unbroken: Unbroken, tmp_path: Path
) -> None:
    checkpoint = CheckpointFile(tmp_path / "p.checkpoint", IDENTITY)
    for decisions in (3200, 6400):
        with pytest.raises(KeyboardInterrupt):
            go(world, TINY, checkpoint, progress=stop_at(decisions))
    assert_same(go(world, TINY, checkpoint), unbroken(TINY))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "part",
    ["learner.network.weights", "learner.target", "learner.network.optimiser.exp_avg",
     "learner.network.optimiser.exp_avg_sq", "learner.replay.recent.reward", "learner.replay.paid.reward",
     "learner.replay.is_paid",
     "actor.worlds.vehicles", "actor.worlds.state", "actor.observation", "actor.allowed"],
)  # fmt: skip
def test_negative_control_every_part_is_needed(part: str, world: Experiment, unbroken: Unbroken, stopped: Path) -> None:
    """The comparison of weights sees it when one part is not what it was."""
    saved = CheckpointFile(stopped, IDENTITY).read()
    assert saved is not None
    broken = np.roll(saved.arrays[part], 1, axis=0)  # each world, transition or weight gets that of its neighbour
    if part == "learner.replay.is_paid":  # only how many there are decides anything
        broken = np.zeros_like(broken)
    assert broken.tobytes() != saved.arrays[part].tobytes()
    checkpoint = CheckpointFile(stopped, IDENTITY)
    checkpoint.write(TrainingState({**saved.arrays, part: broken}, saved.values))
    assert go(world, TINY, checkpoint).weights.tobytes() != unbroken(TINY).weights.tobytes()


@pytest.mark.full
@pytest.mark.parametrize("part", ["rows.observation", "rows.allowed", "rows.log_prob", "rows.reward"])
def test_negative_control_what_ppo_noted_is_needed(
    part: str, world: Experiment, unbroken: Unbroken, tmp_path: Path
) -> None:
    checkpoint = CheckpointFile(tmp_path / "p.checkpoint", IDENTITY)
    with pytest.raises(KeyboardInterrupt):
        go(world, PPO, checkpoint, progress=stop_at(3200))
    saved = checkpoint.read()
    assert saved is not None
    array = saved.arrays[f"learner.{part}"]
    # Few of the decisions that wait for a round were paid: rewards of neighbours would be the same.
    broken = array + np.float32(1.0) if part == "rows.reward" else np.roll(array, 1, axis=0)
    checkpoint.write(TrainingState({**saved.arrays, f"learner.{part}": broken}, saved.values))
    assert go(world, PPO, checkpoint).weights.tobytes() != unbroken(PPO).weights.tobytes()


@pytest.mark.full
@pytest.mark.parametrize("what", ["draws", "steps"])
def test_negative_control_draws_and_adams_steps_are_needed(
    what: str, world: Experiment, unbroken: Unbroken, stopped: Path
) -> None:
    """Draws follow the number of updates, the optimiser's own counter stands beside."""
    checkpoint = CheckpointFile(stopped, IDENTITY)
    saved = checkpoint.read()
    assert saved is not None
    arrays = dict(saved.arrays)
    if what == "draws":
        saved.values["learner"]["updates"] += 7  # copies to the target network stay where they are
    else:
        arrays["learner.network.optimiser.step"] = arrays["learner.network.optimiser.step"] + 1
    checkpoint.write(TrainingState(arrays, saved.values))
    assert go(world, TINY, checkpoint).weights.tobytes() != unbroken(TINY).weights.tobytes()


def test_writing_changes_nothing(world: Experiment, unbroken: Unbroken, tmp_path: Path) -> None:
    checkpoint = CheckpointFile(tmp_path / "p.checkpoint", IDENTITY, every_seconds=0.0)
    assert_same(go(world, TINY, checkpoint), unbroken(TINY))
    assert checkpoint.path.exists()  # it was written, and the caller removes it


def test_a_short_training_writes_nothing(world: Experiment, tmp_path: Path) -> None:
    go(world, replace(TINY, decisions=64), CheckpointFile(tmp_path / "p.checkpoint", IDENTITY, every_seconds=1e6))
    assert snapshot(tmp_path) == {}


CHILD = """
import sys, time
from pathlib import Path
from test_checkpoint import IDENTITY, TINY, go
from cornerforge._checksums import write_tensors
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.experiment.setting import experiment

def wait(point):
    print("point", flush=True)
    time.sleep(600)

go(experiment(bv="uniform"), TINY, CheckpointFile(Path(sys.argv[1]), IDENTITY, every_seconds=0.0), progress=wait)
"""


def child(path: Path) -> subprocess.Popen[str]:
    """A training in another process that says "point" at the first point of its curve, and waits there."""
    here = Path(__file__).parent
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(here), str(here.parent)])}
    command = [sys.executable, "-c", CHILD, str(path)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL there")
def test_a_killed_training_goes_on_to_the_same_weights(world: Experiment, unbroken: Unbroken, tmp_path: Path) -> None:
    path = tmp_path / "p.checkpoint"
    with child(path) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        process.kill()
        assert said == "point\n", process.communicate()[1]
    checkpoint = CheckpointFile(path, IDENTITY)
    saved = checkpoint.read()
    assert saved is not None
    assert 0 < saved.values["decisions"] < 3200
    assert_same(go(world, TINY, checkpoint), unbroken(TINY))


def press_ctrl_c(monkeypatch: pytest.MonkeyPatch, times: int) -> None:
    """Send SIGINT right in the middle of the learning of one iteration."""
    draw = BalancedMemory.draw

    def interrupted(self: BalancedMemory, rng: np.random.Generator, out: Transitions) -> None:
        draw(self, rng, out)
        calls[0] += 1
        if calls[0] == 202:  # the second of the four updates of its iteration
            for _ in range(times):
                signal.raise_signal(signal.SIGINT)

    calls = [0]
    monkeypatch.setattr(BalancedMemory, "draw", interrupted)


def test_ctrl_c_amid_learning_keeps_the_whole_iteration(
    world: Experiment, unbroken: Unbroken, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoint = CheckpointFile(tmp_path / "p.checkpoint", IDENTITY)
    with monkeypatch.context() as patch:
        press_ctrl_c(patch, times=1)
        with pytest.raises(KeyboardInterrupt):
            go(world, TINY, checkpoint)
    saved = checkpoint.read()
    assert saved is not None
    assert saved.values["learner"]["updates"] == 204
    assert_same(go(world, TINY, checkpoint), unbroken(TINY))


def test_a_second_ctrl_c_ends_it_at_once(world: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = signal.getsignal(signal.SIGINT)
    press_ctrl_c(monkeypatch, times=2)
    with pytest.raises(KeyboardInterrupt):
        go(world, TINY, CheckpointFile(tmp_path / "p.checkpoint", IDENTITY))
    assert snapshot(tmp_path) == {}
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_is_handled_as_before_afterwards(world: Experiment, tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    go(world, replace(TINY, decisions=64), CheckpointFile(tmp_path / "p.checkpoint", IDENTITY))
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("identity", "message"),
    [({"seed": 4, "lanes": [1, 2]}, "seed = 3, not 4"), ({"seed": 3, "lanes": [1, 3]}, r"lanes = \[1, 2\], not"),
     ({"seed": 3}, r"lanes = \[1, 2\], not None"), ({**IDENTITY, "code": "x"}, "code = None, not 'x'")],
)  # fmt: skip
def test_the_first_difference_to_another_training_is_named(
    identity: dict[str, object], message: str, world: Experiment, stopped: Path
) -> None:
    before = snapshot(stopped.parent)
    with pytest.raises(InputError, match=message):
        go(world, TINY, CheckpointFile(stopped, identity))
    assert snapshot(stopped.parent) == before


def test_an_identity_that_hides_a_difference_still_gives_an_error_of_ours(world: Experiment, stopped: Path) -> None:
    with pytest.raises(FileFormatError, match="does not fit this training"):
        go(world, replace(TINY, width=32), CheckpointFile(stopped, IDENTITY))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("keep", [0, 5, 1000, -1])
def test_a_truncated_checkpoint_is_named(keep: int, world: Experiment, stopped: Path) -> None:
    stopped.write_bytes(stopped.read_bytes()[:keep])
    before = snapshot(stopped.parent)
    with pytest.raises(FileFormatError, match=r"p\.checkpoint is damaged .* remove it"):
        go(world, TINY, CheckpointFile(stopped, IDENTITY))
    assert snapshot(stopped.parent) == before


def test_one_flipped_bit_is_found(stopped: Path) -> None:
    content = bytearray(stopped.read_bytes())
    content[-100] ^= 1
    stopped.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"its checksum does not fit.*remove it"):
        CheckpointFile(stopped, IDENTITY).read()


def test_another_safetensors_file_and_another_schema_are_refused(stopped: Path) -> None:
    with safe_open(stopped, framework="numpy") as file:
        header = json.loads(file.metadata()["cornerforge_checkpoint"])
    header["schema_version"] = 99
    del header["sha256"]
    write_tensors(stopped, "cornerforge_checkpoint", header, {"a": np.zeros(2)}, "it")
    with pytest.raises(FileFormatError, match="schema version 99"):
        CheckpointFile(stopped, IDENTITY).read()
    save_file({"a": np.zeros(2)}, stopped)
    with pytest.raises(FileFormatError, match="no checkpoint"):
        CheckpointFile(stopped, IDENTITY).read()


def test_arrays_and_values_come_back_as_they_were(tmp_path: Path) -> None:
    arrays = {
        "a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.array([True, False]), "c": np.array(2.5),
        "d": np.zeros((0, 3)), "e": np.array([2**63 - 1, -1]), "f": np.arange(6).reshape(2, 3).T,
    }  # fmt: skip
    values = {"loss": 0.1 + 0.2, "none": None, "nested": {"x": [2**64 - 1]}}
    checkpoint = CheckpointFile(tmp_path / "c", IDENTITY)
    assert checkpoint.read() is None
    checkpoint.write(TrainingState(arrays, values))
    found = CheckpointFile(tmp_path / "c", json.loads(json.dumps(IDENTITY))).read()
    assert found is not None
    assert found.values == values
    assert found.arrays.keys() == arrays.keys()
    for name, array in arrays.items():
        assert (found.arrays[name].dtype, found.arrays[name].shape) == (array.dtype, array.shape)
        assert found.arrays[name].tobytes() == array.tobytes()


def test_what_cannot_be_written_leaves_the_state_before(tmp_path: Path) -> None:
    checkpoint = CheckpointFile(tmp_path / "c", IDENTITY)
    checkpoint.write(TrainingState({"a": np.zeros(2)}, {}))
    before = (tmp_path / "c").read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pathlib.Path.write_bytes", full)
        with pytest.raises(OutputError, match=r"Cannot write the checkpoint .*No space left"):
            checkpoint.write(TrainingState({"a": np.ones(2)}, {}))
    assert snapshot(tmp_path) == {"c": before}


def test_removing_takes_what_a_kill_left_too(tmp_path: Path) -> None:
    checkpoint = CheckpointFile(tmp_path / "c", IDENTITY)
    checkpoint.remove()
    checkpoint.write(TrainingState({"a": np.zeros(2)}, {}))
    with pytest.raises(OutputError, match=r"unfinished training; go on with --resume"):
        checkpoint.check_absent()
    (tmp_path / ".c.01234567.part").write_text("half", encoding="utf-8")
    checkpoint.remove()
    assert snapshot(tmp_path) == {}
    checkpoint.check_absent()


def test_it_is_due_after_its_time_and_not_before(tmp_path: Path) -> None:
    assert not CheckpointFile(tmp_path / "c", IDENTITY, every_seconds=1e6).is_due()
    soon = CheckpointFile(tmp_path / "c", IDENTITY, every_seconds=0.0)
    assert soon.is_due()
