"""Traffic at the start of a test, drawn from the naturalistic model's initial state (`ndd.initial.InitialState`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._elementary import exp, log
from cornerforge._jit import inlined_kernel, kernel, shared_kernel
from cornerforge._philox import PURPOSE_CLASS, PURPOSE_INITIAL, PURPOSE_TRAITS, block, normal_pair, uniform
from cornerforge.drivers.idm import desired_gap
from cornerforge.errors import UndrawableError
from cornerforge.ndd.memory import reflected
from cornerforge.road.lanes import EXITS, URGENT_TIME, has_lane, must_leave_by, on_a_ramp
from cornerforge.road.straight import half_lengths, lane_centre, part_right, truck_share_in
from cornerforge.sim.controllers import NOBODY, RAILS, critical_of
from cornerforge.sim.outcome import RUNNING, UNDRAWN
from cornerforge.sim.perception import begin_to_remember
from cornerforge.sim.rails import put_on_rails
from cornerforge.sim.site.traffic import reset_at_site
from cornerforge.sim.world import NO_ACTION, NO_VEHICLE, all_current
from cornerforge.site.tables import at_site
from cornerforge.types import CAR, CLASSES, MOTORCYCLE, QUEUE_FROM, QUEUE_TO, TRUCK

if TYPE_CHECKING:
    from numpy import uint64

    from cornerforge.drivers.naturalistic import InitialNumbers, NddTables
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = ["clear_world", "linked_reset_world", "naming_tests", "reset_world"]

_LENGTHS = np.array([user.length for user in CLASSES])
_WIDTHS = np.array([user.width for user in CLASSES])
_TRUCK_SPEED = CLASSES[TRUCK].top_speed
_TIME_GAPS = np.array([user.time_gap for user in CLASSES])
_LEAST_ROOM = 0.25
_RAMP_SHARE = 0.4
"""Traffic of a ramp, as a share of a lane's."""
_QUEUE_SPEED = 8.0
"""Largest speed of a queue [m/s]; I-80's congested pairs drive at 0.4 to 10.7 m/s (5 and 95 %)."""
_STANDING = 2.5
"""Gap of a queue in which vehicles stand [m]: I-80, 9,881 states below 0.3 m/s: 2.2, 3.0, 4.1 m at 25, 50, 75 %."""
_EASY = 1.5
"""Drivers at the start are so fast that this stops them at the end of the queue [m/s2]."""
_EXIT_SHARE = 0.15
"""Share of the main road's vehicles that take an exit."""
_MAX_TRIES = 10_000
"""After so many refused draws in a row the test is UNDRAWN. Models of which hardly a draw suits do not load
(`ndd.initial.check_initial`); of the shipped one at most 13 in a row were refused in 2.3 million tests."""
_NO_SPEED = (
    "The traffic at the start of a test cannot be drawn: 10,000 speeds in a row lay outside of the model's speed_low "
    "and speed_high. Use another model."
)
_NO_NEIGHBOUR = (
    "The traffic at the start of a test cannot be drawn: 10,000 vehicles in a row, ahead of or behind another, had a "
    "speed outside of the model's speed_low and speed_high, a gap below 1 m, a follower's gap above its free_gap_low, "
    "or a time to collision below its min_ttc. Use another model, or an ODD that suits it."
)
_LOW_BITS = 2**10 - 1
"""Bits of a random word that say whether a driver sets its indicator: 2^-22 of the quantile that all of it gives. The
lowest bits of the habit's word say its noise level and its vigilance (`naturalistic.LEVELS`): 2^-12 of the habit."""


@inlined_kernel
def _next_words(w: World) -> tuple[uint64, uint64, uint64, uint64]:
    """Draw the next four random words of the initial traffic."""
    state = w.state[0]
    draw = state.draw
    state.draw += 1
    return block(state.seed, state.test, draw, 0, PURPOSE_INITIAL)


@inlined_kernel
def _lane_speed(stream: float, lane: int, setting: Setting) -> float:
    """Compute the mean speed of a lane [m/s], given the test's mean speed.

    Lanes with trucks are on average no faster than trucks go.
    """
    road, initial = setting.road, setting.tables.initial
    speed = stream + road.slower_right * (0.5 - part_right(lane, road))
    if truck_share_in(lane, road) > 0.0:
        speed = min(speed, _TRUCK_SPEED)
    return max(initial.speed_low, min(initial.speed_high, speed))


