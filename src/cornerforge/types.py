"""The data that flows through cornerforge: frozen, struct-of-arrays, no behaviour.

Shapes: `T` frames (0.1 s apart), `K` decisions (1 s apart), `N` vehicle slots (slot 0 is the AV), `A` = 33 actions.
Axes: x along the road, y to the left from the right road edge, headings counter-clockwise from the road's direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from cornerforge._checks import check_in, check_integer, check_number
from cornerforge._schema import check_fields, meant, read
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.perception import Perception
from cornerforge.road.network import Road, faults_of
from cornerforge.site import tables
from cornerforge.site.laws import Demand, Laws
from cornerforge.site.network import Site

__all__ = [
    "ACCELERATIONS",
    "ACTIONS",
    "ACTION_LEFT",
    "ACTION_RIGHT",
    "CAR",
    "CLASSES",
    "FRAME_S",
    "METRES_PER_MILE",
    "MOTORCYCLE",
    "N_ACTIONS",
    "ODDS",
    "PERSON",
    "TRUCK",
    "Action",
    "Crash",
    "Odd",
    "RoadUser",
    "Scenario",
    "odd_named",
]

FRAME_S = 0.1
"""Length of one physics substep and of one recorded frame [s]."""
SUBSTEPS = round(1.0 / FRAME_S)
"""Substeps in a second, from one decision of the BVs to the next."""

METRES_PER_MILE = 1609.344
ACCELERATION_STEP = tables.ACCELERATION_STEP


@dataclass(frozen=True)
class RoadUser:
    """A class of road users.

    Attributes:
        name: As on pages and in files.
        length, width: Of its box [m].
        braking: Hardest braking [m/s2].
        power: At the wheels, by mass [W/kg]; inf: no limit of acceleration.
        resistance: Braking by air and tyres on the level [m/s2]: power / speed - resistance is the strongest
            acceleration.
        top_speed: Its drivers do not accelerate at this speed and above [m/s].
        time_gap: Of a follower at the start, in parts of a car's.
    """

    name: str
    length: float = field(metadata={"unit": "m"})
    width: float = field(metadata={"unit": "m"})
    braking: float = field(default=math.inf, metadata={"unit": "m/s2"})
    power: float = field(default=math.inf, metadata={"unit": "W/kg"})
    resistance: float = field(default=0.0, metadata={"unit": "m/s2"})
    top_speed: float = field(default=math.inf, metadata={"unit": "m/s"})
    time_gap: float = 1.0


CLASSES: tuple[RoadUser, ...] = (
    RoadUser("car", 5.0, 2.0),
    RoadUser("truck", 16.5, 2.55, braking=3.3, power=10.8, resistance=0.17, top_speed=33.1, time_gap=1.8),
    RoadUser("motorcycle", 2.2, 0.8),
    RoadUser("person", 0.6, 0.6),
)
"""Classes of road users by code.

