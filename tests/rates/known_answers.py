"""Two worlds whose crash probability is known without an estimator, and what a method of estimating must do there.

Both start by `sim.traffic.reset_world` as all tests do, so every method is used as it is shipped:

* the *chain*: a lead, the AV and a follower in one lane, always with the same gaps and speeds. Drivers choose among few
  actions, so the chance of a crash is a sum over all futures, which plain Python adds up (`reference.futures`);
* the *cut-in*: one BV in the neighbouring lane, uniform along the road, with a normal speed. It holds its speed but for
  a lane change that begins in some second or never, so the chance of a crash is an integral over place and speed.

A method is a function from a problem, a seed and a number to so many independent weights whose mean is the crash
probability: `METHODS`. The checks need nothing else of it.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from hand_built import setting_of
from numpy.typing import NDArray
from reference.drivers import AvDriver
from reference.futures import Futures, futures_of
from reference.simulator import Simulator
from reference.world import Body, World
from scipy import stats

from cornerforge.drivers.avs import AvModel
from cornerforge.drivers.idm import IdmParams
from cornerforge.drivers.mobil import MobilParams
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel
from cornerforge.rates.branching.danger import N_SEEN, WIDTH, Network
from cornerforge.rates.branching.drive import drive_trees
from cornerforge.rates.branching.population import Plan, Tilt
from cornerforge.rates.weighted import weighted_rate
from cornerforge.sim import Script, ScriptDriver, runner, scripted
from cornerforge.sim.outcome import AV_CRASH
from cornerforge.sim.scripted import START_FIELDS, TRAITS, scripted_start
from cornerforge.sim.setting import Setting
from cornerforge.types import ACTIONS, FIRST_ACCELERATION, Odd

Floats = NDArray[np.float64]

SPEED = 30.0
"""Highest speed on both roads, at which all vehicles of a faster lane go [m/s]."""


@dataclass(frozen=True)
class Problem:
    """A world to estimate the crash probability of.

    Attributes:
        name: Its name.
        odd: Its road.
        model: The drivers.
        av: The AV.
        slots: Vehicle slots, the AV's included; for who would come into one more there is no room.
        plan: How tests branch there.
    """

    name: str
    odd: Odd
    model: NddModel
    av: AvModel
    slots: int
    plan: Plan

    @property
    def setting(self) -> Setting:
        """The run."""
        return setting_of(self.model, self.odd, av=self.av)

    def slow_simulator(self) -> Simulator:
        """The same run in plain Python."""
        return Simulator(self.odd, self.model, AvDriver(self.av.idm, self.av.mobil, self.av.sight))


def with_drivers(problem: Problem, *, seldom: float = 1.0, **memory: float) -> Problem:
    """The same problem with drivers that change lanes `seldom` times as often, and numbers of their memory changed."""
    model = problem.model
    base = (seldom * model.lc_base).astype(np.float32)
    return replace(problem, model=replace(model, lc_base=base, memory=replace(model.memory, **memory)))


# Drivers


def place_of(acceleration: float) -> int:
    """Where an acceleration [m/s2] stands in a row of the tables."""
    return [action.acceleration for action in ACTIONS[FIRST_ACCELERATION:]].index(acceleration)


def by_gap(accelerations: Floats) -> NDArray[np.float32]:
    """A table `NddModel.following` that knows the gap only: one acceleration [m/s2] for each of GAPS, for sure."""
    rows = np.zeros((GAPS.size, len(ACTIONS) - FIRST_ACCELERATION), dtype=np.float32)
    rows[np.arange(GAPS.size), [place_of(a) for a in accelerations]] = 1.0
    return np.broadcast_to(rows[None, :, None], (SPEEDS.size, GAPS.size, RANGE_RATES.size, rows.shape[1])).copy()


def free(chances: dict[float, float]) -> NDArray[np.float32]:
    """A table `NddModel.free` of these accelerations [m/s2] and their chances at every speed."""
    rows = np.zeros((SPEEDS.size, len(ACTIONS) - FIRST_ACCELERATION), dtype=np.float32)
    for acceleration, chance in chances.items():
        rows[:, place_of(acceleration)] = chance
    return rows


def over_rates(by_gaps: Floats) -> NDArray[np.float32]:
    """A table over gap and range rate that knows the gap only, (116,)."""
    return np.repeat(by_gaps[:, None], RANGE_RATES.size, axis=1).astype(np.float32)


ALIKE = InitialState(
    stream_sd=0.0, follow_share=0.0, min_ttc=0.0, change_median=0.0, signal_share=1.0, noise_spread=0.0,
    vigilance_sigma=0.0, rr_scale=1e3,
)  # fmt: skip
"""Drivers without traits of their own: whatever is drawn for them does not matter. The speeds of neighbours are
independent, since no gap is small beside `rr_scale`."""


# Networks by hand


def _network(units: Mapping[str, tuple[float, float, Mapping[int, float]]], least: float) -> Network:
    """A network by hand: log danger is that of `least`, plus for each unit what is seen, weighted, above a threshold.

    Args:
        units: By what they stand for: factor, threshold, and the weights of what is seen (`danger.look_at`).
        least: Least danger.
    """
    first, second = (np.zeros((k, WIDTH), dtype=np.float32) for k in (N_SEEN, WIDTH))
    bias, last = np.zeros(WIDTH, dtype=np.float32), np.zeros(WIDTH + 1, dtype=np.float32)
    for unit, (factor, threshold, weights) in enumerate(units.values()):
        for seen, weight in weights.items():
            first[seen, unit] = weight
        bias[unit], second[unit, unit], last[unit] = -threshold, 1.0, factor
    last[WIDTH] = math.log(least)
    return Network(first, bias, second, np.zeros(WIDTH, dtype=np.float32), last)


_NEARNESS, _SIDE, _IN_LANE, _CHANGE_LEFT, _WAS_AWAY, _IS_AWAY = 1, 2, 7, 9, 12, 13
"""Places of what is seen: 1 / (1 + 0.3 gap); ahead 1, behind -1; in the AV's lane or coming there; rest of a lane
change; its driver looked away; it does now."""


def wary(least: float) -> Network:
    """Dangerous is a BV behind the AV whose driver looks away or changes lanes, the nearer the more."""
    behind = {_SIDE: -1.0, _WAS_AWAY: 0.5, _IS_AWAY: 1.0, _CHANGE_LEFT: 1.0, _NEARNESS: 4.0}
    return _network({"careless": (2.0, 2.5, behind)}, least)


def wary_of_who_comes_in(least: float) -> Network:
    """Dangerous is a BV within 25 m, and more so one that changes into the AV's lane."""
    near = {_NEARNESS: 1.0}
    return _network({"near": (6.0, 0.12, near), "comes": (4.0, 1.3, {**near, _CHANGE_LEFT: 1.0, _IN_LANE: 1.0})}, least)