@kernel
def _draw_speed(w: World, mean: float, initial: InitialNumbers) -> float:
    """Draw a speed from the truncated normal distribution about the test's mean speed [m/s].

    Raises:
        UndrawableError: `_MAX_TRIES` draws in a row were refused.
    """
    for _ in range(_MAX_TRIES):
        words = _next_words(w)
        speed = mean + initial.speed_sd * normal_pair(words[0], words[1])[0]
        if initial.speed_low <= speed <= initial.speed_high:
            return speed
    w.state[0].outcome = UNDRAWN
    raise UndrawableError(_NO_SPEED)


@inlined_kernel
def _draw_neighbour(
    w: World, speed: float, mean: float, ahead: bool, kind: int, tables: NddTables
) -> tuple[float, float, float]:
    """Draw the next vehicle ahead of (or behind) a vehicle that drives at `speed`: gap [m], speed [m/s], quantile.

    The follower is of class `kind`. The quantile is the rank of its time gap among all followers of its class, -1 where
    it does not follow, or no driver has a habit. The chain of speeds is reversible, so the same distribution serves
    both directions.

    Raises:
        UndrawableError: `_MAX_TRIES` draws in a row were refused.
    """
    initial = tables.initial
    for _ in range(_MAX_TRIES):
        words = _next_words(w)
        z_gap, z_speed = normal_pair(words[0], words[1])
        follows = uniform(words[2]) < initial.follow_share
        time_gap = initial.time_gap_shift + initial.time_gap_median * exp(initial.time_gap_sigma * z_gap)
        if kind != CAR:
            time_gap *= _TIME_GAPS[kind]
        free_gap = initial.free_gap_low + (initial.free_gap_high - initial.free_gap_low) * uniform(words[3])
        gap = speed * time_gap if follows else free_gap
        scale = min(initial.rr_scale * exp(initial.rr_exponent * log(gap / 20.0)), initial.speed_sd)
        share = scale / initial.speed_sd
        other = mean + math.sqrt(1.0 - share * share) * (speed - mean) + scale * z_speed
        if follows and not ahead:
            gap = other * time_gap
        closing = speed - other if ahead else other - speed
        is_near = not follows or gap <= initial.free_gap_low
        legal = initial.speed_low <= other <= initial.speed_high and gap >= 1.0 and is_near
        if legal and gap >= initial.min_ttc * closing:
            return gap, other, _normal_share(z_gap) if follows and tables.memory.habit > 0.0 else -1.0
    w.state[0].outcome = UNDRAWN
    raise UndrawableError(_NO_NEIGHBOUR)


@inlined_kernel
def _normal_share(z: float) -> float:
    """Compute the standard normal distribution function to 7.5e-8 (Abramowitz and Stegun 1964, 26.2.17)."""
    t = 1.0 / (1.0 + 0.2316419 * abs(z))
    series = 1.330274429 * t - 1.821255978
    series = series * t + 1.781477937
    series = series * t - 0.356563782
    series = series * t + 0.319381530
    tail = 0.3989422804014327 * exp(-0.5 * z * z) * series * t
    return tail if z < 0.0 else 1.0 - tail


@inlined_kernel
def _give_habit(w: World, slot: int, quantile: float, initial: InitialNumbers) -> None:
    """Give a follower a habit that suits its time gap: with a short gap, high accelerations."""
    if quantile >= 0.0:
        v = w.vehicles
        v[slot].habit = reflected(1.0 - quantile + initial.habit_spread * (2.0 * v[slot].habit - 1.0))


@inlined_kernel
def _join(w: World, lane: int, setting: Setting) -> bool:
    """Give the next free slot a class, a size and traits; False when no slot is left. `_place` puts it on the road."""
    state, road = w.state[0], setting.road
    slot = state.n_vehicles
    if slot >= w.vehicles.size:
        return False
    kind = CAR
    if slot > 0 and road.truck_share + road.motorcycle_share > 0.0:
        draw = uniform(block(state.seed, state.test, slot, 0, PURPOSE_CLASS)[0])
        trucks = truck_share_in(lane, road)
        if draw < trucks:
            kind = TRUCK
        elif draw < trucks + road.motorcycle_share:
            kind = MOTORCYCLE
    v = w.vehicles[slot]
    v.kind = kind
    v.length = road.length if kind == CAR else _LENGTHS[kind]
    v.width = road.width if kind == CAR else _WIDTHS[kind]
    words = block(state.seed, state.test, slot, 0, PURPOSE_TRAITS)
    v.quantile = uniform(words[0])
    v.habit = uniform(words[1])
    v.desired_speed, v.change_time = normal_pair(words[2], words[3])
    v.signals = np.int64(words[0] & np.uint64(_LOW_BITS))
    v.noise = setting.tables.noise[np.int64(words[1] & np.uint64(_LOW_BITS))]
    v.inattention = setting.tables.inattention[np.int64((words[1] >> np.uint64(10)) & np.uint64(_LOW_BITS))]
    return True


