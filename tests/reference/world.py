"""Vehicles on a road, and the traffic at the start of a test."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache
from statistics import NormalDist

from cornerforge.drivers.sight import Sight
from cornerforge.errors import UndrawableError
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.model import NddModel
from cornerforge.types import Odd
from reference.drivers import AvDriver, fold
from reference.elementary import atan, exp, log
from reference.philox import CLASS, INITIAL, TRAITS, Stream, normal_pair, unit
from reference.shapes import Box, LateralPath, plan

__all__ = ["FOLLOWED", "HUMAN", "SIGHT", "TRUCK", "TRUCK_SPEED", "Vehicle", "World", "start"]

SIGHT = 200.0
HUMAN, FOLLOWED = Sight(indicators=True), Sight(offset=0.55)
_DT = 0.1
_FULL_STEERING_SPEED = 5.0
TRUCK, TRUCK_SPEED = 1, 33.1


def _through_ramp(speed: float, a: float, jerk: float, time: float, top: float) -> tuple[float, float]:
    """Distance and speed after a time of constant jerk, piece by piece between the speed's limits."""
    gone = 0.0
    turn = -a / jerk
    if 0.0 < turn < time and not 0.0 <= speed + 0.5 * a * turn <= top:
        # It is held at the limit until its acceleration leads away from it.
        limit = 0.0 if a < 0.0 else top
        until = _reaches(limit, speed, a, jerk)
        gone = _way(speed, a, jerk, until) + limit * (turn - until)
        speed, a, time = limit, 0.0, time - turn
    after = speed + time * (a + 0.5 * jerk * time)
    if 0.0 <= after <= top:
        return gone + _way(speed, a, jerk, time), after
    limit = 0.0 if after < 0.0 else top
    until = _reaches(limit, speed, a, jerk)
    return gone + (_way(speed, a, jerk, until) + limit * (time - until)), limit


def _way(speed: float, a: float, jerk: float, time: float) -> float:
    return time * (speed + time * (0.5 * a + 1.0 / 6.0 * jerk * time))


def _reaches(limit: float, speed: float, a: float, jerk: float) -> float:
    """When the speed, which moves towards a limit in the end, meets it."""
    room, rate, growth = (limit - speed, a, jerk) if limit > 0.0 else (speed, -a, -jerk)
    root = math.sqrt(max(0.0, rate * rate + 2.0 * growth * room))
    return 2.0 * room / (root + rate) if rate > 0.0 else (root - rate) / growth


