"""The AV's car following in the simulator against a fine integration of the IDM's differential equation.

The simulator decides every 0.1 s, holds the acceleration in between and moves in closed form. The reference integrates
dv/dt = IDM(v, gap, rate) by Heun's method with steps of 1 ms, in NumPy, with the IDM's formula written once more. As
the time between two decisions shrinks, the simulator's motion must come nearer to it in proportion.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numba
import numpy as np
from measuring import table

from cornerforge.drivers.avs import AVS, AvModel, numbers_of_av
from cornerforge.drivers.idm import IdmNumbers, IdmParams, idm_acceleration
from cornerforge.drivers.mobil import MobilParams
from cornerforge.drivers.sight import Sight
from cornerforge.experiment.setting import experiment
from cornerforge.road.straight import road_numbers
from cornerforge.sim.actions import hold
from cornerforge.sim.controllers import TOLD
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.loop import BV_MUST_ANSWER, NEVER, advance, answer_as_bv
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.outcome import RUNNING
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.step import allocate_recording
from cornerforge.sim.world import NO_VEHICLE, VEHICLE, all_current, allocate_worlds, world_of
from cornerforge.types import ACCELERATIONS, Odd

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.setting import Setting

    Floats = NDArray[np.float64]

__all__ = [
    "FollowingError",
    "Leads",
    "compare_all",
    "held_decisions",
    "random_leads",
    "reference",
    "render",
    "simulated",
]

LENGTH = 5.0
SECONDS = 40
_ODD = Odd(test_length=1e5, time_limit=3600.0, av_start=0.0, max_jerk=math.inf)
_STUBBORN = MobilParams(min_gain=10.0)
"""No gain is so large: the AV keeps its lane."""


@dataclass(frozen=True)
class Leads:
    """Leads that hold an acceleration for a second each, and how the AV starts behind them.

    Attributes:
        action: Index of the acceleration in each second, shape (runs, SECONDS).
        gap, speed, lead_speed: At the start [m], [m/s], shape (runs,).
    """

    action: NDArray[np.int64]
    gap: Floats
    speed: Floats
    lead_speed: Floats


@dataclass(frozen=True)
class FollowingError:
    """Largest and root-mean-square errors over all runs and moments, against the reference.

    Attributes:
        step: Time between two decisions [s].
        gap, gap_rms: [m].
        speed, speed_rms: [m/s].
    """

    step: float
    gap: float
    gap_rms: float
    speed: float
    speed_rms: float


def random_leads(runs: int, seed: int = 0) -> Leads:
    """Mild and hard manoeuvres around 25 m/s, every fourth lead to standstill and off again, all within sight.

    The AV starts above its desired gap at that speed.
    """
    rng = np.random.default_rng(seed)
    speed = rng.uniform(10.0, 33.0, runs)
    lead_speed = np.clip(speed + rng.normal(0.0, 2.0, runs), 0.0, 40.0)
    action = np.zeros((runs, SECONDS), dtype=np.int64)
    now = lead_speed
    for second in range(SECONDS):
        wish = rng.normal(0.0, 1.2, runs) + 0.2 * (25.0 - now)
        if 8 <= second < 28:
            wish[::4] = -3.0
        action[:, second] = np.clip(np.rint((wish + 4.0) * 5.0), 0, 30)
        now = np.clip(now + ACCELERATIONS[action[:, second]], 0.0, 40.0)
    return Leads(action, 6.0 + 2.2 * speed, speed, lead_speed)


def _lead_motion(leads: Leads, steps: int) -> tuple[Floats, Floats]:
    """Centres [m] and speeds [m/s] of the leads, shape (SECONDS * steps + 1, runs); the AV starts at 0."""
    x, v = leads.gap + LENGTH, leads.lead_speed
    xs, vs = [x], [v]
    t = np.arange(1, steps + 1)[:, None] / steps
    for second in range(SECONDS):
        a = ACCELERATIONS[leads.action[:, second]]
        end = np.clip(v + a * t, 0.0, _ODD.max_speed)
        moving = np.divide(end - v, a, out=t * np.ones_like(v), where=a != 0.0)  # time until a bound is met
        xs.extend(x + 0.5 * (v + end) * moving + end * (t - moving))
        vs.extend(end)
        x, v = xs[-1], vs[-1]
    return np.array(xs), np.array(vs)


def _idm(v: Floats, gap: Floats, lead_v: Floats, p: IdmParams) -> Floats:
    """The IDM's command, cut to the AV's limits, written independently of the package."""
    dynamic = v * p.time_gap + v * (v - lead_v) / (2.0 * np.sqrt(p.max_acceleration * p.comfortable_braking))
    wanted = p.standstill_gap + np.maximum(dynamic, 0.0)
    command = p.max_acceleration * (1.0 - (v / p.desired_speed) ** 4 - (wanted / np.maximum(gap, 0.1)) ** 2)
    return np.clip(command, -p.max_braking, p.max_acceleration)


def reference(leads: Leads, p: IdmParams, *, steps: int = 1000) -> tuple[Floats, Floats]:
    """Gap [m] and speed [m/s] of the continuous IDM every 0.1 s, shape (10 SECONDS + 1, runs).

    Args:
        leads: The leads that it follows.
        p: Parameters.
        steps: Per second, a multiple of 10.
    """
    lead_x, lead_v = _lead_motion(leads, steps)
    h = 1.0 / steps
    x, v = np.zeros_like(leads.speed), leads.speed.copy()
    gaps, speeds = [lead_x[0] - x - LENGTH], [v]
    for k in range(SECONDS * steps):
        a = _idm(v, lead_x[k] - x - LENGTH, lead_v[k], p)
        v_guess = np.maximum(v + h * a, 0.0)
        b = _idm(v_guess, lead_x[k + 1] - (x + h * v) - LENGTH, lead_v[k + 1], p)
        after = np.maximum(v + 0.5 * h * (a + b), 0.0)
        x = x + 0.5 * h * (v + after)
        v = after
        if (k + 1) % (steps // 10) == 0:
            gaps.append(lead_x[k + 1] - x - LENGTH)
            speeds.append(v)
    return np.array(gaps), np.array(speeds)


@numba.njit(error_model="numpy")
def _follow(
    v: NDArray[np.void], lead_x: Floats, lead_v: Floats, idm: IdmNumbers, road: RoadNumbers, h: float,
    gaps: Floats, speeds: Floats,
) -> None:  # fmt: skip
    """Drive vehicle 0 behind a lead, deciding at each of its places; `gaps` and `speeds` take what follows each."""
    for k in range(gaps.size):
        hold(v, 0, idm_acceleration(v[0].speed, lead_x[k] - v[0].x - LENGTH, lead_v[k] - v[0].speed, idm), road)
        move_vehicle(v, 0, h, road)
        gaps[k] = lead_x[k + 1] - v[0].x - LENGTH
        speeds[k] = v[0].speed


def held_decisions(leads: Leads, p: IdmParams, per_second: int) -> tuple[Floats, Floats]:
    """As `reference`, with the package's IDM deciding `per_second` times a second and its closed-form motion."""
    lead_x, lead_v = _lead_motion(leads, per_second)
    numbers, road = IdmNumbers(*astuple(p)), road_numbers(_ODD)
    gaps, speeds = np.zeros_like(lead_x), np.zeros_like(lead_x)
    gaps[0], speeds[0] = leads.gap, leads.speed
    for run in range(leads.speed.size):
        v = np.zeros(1, dtype=VEHICLE)
        v["speed"] = leads.speed[run]
        _follow(
            v, lead_x[:, run], lead_v[:, run], numbers, road, 1.0 / per_second, gaps[1:, run], speeds[1:, run]
        )  # fmt: skip
    return gaps[:: per_second // 10], speeds[:: per_second // 10]


def simulated(leads: Leads, p: IdmParams) -> tuple[Floats, Floats]:
    """As `reference`, driven by the simulator itself: the AV behind one BV that is told its accelerations."""
    setting = experiment(av="idm-mobil").setting._replace(
        road=road_numbers(_ODD), av=numbers_of_av(AvModel("", "", p, _STUBBORN, Sight("decision")))
    )
    setting = setting.with_drivers(critical=TOLD)
    motion = [_simulated_run(leads, run, setting) for run in range(leads.speed.size)]
    return np.array([gap for gap, _ in motion]).T, np.array([speed for _, speed in motion]).T


def _simulated_run(leads: Leads, run: int, setting: Setting) -> tuple[Floats, Floats]:
    w = world_of(allocate_worlds(1, 2))
    v = w.vehicles
    v["x"], v["speed"] = (0.0, leads.gap[run] + LENGTH), (leads.speed[run], leads.lead_speed[run])
    v["y"], v["lanes"], v["present"], v["action"] = 2.0, 1, 1, -1
    w.order[:] = 0, 1
    w.state["n_vehicles"], w.state["controlled"], w.state["outcome"] = 2, NO_VEHICLE, RUNNING
    all_current(w)
    frames = allocate_recording(10 * SECONDS + 1, 2)
    scratch, keep = allocate_scratch(2, setting.who.policy), keep_nothing(2)._replace(recording=frames)
    for action in leads.action[run]:
        answer_as_bv(w, 2 + action)
        if advance(w, setting, scratch, keep, NEVER) != BV_MUST_ANSWER:
            raise RuntimeError("A run of car following ended before its time.")
    # The frame that a second begins with is written when it begins; the last one stands in the world.
    x = np.append(frames["x"][:-1, 1] - frames["x"][:-1, 0], v["x"][1] - v["x"][0])
    return x - LENGTH, np.append(frames["speed"][:-1, 0], v["speed"][0])


def _error(step: float, motion: tuple[Floats, Floats], truth: tuple[Floats, Floats]) -> FollowingError:
    gap, speed = motion[0] - truth[0], motion[1] - truth[1]
    return FollowingError(
        step,
        float(np.abs(gap).max()),
        float(np.sqrt((gap**2).mean())),
        float(np.abs(speed).max()),
        float(np.sqrt((speed**2).mean())),
    )


def compare_model(model: AvModel, *, runs: int, seed: int = 0) -> list[FollowingError]:
    """Errors of the simulator (0.1 s), then of closed-form motion with decisions 2, 4 and 8 times as often.

    Raises:
        RuntimeError: The simulator does not drive as the same decisions outside it, or the errors do not shrink.
    """
    leads = random_leads(runs, seed)
    truth = reference(leads, model.idm)
    ours, same = simulated(leads, model.idm), held_decisions(leads, model.idm, 10)
    if max(np.abs(a - b).max() for a, b in zip(ours, same, strict=True)) > 1e-8:
        raise RuntimeError(f"The simulator's {model.name} does not drive as its own IDM and motion say.")
    errors = [_error(0.1, ours, truth)]
    errors += [_error(1.0 / n, held_decisions(leads, model.idm, n), truth) for n in (20, 40, 80)]
    if any(fine.gap > 0.6 * coarse.gap for coarse, fine in pairwise(errors)):
        raise RuntimeError(f"{model.name}: the error in car following does not shrink with the step.")
    return errors


def compare_all(*, runs: int) -> dict[str, list[FollowingError]]:
    """Both AV parameter sets."""
    return {name: compare_model(AVS[name], runs=runs) for name in ("idm-mobil", "idm-mobil-d2rl")}


def render(errors: dict[str, list[FollowingError]], runs: int) -> str:
    """The section's Markdown."""
    rows = [
        (f"`{name}`, {'the simulator' if k == 0 else 'same motion'}, decisions every {1e3 * e.step:g} ms",
         f"{e.gap:.4f}", f"{e.gap_rms:.4f}", f"{e.speed:.4f}", f"{e.speed_rms:.4f}")
        for name, series in errors.items() for k, e in enumerate(series)
    ]  # fmt: skip
    head = ("error in car following", "gap, max [m]", "gap, rms [m]", "speed, max [m/s]", "speed, rms [m/s]")
    return (
        f"{table(head, rows)}\n\n"
        f"{runs} runs of {SECONDS} s each behind leads that change their acceleration every second, a quarter of them\n"
        "to standstill and off again, against the continuous IDM (Heun, 1 ms). Errors shrink with the step, to first\n"
        "order: what is left at 0.1 s is the AV's reaction time, not its kinematics."
    )
