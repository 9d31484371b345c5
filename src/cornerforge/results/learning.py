"""Results of `train` and `train-av`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.rates import Rate, Yield
from cornerforge.results.stating import meant

__all__ = ["Baseline", "Learned", "LearnedPolicy", "Trained", "TrainedAv"]

POLICY_HASH = meant("Hash of the policy; what it made bears it.")
BOUNDED = meant("Only actions that the naturalistic model calls possible.")
BUDGET = meant("Likelihood budget of a test; null: none.", "nats")
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


@dataclass(frozen=True, kw_only=True)
class _Training(Learned):
    """How it was trained."""

    preset: str = field(metadata=PRESET)
    bounded: bool = field(metadata=BOUNDED)
    budget: float | None = field(metadata=BUDGET)
    reward: str = field(metadata=meant("Which crashes were paid for: crash, striking or avoidable."))
    delay_s: float = field(metadata=meant("Time that the AV has to react, for avoidable crashes.", "s"))


@dataclass(frozen=True, kw_only=True)
class _Named:
    """Who is measured."""

    name: str = field(metadata=meant('Such as "swerve" and "swerve, bounded".'))
    bounded: bool = field(metadata=BOUNDED)


@dataclass(frozen=True, kw_only=True)
class Baseline(Yield, _Named):
    """What a plain adversary reaches on the same tests."""


@dataclass(frozen=True, kw_only=True)
class Trained(Yield, _Training):
    """A trained adversary, measured on tests that no training uses, with the plain ones beside it."""

    baselines: tuple[Baseline, ...] = field(metadata=meant("Plain adversaries and nobody, on the same tests."))
    policy_hash: str = field(metadata=POLICY_HASH)
    kept: bool = field(metadata=meant("A finished policy of the same training was there, and only measured again."))
    out: str = field(metadata=meant("File of the policy."))


@dataclass(frozen=True, kw_only=True)
class TrainedAv(Rate, Learned):
    """A trained AV, measured in natural traffic that it never saw."""

    mean_speed: float = field(metadata=meant("Mean speed of the AV in these tests.", "m/s"))
    av_hash: str = field(metadata=meant("Hash of the AV."))
    out: str = field(metadata=meant("File of the AV."))