@dataclass(eq=False)
class Vehicle:
    """One vehicle; `path` is its lane change, None while it keeps its lane.

    `quantile` is that of its last acceleration, `habit` the one that it tends to; `desired_speed` is in m/s,
    `change_time`, how long an undisturbed lane change takes, in s.
    """

    slot: int
    x: float
    y: float
    speed: float
    target_lane: int
    lanes: set[int]
    heading: float = 0.0
    acceleration: float = 0.0
    path: LateralPath | None = None
    clock: float = 0.0
    action: int = -1
    present: bool = True
    length: float = 5.0
    width: float = 2.0
    kind: int = 0
    commanded: float = 0.0
    held_from: tuple[float, float, float] = (0.0, 0.0, 0.0)
    substeps_held: int = 0
    quantile: float = 0.0
    habit: float = 0.0
    desired_speed: float = 0.0
    change_time: float = 4.0
    signals: bool = True
    away: bool = False
    noise: float = 0.0
    inattention: float = 1.0

    def change_lane(self, lane: int, odd: Odd) -> None:
        """Begin a lane change, or turn a running one."""
        speed = acceleration = 0.0
        if self.path is not None:
            speed, acceleration = self.path.speed(self.clock), self.path.acceleration(self.clock)
        centre = (lane + 0.5) * odd.lane_width
        self.path = plan(self.y, speed, acceleration, centre, self.change_time, odd.max_lateral_acceleration)
        self.clock = 0.0
        self.target_lane = lane
        self.lanes = self.lanes | {lane}

    def running_side(self, odd: Odd) -> int:
        """+1 while changing to the left, -1 to the right, 0 while keeping the lane."""
        if self.path is None:
            return 0
        return 1 if self.path.c[0] < (self.target_lane + 0.5) * odd.lane_width else -1

    def can(self, acceleration: int) -> int:
        """The nearest of the 31 accelerations that it can do: a truck brakes with up to 3.2 m/s2, and its engine has
        10.8 W/kg, of which 0.17 m/s2 go to air and tyres."""
        if self.kind != TRUCK:
            return acceleration
        engine = 0.0 if self.speed >= TRUCK_SPEED else 10.8 / max(self.speed, 1.0) - 0.17
        return min(max(acceleration, 4), min(math.floor((engine + 4.0) * 5.0 + 0.5), 30))

    def act(self, action: int, odd: Odd) -> None:
        """Carry out an action: 0 left, 1 right, else the acceleration -4.0 + 0.2 (action - 2)."""
        self.action = action
        self.hold(round(-4.0 + 0.2 * (action - 2), 1) if action >= 2 else 0.0, odd)
        if action >= 2:
            return
        side = 1 if action == 0 else -1
        lane = self.target_lane + side
        if self.running_side(odd) != side and 0 <= lane < odd.n_lanes:
            self.change_lane(lane, odd)

    def hold(self, acceleration: float, odd: Odd) -> None:
        """Go to this acceleration from here on, and hold it."""
        self.commanded = acceleration
        if odd.max_jerk == math.inf:
            self.acceleration = acceleration
        now, ramp = self.acceleration, abs(acceleration - self.acceleration) * (1.0 / odd.max_jerk)
        most = max(abs(now), abs(acceleration)) * ramp
        if ramp <= _DT and self.speed - most >= 0.0 and self.speed + most <= odd.max_speed:
            # The ramp is over when it is next looked at: from where would the held acceleration have led here?
            change = acceleration - now
            self.held_from = (
                self.x + 1.0 / 6.0 * change * ramp * ramp,
                self.speed - 0.5 * change * ramp,
                acceleration,
            )
        else:
            self.held_from = (self.x, self.speed, now)
        self.substeps_held = 0

    def move(self, odd: Odd) -> None:
        """0.1 s further: along the road by the law of a ramp and then constant acceleration, across it on the path."""
        x, start, a0 = self.held_from
        self.substeps_held += 1
        time = self.substeps_held * _DT
        command = self.commanded
        now = command
        limited = odd.max_jerk < math.inf
        gone = 0.0
        if limited and command != a0:
            ramp = abs(command - a0) * (1.0 / odd.max_jerk)
            jerk = odd.max_jerk if command > a0 else -odd.max_jerk
            if time < ramp:
                now = a0 + jerk * time
            gone, start = _through_ramp(start, a0, jerk, min(time, ramp), odd.max_speed)
            time -= min(time, ramp)
        self.speed = start + command * time
        if self.speed < 0.0:  # has come to a stop
            self.x = x + (gone - 0.5 * start * start / command)
            self.speed = 0.0
        elif self.speed > odd.max_speed:
            until = (odd.max_speed - start) / command
            self.x = x + (gone + 0.5 * (start + odd.max_speed) * until) + odd.max_speed * (time - until)
            self.speed = odd.max_speed
        else:
            self.x = x + (gone + 0.5 * (start + self.speed) * time)
        if limited:
            stuck = (self.speed == 0.0 and now < 0.0) or (self.speed == odd.max_speed and now > 0.0)
            self.acceleration = 0.0 if stuck else now
        if self.path is not None:
            self._move_sideways(self.path, odd)

    def _move_sideways(self, path: LateralPath, odd: Odd) -> None:
        pace = min(1.0, self.speed / _FULL_STEERING_SPEED)
        self.clock += _DT * pace
        if self.clock >= path.duration - 1e-9:
            self.y, self.heading, self.path = (self.target_lane + 0.5) * odd.lane_width, 0.0, None
        else:
            self.y = path.position(self.clock)
            if self.speed > 0.0:
                self.heading = atan(path.speed(self.clock) * pace / self.speed)
        half = 0.5 * self.width
        edges = {math.floor((self.y - half) / odd.lane_width), math.floor((self.y + half) / odd.lane_width)}
        self.lanes = {self.target_lane} | {lane for lane in edges if lane >= 0}

    def side_moved_to(self) -> int:
        """+1 while it moves to the left, -1 to the right, 0 while it does neither."""
        rate = 0.0 if self.path is None or self.speed == 0.0 else self.path.speed(self.clock)
        return (rate > 0.0) - (rate < 0.0)

    def lane_entered(self, sight: Sight, odd: Odd) -> int:
        """The lane that an AV takes it to change to; that of its centre if it takes it to keep its lane."""
        if sight.by == "decision" or (sight.by == "motion" and sight.indicators and self.signals):
            return self.target_lane
        here = math.floor(self.y / odd.lane_width)
        side = self.side_moved_to()
        if sight.by == "centre" or self.path is None or here + side < 0:
            return here
        is_over_line = math.floor((self.y + side * self.width / 2.0) / odd.lane_width) != here
        t = sight.perception_time
        moved = t * (self.path.speed(self.clock) - 0.5 * t * self.path.acceleration(self.clock))
        was_off = side * (self.y - moved - (here + 0.5) * odd.lane_width)
        return here + side if is_over_line or was_off >= sight.offset else here

    def lanes_seen(self, sight: Sight, odd: Odd) -> set[int]:
        """The lanes in which an AV takes it to be."""
        if sight.by == "centre":
            return {math.floor(self.y / odd.lane_width)}
        if sight.by == "decision" or self.path is None:
            return self.lanes
        half = self.width / 2.0
        body = {math.floor((self.y - half) / odd.lane_width), math.floor((self.y + half) / odd.lane_width)}
        return {lane for lane in body if lane >= 0} | {self.lane_entered(sight, odd)}

    def box(self) -> Box:
        """Its body."""
        return Box(self.x, self.y, self.heading, self.length, self.width)

    def room_to(self, other: Vehicle) -> float:
        """Half of both lengths [m]: bumper touches bumper when the centres are so far apart."""
        return (self.length + other.length) / 2.0


