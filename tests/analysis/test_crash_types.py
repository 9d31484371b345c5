"""Crash types on contacts built by hand, on every mirror image, and on random ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cornerforge.analysis import CRASH_TYPES, STRIKERS, classify_crashes
from cornerforge.analysis.contact import FRONT, REAR, SIDE, find_contact
from cornerforge.errors import InputError
from cornerforge.geometry import Box, boxes_overlap

D = np.pi / 180.0

# name: (AV, BV) as [x, y, speed, heading in degrees], type code, striker
CONTACTS: dict[str, tuple[list[float], list[float], int, str]] = {
    "AV runs into the rear": ([0, 2, 30, 0], [4.6, 2, 20, 0], 1, "av"),
    "AV runs 2 m deep into a rear, half beside it": ([0, 2, 40, 0], [3.0, 3.5, 20, 0], 1, "av"),
    "AV runs into a vehicle that has just cut in": ([0, 2, 30, 0], [4.4, 3.2, 20, -3], 1, "av"),
    "BV runs into the AV's rear": ([0, 2, 20, 0], [-4.6, 2, 30, 0], 2, "bv"),
    "BV runs into the AV's rear at 9 degrees": ([0, 2, 20, 0], [-4.7, 2.2, 30, -9], 2, "bv"),
    "the same at 11 degrees is an angle crash": ([0, 2, 20, 0], [-4.7, 2.2, 30, -11], 5, "bv"),
    "AV into a rear at 20 degrees": ([0, 2, 30, 20], [4.9, 2, 10, 0], 5, "av"),
    "head-on": ([0, 2, 20, 0], [4.5, 2.3, 20, 180], 3, "mutual"),
    "opposite directions, side to side": ([0, 2, 20, 0], [1, 3.9, 20, 178], 3, "mutual"),
    "BV moves into the AV": ([0, 2, 30, 0], [1, 3.9, 30, -4], 4, "bv"),
    "AV moves into the BV": ([0, 2, 30, 4], [-1, 3.9, 30, 0], 4, "av"),
    "both move": ([0, 2, 30, 3], [0.5, 3.9, 31, -3], 4, "mutual"),
    "BV cuts in, its tail meets the AV's front corner sideways": ([0, 2, 30, 0], [4.2, 3.7, 30.2, -4], 4, "bv"),
    "steep sideswipe": ([0, 2, 30, 0], [0, 4.7, 25, -35], 4, "bv"),
    "front into side": ([0, 2, 30, 0], [0, 4.95, 20, -50], 5, "bv"),
    "AV strikes broadside": ([0, 2, 20, 0], [3.4, 2, 5, 90], 5, "av"),
    "BV strikes the AV broadside": ([0, 2, 5, 0], [0, 5.4, 20, -90], 5, "bv"),
    "fronts of both at 130 degrees": ([0, 2, 20, 0], [4.2, 3, 20, -130], 5, "mutual"),
    "side by side at the same velocity": ([0, 2, 30, 0], [1, 3.99, 30, 0], 4, "mutual"),
    "touching within rounding": ([0, 2, 30, 0], [5.00001, 2, 20, 0], 1, "av"),
}


def as_pose(av: Sequence[float], bv: Sequence[float]) -> np.ndarray:
    pose = np.array([[av, bv]], dtype=np.float64)
    pose[..., 3] *= D
    return pose


def overlap(pose: np.ndarray) -> bool:
    (xa, ya, _, ha), (xb, yb, _, hb) = pose[0].tolist()
    return boxes_overlap(Box(xa, ya, ha, 5.0, 2.0), Box(xb, yb, hb, 5.0, 2.0))


def mirrored(pose: np.ndarray) -> np.ndarray:
    return pose * np.array([1.0, -1.0, 1.0, -1.0])


@pytest.mark.parametrize("name", CONTACTS)
def test_contacts_built_by_hand_and_their_mirror_images(name: str) -> None:
    av, bv, code, striker = CONTACTS[name]
    pose = as_pose(av, bv)
    if name != "touching within rounding":
        assert overlap(pose)
    for image in (pose, mirrored(pose)):
        found = classify_crashes(image)
        assert (found.code.tolist(), STRIKERS[found.striker[0]]) == ([code], striker)
        assert found.names == [CRASH_TYPES[code]]


def test_every_type_and_striker_is_built_by_hand() -> None:
    assert {code for _, _, code, _ in CONTACTS.values()} == set(CRASH_TYPES)
    assert {striker for *_, striker in CONTACTS.values()} == set(STRIKERS)
    assert {(code, striker) for _, _, code, striker in CONTACTS.values()} >= {
        (1, "av"), (2, "bv"), (3, "mutual"), (4, "av"), (4, "bv"), (4, "mutual"), (5, "av"), (5, "bv"), (5, "mutual"),
    }  # fmt: skip


@pytest.mark.parametrize("name", CONTACTS)
def test_exchanged_vehicles_exchange_the_roles_of_contacts_built_by_hand(name: str) -> None:
    """AV and BV change places: the two rear-ends become each other, the striker the other one, nothing else changes."""
    av, bv, code, striker = CONTACTS[name]
    found = classify_crashes(as_pose(bv, av))
    assert found.code.tolist() == [{1: 2, 2: 1}.get(code, code)]
    assert STRIKERS[found.striker[0]] == {"av": "bv", "bv": "av"}.get(striker, striker)


# name: sectors of the AV and the BV
SECTORS = {
    "AV runs into the rear": (FRONT, REAR),
    "BV runs into the AV's rear": (REAR, FRONT),
    "head-on": (FRONT, FRONT),
    "BV moves into the AV": (SIDE, SIDE),
    "AV strikes broadside": (FRONT, SIDE),
    "BV strikes the AV broadside": (SIDE, FRONT),
    "side by side at the same velocity": (SIDE, SIDE),
    "AV runs 2 m deep into a rear, half beside it": (FRONT, REAR),
}


@pytest.mark.parametrize("name", SECTORS)
def test_sectors_of_both_vehicles_and_their_mirror_images(name: str) -> None:
    av, bv, *_ = CONTACTS[name]
    pose = as_pose(av, bv)
    for image, wanted in (
        (pose, SECTORS[name]), (mirrored(pose), SECTORS[name]), (pose[:, ::-1], SECTORS[name][::-1]),
    ):  # fmt: skip
        contact = find_contact(image, 5.0, 2.0)
        assert (contact.av_sector[0], contact.bv_sector[0]) == wanted
        assert contact.relative_heading[0] == pytest.approx(abs(pose[0, 1, 3] - pose[0, 0, 3]))


@st.composite
def contacts(draw: st.DrawFn) -> np.ndarray:
    number = lambda low, high: draw(st.floats(low, high))  # noqa: E731
    av = [number(0, 500), number(0, 12), number(0, 40), number(-60, 60)]
    bv = [av[0] + number(-5, 5), av[1] + number(-5, 5), number(0, 40), number(-60, 60)]
    pose = as_pose(av, bv)
    assume(overlap(pose))
    return pose


@given(contacts())
def test_mirroring_changes_nothing(pose: np.ndarray) -> None:
    one, other = classify_crashes(pose), classify_crashes(mirrored(pose))
    assert one.code == other.code
    assert one.striker == other.striker


@given(contacts())
def test_exchanging_the_vehicles_exchanges_the_roles(pose: np.ndarray) -> None:
    assume(abs(pose[0, 0, 1] - pose[0, 1, 1]) > 1e-6)  # dead centre has no left and right to agree on
    one, other = classify_crashes(pose), classify_crashes(pose[:, ::-1])
    assert other.code[0] == {1: 2, 2: 1}.get(one.code[0], one.code[0])
    assert other.striker[0] == {0: 1, 1: 0}.get(one.striker[0], one.striker[0])


@given(st.lists(contacts(), min_size=2, max_size=5))
def test_a_batch_is_its_cases_one_by_one(poses: list[np.ndarray]) -> None:
    batch = classify_crashes(np.concatenate(poses))
    assert batch.code.tolist() == [classify_crashes(pose).code[0] for pose in poses]
    assert sum(batch.counts().values()) == sum(batch.striker_counts().values()) == len(poses)


def test_bad_input_is_named() -> None:
    apart = as_pose([0, 2, 30, 0], [9, 2, 30, 0])
    with pytest.raises(InputError, match=r"case 0 are 4\.00 m apart"):
        classify_crashes(apart)
    assert classify_crashes(apart, length=9.5).code.tolist() == [1]  # long enough to touch
    with pytest.raises(InputError, match=r"pose has shape \(2, 4\)"):
        classify_crashes(apart[0])
    apart[0, 0, 0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        classify_crashes(apart)
