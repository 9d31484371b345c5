"""Hyperparameters of trainings: what all learners have, those of the DQN, and the DQN's presets.

Importing this needs no PyTorch. Another learner keeps its hyperparameters and presets in its own file.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from cornerforge._checks import check_in, check_integer
from cornerforge._schema import Declared, Share, check_fields, meant
from cornerforge.adversary.worlds import reward_numbers
from cornerforge.drivers.policy import NetworkShape
from cornerforge.errors import MissingExtraError, UnknownNameError
from cornerforge.sim import observe
from cornerforge.world_options import LEARNERS

if TYPE_CHECKING:
    from cornerforge.adversary.learner import Learner

__all__ = ["PRESETS", "Count", "DqnConfig", "TrainConfig", "preset_named"]

Count = Annotated[int, meant("A number of things.", "", 1, 10**12)]
"""A whole number of at least 1."""


class TrainConfig(Declared):
    """Hyperparameters that every learner has.

    `learner` is a name of `world_options.LEARNERS`. `decisions` counts transitions of the controlled BV over all
    worlds; schedules run over decisions, never over seconds, so that the same seed learns the same weights on any
    machine speed. `reward` is a name of `adversary.worlds.rewards.REWARDS`; `delay_s` is the AV's time to react in
    `avoidable`, and of no account in others. `head`, the same for all policies of a learner, is a name of
    `drivers.policy.HEADS`.

    Raises:
        InputError: A value is out of range.
    """

    head: ClassVar[str] = "greedy"

    learner: str
    preset: str
    learning_rate: Annotated[float, meant("At the begin.", "", 1e-9, 1.0)]
    final_learning_rate: Annotated[float, meant("At the end.", "", 1e-9, 1.0)]
    worlds: Count
    decisions: Count
    n_shared: int
    n_stream: int
    width: int
    discount: Share = 1.0
    reward: str = "crash"
    delay_s: Annotated[float, meant("Time of the AV to react.", "s")] = 1.0

    def __post_init__(self) -> None:
        check_fields(self, "train.")
        reward_numbers(self.reward, self.delay_s)

    @property
    def network(self) -> NetworkShape:
        """Shape of the network."""
        return NetworkShape(observe.N_OBSERVATION, self.n_shared, self.n_stream, self.width)

    def make_learner(self, seed: int) -> Learner:
        """Make the learner that has these hyperparameters.

        Raises:
            MissingExtraError: PyTorch is missing.
        """
        learner: Learner = _module_of(self.learner).make_learner(self, seed)
        return learner


class DqnConfig(TrainConfig):
    """Hyperparameters of the dueling double DQN.

    `guided` is the share of worlds, at most 0.9, in which exploring mostly means to draw level and swerve, or to ram
    the AV from behind, so that crashes that chance hardly ever makes are seen at all; the chance to explore never falls
    below `guided_epsilon` there. Their likelihood budgets exceed the budget by up to `richer`: what is left is seen, so
    a crash that a richer test affords teaches what it would take. The training curve counts the other worlds.
    `paid_share`: see `replay.BalancedMemory`.
    `target_limit`: learning targets are cut to [-target_limit, target_limit]. The default 1 is the largest return of a
    test that is paid at its end only; rewards on the way need more.

    Raises:
        InputError: A value is out of range.
    """

    learner: str = "dqn"
    optimiser: str
    batch: Count
    replay_size: int
    replay_start: int
    epsilon_start: Share
    epsilon_end: Share
    epsilon_decisions: Count
    target_update: Annotated[Count, meant("Time between updates of the target.", "updates")]
    decisions_per_update: int
    guided: Annotated[float, meant("Share of worlds.", "", 0.0, 0.9)] = 0.0
    guided_epsilon: Share = 0.0
    richer: Annotated[float, meant("Most of the budget beyond it.", "nats", 0.0, 1e3)] = 0.0
    paid_share: Share = 0.0
    target_limit: Annotated[float, meant("Largest target.", "", 1e-6, 1e6)] = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_in("optimiser", self.optimiser, ("adam", "sgd"))
        check_integer("train.decisions_per_update", self.decisions_per_update, low=1, high=self.worlds)
        check_integer("train.replay_size", self.replay_size, low=max(self.batch, self.worlds), high=10**9)
        # Beyond the memory's size learning would never start.
        check_integer("train.replay_start", self.replay_start, low=1, high=self.replay_size)


PRESETS = {
    "fast": DqnConfig(
        preset="fast",
        optimiser="adam",
        learning_rate=1e-3,
        final_learning_rate=5e-5,
        batch=512,
        replay_size=524_288,
        replay_start=16_384,
        epsilon_start=1.0,
        epsilon_end=0.02,
        epsilon_decisions=400_000,
        target_update=250,
        decisions_per_update=256,
        worlds=512,
        decisions=3_000_000,
        n_shared=2,
        n_stream=1,
        width=64,
        guided=0.5,
        guided_epsilon=0.25,
        richer=15.0,
        paid_share=0.5,
    ),
    "paper": DqnConfig(
        preset="paper",
        optimiser="sgd",
        learning_rate=1e-6,
        final_learning_rate=1e-6,
        batch=16,
        replay_size=1_000_000,
        replay_start=5_000,
        epsilon_start=1.0,
        epsilon_end=0.1,
        epsilon_decisions=1_000_000,
        target_update=1_000,
        decisions_per_update=1,
        worlds=16,
        decisions=10_000_000,
        n_shared=4,
        n_stream=2,
        width=128,
    ),
}
"""`paper` is Table 1 and Figure 1 of the paper; it does not say how fast epsilon falls (here over 1e6 decisions), nor
how many environment steps go with one update (here one). `fast` learns best per minute on two cores."""


def _module_of(learner: str) -> Any:
    """Import the file of a learner: it gives `PRESETS`, by name, and `make_learner(config, seed)`.

    Raises:
        MissingExtraError: PyTorch is missing.
    """
    try:
        return import_module(f"cornerforge.adversary.{learner}")
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise MissingExtraError("torch", "learn") from error


def preset_named(name: str, learner: str = "dqn") -> TrainConfig:
    """Look up a preset of a learner.

    Raises:
        UnknownNameError: There is no such learner, or it has no preset of that name.
        MissingExtraError: PyTorch is missing; the DQN's presets need none.
    """
    if learner not in LEARNERS:
        raise UnknownNameError("learner", learner, LEARNERS)
    presets: Mapping[str, TrainConfig] = PRESETS if learner == "dqn" else _module_of(learner).PRESETS
    if name not in presets:
        raise UnknownNameError("preset", name, presets)
    return presets[name]
