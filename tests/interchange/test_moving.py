"""Progress that moves between two reports."""

from __future__ import annotations

import pytest

from cornerforge.work.progress import NO_PROGRESS, Moving, moving

Report = tuple[str, float, float]


class Desk:
    """Takes reports, and says how many answers there were."""

    def __init__(self) -> None:
        self.reports: list[Report] = []
        self.answers = 0

    def __call__(self, stage: str, done: float, total: float) -> None:
        self.reports.append((stage, done, total))


def test_it_moves_by_answers_and_learns_what_one_is_worth() -> None:
    desk = Desk()
    told = Moving(desk, lambda: desk.answers, each=0.01)
    told("drive", 0, 10)
    told.tick()
    assert desk.reports == [("drive", 0, 10)]  # nothing was answered
    desk.answers = 100
    told.tick()
    assert desk.reports[-1] == ("drive", pytest.approx(1.0), 10)
    told("drive", 2, 10)  # so 50 answers are one
    desk.answers = 150
    told.tick()
    assert desk.reports[-1] == ("drive", pytest.approx(3.0), 10)


def test_a_report_corrects_a_guess_and_only_a_report_is_the_end() -> None:
    desk = Desk()
    told = Moving(desk, lambda: desk.answers, each=1.0)
    told("drive", 0, 10)
    desk.answers = 5000
    told.tick()
    assert 9.0 < desk.reports[-1][1] < 10.0
    told("drive", 1, 10)
    desk.answers += 1
    told.tick()
    assert [done for _, done, _ in desk.reports[1:]] == [pytest.approx(9.99), 1, pytest.approx(1.0, abs=0.01)]


def test_work_of_an_earlier_session_is_not_taken_for_answers() -> None:
    desk = Desk()
    desk.answers = 1000
    told = Moving(desk, lambda: desk.answers, each=0.1)
    told("generate", 80, 100)
    desk.answers = 1010
    told("generate", 81, 100)
    desk.answers = 1020
    told.tick()
    assert desk.reports[-1] == ("generate", pytest.approx(82.0), 100)


def test_an_interrupt_out_of_a_tick_reaches_the_work() -> None:
    def refuse(stage: str, done: float, total: float) -> None:  # noqa: ARG001
        if done > 0.0:
            raise KeyboardInterrupt

    answers = [0]
    told = Moving(refuse, lambda: answers[0], each=1.0)
    told("drive", 0, 10)
    answers[0] = 3
    told.tick()
    with pytest.raises(KeyboardInterrupt):
        told("drive", 0, 10)


def test_others_are_told_as_before() -> None:
    desk = Desk()
    with moving(desk, None, 1.0, "drive", 0, 10) as told:
        assert told is desk
    with moving(NO_PROGRESS, lambda: 1, 1.0, "drive", 0, 10) as told:
        assert told is NO_PROGRESS
    assert desk.reports == []
    with moving(desk, lambda: 1, 1.0, "drive", 4, 10) as told:
        told("drive", 5, 10)
    assert desk.reports == [("drive", 4, 10), ("drive", 5, 10)]
