"""Natural crash rates by trees of tests (`sim.trees`): grown in threads, summed up, and judged."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.execution import Rooms, in_order
from cornerforge.sim import (
    BUILT_IN,
    NATURALISTIC,
    NOBODY,
    Setting,
    allocate_scratch,
    keep_nothing,
    lessons,
    trees,
    warn_of_left_out,
)

__all__ = ["Grown", "LessonTable", "grow"]

_ARRAYS = ("roots", "crashes", "actions")
_CHUNK = 250
_ROWS = 400
"""Worlds that wait at once; the stack is as deep as acts and copies of one tree."""
_LEAVES_PER_ROOT = 16
_MOMENTS_PER_ROOT, _LESSONS_PER_ROOT = 400, 4000
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
        roots: One a tree, of `sim.trees.ROOT`, in the order of the tests.
        crashes: Their crashes, as far as there was room, of `sim.trees.LEAF`.
        actions: With which they come again, int8 (K, decisions, N).
        lessons: What they teach; None if that was not asked for.
        cpu_seconds: Of all threads together.
    """

    roots: NDArray[np.void]
    crashes: NDArray[np.void]
    actions: NDArray[np.int8]
    lessons: LessonTable | None
    cpu_seconds: float


def grow(
    setting: Setting,
    slots: int,
    plan: trees.Plan,
    *,
    seed: int,
    first: int,
    tests: int,
    threads: int,
    learning: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Grown:
    """Grow the trees of a range of tests.

    Args:
        setting, slots: The run, natural, with an AV of the kernels, and its vehicle slots per world.
        plan: How they grow.
        seed, first, tests: The tests.
        threads: Pool size; does not change the result.
        learning: Keep lessons (about 10 kB a tree).
        progress: Called with the number of trees done after each chunk.

    Raises:
        InputError: The run has an adversary, BVs of another kind, or an AV outside the kernels.
    """
    check_integer("tests", tests, low=1)
    who = setting.who
    if who.critical != NOBODY or who.others != NATURALISTIC or who.av != BUILT_IN:
        raise InputError("Trees grow from natural tests of an AV inside the simulator; this run has other drivers.")
    decisions = setting.road.max_decisions

    def rooms() -> tuple[Any, ...]:
        log = lessons.allocate_lessons(*(_CHUNK * n if learning else 0 for n in (_MOMENTS_PER_ROOT, _LESSONS_PER_ROOT)))
        leaves = trees.allocate_leaves(_CHUNK * _LEAVES_PER_ROOT, slots, decisions)
        return trees.allocate_nursery(_ROWS, slots, decisions), leaves, log, allocate_scratch(slots, who.policy)

    lent = Rooms(rooms)

    def work(start: int, count: int) -> Grown:
        begun = time.thread_time()
        roots = np.zeros(count, dtype=trees.ROOT)
        with lent.lend() as (nursery, leaves, log, scratch):
            leaves.used[:] = 0
            log.used[:] = 0
            forest = trees.Forest(plan, setting, scratch, keep_nothing(slots), nursery, leaves, log)
            trees.grow_range(seed, start, forest, roots)
            warn_of_left_out(scratch)
            found = leaves.used[0]
            crashes, actions = leaves.crashes[:found].copy(), leaves.actions[:found].copy()
            rng = np.random.Generator(np.random.Philox(key=[seed, start]))
            table = _table(log, rng) if learning else None
        return Grown(roots, crashes, actions, table, time.thread_time() - begun)

    parts: list[Grown] = []
    done = 0
    for part in in_order(work, first, tests, chunk=_CHUNK, threads=threads):
        parts.append(part)
        done += part.roots.size
        if progress is not None:
            progress(done)
    return _joined(parts)


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
    return Grown(roots, crashes, actions, whole, sum(part.cpu_seconds for part in parts))
