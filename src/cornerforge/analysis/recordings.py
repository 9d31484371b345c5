"""Recorded motion of many cases as flat arrays, for measures and rules that look at every frame of every case.

Made from rows of a library's tracks (`recordings_of_tracks`) or from scenarios in memory (`recordings_of_scenarios`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.types import FRAME_S, Odd, Scenario

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["AV", "BV", "PairMotion", "Recordings", "pair_motion", "recordings_of_scenarios", "recordings_of_tracks"]

AV, BV = 0, 1
"""First axis of the arrays of a pair."""

_SERIES = ("x", "y", "speed", "heading")


@dataclass(frozen=True)
class Recordings:
    """Cases one after the other, from the start of each test to the frame of its crash, 0.1 s a frame.

    A case's series stand vehicle by vehicle, the AV first: vehicle i at frame t is entry i * n_frames + t of the case.

    Attributes:
        case_ids: Names of the cases, length S.
        n_frames: Frames of each case, int64, shape (S,); the last one is that of the contact.
        n_vehicles: Vehicles of each case, int64, shape (S,).
        partner: Which of them the AV touches first, int64, shape (S,), at least 1.
        x, y, speed, heading: As in `Scenario` [m, m, m/s, rad], flat, any float type; NaN where absent.
        present: The vehicle exists, flat.
        length, width: Of all vehicles [m].
    """

    case_ids: tuple[str, ...]
    n_frames: NDArray[np.int64]
    n_vehicles: NDArray[np.int64]
    partner: NDArray[np.int64]
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    speed: NDArray[np.floating]
    heading: NDArray[np.floating]
    present: NDArray[np.bool_]
    length: float
    width: float

    def __len__(self) -> int:
        return len(self.case_ids)

    @property
    def start(self) -> NDArray[np.int64]:
        """Where each case's entries begin, and the end of the last, shape (S + 1,)."""
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(self.n_frames * self.n_vehicles)])

    def blocks(self, size: int) -> Iterator[Recordings]:
        """The same cases in pieces of at most `size`, so that what is derived of them stays small."""
        start = self.start
        for first in range(0, len(self), size):
            last = min(first + size, len(self))
            rows, entries = slice(first, last), slice(int(start[first]), int(start[last]))
            yield replace(
                self,
                case_ids=self.case_ids[rows],
                n_frames=self.n_frames[rows],
                n_vehicles=self.n_vehicles[rows],
                partner=self.partner[rows],
                present=self.present[entries],
                **{name: getattr(self, name)[entries] for name in _SERIES},
            )


