"""Results of `train` and `train-av`."""

from __future__ import annotations

from typing import Annotated, Any

from cornerforge._schema import Share, Whole, meant
from cornerforge.results.html import Result
from cornerforge.results.rates import Rate, Yield

__all__ = ["Baseline", "Learned", "LearnedPolicy", "Trained", "TrainedAv", "TrainingCurve", "TrainingPoint"]

POLICY_HASH = meant("Hash of the policy; what it made bears it.")
BOUNDED = meant("Only actions that the naturalistic model calls possible.")
BUDGET = meant("Likelihood budget of a test; null: none.", "nats")
AV_FAULTS = meant("Tests of the training that were abandoned because an AV from outside failed in them.")
PRESET = meant('Settings of the training, "fast" or "paper".')


class Learned(Result):
    """How long a training was."""

    decisions: Annotated[Whole, meant("Decisions learnt from, one a second of driving; whole iterations.")]
    updates: Annotated[Whole, meant("Steps of the optimiser.")]
    seconds: Annotated[float, meant("Wall-clock of the training; 0 where a finished one was kept.", "s")]


class LearnedPolicy(Learned):
    """A policy that was trained, not yet measured."""

    preset: Annotated[str, PRESET]
    policy_hash: Annotated[str, POLICY_HASH]
    av_faults: Annotated[Whole, AV_FAULTS]


class _Training(Learned):
    """How it was trained."""

    learner: Annotated[str, meant("What learned: dqn or ppo.")]
    preset: Annotated[str, PRESET]
    bounded: Annotated[bool, BOUNDED]
    budget: Annotated[float | None, BUDGET]
    reward: Annotated[str, meant("Which crashes were paid for: a name of a reward, such as crash or preventable.")]
    delay_s: Annotated[float, meant("Time that the AV has to react, for avoidable crashes.", "s")]


class _Named(Result):
    """Adversary that is measured."""

    name: Annotated[str, meant('Such as "swerve" and "swerve, bounded".')]
    bounded: Annotated[bool, BOUNDED]


class Baseline(Yield, _Named):
    """Yield of a plain adversary on the same tests."""


class Trained(Yield, _Training):
    """A trained adversary, measured on tests that no training uses, with the plain ones beside it."""

    baselines: Annotated[tuple[Baseline, ...], meant("Plain adversaries and nobody, on the same tests.")]
    policy_hash: Annotated[str, POLICY_HASH]
    kept: Annotated[bool, meant("A finished policy of the same training was there, and only measured again.")]
    av_faults: Annotated[Whole, AV_FAULTS]
    out: Annotated[str, meant("File of the policy.")]


class TrainedAv(Rate, Learned):
    """A trained AV, measured in natural traffic that it never saw."""

    mean_speed: Annotated[float, meant("Mean speed of the AV in these tests.", "m/s")]
    av_hash: Annotated[str, meant("Hash of the AV.")]
    out: Annotated[str, meant("File of the AV.")]


class TrainingPoint(Result):
    """One point of a training curve, over the tests that ended since the point before.

    The tests explore, at random only: tests of guided worlds (`DqnConfig.guided`) are not counted.
    """

    decisions: Annotated[Whole, meant("Decisions learnt from so far.")]
    seconds: Annotated[
        float | None, meant("Wall-clock so far; null in files, so that the same training gives the same bytes.", "s")
    ]
    updates: Annotated[Whole, meant("Steps of the optimiser so far.")]
    epsilon: Annotated[
        float | None,
        meant("Share of decisions taken at random, 0 to 1; null: the learner draws all by its probabilities."),
    ]
    loss: Annotated[
        float | None,
        meant("What the last step lowered, of the DQN the temporal difference; null: nothing was learnt yet."),
    ]
    tests: Annotated[Whole, meant("Tests that count.")]
    crashes_per_test: Annotated[
        Share | None, meant("Share of the tests in which the AV crashed, 0 to 1; null: no tests.", "per test")
    ]
    paid_per_test: Annotated[
        Share | None, meant("Share of the tests with a reward of +1, 0 to 1; where it is counted.", "per test")
    ] = None
    entropy: Annotated[float | None, meant("Mean entropy of the probabilities of actions, of PPO alone.", "nats")] = (
        None
    )


class TrainingCurve(Result):
    """How an adversary learnt; `training.json` of a run."""

    preset: Annotated[str, PRESET]
    config: Annotated[dict[str, Any], meant("Settings of the training, by name; null: not set.")]
    points: Annotated[tuple[TrainingPoint, ...], meant("In order.")]
