"""One world's state and constants, in the form that compiled kernels take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.avs import AvModel, AvNumbers, numbers_of_av
from cornerforge.drivers.idm import IdmParams
from cornerforge.drivers.mobil import MobilParams
from cornerforge.drivers.sight import Sight
from cornerforge.geometry import Path
from cornerforge.types import CAR, CLASSES, FRAME_S, MAX_LANES, Odd

if TYPE_CHECKING:
    from cornerforge.road.straight import RoadNumbers

__all__ = [
    "SEEN",
    "STATE",
    "VEHICLE",
    "AvNumbers",
    "World",
    "all_current",
    "allocate_worlds",
    "arrays_of",
    "av_numbers",
    "forget_av_neighbours",
    "list_all",
    "moment_of",
    "n_slots",
    "numbers_of_av",
    "path_of",
    "world_of",
    "world_row",
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
        ("length", "f8"),
        ("width", "f8"),
        ("kind", "i8"),
        ("quantile", "f8"),
        ("habit", "f8"),
        ("desired_speed", "f8"),
        ("change_time", "f8"),
        ("signals", "i4"),
        ("away", "i4"),
        ("commanded", "f8"),
        ("acceleration_held", "f8"),
        ("noise", "f8"),
        ("inattention", "f8"),
        ("noticed", "i8"),
    ]
)
"""One vehicle. A record array passes a kernel one pointer, not one a field: measured 30 times faster in Numba.

x, y: box centre [m]; speed, lateral_speed: along and across the road [m/s]; x_held, speed_held: where, and at which
speed, the acceleration held now would have begun at the last decision (`sim.actions.hold`); heading [rad];
acceleration: along the road, as it is now [m/s2] (without a limit of jerk: as commanded, also where the vehicle
stands); clock, duration: time since the start of the lane change and its planned length [s], duration 0 means lane
keeping; c0..c5: its quintic; target_lane: lane kept or changed to; lanes: bit mask of the lanes occupied
(`road.straight.lane_bits`); present: 1 or 0; action: index of its last action, -1 for none; length, width: of its box
[m]; kind: its class, an index of `types.CLASSES`; quantile, habit: of its last acceleration among its own in the state
that it saw, and the quantile that it returns to (`ndd.model.Memory`), 0 to 1; desired_speed: its desired speed [m/s];
change_time: how long its undisturbed lane changes take [s]; signals: 1 if its driver sets the indicator before it
changes lanes; away: 1 if its driver looked away from the road in the last second; commanded, acceleration_held: the
acceleration that was decided last, and the one from which motion goes to it [m/s2]; noise: its driver's noise level
(`ndd.memory.own_rank`), -1 to 1; inattention: how many times as often as all drivers it begins to look away; noticed:
since when an AV with a flaw of perception knows of it, in tenths of a second since the start plus 1, 0 while it does
not.
"""


RUNNING, COMPLETED, AV_CRASH, BV_CRASH, TIME_UP = range(5)
"""Outcome codes. BV_CRASH ends a test only when the controlled BV takes part; others are counted and their vehicles
removed."""
AV_FAULT = 5
"""Outcome code of a test that does not count: an AV from outside raised, hung, or gave no usable answer in it."""
UNDRAWN = 7
"""Outcome code of a world with no traffic drawn at the start; `UndrawableError` ends the drive."""
IDLE = -1
"""Outcome code of a world that drives no test."""
NO_VEHICLE = -1
"""Slot number that stands for no vehicle."""
NO_ACTION = -1
"""Action index of a vehicle that has decided nothing, and of the AV."""
UNKNOWN = -2
"""Entry of `World.av_lead` and `World.av_rear` in a lane in which all vehicles must be looked at."""
MAX_BRANCH = 2**16 - 1

STATE = np.dtype(
    [
        ("seed", "i8"),
        ("test", "i8"),
        ("branch", "i8"),
        ("draw", "i8"),
        ("n_vehicles", "i8"),
        ("decisions", "i8"),
        ("substep", "i8"),
        ("controlled", "i8"),
        ("outcome", "i8"),
        ("frame", "i8"),
        ("slot_a", "i8"),
        ("slot_b", "i8"),
        ("bv_crashes", "i8"),
        ("bv_crashes_before", "i8"),
        ("budget_left", "i8"),
        ("n_current", "i8"),
        ("n_seen", "i8"),
        ("n_pairs", "i8"),
        ("av_has_answered", "i8"),
        ("av_lane", "i8"),
        ("bv_has_answered", "i8"),
        ("bv_action", "i8"),
        ("av_command", "f8"),
        ("travel", "f8"),
        ("av_steers", "i8"),
        ("av_curvature", "f8"),
        ("av_controls", "f8", (2 * round(1.0 / FRAME_S),)),
        ("av_alarmed", "i8"),
    ]
)
"""State of a world besides its vehicles.

