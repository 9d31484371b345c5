"""Our IDM and MOBIL against highway-env's own functions, on random states.

highway-env's class constants are set to ours. Where its formulas differ, `RULES` says how; `Restated` makes these
changes and no others, so that all that is left of `IDMVehicle` must agree with ours to 1e-9, or the comparison stops.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

from cornerforge.drivers.avs import AVS, AvModel, numbers_of_av
from cornerforge.drivers.idm import IdmNumbers, IdmParams, idm_acceleration
from cornerforge.drivers.mobil import MobilParams
from cornerforge.road.straight import road_numbers
from cornerforge.sim.av import av_decide
from cornerforge.sim.world import NO_VEHICLE, World, all_current, allocate_worlds, world_of
from cornerforge.types import Odd

__all__ = ["TOLERANCE", "IdmAgreement", "MobilAgreement", "compare_idm", "compare_mobil", "render"]

TOLERANCE = 1e-9
"""Largest difference in acceleration that counts as agreement [m/s2]."""
LENGTH = 5.0
RULES = """\
highway-env's constants are set to ours (`COMFORT_ACC_MAX`, `COMFORT_ACC_MIN`, `DISTANCE_WANTED`, `TIME_WANTED`,
`POLITENESS`, `LANE_CHANGE_*`, the target speed). Its formulas differ in these points, and only in these:

1. It measures gaps from centre to centre and adds the length to the standstill gap: its IDM has
   (s0 + L + ...) / (gap + L) where ours, and the paper of the IDM, has (s0 + ...) / gap.
2. Its desired gap may fall below s0, even below zero, behind a faster lead; ours keeps s0 (max(0, ...), as Treiber and
   Kesting (2013) write it).