def plan_with(network: Network, level: float, explore: float = 0.02) -> Plan:
    """Plan trees by a network, at a level of weight times danger."""
    return Plan(level, 0.3 * level, 0.1, explore, 1, 10.0, 2.0, network)


# The chain

AV_AT, BEHIND, AHEAD = 35.0, 5.0, 12.0
"""Where the AV starts, and its gaps to the follower and the lead [m]."""
CHAIN_S = 4
"""How long a test of the chain takes [s]: so many decisions."""


@cache
def chain() -> Problem:
    """A lead, the AV and a follower, 12 m and 5 m apart, all at 30 m/s; the other lane is empty.

    In each second the lead brakes with 4 m/s2 (chance 0.1) or holds its speed; the follower brakes by its gap. Both may
    begin a lane change (0.1) or look away (0.2, and then again 0.5). The AV brakes a little, and a lot or changes
    lanes where the lead brakes.
    """
    initial = replace(ALIKE, speed_mean=SPEED + 5.0, speed_sd=1e-3, free_gap_low=BEHIND, free_gap_high=BEHIND)
    accept = over_rates(np.clip(GAPS / 40.0, 0.0, 1.0))
    model = NddModel(
        following=by_gap(np.select([GAPS < 8.0, GAPS < 14.0, GAPS < 30.0], [-4.0, -2.0, -0.6], 0.0)),
        free=free({-4.0: 0.1, 0.0: 0.9}),
        free_pull=0.0,
        lc_base=np.full(SPEEDS.size, 0.1, dtype=np.float32),
        lc_desire=over_rates(np.ones(GAPS.size)),
        lc_desire_free=1.0,
        lc_accept_lead=accept,
        lc_accept_rear=accept,
        lc_turn_back=over_rates(np.where(GAPS < 3.0, 0.5, 0.0)),
        overlook=0.3,
        overlook_conflict=0.3,
        memory=Memory(away=0.2, away_again=0.5),
        initial=initial,
        provenance={},
    )
    # At the start leads are faster before they are cut to 30 m/s, so the AV wants no more than its gap at standstill.
    idm = IdmParams(standstill_gap=AHEAD, time_gap=0.1, max_braking=3.0)
    odd = Odd(
        name="chain", n_lanes=2, max_speed=SPEED, time_limit=CHAIN_S, test_length=1e3, av_start=AV_AT,
        traffic_length=AV_AT + 18.0, av_substeps=10,
    )  # fmt: skip
    av = AvModel(
        "close", "Follows closely, and changes lanes only where it gains much.", idm, MobilParams(min_gain=3.0)
    )
    return Problem("chain", odd, model, av, 3, plan_with(wary(1e-2), 0.1))


