"""Controllers of the vehicles: what drives the AV, the critical BV (the BV nearest to the AV) and the other BVs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import PURPOSE_CAST, block, uniform
from cornerforge.drivers.policy import NO_POLICY, PolicyNumbers
from cornerforge.sim.rails import NO_RAILS, Rails

__all__ = [
    "ADVERSARIES",
    "AS_LEARNED",
    "BUILT_IN",
    "CUTS_IN",
    "DART_OUT",
    "IDM_BVS",
    "LIKELIEST",
    "NATURALISTIC",
    "NOBODY",
    "NO_CAST",
    "NO_SCRIPT",
    "OUTSIDE",
    "POLICY",
    "RAILS",
    "RECORDED",
    "RED_RUNNER",
    "ROAD_ADVERSARIES",
    "SCRIPTED",
    "SITE_ADVERSARIES",
    "STEERED",
    "SWERVE",
    "TOLD",
    "TURNS_ACROSS",
    "UNIFORM",
    "Cast",
    "Controllers",
    "Mask",
    "cast_index",
    "cast_of",
    "critical_of",
    "is_outside",
]

BUILT_IN, OUTSIDE, LIKELIEST, STEERED, RECORDED = range(5)
"""Controllers of the AV. BUILT_IN: its own law. OUTSIDE: a program outside the kernels that orders accelerations and
lane changes. LIKELIEST: the likeliest action of the naturalistic model. STEERED: a program outside that accelerates and
steers. RECORDED: no driver; the AV is on rails where others are (`RAILS`)."""
NOBODY, POLICY, UNIFORM, LANE_CHANGER, SWERVE, DART_OUT, RED_RUNNER, TURNS_ACROSS, CUTS_IN, TOLD = range(10)
ADVERSARIES = {
    "nobody": NOBODY,
    "policy": POLICY,
    "uniform": UNIFORM,
    "lane-changer": LANE_CHANGER,
    "swerve": SWERVE,
    "dart-out": DART_OUT,
    "red-runner": RED_RUNNER,
    "turns-across": TURNS_ACROSS,
    "cuts-in": CUTS_IN,
}
"""Controllers of the critical BV, by name. nobody: the controller of the other BVs. policy: a learned network. uniform:
any allowed action. lane-changer: changes lanes two times in three. swerve: comes level with the AV in the next lane,
then changes into its lane. At sites, where each but uniform does as its law says until it meets the AV: dart-out: a
person leaves the kerb when the AV can hardly stop. red-runner: a vehicle goes at red. turns-across: a left turn that
must yield goes before the AV. cuts-in: so does a vehicle that merges. TOLD, which has no name here: somebody outside
the kernels."""
SITE_ADVERSARIES = ("uniform", "dart-out", "red-runner", "turns-across", "cuts-in")
ROAD_ADVERSARIES = tuple(
    name for name in ADVERSARIES if name not in ("nobody", "policy") and name not in SITE_ADVERSARIES[1:]
)
"""Plain adversaries that drive and walk at sites; those that drive on roads."""
NATURALISTIC, IDM_BVS, SCRIPTED, RAILS = range(4)
"""Controllers of the other BVs: the naturalistic model, the IDM without lane changes, a script of actions for every BV,
or rails that say where every BV is (`sim.rails`)."""

AS_LEARNED = -1.0
"""Temperature of a policy that acts as its head says (`drivers.policy.HEADS`)."""

MEMBER = np.dtype(
    [
        ("begin", "i8"),
        ("end", "i8"),
        ("n_inputs", "i8"),
        ("n_shared", "i8"),
        ("n_stream", "i8"),
        ("width", "i8"),
        ("head", "i8"),
        ("bounded", "i8"),
        ("budget", "i8"),
        ("excess", "i8"),
        ("steers_from", "i8"),
    ]
)
"""A policy of a mixture: where its weights begin and end, its network's shape and its head, and its `Mask`."""


