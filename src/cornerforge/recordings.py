"""Recorded motion of many cases as one ragged table: flat arrays that kernels and NumPy code take alike.

The table is made from a library's tables (`recordings_of_tracks`) or from a scenario in memory (`recordings_of`);
`fields.SERIES` names the series. For a kernel that looks at one case, `unpack` writes the case into frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel
from cornerforge.errors import InputError
from cornerforge.fields import BODY, SERIES
from cornerforge.geometry import Box
from cornerforge.types import FRAME_S, Scenario

if TYPE_CHECKING:
    import pyarrow as pa
    from numpy.typing import NDArray

__all__ = [
    "BODY_FIELDS",
    "Recordings",
    "Trajectories",
    "box_in",
    "recordings_of",
    "recordings_of_columns",
    "recordings_of_tracks",
    "unpack",
]

BODY_FIELDS = np.dtype([(body.name, body.recorded.lstrip("<")) for body in BODY], align=True)
"""Constants of a vehicle: its class, 0 for a car, the size of its box [m], how long its lane changes take [s]."""

_OF_CASE = ("seed", "test", "frames", "vehicles", "at", "vehicle_at", "last", "partner")
_OF_VEHICLE = ("slot", *(BODY_FIELDS.names or ()))
_OF_FRAME = tuple(series.name for series in SERIES)


class Recordings(NamedTuple):
    """C cases one after the other, 0.1 s a frame.

    Vehicle i of case c, the AV being vehicle 0, stands at `vehicle_at[c] + i`; its state at frame t stands at
    `at[c] + i * frames[c] + t`.

    Attributes:
        seed, test: Name of each case, int64, shape (C,).
        frames: Frames of each case, int64, shape (C,).
        vehicles: Vehicles of each case, int64, shape (C,).
        at: Where the case's states begin, int64, shape (C,).
        vehicle_at: Where its vehicles begin, int64, shape (C,).
        last: Frame of the contact, int64, shape (C,); outside [0, frames) where the recording does not hold it.
        partner: Number of the vehicle that the AV touches first, int64, shape (C,); 0 where it is not among them.
        slot: Name of each vehicle within its test, int16, shape (V,).
        kind: Class of each vehicle, 0 for a car, int8, shape (V,).
        length, width: Size of each vehicle [m], float64, shape (V,).
        change_time: How long its undisturbed lane changes take [s], float64, shape (V,).
        x, y, speed, heading, acceleration: As in `types.Scenario`, float32 from libraries, else float64, shape (E,);
            NaN where absent.
        target_lane: As in `types.Scenario`, int8, shape (E,).
        present: The vehicle exists, bool, shape (E,).
    """

    seed: NDArray[np.int64]
    test: NDArray[np.int64]
    frames: NDArray[np.int64]
    vehicles: NDArray[np.int64]
    at: NDArray[np.int64]
    vehicle_at: NDArray[np.int64]
    last: NDArray[np.int64]
    partner: NDArray[np.int64]
    slot: NDArray[np.int16]
    kind: NDArray[np.int8]
    length: NDArray[np.float64]
    width: NDArray[np.float64]
    change_time: NDArray[np.float64]
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    speed: NDArray[np.floating]
    heading: NDArray[np.floating]
    acceleration: NDArray[np.floating]
    target_lane: NDArray[np.int8]
    present: NDArray[np.bool_]

    @property
    def n_cases(self) -> int:
        """Number of cases (`len` gives the tuple's length)."""
        return self.frames.size

    @property
    def case_ids(self) -> tuple[str, ...]:
        """The cases' names, seed:test."""
        return tuple(f"{seed}:{test}" for seed, test in zip(self.seed.tolist(), self.test.tolist(), strict=True))

    def blocks(self, size: int) -> Iterator[Recordings]:
        """Yield the cases in pieces of at most `size`, as views, so that arrays derived from them stay small."""
        ends = np.append(self.at, self.x.size), np.append(self.vehicle_at, self.slot.size)
        for first in range(0, self.n_cases, size):
            after = min(first + size, self.n_cases)
            cases = slice(first, after)
            states, vehicles = (slice(int(end[first]), int(end[after])) for end in ends)
            parts = [(_OF_CASE, cases), (_OF_VEHICLE, vehicles), (_OF_FRAME, states)]
            block = Recordings(**{name: getattr(self, name)[rows] for names, rows in parts for name in names})
            yield block._replace(at=block.at - states.start, vehicle_at=block.vehicle_at - vehicles.start)


class Trajectories(NamedTuple):
    """One recorded test as kernels look at it.

    Attributes:
        frames: (at least as many frames as are recorded, at least n) of `fields.FRAME_FIELDS`.
        bodies: Class and size of each vehicle, (at least n,), records with the fields of `BODY_FIELDS`.
        n: Number of vehicles, the AV first.
    """

    frames: NDArray[np.void]
    bodies: NDArray[np.void]
    n: int


@inlined_kernel
def unpack(r: Recordings, c: int, frames: NDArray[np.void], bodies: NDArray[np.void]) -> None:
    """Write the states of case c into the first frames and slots of `frames`, and its vehicles into `bodies`.

    Args:
        r: The cases.
        c: Number of the case.
        frames: (frames, slots) of `fields.FRAME_FIELDS`, large enough for the case; where a vehicle is absent only
            `present` is written.
        bodies: (slots,) of `BODY_FIELDS`.
    """
    for i in range(r.vehicles[c]):
        body = bodies[i]
        body.kind = r.kind[r.vehicle_at[c] + i]
        body.length = r.length[r.vehicle_at[c] + i]
        body.width = r.width[r.vehicle_at[c] + i]
        body.change_time = r.change_time[r.vehicle_at[c] + i]
        for t in range(r.frames[c]):
            k = r.at[c] + i * r.frames[c] + t
            cell = frames[t, i]
            cell.present = r.present[k]
            if r.present[k]:
                cell.x = r.x[k]
                cell.y = r.y[k]
                cell.speed = r.speed[k]
                cell.heading = r.heading[k]
                cell.acceleration = r.acceleration[k]
                cell.target_lane = r.target_lane[k]


@inlined_kernel
def box_in(test: Trajectories, f: int, i: int) -> Box:
    """Take the box of vehicle i at frame f."""
    cell = test.frames[f, i]
    body = test.bodies[i]
    return Box(cell.x, cell.y, cell.heading, body.length, body.width)


def recordings_of_tracks(cases: pa.Table, tracks: pa.Table) -> Recordings:
    """Take the motion of cases out of a library's tables.

    Args:
        cases: One row a case; `case_id`, `crash_time_s` and `bv_slot` of `fields.CASES` are read.
        tracks: `fields.TRACKS` of the same cases in the same order.

    Raises:
        InputError: The tables are not of the same cases, or a name is not seed:test.
    """
    ids = cases.column("case_id").to_pylist()
    if ids != tracks.column("case_id").to_pylist():
        raise InputError(
            f"{len(ids)} cases and {len(tracks)} trajectories are not of the same cases in the same order."
        )

    def flat(name: str) -> NDArray[Any]:
        return np.asarray(tracks.column(name).combine_chunks().flatten().to_numpy(zero_copy_only=False))

    crash_time = cases.column("crash_time_s").to_numpy()
    known = np.isfinite(crash_time)
    last = np.full(len(ids), -1, dtype=np.int64)
    last[known] = np.rint(crash_time[known] / FRAME_S)
    return recordings_of_columns(
        names=_numbers_of(ids),
        frames=tracks.column("n_frames").to_numpy().astype(np.int64),
        vehicles=tracks.column("slot").combine_chunks().value_lengths().to_numpy().astype(np.int64),
        last=last,
        slot=flat("slot"),
        bv_slot=cases.column("bv_slot").to_numpy(),
        columns={
            **{body.name: flat(body.column.name).copy() for body in BODY},
            **{series.name: flat(series.column.name) for series in SERIES},
        },
    )


def recordings_of(scenario: Scenario) -> Recordings:
    """Take a crash of the AV as recordings of one case; frames after the contact are left out.

    Raises:
        InputError: As `Scenario.contact`.
    """
    last, partner = scenario.contact()

    def one(value: int) -> NDArray[np.int64]:
        return np.array([value], dtype=np.int64)

    return Recordings(
        seed=one(scenario.seed),
        test=one(scenario.test),
        frames=one(last + 1),
        vehicles=one(scenario.slot.size),
        at=one(0),
        vehicle_at=one(0),
        last=one(last),
        partner=one(partner),
        slot=scenario.slot.copy(),
        **{name: np.array(getattr(scenario, name), BODY_FIELDS[name]) for name in BODY_FIELDS.names or ()},
        **{name: getattr(scenario, name)[: last + 1].T.ravel() for name in _OF_FRAME},
    )


def _numbers_of(case_ids: Sequence[str]) -> NDArray[np.int64]:
    """Read seed and test from each case's name, shape (C, 2)."""
    numbers = np.empty((len(case_ids), 2), dtype=np.int64)
    for row, name in enumerate(case_ids):
        seed, _, test = name.partition(":")
        try:
            numbers[row] = int(seed), int(test)
        except ValueError:
            raise InputError(f"{name} is no name of a case; give seed:test, such as 1:204.") from None
    return numbers


def recordings_of_columns(
    *,
    names: NDArray[np.int64],
    frames: NDArray[np.int64],
    vehicles: NDArray[np.int64],
    last: NDArray[np.int64],
    slot: NDArray[np.int16],
    bv_slot: NDArray[Any],
    columns: dict[str, NDArray[Any]],
) -> Recordings:
    """Make recordings of columns in their order: find where each case begins, and its crash partner by the slot.

    Args:
        names: Seed and test of each case, shape (C, 2).
        frames, vehicles, last: As in `Recordings`.
        slot: As in `Recordings`.
        bv_slot: Name of the vehicle that the AV touched first, shape (C,).
        columns: Constants of each vehicle, `fields.BODY` by name, (V,) each, and series, `fields.SERIES`, (E,) each.
    """
    sizes = frames * vehicles
    vehicle_at = np.cumsum(vehicles) - vehicles
    case = np.repeat(np.arange(frames.size), vehicles)
    found = np.flatnonzero(slot == bv_slot[case])
    once = found[np.bincount(case[found], minlength=frames.size)[case[found]] == 1]
    partner = np.zeros(frames.size, dtype=np.int64)
    partner[case[once]] = once - vehicle_at[case[once]]
    return Recordings(
        seed=names[:, 0].copy(),
        test=names[:, 1].copy(),
        frames=frames,
        vehicles=vehicles,
        at=np.cumsum(sizes) - sizes,
        vehicle_at=vehicle_at,
        last=last,
        partner=partner,
        slot=slot,
        **columns,
    )
