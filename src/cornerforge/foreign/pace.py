"""How long an AV from outside takes for an answer, and what follows: worlds in a call, time limits, estimates.

Nothing here changes a result: an answer does not depend on how many worlds are asked about together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["MOST_WORLDS", "Pace", "announce", "announced", "choose_batch"]

MOST_WORLDS = 256
"""Worlds in a call at most, unless the user says more."""
CALL_SECONDS = 1.0
"""A call for many worlds should take no longer than about this [s]."""
_LIMIT_FACTOR = 3.0
"""A call may take its usual time so many times, and the time limit of one answer on top."""
_WEIGHT = 0.1
"""Weight of a new call in the usual time."""
_OWN_SECONDS = 3e-4
"""What a call costs the simulator, whatever the number of worlds [s]."""
_WORLD_SECONDS = 5e-6
"""What a world costs the simulator between two answers [s]."""
_GAIN = 0.85
"""More worlds are worth it if an answer then takes this share of the time or less."""
_RANGE_SECONDS = 20.0
"""A range of tests that one process drives should take no longer [s], so that all processes are busy to the end."""


class Pace:
    """The usual time of an AV's calls, by the number of worlds that drive, and the time limits that follow from it.

    Sessions of one AV share it; a count that is lost between threads does no harm.

    Args:
        timeout: Longest time for the answer in one world [s].
        first_timeout: Longest time for loading, for setting up, and for the first answer of a process [s], each.
    """

    def __init__(self, timeout: float, first_timeout: float) -> None:
        self.timeout, self.first_timeout = timeout, max(first_timeout, timeout)
        self._seconds: dict[int, float] = {}
        self.answers = 0
        """Answers noted so far, one for each world that drove."""
        self.slower: float | None = None
        """Driving took so many times as long as expected, of late; None: nothing was driven."""

    def note(self, worlds: int, seconds: float) -> None:
        """Note that a call in which so many worlds drove took so long [s]."""
        self.answers += worlds
        place = _place(worlds)
        before = self._seconds.get(place, seconds)
        self._seconds[place] = before + _WEIGHT * (seconds - before)

    def note_driven(self, answers: float, seconds: float, batch: int) -> None:
        """Note that one process drove tests with so many answers in so long [s], `batch` worlds side by side."""
        slower = max(1.0, seconds / max(answers * self.seconds_per_answer(batch), 1e-9))
        before = slower if self.slower is None else self.slower
        self.slower = before + _WEIGHT * (slower - before)

    def usual(self, worlds: int) -> float:
        """Say how long a call for so many worlds usually takes [s]; 0 if no call was noted.

        A call for more worlds is taken to last no shorter. Beyond the largest call noted, time grows with the worlds.
        """
        known, place = sorted(self._seconds), _place(worlds)
        for other in known:
            if other >= place:
                return self._seconds[other]
        return self._seconds[known[-1]] * worlds / 2.0 ** known[-1] if known else 0.0

    def limit(self, worlds: int, *, first: bool = False) -> float:
        """Say how long a call for so many worlds may take [s]: the limit of one answer, and more for many worlds.

        Args:
            worlds: Worlds that drive.
            first: It is the first call of its process.
        """
        most = self.first_timeout if first else self.timeout
        return most + (_LIMIT_FACTOR * self.usual(worlds) if worlds > 1 else 0.0)

    def allow_more(self, worlds: int) -> None:
        """Take calls for so many worlds to last as long as the limit of one answer: one had too little time."""
        self._seconds[_place(worlds)] = max(self.usual(worlds), self.timeout)

    def seconds_per_answer(self, batch: int) -> float:
        """Say how long one process takes for the answer in one world, if so many are asked about together [s]."""
        return (self.usual(batch) + _OWN_SECONDS) / batch + _WORLD_SECONDS

    def rows(self, batch: int, tests: int) -> int:
        """Say how many worlds side by side drive so many tests: no more than tests, if that saves time."""
        return min(batch, max(1, tests)) if self.usual(batch) > 0.05 else batch

    def range_size(self, usual: int, batch: int, tests: int, processes: int, answers: float) -> int:
        """Say how many tests in a row one process drives, so that all processes are busy, also at the end.

        Args:
            usual: For an AV that is fast.
            batch: Worlds side by side.
            tests: All tests.
            processes: Number of processes.
            answers: Answers in a test.
        """
        if self.usual(batch) <= 0.0:
            return usual
        in_time = int(_RANGE_SECONDS / (answers * self.seconds_per_answer(batch)))
        share = -(-tests // processes)
        return max(1, min(usual, max(batch, in_time), share))


def _place(worlds: int) -> int:
    """Put numbers of worlds together: 1, 2, 3 to 4, 5 to 8, ..."""
    return max(0, int(worlds) - 1).bit_length()


def choose_batch(seconds_of: Callable[[int], float], most: int = MOST_WORLDS) -> int:
    """Choose how many worlds are asked about together: more as long as that saves time and a call stays short.

    Args:
        seconds_of: Measures how long a call for so many worlds takes [s]; called for 1 first, then for more and more.
        most: Worlds at most.

    Returns:
        1 for an AV that takes the same time for each world; `most` for one that answers many worlds in one go.

    >>> choose_batch(lambda worlds: 0.2 * worlds), choose_batch(lambda worlds: 0.2 + 0.0001 * worlds)
    (1, 256)
    >>> choose_batch(lambda worlds: 1e-4 + 1e-7 * worlds)
    256
    """
    alone = seconds_of(1)
    best, seconds = 1, alone
    while best < most and seconds <= max(CALL_SECONDS, 2.0 * alone):
        more = min(most, max(4 * best, int(best * CALL_SECONDS / max(seconds, 1e-9))))
        longer = seconds_of(more)
        if (longer + _OWN_SECONDS) / more > _GAIN * (seconds + _OWN_SECONDS) / best:
            break
        if longer > 2.0 * max(CALL_SECONDS, alone):
            break
        best, seconds = more, longer
    return best


_listeners: list[Callable[[str], None]] = []


def announce(text: str) -> None:
    """Tell those who listen (the command line, on standard error) something that a user should know now, in a line."""
    for listener in _listeners[-1:]:
        listener(text)


@contextmanager
def announced(listener: Callable[[str], None]) -> Iterator[None]:
    """Hear what is announced as long as the block runs, also from other threads."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)