@inlined_kernel
def _queue(w: World, road: RoadNumbers) -> tuple[float, float]:
    """Draw the queue of a test: where its end is at the start [m], and how fast it moves [m/s]."""
    words = block(w.state[0].seed, w.state[0].test, 0, 1, PURPOSE_CLASS)
    at = QUEUE_FROM + (QUEUE_TO - QUEUE_FROM) * uniform(words[0])
    return road.av_start + at, _QUEUE_SPEED * uniform(words[1])


@kernel
def _eased(w: World, x: float, speed: float, road: RoadNumbers) -> float:
    """Compute how fast a vehicle at x that would drive at `speed` starts before or in a queue [m/s]."""
    if not road.queue:
        return speed
    end, crawl = _queue(w, road)
    return min(speed, math.sqrt(crawl * crawl + 2.0 * _EASY * max(end - x, 0.0)))


@inlined_kernel
def _gap_there(w: World, x: float, speed: float, gap: float, road: RoadNumbers) -> float:
    """Compute the gap ahead of a vehicle at x, drawn as `gap` at `speed` [m]: near a queue the time gap stays."""
    if not road.queue:
        return gap
    slow = _eased(w, x, speed, road) / speed
    return gap * slow + _STANDING * (1.0 - slow)


@inlined_kernel
def _narrowness(width: float, road: RoadNumbers) -> float:
    """Compute how much less room than between two cars is beside a vehicle of a width [m]; at least 1.

    The room ends at the widest vehicle in the middle of the next lane. A vehicle that begins a change beside another
    and turns back a second later touches it if the change is too quick for the room.
    """
    room = road.lane_width - 0.5 * (width + road.widest)
    return max(1.0, (road.lane_width - road.width) / max(room, _LEAST_ROOM))


@inlined_kernel
def _takes_exit(w: World, slot: int, lane: int, x: float, road: RoadNumbers) -> bool:
    """Does the vehicle that is put there take the exit? The AV by its task; of what comes from a ramp none does."""
    if slot == 0 or road.lanes.exit_slot < 0 or on_a_ramp(lane, x, road):
        return slot == 0 and road.av_exits
    word = block(w.state[0].seed, w.state[0].test, slot, 1, PURPOSE_TRAITS)[0]
    return uniform(word) < _EXIT_SHARE


@inlined_kernel
def _place(w: World, x: float, lane: int, speed: float, mean: float, setting: Setting) -> None:
    """Put the vehicle of the last `_join` on the road: centre at x [m] in a lane, at `speed` [m/s]; `mean`: the test's.

    Its desired speed is drawn given its speed, as both are in the long run (bivariate normal). The AV changes lanes in
    the ODD's time, and so do all vehicles if the ODD says so or the model says nothing; else none is quicker than the
    room beside wide vehicles allows. The AV sets its indicator.
    """
    road, initial = setting.road, setting.tables.initial
    v = w.vehicles
    slot = w.state[0].n_vehicles
    speed = min(speed, road.max_speed)
    share = initial.desire_share
    noise = math.sqrt(share * (1.0 - share)) * initial.speed_sd * v[slot].desired_speed
    v[slot].desired_speed = mean + share * (speed - mean) + noise
    if road.queue:
        end, crawl = _queue(w, road)
        speed = _eased(w, x, speed, road)
        if slot > 0 and x > end:
            v[slot].desired_speed = crawl
    if v[slot].kind == TRUCK:
        v[slot].desired_speed = min(v[slot].desired_speed, _TRUCK_SPEED)
    if slot == 0 or road.same_duration or initial.change_median == 0.0:
        v[slot].change_time = road.lane_change_duration
    else:
        time = initial.change_median * exp(initial.change_sigma * v[slot].change_time)
        least = initial.change_low
        if not road.one_size:
            least *= _narrowness(v[slot].width, road)
        v[slot].change_time = min(max(time, least), initial.change_high)
    announces = v[slot].signals < initial.signal_share * (_LOW_BITS + 1)
    v[slot].away = 0
    v[slot].signals = 1 if slot == 0 or announces else 0
    if _takes_exit(w, slot, lane, x, road):
        v[slot].signals |= EXITS
    v[slot].x = x
    v[slot].y = lane_centre(lane, road.lane_width)
    v[slot].speed = speed
    v[slot].x_held = x
    v[slot].speed_held = speed
    v[slot].lateral_speed = 0.0
    v[slot].heading = 0.0
    v[slot].acceleration = 0.0
    v[slot].commanded = 0.0
    v[slot].acceleration_held = 0.0
    v[slot].clock = 0.0
    v[slot].duration = 0.0
    v[slot].target_lane = lane
    v[slot].lanes = 1 << lane
    v[slot].present = 1
    v[slot].action = NO_ACTION
    w.state[0].n_vehicles = slot + 1


