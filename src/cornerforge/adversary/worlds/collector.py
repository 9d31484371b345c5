"""Worlds in which an adversary learns against a foreign AV: all go a second on, side by side, for each decision.

The worlds are in groups, each with an AV process of its own that has a seat for every world of the group; groups are
driven at the same time. A failure of the AV costs the tests in which it fails alone (`Group.ask`), never the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cornerforge.adversary.worlds import drive_bv_outside as outside
from cornerforge.adversary.worlds.drive_bv import allocate_history
from cornerforge.errors import AvFaultError
from cornerforge.foreign.driver import Fault, ForeignAv
from cornerforge.foreign.process import AvFailureError
from cornerforge.foreign.session import answers_per_second, seeds_of
from cornerforge.sim import World, allocate_scratch, allocate_worlds, keep_nothing, warn_of_left_out

if TYPE_CHECKING:
    from cornerforge.adversary.worlds.drive_bv import Actors, Exploring, Transitions
    from cornerforge.adversary.worlds.rewards import RewardNumbers
    from cornerforge.sim import Setting

__all__ = ["ForeignCollector", "Group"]

Answers: TypeAlias = "tuple[NDArray[np.float64], dict[int, AvFailureError]]"
"""Answers, and failures by seat, as of `AvSession.act`."""

_KINDS = ("raised", "answer", "hung", "ended", "left")
_MOST_TOGETHER = 3
"""So often in a row a question may fail for many worlds and then for none of them alone."""


class ForeignCollector:
    """Does for a foreign AV what `drive_bv.collect` does for a built-in one, to the same bits if the AVs are the same.

    Args:
        av: The AV.
        setting: The run, whose AV is OUTSIDE or STEERED and whose critical BV is TOLD.
        slots: Vehicle slots per world.
        actors: The worlds, allocated for that setting.
        threads: Groups of worlds that are driven at the same time; does not change the result.
    """

    def __init__(self, av: ForeignAv, setting: Setting, slots: int, actors: Actors, threads: int) -> None:
        self._av, self._actors = av, actors
        worlds = len(actors.allowed)
        size = av.group_size(worlds, threads)
        self._groups = [
            Group(av, setting, slots, actors, np.arange(first, min(first + size, worlds)), size)
            for first in range(0, worlds, size)
        ]
        self._pool = ThreadPoolExecutor(av.spec.processes or threads)

    def warm_up(self, exploring: Exploring, reward: RewardNumbers, out: Transitions) -> None:
        """Load the kernels that `collect` calls, or compile them; moves nobody."""
        self._groups[0].warm_up(exploring, reward, out)

    def collect(self, exploring: Exploring, reward: RewardNumbers, out: Transitions) -> None:
        """Drive all worlds for one decision, as `drive_bv.collect` does.

        Raises:
            AvFaultError: The AV failed in too many tests.
        """
        for _ in self._pool.map(lambda group: group.go_on(exploring, reward, out), self._groups):
            pass
        total = self._actors.finished.view(np.int64)
        for group in self._groups:
            own = group.finished.view(np.int64)
            total += own
            own[:] = 0
        self._av.note_driven(int(out.end.sum()))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Answers in tests that go on, and the tests in which the AV failed: all beside the worlds, by name."""
        history = self._actors.history
        faults = [(test, _KINDS.index(fault.what)) for (_, test), fault in self._av.faults.items()]
        return {
            "answers": history.answers[:, : int(history.answered.max())],
            "answered": history.answered,
            "faults": np.array(faults, dtype=np.int64).reshape(-1, 2),
        }

    def restore(self, seed: int, saved: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` gave; the worlds are restored already. The AV will be shown again what it saw."""
        history = self._actors.history
        history.answers[:, : saved["answers"].shape[1]] = saved["answers"]
        history.answered[:] = saved["answered"]
        for test, kind in saved["faults"].tolist():
            self._av.faults[seed, test] = Fault(
                test, _KINDS[kind], f"failed ({_KINDS[kind]}) before the training stopped"
            )
        for group in self._groups:
            group.is_in_step = False

    def close(self) -> None:
        """End the AV's processes."""
        self._pool.shutdown()
        for group in self._groups:
            group.close()


class Group:
    """Some of the worlds, with an AV process of their own.

    Args:
        av: The AV.
        setting: The run, whose AV is OUTSIDE or STEERED and whose critical BV is TOLD.
        slots: Vehicle slots per world.
        actors: All the worlds.
        rows: Those of this group.
        seats: Worlds that the AV drives side by side, at least as many.

    Attributes:
        finished: Counts of tests that ended, as in `Actors`.
        is_in_step: The AV in the process saw all that it must have seen by now.
    """

    def __init__(
        self, av: ForeignAv, setting: Setting, slots: int, actors: Actors, rows: NDArray[np.int64], seats: int
    ) -> None:
        self._av, self._setting, self._slots, self._rows = av, setting, slots, rows
        own = allocate_history(1, setting, slots)
        self.finished = np.zeros_like(actors.finished)
        self._actors = actors._replace(
            history=actors.history._replace(world=own.world, keep=own.keep), finished=self.finished
        )
        self._session = av.new_session(seats)
        self._views = self._session.views(seats, slots)
        self._scratch, self._keep = allocate_scratch(slots, setting.who.policy), keep_nothing(slots)
        self._again: World | None = None
        self.is_in_step = True

    def close(self) -> None:
        """End the AV's process."""
        self._session.drop()

    def warm_up(self, exploring: Exploring, reward: RewardNumbers, out: Transitions) -> None:
        """Load all kernels; moves nobody."""
        none = np.zeros(0, dtype=np.int64)
        setting, actors, s = self._setting, self._actors, self._scratch
        again = allocate_worlds(1, self._slots, setting.road)
        outside.begin_seconds(none, exploring, actors, s, out)
        outside.look(none, none, actors.worlds, setting, s, self._views)
        outside.go_on(none, none, np.zeros((0, setting.answer_width)), actors, setting, s, self._keep)
        outside.end_seconds(none, exploring, setting, reward, actors, s, self._keep, out)
        outside.begin_to_steer(none, exploring, setting, s, self._keep, actors)
        outside.look_back(none, none, actors, setting, again)
        outside.go_on_again(none, none, none, actors, setting, s, self._keep, again)

    def go_on(self, exploring: Exploring, reward: RewardNumbers, out: Transitions) -> None:
        """Drive the worlds for one decision; their transitions go into their rows of `out`.

        Raises:
            AvFaultError: The AV failed in too many tests.
        """
        rows, setting, actors = self._rows, self._setting, self._actors
        while (seats := outside.early(rows, actors)).size:
            self.drive_second(seats)
            outside.begin_to_steer(rows, exploring, setting, self._scratch, self._keep, actors)
        outside.begin_seconds(rows, exploring, actors, self._scratch, out)
        self.drive_second(outside.running(rows, actors))
        outside.end_seconds(rows, exploring, setting, reward, actors, self._scratch, self._keep, out)
        warn_of_left_out(self._scratch)

    def drive_second(self, seats: NDArray[np.int64]) -> None:
        """Drive the worlds of some seats, whose critical BVs have answered, to the end of their second or test.

        Other worlds in which a test runs stand still; an AV that remembers is shown their past again before they go on.

        Raises:
            AvFaultError: The AV failed in too many tests.
        """
        rows, setting, actors = self._rows, self._setting, self._actors
        everybody = seats.size == outside.running(rows, actors).size
        for _ in range(answers_per_second(setting)):
            seats, answers = self.ask(seats)
            if seats.size == 0:
                break
            outside.go_on(rows, seats, answers, actors, setting, self._scratch, self._keep)
            seats = np.intersect1d(seats, outside.running(rows, actors), assume_unique=True)
        if not everybody:
            self.is_in_step = False

    def ask(self, seats: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Ask the AV what it does now in the worlds of some seats, and give up tests in which it fails.

        Returns:
            The seats whose tests go on, and the AV's answers, a row for each seat of the group.

        Raises:
            AvFaultError: The AV failed in too many tests, or again and again without failing in one test alone.
        """
        together = 0
        while seats.size:
            try:
                answers, failed = self._answers_for(seats)
            except AvFailureError as failure:
                self._session.renew()
                failing = self._failing_alone(seats)
                seats = self._give_up(seats, failing)
                together = 0 if failing else together + 1
                if together == _MOST_TOGETHER:
                    raise AvFaultError(
                        f"The AV {self._av.name} {failure}, {together} times in a row for {seats.size} worlds together "
                        f"and for none alone. Correct the AV; to look closer: {self._av.closer()}"
                    ) from failure
                continue
            return self._give_up(seats, failed), answers
        return seats, np.zeros((len(self._views), self._setting.answer_width))

    def _answers_for(self, seats: NDArray[np.int64]) -> Answers:
        """Ask the AV once; first show it what it should have seen, if it did not."""
        if not self.is_in_step:
            self._session.ask_once()  # the first answer has more time, which a hang must not get
            if self._session.remembers:
                self._show_again(seats)
        rows, worlds = self._rows, self._actors.worlds
        outside.look(rows, seats, worlds, self._setting, self._scratch, self._views)
        answers = self._act(seats, seats[self._actors.history.answered[rows[seats]] == 0])
        self.is_in_step = True
        return answers

    def _act(self, seats: NDArray[np.int64], fresh: NDArray[np.int64]) -> Answers:
        """Show the views of seats to the AV; in `fresh` ones a test begins."""
        state = self._actors.worlds.state[self._rows[fresh], 0]
        seeds = seeds_of(int(state["seed"][0]), state["test"]) if fresh.size else fresh
        return self._session.act(self._views, seats, fresh, seeds)

    def _show_again(self, seats: NDArray[np.int64]) -> None:
        """Show the AV again what it saw in the tests of some seats before now; its answers of then are carried out.

        The tests are driven again from their starts, each beginning late enough that all arrive at the present
        together: no seat is shown nothing between its test's start and now.
        """
        if self._again is None:
            self._again = allocate_worlds(self._rows.size, self._slots, self._setting.road)
        rows, setting, actors, again = self._rows, self._setting, self._actors, self._again
        own = np.arange(self._rows.size)
        past = actors.history.answered[rows[seats]]
        longest = int(past.max())
        for step in range(longest):
            moments = step - (longest - past)
            shown, fresh = seats[moments >= 0], seats[moments == 0]
            outside.look_back(rows, fresh, actors, setting, again)
            outside.look(own, shown, again, setting, self._scratch, self._views)
            self._act(shown, fresh)
            outside.go_on_again(rows, shown, moments[moments >= 0], actors, setting, self._scratch, self._keep, again)

    def _failing_alone(self, seats: NDArray[np.int64]) -> dict[int, AvFailureError]:
        """Find the seats in whose tests a new AV fails at this question though it drives nothing else, by halving."""
        found: dict[int, AvFailureError] = {}
        for half in np.array_split(seats, 2):
            self.is_in_step = False
            try:
                if half.size:
                    self._answers_for(half)
            except AvFailureError as failure:
                self._session.renew()
                if half.size == 1:
                    found[int(half[0])] = failure
                else:
                    found |= self._failing_alone(half)
        self.is_in_step = False
        return found

    def _give_up(self, seats: NDArray[np.int64], failing: Mapping[int, AvFailureError]) -> NDArray[np.int64]:
        """Abandon the tests of some of the seats; returns the other ones."""
        if not failing:
            return seats
        for seat, failure in failing.items():
            state = self._actors.worlds.state[self._rows[seat], 0]
            self._av.note(int(state["seed"]), Fault(int(state["test"]), failure.what, str(failure)))
        gone = np.array(list(failing), dtype=np.int64)
        outside.abandon(self._rows[gone], self._actors)
        return np.setdiff1d(seats, gone, assume_unique=True)
