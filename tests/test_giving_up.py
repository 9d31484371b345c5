"""Long work in threads is told when nobody wants it any more: an interrupt does not wait for its end."""

from __future__ import annotations

import threading

from cornerforge.work import in_order, is_given_up


def test_work_learns_that_it_is_given_up() -> None:
    told = threading.Event()

    def work(first: int, count: int) -> int:
        if first > 0:
            while not is_given_up():
                told.wait(0.01)
            told.set()
        return count

    parts = in_order(work, 0, 3, chunk=1, threads=2)
    assert next(parts) == 1
    assert not told.is_set()
    parts.close()
    assert told.is_set()
    assert not is_given_up()
