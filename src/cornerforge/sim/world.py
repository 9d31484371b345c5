"""One world's state and constants, in the form that compiled kernels take."""

from __future__ import annotations

from dataclasses import astuple
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel
from cornerforge.drivers.avs import AV_KINDS, AvModel
from cornerforge.drivers.idm import IdmNumbers, IdmParams
from cornerforge.drivers.mobil import MobilNumbers, MobilParams
from cornerforge.drivers.policy import NO_POLICY, PolicyNumbers
from cornerforge.drivers.rss import RssNumbers
from cornerforge.geometry import Path
from cornerforge.types import MAX_LANES, Odd

__all__ = [
    "INFO_FIELDS",
    "VEHICLE",
    "AvNumbers",
    "RoadNumbers",
    "World",
    "all_current",
    "allocate_worlds",
    "av_numbers",
    "forget_av_neighbours",
    "list_all",
    "n_slots",
    "numbers_of_av",
    "path_of",
    "road_numbers",
]


VEHICLE = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("speed", "f8"),
        ("x_held", "f8"),
        ("speed_held", "f8"),
        ("lateral_speed", "f8"),
        ("heading", "f8"),
        ("acceleration", "f8"),
        ("clock", "f8"),
        ("duration", "f8"),
        ("c0", "f8"),
        ("c1", "f8"),
        ("c2", "f8"),
        ("c3", "f8"),
        ("c4", "f8"),
        ("c5", "f8"),
        ("target_lane", "i8"),
        ("lanes", "i8"),
        ("present", "i8"),
        ("action", "i8"),
    ]
)
"""One vehicle. A record array: a kernel passes one pointer instead of eighteen, which measured 30 times faster in
Numba.

x, y: box centre [m]; speed, lateral_speed: along and across the road [m/s]; x_held, speed_held: x and speed
when the present acceleration began; heading [rad]; acceleration: along the
road, held until the next decision [m/s2]; clock, duration: time since the start of the lane change and its planned
length [s], duration 0 means lane keeping; c0..c5: its quintic; target_lane: lane kept or changed to; lanes: bit mask
of the lanes occupied (`geometry.lane_bits`); present: 1 or 0; action: last decided index, -1 for none.
"""


class World(NamedTuple):
    """State of one world; with a leading axis `B` it is a batch of worlds.

    Attributes:
        vehicles: (N,) of VEHICLE; slot 0 is the AV.
        order: Slots by rising x, int64 (N,), the first info[N_VEHICLES] entries.
        current: Slots whose state is that of this moment, int64 (N,), the first info[N_CURRENT] entries: at decision
            times all that are present, within a second only those that somebody may touch or look at. The AV is the
            first; the first info[N_SEEN] are whom somebody may look at; both parts rise.
        info: int64 (INFO_FIELDS,): see the index constants below.
        words: Scratch: the random words with which each slot decides (`_philox.blocks`), uint64 (4, N).
    """

    vehicles: NDArray[np.void]
    order: NDArray[np.int64]
    current: NDArray[np.int64]
    info: NDArray[np.int64]
    words: NDArray[np.uint64]


N_VEHICLES, N_DECISIONS, CONTROLLED, OUTCOME, FRAME, SLOT_A, SLOT_B, N_BV_CRASHES, N_CURRENT, N_SEEN = range(10)
BUDGET_LEFT = 10
"""What is left of the adversary's likelihood budget, in millionths of a nat, plus 1; 0: no limit."""
AV_LEADS = 11
"""info[AV_LEADS + lane]: the one vehicle that can be the AV's nearest ahead in a lane until the end of the second, -1
for none, or UNKNOWN: then look at all."""
AV_REARS = AV_LEADS + MAX_LANES
"""info[AV_REARS + lane]: the same behind, where info[AV_LEADS + lane] is not UNKNOWN."""
AHEAD = AV_REARS + MAX_LANES
"""info[AHEAD + lane]: scratch, the rearmost vehicle so far of a walk from the front to the rear."""
INFO_FIELDS = AHEAD + MAX_LANES
UNKNOWN = -2

RUNNING, COMPLETED, AV_CRASH, BV_CRASH, TIME_UP = range(5)
"""Outcome codes. BV_CRASH ends a test only when the controlled BV takes part; others are counted and their vehicles
removed."""
AV_FAULT = 5
"""Outcome code of a test that an AV from outside spoiled (it raised, hung, or gave no usable answer): it is no test."""


