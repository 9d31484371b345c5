"""Crashes of a learner's worlds as cases, the same that a library would hold of them, for judges outside the kernels.

A reward that needs more than a kernel knows of a crash (`rewards.Reward.by_case`) is given by whoever judges stored
cases: so the same crash has the same verdict in training, in an environment and in an analysis.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.adversary.worlds.drive_bv import History, drive_again
from cornerforge.recordings import Recordings
from cornerforge.sim import (
    World,
    allocate_scratch,
    allocate_worlds,
    forget_frames,
    harvest,
    keep_whole_test,
    warn_of_left_out,
    world_of,
    world_row,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim import Keep, Scratch, Setting, harvest

__all__ = ["CrashCases", "Verdict"]

Verdict = Callable[[Recordings], "NDArray[np.bool_]"]
"""Says of each of C recorded crashes whether it is paid for, bool (C,)."""
_ROOM = 64
"""Number of cases that are judged together."""


class _Room(NamedTuple):
    """A world and scratch to drive in."""

    again: World
    scratch: Scratch


@kernel
def _keep_crashes(
    first: int, worlds: World, history: History, setting: Setting, room: _Room, keep: Keep, h: harvest.Harvest,
    kept: NDArray[np.int64],
) -> int:  # fmt: skip
    """Append the crashes of worlds first, first + 1, ... as cases until there is no more room.

    Args:
        first: The first world.
        worlds: Their seeds are read.
        history: What they did; `crashed` says which tests.
        setting: The run, whose critical BV is TOLD.
        room: To drive in.
        keep: Keeps one whole test; all vehicles are absent before and after.
        h: The columns to append to, without a case yet.
        kept: Receives the world of each case.

    Returns:
        The first world that was not looked at.
    """
    recording, again, s = keep.recording, room.again, room.scratch
    n = 0
    for b in range(first, history.crashed.size):
        if history.crashed[b] < 0:
            continue
        if harvest.is_full(h, recording.shape[0], recording.shape[1]):
            return b
        drive_again(history, b, world_row(worlds, b).state[0].seed, history.crashed[b], again, setting, s, keep)
        kept[n] = b
        n += 1
        harvest.keep_driven(again, setting, keep, h)
        forget_frames(recording, again.state[0].frame + 1, again.vehicles.size)
    return history.crashed.size


class CrashCases:
    """Has the crashes of many worlds judged; serves one thread.

    Args:
        setting: The run, whose critical BV is TOLD.
        slots: Vehicle slots per world.
        verdict: The judge.
    """

    def __init__(self, setting: Setting, slots: int, verdict: Verdict) -> None:
        self._setting, self._verdict = setting, verdict
        self._room = _Room(
            world_of(allocate_worlds(1, slots, setting.road)),
            allocate_scratch(slots, setting.who.policy),
        )
        self._keep = keep_whole_test(setting, slots)
        self._harvest = harvest.allocate_harvest(_ROOM, slots, setting.road.max_decisions)
        self._kept = np.zeros(self._harvest.rows.size, dtype=np.int64)

    def judge(self, worlds: World, history: History) -> NDArray[np.int64]:
        """Judge the crashes that `history` notes, and forget them.

        Nothing may have been decided in these worlds since their tests ended; the next tests may have begun.

        Args:
            worlds: The worlds.
            history: What they did.

        Returns:
            The worlds whose crashes are paid for, ascending.
        """
        paid = []
        first = 0 if (history.crashed >= 0).any() else history.crashed.size
        while first < history.crashed.size:
            self._harvest.clear()
            first = _keep_crashes(
                first, worlds, history, self._setting, self._room, self._keep, self._harvest, self._kept
            )
            verdict = self._verdict(self._harvest.recordings())
            paid.append(self._kept[: verdict.size][verdict])
        warn_of_left_out(self._room.scratch)
        history.crashed[:] = -1
        return np.concatenate(paid) if paid else np.empty(0, dtype=np.int64)