3. It lets a gap sink to 0.01 m, ours to 0.1 m, and takes the square of a negative gap for that of a positive one.
4. It cuts a command where it is carried out (at 6 m/s2), so MOBIL weighs commands that no car can carry out; ours cuts
   where it is computed (at the AV's own limits), so MOBIL weighs what will happen.
5. Its MOBIL asks only whether the new follower must brake hard; ours also whether the AV itself must.
6. With two sides to change to, it takes the last that qualifies, ours the better one. Its politeness counts the old
   follower too, ours the new one only (the built-in AVs have politeness 0; compared at 0.5 without an old follower)."""


class _Plain(IDMVehicle):
    """highway-env's driver as it is; a class of its own, so that constants can be set."""


class Restated(_Plain):
    """highway-env's driver with points 1 to 5 of `RULES` made ours."""

    STRONGEST_BRAKING = 4.0

    def lane_distance_to(self, other: Any, lane: Any = None) -> float:
        return float(max(super().lane_distance_to(other, lane) - LENGTH, 0.1))

    def desired_gap(self, ego_vehicle: Any, front_vehicle: Any = None, projected: bool = True) -> float:
        return float(max(self.DISTANCE_WANTED, super().desired_gap(ego_vehicle, front_vehicle, projected)))

    def acceleration(self, ego_vehicle: Any, front_vehicle: Any = None, rear_vehicle: Any = None) -> float:
        command = super().acceleration(ego_vehicle, front_vehicle, rear_vehicle)
        return float(np.clip(command, -self.STRONGEST_BRAKING, self.COMFORT_ACC_MAX))

    def mobil(self, lane_index: Any) -> bool:
        lead, _ = self.road.neighbour_vehicles(self, lane_index)
        is_safe = self.acceleration(self, lead) >= -self.LANE_CHANGE_MAX_BRAKING_IMPOSED
        return is_safe and bool(super().mobil(lane_index))


def _set_constants(kind: type[_Plain], idm: IdmParams, mobil: MobilParams) -> None:
    kind.COMFORT_ACC_MAX = idm.max_acceleration
    kind.COMFORT_ACC_MIN = -idm.comfortable_braking
    kind.DISTANCE_WANTED = idm.standstill_gap
    kind.TIME_WANTED = idm.time_gap
    kind.DELTA = 4.0
    kind.POLITENESS = mobil.politeness
    kind.LANE_CHANGE_MIN_ACC_GAIN = mobil.min_gain
    kind.LANE_CHANGE_MAX_BRAKING_IMPOSED = mobil.max_imposed_braking
    if issubclass(kind, Restated):
        kind.STRONGEST_BRAKING = idm.max_braking


class _Cars:
    """A straight road of highway-env with vehicles that are put where a state wants them."""

    def __init__(self, kind: type[_Plain], count: int, model: AvModel, lanes: int = 3) -> None:
        _set_constants(kind, model.idm, model.mobil)
        self._network = RoadNetwork.straight_road_network(lanes, length=2000.0, speed_limit=100.0)
        self._road = Road(network=self._network)
        self.all = [kind(self._road, [0.0, 0.0], target_speed=model.idm.desired_speed) for _ in range(count)]

    def put(self, k: int, x: float, lane: int, speed: float) -> None:
        """Vehicle k to x [m] in the middle of a lane, at a speed [m/s]."""
        car = self.all[k]
        car.position = np.array([x + 1000.0, 4.0 * lane])
        car.speed = speed
        car.lane_index = car.target_lane_index = ("0", "1", lane)
        car.lane = self._network.get_lane(car.lane_index)

    def on_road(self, count: int) -> None:
        """Only the first `count` vehicles are there."""
        self._road.vehicles = self.all[:count]


@dataclass(frozen=True)
class IdmAgreement:
    """Accelerations of one AV's IDM against theirs [m/s2].

    Attributes:
        states: All that were compared with `Restated`.
        largest: Largest difference there.
        plain_states: Of these, where points 2 to 4 do not matter, compared with `IDMVehicle` as it is.
        plain_largest: Largest difference there.
        below_s0: States in which point 2 changes the command, and by how much at most.
        cut: States in which our cut changes it.
        centre_median: Median |difference| of their own measure of gaps (point 1) over uncut states.
    """

    av: str
    states: int
    largest: float
    plain_states: int
    plain_largest: float
    below_s0: int
    cut: int
    centre_median: float


@dataclass(frozen=True)
class MobilAgreement:
    """Lane-change decisions of one AV against theirs.

    Attributes:
        states: Compared, all three lanes.
        changes: Ours that change lanes.
        restated_differ: Decisions that differ from `Restated` (must be 0).
        plain_differ: Decisions that differ from `IDMVehicle` with gaps from bumper to bumper only (points 2 to 6).
    """

    av: str
    politeness: float
    states: int
    changes: int
    restated_differ: int
    plain_differ: int


def _raw_idm(speed: float, gap: float, rate: float, p: IdmParams) -> tuple[float, float]:
    """The uncut command and the dynamic part of the desired gap, written once more."""
    dynamic = speed * p.time_gap - speed * rate / (2.0 * (p.max_acceleration * p.comfortable_braking) ** 0.5)
    wish = (p.standstill_gap + max(0.0, dynamic)) / max(gap, 0.1)
    return p.max_acceleration * (1.0 - (speed / p.desired_speed) ** 4 - wish**2), dynamic


def _random_state(rng: np.random.Generator) -> tuple[float, float, float]:
    """Speeds of subject and lead [m/s] and gap [m]: four fifths as in traffic, the rest anything, overlaps too."""
    speed = float(rng.uniform(0.0, 40.0))
    if rng.random() < 0.2:
        return speed, float(rng.uniform(0.0, 40.0)), float(rng.uniform(-5.0, 300.0))
    gap = float(np.exp(rng.uniform(np.log(0.05 + speed), np.log(300.0))))
    return speed, max(0.0, speed + float(rng.normal(0.0, 3.0))), gap


def compare_idm(model: AvModel, *, states: int, seed: int = 0) -> IdmAgreement:
    """Compare accelerations of random states.

    Raises:
        RuntimeError: A difference above TOLERANCE.
    """
    rng = np.random.default_rng(seed)
    numbers = IdmNumbers(*astuple(model.idm))
    plain, restated, theirs = _Cars(_Plain, 2, model), _Cars(Restated, 2, model), _Cars(_Plain, 2, model)
    largest = plain_largest = 0.0
    plain_states = below_s0 = cut = 0
    centre = []
    for _ in range(states):
        speed, lead_speed, gap = _random_state(rng)
        ours = idm_acceleration(speed, gap, lead_speed - speed, numbers)
        restated.put(0, 0.0, 0, speed)
        restated.put(1, gap + LENGTH, 0, lead_speed)
        largest = max(largest, abs(ours - restated.all[0].acceleration(*restated.all)))
        uncut, dynamic = _raw_idm(speed, gap, lead_speed - speed, model.idm)
        is_cut = not -model.idm.max_braking <= uncut <= model.idm.max_acceleration
        cut += is_cut
        below_s0 += dynamic < 0.0 and not is_cut
        if not is_cut and dynamic >= 0.0 and gap >= 0.1:
            plain.put(0, 0.0, 0, speed)
            plain.put(1, gap, 0, lead_speed)  # point 1: their centres as far apart as our bumpers
            plain_largest = max(plain_largest, abs(ours - plain.all[0].acceleration(*plain.all)))
            plain_states += 1
            theirs.put(0, 0.0, 0, speed)
            theirs.put(1, gap + LENGTH, 0, lead_speed)
            _Plain.DISTANCE_WANTED = model.idm.standstill_gap + LENGTH
            centre.append(abs(ours - theirs.all[0].acceleration(*theirs.all)))
            _Plain.DISTANCE_WANTED = model.idm.standstill_gap
    if max(largest, plain_largest) > TOLERANCE:
        raise RuntimeError(f"IDM of {model.name}: differs from highway-env by {max(largest, plain_largest):.3g} m/s2.")
    median = float(np.median(centre))
    return IdmAgreement(model.name, states, largest, plain_states, plain_largest, below_s0, cut, median)


class _BumperGaps(_Plain):
    """highway-env's driver with point 1 alone made ours."""

    def lane_distance_to(self, other: Any, lane: Any = None) -> float:
        return float(super().lane_distance_to(other, lane) - LENGTH)


def _random_cars(rng: np.random.Generator, has_old_follower: bool) -> list[tuple[float, int, float]]:
    """(x, lane, speed) of the AV at x = 0, then up to two vehicles ahead and two behind in each of three lanes."""
    av_lane = int(rng.integers(3))
    cars = [(0.0, av_lane, float(rng.uniform(10.0, 38.0)))]
    for lane in range(3):
        for ahead in (True, False):
            if lane == av_lane and not ahead and not has_old_follower:
                continue
            for _ in range(rng.integers(3)):
                reach = float(np.exp(rng.uniform(np.log(4.0), np.log(180.0))))
                cars.append((reach if ahead else -reach, lane, float(rng.uniform(10.0, 40.0))))
    return cars


def _world_of(worlds: World, cars: list[tuple[float, int, float]]) -> World:
    """Our world of these cars, all in the centres of their lanes."""
    w = world_of(worlds)
    w.vehicles["present"] = 0
    for k, (x, lane, speed) in enumerate(cars):
        v = w.vehicles[k]
        v["x"], v["y"], v["speed"], v["duration"] = x, 4.0 * lane + 2.0, speed, 0.0
        v["target_lane"], v["lanes"], v["present"], v["action"] = lane, 1 << lane, 1, -1
    w.order[:] = np.arange(w.order.size)
    w.state[:] = 0
    w.state["n_vehicles"], w.state["controlled"] = len(cars), NO_VEHICLE
    all_current(w)
    return w


def _their_lane(cars: _Cars, state: list[tuple[float, int, float]], pick_best: bool) -> int:
    """The lane that their MOBIL chooses; of two that qualify the better (point 6) or, as they do, the last."""
    for k, car in enumerate(state):
        cars.put(k, *car)
    cars.on_road(len(state))
    av = cars.all[0]
    lane: int = state[0][1]
    best = -np.inf
    for side in (lane + 1, lane - 1):  # of two equal ones ours takes the left
        index = ("0", "1", side)
        if 0 <= side <= 2 and av.mobil(index):
            lead, rear = av.road.neighbour_vehicles(av, index)
            gain = av.acceleration(av, lead)
            gain += av.POLITENESS * (av.acceleration(rear, av) - av.acceleration(rear, lead))
            if not pick_best or gain > best:
                best, lane = gain, side
    return lane


def compare_mobil(model: AvModel, *, states: int, seed: int = 0) -> MobilAgreement:
    """Compare the lane that the AV chooses, in random traffic of three lanes.

    Raises:
        RuntimeError: A decision differs from that of `Restated`.
    """
    rng = np.random.default_rng(seed)
    numbers = numbers_of_av(AvModel("", "", model.idm, model.mobil, model.sight))
    road = road_numbers(Odd(n_lanes=3))
    restated, plain = _Cars(Restated, 13, model), _Cars(_BumperGaps, 13, model)
    worlds = allocate_worlds(1, 13)
    changes = restated_differ = plain_differ = 0
    for _ in range(states):
        cars = _random_cars(rng, has_old_follower=model.mobil.politeness == 0.0)
        _, lane = av_decide(_world_of(worlds, cars), road, numbers)
        changes += lane != cars[0][1]
        restated_differ += lane != _their_lane(restated, cars, True)
        plain_differ += lane != _their_lane(plain, cars, False)
    if restated_differ:
        raise RuntimeError(f"MOBIL of {model.name}: {restated_differ} of {states} decisions differ from highway-env's.")
    return MobilAgreement(model.name, model.mobil.politeness, states, changes, restated_differ, plain_differ)


def compare_all(*, states: int) -> tuple[list[IdmAgreement], list[MobilAgreement]]:
    """Both AV parameter sets, and on a fifth of the states the first one made polite."""
    nade, d2rl = AVS["idm-mobil"], AVS["idm-mobil-d2rl"]
    polite = AvModel("idm-mobil", "", nade.idm, MobilParams(politeness=0.5))
    idm = [compare_idm(model, states=states) for model in (nade, d2rl)]
    mobil = [compare_mobil(model, states=states) for model in (nade, d2rl)]
    mobil.append(compare_mobil(polite, states=states // 5))
    return idm, mobil


def render(idm: list[IdmAgreement], mobil: list[MobilAgreement]) -> str:
    """The section's Markdown."""
    lines = [RULES, ""]
    for a in idm:
        lines.append(
            f"- IDM of `{a.av}`: {a.states:,} random states agree with `IDMVehicle.acceleration` after these changes "
            f"to {a.largest:.1e} m/s2, and {a.plain_states:,} in which points 2-4 play no part agree with it as it is "
            f"to {a.plain_largest:.1e}. Point 2 changes {a.below_s0:,} commands, our cut {a.cut:,}; point 1 alone "
            f"would change a command by {a.centre_median:.2f} m/s2 (median of the uncut)."
        )
    for m in mobil:
        lines.append(
            f"- MOBIL of `{m.av}`, politeness {m.politeness:g}: all of {m.states:,} decisions in random traffic "
            f"({m.changes:,} of them to change lanes) are those of `IDMVehicle.mobil` after these changes; with point "
            f"1 alone changed {m.plain_differ:,} would differ."
        )
    return "\n".join(lines)