@dataclass
class Body:
    """What a vehicle is before it has a place: its class and size, and its driver's traits.

    `desired_speed` and `change_time` are standard normal numbers here, from which the desired speed and the time that a
    lane change takes follow.
    """

    kind: int
    length: float
    width: float
    quantile: float
    habit: float
    desired_speed: float
    change_time: float
    signals: bool
    noise: float = 0.0
    inattention: float = 1.0


@dataclass
class World:
    """All vehicles of one test; slot 0 is the AV."""

    odd: Odd
    vehicles: list[Vehicle] = field(default_factory=list)

    @property
    def av(self) -> Vehicle:
        """The vehicle under test."""
        return self.vehicles[0]

    def bvs(self) -> list[Vehicle]:
        """The others that are still there."""
        return [vehicle for vehicle in self.vehicles[1:] if vehicle.present]

    def place(self, x: float, lane: int, speed: float, body: Body) -> None:
        """A further vehicle in the next slot."""
        y = (lane + 0.5) * self.odd.lane_width
        placed = Vehicle(len(self.vehicles), x, y, min(speed, self.odd.max_speed), lane, {lane})
        placed.kind, placed.length, placed.width = body.kind, body.length, body.width
        placed.quantile, placed.habit, placed.desired_speed = body.quantile, body.habit, body.desired_speed
        placed.change_time, placed.signals = body.change_time, body.signals
        placed.noise, placed.inattention = body.noise, body.inattention
        self.vehicles.append(placed)

    def from_rear_to_front(self) -> list[Vehicle]:
        """Those present by rising x, slot by slot at the same x."""
        return sorted((v for v in self.vehicles if v.present), key=lambda v: (v.x, v.slot))

    def neighbours(self, subject: Vehicle, lane: int, sight: Sight = HUMAN) -> tuple[Vehicle | None, Vehicle | None]:
        """Nearest vehicles ahead and behind in a lane, within 200 m; `sight` says who is in it."""
        seen = [
            other
            for other in self.from_rear_to_front()
            if other is not subject and abs(other.x - subject.x) < SIGHT and lane in other.lanes_seen(sight, self.odd)
        ]
        ahead = [v for v in seen if (v.x, v.slot) > (subject.x, subject.slot)]
        behind = [v for v in seen if (v.x, v.slot) < (subject.x, subject.slot)]
        return (ahead[0] if ahead else None), (behind[-1] if behind else None)

    def gap(self, lead: Vehicle, rear: Vehicle) -> float:
        """Bumper to bumper [m]."""
        return lead.x - rear.x - lead.room_to(rear)

    def nearest_bv(self) -> Vehicle | None:
        """The BV whose centre is nearest to the AV's."""
        return min(
            self.bvs(),
            key=lambda v: (v.x - self.av.x) * (v.x - self.av.x) + (v.y - self.av.y) * (v.y - self.av.y),
            default=None,
        )


@cache
def _log_normal(sigma: float) -> list[float]:
    """1,024 equally frequent values of a log-normal distribution with the median 1."""
    return [exp(sigma * round(NormalDist().inv_cdf((2 * k + 1) / 2048), 9)) for k in range(1024)]


