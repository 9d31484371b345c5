"""Judges of crashes for rewards that are given case by case: the functions by which `analyse` judges stored cases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge.adversary.worlds import Verdict, driver_of_reward, reward_named
from cornerforge.drivers.careful import CAREFUL
from cornerforge.sim import harvest
from cornerforge.types import SUBSTEPS
from cornerforge.work import Rooms, in_order

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.analysis.prevented import Prevention
    from cornerforge.experiment.experiments import Experiment
    from cornerforge.recordings import Recordings
    from cornerforge.sim import Recorder, harvest
    from cornerforge.types import Odd

__all__ = ["Paid", "count_paid", "judge_by_case", "verdict_of"]

_BY_BRAKING = "preventable-by-braking"
_ROOM = 32
"""Number of cases that one thread records and judges together."""


class Paid(NamedTuple):
    """Verdicts on C crashes, bool (C,) each.

    Attributes:
        paid: The reward pays for it.
        strictly: And by a stricter reading too: of `preventable`, holding the speed would not have been enough; of
            `own-fault`, the AV alone was at fault; of `own-doing`, a reference driver would have prevented it.
            `preventable-by-braking` has no stricter one.
    """

    paid: NDArray[np.bool_]
    strictly: NDArray[np.bool_]


def _prevention(odd: Odd, steers: bool, recordings: Recordings) -> Prevention:
    from cornerforge.analysis.avoidability import AvoidParams, problems_of
    from cornerforge.analysis.prevented import prevention_of

    problems = problems_of(recordings, recordings.partner.tolist(), odd)
    return prevention_of(recordings, problems, odd, AvoidParams(steers=steers))


def _own_doing(odd: Odd, steers: bool, recordings: Recordings) -> Paid:
    from cornerforge.analysis.conduct import conduct_of

    found = _prevention(odd, steers, recordings)
    conduct = conduct_of(recordings, odd, found)
    wrong = conduct.code != 0
    return Paid(wrong, wrong & found.prevented.any(axis=1))


def _preventable(driver: str, odd: Odd, steers: bool, recordings: Recordings) -> Paid:
    found = _prevention(odd, steers, recordings)
    prevented = found.prevented[:, CAREFUL[driver]]
    return Paid(prevented, prevented & ~found.held)


def _own_fault(odd: Odd, recordings: Recordings) -> Paid:
    from cornerforge.analysis.fault import FAULTS, assign_fault

    fault = assign_fault(recordings, odd=odd).fault
    alone = fault == FAULTS.index("av")
    return Paid(alone | (fault == FAULTS.index("both")), alone)


def _judge_of(reward: str, run: Experiment) -> Callable[[Recordings], Paid] | None:
    """Return the judge of a reward's crashes; None: kernels judge them.

    Raises:
        UnknownNameError, InputError: As `adversary.worlds.rewards.reward_named`.
    """
    if not reward_named(reward).by_case:
        return None
    driver = driver_of_reward(reward)
    if reward == "own-doing":
        return partial(_own_doing, run.odd, run.av_steers)
    if driver is None:
        return partial(_own_fault, run.odd)
    odd, steers, by_braking = run.odd, run.av_steers, reward.startswith(_BY_BRAKING)

    def judge(recordings: Recordings) -> Paid:
        found = _preventable(driver, odd, steers, recordings)
        return Paid(found.strictly, found.strictly) if by_braking else found

    return judge


def verdict_of(reward: str, run: Experiment) -> Verdict | None:
    """Return who says of crashes of a run whether a reward pays for them; None: kernels do.

    Raises:
        UnknownNameError, InputError: As `adversary.worlds.rewards.reward_named`.
    """
    judge = _judge_of(reward, run)
    return None if judge is None else lambda recordings: judge(recordings).paid


def judge_by_case(run: Experiment, seed: int, crashed: Sequence[int], reward: str, threads: int) -> Paid | None:
    """Record tests that ended in a crash of the AV, and judge each as the case that a library would hold.

    Args:
        run: The experiment.
        seed, crashed: The tests.
        reward: Its name.
        threads: Size of the pool; does not change the result.

    Returns:
        The verdicts in the order of `crashed`; None: the reward is not given case by case.
    """
    judge = _judge_of(reward, run)
    if judge is None:
        return None

    def make() -> tuple[Recorder, harvest.Harvest]:
        return run.recorder(), harvest.allocate_harvest(_ROOM, run.slots, run.setting.road.max_decisions)

    rooms = Rooms(make)
    longest = SUBSTEPS * int(run.setting.road.max_decisions) + 1, run.slots

    def work(first: int, count: int) -> Paid:
        parts = []
        with rooms.lend() as (recorder, cases):
            cases.clear()
            for test in crashed[first : first + count]:
                recorder.drive(seed, test)
                recorder.keep(cases)
                if harvest.is_full(cases, *longest):
                    parts.append(judge(cases.recordings()))
                    cases.clear()
            if cases.n_cases:
                parts.append(judge(cases.recordings()))
        return _joined(parts)

    return _joined(list(in_order(work, 0, len(crashed), chunk=_ROOM, threads=run.processes(threads))))


def count_paid(run: Experiment, seed: int, crashed: Sequence[int], reward: str, threads: int) -> dict[str, int | None]:
    """Count the verdicts of `judge_by_case`: `paid` and `strictly`, None where the reward is not given case by case."""
    found = judge_by_case(run, seed, crashed, reward, threads)
    return {name: None if found is None else int(getattr(found, name).sum()) for name in Paid._fields}


def _joined(parts: Sequence[Paid]) -> Paid:
    none = Paid(np.empty(0, np.bool_), np.empty(0, np.bool_))
    return Paid(*(np.concatenate(column) for column in zip(none, *parts, strict=True)))
