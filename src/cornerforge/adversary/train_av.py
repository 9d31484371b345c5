"""Training of the AV: the adversary's learner, with the AV's worlds in place of the adversary's.

Some of its tests have hostile BVs, so that it meets danger often enough to learn from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge._schema import Share, meant
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import DqnConfig
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.train import TRAINING_TESTS, CurvePoint, TrainResult, train_in
from cornerforge.adversary.worlds import (
    AV_DECISIONS,
    HOSTILE,
    AvReward,
    Exploring,
    Transitions,
    allocate_av_actors,
    collect_av,
    start_av_worlds,
)
from cornerforge.drivers.avs import AV_KINDS
from cornerforge.drivers.policy import LEARNED_WIDTH, NetworkShape, PolicyNumbers
from cornerforge.errors import InputError
from cornerforge.sim import (
    Setting,
    allocate_scratch,
    av_features,
    controllers,
    keep_nothing,
    naming_tests,
    warn_of_left_out,
)

__all__ = ["AV_TRAINING", "AvTrainConfig", "train_av"]


class AvTrainConfig(DqnConfig):
    """`DqnConfig` for the AV. A decision is a second of one world here: two decisions of the AV.

    Attributes:
        progress, acceleration, lane_change, nearness, time_gap: See `worlds.drive_av.AvReward`.
        hostile: Adversaries, one test each by turns: name, and whether it is NDD-bounded. "nobody" is natural
            traffic.

    Raises:
        InputError: A value is out of range, or the network is wider than the kernels take.
    """

    progress: Share = 0.01
    acceleration: Share = 0.002
    lane_change: Share = 0.004
    nearness: Share = 0.02
    time_gap: Annotated[float, meant("Time gap from which on `nearness` is 0.", "s", 0.1, 10.0)] = 1.0
    hostile: tuple[tuple[str, bool], ...] = (("nobody", False),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width > LEARNED_WIDTH:
            raise InputError(f"train.width = {self.width}: a learned AV's layers are at most {LEARNED_WIDTH} wide.")

    @property
    def network(self) -> NetworkShape:
        """Shape of the Q-network."""
        return NetworkShape(av_features.N_AV_FEATURES, self.n_shared, self.n_stream, self.width)

    @property
    def av_reward(self) -> AvReward:
        """Weights of the reward for the kernels."""
        return AvReward(self.progress, self.acceleration, self.lane_change, self.nearness, self.time_gap)

    @property
    def adversaries(self) -> NDArray[np.void]:
        """The adversaries by turns, as kernels take them."""
        turns = [(controllers.ADVERSARIES[name], bounded) for name, bounded in self.hostile]
        return np.array(turns, dtype=HOSTILE)


AV_TRAINING = AvTrainConfig(
    preset="av",
    optimiser="adam",
    learning_rate=1e-3,
    final_learning_rate=2e-5,
    batch=512,
    replay_size=600_000,
    replay_start=16_384,
    epsilon_start=1.0,
    epsilon_end=0.03,
    epsilon_decisions=200_000,
    target_update=500,
    decisions_per_update=64,
    worlds=512,
    decisions=1_000_000,
    n_shared=2,
    n_stream=1,
    width=64,
    discount=0.97,
    hostile=(
        *(("nobody", False),) * 5,
        ("lane-changer", True),
        ("uniform", True),
        ("lane-changer", False),
    ),
)
"""What the shipped `rl` was trained with (`make rl-av`)."""


class _Actor:
    """The worlds in which the AV drives."""

    def __init__(self, setting: Setting, slots: int, config: AvTrainConfig, seed: int) -> None:
        self._setting = setting
        self._reward = config.av_reward
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._keep = keep_nothing(slots)
        self._actors = allocate_av_actors(
            config.worlds, slots, av_features.N_AV_FEATURES, config.adversaries, setting.road
        )
        self._out = allocate_transitions(AV_DECISIONS * config.worlds, av_features.N_AV_FEATURES)
        self.finished = self._actors.finished.view(np.int64)
        with naming_tests(self._actors.worlds):
            start_av_worlds(seed, TRAINING_TESTS, setting, self._scratch, self._actors)

    def warm_up(self, exploring: Exploring) -> None:
        """Load the kernels that `act` calls, or compile them (once per installation); moves nobody."""
        self._collect(0, exploring)

    def act(self, exploring: Exploring, out: Transitions) -> Transitions:  # noqa: ARG002
        """Drive every world for one second with the given network."""
        rows = self._collect(len(self._actors.allowed), exploring)
        return Transitions._make(part[:rows] for part in self._out)

    def _collect(self, n: int, exploring: Exploring) -> int:
        """Drive the first n worlds for one second into `_out`; returns the number of transitions."""
        setting = self._setting._replace(av=self._setting.av._replace(network=exploring.policy))
        with naming_tests(self._actors.worlds):
            rows = collect_av(
                n, exploring.epsilon, setting, self._reward, self._actors, self._scratch, self._keep, self._out
            )
        warn_of_left_out(self._scratch)
        return rows

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything that `act` changes and needs again, by name; views."""
        actors = self._actors
        return {
            **{f"worlds.{name}": array for name, array in actors.worlds.arrays().items()},
            "observation": actors.observation,
            "allowed": actors.allowed,
            "finished": self.finished,
        }

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` gave."""
        for name, ours in self.arrays().items():
            ours[...] = saved[name]


def train_av(
    setting: Setting,
    slots: int,
    config: AvTrainConfig = AV_TRAINING,
    *,
    seed: int = 0,
    threads: int = 2,
    max_seconds: float | None = None,
    progress: Callable[[CurvePoint], None] | None = None,
    checkpoint: CheckpointFile | None = None,
) -> TrainResult:
    """Learn to drive: a dueling double DQN on `sim.av_features`, paid as `AvReward` says.

    Args:
        setting: The run; its adversary is replaced by `config.hostile`, its AV keeps only its IDM and MOBIL parameters
            (with them it explores, and starts a test at their desired gap).
        slots: Vehicle slots per world.
        config: Hyperparameters; `config.decisions` says how many seconds to drive, rounded up to whole iterations.
        seed: Determines tests, exploration, initial weights and replay draws.
        threads: 1 acts and learns by turns, more do both at once; the result is the same.
        max_seconds: Stop earlier after this time [s]; then the result depends on the machine's speed.
        progress: Called with each new point of the curve, whose crashes count hostile tests too.
        checkpoint: As for `train_adversary`.

    Returns:
        Final weights and the training curve.

    Raises:
        InputError: The seed is out of range, or the checkpoint is of another training.
        FileFormatError: The checkpoint is damaged.
        OutputError: The checkpoint cannot be written.
    """
    check_integer("seed", seed, low=0, high=2**63 - 1)

    def worlds(network: PolicyNumbers) -> _Actor:
        av = setting.av._replace(kind=AV_KINDS["learned"].code, network=network)
        road = setting.road._replace(av_substeps=av_features.DECIDES_EVERY)
        return _Actor(setting._replace(av=av, road=road).with_drivers(critical=controllers.NOBODY), slots, config, seed)

    return train_in(worlds, config, seed, threads, max_seconds, progress, checkpoint)