@dataclass
class _Traffic:
    """Draws the traffic: the AV's lane from the AV on forwards and backwards, then the other lanes from the rear."""

    world: World
    law: InitialState
    stream: Stream
    habits: bool
    draws: int = 0
    stream_speed: float = 0.0
    mean: float = 0.0
    trucks: float = 0.0

    def words(self) -> tuple[int, int, int, int]:
        words = self.stream.words(self.draws, 0, INITIAL)
        self.draws += 1
        return words

    def choose_stream(self) -> None:
        """The mean speed of this test's stream, at most as far from the usual one as a vehicle's may be."""
        words = self.words()
        mean = self.law.speed_mean + self.law.stream_sd * normal_pair(words[0], words[1])[0]
        self.stream_speed = min(max(mean, self.law.speed_low), self.law.speed_high)

    def choose_lane(self, lane: int) -> None:
        """The lane that is filled next: its mean speed and its share of trucks."""
        odd = self.world.odd
        to_the_right = (odd.n_lanes - 1 - lane) / (odd.n_lanes - 1)
        self.trucks = 2.0 * to_the_right * odd.truck_share
        mean = self.stream_speed + odd.slower_right * (0.5 - to_the_right)
        mean = min(mean, TRUCK_SPEED) if self.trucks else mean
        self.mean = min(max(mean, self.law.speed_low), self.law.speed_high)

    def speed(self) -> float:
        """A normal speed, drawn again until it is legal."""
        for _ in range(10_000):
            words = self.words()
            speed = self.mean + self.law.speed_sd * normal_pair(words[0], words[1])[0]
            if self.law.speed_low <= speed <= self.law.speed_high:
                return speed
        raise UndrawableError("speed")

    def neighbour(self, speed: float, *, ahead: bool, is_truck: bool) -> tuple[float, float, float | None]:
        """Gap and speed of the next vehicle, and the quantile of the follower's time gap, None where none follows.

        A truck's time gaps are longer (`is_truck`: the one behind is one).
        """
        law = self.law
        for _ in range(10_000):
            words = self.words()
            z_gap, z_speed = normal_pair(words[0], words[1])
            follows = unit(words[2]) < law.follow_share
            time_gap = law.time_gap_shift + law.time_gap_median * exp(law.time_gap_sigma * z_gap)
            time_gap *= 1.8 if is_truck else 1.0
            free_gap = law.free_gap_low + (law.free_gap_high - law.free_gap_low) * unit(words[3])
            gap = speed * time_gap if follows else free_gap
            # The change from one vehicle to the next is wider at larger gaps, at most as wide as all speeds are.
            spread = min(law.speed_sd, law.rr_scale * exp(law.rr_exponent * log(gap / 20.0)))
            part = spread / law.speed_sd
            other = self.mean + math.sqrt(1.0 - part * part) * (speed - self.mean) + spread * z_speed
            if follows and not ahead:  # the time gap is the follower's, who is the new vehicle
                gap = other * time_gap
            closing = speed - other if ahead else other - speed
            if not law.speed_low <= other <= law.speed_high or gap < 1.0 or (follows and gap > law.free_gap_low):
                continue
            if gap >= law.min_ttc * closing:
                return gap, other, _normal_share(z_gap) if follows and self.habits else None
        raise UndrawableError("neighbour")

    def body(self) -> Body:
        """What the next vehicle is; the first, the AV, is a car."""
        odd, number = self.world.odd, len(self.world.vehicles)
        draw = unit(self.stream.words(number, 0, CLASS)[0])
        kind, length, width = 0, odd.vehicle_length, odd.vehicle_width
        if number > 0 and draw < self.trucks:
            kind, length, width = TRUCK, 16.5, 2.55
        elif number > 0 and draw < self.trucks + odd.motorcycle_share:
            kind, length, width = 2, 2.2, 0.8
        quantile, habit, *own = self.stream.words(number, 0, TRAITS)
        signals = number == 0 or quantile % 1024 < self.law.signal_share * 1024
        odds = _log_normal(self.law.noise_spread)[habit % 1024]
        noise = (odds - 1.0) / (odds + 1.0)
        often = _log_normal(self.law.vigilance_sigma)  # how often drivers look away; 1 is the mean
        inattention = often[habit // 1024 % 1024] / math.fsum(often) * 1024
        drawn = unit(quantile), unit(habit), *normal_pair(*own)
        return Body(kind, length, width, *drawn, signals, noise, inattention)

    def habit(self, habit: float, quantile: float | None) -> float:
        """The habit of a driver with a time gap of this quantile: the shorter the gap, the higher."""
        if quantile is None:
            return habit
        return fold(1.0 - quantile + self.law.habit_spread * (2.0 * habit - 1.0))

    def place(self, x: float, lane: int, speed: float, body: Body) -> None:
        """The next vehicle, whose driver's desired speed has a normal distribution given its speed."""
        speed = min(speed, self.world.odd.max_speed)
        share = self.law.desire_share
        noise = math.sqrt(share * (1.0 - share)) * self.law.speed_sd * body.desired_speed
        body.desired_speed = self.mean + share * (speed - self.mean) + noise
        if body.kind == TRUCK:
            body.desired_speed = min(body.desired_speed, TRUCK_SPEED)
        odd = self.world.odd
        if self.world.vehicles and not odd.same_duration and self.law.change_median > 0.0:
            time = self.law.change_median * exp(self.law.change_sigma * body.change_time)
            widest = 2.55 if odd.truck_share > 0.0 else odd.vehicle_width
            room, usual = odd.lane_width - (body.width + widest) / 2.0, odd.lane_width - odd.vehicle_width
            least = self.law.change_low * max(1.0, usual / room)
            body.change_time = min(max(time, least), self.law.change_high)
        else:
            body.change_time = odd.lane_change_duration
        self.world.place(x, lane, speed, body)

    def fill_ahead(self, x: float, lane: int, speed: float, length: float, rear: Vehicle | None) -> None:
        """Vehicles ahead of one at x, which is `rear` if it is there, up to the end of the traffic."""
        while True:
            is_truck = rear is not None and rear.kind == TRUCK
            gap, speed, quantile = self.neighbour(speed, ahead=True, is_truck=is_truck)
            if rear is not None:
                rear.habit = self.habit(rear.habit, quantile)
            body = self.body()
            x += (length + body.length) / 2.0 + gap
            if x > self.world.odd.traffic_length:
                return
            self.place(x, lane, speed, body)
            length, rear = body.length, self.world.vehicles[-1]

    def fill_av_lane(self, lane: int, av: AvDriver) -> None:
        odd = self.world.odd
        own = min(self.speed(), odd.max_speed)
        self.place(odd.av_start, lane, own, self.body())
        gap, speed, _ = self.neighbour(own, ahead=True, is_truck=False)
        body = self.body()
        x = odd.av_start + (odd.vehicle_length + body.length) / 2.0 + max(gap, av.desired_gap(own, speed - own))
        if x <= odd.traffic_length:
            self.place(x, lane, speed, body)
            self.fill_ahead(x, lane, speed, body.length, self.world.vehicles[-1])
        x, speed, length = odd.av_start, own, odd.vehicle_length
        while True:
            body = self.body()
            gap, speed, quantile = self.neighbour(speed, ahead=False, is_truck=body.kind == TRUCK)
            body.habit = self.habit(body.habit, quantile)
            x -= (length + body.length) / 2.0 + gap
            if x < 0.0:
                return
            self.place(x, lane, speed, body)
            length = body.length


def _normal_share(z: float) -> float:
    """P(a standard normal number is at most z), to 7.5e-8: Abramowitz and Stegun 1964, 26.2.17."""
    t = 1.0 / (1.0 + 0.2316419 * abs(z))
    density = 0.3989422804014327 * exp(-0.5 * z * z)
    polynomial = 0.0
    for coefficient in (1.330274429, -1.821255978, 1.781477937, -0.356563782, 0.319381530):
        polynomial = polynomial * t + coefficient
    above = density * polynomial * t
    return above if z < 0.0 else 1.0 - above


def start(odd: Odd, model: NddModel, av: AvDriver, stream: Stream) -> World:
    """The world at the start of a test."""
    traffic = _Traffic(World(odd), model.initial, stream, model.memory.habit > 0.0)
    av_lane = min(odd.n_lanes - 1, math.floor(unit(traffic.words()[0]) * odd.n_lanes))
    traffic.choose_stream()
    traffic.choose_lane(av_lane)
    traffic.fill_av_lane(av_lane, av)
    for lane in range(odd.n_lanes):
        if lane != av_lane:
            x = -model.initial.free_gap_low * unit(traffic.words()[0])
            traffic.choose_lane(lane)
            traffic.fill_ahead(x, lane, traffic.speed(), odd.vehicle_length, None)
    return traffic.world
