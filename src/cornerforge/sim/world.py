"""One world's state and constants, in the form that compiled kernels take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.outcome import IDLE
from cornerforge.site.tables import slots_at
from cornerforge.types import CAR, CLASSES, MAX_LANES, SUBSTEPS, Odd

if TYPE_CHECKING:
    from cornerforge.road.straight import RoadNumbers

__all__ = [
    "AGENT",
    "ALL_OF_THEM",
    "AV",
    "COMES",
    "GONE",
    "HERE",
    "SEEN",
    "STATE",
    "VEHICLE",
    "World",
    "all_current",
    "allocate_like",
    "allocate_worlds",
    "forget_av_neighbours",
    "list_all",
    "moment_of",
    "n_slots",
    "world_of",
    "world_row",
]


def _record(*fields: tuple[str, str, str]) -> np.dtype[np.void]:
    """Make a record of fields: name, type, meaning. Kernels pass it as one pointer: 30 times faster than arrays."""
    return np.dtype([(name, kind) for name, kind, _ in fields])


VEHICLE = _record(
    ("x", "f8", "box centre along the road [m]"),
    ("y", "f8", "box centre across the road [m]"),
    ("speed", "f8", "along the road [m/s]"),
    ("x_held", "f8", "where the acceleration held now would have begun at the last decision (`actions.hold`) [m]"),
    ("speed_held", "f8", "speed at `x_held` [m/s]"),
    ("lateral_speed", "f8", "across the road [m/s]"),
    ("heading", "f8", "[rad]"),
    ("acceleration", "f8", "along the road, now [m/s2]; without a limit of jerk as commanded, also where it stands"),
    ("clock", "f8", "time since its lane change began [s]"),
    ("duration", "f8", "planned length of its lane change [s]; 0: it keeps its lane"),
    ("c0", "f8", "c0 to c5: the quintic of its lane change"),
    *((f"c{power}", "f8", "") for power in range(1, 6)),
    ("target_lane", "i8", "lane kept or changed to"),
    ("lanes", "i8", "lanes occupied, a bit mask (`road.straight.lane_bits`)"),
    ("present", "i8", "1 or 0"),
    ("action", "i8", "index of its last action; NO_ACTION for none"),
    ("length", "f8", "of its box [m]"),
    ("width", "f8", "of its box [m]"),
    ("kind", "i8", "its class, an index of `types.CLASSES`"),
    ("quantile", "f8", "of its last acceleration among its own in the state that it saw, 0 to 1 (`ndd.model.Memory`)"),
    ("habit", "f8", "the quantile that it returns to, 0 to 1"),
    ("desired_speed", "f8", "[m/s]"),
    ("change_time", "f8", "how long its undisturbed lane changes take [s]"),
    (
        "signals",
        "i4",
        "1 if its driver sets the indicator before it changes lanes, plus `road.lanes.EXITS` if it takes the exit",
    ),
    ("away", "i4", "1 if its driver looked away from the road in the last second"),
    ("commanded", "f8", "the acceleration that was decided last [m/s2]"),
    ("acceleration_held", "f8", "the acceleration from which motion goes to `commanded` [m/s2]"),
    ("noise", "f8", "its driver's noise level, -1 to 1 (`ndd.memory.own_rank`)"),
    ("inattention", "f8", "how many times as often as all drivers it begins to look away"),
)
"""One vehicle."""


NO_VEHICLE = -1
"""Slot number that stands for no vehicle."""
NO_ACTION = -1
"""Action index of a vehicle that has decided nothing, and of the AV."""
UNKNOWN = -2
"""The AV's `lead` and `rear` in a lane in which all vehicles must be looked at."""
MAX_BRANCH = 2**16 - 1

STATE = _record(
    ("seed", "i8", "seed and test: name of the test"),
    ("test", "i8", ""),
    ("branch", "i8", "number of the future that the random words belong to; 0: the test's own"),
    ("draw", "i8", "next unused draw of the initial traffic"),
    ("n_vehicles", "i8", "slots in use"),
    ("decisions", "i8", "seconds begun"),
    ("substep", "i8", "tenths of the running second that are over; 0 between seconds"),
    ("controlled", "i8", "slot of the BV that an adversary controls in this second; NO_VEHICLE for none"),
    ("outcome", "i8", "how the test stands, or ended"),
    ("frame", "i8", "frame in which it ended"),
    ("slot_a", "i8", "slot_a and slot_b: slots in contact"),
    ("slot_b", "i8", ""),
    ("bv_crashes", "i8", "crashes between BVs so far"),
    ("bv_crashes_before", "i8", "the same when the second began"),
    ("budget_left", "i8", "rest of the adversary's likelihood budget, millionths of a nat, plus 1; 0: no limit"),
    ("budget_most", "i8", "what a budget of excess fills up to again, in the same units; 0: it is one of shortfalls"),
    ("steers_from", "i8", "second from which an adversary controls a BV"),
    ("n_current", "i8", "how much of `current` is in use"),
    ("n_seen", "i8", "how much of `current` the AV may look at"),
    ("n_pairs", "i8", "how many pairs are in use"),
    ("bv_has_answered", "i8", "1 once a program outside has answered for the critical BV"),
    ("bv_action", "i8", "that answer"),
    ("hidden", "i8", "slot of the BV that an adversary makes the AV lose in this second; NO_VEHICLE for none"),
    ("travel", "f8", "distance that the counted BVs drove [m]"),
    ("clock", "f8", "time of a site's signals when the test began [s]"),
)
"""What a world is besides its vehicles."""

