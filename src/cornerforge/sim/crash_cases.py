"""Crashes of a learner's worlds as cases, the same that a library would hold of them, for judges outside the kernels.

A reward that needs more than a kernel knows of a crash (`rewards.Reward.by_case`) is given by whoever judges stored
cases: so the same crash has the same verdict in training, in an environment and in an analysis.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.fields import REALS, SERIES
from cornerforge.recordings import BODY_FIELDS, Recordings, recordings_of_columns
from cornerforge.sim.drive_bv import History, drive_again
from cornerforge.sim.harvest import CASES_KEPT, allocate_harvest, is_full, keep_driven
from cornerforge.sim.keep import keep_whole_test
from cornerforge.sim.scratch import allocate_scratch, warn_of_left_out
from cornerforge.sim.step import forget_frames
from cornerforge.sim.world import World, allocate_worlds, world_of, world_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.harvest import Harvest
    from cornerforge.sim.keep import Keep
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting

__all__ = ["CrashCases", "Verdict", "recordings_of_harvest"]

Verdict = Callable[[Recordings], "NDArray[np.bool_]"]
"""Says of each of C recorded crashes whether it is paid for, bool (C,)."""
_ROOM = 64
"""Number of cases that are judged together."""


def recordings_of_harvest(h: Harvest) -> Recordings:
    """Take the motion of all cases of a harvest, at least one, as a library that stores them gives it back.

    The arrays are those of the harvest: judge before it is filled again.
    """
    rows = h.rows[: h.n_cases]
    frames, vehicles = rows["n_frames"].astype(np.int64), rows["n_kept"].astype(np.int64)
    size, stored = int(vehicles.sum()), int((frames * vehicles).sum())
    bodies = np.zeros(size, dtype=BODY_FIELDS)
    for name in BODY_FIELDS.names or ():
        bodies[name] = getattr(h, name)[:size]
    reals = dict(zip(REALS, h.reals, strict=True))
    return recordings_of_columns(
        names=np.stack([rows["seed"], rows["test"]], axis=1),
        frames=frames,
        vehicles=vehicles,
        last=frames - 1,
        slot=h.slot[:size],
        bv_slot=rows["bv_slot"].astype(np.int64),
        bodies=bodies,
        states={one.name: (reals[one.name] if one.name in reals else getattr(h, one.name))[:stored] for one in SERIES},
    )


class _Room(NamedTuple):
    """A world and scratch to drive in."""

    again: World
    scratch: Scratch


@kernel
def _keep_crashes(
    first: int, worlds: World, history: History, setting: Setting, room: _Room, keep: Keep, h: Harvest,
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
        h: The columns to append to.
        kept: Receives the world of each case.

    Returns:
        The first world that was not looked at.
    """
    recording, again, s = keep.recording, room.again, room.scratch
    for b in range(first, history.crashed.size):
        if history.crashed[b] < 0:
            continue
        if is_full(h, recording.shape[0], recording.shape[1]):
            return b
        drive_again(history, b, world_row(worlds, b).state[0].seed, history.crashed[b], again, setting, s, keep)
        kept[h.filled[CASES_KEPT]] = b
        keep_driven(again, setting, keep, h)
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
        self._room = _Room(world_of(allocate_worlds(1, slots)), allocate_scratch(slots, setting.who.policy))
        self._keep = keep_whole_test(setting, slots)
        self._harvest = allocate_harvest(_ROOM, slots, setting.road.max_decisions)
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
            verdict = self._verdict(recordings_of_harvest(self._harvest))
            paid.append(self._kept[: verdict.size][verdict])
        warn_of_left_out(self._room.scratch)
        history.crashed[:] = -1
        return np.concatenate(paid) if paid else np.empty(0, dtype=np.int64)
