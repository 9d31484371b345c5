"""In which crashes did the AV strike, and which could it have avoided by braking? Kernels, and a pool of threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge._jit import kernel
from cornerforge.sim.adversaries import ChoiceScratch, allocate_choice_scratch
from cornerforge.sim.braking import Braking, is_avoidable
from cornerforge.sim.drive import Decisions, Setting, allocate_decisions, drive_test, world_row
from cornerforge.sim.reach import Pairs, allocate_pairs
from cornerforge.sim.rewards import av_strikes
from cornerforge.sim.statistics import NOBODY, Census, Counts, allocate_counts
from cornerforge.sim.step import SUBSTEPS, allocate_recording
from cornerforge.sim.world import AV_CRASH, FRAME, N_VEHICLES, OUTCOME, SLOT_B, World, allocate_worlds

__all__ = ["forget_frames", "judge_crash", "judge_crashes", "judge_range"]

_CHUNK = 256


@kernel
def forget_frames(recording: NDArray[np.void], frames: int, slots: int) -> None:
    """Nobody is there in the first frames of a recording."""
    for f in range(min(frames, recording.shape[0])):
        for i in range(slots):
            recording[f, i].present = 0


@kernel
def judge_crash(w: World, recording: NDArray[np.void], setting: Setting, braking: Braking) -> tuple[bool, bool]:
    """Did the AV strike, and could it have avoided the crash by braking? Of a recorded test that ended in its crash."""
    last = w.info[FRAME]
    partner = w.info[SLOT_B]
    a = w.vehicles[0]
    b = w.vehicles[partner]
    strikes = av_strikes(a.x, a.y, a.speed, a.heading, b.x, b.y, b.speed, b.heading, setting.road)
    return strikes, is_avoidable(recording, w.info[N_VEHICLES], last, partner, setting.road, braking)


@kernel
def judge_range(
    seed: int, tests: NDArray[np.int64], setting: Setting, braking: Braking, worlds: World, pairs: Pairs,
    s: ChoiceScratch, recording: NDArray[np.void], decisions: Decisions, counts: Counts, census: Census,
    strikes: NDArray[np.bool_], avoidable: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Drive tests again that ended in a crash of the AV, and say of each whether the AV struck, and could have braked.

    Args:
        seed, tests, setting: Which tests, (n,); a test that ends otherwise gets False twice.
        braking: How the AV would have braked.
        worlds, pairs, s: Scratch, a batch of one world.
        recording: Room for one whole test, nobody there; left so.
        decisions, counts, census: Of size 0, scratch, and nobody.
        strikes, avoidable: The answers, (n,).
    """
    w = world_row(worlds, 0)
    for k in range(tests.size):
        drive_test(w, seed, tests[k], setting, pairs, s, recording, decisions, counts, census)
        strikes[k] = False
        avoidable[k] = False
        if w.info[OUTCOME] == AV_CRASH:
            strikes[k], avoidable[k] = judge_crash(w, recording, setting, braking)
        forget_frames(recording, w.info[FRAME] + 1, recording.shape[1])


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
        allocate_decisions(0, slots),
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
