"""Trees of tests (`splitting`), or tests drawn from proposals (`tilt`), driven in threads and summed up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.rates.branching.population import TREE, Plan, Population, allocate_pool, allocate_terminal_states
from cornerforge.rates.branching.splitting import drive_tree_range
from cornerforge.rates.branching.training_data import TrainingData, add_what_followed, allocate_training_data
from cornerforge.sim import Setting, allocate_scratch, controllers, keep_nothing, naming_tests, warn_of_left_out
from cornerforge.work import Rooms, cpu_seconds, in_order

__all__ = ["BUILT_IN_TREES", "DrivenTrees", "TrainingTable", "TreeDriver", "Watched", "drive_trees"]

_ARRAYS = ("trees", "crashes", "actions")
_ROWS = 400
"""Worlds that wait at once; the stack is as deep as acts and copies of one tree. Without copies it is one world."""
_CRASHES_PER_TREE = 16
_MOMENTS_PER_TREE, _SAMPLES_PER_TREE = 400, 4000
_MOST_MOMENTS, _MOST_SAMPLES = 1_000_000, 8_000_000
"""Room for moments and samples; further ones are not noted."""
_LEAST_PICKED = 0.03


@dataclass(frozen=True)
class TrainingTable:
    """Samples of many trees (`training_data`): all that a crash followed, and of the others the nearer the more.

    Attributes:
        seen: What was seen, float32 (L, N_SEEN).
        followed: Weight of the crashes that followed, per weight of the sample, (L,).
        weight: For how many samples each stands, (L,).
        test: Test of each, int64 (L,).
    """

    seen: NDArray[np.float32]
    followed: NDArray[np.float64]
    weight: NDArray[np.float64]
    test: NDArray[np.int64]


@dataclass(frozen=True)
class DrivenTrees:
    """Trees.

    Attributes:
        trees: One a tree, of `population.TREE`, in the order of the tests.
        crashes: Their crashes, as far as there was room, of `population.TERMINAL_STATE`.
        actions: With which they come again, int8 (K, decisions, N).
        answers: With which an AV from outside comes again, (K, A, 2); A is 0 for an AV of the kernels.
        training: Samples to train with; None if that was not asked for.
        cpu_seconds: Processor time of all threads together; without processes of AVs from outside.
        asked: How often an AV from outside was asked, again for copies too.
        strayed: How often it answered otherwise when it was asked again.
    """

    trees: NDArray[np.void]
    crashes: NDArray[np.void]
    actions: NDArray[np.int8]
    answers: NDArray[np.float64]
    training: TrainingTable | None
    cpu_seconds: float
    asked: int
    strayed: int


@dataclass(frozen=True)
class Watched:
    """Record of an AV from outside while trees were driven.

    Attributes:
        answers: What it answered on the way to each crash, in the order of the crashes, (K, A, W); NaN after the last.
        asked: Answers, also those asked for once more, for copies.
        strayed: Those of the latter that were others than before.
    """

    answers: NDArray[np.float64]
    asked: int
    strayed: int


class TreeDriver:
    """Drives trees of an AV of the kernels, one after the other.

    Attributes:
        places: Trees that are driven side by side.
        chunk: Trees of one call; what comes out does not depend on it but for the samples that are picked.
    """

    places, chunk = 1, 250

    def __call__(self, seed: int, first: int, population: Population, trees: NDArray[np.void]) -> Watched:
        """Drive the trees of tests first, first + 1, ..., one for each of `trees`, with the population."""
        drive_tree_range(seed, first, population, trees)
        return Watched(np.zeros((int(population.terminal.used[0]), 0, 2)), 0, 0)


BUILT_IN_TREES = TreeDriver()
"""Value for AVs of the kernels."""


def drive_trees(
    setting: Setting,
    slots: int,
    plan: Plan,
    *,
    seed: int,
    first: int,
    tests: int,
    threads: int,
    learning: bool = False,
    driver: TreeDriver = BUILT_IN_TREES,
    progress: Callable[[int], None] | None = None,
) -> DrivenTrees:
    """Drive the trees of a range of tests.

    Args:
        setting, slots: The run, natural, and its vehicle slots per world.
        plan: How they branch.
        seed, first, tests: The tests.
        threads: Pool size; does not change the result.
        learning: Keep samples (about 10 kB a tree).
        driver: Drives them; an AV from outside has its own, and then the setting's AV does not matter.
        progress: Called with the number of trees done after each chunk.

    Raises:
        InputError: The run has an adversary, BVs of another kind, or an AV outside without a driver.
        AvFaultError: An AV from outside fails.
    """
    check_integer("tests", tests, low=1)
    who = setting.who
    if who.critical != controllers.NOBODY or who.others != controllers.NATURALISTIC:
        raise InputError("Trees are made of natural tests; this run has other drivers.")
    if who.av != controllers.BUILT_IN and driver is BUILT_IN_TREES:
        raise InputError("Trees of an AV outside the simulator need a driver of its own.")
    decisions, chunk = setting.road.max_decisions, driver.chunk

    def rooms() -> tuple[Any, ...]:
        moments, noted = min(_MOST_MOMENTS, chunk * _MOMENTS_PER_TREE), min(_MOST_SAMPLES, chunk * _SAMPLES_PER_TREE)
        log = allocate_training_data(moments, noted) if learning else allocate_training_data(0, 0)
        terminal = allocate_terminal_states(chunk * _CRASHES_PER_TREE, slots, decisions)
        pool = allocate_pool(_ROWS if not plan.tilt.shares.size else 1, slots, decisions, driver.places, setting.road)
        return pool, terminal, log, allocate_scratch(slots, who.policy)

    lent = Rooms(rooms)

    def work(start: int, count: int) -> DrivenTrees:
        trees = np.zeros(count, dtype=TREE)
        with lent.lend() as (pool, terminal, log, scratch):
            terminal.used[:] = 0
            log.used[:] = 0
            population = Population(plan, setting, scratch, keep_nothing(slots), pool, terminal, log)
            with naming_tests(pool.worlds):
                noted = driver(seed, start, population, trees)
            warn_of_left_out(scratch)
            found = terminal.used[0]
            crashes, actions = terminal.crashes[:found].copy(), terminal.actions[:found].copy()
            rng = np.random.Generator(np.random.Philox(key=[seed, start]))
            table = _table(log, rng) if learning else None
        return DrivenTrees(trees, crashes, actions, noted.answers, table, 0.0, noted.asked, noted.strayed)

    parts: list[DrivenTrees] = []
    done, begun = 0, cpu_seconds()
    for part in in_order(work, first, tests, chunk=chunk, threads=threads):
        parts.append(part)
        done += part.trees.size
        if progress is not None:
            progress(done)
    return replace(_joined(parts), cpu_seconds=cpu_seconds() - begun)


def _table(log: TrainingData, rng: np.random.Generator) -> TrainingTable:
    """Pick samples of a log."""
    moments, used = log.moments[: log.used[0]], int(log.used[1])
    seen, followed = log.seen[:used], np.empty(used)
    add_what_followed(log, followed)
    chance = np.where(followed > 0.0, 1.0, np.clip(seen[:, -1], _LEAST_PICKED, 1.0))
    picked = rng.random(used) < chance
    test = np.repeat(moments["test"], moments["n"])
    return TrainingTable(seen[picked], followed[picked], 1.0 / chance[picked], test[picked])


def _joined(parts: list[DrivenTrees]) -> DrivenTrees:
    """Join parts."""
    tables = [part.training for part in parts if part.training is not None]
    whole = None
    if tables:
        names = ("seen", "followed", "weight", "test")
        whole = TrainingTable(*(np.concatenate([getattr(table, name) for table in tables]) for name in names))
    trees, crashes, actions = (np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS)
    answers = np.full((len(crashes), max(part.answers.shape[1] for part in parts), 2), np.nan)
    begin = 0
    for part in parts:
        answers[begin : begin + len(part.answers), : part.answers.shape[1]] = part.answers
        begin += len(part.answers)
    asked, strayed = sum(part.asked for part in parts), sum(part.strayed for part in parts)
    return DrivenTrees(trees, crashes, actions, answers, whole, 0.0, asked, strayed)
