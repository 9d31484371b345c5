"""Tests of a foreign AV, driven once more with the answers that it gave: for recordings, and second by second."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge.foreign.session import Steps
from cornerforge.sim import SUBSTEPS, Recorder, World, lockstep, ordered_lane

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.foreign.driver import ForeignAv
    from cornerforge.sim import Setting
    from cornerforge.types import Odd

__all__ = ["ForeignRecorder", "ScriptedSeconds"]


class ForeignRecorder(Recorder):
    """Records tests of a foreign AV: it drives them once more with the answers that the AV gave.

    So the recording shows what happened, even if the AV would answer differently now.

    Args:
        av: The AV.
        setting, odd: As for `Recorder`.
    """

    def __init__(self, av: ForeignAv, setting: Setting, odd: Odd) -> None:
        super().__init__(setting, odd)
        self._av = av
        av.keep_scripts()

    def _drive(self, seed: int, test: int) -> None:
        slots = self._world.vehicles.size
        batch = batch_of(self._world)
        lockstep.begin(seed, np.zeros(1, dtype=np.int64), np.array([test], dtype=np.int64), self._setting, batch)
        steps = Steps(self._setting, slots, batch, self._keep)
        for answer in self._av.script(self._setting, slots, seed, test):
            steps.act(answer[None])


def batch_of(world: World) -> lockstep.Batch:
    """Make a batch of one world, as views."""
    slots = world.vehicles.size
    return lockstep.allocate_batch(1, slots)._replace(worlds=World._make(array[None] for array in world))


class ScriptedSeconds:
    """Drives a world by whole seconds with the answers that a foreign AV gave, for `rates.attention`.

    Args:
        av: The AV.
        slots: Vehicle slots per world.
    """

    def __init__(self, av: ForeignAv, slots: int) -> None:
        self._av, self._slots = av, slots

    def _answers(self, world: World, setting: Setting) -> NDArray[np.float64]:
        """Look up the AV's answers within the second that begins."""
        state = world.state[0]
        per_second = -(-SUBSTEPS // int(setting.road.av_substeps))
        begin = int(state["decisions"]) * per_second
        script = self._av.script(setting, self._slots, int(state["seed"]), int(state["test"]))
        return script[begin : begin + per_second]

    def av_lane(self, world: World, setting: Setting) -> int:
        """Find the target lane that the AV chooses at this moment, when the BVs decide."""
        order = self._answers(world, setting)[0, 1]
        return int(ordered_lane(world, 0, int(np.sign(order)), setting.road))

    def __call__(self, world: World, setting: Setting) -> None:
        """Advance a running world by one decision of the BVs."""
        steps = Steps(setting, self._slots, batch_of(world))
        for answer in self._answers(world, setting):
            steps.act(answer[None])
