"""Trees of tests for a foreign AV: worlds are copied, and the AV is shown again what it has seen in a copied world.

A world can be copied (`splitting`), an AV in another process cannot. But what it answers depends on its test's seed and
on what it saw since `reset` alone (`foreign.interface`). So a copy of the AV is made by showing to a row of its batch,
from the reset on, what it saw in the world that was copied. An AV without `reset` remembers nothing and is spared this.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import AvFaultError
from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.process import AvFailureError
from cornerforge.foreign.session import AvSession, seeds_of
from cornerforge.rates.branching import schedule
from cornerforge.rates.branching.drive import TreeDriver, Watched
from cornerforge.rates.branching.population import Population
from cornerforge.work import is_given_up

__all__ = ["ForeignTrees"]

_NOTHING = -1
_PLACES = 64


class _Past:
    """Record of what the AV saw and answered, moment by moment; each moment knows the one before it."""

    def __init__(self, views: NDArray[Any], width: int, room: int = 4096) -> None:
        self.view = np.zeros((room, *views.shape[1:]), dtype=views.dtype)
        self.answer = np.zeros((room, width))
        self.before = np.zeros(room, dtype=np.int64)
        self._place = np.full(room, _NOTHING)
        self._free = list(range(room))

    def add(
        self, views: NDArray[Any], answers: NDArray[np.float64], before: NDArray[np.int64],
        places: NDArray[np.int64],
    ) -> NDArray[np.int64]:  # fmt: skip
        """Note moments of trees at some places; returns their numbers."""
        n = len(answers)
        while len(self._free) < n:
            old = self.before.size
            self.view, self.answer, self.before, self._place = (
                np.concatenate([array, np.zeros_like(array)])
                for array in (self.view, self.answer, self.before, self._place)
            )
            self._place[old:] = _NOTHING
            self._free += range(old, 2 * old)
        new = np.array(self._free[-n:], dtype=np.int64)
        del self._free[-n:]
        self.view[new], self.answer[new], self.before[new], self._place[new] = views, answers, before, places
        return new

    def path_to(self, moment: int) -> list[int]:
        """List the moments of a world's past, the first one first."""
        path = []
        while moment != _NOTHING:
            path.append(moment)
            moment = int(self.before[moment])
        return path[::-1]

    def forget(self, places: NDArray[np.int64]) -> NDArray[np.int64]:
        """Forget the trees at some places; return the forgotten moments, because their numbers will be used again."""
        gone = np.flatnonzero(np.isin(self._place, places))
        self._place[gone] = _NOTHING
        self._free += gone.tolist()
        return gone


@dataclass
class _Seats:
    """Rows of the AV's batch: which world sits there, what the AV remembers there, and what it must be shown first.

    Attributes:
        row: Row of the world, -1 for none, (B,).
        memory: The moment up to which the AV remembers, -1 for none or unknown, (B,).
        fresh: It must be reset before the next question, (B,).
        replay: Past moments that it must be shown before it goes on, by seat.
        free: Seats without a world, by the time since when.
    """

    row: NDArray[np.int64]
    memory: NDArray[np.int64]
    fresh: NDArray[np.bool_]
    replay: dict[int, list[int]] = field(default_factory=dict)
    free: OrderedDict[int, None] = field(default_factory=OrderedDict)

    def take(self, row: int, memory: int, past: _Past, *, remembers: bool) -> None:
        """Give a world a seat, the one where the AV remembers its past if there is one; one must be free."""
        known = np.flatnonzero(self.memory == memory) if remembers and memory != _NOTHING else ()
        seat = next((int(s) for s in known if int(s) in self.free), None)
        if seat is None:
            seat = next(iter(self.free))
            self.fresh[seat] = remembers
            if remembers and memory != _NOTHING:
                self.replay[seat] = past.path_to(memory)
        del self.free[seat]
        self.row[seat], self.memory[seat] = row, memory

    def leave(self, seats: NDArray[np.int64]) -> None:
        """Free seats."""
        self.row[seats] = _NOTHING
        self.free.update(dict.fromkeys(seats.tolist()))


class ForeignTrees(TreeDriver):
    """Drives the trees of a foreign AV.

    Args:
        av: The AV.
        places: Trees that are driven side by side; more than 64 take much memory, unless each is one
            world, without copies.
    """

    chunk = 8000

    def __init__(self, av: ForeignAv, places: int = _PLACES) -> None:
        self._av, self.places = av, places

    def __call__(self, seed: int, first: int, population: Population, trees: NDArray[np.void]) -> Watched:
        """Drive the trees of tests first, first + 1, ..., one for each of `trees`.

        Raises:
            AvFaultError: The AV fails.
        """
        population = population._replace(setting=self._av.steering(population.setting))
        with self._av.lend_session() as session:
            return _Driving(self._av, session, seed, first, population, trees).drive()


