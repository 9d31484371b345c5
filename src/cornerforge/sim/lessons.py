"""What trees of tests tell about danger: which worlds were met, and which of them came to a crash.

A *lesson* is one BV near the AV at one moment: what was seen of it, and of which earlier lesson about the same BV it is
the continuation, with which share of its weight. The mean of what followed, weighted so, is the danger that the network
should have given (`rates.teaching`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.road.straight import ahead_by
from cornerforge.sim.acts import TWO, Survey, begins_ahead, intent_now, intent_of
from cornerforge.sim.danger import N_SEEN, Ahead, Intent, add_ahead, look_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = ["NO_MOMENT", "Lessons", "add_what_followed", "allocate_lessons", "crashed", "note_act", "note_moment"]

NO_MOMENT = -1
"""In place of a moment's number: it was not noted."""

MOMENT = np.dtype([("parent", "i8"), ("first", "i8"), ("n", "i8"), ("root", "i8"), ("act", "i8"), ("weight", "f8")])
"""A world at a moment. parent: the moment before it; first, n: its lessons; root: its test; act: 0 for the begin of a
second, else the kind of act that is known to happen in it; weight: of the world, all copies together."""

LESSON = np.dtype([("slot", "i8"), ("before", "i8"), ("share", "f8"), ("crash", "f8")])
"""A lesson. slot: of the BV; before: the lesson that it continues, -1 for none; share: its weight over that one's;
crash: weight of crashes with this BV within the second, over the moment's weight."""


class Lessons(NamedTuple):
    """Lessons in the order in which they were met; with no room nothing is noted.

    Attributes:
        moments: (M,) of MOMENT.
        lessons: (L,) of LESSON.
        seen: What was seen, float32 (L, N_SEEN).
        used: How many moments and lessons there are, int64 (2,).
    """

    moments: NDArray[np.void]
    lessons: NDArray[np.void]
    seen: NDArray[np.float32]
    used: NDArray[np.int64]


def allocate_lessons(moments: int, lessons: int) -> Lessons:
    """Allocate room for so many moments and lessons."""
    return Lessons(
        np.zeros(moments, dtype=MOMENT),
        np.zeros(lessons, dtype=LESSON),
        np.zeros((lessons, N_SEEN), dtype=np.float32),
        np.zeros(2, dtype=np.int64),
    )


@inlined_kernel
def _begin(w: World, parent: int, weight: float, act: int, most: int, log: Lessons) -> int:
    """Begin a moment of at most `most` lessons; return its number, NO_MOMENT without room."""
    used = log.used
    if used[0] >= log.moments.size or used[1] + most > log.lessons.size:
        return NO_MOMENT
    number: int = used[0]
    used[0] += 1
    moment = log.moments[number]
    moment.parent = parent
    moment.first = used[1]
    moment.n = 0
    moment.root = w.state[0].test
    moment.act = act
    moment.weight = weight
    return number


@inlined_kernel
def _add(slot: int, number: int, log: Lessons) -> int:
    """Add a lesson about a slot to moment `number`, and find the one that it continues; return its place."""
    place: int = log.used[1]
    log.used[1] += 1
    moment = log.moments[number]
    moment.n += 1
    lesson = log.lessons[place]
    lesson.slot = slot
    lesson.before = -1
    lesson.share = 0.0
    lesson.crash = 0.0
    parent = moment.parent
    for _ in range(2):  # where an act is known, not all BVs have a lesson
        if parent == NO_MOMENT:
            break
        before = log.moments[parent]
        for p in range(before.first, before.first + before.n):
            if log.lessons[p].slot == slot:
                lesson.before = p
                lesson.share = moment.weight / before.weight
                return place
        if before.act == 0:
            break
        parent = before.parent
    return place


@kernel
def note_moment(w: World, parent: int, weight: float, s: Survey, log: Lessons) -> int:
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
    w: World, near: int, intent: Intent, ahead: Ahead, setting: Setting, number: int, s: Survey, log: Lessons
) -> None:
    """Add a lesson about a near BV of which it is known what it does."""
    place = _add(s.near[near].slot, number, log)
    look_at(w.vehicles, s.near[near].slot, intent, s.near[near].away, ahead, setting.road, log.seen[place])


@kernel
def note_act(
    w: World, parent: int, weight: float, acts: tuple[int, int], ahead: Ahead, setting: Setting, s: Survey, log: Lessons
) -> int:
    """Note a world of which it is known that the first of `acts` happens, and the second if that is not -1.

    The lessons are about who acts, and about the AV's follower if somebody comes in ahead of the AV.
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
def crashed(slot: int, weight: float, number: int, log: Lessons) -> None:
    """Note that a world of a weight, last noted as moment `number`, ended in a crash of the AV with a slot."""
    while number != NO_MOMENT:
        moment = log.moments[number]
        for p in range(moment.first, moment.first + moment.n):
            if log.lessons[p].slot == slot:
                log.lessons[p].crash += weight / moment.weight
                return
        if moment.act == 0:
            return
        number = moment.parent


@kernel
def add_what_followed(log: Lessons, followed: NDArray[np.float64]) -> None:
    """Write into `followed`, (L,) or more, the weight of crashes that followed each lesson, over that of the lesson."""
    n = log.used[1]
    for p in range(n):
        followed[p] = log.lessons[p].crash
    for p in range(n - 1, -1, -1):  # a lesson comes after the one that it continues
        before = log.lessons[p].before
        if before >= 0:
            followed[before] += log.lessons[p].share * followed[p]
