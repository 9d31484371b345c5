"""Crash types on contacts built by hand, on every mirror image, and on random ones."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from reference.shapes import Box as ShapeBox

from cornerforge.analysis import CRASH_TYPES, STRIKERS, classify_crashes
from cornerforge.analysis.contact import FRONT, REAR, SIDE, Contact, find_contact
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


# Straight, or turned by more than 1e-6 degrees: at less, rounding breaks a tie of two faces.
HEADINGS = st.one_of(st.just(0.0), st.floats(1e-6, 60.0), st.floats(-60.0, -1e-6))


@st.composite
def contacts(draw: st.DrawFn) -> np.ndarray:
    """Draw an AV and a BV that overlap: one drawn too far away comes nearer until it touches, so none is lost."""
    number = lambda low, high: draw(st.floats(low, high))  # noqa: E731
    av = [number(0, 500), number(0, 12), number(0, 40), draw(HEADINGS)]
    ahead, left, speed, heading = number(-5, 5), number(-5, 5), number(0, 40), draw(HEADINGS)
    while not overlap(pose := as_pose(av, [av[0] + ahead, av[1] + left, speed, heading])):
        ahead, left = 0.95 * ahead, 0.95 * left
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


CAR, TRUCK, MOTORCYCLE = (5.0, 2.0), (16.5, 2.55), (2.2, 0.8)
"""Length and width [m]."""

# name: (AV, BV) as [x, y, speed, heading in degrees], the BV's size, sectors of both, type code, striker
OF_TWO_SIZES: dict[str, tuple[list[float], list[float], tuple[float, float], tuple[int, int], int, str]] = {
    # bumper meets bumper where the centres are 2.5 + 8.25 = 10.75 m apart, or 2.5 + 1.1 = 3.6 m
    "into a truck's rear": ([0, 2, 30, 0], [10.4, 2, 20, 0], TRUCK, (FRONT, REAR), 1, "av"),
    "hit by a truck from behind": ([0, 2, 20, 0], [-10.4, 2, 30, 0], TRUCK, (REAR, FRONT), 2, "bv"),
    "into a motorcycle's rear": ([0, 2, 30, 0], [3.3, 2, 20, 0], MOTORCYCLE, (FRONT, REAR), 1, "av"),
    "hit by a motorcycle from behind": ([0, 2, 20, 0], [-3.3, 2.5, 30, 0], MOTORCYCLE, (REAR, FRONT), 2, "bv"),
    # side meets side where they are 1 + 1.275 = 2.275 m apart, or 1 + 0.4 = 1.4 m
    "a truck moves into the AV": ([0, 2, 30, 0], [5, 4.05, 30, -4], TRUCK, (SIDE, SIDE), 4, "bv"),
    "the AV moves into a truck beside it": ([0, 2, 30, 4], [-4, 4.3, 30, 0], TRUCK, (SIDE, SIDE), 4, "av"),
    "a motorcycle moves into the AV": ([0, 2, 30, 0], [1, 3.4, 30, -4], MOTORCYCLE, (SIDE, SIDE), 4, "bv"),
    # the motorcycle has been beside it for 1.3 / 5 s and closes sideways at 30 tan 4 deg = 2.1 m/s for 0.05 / 2.1 s
    "the AV moves into a motorcycle that it overtakes": (
        [0, 2, 30, 4], [2.0, 3.41, 25, 0], MOTORCYCLE, (SIDE, SIDE), 4, "av",
    ),
    "into a truck's side, 7 m behind its centre": ([0, 2, 20, 0], [3.4, 9, 5, 90], TRUCK, (FRONT, SIDE), 5, "av"),
    "into a motorcycle's side": ([0, 2, 20, 0], [2.7, 2, 5, 90], MOTORCYCLE, (FRONT, SIDE), 5, "av"),
    "a truck strikes broadside": ([0, 2, 5, 0], [0, 11.1, 20, -90], TRUCK, (SIDE, FRONT), 5, "bv"),
    "a truck from the front": ([0, 2, 20, 0], [10.4, 3, 20, 180], TRUCK, (FRONT, FRONT), 3, "mutual"),
}  # fmt: skip


def sizes_of(bv: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Lengths and widths of one case: a car and the other."""
    return np.array([[CAR[0], bv[0]]]), np.array([[CAR[1], bv[1]]])


