"""Delta debugging: whatever is asked, nothing of the answer can be left out."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from cornerforge.analysis.ddmin import ddmin

small = st.integers(min_value=0, max_value=14)


@given(n=st.integers(min_value=0, max_value=40), needed=st.sets(st.integers(min_value=0, max_value=39)))
def test_what_is_needed_together_is_found_exactly(n: int, needed: set[int]) -> None:
    needed = {item for item in needed if item < n}
    assert ddmin(range(n), lambda part: needed <= set(part)) == sorted(needed)


@given(
    n=st.integers(min_value=1, max_value=15),
    ways=st.lists(st.sets(small, min_size=1, max_size=4), min_size=1, max_size=4),
    spoilers=st.sets(small, max_size=3),
)
def test_no_single_item_of_the_answer_can_be_left_out(n: int, ways: list[set[int]], spoilers: set[int]) -> None:
    """The effect need not be monotone: it shows by one of several ways, unless an odd number of spoilers is there."""

    def shows(part: list[int]) -> bool:
        there = set(part)
        return any(way <= there for way in ways) and len(spoilers & there) % 2 == 0

    if not shows(list(range(n))):
        return
    found = ddmin(range(n), shows)
    assert shows(found)
    assert found == sorted(set(found))
    assert not any(shows(found[:k] + found[k + 1 :]) for k in range(len(found)))


def test_questions_are_about_parts_only_the_empty_one_first() -> None:
    asked: list[list[int]] = []

    def shows(part: list[int]) -> bool:
        asked.append(part)
        return {2, 5} <= set(part)

    assert ddmin(range(8), shows) == [2, 5]
    assert asked[0] == []
    assert all(len(part) < 8 for part in asked)
    assert ddmin([], lambda part: True) == []  # noqa: ARG005
    assert ddmin([7], lambda part: bool(part)) == [7]