def start_of_chain(problem: Problem, lane: int) -> World:
    """The start of the chain in plain Python, as said in `chain`."""
    world = World(problem.odd)
    length = problem.odd.vehicle_length
    for x in (AV_AT, AV_AT + length + AHEAD, AV_AT - length - BEHIND):
        body = Body(0, length, problem.odd.vehicle_width, 0.5, 0.5, SPEED, problem.odd.lane_change_duration, True)
        world.place(x, lane, SPEED, body)
    return world


def chain_answer(problem: Problem, lane: int = 0) -> Futures:
    """All futures of the chain with the AV in a lane; both lanes are mirror images."""
    return futures_of(problem.slow_simulator(), start_of_chain(problem, lane))


# The cut-in

CUT_IN_S, CHANGE_S = 5, 6.0
"""How long a test of the cut-in takes, and a lane change in it [s]: one that has begun is not over when the test is."""
MEAN_SPEED, SPREAD = 25.0, 1.0
"""Of the speeds in the right lane [m/s]; in the left one it is SPEED."""
REACH, MIDDLE = 60.0, 35.0
"""The BV starts up to REACH / 2 behind or ahead of the AV, which starts at MIDDLE [m, centre to centre]."""


@cache
def cut_in() -> Problem:
    """The AV and one BV in the other of two lanes.

    In the left lane everybody starts with 30 m/s, in the right one with a speed that is normal, 25 and 1 m/s. The AV's
    lane is drawn, and the BV is uniform within 30 m of the AV. The BV holds its speed (behind a lead nearer than 20 m
    it brakes with 1 m/s2); in each second it wants to change lanes with the chance 0.2, accepts a gap of g m with the
    chance g / 30 and overlooks the AV with 0.1. It turns back where the AV is beside it, unless it overlooks it. Nobody
    looks away.
    """
    initial = replace(
        ALIKE, speed_mean=MEAN_SPEED + 5.0, speed_sd=SPREAD, free_gap_low=REACH, free_gap_high=REACH
    )  # fmt: skip
    accept = over_rates(np.clip(GAPS / 30.0, 0.0, 1.0))
    model = NddModel(
        following=by_gap(np.where(GAPS < 20.0, -1.0, 0.0)),
        free=free({0.0: 1.0}),
        free_pull=0.0,
        lc_base=np.full(SPEEDS.size, 0.2, dtype=np.float32),
        lc_desire=over_rates(np.ones(GAPS.size)),
        lc_desire_free=1.0,
        lc_accept_lead=accept,
        lc_accept_rear=accept,
        lc_turn_back=over_rates(np.zeros(GAPS.size)),
        overlook=0.1,
        overlook_conflict=0.1,
        memory=Memory(),
        initial=initial,
        provenance={},
    )
    odd = Odd(
        name="cut-in", n_lanes=2, max_speed=SPEED, time_limit=CUT_IN_S, test_length=1e3, av_start=MIDDLE,
        traffic_length=REACH + 5.0, slower_right=10.0, lane_change_duration=CHANGE_S,
    )  # fmt: skip
    av = AvModel("usual", "IDM and MOBIL.", IdmParams(), MobilParams())
    return Problem("cut-in", odd, model, av, 3, plan_with(wary_of_who_comes_in(3e-3), 0.08))