seed, test: name of the test; branch: number of the future that the random words belong to (0: the test's own);
draw: next unused draw of the initial traffic; n_vehicles: slots in use; decisions: seconds begun; substep: tenths of
the running second that are over, 0 between seconds; controlled: slot of the BV that an adversary controls in this
second, NO_VEHICLE for none; outcome, frame, slot_a, slot_b: how the test ended, in which frame, and the slots in
contact; bv_crashes: crashes between BVs so far, bv_crashes_before: the same when the second began; budget_left: the
rest of the adversary's likelihood budget, in millionths of a nat, plus 1 (0: no limit); n_current, n_seen, n_pairs: how
much of `current` and of the pairs is in use; av_has_answered, av_command [m/s2], av_lane (target lane): the answer of
an AV outside; bv_has_answered, bv_action: the answer for a BV controlled from outside; travel: distance that the
counted BVs drove [m]; av_steers: 1 if the AV outside answers by steering (`bicycle`); av_curvature: of its way now, to
the left positive [1/m]; av_controls: its answer, an acceleration [m/s2] and a curvature [1/m] for each tenth of a
second until it answers again; av_alarmed: when a reference driver saw the danger that it reacts to, in tenths of a
second since the start plus 1, 0 while it reacts to none.
"""


class World(NamedTuple):
    """All that the future of one world depends on; with a leading axis `B` it is a batch of worlds.

    Attributes:
        vehicles: (N,) of VEHICLE; slot 0 is the AV.
        state: (1,) of STATE.
        order: Slots by rising x, int64 (N,), the first `state.n_vehicles` entries.
        current: Slots of the vehicles with the state of this moment, int64 (N,), the first `state.n_current` entries:
            at decision times all that are present, within a second only vehicles that another may touch or look at. The
            AV comes first; the first `state.n_seen` may be looked at; slots rise within both parts.
        pair_a, pair_b: Slots of the pairs that can touch within the running second, int16 (N (N - 1) / 2,), room for
            all pairs; the first `state.n_pairs` entries; a < b.
        av_lead, av_rear: For each lane the only vehicle that can be the AV's nearest ahead or behind until the end of
            the second, int64 (MAX_LANES,), NO_VEHICLE for none; where `av_lead` is UNKNOWN all must be looked at.
        seen: Each BV's state at the last decision time, for counting, (N,) of SEEN.
    """

    vehicles: NDArray[np.void]
    state: NDArray[np.void]
    order: NDArray[np.int64]
    current: NDArray[np.int64]
    pair_a: NDArray[np.int16]
    pair_b: NDArray[np.int16]
    av_lead: NDArray[np.int64]
    av_rear: NDArray[np.int64]
    seen: NDArray[np.void]


SEEN = np.dtype(
    [("x", "f8"), ("y", "f8"), ("speed", "f8"), ("lateral_speed", "f8"), ("lanes", "i8"), ("as_what", "i8")]
)
"""A vehicle at the last decision time, for `statistics.count_choices`: position along and across the road [m], speeds
along and across it [m/s], its lanes as a bit mask, and whether it is counted as following, as free, or not at all."""


def n_slots(odd: Odd | RoadNumbers) -> int:
    """Compute the vehicle slots per world: the AV, and one vehicle every 40 m of traffic in each lane."""
    return 1 + odd.n_lanes * int(np.ceil(odd.traffic_length / 40.0))


def av_numbers(idm: IdmParams, mobil: MobilParams, sight: Sight) -> AvNumbers:
    """Make the constants of a plain AV (IDM and MOBIL) for the kernels."""
    return numbers_of_av(AvModel("", "", idm, mobil, sight))


def allocate_worlds(n_worlds: int, slots: int) -> World:
    """Allocate a batch of idle worlds: arrays with a leading axis of `n_worlds`, `slots` vehicles each, all cars."""
    worlds = World(
        vehicles=np.zeros((n_worlds, slots), dtype=VEHICLE),
        state=np.zeros((n_worlds, 1), dtype=STATE),
        order=np.zeros((n_worlds, slots), dtype=np.int64),
        current=np.zeros((n_worlds, slots), dtype=np.int64),
        pair_a=np.zeros((n_worlds, slots * (slots - 1) // 2), dtype=np.int16),
        pair_b=np.zeros((n_worlds, slots * (slots - 1) // 2), dtype=np.int16),
        av_lead=np.zeros((n_worlds, MAX_LANES), dtype=np.int64),
        av_rear=np.zeros((n_worlds, MAX_LANES), dtype=np.int64),
        seen=np.zeros((n_worlds, slots), dtype=SEEN),
    )
    worlds.state["outcome"] = IDLE
    worlds.vehicles["length"], worlds.vehicles["width"] = CLASSES[CAR].length, CLASSES[CAR].width
    return worlds


@kernel
def world_row(worlds: World, b: int) -> World:
    """Take world b of a batch, as views."""
    return World(
        worlds.vehicles[b],
        worlds.state[b],
        worlds.order[b],
        worlds.current[b],
        worlds.pair_a[b],
        worlds.pair_b[b],
        worlds.av_lead[b],
        worlds.av_rear[b],
        worlds.seen[b],
    )


def world_of(worlds: World, b: int = 0) -> World:
    """Take world b of a batch, as views; `world_row` for Python."""
    return World._make(array[b] for array in worlds)


def arrays_of(worlds: World) -> dict[str, NDArray[Any]]:
    """List the arrays of a world or a batch by name, as views; records as bytes."""
    return {name: array.view(np.uint8) if array.dtype.names else array for name, array in worlds._asdict().items()}


@inlined_kernel
def moment_of(w: World) -> int:
    """Compute the `step` of the coming decision's random words (`_philox.block`): its number and the world's branch."""
    state = w.state[0]
    moment: int = state.decisions | (state.branch << 16)
    return moment


@inlined_kernel
def forget_av_neighbours(w: World) -> None:
    """Note that the AV's nearest vehicles are UNKNOWN in every lane."""
    for lane in range(w.av_lead.size):
        w.av_lead[lane] = UNKNOWN
        w.av_rear[lane] = UNKNOWN


@inlined_kernel
def list_all(w: World) -> None:
    """Note that the state of every vehicle is current; what is known of the AV's neighbours stays."""
    state = w.state[0]
    found = 0
    for i in range(state.n_vehicles):
        if w.vehicles[i].present:
            w.current[found] = i
            found += 1
    state.n_current = found
    state.n_seen = found


@inlined_kernel
def all_current(w: World) -> None:
    """Note that the state of every vehicle is current, and that the AV's neighbours are UNKNOWN."""
    list_all(w)
    forget_av_neighbours(w)


@inlined_kernel
def path_of(v: NDArray[np.void], i: int) -> Path:
    """Take the coefficients of vehicle i's lateral path."""
    return v[i].c0, v[i].c1, v[i].c2, v[i].c3, v[i].c4, v[i].c5
