"""Tests of a foreign AV, driven once more with the answers that it gave: for recordings, and second by second."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge.foreign.session import Steps, answers_per_second
from cornerforge.sim import Recorder, World, actions, controllers, lockstep, scripted, warn_of_left_out

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.foreign.driver import ForeignAv
    from cornerforge.sim import Script, Setting
    from cornerforge.types import Odd, Scenario

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
        self._answer(seed, test, self._setting, self._av.script(self._setting, slots, seed, test))

    def _answer(self, seed: int, test: int, setting: Setting, answers: NDArray[np.float64]) -> None:
        lockstep.drive_answered(self._world, seed, test, answers, self._av.steering(setting), self._scratch, self._keep)
        warn_of_left_out(self._scratch)

    def record_branch(self, script: Script, answers: NDArray[np.float64]) -> Scenario:
        """Record a branch of a test's tree: the test from its start on, with other actions of its BVs.

        Args:
            script: Its name, and the actions of all vehicles; after them BVs do what is likeliest.
            answers: Of the AV, (A, W).
        """
        actions = np.full((int(self._setting.road.max_decisions), script.slot.size), scripted.NATURAL, dtype=np.int8)
        actions[: len(script.action)] = script.action
        self._forget()
        setting = self._setting.with_drivers(others=controllers.SCRIPTED, script=actions)
        self._answer(script.seed, script.test, setting, answers)
        self._driven(script.seed, script.test)
        return self.scenario()


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
        per_second = answers_per_second(setting)
        begin = int(state["decisions"]) * per_second
        script = self._av.script(setting, self._slots, int(state["seed"]), int(state["test"]))
        return script[begin : begin + per_second]

    def av_lane(self, world: World, setting: Setting) -> int:
        """Find the target lane that the AV chooses at this moment, when the BVs decide."""
        if self._av.controller == controllers.STEERED:  # it chooses none
            return int(world.vehicles[0]["target_lane"])
        order = self._answers(world, setting)[0, 1]
        return int(actions.ordered_lane(world, 0, int(np.sign(order)), setting.road))

    def __call__(self, world: World, setting: Setting) -> None:
        """Advance a running world by one decision of the BVs."""
        batch = lockstep.allocate_batch(1, self._slots)._replace(worlds=World._make(array[None] for array in world))
        steps = Steps(self._av.steering(setting), self._slots, batch)
        for answer in self._answers(world, setting):
            steps.act(answer[None])