class _Driving:
    """A range of trees that is being driven."""

    def __init__(
        self, av: ForeignAv, session: AvSession, seed: int, first: int, population: Population, trees: NDArray[np.void]
    ) -> None:
        self._av, self._session, self._seed, self._first = av, session, seed, first
        self._population, self._trees = population, trees
        pool = population.pool
        self._schedule = schedule.allocate_schedule(pool.top.size, pool.depth)
        size = session.batch_size
        self._views = session.views(size, pool.worlds.vehicles.shape[1])
        self._width = population.setting.answer_width
        self._past = _Past(self._views, self._width)
        none = np.full(size, _NOTHING)
        self._seats = _Seats(none, none.copy(), np.zeros(size, dtype=np.bool_))
        self._seats.free.update(dict.fromkeys(range(size)))
        self._answers: list[NDArray[np.float64]] = []
        self._asked = self._strayed = 0

    def drive(self) -> Watched:
        started, free = 0, np.arange(self._schedule.tree.size)
        while not is_given_up():
            now = free[: self._trees.size - started]
            if now.size:
                schedule.start_trees(
                    now, self._seed, self._first, started, self._population, self._schedule, self._trees
                )
                started += now.size
                free = free[now.size :]
            waiting, ready = schedule.branch_out_all(self._population, self._schedule, self._trees)
            self._note_crashes()
            done = self._schedule.ready[:ready].copy()
            if ready:
                gone = self._past.forget(done)
                self._seats.memory[np.isin(self._seats.memory, gone)] = _NOTHING
                free = np.concatenate([free, done])
            self._seat(waiting)
            if (self._seats.row != _NOTHING).any():
                self._ask()
            elif started == self._trees.size and waiting == 0:
                break
        most = max((len(answers) for answers in self._answers), default=0)
        answers = np.full((len(self._answers), most, self._width), np.nan)
        for k, own in enumerate(self._answers):
            answers[k, : len(own)] = own
        return Watched(answers, self._asked, self._strayed)

    def _note_crashes(self) -> None:
        """Note the answers that led to each new crash."""
        terminal = self._population.terminal
        for k in range(len(self._answers), int(terminal.used[0])):
            self._answers.append(self._past.answer[self._past.path_to(int(terminal.crashes["memory"][k]))])

    def _seat(self, waiting: int) -> None:
        """Give free seats to worlds that wait, those first that their trees need first."""
        room = len(self._seats.free)
        if waiting == 0 or room == 0:
            return
        order = np.argsort(self._schedule.ranks[:waiting], kind="stable")[:room]
        remembers = self._session.remembers
        for row in self._schedule.rows[:waiting][order].tolist():
            self._seats.take(row, int(self._population.pool.memory[row]), self._past, remembers=remembers)
            self._schedule.moves[row] = 1

    def _ask(self) -> None:
        """Ask the AV once, about worlds where they are and about what copies of it must be shown."""
        seats = self._seats
        asked = live = np.flatnonzero(seats.row != _NOTHING)
        shown = np.array(sorted(seats.replay), dtype=np.int64)
        if shown.size:
            live = np.setdiff1d(asked, shown, assume_unique=True)
        moments = np.array([seats.replay[seat][0] for seat in shown.tolist()], dtype=np.int64)
        rows = seats.row[live]
        schedule.look(rows, live, self._population, self._views)
        self._views[shown] = self._past.view[moments]
        fresh = np.flatnonzero(seats.fresh)
        seats.fresh[fresh] = False
        tests = self._population.pool.worlds.state["test"][:, 0]
        try:
            answers, failed = self._session.act(self._views, live, fresh, seeds_of(self._seed, tests[seats.row[fresh]]))
        except AvFailureError as failure:
            self._session.renew()
            raise self._fault(f"in one of the tests {_some(tests[seats.row[asked]])} it {failure}", "") from failure
        for seat, how in failed.items():
            raise self._fault(f"in test {tests[seats.row[seat]]} it {how}", str(how))
        seats.memory[seats.row == _NOTHING] = _NOTHING  # the AV was shown zeros there
        if shown.size:
            self._go_over(shown, moments, answers)
        if live.size:
            self._go_on(live, rows, answers)

    def _go_over(self, shown: NDArray[np.int64], moments: NDArray[np.int64], answers: NDArray[np.float64]) -> None:
        """Note that the AV was shown past moments again."""
        self._asked += shown.size
        self._strayed += int((answers[shown] != self._past.answer[moments]).any(axis=1).sum())
        for seat in shown.tolist():
            self._seats.replay[seat].pop(0)
            if not self._seats.replay[seat]:
                del self._seats.replay[seat]

    def _go_on(self, live: NDArray[np.int64], rows: NDArray[np.int64], answers: NDArray[np.float64]) -> None:
        """Drive worlds on with the AV's answers."""
        self._asked += live.size
        pool, seats = self._population.pool, self._seats
        own = np.ascontiguousarray(answers[live])
        places = rows // pool.depth
        moments = self._past.add(self._views[live], own, pool.memory[rows], places)
        pool.memory[rows] = moments
        seats.memory[live] = moments
        driven = np.zeros(rows.size, dtype=np.bool_)
        schedule.answer(rows, own, self._population, self._schedule, driven)
        gone = live[driven]
        self._views[gone] = 0.0
        seats.leave(gone)

    def _fault(self, what: str, how: str) -> AvFaultError:
        error = AvFaultError(
            f"The AV {self._av.name} failed while trees of tests were driven: {what}. Count with --method mc, which "
            f"sets these tests aside, or correct the AV; to look closer: {self._av.closer()}"
        )
        return self._av.explained(error, how)


def _some(tests: NDArray[np.int64]) -> str:
    """Name a few tests."""
    names = [str(test) for test in np.unique(tests)[:3]]
    return ", ".join(names) + (", ..." if np.unique(tests).size > 3 else "")
