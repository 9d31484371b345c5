"""Results of `train` and `train-av`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from cornerforge.results.rates import Rate, Yield
from cornerforge.results.stating import meant, share

__all__ = ["Baseline", "Learned", "LearnedPolicy", "Trained", "TrainedAv", "TrainingCurve", "TrainingPoint"]

POLICY_HASH = meant("Hash of the policy; what it made bears it.")
BOUNDED = meant("Only actions that the naturalistic model calls possible.")
BUDGET = meant("Likelihood budget of a test; null: none.", "nats")
AV_FAULTS = meant("Tests of the training that were abandoned because an AV from outside failed in them.")
PRESET = meant('Settings of the training, "fast" or "paper".')


@dataclass(frozen=True, kw_only=True)
class Learned:
    """How long a training was."""

    decisions: int = field(metadata=meant("Decisions learnt from, one a second of driving; whole iterations."))
    updates: int = field(metadata=meant("Steps of the optimiser."))
    seconds: float = field(metadata=meant("Wall-clock of the training; 0 where a finished one was kept.", "s"))


@dataclass(frozen=True, kw_only=True)
class LearnedPolicy(Learned):
    """A policy that was trained, not yet measured."""

    preset: str = field(metadata=PRESET)
    policy_hash: str = field(metadata=POLICY_HASH)
    av_faults: int = field(metadata=AV_FAULTS)


@dataclass(frozen=True, kw_only=True)
class _Training(Learned):
    """How it was trained."""

    preset: str = field(metadata=PRESET)
    bounded: bool = field(metadata=BOUNDED)
    budget: float | None = field(metadata=BUDGET)
    reward: str = field(
        metadata=meant("Which crashes were paid for: a name of a reward, such as crash or preventable.")
    )
    delay_s: float = field(metadata=meant("Time that the AV has to react, for avoidable crashes.", "s"))


@dataclass(frozen=True, kw_only=True)
class _Named:
    """Adversary that is measured."""

    name: str = field(metadata=meant('Such as "swerve" and "swerve, bounded".'))
    bounded: bool = field(metadata=BOUNDED)


@dataclass(frozen=True, kw_only=True)
class Baseline(Yield, _Named):
    """Yield of a plain adversary on the same tests."""


@dataclass(frozen=True, kw_only=True)
class Trained(Yield, _Training):
    """A trained adversary, measured on tests that no training uses, with the plain ones beside it."""

    baselines: tuple[Baseline, ...] = field(metadata=meant("Plain adversaries and nobody, on the same tests."))
    policy_hash: str = field(metadata=POLICY_HASH)
    kept: bool = field(metadata=meant("A finished policy of the same training was there, and only measured again."))
    av_faults: int = field(metadata=AV_FAULTS)
    out: str = field(metadata=meant("File of the policy."))


@dataclass(frozen=True, kw_only=True)
class TrainedAv(Rate, Learned):
    """A trained AV, measured in natural traffic that it never saw."""

    mean_speed: float = field(metadata=meant("Mean speed of the AV in these tests.", "m/s"))
    av_hash: str = field(metadata=meant("Hash of the AV."))
    out: str = field(metadata=meant("File of the AV."))


@dataclass(frozen=True, kw_only=True)
class TrainingPoint:
    """One point of a training curve, over the tests that ended since the point before.

    The tests explore, at random only: tests of guided worlds (`TrainConfig.guided`) are not counted.
    """

    decisions: int = field(metadata=meant("Decisions learnt from so far."))
    seconds: float | None = field(
        metadata=meant("Wall-clock so far; null in files, so that the same training gives the same bytes.", "s")
    )
    updates: int = field(metadata=meant("Steps of the optimiser so far."))
    epsilon: float = field(metadata=meant("Share of decisions taken at random, 0 to 1."))
    loss: float | None = field(metadata=meant("Temporal difference; null: nothing was learnt yet."))
    tests: int = field(metadata=meant("Tests that count."))
    crashes_per_test: float | None = field(
        metadata=share("Share of the tests in which the AV crashed, 0 to 1; null: no tests.", "per test")
    )
    paid_per_test: float | None = field(
        default=None, metadata=share("Share of the tests with a reward of +1, 0 to 1; where it is counted.", "per test")
    )


@dataclass(frozen=True, kw_only=True)
class TrainingCurve:
    """How an adversary learnt; `training.json` of a run."""

    preset: str = field(metadata=PRESET)
    config: dict[str, Any] = field(metadata=meant("Settings of the training, by name; null: not set."))
    points: tuple[TrainingPoint, ...] = field(metadata=meant("In order."))
