"""Which crashes of a bulk simulation did the AV strike in, and which could it have avoided? In a thread pool."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.sim.adversaries import allocate_choice_scratch
from cornerforge.sim.braking import Braking
from cornerforge.sim.drive import Decisions, Setting, judge_range
from cornerforge.sim.statistics import NOBODY, allocate_counts
from cornerforge.sim.step import SUBSTEPS, allocate_pairs, allocate_recording
from cornerforge.sim.world import allocate_worlds

__all__ = ["judge_crashes"]

_CHUNK = 256


def _judge_chunk(
    setting: Setting, slots: int, seed: int, tests: NDArray[np.int64], braking: Braking
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    strikes, avoidable = np.zeros(tests.size, dtype=np.bool_), np.zeros(tests.size, dtype=np.bool_)
    judge_range(
        seed,
        tests,
        setting,
        braking,
        allocate_worlds(1, slots),
        allocate_pairs(slots),
        allocate_choice_scratch(setting.policy),
        allocate_recording(SUBSTEPS * setting.road.max_decisions + 1, slots),
        Decisions(np.zeros((0, slots), dtype=np.int8), np.zeros(0, dtype=np.int16), np.zeros(0)),
        allocate_counts(slots),
        NOBODY,
        strikes,
        avoidable,
    )
    return strikes, avoidable


def judge_crashes(
    setting: Setting, slots: int, *, seed: int, tests: list[int], braking: Braking, threads: int = 1
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Drive crashed tests again and judge each crash.

    Args:
        setting: The run.
        slots: Vehicle slots per world (`world.n_slots`).
        seed: Of the tests.
        tests: Numbers of tests that ended in a crash of the AV, n of them; one that did not gets False twice.
        braking: How the AV would have braked.
        threads: Pool size; does not change the result.

    Returns:
        Whether the AV's front took part in the first contact, and whether braking would have avoided the crash
        (`braking.is_avoidable`), bool (n,) each.

    Raises:
        InputError: `threads` is out of range.
    """
    check_integer("threads", threads, low=1, high=1024)
    numbers = np.array(tests, dtype=np.int64)
    chunks = [numbers[k : k + _CHUNK] for k in range(0, numbers.size, _CHUNK)] or [numbers]
    with ThreadPoolExecutor(threads) as pool:
        parts = list(pool.map(lambda chunk: _judge_chunk(setting, slots, seed, chunk, braking), chunks))
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