A car has the size that the ODD gives (`vehicle_length`, `vehicle_width`; here the paper's), a truck the largest that
Directive 96/53/EC allows an articulated one, a motorcycle a common size. All drive by the same model, which was fitted
mostly to cars; a natural driver's accelerations are cut to what its vehicle can do. Sources of a truck's limits, and
what they leave out: docs/adr/0028-trucks.md.
"""
CAR, TRUCK, MOTORCYCLE, PERSON = range(len(CLASSES))

MAX_LANES = 6
"""Most lanes that an ODD may have."""


class Action(NamedTuple):
    """An action that a vehicle can choose for the next second.

    Attributes:
        name: Its name on pages.
        side: Side of its lane change: 1 left, -1 right, 0 no change.
        acceleration: Acceleration that it holds [m/s2]; 0 for a lane change, which holds the speed.
    """

    name: str
    side: int
    acceleration: float


ACTIONS: tuple[Action, ...] = (
    Action("change to the left", 1, 0.0),
    Action("change to the right", -1, 0.0),
    *(Action(f"{a:+.1f} m/s²", 0, a) for a in np.round(np.arange(31) * ACCELERATION_STEP - 4.0, 1).tolist()),
)
"""All actions by their index: lane changes first, then accelerations -4.0, -3.8, ..., 2.0. Files hold these indices.

The constants below are made from this table. Kernels take the arrays, which they can index.
"""
N_ACTIONS = len(ACTIONS)
_SIDES = [action.side for action in ACTIONS]
ACTION_SIDES: NDArray[np.int64] = np.array(_SIDES, dtype=np.int64)
"""Side of each action: 1 left, -1 right, 0 keeps the lane, shape (33,)."""
ACTION_ACCELERATIONS: NDArray[np.float64] = np.array([action.acceleration for action in ACTIONS])
"""Acceleration that each action holds [m/s2], shape (33,)."""
ACTION_LEFT, ACTION_RIGHT = _SIDES.index(1), _SIDES.index(-1)
FIRST_ACCELERATION = _SIDES.index(0)
"""Index of the hardest braking. The indices below are lane changes; all from there on are accelerations."""
ACCELERATIONS: NDArray[np.float64] = ACTION_ACCELERATIONS[FIRST_ACCELERATION:].copy()
"""Acceleration of action index FIRST_ACCELERATION + i [m/s2], shape (31,)."""
N_ACCELERATIONS = len(ACCELERATIONS)
LOWEST_COMMAND, HIGHEST_COMMAND = -8.0, 2.0
"""Limits to which the commands of an AV outside the kernels are cut [m/s2]."""
ACTION_HOLD = ACTIONS.index(Action("+0.0 m/s²", 0, 0.0))
"""Index of acceleration 0."""


TRAFFIC = {"free": 40.0, "dense": 15.0, "queue": 8.0}
"""Kinds of traffic, and for each the distance of vehicles in a lane, in the mean, for which a world has room [m]
(docs/adr/0078-traffic-that-stops.md)."""
QUEUE_FROM, QUEUE_TO = 250.0, 330.0
"""Where the end of a queue is at the start, ahead of the AV [m]: farther than drivers see."""
LATER = {
    "truck_share": 0.0, "motorcycle_share": 0.0, "ignored_rear": 0.0, "same_duration": False, "slower_right": 0.0,
    "max_jerk": math.inf, "road": None, "road_at": 0.0, "task": "through", "traffic": "free",
    "perception": None, "site": None, "laws": None, "demand": None,
}  # fmt: skip
"""Fields of an ODD that files may lack, and what they are there."""


@dataclass(frozen=True)
class Odd:
    """Operational design domain: what is constant in a run (paper: theta).

    Raises:
        InputError: A field is outside its range, the AV starts beyond the `traffic_length`, or the shares of classes
            are too large together.
    """

    name: Annotated[str, Meta(max_length=200, description="What it is called.")] = "default"
    n_lanes: Annotated[int, meant("Lanes in the direction of travel; lane 0 is the rightmost.", "", 2, MAX_LANES)] = 3
    lane_width: Annotated[float, meant("Of all lanes; 3.66 m: 12 feet, as on US motorways.", "m", 2.5, 6)] = 3.66
    vehicle_length: Annotated[float, meant("Length of the AV, and of cars.", "m", 2, 20)] = 5.0
    vehicle_width: Annotated[float, meant("Width of the AV, and of cars.", "m", 1, 2.6)] = 2.0
    max_speed: Annotated[float, meant("Largest speed of any vehicle.", "m/s", 10, 80)] = 40.0
    lane_change_duration: Annotated[
        float, meant("How long an undisturbed lane change takes; of BVs see `same_duration`.", "s", 0.5, 10)
    ] = 4.0
    max_lateral_acceleration: Annotated[float, meant("No lane change has more.", "m/s2", 1, 1000)] = 4.0
    test_length: Annotated[float, meant("The drive ends when the AV has come so far.", "m", 10, 1e5)] = 400.0
    time_limit: Annotated[float, meant("The drive ends after this time.", "s", 1, 3600)] = 60.0
    av_start: Annotated[
        float, meant("Where the AV starts on the `traffic_length` that is filled with traffic.", "m", 0, 5000)
    ] = 240.0
    traffic_length: Annotated[
        float, meant("Stretch with traffic; it makes room for a vehicle every 40 m in each lane.", "m", 50, 5000)
    ] = 640.0
    av_substeps: Annotated[
        int, meant("Physics substeps (0.1 s) between two decisions of the AV; 10: once a second, as BVs.", "", 1, 10)
    ] = 1
    truck_share: Annotated[float, meant("Share of trucks among the BVs; in a lane the more, the farther right it is "
        "(`road.straight.truck_share_in`).", "", 0, 0.5)] = 0.0  # fmt: skip
    motorcycle_share: Annotated[float, meant("Share of motorcycles; other BVs and the AV are cars.", "", 0, 1)] = 0.0
    ignored_rear: Annotated[float, meant("Chance that a BV which wants to change lanes ignores the vehicle behind it "
        "there, `IGNORED_FROM` or more away.", "", 0, 1)] = 0.0  # fmt: skip
    same_duration: Annotated[bool, meant("All lane changes take `lane_change_duration`, even if the naturalistic model "
        "gives every BV a time of its own.")] = False  # fmt: skip
    slower_right: Annotated[float, meant("How much slower traffic flows in the rightmost lane than in the leftmost; "
        "even steps between, the mean stays.", "m/s", 0, 10)] = 0.0  # fmt: skip
    max_jerk: Annotated[float, meant("How fast an acceleration goes to the commanded one; inf, in files absent: at "
        "once. 12.65: that of UN R157's careful driver.", "m/s3", 0.5, 1000)] = 12.65  # fmt: skip
    road: Annotated[Road | None, meant("The road, if lanes begin or end along it, or it has curves; `n_lanes` and "
        "`lane_width` are its own.")] = None  # fmt: skip
    road_at: Annotated[float, meant("Place of the road at which x is 0.", "m", -1e5, 1e6)] = 0.0
    task: Annotated[str, meant("What the AV is to do: drive through, come from the ramp, or take the exit.",
        choices=("through", "ramp", "exit"))] = "through"  # fmt: skip
    traffic: Annotated[str, meant("How the others drive: freely at 20 to 40 m/s, densely, or freely up to the end of "
        "a queue ahead.", choices=tuple(TRAFFIC))] = "free"  # fmt: skip
    perception: Annotated[Perception | None, meant("What the AV perceives; missing: everything, at once.")] = None
    site: Annotated[Site | None, meant("The junction, instead of a road.")] = None
    laws: Annotated[Laws | None, meant("How people drive and walk at the site.")] = None
    demand: Annotated[Demand | None, meant("How many vehicles and people come to the site.")] = None

    def __post_init__(self) -> None:
        check_integer("lanes", self.n_lanes, low=2, high=MAX_LANES)
        check_fields(self, "odd.", but=("max_jerk",) if self.max_jerk == math.inf else ())
        check_number("odd.av_start", self.av_start, low=0.0, high=self.traffic_length, unit="m")
        check_number("odd.motorcycle_share", self.motorcycle_share, low=0.0, high=1.0 - 2.0 * self.truck_share)
        check_in("odd.traffic", self.traffic, tuple(TRAFFIC))
        if self.traffic == "queue":
            least = self.av_start + QUEUE_TO
            check_number("odd.traffic_length, for a queue,", self.traffic_length, low=least, high=5000.0, unit="m")
        self._check_road()
        if not (self.site is None) == (self.laws is None) == (self.demand is None):
            raise InputError("odd.site, odd.laws and odd.demand belong together; give all of them or none.")
        for one in fields(self):
            if isinstance(one.default, float):  # kernels would be compiled once more for a whole number
                object.__setattr__(self, one.name, float(getattr(self, one.name)))

    def _check_road(self) -> None:
        check_in("odd.task", self.task, ("through", "ramp", "exit"))
        if self.road is None:
            if self.task != "through":
                raise InputError(
                    f"odd.task = {self.task!r} needs a road with a ramp; name one: on-ramp, exit, weaving."
                )
            return
        if faults := faults_of(self.road):
            raise InputError(f"The road {self.road.name}: {'; '.join(faults)}.")
        if (self.n_lanes, self.lane_width) != (self.road.slots, self.road.lane_width):
            raise InputError(
                f"The road {self.road.name} has {self.road.slots} lanes of {self.road.lane_width:g} m, the ODD "
                f"{self.n_lanes} of {self.lane_width:g} m."
            )

    def stated(self) -> dict[str, Any]:
        """All fields, for files and hashes; what does not occur is left out, as before it could, and so is no limit.

        >>> "truck_share" in Odd().stated(), "truck_share" in Odd(truck_share=0.1).stated()
        (False, True)
        """
        return {name: value for name, value in asdict(self).items() if name not in LATER or value != LATER[name]}

    @staticmethod
    def of_stated(stated: Mapping[str, Any]) -> Odd:
        """Make the ODD of which `stated` gave the fields; what is left out does not occur, also in early files.

        >>> Odd.of_stated(Odd().stated()) == Odd(), Odd.of_stated({"name": "early"}).max_jerk
        (True, inf)
        """
        given = {"max_jerk": math.inf, **stated}
        if isinstance(given.get("road"), Mapping):
            given["road"] = read(Road, given["road"], "The road")
        for name, kind in (("perception", Perception), ("site", Site), ("laws", Laws), ("demand", Demand)):
            if isinstance(given.get(name), Mapping):
                given[name] = read(kind, given[name], f"The {name}")
        return Odd(**given)

    def size_of(self, kind: int) -> tuple[float, float]:
        """Length and width of a class [m], by its index in `CLASSES`."""
        return (self.vehicle_length, self.vehicle_width) if kind == CAR else (CLASSES[kind].length, CLASSES[kind].width)

    @property
    def spacing(self) -> float:
        """Distance of vehicles in a lane, in the mean, for which a world has room [m]."""
        return TRAFFIC[self.traffic]

    @property
    def sizes_on_road(self) -> list[tuple[float, float]]:
        """Length and width [m] of the classes that may occur."""
        shares = (1.0, self.truck_share, self.motorcycle_share)
        return [self.size_of(kind) for kind, share in enumerate(shares) if share > 0.0]


ODDS: dict[str, Odd] = {
    "default": Odd(),
    "swift": Odd(name="swift", lane_change_duration=2.5, same_duration=True),
    "paper": Odd(
        name="paper",
        lane_width=4.0,
        lane_change_duration=1.0,
        max_lateral_acceleration=1e3,
        av_start=400.0,
        traffic_length=1200.0,
        av_substeps=10,
        ignored_rear=0.01,
        same_duration=True,
        max_jerk=math.inf,
    ),
    "mixed": Odd(name="mixed", truck_share=0.1, motorcycle_share=0.01, slower_right=2.0),
}
"""The built-in ODDs by name. They differ in how long a lane change takes, how often the AV decides, how much traffic
surrounds it at the start, and in the classes of the vehicles. In `mixed` one vehicle in ten is a truck and one in a
hundred a motorcycle: US highways have a tenth and 0.6 % by miles driven, highD's motorways a fifth of trucks; lanes
to the right have more trucks and are slower (docs/adr/0028-trucks.md). In
`paper` lanes are 4 m wide and one change in a hundred ignores the vehicle behind: the paper says nothing of either, the
code that its group released does."""

IGNORED_FROM = 5.0
"""Nearest gap to a vehicle behind [m] at which a change may ignore it (`Odd.ignored_rear`)."""


def odd_named(name: str) -> Odd:
    """Look up a built-in ODD.

    Raises:
        UnknownNameError: No ODD has that name.

    >>> odd_named("swift").lane_change_duration
    2.5
    """
    if name not in ODDS:
        raise UnknownNameError("ODD", name, ODDS)
    return ODDS[name]


@dataclass(frozen=True)
class Crash:
    """First contact of two vehicles' boxes.

    Attributes:
        time: Since the start of the test [s]; the crash is seen in the frame at this time.
        slot_a: The AV's slot (0) when the AV takes part, else the smaller slot.
        slot_b: The other vehicle's slot.
    """

    time: float = field(metadata={"unit": "s"})
    slot_a: int
    slot_b: int


@dataclass(frozen=True)
class Scenario:
    """One recorded test: s0, u0, s1, ..., sn (paper, equation 2).

    Arrays are (T, N) unless said; where `present` is False the values are meaningless (NaN).

    Attributes:
        seed: Seed of the run; with `test` it names the random numbers.
        test: Index of the test within the seed, at least 0.
        odd: The road and the rules.
        slot: Slot number of each column, shape (N,); column 0 is slot 0, the AV.
        x: Box centre along the road [m].
        y: Box centre, to the left of the right road edge [m].
        speed: Along the road [m/s], in [0, odd.max_speed].
        heading: Counter-clockwise from the road's direction [rad].
        acceleration: Along the road, at this frame [m/s2]; without `odd.max_jerk` what is held from this frame to the
            next, and the last frame repeats the one before.
        target_lane: Lane index (0 = rightmost) that the vehicle keeps or changes to; -1 where absent.
        present: The vehicle exists.
        action: Index of the action chosen at frame 10 k, shape (K, N); -1 for the AV and where absent.
        critical_bv: Column of the BV nearest to the AV at frame 10 k, shape (K,); -1 when there is none.
        log_prob_nde: Natural log of the naturalistic model's probability of the critical BV's action, shape (K,);
            -inf where the model calls it impossible, 0 where there is no critical BV.
        crash: First contact that ended the test, or None.
        kind: Class of each vehicle, an index of `CLASSES`, shape (N,); empty: all are cars.
        length, width: Size of each vehicle [m], shape (N,); empty: the size of its class.
        change_time: How long an undisturbed lane change of each vehicle takes [s], shape (N,); empty: as the ODD says.
        shortfall: ln P of the likeliest action minus ln P of the critical BV's action, human errors included
            [nats], shape (K,), at least 0; +inf where the action is impossible, 0 where there is no critical BV; None:
            not recorded, as in scenarios read from a library.
        excess: -ln P of the critical BV's action minus its expected value, the entropy of what a natural driver does
            [nats], shape (K,); +inf, 0 and None as of `shortfall`.
        signals_s: Time of a site's signals at the first frame [s]; None: as the test's name draws it, and on a road
            (`site.signals.clock_in`).
        hidden: Seconds in which an adversary made the AV lose the critical BV: bit k is 1 for second k.
    """

    seed: int
    test: int
    odd: Odd
    slot: NDArray[np.int16]
    x: NDArray[np.float64] = field(metadata={"unit": "m"})
    y: NDArray[np.float64] = field(metadata={"unit": "m"})
    speed: NDArray[np.float64] = field(metadata={"unit": "m/s"})
    heading: NDArray[np.float64] = field(metadata={"unit": "rad"})
    acceleration: NDArray[np.float64] = field(metadata={"unit": "m/s2"})
    target_lane: NDArray[np.int8]
    present: NDArray[np.bool_]
    action: NDArray[np.int8]
    critical_bv: NDArray[np.int16]
    log_prob_nde: NDArray[np.float64]
    crash: Crash | None
    shortfall: NDArray[np.float64] | None = field(default=None, metadata={"unit": "nats"})
    excess: NDArray[np.float64] | None = field(default=None, metadata={"unit": "nats"})
    kind: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, dtype=np.int8))
    length: NDArray[np.float64] = field(default_factory=lambda: np.empty(0), metadata={"unit": "m"})
    width: NDArray[np.float64] = field(default_factory=lambda: np.empty(0), metadata={"unit": "m"})
    change_time: NDArray[np.float64] = field(default_factory=lambda: np.empty(0), metadata={"unit": "s"})
    hidden: int = 0
    signals_s: float | None = field(default=None, metadata={"unit": "s"})

    def __post_init__(self) -> None:
        size = self.slot.size
        if self.kind.size == 0:
            object.__setattr__(self, "kind", np.full(size, CAR, dtype=np.int8))
        for name, place in (("length", 0), ("width", 1)):
            if getattr(self, name).size == 0:
                sizes = [self.odd.size_of(int(kind))[place] for kind in self.kind]
                object.__setattr__(self, name, np.array(sizes, dtype=np.float64))
        if self.change_time.size == 0:
            object.__setattr__(self, "change_time", np.full(size, self.odd.lane_change_duration))

    @property
    def hidden_slots(self) -> NDArray[np.int16]:
        """Slot that an adversary made the AV lose in the second of each decision, (K,); -1 for none."""
        lost = np.array([bool(self.hidden >> second & 1) for second in range(self.critical_bv.size)], dtype=np.bool_)
        return np.where(lost, self.slot[self.critical_bv], -1).astype(np.int16)

    @property
    def case_id(self) -> str:
        """Name of the test, `seed:test`."""
        return f"{self.seed}:{self.test}"

    @property
    def partner(self) -> int | None:
        """Column of the vehicle that the AV crashed with; None if the AV did not crash."""
        if self.crash is None or self.crash.slot_a != 0:
            return None
        return next(iter(np.flatnonzero(self.slot == self.crash.slot_b).tolist()), None)

    def contact(self) -> tuple[int, int]:
        """Frame of the AV's crash, and column of the vehicle that it crashed with.

        Raises:
            InputError: There is no crash of the AV, or the recording does not hold its contact.
        """
        crash, partner = self.crash, self.partner
        if crash is None or crash.slot_a != 0:
            raise InputError(f"Test {self.case_id} holds no crash of the AV; only AV crashes are cases.")
        frame = round(crash.time / FRAME_S)
        if partner is None or not 0 <= frame < len(self.x) or not self.present[frame, [0, partner]].all():
            raise InputError(
                f"Test {self.case_id}: the contact with slot {crash.slot_b} at {crash.time} s is not in the recording "
                f"of {len(self.x)} frames."
            )
        return frame, partner