def start_of_cut_in(problem: Problem, av_lane: int, off: float, speed: float) -> NDArray[np.void]:
    """A start of the cut-in, (2,) of `sim.world.VEHICLE`.

    Args:
        problem: The cut-in.
        av_lane: Lane of the AV; the BV is in the other one.
        off: Where the BV is, seen from the AV [m], ahead is positive.
        speed: In the right lane [m/s].
    """
    odd = problem.odd
    values = {name: np.zeros(2) for name in START_FIELDS}
    lanes = np.array([av_lane, 1 - av_lane])
    values["x"] = np.array([MIDDLE, MIDDLE + off])
    values["y"] = (lanes + 0.5) * odd.lane_width
    values["speed"] = np.where(lanes == 0, min(speed, SPEED), SPEED)
    values["target_lane"], values["lanes"] = lanes.astype(np.float64), (1 << lanes).astype(np.float64)
    values["length"], values["width"] = np.full(2, odd.vehicle_length), np.full(2, odd.vehicle_width)
    values["change_time"] = np.full(2, CHANGE_S)
    values["signals"] = values["inattention"] = np.ones(2)
    values["quantile"] = np.full(2, 0.5)
    assert set(TRAITS) <= set(values)
    return scripted_start(np.stack([values[name] for name in START_FIELDS], axis=1).astype(np.float64))


def chance_from(driver: ScriptDriver, start: NDArray[np.void]) -> float:
    """Chance of a crash from one start of the cut-in: a sum over all that the BV may do in each second.

    That is to begin its lane change, and to turn back where the AV is beside it, or not. Else one action is certain.
    """
    slot = np.arange(2, dtype=np.int16)

    def after(begun: list[int], chance: float) -> float:
        """Chance of all futures that begin with these actions, of that chance together, and end in a crash."""
        script = np.full((CUT_IN_S, 2), scripted.NATURAL, dtype=np.int8)
        script[: len(begun), 1] = begun
        drive, chances = driver.record(Script(slot, start, script))
        taken = drive.action[:, 1].tolist()  # where the script says scripted.NATURAL, the likeliest
        total = 0.0
        for second in range(len(begun), len(taken)):
            p = chances[second, 1]
            for action in np.flatnonzero(p > 0.0).tolist():
                if action != taken[second]:
                    total += after([*taken[:second], action], chance * float(p[action]))
            chance *= float(p[taken[second]])
        return total + (chance if drive.crash is not None else 0.0)

    return after([], 1.0)


def chances_from(problem: Problem, offs: Floats, speed: float) -> list[float]:
    """Chances of a crash from starts of the cut-in at these places and a speed; the AV in either lane."""
    driver = ScriptDriver(problem.setting, problem.odd)
    return [chance_from(driver, start_of_cut_in(problem, lane, off, speed)) for off in offs.tolist() for lane in (0, 1)]


def cut_in_answer(problem: Problem, places: int, speeds: int) -> float:
    """Chance of a crash in the cut-in: the integral over the BV's place and the speed in the right lane.

    The speeds stand in the middle of equally likely shares, and so do the places in the mean (midpoint rule): those of
    one speed are shifted against those of the next by a golden section of their distance. The crashes end at edges,
    slanting in place and speed; without shifts, points of an edge would be wrong together.

    Args:
        problem: The cut-in.
        places, speeds: How many of each.
    """
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    total = 0.0
    for row in range(speeds):
        # The truncation at 20 and 40 m/s cuts off 6e-7, and of the left lane's speeds 3e-7 are below SPEED.
        speed = MEAN_SPEED + SPREAD * float(stats.norm.ppf((row + 0.5) / speeds))
        offs = REACH * ((np.arange(places) + (row + 1) * golden % 1.0) / places - 0.5)
        total += math.fsum(chances_from(problem, offs, speed))
    return total / (2 * speeds * places)


# Methods

Weights = Callable[[Problem, int, int], Floats]
"""A method: problem, seed and n, to n independent weights whose mean is the crash probability."""


def count(problem: Problem, seed: int, n: int) -> Floats:
    """Plain tests: 1 for a crash of the AV, else 0."""
    ends = runner.drive_chunk(problem.setting, problem.slots, seed, 0, n, False)[0].code
    return (ends == AV_CRASH).astype(np.float64)


def split(problem: Problem, seed: int, n: int) -> Floats:
    """Trees of tests, by the problem's plan."""
    trees = drive_trees(problem.setting, problem.slots, problem.plan, seed=seed, first=0, tests=n, threads=1).trees
    assert trees["lost"].sum() == 0
    return trees["weight"].copy()


