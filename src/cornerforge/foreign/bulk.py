"""Tests in a row driven by an AV from outside: in lockstep, and faults are traced to single tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cornerforge.foreign.pace import announce
from cornerforge.foreign.process import AvFailureError
from cornerforge.foreign.session import answers_per_second, seeds_of
from cornerforge.sim import (
    allocate_scratch,
    keep_nothing,
    lockstep,
    naming_tests,
    outcome,
    statistics,
    warn_of_left_out,
    world_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cornerforge.foreign.driver import ForeignAv
    from cornerforge.foreign.session import AvSession
    from cornerforge.sim import Setting

__all__ = ["Fault", "RangeOfTests"]


@dataclass(frozen=True)
class Fault:
    """A test that does not count, because the AV failed in it.

    Attributes:
        test: Number of the test.
        what: "raised", "answer" (it was not usable), "left" (the AV left the road), "hung" or "ended" (the AV's process
            did).
        message: Rest of a sentence that begins with the AV's name.
    """

    test: int
    what: str
    message: str


class RangeOfTests:
    """Tests first .. first + count - 1 of a seed, as many side by side as the AV's batch holds.

    A failure of the AV for a whole batch costs no test in which the AV does not fail alone: tests are driven again in
    ever smaller groups.

    Args:
        av, session: The AV, where a test in which it fails is noted; a process of it.
        setting, slots: The run, whose AV is OUTSIDE or STEERED; vehicle slots per world.
        seed, first, count: The tests.
        census: What is counted.

    Attributes:
        outcomes: One entry per test; AV_FAULT for one that does not count.
    """

    def __init__(
        self, av: ForeignAv, session: AvSession, setting: Setting, slots: int, seed: int, first: int, count: int,
        census: statistics.Census,
    ) -> None:  # fmt: skip
        self._av, self._session, self._setting, self._slots = av, session, setting, slots
        self._seed, self._first, self._census = seed, first, census
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self.outcomes = outcome.allocate_outcomes(count)

    def drive(self) -> statistics.Counts:
        """Drive all tests; returns what was counted.

        Raises:
            AvFaultError: There are too many faults.
        """
        count, total = self.outcomes.code.size, statistics.allocate_counts()
        groups = [list(range(self._first, self._first + count))] if count else []
        while groups:
            counts = statistics.allocate_counts()
            again = self._drive(groups.pop(), counts)
            if again is not None:
                groups += filter(None, again)
            elif self._census.on:
                total.add(counts)
        return total

    def _drive(self, group: list[int], counts: statistics.Counts) -> list[list[int]] | None:
        """Drive a group of tests from start to end.

        Returns:
            None: all were driven, and counted. Else groups to drive next, because the AV failed; where traffic is
            counted, `counts` then hold what must not count.
        """
        av, session, setting, scratch, seed = self._av, self._session, self._setting, self._scratch, self._seed
        is_fresh = session.is_fresh
        batch = session.batch(self._slots)
        size = batch.views.shape[0]
        keep = keep_nothing(self._slots, counts=counts, census=self._census)
        done = np.zeros(size, dtype=np.int64)
        tests = np.array(group, dtype=np.int64)
        driven = batch.worlds.state["test"][:, 0]  # a view
        most = int(setting.road.max_decisions) * answers_per_second(setting)
        log = np.zeros((size, most, setting.answer_width)) if av.keeps_scripts else None
        answered = np.zeros(size, dtype=np.int64)
        begun = 0
        finished: set[int] = set()
        while True:
            fresh = lockstep.idle(batch)[: tests.size - begun]
            if fresh.size:
                with naming_tests(batch.worlds):
                    lockstep.begin(seed, fresh, tests[begun : begun + fresh.size], setting, batch)
                answered[fresh] = 0
                begun += fresh.size
            driving = lockstep.running(batch)
            if driving.size == 0:
                return None
            lockstep.see(batch, setting, scratch)
            try:
                answers, failed = session.act(batch.views, driving, fresh, seeds_of(seed, driven[fresh]))
            except AvFailureError as failure:
                return self._narrow(failure, group, sorted(driven[driving].tolist()), finished, is_fresh=is_fresh)
            if failed:
                spoiled = {int(driven[b]): failure for b, failure in failed.items()}
                if self._census.on:  # the whole group begins anew without those that fail in one way
                    one = next(iter(spoiled.values()))
                    spoiled = {test: failure for test, failure in spoiled.items() if str(failure) == str(one)}
                self._note(spoiled)
                if self._census.on:
                    return [[test for test in group if test not in spoiled]]
                finished |= set(spoiled)
                lockstep.stop(batch, np.array(list(failed), dtype=np.int64))
                if driving.size == len(failed):
                    continue
            if log is not None:
                log[driving, answered[driving]] = answers[driving]
                answered[driving] += 1
            ended = done[: lockstep.act(answers, False, setting, batch, scratch, keep, done)]
            warn_of_left_out(scratch)
            finished |= set(driven[ended].tolist())
            for b in ended.tolist():
                outcome.write_outcome(
                    world_of(batch.worlds, b), self.outcomes, int(driven[b]) - self._first, setting.road
                )
                if log is not None and batch.worlds.state["outcome"][b, 0] == outcome.AV_CRASH:
                    av.keep_script(seed, int(driven[b]), log[b, : answered[b]].copy())

    def _narrow(
        self, failure: AvFailureError, group: list[int], suspects: list[int], finished: set[int], *, is_fresh: bool
    ) -> list[list[int]]:
        """Note a fault if it is certain, and return the groups of tests to drive next, the last one first."""
        if len(group) == 1 and not is_fresh:  # what was before may be to blame
            self._session.drop()
            return [group]
        self._session.renew()
        if len(group) == 1:
            self._note({group[0]: failure})
            return []
        gone = set(suspects) if self._census.on else {*suspects, *finished}
        left = [test for test in group if test not in gone]
        if failure.what != "hung" and len(suspects) > 1:
            half = (len(suspects) + 1) // 2
            return [left, suspects[half:], suspects[:half]]
        if failure.what == "hung":  # a hang costs the whole time limit: look once at each
            self._av.pace.allow_more(len(suspects))
            announce(
                f"The AV {self._av.name} {failure}; these tests are driven again one by one. If it is slow and not "
                f"hung: --av-batch below {len(suspects)}, or a longer --av-timeout."
            )
        return [left, *([test] for test in reversed(suspects))]

    def _note(self, spoiled: Mapping[int, AvFailureError]) -> None:
        """Note faults by test; the tests do not count."""
        for test in sorted(spoiled):
            for column in self.outcomes:
                column[test - self._first] = 0
            self.outcomes.code[test - self._first] = outcome.AV_FAULT
            self._av.note(self._seed, Fault(test, spoiled[test].what, str(spoiled[test])))
