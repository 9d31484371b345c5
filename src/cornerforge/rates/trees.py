"""Natural crash rates by trees of tests (`sim.trees`) or tilted ones (`sim.tilt`): driven in threads, and summed up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.execution import Rooms, cpu_seconds, in_order
from cornerforge.sim import (
    BUILT_IN,
    NATURALISTIC,
    NOBODY,
    ROOT,
    Forest,
    Plan,
    Setting,
    allocate_leaves,
    allocate_nursery,
    allocate_scratch,
    keep_nothing,
    lessons,
    naming_tests,
    trees,
    warn_of_left_out,
)

__all__ = ["BUILT_IN_GROWER", "Grower", "Grown", "LessonTable", "Noted", "grow"]

_ARRAYS = ("roots", "crashes", "actions")
_ROWS = 400
"""Worlds that wait at once; the stack is as deep as acts and copies of one tree. Without copies it is one world."""
_LEAVES_PER_ROOT = 16
_MOMENTS_PER_ROOT, _LESSONS_PER_ROOT = 400, 4000
_MOST_MOMENTS, _MOST_LESSONS = 1_000_000, 8_000_000
"""With no more room, more lessons are not noted."""
_LEAST_PICKED = 0.03


@dataclass(frozen=True)
class LessonTable:
    """Lessons of many trees (`sim.lessons`): all that a crash followed, and of the others the nearer the more.

    Attributes:
        seen: What was seen, float32 (L, N_SEEN).
        followed: Weight of the crashes that followed, per weight of the lesson, (L,).
        weight: For how many lessons each stands, (L,).
        root: Test of each, int64 (L,).
    """

    seen: NDArray[np.float32]
    followed: NDArray[np.float64]
    weight: NDArray[np.float64]
    root: NDArray[np.int64]


@dataclass(frozen=True)
class Grown:
    """Trees.

    Attributes:
        roots: One a tree, of `sim.forest.ROOT`, in the order of the tests.
        crashes: Their crashes, as far as there was room, of `sim.forest.LEAF`.
        actions: With which they come again, int8 (K, decisions, N).
        answers: With which an AV from outside comes again, (K, A, 2); A is 0 for an AV of the kernels.
        lessons: What they teach; None if that was not asked for.
        cpu_seconds: Of all threads together; without processes of AVs from outside.
        asked: How often an AV from outside was asked, again for copies too.
        strayed: How often it answered otherwise when it was asked again.
    """

    roots: NDArray[np.void]
    crashes: NDArray[np.void]
    actions: NDArray[np.int8]
    answers: NDArray[np.float64]
    lessons: LessonTable | None
    cpu_seconds: float
    asked: int
    strayed: int


class Noted(Protocol):
    """What is noted of an AV from outside: `foreign.trees.Watched`."""

    @property
    def answers(self) -> NDArray[np.float64]:
        """What it answered on the way to each crash."""

    @property
    def asked(self) -> int:
        """How often it was asked."""

    @property
    def again(self) -> int:
        """How often it was asked once more, for copies."""

    @property
    def strayed(self) -> int:
        """How often it then answered otherwise."""


class Grower(Protocol):
    """Grows trees."""

    @property
    def places(self) -> int:
        """Trees that grow side by side."""

    @property
    def chunk(self) -> int:
        """Trees of one call; what comes out does not depend on it but for the lessons that are picked."""

    def __call__(self, seed: int, first: int, forest: Forest, roots: NDArray[np.void]) -> Noted | None:
        """Grow the trees of tests first, first + 1, ..., one for each of `roots`; the forest takes what they give."""


class _BuiltInGrower:
    """Trees of an AV of the kernels, one after the other."""

    places, chunk = 1, 250

    def __call__(self, seed: int, first: int, forest: Forest, roots: NDArray[np.void]) -> None:
        trees.grow_range(seed, first, forest, roots)


BUILT_IN_GROWER: Grower = _BuiltInGrower()
"""For AVs of the kernels."""


def grow(
    setting: Setting,
    slots: int,
    plan: Plan,
    *,
    seed: int,
    first: int,
    tests: int,
    threads: int,
    learning: bool = False,
    grower: Grower = BUILT_IN_GROWER,
    progress: Callable[[int], None] | None = None,
) -> Grown:
    """Grow the trees of a range of tests.

    Args:
        setting, slots: The run, natural, and its vehicle slots per world.
        plan: How they grow.
        seed, first, tests: The tests.
        threads: Pool size; does not change the result.
        learning: Keep lessons (about 10 kB a tree).
        grower: Grows them; an AV from outside has its own, and then the setting's AV does not matter.
        progress: Called with the number of trees done after each chunk.

    Raises:
        InputError: The run has an adversary, BVs of another kind, or an AV outside without a grower.
        AvFaultError: An AV from outside fails.
    """
    check_integer("tests", tests, low=1)
    who = setting.who
    if who.critical != NOBODY or who.others != NATURALISTIC:
        raise InputError("Trees grow from natural tests; this run has other drivers.")
    if who.av != BUILT_IN and grower is BUILT_IN_GROWER:
        raise InputError("Trees of an AV outside the simulator need a grower of its own.")
    decisions, chunk = setting.road.max_decisions, grower.chunk

    def rooms() -> tuple[Any, ...]:
        moments, noted = min(_MOST_MOMENTS, chunk * _MOMENTS_PER_ROOT), min(_MOST_LESSONS, chunk * _LESSONS_PER_ROOT)
        log = lessons.allocate_lessons(moments, noted) if learning else lessons.allocate_lessons(0, 0)
        leaves = allocate_leaves(chunk * _LEAVES_PER_ROOT, slots, decisions)
        nursery = allocate_nursery(_ROWS if not plan.tilt.shares.size else 1, slots, decisions, grower.places)
        return nursery, leaves, log, allocate_scratch(slots, who.policy)

    lent = Rooms(rooms)

    def work(start: int, count: int) -> Grown:
        roots = np.zeros(count, dtype=ROOT)
        with lent.lend() as (nursery, leaves, log, scratch):
            leaves.used[:] = 0
            log.used[:] = 0
            forest = Forest(plan, setting, scratch, keep_nothing(slots), nursery, leaves, log)
            with naming_tests(nursery.worlds):
                noted = grower(seed, start, forest, roots)
            warn_of_left_out(scratch)
            found = leaves.used[0]
            crashes, actions = leaves.crashes[:found].copy(), leaves.actions[:found].copy()
            rng = np.random.Generator(np.random.Philox(key=[seed, start]))
            table = _table(log, rng) if learning else None
        if noted is None:
            return Grown(roots, crashes, actions, np.zeros((found, 0, 2)), table, 0.0, 0, 0)
        return Grown(roots, crashes, actions, noted.answers, table, 0.0, noted.asked + noted.again, noted.strayed)

    parts: list[Grown] = []
    done, begun = 0, cpu_seconds()
    for part in in_order(work, first, tests, chunk=chunk, threads=threads):
        parts.append(part)
        done += part.roots.size
        if progress is not None:
            progress(done)
    return replace(_joined(parts), cpu_seconds=cpu_seconds() - begun)


def _table(log: lessons.Lessons, rng: np.random.Generator) -> LessonTable:
    """Pick lessons of a log."""
    moments, used = log.moments[: log.used[0]], int(log.used[1])
    seen, followed = log.seen[:used], np.empty(used)
    lessons.add_what_followed(log, followed)
    chance = np.where(followed > 0.0, 1.0, np.clip(seen[:, -1], _LEAST_PICKED, 1.0))
    picked = rng.random(used) < chance
    root = np.repeat(moments["root"], moments["n"])
    return LessonTable(seen[picked], followed[picked], 1.0 / chance[picked], root[picked])


def _joined(parts: list[Grown]) -> Grown:
    """Join parts."""
    tables = [part.lessons for part in parts if part.lessons is not None]
    whole = None
    if tables:
        names = ("seen", "followed", "weight", "root")
        whole = LessonTable(*(np.concatenate([getattr(table, name) for table in tables]) for name in names))
    roots, crashes, actions = (np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS)
    answers = np.full((len(crashes), max(part.answers.shape[1] for part in parts), 2), np.nan)
    begin = 0
    for part in parts:
        answers[begin : begin + len(part.answers), : part.answers.shape[1]] = part.answers
        begin += len(part.answers)
    asked, strayed = sum(part.asked for part in parts), sum(part.strayed for part in parts)
    return Grown(roots, crashes, actions, answers, whole, 0.0, asked, strayed)