class Mask(NamedTuple):
    """Limits of an adversary.

    Attributes:
        bounded: 1 for the NDD-bounded mask.
        budget: Likelihood budget of a test (`observe.budget_units`); 0: no limit. Needs `bounded`.
        excess: 1 if the budget is one of excess, 0 if it is one of shortfalls (`observe.price_from`).
        steers_from: Second from which it controls a BV; until then all BVs drive naturally.
    """

    bounded: int = 0
    budget: int = 0
    excess: int = 0
    steers_from: int = 0


class Cast(NamedTuple):
    """Policies of a mixture, one of which drives each test.

    Attributes:
        weights: Weights of all networks, one after the other, float32.
        members: One row per policy, (K,) of MEMBER. K = 0: no mixture.
    """

    weights: NDArray[np.float32]
    members: NDArray[np.void]


NO_CAST = Cast(np.zeros(1, dtype=np.float32), np.zeros(0, dtype=MEMBER))
NO_SCRIPT = np.zeros((0, 0), dtype=np.int8)
HIDDEN = 65
"""Added to the action of a script, which is at least -1: the AV loses that vehicle in that second."""


class Controllers(NamedTuple):
    """The controllers of the AV, of the critical BV (the BV nearest to the AV) and of the other BVs.

    Attributes:
        av: BUILT_IN, OUTSIDE, LIKELIEST, STEERED or RECORDED.
        critical: Code of ADVERSARIES, or TOLD.
        others: NATURALISTIC, IDM_BVS, SCRIPTED or RAILS.
        bounded: 1 for the NDD-bounded mask.
        policy: The adversary's network; of a mixture the widest one, which decides the size of scratch.
        budget, excess, steers_from: As of `Mask`.
        temperature: Temperature at which a policy draws its actions; 0: it takes the best one; AS_LEARNED: as its
            head says.
        cast: The mixture of policies, each with its own mask and budget; empty for none.
        script: Action of each vehicle at each decision, plus HIDDEN where the AV loses it, int8 (K, N), for
            SCRIPTED; the test is cut off after K.
        rails: Starts and rails of the tests, for RAILS; then no BV is critical.
    """

    av: int = BUILT_IN
    critical: int = NOBODY
    others: int = NATURALISTIC
    bounded: int = 0
    policy: PolicyNumbers = NO_POLICY
    budget: int = 0
    excess: int = 0
    steers_from: int = 0
    temperature: float = 0.0
    cast: Cast = NO_CAST
    script: NDArray[np.int8] = NO_SCRIPT
    rails: Rails = NO_RAILS


def cast_of(policies: Sequence[PolicyNumbers], masks: Sequence[Mask]) -> Cast:
    """Make a mixture of policies.

    Args:
        policies: At least one.
        masks: What each policy may do. A budget is ignored where it is not bounded.
    """
    members = np.zeros(len(policies), dtype=MEMBER)
    begin = 0
    for k, (policy, mask) in enumerate(zip(policies, masks, strict=True)):
        end = begin + policy.weights.size
        members[k] = (begin, end, *policy[1:], *mask._replace(budget=mask.budget if mask.bounded else 0))
        begin = end
    return Cast(np.concatenate([policy.weights for policy in policies]), members)


@inlined_kernel
def is_outside(who: Controllers) -> bool:
    """Does a program outside the kernels answer for the AV?"""
    outside: bool = who.av == OUTSIDE or who.av == STEERED
    return outside


@kernel
def cast_index(seed: int, test: int, n: int) -> int:
    """Draw which of n policies drives a test, each with chance 1 / n; 0 for a single one."""
    draw = uniform(block(seed, test, 0, 0, PURPOSE_CAST)[0])
    return min(n - 1, math.floor(draw * n))


@inlined_kernel
def critical_of(seed: int, test: int, who: Controllers) -> tuple[PolicyNumbers, Mask]:
    """Look up network and mask of the adversary of one test."""
    members = who.cast.members
    if members.size == 0:
        return who.policy, Mask(who.bounded, who.budget, who.excess, who.steers_from)
    row = members[cast_index(seed, test, members.size)]
    weights = who.cast.weights[row.begin : row.end]
    network = PolicyNumbers(weights, row.n_inputs, row.n_shared, row.n_stream, row.width, row.head)
    return network, Mask(row.bounded, row.budget, row.excess, row.steers_from)