@kernel
def _fill_ahead(w: World, x: float, speed: float, lane: int, rear: int, mean: float, setting: Setting) -> None:
    """Add vehicles ahead of one at x with `speed`, up to the end of the traffic; `rear`: its slot, -1: not there.

    `mean` is the test's mean speed.
    """
    road, initial = setting.road, setting.tables.initial
    before = w.vehicles[rear].length if rear >= 0 else road.length
    while True:  # each time round takes a slot, or ends
        kind = w.vehicles[rear].kind if rear >= 0 else CAR
        own = speed
        gap, speed, quantile = _draw_neighbour(w, speed, mean, True, kind, setting.tables)
        if rear >= 0:
            _give_habit(w, rear, quantile, initial)
        if not _join(w, lane, setting):
            return
        rear = w.state[0].n_vehicles
        length = w.vehicles[rear].length
        x += 0.5 * (before + length) + _gap_there(w, x, own, gap, road)
        if x > road.traffic_length:
            return
        if _has_room(w, x, lane, speed, road):
            _place(w, x, lane, speed, mean, setting)
        before = length


@inlined_kernel
def _has_room(w: World, x: float, lane: int, speed: float, road: RoadNumbers) -> bool:
    """Is there a lane at x, and does a vehicle of its traffic drive there still?

    A ramp has less traffic than a lane. Of those in a lane that ends, most have left it before: drivers want to with
    the chance of twice their urgency u a second, so a share of exp(-20 u^2) is left of what came 20 s before.
    """
    if not road.lanes.varied:
        return True
    draw = uniform(_next_words(w)[0])
    if on_a_ramp(lane, x, road):
        return draw < _RAMP_SHARE
    time = (must_leave_by(lane, x, False, road) - x) / speed
    horizon = URGENT_TIME * road.law.urgent_time
    late = max(0.0, 1.0 - time / horizon)
    return has_lane(lane, x, road) and draw < exp(-horizon * late * late)


@kernel
def _fill_behind(w: World, x: float, speed: float, lane: int, mean: float, setting: Setting) -> None:
    """Add vehicles behind the AV, at x with `speed`, back to the begin of the traffic; `mean`: the test's speed."""
    road, initial = setting.road, setting.tables.initial
    before = road.length
    while True:  # each time round takes a slot, or ends
        if not _join(w, lane, setting):
            return
        joined = w.state[0].n_vehicles
        gap, speed, quantile = _draw_neighbour(w, speed, mean, False, w.vehicles[joined].kind, setting.tables)
        _give_habit(w, joined, quantile, initial)
        length = w.vehicles[joined].length
        x -= 0.5 * (before + length) + gap
        if x < 0.0:
            return
        if _has_room(w, x, lane, speed, road):
            _place(w, x, lane, speed, mean, setting)
        before = length


@contextmanager
def naming_tests(worlds: World) -> Iterator[None]:
    """Add the test to an `UndrawableError` from kernels, because their messages are constant.

    Args:
        worlds: World or batch in which tests start.
    """
    try:
        yield
    except UndrawableError as error:
        state = worlds.state.reshape(-1)
        for one in state[state["outcome"] == UNDRAWN][:1]:
            raise UndrawableError(f"Test {one['seed']}:{one['test']}: {error}") from None
        raise


