"""Records of a drive: frames, decisions and counts. Keeping them does not change the drive."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._elementary import log
from cornerforge._jit import kernel
from cornerforge.sim.observe import UNITS_PER_NAT, price_from
from cornerforge.sim.perception import losses_price
from cornerforge.sim.statistics import NOBODY_COUNTED, Census, Counts, allocate_counts
from cornerforge.sim.step import allocate_recording
from cornerforge.types import N_ACTIONS, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import ChoiceScratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "Decisions",
    "Keep",
    "allocate_decisions",
    "keep_nothing",
    "keep_whole_test",
    "record_choice",
]


class Decisions(NamedTuple):
    """Record of the decisions of one test.

    Attributes:
        action: Action of every vehicle, (K, N).
        controlled: Slot of the critical BV, (K,); -1 for none.
        log_prob: Natural log of the probability of the critical BV's action under the NDE, given what the AV chose at
            that moment, (K,); 0 without a critical BV.
        shortfall: Log-probability of the likeliest action minus that of the taken one, human errors included [nats],
            (K,), at least 0, +inf where the action is impossible; 0 without a critical BV. It is the action's cost to a
            likelihood budget, which does not know what the AV chose at that moment.
        excess: Entropy of what the BV may do, taken from -ln of the probability of what it did [nats], (K,): in the
            mean 0 of natural drivers; +inf where the action is impossible; 0 without a critical BV.
        log_prob_policy: Natural log of the action's probability under the policy, (K,); 0 without a policy.
        hidden: 1 where the adversary also made the AV lose the critical BV (`perception.lose_controlled`), (K,); the
            natural chance of that is in the three measures before.
    """

    action: NDArray[np.int8]
    controlled: NDArray[np.int16]
    log_prob: NDArray[np.float64]
    shortfall: NDArray[np.float64]
    excess: NDArray[np.float64]
    log_prob_policy: NDArray[np.float64]
    hidden: NDArray[np.int8]


class Keep(NamedTuple):
    """Where a drive is kept; arrays of size 0 keep nothing.

    Attributes:
        recording: Frames, (T, N) of `fields.FRAME_FIELDS`; all absent before the drive.
        decisions: Decisions of the first K seconds.
        chances: P(action) of each BV at each of the first K decisions of a scripted drive, float64 (K, N, 33).
        counts: Histograms to add to.
        census: Which BVs are counted, and when.
    """

    recording: NDArray[np.void]
    decisions: Decisions
    chances: NDArray[np.float64]
    counts: Counts
    census: Census


def allocate_decisions(n: int, slots: int) -> Decisions:
    """Allocate n decisions of `slots` vehicles; 0 records nothing."""
    log_prob, shortfall, excess, of_policy = np.zeros((4, n))
    action, hidden = np.zeros((n, slots), dtype=np.int8), np.zeros(n, dtype=np.int8)
    return Decisions(action, np.zeros(n, dtype=np.int16), log_prob, shortfall, excess, of_policy, hidden)


def keep_nothing(slots: int, *, counts: Counts | None = None, census: Census = NOBODY_COUNTED) -> Keep:
    """Keep neither frames nor decisions; count what a census says, if one is given."""
    return Keep(
        allocate_recording(0, slots),
        allocate_decisions(0, slots),
        np.zeros((0, slots, N_ACTIONS)),
        allocate_counts() if counts is None else counts,
        census,
    )


def keep_whole_test(setting: Setting, slots: int) -> Keep:
    """Keep every frame and decision of a test; allocated for the longest one."""
    longest = setting.road.max_decisions
    return keep_nothing(slots)._replace(
        recording=allocate_recording(SUBSTEPS * longest + 1, slots), decisions=allocate_decisions(longest, slots)
    )


@kernel
def record_choice(
    w: World, bv: int, log_prob_policy: float, road: RoadNumbers, s: ChoiceScratch, decisions: Decisions
) -> None:
    """Note all actions in the second that begins, and how likely the critical BV's action was.

    Args:
        w: The world; all vehicles have decided, none has begun to act.
        bv: Slot of the critical BV, -1 for none.
        log_prob_policy: Natural log of the probability of its action under the policy.
        road: Constants.
        s: `p` and `unseen` hold the probabilities of its actions.
        decisions: Where it goes.
    """
    step = w.state[0].decisions
    decisions.controlled[step] = bv
    decisions.log_prob[step] = 0.0
    decisions.shortfall[step] = 0.0
    decisions.excess[step] = 0.0
    decisions.log_prob_policy[step] = log_prob_policy
    decisions.hidden[step] = 0
    for i in range(w.state[0].n_vehicles):
        decisions.action[step, i] = w.vehicles[i].action
    if bv < 0:
        return
    action = w.vehicles[bv].action
    p = s.p[action]
    decisions.log_prob[step] = log(p) if p > 0.0 else -math.inf
    p = s.unseen[action]
    decisions.shortfall[step] = price_from(s.unseen, False) - log(p) if p > 0.0 else math.inf
    decisions.excess[step] = price_from(s.unseen, True) - log(p) if p > 0.0 else math.inf
    if w.state[0].hidden == bv:
        decisions.hidden[step] = 1
        decisions.log_prob[step] += log(road.perception.dropout)
        decisions.shortfall[step] += losses_price(road) / UNITS_PER_NAT
        decisions.excess[step] += losses_price(road) / UNITS_PER_NAT