@dataclass(frozen=True)
class PairMotion:
    """The AV and its crash partner, all cases ending in the same column: the contact.

    Frames before both were there repeat the first frame in which they were, so that differences there are 0.

    Attributes:
        x, y, speed, heading: [m, m, m/s, rad], float64, shape (2, S, T); `AV` and `BV` on the first axis.
        recorded: The frame is of the recording, shape (S, T); the last column always is.
        free_along, free_across: Room between what the two boxes, as they stand, cover along and across the road [m],
            shape (S, T); negative: overlap. A box that stands askew covers more: that matters for vehicles that all but
            stood while they changed lanes, and it makes every contact an overlap on both axes.
        length, width: Of both vehicles [m].
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    speed: NDArray[np.float64]
    heading: NDArray[np.float64]
    recorded: NDArray[np.bool_]
    free_along: NDArray[np.float64]
    free_across: NDArray[np.float64]
    length: float
    width: float


def recordings_of_tracks(tracks: pa.Table, bv_slot: NDArray[np.integer], odd: Odd) -> Recordings:
    """Take the motion of cases out of a library's tracks.

    Args:
        tracks: Rows of `library.schema.TRACKS`.
        bv_slot: Slot of each case's crash partner (column `bv_slot` of its cases), shape (S,).
        odd: Road and rules of the library.

    Raises:
        InputError: A case's crash partner is not among its tracks, or the numbers of rows differ.
    """
    if len(bv_slot) != tracks.num_rows:
        raise InputError(f"There are {len(bv_slot)} crash partners for {tracks.num_rows} tracks; give one for each.")

    def flat(name: str) -> NDArray[Any]:
        column = tracks.column(name).combine_chunks()
        return np.asarray(column.flatten().to_numpy(zero_copy_only=False))

    case_ids = tuple(tracks.column("case_id").to_pylist())
    slot = flat("slot")
    n_vehicles = np.asarray(tracks.column("slot").combine_chunks().value_lengths().to_numpy(), np.int64)
    return Recordings(
        case_ids=case_ids,
        n_frames=tracks.column("n_frames").to_numpy().astype(np.int64),
        n_vehicles=n_vehicles,
        partner=_partner_columns(case_ids, slot, n_vehicles, bv_slot),
        x=flat("x_m"),
        y=flat("y_m"),
        speed=flat("speed_mps"),
        heading=flat("heading_rad"),
        present=flat("present"),
        length=odd.vehicle_length,
        width=odd.vehicle_width,
    )


def recordings_of_scenarios(scenarios: Sequence[Scenario]) -> Recordings:
    """The same from scenarios in memory, all of one ODD; what was recorded after the contact is left out.

    Raises:
        InputError: There is none, one holds no crash of the AV or does not hold its contact, or their ODDs differ.
    """
    if not scenarios:
        raise InputError("There are no scenarios; give at least one.")
    odd = scenarios[0].odd
    case_ids = tuple(f"{s.seed}:{s.test}" for s in scenarios)
    slots, ends = [], []
    for name, scenario in zip(case_ids, scenarios, strict=True):
        if scenario.crash is None or scenario.crash.slot_a != 0:
            raise InputError(f"Test {name} holds no crash of the AV; only AV crashes are cases.")
        if scenario.odd != odd:
            raise InputError(f"Test {name} is of another ODD than test {case_ids[0]}; give them one by one.")
        frame = round(scenario.crash.time / FRAME_S)
        if not 0 <= frame < len(scenario.x):
            raise InputError(f"Test {name}: its contact is not in the recording of {len(scenario.x)} frames.")
        ends.append(frame + 1)
        slots.append(scenario.crash.slot_b)
    n_vehicles = np.array([len(s.slot) for s in scenarios], np.int64)

    def flat(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(s, name)[:end].T.ravel() for s, end in zip(scenarios, ends, strict=True)])

    return Recordings(
        case_ids=case_ids,
        n_frames=np.array(ends, np.int64),
        n_vehicles=n_vehicles,
        partner=_partner_columns(case_ids, np.concatenate([s.slot for s in scenarios]), n_vehicles, np.array(slots)),
        present=flat("present"),
        length=odd.vehicle_length,
        width=odd.vehicle_width,
        **{name: flat(name) for name in _SERIES},
    )


def _partner_columns(
    case_ids: Sequence[str], slot: NDArray[Any], n_vehicles: NDArray[np.int64], bv_slot: NDArray[np.integer]
) -> NDArray[np.int64]:
    """Place of each case's crash partner among its vehicles."""
    case = np.repeat(np.arange(len(case_ids)), n_vehicles)
    found = np.flatnonzero(slot == np.asarray(bv_slot)[case])
    if not np.array_equal(case[found], np.arange(len(case_ids))):
        wrong = int(np.flatnonzero(np.bincount(case[found], minlength=len(case_ids)) != 1)[0])
        raise InputError(
            f"Case {case_ids[wrong]}: its crash partner, slot {int(bv_slot[wrong])}, is not among its vehicles once."
        )
    return np.asarray(found - (np.cumsum(n_vehicles) - n_vehicles), np.int64)


def pair_motion(recordings: Recordings) -> PairMotion:
    """Pick the AV and its crash partner, ending at the contact.

    Raises:
        InputError: One of the two is absent at the contact, or where they are is not a finite number.
    """
    start, n_frames = recordings.start[:-1], recordings.n_frames
    n_columns = int(n_frames.max(initial=1))
    frame = n_frames[:, None] - n_columns + np.arange(n_columns)
    vehicle_start = np.stack([start, start + recordings.partner * n_frames])[:, :, None]
    within = np.maximum(frame, 0)
    absent = ~recordings.present[vehicle_start + within].all(axis=0)
    if absent[:, -1].any():
        case = recordings.case_ids[int(np.argmax(absent[:, -1]))]
        raise InputError(f"Case {case}: the AV or its crash partner is absent at the contact.")
    # Behind the last frame in which one of them was missing, both have been there ever since.
    first = np.where(absent, within + 1, 0).max(axis=1)
    entries = vehicle_start + np.maximum(frame, first[:, None])
    series = {name: np.asarray(getattr(recordings, name)[entries], np.float64) for name in _SERIES}
    for name, values in series.items():
        bad = ~np.isfinite(values).all(axis=(0, 2))
        if bad.any():
            raise InputError(
                f"Case {recordings.case_ids[int(np.argmax(bad))]}: {name} of the AV or its crash partner is not finite."
            )
    length, width = recordings.length, recordings.width
    cos, sin = np.abs(np.cos(series["heading"])), np.abs(np.sin(series["heading"]))
    apart_x, apart_y = (np.abs(series[name][BV] - series[name][AV]) for name in ("x", "y"))
    return PairMotion(
        recorded=frame >= first[:, None],
        free_along=apart_x - 0.5 * (length * cos + width * sin).sum(axis=0),
        free_across=apart_y - 0.5 * (width * cos + length * sin).sum(axis=0),
        length=length,
        width=width,
        **series,
    )