@kernel
def clear_world(w: World, seed: int, test: int, branch: int) -> None:
    """Empty the road and set the state to the start of a test, without a likelihood budget."""
    state = w.state[0]
    state.seed = seed
    state.test = test
    state.branch = branch
    state.draw = 0
    state.n_vehicles = 0
    state.decisions = 0
    state.substep = 0
    state.controlled = NO_VEHICLE
    state.outcome = RUNNING
    state.frame = 0
    state.slot_a = 0
    state.slot_b = 0
    state.bv_crashes = 0
    state.bv_crashes_before = 0
    state.budget_left = 0
    state.budget_most = 0
    state.steers_from = 0
    state.n_current = 0
    state.n_seen = 0
    state.n_pairs = 0
    state.bv_has_answered = 0
    state.bv_action = NO_ACTION
    state.hidden = NO_VEHICLE
    state.travel = 0.0
    state.clock = 0.0
    av = w.av[0]
    av.has_answered = 0
    av.lane = 0
    av.command = 0.0
    av.steers = 0
    av.curvature = 0.0
    av.controls[:] = 0.0
    av.alarmed = 0
    for i in range(w.vehicles.size):
        w.vehicles[i].present = 0
        w.noticed[i] = 0


@inlined_kernel
def _av_lane(draw: float, road: RoadNumbers) -> int:
    """Choose one of the lanes in which the AV may start, all with the same chance, by a number in (0, 1)."""
    lanes = 0
    for lane in range(road.n_lanes):
        lanes += (road.av_lanes >> lane) & 1
    left = min(lanes - 1, math.floor(draw * lanes))
    for lane in range(road.n_lanes):
        if (road.av_lanes >> lane) & 1:
            if left == 0:
                return lane
            left -= 1
    return 0


@inlined_kernel
def linked_reset_world(w: World, seed: int, test: int, setting: Setting) -> None:
    """Do what `reset_world` does, melted into the program that calls it: 1 microsecond quicker, of 30 for a test."""
    road, initial = setting.road, setting.tables.initial
    clear_world(w, seed, test, 0)
    if setting.who.others == RAILS:
        put_on_rails(w, setting.who.rails, road)
        if road.perception.late > 0:
            begin_to_remember(w, road)
        return
    state = w.state[0]
    mask = critical_of(seed, test, setting.who)[1]
    state.budget_left = mask.budget
    state.budget_most = mask.budget if mask.excess else 0
    state.steers_from = mask.steers_from if setting.who.critical != NOBODY else 0
    if at_site(road.site):
        reset_at_site(w, setting)
        return
    av_lane = _av_lane(uniform(_next_words(w)[0]), road)
    words = _next_words(w)
    mean = initial.speed_mean + initial.stream_sd * normal_pair(words[0], words[1])[0]
    stream = max(initial.speed_low, min(initial.speed_high, mean))
    mean = _lane_speed(stream, av_lane, setting)
    speed = min(_draw_speed(w, mean, initial), road.max_speed)
    _join(w, av_lane, setting)
    _place(w, road.av_start, av_lane, speed, mean, setting)

    # The lead's speed decides the AV's desired gap, so the first link of the AV's chain is drawn here.
    gap, lead_speed, _ = _draw_neighbour(w, speed, mean, True, CAR, setting.tables)
    _join(w, av_lane, setting)
    gap = max(gap, desired_gap(speed, lead_speed - speed, setting.av.idm))
    x = road.av_start + half_lengths(w.vehicles, 0, 1) + gap
    if x <= road.traffic_length and has_lane(av_lane, x, road):
        _place(w, x, av_lane, lead_speed, mean, setting)
        _fill_ahead(w, x, lead_speed, av_lane, 1, mean, setting)
    _fill_behind(w, road.av_start, speed, av_lane, mean, setting)
    for lane in range(road.n_lanes):
        if lane != av_lane:
            start = uniform(_next_words(w)[0])
            mean = _lane_speed(stream, lane, setting)
            _fill_ahead(
                w, -initial.free_gap_low * start, _draw_speed(w, mean, initial), lane, NO_VEHICLE, mean, setting
            )
    for i in range(state.n_vehicles):
        w.order[i] = i
    all_current(w)
    if road.perception.late > 0:
        begin_to_remember(w, road)


@shared_kernel
def reset_world(w: World, seed: int, test: int, setting: Setting) -> None:
    """Put test `test` of `seed` at its start: the AV in slot 0 at `av_start`, then its lane, then the others.

    The AV's lead is no nearer than the AV's own desired gap: a closer start would itself cause crashes. The world gets
    the likelihood budget of the adversary that drives this test. A test on rails starts as they say.

    Raises:
        UndrawableError: The traffic cannot be drawn; the world's outcome is UNDRAWN then.
    """
    linked_reset_world(w, seed, test, setting)