COMES, HERE, GONE = range(3)
"""Stages of an agent: it has not come yet; it is there; it has left."""
ALL_OF_THEM = -2
"""In `AGENT.overlooks`: it looks at none."""
AGENT = _record(
    ("s", "f8", "box centre along its route [m]"),
    ("route", "i8", "index of its route"),
    ("stage", "i8", "COMES, HERE or GONE"),
    ("marks", "i8", "what it is like and has decided, a bit mask (`site.claims`)"),
    ("enters", "f8", "when it comes, since the start [s]"),
    (
        "headway",
        "f8",
        "its factor of the time gap that it keeps; of a person, how long it waits for a gap on Don't Walk"
        " [s]; 0: it takes none",
    ),
    ("gaps", "f8", "its factor of critical gaps"),
    ("manners", "f8", "its factor of the gap left to people; of a person, to vehicles"),
    ("cleared", "f8", "it has decided to go as far as this along its route [m]"),
    ("overlooks", "i8", "slot that it overlooks; NO_VEHICLE; ALL_OF_THEM"),
    ("heeds", "i8", "slot that it has given way to last; NO_VEHICLE"),
    ("resumes", "f8", "it waits so long behind those that it has let go, since the start [s]"),
    ("free", "f8", "acceleration with which it goes; of a person the speed [m/s2, m/s]"),
    ("stops", "f8", "acceleration with which it gives way; of a person the speed [m/s2, m/s]"),
    ("most", "f8", "it accelerates no more, so as not to run into what is ahead [m/s2]"),
    ("chooses", "i8", "1 if it has to choose between going and giving way"),
    ("goes", "f8", "chance that it goes, where it chooses"),
    ("for_whom", "i8", "slot because of which it chooses; NO_VEHICLE: a light"),
    ("until", "f8", "how far it would have decided to go [m]"),
    ("ratio", "f8", "to whoever looks at the moment: the gap before it over the critical gap"),
    ("begins", "f8", "and where the zone with it begins along that one's route [m]"),
    ("kept", "f8", "its `s` while the world is as the AV perceives it, else 0 [m]"),
    ("unseen", "i8", "1 if to go would mean that it overlooks `for_whom`"),
    ("lets_av", "i8", "bit k is 1 if it lets the AV go first in their k-th zone, since the second began"),
)
"""One vehicle or person at a site. From `free` on: how it saw the world at the last decision."""

AV = _record(
    ("lead", f"({MAX_LANES},)i8", "for each lane the only vehicle that can be its nearest ahead until the second's end;"
        " NO_VEHICLE for none; UNKNOWN: all must be looked at"),
    ("rear", f"({MAX_LANES},)i8", "the same behind; it means nothing where `lead` is UNKNOWN"),
    ("has_answered", "i8", "1 once a program outside has answered for it"),
    ("lane", "i8", "target lane of that answer"),
    ("command", "f8", "acceleration of that answer [m/s2]"),
    ("steers", "i8", "1 if the program outside steers (`bicycle`)"),
    ("curvature", "f8", "of its way now, to the left positive [1/m]"),
    ("controls", f"({2 * SUBSTEPS},)f8", "the answer of a program that steers: acceleration [m/s2] and"
        " curvature [1/m] for each tenth of a second until it answers again"),
    ("alarmed", "i8", "when a reference driver saw the danger that it reacts to, in tenths of a second since the start"
        " plus 1; 0: it reacts to none; or since when an AV stands that stops where its lane ends"),
)  # fmt: skip
"""What a world knows of its AV besides its motion."""