def draw_from_proposals(problem: Problem, seed: int, n: int) -> Floats:
    """Tests drawn from proposals by the problem's plan: importance sampling."""
    tilt = Tilt(np.array([0.1, 0.5, 0.4]), np.array([0.0, 1.0, 1.6]), 3)
    return split(replace(problem, plan=problem.plan._replace(tilt=tilt)), seed, n)


METHODS: dict[str, Weights] = {"mc": count, "splitting": split, "is": draw_from_proposals}


def taught(problem: Problem, seed: int) -> tuple[Problem, int]:
    """The problem with a plan that was really taught, with fewer trees than a user's; needs torch.

    Returns:
        The problem, and how many seconds of worlds teaching drove.
    """
    teaching = importlib.import_module("cornerforge.rates.teaching")
    seconds = []
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "_EXPLORING": 4_000,
            "_ROUNDS": (4_000, 8_000, 16_000),
            "_STEPS": 1_500,
            "_PILOT": 1_000,
        }.items():
            patch.setattr(teaching, name, value)
        found = teaching.teach(
            problem.setting, problem.slots, seed=seed, threads=1,
            tell=lambda _, driven: seconds.append(int(driven.trees["seconds"].sum())),
        )  # fmt: skip
    return replace(problem, plan=teaching.plan_of(found.network, found.level)), sum(seconds)


# What a method must do

SIGMAS = 4.9
"""A mean that is right is further off with a chance of 1e-6."""
EFFECTIVE = 350
"""So many effective weights an estimate gets in the mean: enough that nearly all are out of doubt."""


def enough(weights: Weights, problem: Problem, seed: int, pilot: int = 4_000) -> int:
    """How many weights make EFFECTIVE, by a pilot of so many or more."""
    while (found := weighted_rate(weights(problem, seed, pilot))).effective < 0.5 * EFFECTIVE:
        pilot *= 2
    return math.ceil(pilot * EFFECTIVE / found.effective)


@dataclass(frozen=True)
class Repeated:
    """Many estimates of one crash probability that is known.

    Attributes:
        answer: The probability; off: how exactly it is known.
        rates: The estimates, (runs,); low, high: their 95 % intervals.
        effective: Effective weights of each.
    """

    answer: float
    off: float
    rates: Floats
    low: Floats
    high: Floats
    effective: Floats

    @property
    def mean(self) -> float:
        """Mean of the estimates."""
        return float(self.rates.mean())

    @property
    def error(self) -> float:
        """Standard error of the mean, and of the answer; from the scatter of the estimates, not from what they say."""
        return math.hypot(float(self.rates.std(ddof=1)) / math.sqrt(self.rates.size), self.off)

    @property
    def covered(self) -> int:
        """How many intervals hold the answer."""
        return int(((self.low <= self.answer) & (self.answer <= self.high)).sum())

    @property
    def detectable(self) -> float:
        """Weights that are wrong by this factor less 1 are caught but for a chance of 1e-6; infinite for none."""
        away = 2.0 * SIGMAS * self.error
        return away / (self.answer - away) if away < self.answer else math.inf

    def mean_is_right(self) -> bool:
        """Is the mean of the estimates the answer, as far as they can tell?"""
        return abs(self.mean - self.answer) <= SIGMAS * self.error

    def times(self, factor: float) -> Repeated:
        """The same with all weights this many times as large; intervals of weights go with their scale."""
        return replace(self, rates=factor * self.rates, low=factor * self.low, high=factor * self.high)

    def told(self) -> str:
        """The numbers in a line."""
        runs = self.rates.size
        return (
            f"{self.covered / runs:.3f} of {runs} intervals hold {self.answer:.5g} (+- {self.off:.1g}); mean "
            f"{self.mean:.5g} +- {self.error:.2g}; {self.effective.mean():.0f} effective, least "
            f"{self.effective.min():.0f}; an error of {100.0 * self.detectable:.2g} % is seen"
        )


def repeat(
    weights: Weights, problem: Problem, answer: float, *, off: float = 0.0, seed: int, n: int, runs: int
) -> Repeated:
    """Estimate again and again, with a seed of its own each time, from n weights each."""
    found = [weighted_rate(weights(problem, seed + run, n)) for run in range(runs)]
    columns = (np.array([getattr(one, name) for one in found]) for name in ("rate", "low", "high", "effective"))
    return Repeated(answer, off, *columns)