class RoadNumbers(NamedTuple):
    """`Odd` as kernels take it; units as there."""

    n_lanes: int
    lane_width: float
    length: float
    width: float
    max_speed: float
    lane_change_duration: float
    max_lateral_acceleration: float
    test_length: float
    max_decisions: int
    av_start: float
    traffic_length: float
    av_substeps: int


class AvNumbers(NamedTuple):
    """The AV under test as kernels take it.

    Attributes:
        idm, mobil: Parameters of the built-in AV.
        sees_intentions: 1 if it takes a vehicle that is entering a lane for one that is in it, and gives way to one
        that
            enters its own target lane; 0 for the plain model that goes by lane centres.
    """

    idm: IdmNumbers
    mobil: MobilNumbers
    sees_intentions: int
    kind: int
    rss: RssNumbers
    network: PolicyNumbers


def n_slots(odd: Odd) -> int:
    """Vehicle slots per world: the AV and what fits on the road at the shortest spacings of the initial model."""
    return 1 + odd.n_lanes * int(np.ceil(odd.traffic_length / 40.0))


def road_numbers(odd: Odd) -> RoadNumbers:
    """Constants of an ODD for the kernels."""
    return RoadNumbers(
        odd.n_lanes,
        odd.lane_width,
        odd.vehicle_length,
        odd.vehicle_width,
        odd.max_speed,
        odd.lane_change_duration,
        odd.max_lateral_acceleration,
        odd.test_length,
        int(np.ceil(odd.time_limit)),
        odd.av_start,
        odd.traffic_length,
        odd.av_substeps,
    )


def av_numbers(idm: IdmParams, mobil: MobilParams, *, sees_intentions: bool) -> AvNumbers:
    """Constants of a plain AV, IDM and MOBIL, for the kernels."""
    return numbers_of_av(AvModel("", "", idm, mobil, sees_intentions))


def numbers_of_av(model: AvModel) -> AvNumbers:
    """Constants of a built-in AV for the kernels; a learned AV without its network drives nowhere but can be built."""
    network = NO_POLICY
    if model.network is not None:
        s = model.network.shape
        network = PolicyNumbers(model.network.weights, s.n_inputs, s.n_shared, s.n_stream, s.width)
    return AvNumbers(
        IdmNumbers(*astuple(model.idm)),
        MobilNumbers(*astuple(model.mobil)),
        int(model.sees_intentions),
        AV_KINDS[model.kind],
        RssNumbers(*astuple(model.rss)),
        network,
    )


def allocate_worlds(n_worlds: int, slots: int) -> World:
    """Zeroed state for a batch: arrays of shape (n_worlds, slots), (n_worlds, INFO_FIELDS) and (n_worlds, 4, slots)."""
    return World(
        np.zeros((n_worlds, slots), dtype=VEHICLE),
        np.zeros((n_worlds, slots), dtype=np.int64),
        np.zeros((n_worlds, slots), dtype=np.int64),
        np.zeros((n_worlds, INFO_FIELDS), dtype=np.int64),
        np.zeros((n_worlds, 4, slots), dtype=np.uint64),
    )


@inlined_kernel
def forget_av_neighbours(w: World) -> None:
    """Note that nothing is known about who is the AV's nearest in any lane."""
    for place in range(AV_LEADS, AV_REARS + MAX_LANES):
        w.info[place] = UNKNOWN


@inlined_kernel
def list_all(w: World) -> None:
    """Note that the state of every vehicle is that of this moment; what is known of the AV's neighbours stays."""
    found = 0
    for i in range(w.info[N_VEHICLES]):
        if w.vehicles[i].present:
            w.current[found] = i
            found += 1
    w.info[N_CURRENT] = found
    w.info[N_SEEN] = found


@inlined_kernel
def all_current(w: World) -> None:
    """Note that the state of every vehicle is that of this moment, for all to see."""
    list_all(w)
    forget_av_neighbours(w)


@inlined_kernel
def path_of(v: NDArray[np.void], i: int) -> Path:
    """Coefficients of vehicle i's lateral path."""
    return v[i].c0, v[i].c1, v[i].c2, v[i].c3, v[i].c4, v[i].c5