class World(NamedTuple):
    """All that the future of one world depends on; with a leading axis `B` it is a batch of worlds.

    Attributes:
        vehicles: (N,) of VEHICLE; slot 0 is the AV.
        state: (1,) of STATE.
        av: (1,) of AV.
        noticed: Since when an AV with a flaw of perception knows of each vehicle, in tenths of a second since the start
            plus 1, int64 (N,); 0: it does not.
        order: Slots by rising x, int64 (N,), the first `state.n_vehicles` entries.
        current: Slots of the vehicles with the state of this moment, int64 (N,), the first `state.n_current` entries:
            at decision times all that are present, within a second only vehicles that another may touch or look at. The
            AV comes first; the first `state.n_seen` may be looked at; slots rise within both parts.
        pairs: Slots of the pairs that can touch within the running second, int16 (N (N - 1) / 2, 2), room for all
            pairs; the first `state.n_pairs` rows; the smaller slot first.
        seen: Each BV's state at the last decision time, for counting, N of SEEN. For an AV that sees late K times N
            more follow: where all were in the last K tenths of a second, tenth t in part t mod K.
        agents: What is known of each vehicle and person at a site, (N,) of AGENT; (0,) on a road.
    """

    vehicles: NDArray[np.void]
    state: NDArray[np.void]
    av: NDArray[np.void]
    noticed: NDArray[np.int64]
    order: NDArray[np.int64]
    current: NDArray[np.int64]
    pairs: NDArray[np.int16]
    seen: NDArray[np.void]
    agents: NDArray[np.void]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """List the arrays of this world or batch by name, as views; records as bytes."""
        return {name: array.view(np.uint8) if array.dtype.names else array for name, array in self._asdict().items()}


SEEN = _record(
    ("x", "f8", "along the road [m]"),
    ("y", "f8", "across it [m]"),
    ("speed", "f8", "along it [m/s]"),
    ("lateral_speed", "f8", "across it [m/s]"),
    ("lanes", "i8", "as `VEHICLE` has them"),
    (
        "as_what",
        "i8",
        "whether it is counted as following, as free, or not at all; of the past: whether it changes lanes",
    ),
    ("heading", "f8", "[rad]; of the past only, as the rest"),
    ("acceleration", "f8", "along the road [m/s2]"),
    ("target_lane", "i8", "lane kept or changed to"),
)
"""A vehicle at the last decision time, for `statistics.count_choices`, or some tenths of a second ago."""


def n_slots(road: Odd | RoadNumbers) -> int:
    """Compute the vehicle slots per world: the AV, and one vehicle every `spacing` of traffic in each lane.

    At a site: the AV, and as many as come in a test and its warm-up, but in one of 1e9.
    """
    if isinstance(road, Odd):
        if road.site is not None and road.demand is not None:
            return slots_at(road.site, road.demand, road.time_limit)
    elif road.site.size:
        return int(road.site[0]["slots"])
    return 1 + road.n_lanes * int(np.ceil(road.traffic_length / road.spacing))


def allocate_worlds(n_worlds: int, slots: int, road: RoadNumbers | None = None) -> World:
    """Allocate a batch of idle worlds: arrays with a leading axis of `n_worlds`, `slots` vehicles each, all cars.

    `road`: of the tests, a site too; None: a road on which the AV sees at once.
    """
    if road is None:
        return allocate_like(n_worlds, slots)
    return allocate_like(n_worlds, slots, int(road.perception.late), slots if road.site.size else 0)


def allocate_like(n_worlds: int, slots: int, late: int = 0, agents: int = 0) -> World:
    """Allocate as `allocate_worlds` for an AV that sees so late [0.1 s], and with so many agents of a site."""
    worlds = World(
        vehicles=np.zeros((n_worlds, slots), dtype=VEHICLE),
        state=np.zeros((n_worlds, 1), dtype=STATE),
        av=np.zeros((n_worlds, 1), dtype=AV),
        noticed=np.zeros((n_worlds, slots), dtype=np.int64),
        order=np.zeros((n_worlds, slots), dtype=np.int64),
        current=np.zeros((n_worlds, slots), dtype=np.int64),
        pairs=np.zeros((n_worlds, slots * (slots - 1) // 2, 2), dtype=np.int16),
        seen=np.zeros((n_worlds, slots * (late + 2 if late else 1)), dtype=SEEN),
        agents=np.zeros((n_worlds, agents), dtype=AGENT),
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
        worlds.av[b],
        worlds.noticed[b],
        worlds.order[b],
        worlds.current[b],
        worlds.pairs[b],
        worlds.seen[b],
        worlds.agents[b],
    )


def world_of(worlds: World, b: int = 0) -> World:
    """Take world b of a batch, as views; `world_row` for Python."""
    return World._make(array[b] for array in worlds)


@inlined_kernel
def moment_of(w: World) -> int:
    """Compute the `step` of the coming decision's random words (`_philox.block`): its number and the world's branch."""
    state = w.state[0]
    moment: int = state.decisions | (state.branch << 16)
    return moment


@inlined_kernel
def forget_av_neighbours(w: World) -> None:
    """Note that the AV's nearest vehicles are UNKNOWN in every lane."""
    av = w.av[0]
    for lane in range(MAX_LANES):
        av.lead[lane] = UNKNOWN
        av.rear[lane] = UNKNOWN


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
