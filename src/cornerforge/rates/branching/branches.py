"""Acts of near BVs in a second, as branches of which exactly one happens, with its chance and its danger.

The listed acts (`acts`) are independent of each other, except acts of one group. In order of the list, branch k is that
act k is the first to happen. Later acts are left to nature, but for acts that are paired with it: of these the first to
happen makes a branch of its own, and where none does, all are held not to happen. The last branch is that no listed act
happens.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.rates.branching.acts import MOST_ACTS, Survey, chance_of, last_of
from cornerforge.sim import steering

__all__ = ["NO_ACT", "Branches", "allocate_branches", "hold_to_branch", "hold_to_no_act", "list_branches"]

NO_ACT = -1
"""Number that stands for no act."""
_MOST = MOST_ACTS + MOST_ACTS * (MOST_ACTS - 1) // 2

BRANCH = np.dtype([("first", "i8"), ("second", "i8"), ("chance", "f8"), ("danger", "f8")])
"""A branch in which an act happens. first: the act; second: one paired with it, or NO_ACT; chance; danger: of all BVs
together then."""


class Branches(NamedTuple):
    """Branches of a second.

    Attributes:
        listed: Those in which a listed act happens, of BRANCH.
        n: How many there are, int64 (1,).
        rest: Chance that no listed act happens, (1,).
    """

    listed: NDArray[np.void]
    n: NDArray[np.int64]
    rest: NDArray[np.float64]


def allocate_branches() -> Branches:
    """Allocate room for all branches that a survey may have."""
    return Branches(np.zeros(_MOST, dtype=BRANCH), np.zeros(1, dtype=np.int64), np.zeros(1))


@inlined_kernel
def _add(first: int, second: int, chance: float, danger: float, branches: Branches) -> None:
    """Add a branch."""
    branch = branches.listed[branches.n[0]]
    branches.n[0] += 1
    branch.first = first
    branch.second = second
    branch.chance = chance
    branch.danger = danger


@kernel
def list_branches(whole: float, survey: Survey, branches: Branches) -> None:
    """List the branches of a survey; chances are multiplied by `whole`."""
    n = survey.n_acts[0]
    branches.n[0] = 0
    rest = whole
    for k in range(n):
        act = survey.acts[k]
        chance = rest * chance_of(act.count)
        for m in range(last_of(k, survey) + 1, n):
            other = survey.acts[m]
            if _is_paired(k, last_of(m, survey), survey):
                danger = max(survey.pairs[k, m], act.danger)
                _add(k, m, chance * chance_of(other.count), danger, branches)
                if other.is_last:
                    chance *= chance_of(other.rest_count)
        _add(k, NO_ACT, chance, act.danger, branches)
        if act.is_last:
            rest *= chance_of(act.rest_count)
    branches.rest[0] = rest


@inlined_kernel
def _is_paired(k: int, last: int, s: Survey) -> bool:
    """Is any act of the group that ends with `last` looked at together with act k?"""
    m = last
    while m > k and (m == last or s.acts[m].is_last == 0):
        if s.pairs[k, m] > 0.0:
            return True
        m -= 1
    return False


@inlined_kernel
def _hold_to_rest(last: int, held: steering.Steering, s: Survey) -> None:
    """Let nothing of the group happen that ends with act `last`."""
    act = s.acts[last]
    steering.hold_to(held, act.slot, act.word, act.rest_first, act.rest_count)


@inlined_kernel
def _hold_to_act(k: int, held: steering.Steering, s: Survey) -> None:
    """Let act k happen."""
    act = s.acts[k]
    steering.hold_to(held, act.slot, act.word, act.first, act.count)


@kernel
def hold_to_branch(first: int, second: int, held: steering.Steering, survey: Survey) -> None:
    """Hold BVs to a branch in which act `first` happens, and `second` if that is not NO_ACT."""
    own = last_of(first, survey)
    until = survey.n_acts[0] if second == NO_ACT else last_of(second, survey)
    for m in range(until):
        if survey.acts[m].is_last and m != own and (m < first or _is_paired(first, m, survey)):
            _hold_to_rest(m, held, survey)
    _hold_to_act(first, held, survey)
    if second != NO_ACT:
        _hold_to_act(second, held, survey)


@inlined_kernel
def hold_to_no_act(held: steering.Steering, survey: Survey) -> None:
    """Hold BVs to the branch in which no listed act happens."""
    for k in range(survey.n_acts[0]):
        if survey.acts[k].is_last:
            _hold_to_rest(k, held, survey)