@pytest.mark.parametrize("name", OF_TWO_SIZES)
def test_contacts_of_two_sizes_by_hand_their_mirror_images_and_with_roles_exchanged(name: str) -> None:
    av, bv, size, sectors, code, striker = OF_TWO_SIZES[name]
    pose, (length, width) = as_pose(av, bv), sizes_of(size)
    assert ShapeBox.overlaps(*moved_back(pose, length, width, 0.0))
    for image in (pose, mirrored(pose)):
        contact, found = find_contact(image, length, width), classify_crashes(image, length, width)
        assert (contact.av_sector[0], contact.bv_sector[0]) == sectors
        assert (found.code.tolist(), STRIKERS[found.striker[0]]) == ([code], striker)
    other = classify_crashes(pose[:, ::-1], length[:, ::-1], width[:, ::-1])
    assert other.code.tolist() == [{1: 2, 2: 1}.get(code, code)]
    assert STRIKERS[other.striker[0]] == {"av": "bv", "bv": "av"}.get(striker, striker)


def test_of_two_sizes_each_is_its_own_vehicles() -> None:
    """Negative control: with the sizes exchanged, or both a car's, some of these contacts are others, or none."""
    others = []
    for av, bv, size, *_, code, _ in OF_TWO_SIZES.values():
        pose, (length, width) = as_pose(av, bv), sizes_of(size)
        for wrong in ((length[:, ::-1], width[:, ::-1]), CAR):
            try:
                others.append(classify_crashes(pose, *wrong).code[0] != code)
            except InputError:
                others.append(True)
    assert sum(others) >= len(OF_TWO_SIZES) // 2


def moved_back(pose: np.ndarray, length: np.ndarray, width: np.ndarray, seconds: float) -> list[ShapeBox]:
    """Both boxes so long before, each along its path."""
    boxes = []
    for who in (0, 1):
        x, y, speed, heading = pose[0, who].tolist()
        back = seconds * speed
        place = x - back, y - back * math.tan(heading)
        boxes.append(ShapeBox(*place, heading, float(length[0, who]), float(width[0, who])))
    return boxes


def touched_before(pose: np.ndarray, length: np.ndarray, width: np.ndarray) -> float | None:
    """How long ago the boxes began to overlap [s], by halving, 0 to 0.1; None: longer ago, or they do not overlap."""
    together, apart = 0.0, 0.1
    here, before = moved_back(pose, length, width, together), moved_back(pose, length, width, apart)
    if not here[0].overlaps(here[1]) or before[0].overlaps(before[1]):
        return None
    for _ in range(50):
        middle = 0.5 * (together + apart)
        if ShapeBox.overlaps(*moved_back(pose, length, width, middle)):
            together = middle
        else:
            apart = middle
    return apart


def test_the_normal_parts_both_polygons_at_the_moment_at_which_they_touched(seed: int) -> None:
    """The referee moves polygons back until they are apart, and looks at where their corners lie along the normal."""
    rng = np.random.default_rng(seed)
    checked = 0
    for _ in range(10_000):
        sizes = np.array([CAR, TRUCK, MOTORCYCLE])[rng.integers(0, 3, size=2)]
        av = [rng.uniform(0.0, 500.0), rng.uniform(0.0, 12.0), rng.uniform(0.0, 40.0), rng.uniform(-50.0, 50.0)]
        bv = [av[0] + rng.uniform(-12.0, 12.0), av[1] + rng.uniform(-6.0, 6.0), rng.uniform(0.0, 40.0), 0.0]
        pose = as_pose(av, bv)
        length, width = sizes[None, :, 0], sizes[None, :, 1]
        since = touched_before(pose, length, width)
        if since is None:
            continue
        normal = find_contact(pose, length, width).normal[0]
        boxes = moved_back(pose, length, width, since)
        before, now = np.array([boxes[1].x - boxes[0].x, boxes[1].y - boxes[0].y]), pose[0, 1, :2] - pose[0, 0, :2]
        turned = pose[0, :, 3] + np.array([[0.0], [0.5 * math.pi]])
        axes = np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        if (np.sign(axes @ before) != np.sign(axes @ now)).any():
            continue  # one has passed the other's centre within 0.1 s
        corners_av, corners_bv = (np.array(box.corners()) @ normal for box in boxes)
        assert corners_av.max() <= corners_bv.min() + 1e-6
        checked += 1
    assert checked >= 250


def test_one_number_is_everybodys_size_and_shapes_are_checked() -> None:
    pose = np.concatenate([as_pose(av, bv) for av, bv, *_ in CONTACTS.values()])
    ones = np.ones((len(pose), 2))
    one, other = find_contact(pose, 5.0, 2.0), find_contact(pose, 5.0 * ones, 2.0 * ones)
    for name in Contact.__dataclass_fields__:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    with pytest.raises(InputError, match=r"vehicle_length has shape \(2,\)"):
        find_contact(pose, np.array([5.0, 5.0]), 2.0)
    with pytest.raises(InputError, match=r"vehicle_width = 0\.0"):
        find_contact(pose, 5.0, 0.0 * ones)


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
