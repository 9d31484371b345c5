from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.analysis import CRASH_TYPES, STRIKERS, crash_cells, unseen_chance, variety_of
from cornerforge.analysis.variety import SIDES
from cornerforge.errors import InputError

NAMES = tuple("abcdefgh")


def test_cells_of_crashes_by_hand() -> None:
    av = [0.0, 2.0, 30.0, 0.0]
    pose = np.array(
        [
            [av, [4.9, 2.0, 20.0, 0.0]],  # the AV runs into one ahead
            [av, [-4.9, 2.0, 40.0, 0.0]],  # and is run into
            [av, [1.0, 3.95, 30.0, -0.1]],  # one swerves into it from the left
            [av, [1.0, 0.05, 30.0, 0.1]],  # and one from the right
        ]
    )
    index, names = crash_cells(pose)
    assert [names[k] for k in index] == [
        "rear-end by AV | front | av",
        "rear-end by BV | rear | bv",
        "sideswipe | left | bv",
        "sideswipe | right | bv",
    ]
    assert len(names) == len(set(names)) == len(CRASH_TYPES) * len(SIDES) * len(STRIKERS)
    index, names = crash_cells(pose, avoidable=np.array([True, False, True, False]))
    assert [names[k].rpartition(" | ")[2] for k in index] == ["avoidable", "unavoidable"] * 2
    mirrored = pose.copy()
    mirrored[..., 1] = 4.0 - mirrored[..., 1]
    mirrored[..., 3] *= -1.0
    swap = {"left": "right", "right": "left"}
    ours, theirs = (crash_cells(p)[0] for p in (pose, mirrored))
    _, names = crash_cells(pose)
    assert [names[k].split(" | ") for k in theirs] == [
        [kind, swap.get(side, side), who] for kind, side, who in (names[k].split(" | ") for k in ours)
    ]


def test_cells_take_each_vehicles_own_size() -> None:
    av = [0.0, 2.0, 30.0, 0.0]
    pose = np.array([[av, [10.4, 2.0, 20.0, 0.0]], [av, [1.0, 3.35, 30.0, -0.1]]])  # a truck's rear, a motorcycle
    length, width = np.array([[5.0, 16.5], [5.0, 2.2]]), np.array([[2.0, 2.55], [2.0, 0.8]])
    index, names = crash_cells(pose, vehicle_length=length, vehicle_width=width)
    assert [names[k] for k in index] == ["rear-end by AV | front | av", "sideswipe | left | bv"]
    with pytest.raises(InputError, match="case 0 are"):
        crash_cells(pose)


def test_entropy_by_hand() -> None:
    found = variety_of(np.array([0] * 6 + [1] * 2), NAMES)
    assert found.entropy == pytest.approx(-(0.75 * math.log(0.75) + 0.25 * math.log(0.25)))
    assert found.effective == pytest.approx(math.exp(found.entropy))
    assert found.cells == {"a": 6, "b": 2}
    assert found.to_json()["filled"] == 2
    alone = variety_of(np.zeros(50, dtype=np.intp), NAMES)
    assert (alone.entropy, alone.entropy_interval95, alone.effective) == (0.0, (0.0, 0.0), 1.0)


@given(st.lists(st.integers(0, 7), min_size=1, max_size=300))
def test_bounds_and_order(cells: list[int]) -> None:
    found = variety_of(np.array(cells), NAMES)
    assert 0.0 <= found.entropy <= math.log(len(set(cells))) + 1e-12
    assert found.entropy_interval95[0] <= found.entropy_interval95[1]
    assert sum(found.cells.values()) == len(cells)
    assert list(found.cells.values()) == sorted(found.cells.values(), reverse=True)
    assert found.unseen_interval95[0] <= found.unseen <= found.unseen_interval95[1] <= 1.0
    shuffled = variety_of(np.array(cells[::-1]), NAMES)
    assert (shuffled.cells, shuffled.entropy) == (found.cells, found.entropy)


def test_the_interval_holds_the_true_entropy(seed: int) -> None:
    # 200 samples of 400 from a known law: a 95 % interval that covers fewer than 170 is no such thing
    # (P < 1e-6 if it covers 92 % or more), and one that covers all of 200 is too wide (P = 3.5e-5 at 95 %).
    rng = np.random.default_rng(seed)
    p = np.array([0.4, 0.2, 0.15, 0.1, 0.06, 0.05, 0.03, 0.01])
    truth = float(-(p * np.log(p)).sum())
    covered = 0
    for k in range(200):
        low, high = variety_of(rng.choice(8, size=400, p=p), NAMES, seed=k).entropy_interval95
        covered += low <= truth <= high
    assert 170 <= covered < 200


def test_unseen_chance_by_hand_and_by_sampling(seed: int) -> None:
    assert unseen_chance(np.array([5, 0, 1, 1, 2, 0]))[0] == pytest.approx(2.0 / 9.0)
    share, (low, high) = unseen_chance(np.array([300]))
    assert (share, low) == (0.0, 0.0)
    assert high == pytest.approx(0.01, abs=1e-4)  # none in 300: rule of three
    rng = np.random.default_rng(seed)
    p = 1.0 / np.arange(1, 201)
    p /= p.sum()
    covered = 0
    for _ in range(200):
        counts = rng.multinomial(150, p)
        low, high = unseen_chance(counts)[1]
        covered += low <= p[counts == 0].sum() <= high
    assert covered >= 170


@pytest.mark.parametrize("cells", [[], [8], [-1, 2]])
def test_what_is_no_cell_is_refused(cells: list[int]) -> None:
    with pytest.raises(InputError):
        variety_of(np.array(cells, dtype=np.intp), NAMES)


def test_a_wrong_number_of_labels_is_refused() -> None:
    pose = np.array([[[0.0, 2.0, 30.0, 0.0], [4.9, 2.0, 20.0, 0.0]]])
    with pytest.raises(InputError, match="avoidable has shape"):
        crash_cells(pose, avoidable=np.array([True, False]))


def test_no_case_has_no_unseen_kind() -> None:
    with pytest.raises(InputError, match="no cases"):
        unseen_chance(np.zeros(5, dtype=np.int64))
