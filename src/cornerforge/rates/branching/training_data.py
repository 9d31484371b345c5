"""Training data of the danger: which worlds trees of tests met, and which of them came to a crash.

A *sample* is one BV near the AV at one moment: what was seen of it, and of which earlier sample about the same BV it is
the continuation, with which share of its weight. The mean of what followed, weighted so, is the danger that the network
should have given (`rates.teaching`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.rates.branching.acts import TWO, Survey, begins_ahead, intent_now, intent_of
from cornerforge.rates.branching.danger import N_SEEN, Ahead, Intent, add_ahead, look_at
from cornerforge.road.straight import ahead_by

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim import Setting, World

__all__ = [
    "NO_MOMENT",
    "TrainingData",
    "add_what_followed",
    "allocate_training_data",
    "note_act",
    "note_crash",
    "note_moment",
]

NO_MOMENT = -1
"""Number of a moment that was not noted."""

MOMENT = np.dtype([("parent", "i8"), ("first", "i8"), ("n", "i8"), ("test", "i8"), ("act", "i8"), ("weight", "f8")])
"""A world at a moment. parent: the moment before it; first, n: its samples; test: the tree's; act: 0 for the begin of a
second, else the kind of act that is known to happen in it; weight: of the world, all copies together."""

SAMPLE = np.dtype([("slot", "i8"), ("before", "i8"), ("share", "f8"), ("crash", "f8")])
"""A sample. slot: of the BV; before: the sample that it continues, -1 for none; share: its weight over that one's;
crash: weight of crashes with this BV within the second, over the moment's weight."""


class TrainingData(NamedTuple):
    """Samples in the order in which they were met; without room nothing is noted.

    Attributes:
        moments: (M,) of MOMENT.
        samples: (L,) of SAMPLE.
        seen: What was seen, float32 (L, N_SEEN).
        used: How many moments and samples there are, int64 (2,).
    """

    moments: NDArray[np.void]
    samples: NDArray[np.void]
    seen: NDArray[np.float32]
    used: NDArray[np.int64]


def allocate_training_data(moments: int, samples: int) -> TrainingData:
    """Allocate room for so many moments and samples."""
    return TrainingData(
        np.zeros(moments, dtype=MOMENT),
        np.zeros(samples, dtype=SAMPLE),
        np.zeros((samples, N_SEEN), dtype=np.float32),
        np.zeros(2, dtype=np.int64),
    )


@inlined_kernel
def _begin(w: World, parent: int, weight: float, act: int, most: int, log: TrainingData) -> int:
    """Begin a moment of at most `most` samples; return its number, NO_MOMENT without room."""
    used = log.used
    if used[0] >= log.moments.size or used[1] + most > log.samples.size:
        return NO_MOMENT
    number: int = used[0]
    used[0] += 1
    moment = log.moments[number]
    moment.parent = parent
    moment.first = used[1]
    moment.n = 0
    moment.test = w.state[0].test
    moment.act = act
    moment.weight = weight
    return number


@inlined_kernel
def _add(slot: int, number: int, log: TrainingData) -> int:
    """Add a sample about a slot to moment `number`, and find the one that it continues; return its place."""
    place: int = log.used[1]
    log.used[1] += 1
    moment = log.moments[number]
    moment.n += 1
    sample = log.samples[place]
    sample.slot = slot
    sample.before = -1
    sample.share = 0.0
    sample.crash = 0.0
    parent = moment.parent
    for _ in range(2):  # where an act is known, not all BVs have a sample
        if parent == NO_MOMENT:
            break
        before = log.moments[parent]
        for p in range(before.first, before.first + before.n):
            if log.samples[p].slot == slot:
                sample.before = p
                sample.share = moment.weight / before.weight
                return place
        if before.act == 0:
            break
        parent = before.parent
    return place


@kernel
def note_moment(w: World, parent: int, weight: float, s: Survey, log: TrainingData) -> int:
    """Note a world at the begin of a second, with all near BVs; `weight`: of all its copies together."""
    number = _begin(w, parent, weight, 0, s.n_near[0], log)
    if number == NO_MOMENT:
        return number
    for n in range(s.n_near[0]):
        place = _add(s.near[n].slot, number, log)
        for k in range(N_SEEN):
            log.seen[place, k] = s.seen[n, k]
    return number


@inlined_kernel
def _add_look(
    w: World, near: int, intent: Intent, ahead: Ahead, setting: Setting, number: int, s: Survey, log: TrainingData
) -> None:
    """Add a sample about a near BV of which it is known what it does."""
    place = _add(s.near[near].slot, number, log)
    look_at(w, s.near[near].slot, intent, s.near[near].away, ahead, setting.road, log.seen[place])


@kernel
def note_act(
    w: World,
    parent: int,
    weight: float,
    acts: tuple[int, int],
    ahead: Ahead,
    setting: Setting,
    s: Survey,
    log: TrainingData,
) -> int:
    """Note a world of which it is known that the first of `acts` happens, and the second if that is not -1.

    The samples are about the BVs that act, and about the AV's follower if a BV comes in ahead of the AV.
    """
    if parent == NO_MOMENT:
        return NO_MOMENT
    number = _begin(w, parent, weight, s.acts[acts[0]].kind if acts[1] < 0 else TWO, 3, log)
    if number == NO_MOMENT:
        return number
    follower = s.follower[0]
    more = ahead
    comes_in = False
    for act in acts:
        if act >= 0 and begins_ahead(w, s.acts[act]):
            more = add_ahead(w, s.acts[act].slot, more)
            comes_in = True
    for act in acts:
        if act >= 0:
            one = s.acts[act]
            behind = ahead_by(w.vehicles, 0, one.slot) < 0.0
            _add_look(w, one.near, intent_of(one, s), more if behind else ahead, setting, number, s, log)
            if one.near == follower:
                follower = -1
    if follower >= 0 and comes_in:
        _add_look(w, follower, intent_now(s.near[follower]), more, setting, number, s, log)
    return number


@kernel
def note_crash(slot: int, weight: float, number: int, log: TrainingData) -> None:
    """Note that a world of a weight, last noted as moment `number`, ended in a crash of the AV with a slot."""
    while number != NO_MOMENT:
        moment = log.moments[number]
        for p in range(moment.first, moment.first + moment.n):
            if log.samples[p].slot == slot:
                log.samples[p].crash += weight / moment.weight
                return
        if moment.act == 0:
            return
        number = moment.parent


@kernel
def add_what_followed(log: TrainingData, followed: NDArray[np.float64]) -> None:
    """Write into `followed`, (L,) or more, the weight of crashes after each sample, over the sample's weight."""
    n = log.used[1]
    for p in range(n):
        followed[p] = log.samples[p].crash
    for p in range(n - 1, -1, -1):  # a sample comes after the one that it continues
        before = log.samples[p].before
        if before >= 0:
            followed[before] += log.samples[p].share * followed[p]
