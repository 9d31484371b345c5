"""Judgements of crashes: did the AV strike, and could it have avoided the crash by braking? Tests are driven again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.adversary.worlds.rewards import av_strikes
from cornerforge.counterfactual import Braking, is_avoidable
from cornerforge.execution import in_order
from cornerforge.recordings import Trajectories
from cornerforge.sim import (
    AV_CRASH,
    Keep,
    Recorder,
    Scratch,
    Setting,
    World,
    allocate_scratch,
    allocate_worlds,
    drive_test,
    forget_frames,
    keep_whole_test,
    warn_of_left_out,
    world_of,
)

__all__ = ["judge_crash", "judge_crashes", "judge_test"]

_CHUNK = 256


@kernel
def judge_crash(w: World, recording: NDArray[np.void], setting: Setting, braking: Braking) -> tuple[bool, bool]:
    """Judge a recorded test that ended in a crash of the AV: did it strike, could braking have avoided the crash?"""
    state = w.state[0]
    partner = state.slot_b
    strikes = av_strikes(w.vehicles, 0, partner)
    test = Trajectories(recording, w.vehicles, state.n_vehicles)
    return strikes, is_avoidable(test, state.frame, partner, setting.road, braking)


@kernel
def _judge_range(
    seed: int, tests: NDArray[np.int64], setting: Setting, braking: Braking, w: World, s: Scratch, keep: Keep,
    judged: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Drive tests again that ended in a crash of the AV, and judge each of them (`judge_crash`).

    Args:
        seed, tests, setting: The tests, (n,); a test that ends otherwise gets False twice.
        braking: How the AV would have braked.
        w, s: A world and scratch to drive in.
        keep: Holds one whole test; all vehicles absent before and after.
        judged: The answers, (n, 2).
    """
    for k in range(tests.size):
        drive_test(w, seed, tests[k], setting, s, keep)
        judged[k, 0] = False
        judged[k, 1] = False
        if w.state[0].outcome == AV_CRASH:
            judged[k, 0], judged[k, 1] = judge_crash(w, keep.recording, setting, braking)
        forget_frames(keep.recording, w.state[0].frame + 1, keep.recording.shape[1])


def _judge_chunk(
    setting: Setting, slots: int, seed: int, tests: NDArray[np.int64], braking: Braking
) -> NDArray[np.bool_]:
    judged = np.zeros((tests.size, 2), dtype=np.bool_)
    scratch = allocate_scratch(slots, setting.who.policy)
    _judge_range(
        seed,
        tests,
        setting,
        braking,
        world_of(allocate_worlds(1, slots)),
        scratch,
        keep_whole_test(setting, slots),
        judged,
    )
    warn_of_left_out(scratch)
    return judged


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
        (`counterfactual.is_avoidable`), bool (n,) each.

    Raises:
        InputError: `threads` is out of range.
    """
    numbers = np.array(tests, dtype=np.int64)

    def judge(first: int, count: int) -> NDArray[np.bool_]:
        return _judge_chunk(setting, slots, seed, numbers[first : first + count], braking)

    judged = np.zeros((numbers.size, 2), dtype=np.bool_)
    done = 0
    for part in in_order(judge, 0, numbers.size, chunk=_CHUNK, threads=threads):
        judged[done : done + len(part)] = part
        done += len(part)
    return judged[:, 0], judged[:, 1]


def judge_test(recorder: Recorder, setting: Setting, seed: int, test: int, braking: Braking) -> tuple[bool, bool]:
    """Record one test and judge its crash of the AV (`judge_crash`); twice False where it holds none.

    Returns:
        Whether the AV struck, and whether braking would have avoided the crash.
    """
    world, keep = recorder.drive(seed, test)
    if int(world.state["outcome"][0]) != AV_CRASH:
        return False, False
    strikes, avoidable = judge_crash(world, keep.recording, setting, braking)
    return bool(strikes), bool(avoidable)
