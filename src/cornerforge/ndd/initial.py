"""Traffic at the start of a test: the numbers of its law, which values they may have, and whether it can be drawn.

Kernels draw speeds and gaps until they suit (`sim/traffic.py`). A law of which hardly anything suits is refused here,
where a model enters (docs/adr/0049-no-endless-drawing.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from cornerforge._schema import Share, check_fields, meant
from cornerforge.errors import FileFormatError, InputError
from cornerforge.types import CLASSES

__all__ = ["LEAST_ACCEPTED", "InitialState", "accepted_share", "check_initial", "check_numbers", "traffic_at_start"]

Floats = NDArray[np.float64]

LEAST_ACCEPTED = 0.02
"""Least share of draws that must suit. A kernel gives up after 10,000 refused draws in a row: at this share the chance
of that is 1e-88."""
_SIGMAS = (-4.0, -2.0, 0.0, 2.0, 4.0)
"""Mean speeds of tests, and speeds in them, that are looked at, in standard deviations; not both at an outer one."""
_LEVELS = 24
"""Equally frequent values that stand for a random number."""
_NORMAL: Floats = np.array([NormalDist().inv_cdf((k + 0.5) / _LEVELS) for k in range(_LEVELS)])
_UNIFORM: Floats = (np.arange(_LEVELS) + 0.5) / _LEVELS


@dataclass(frozen=True)
class InitialState:
    """Traffic at the start of a test: a chain of vehicles per lane.

    All lanes of one test share a mean speed m, normal with `speed_mean` and `stream_sd`. Speeds are normal about m with
    `speed_sd`, cut to [speed_low, speed_high]. The next vehicle ahead follows with probability `follow_share`, at a
    time gap of `time_gap_shift` plus a log-normal part, else at a uniform free gap. Its speed is m + sqrt(1 - (s /
    speed_sd)^2) (v - m) + s z with s = rr_scale (gap / 20)^rr_exponent, at most speed_sd, and z standard normal, which
    keeps the distribution of speeds along the chain. States with a time to collision below `min_ttc` are drawn again.

    What stays with a driver: its desired speed, given its speed v normal with mean m + desire_share (v - m), so that
    `desire_share` of the variance of speeds lies between drivers; and its habit (`Memory`), for a follower one minus
    the quantile of its time gap, give or take `habit_spread` (1: independent of it). How long its undisturbed lane
    changes take is log-normal, cut to [change_low, change_high]; a `change_median` of 0: all take as long as the ODD
    says. `signal_share` of the drivers set the indicator before they change lanes. Its noise level t, -1 to 1: it uses
    the outer quarters of the acceleration's distribution with density 1 + t (`memory.own_rank`). The odds of an
    acceleration there, (1 + t) / (1 - t), are log-normal with median 1 and `noise_spread`. How many times as often
    as all drivers it begins to look away is log-normal with mean 1 and `vigilance_sigma`, cut at 20.

    The ranges are wide: what lies beyond is no highway.
    """

    speed_mean: Annotated[float, meant("Mean over tests.", "m/s", 0, 60)] = 30.05
    stream_sd: Annotated[float, meant("Spread of the tests' means.", "m/s", 0, 10)] = 2.9
    speed_sd: Annotated[float, meant("Spread within a test.", "m/s", 0.001, 25)] = 1.8
    speed_low: Annotated[float, meant("Least speed.", "m/s", 0, 60)] = 20.0
    speed_high: Annotated[float, meant("Largest speed.", "m/s", 1, 80)] = 40.0
    follow_share: Share = 0.682
    time_gap_shift: Annotated[float, meant("Least time gap of a follower.", "s", 0, 5)] = 0.265
    time_gap_median: Annotated[float, meant("Of its log-normal part.", "s", 0.01, 10)] = 0.92
    time_gap_sigma: Annotated[float, meant("Of its log-normal part.", "", 0, 2)] = 0.68
    desire_share: Share = 0.33
    habit_spread: Share = 1.0
    rr_scale: Annotated[float, meant("Spread of range rates at 20 m.", "m/s", 0, 1000)] = 0.8
    rr_exponent: Annotated[float, meant("Growth of it with the gap.", "", 0, 3)] = 0.46
    min_ttc: Annotated[float, meant("Least time to collision.", "s", 0, 20)] = 2.5
    free_gap_low: Annotated[float, meant("Least free gap.", "m", 1, 1000)] = 120.0
    free_gap_high: Annotated[float, meant("Largest free gap.", "m", 1, 1000)] = 300.0
    change_median: Annotated[float, meant("Time of a lane change.", "s", 0, 30)] = 6.3
    change_sigma: Annotated[float, meant("Of its log-normal law.", "", 0, 2)] = 0.35
    change_low: Annotated[float, meant("Shortest lane change.", "s", 0.5, 30)] = 4.2
    change_high: Annotated[float, meant("Longest lane change.", "s", 0.5, 30)] = 17.0
    signal_share: Share = 0.52
    noise_spread: Annotated[float, meant("Of the odds of an outer acceleration.", "", 0, 2)] = 0.166
    vigilance_sigma: Annotated[float, meant("Of how often a driver looks away.", "", 0, 1.5)] = 0.8


DENSE = {
    "speed_mean": 13.7, "stream_sd": 3.3, "speed_low": 3.0, "speed_high": 25.0, "follow_share": 0.97,
    "time_gap_median": 1.2, "time_gap_sigma": 0.55, "rr_scale": 1.2,
}  # fmt: skip
"""Numbers of dense traffic: US-101's speeds (949 vehicles of 27 clips: 13.7 m/s, standard deviation of the clips' means
3.3), and time gaps of US-101 and the HOV lane of I-80 (at 12 to 16 m/s 0.7, 1.06, 1.5, 2.1, 3.6 s at 5, 25, 50, 75 and
95 %). Range rates: the followers of I-80 at 8 to 12 m/s have a spread of 1.27 m/s at 15 m."""


def traffic_at_start(initial: InitialState, traffic: str) -> InitialState:
    """Give the law of the traffic at the start, by its kind (`types.TRAFFIC`); that before a queue is free."""
    return replace(initial, **DENSE) if traffic == "dense" else initial


_ASCENDING = (
    ("speed_mean", "speed_high"), ("speed_low", "speed_mean"), ("free_gap_low", "free_gap_high"),
    ("change_low", "change_high"),
)  # fmt: skip


def check_numbers(part: object) -> None:
    """Check the numbers of a part of a model against the ranges that its fields declare.

    Raises:
        FileFormatError: One is no finite number, or out of its range; the message names it.
    """
    try:
        check_fields(part, "Model number ")
    except InputError as error:
        raise FileFormatError(str(error)) from error


def check_initial(initial: InitialState) -> None:
    """Check that traffic can be drawn: of each draw, in any likely state, at least `LEAST_ACCEPTED` must suit.

    Speeds by their normal distribution, neighbours by equally frequent values of their random numbers; some 18 ms.

    Args:
        initial: Its numbers are within their ranges (`check_numbers`).

    Raises:
        FileFormatError: A lower limit is above its upper one, or hardly any draw would suit; the message names the
            numbers that refuse most.
    """
    for one, other in _ASCENDING:
        value, limit = getattr(initial, one), getattr(initial, other)
        if value > limit:
            raise FileFormatError(f"Model number {one} = {value} is above {other} = {limit}; it must not be.")
    low, high, sd = initial.speed_low, initial.speed_high, initial.speed_sd
    inside = NormalDist().cdf((high - low) / sd) - 0.5  # about a mean at either end: there the fewest suit
    if inside < LEAST_ACCEPTED:
        raise FileFormatError(
            f"Hardly any speed can be drawn: {_percent(inside)} with speed_sd = {sd:g} m/s about speed_low = {low:g} "
            f"m/s lie between it and speed_high = {high:g} m/s; {_percent(LEAST_ACCEPTED)} must. Take a smaller "
            "speed_sd or limits farther apart."
        )
    for ahead in (True, False):
        for factor in sorted({user.time_gap for user in CLASSES}):
            for sigma in _SIGMAS:
                mean = min(max(initial.speed_mean + sigma * initial.stream_sd, low), high)
                others = [other for other in _SIGMAS if abs(sigma) + abs(other) < 8.0]
                speeds = np.clip(mean + sd * np.array(others), low, high)
                accepted, refused = accepted_share(initial, speeds, mean, ahead=ahead, factor=factor)
                worst = int(accepted.argmin())
                if accepted[worst] < LEAST_ACCEPTED:
                    reason = max(refused, key=lambda name: float(refused[name][worst]))
                    raise FileFormatError(
                        f"Hardly any vehicle {'ahead of' if ahead else 'behind'} one at {speeds[worst]:.3g} m/s can be "
                        f"drawn: {_percent(float(accepted[worst]))} suit where traffic has a mean of {mean:.3g} m/s; "
                        f"{_percent(LEAST_ACCEPTED)} must. Most are refused by {_said(initial, reason)}."
                    )


_REASONS = {
    "speed": ("speed_low", "speed_high", "speed_sd", "rr_scale"),
    "near": ("time_gap_shift", "time_gap_median", "time_gap_sigma"),
    "far": ("free_gap_low", "time_gap_shift", "time_gap_median", "time_gap_sigma"),
    "ttc": ("min_ttc", "rr_scale", "speed_sd"),
}
"""Reason for refusing a draw -> the numbers that decide it."""


def _said(initial: InitialState, reason: str) -> str:
    named = ", ".join(f"{name} = {getattr(initial, name):g}" for name in _REASONS[reason])
    why = {
        "speed": "a speed out of its limits",
        "near": "a gap below 1 m",
        "far": "a follower's gap above free_gap_low",
        "ttc": "a time to collision below min_ttc",
    }
    return f"{why[reason]} ({named})"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} % of draws"


def accepted_share(
    initial: InitialState, speeds: Floats, mean: float, *, ahead: bool, factor: float = 1.0
) -> tuple[Floats, dict[str, Floats]]:
    """Compute which share of draws of a neighbour suits: what `sim.traffic` draws, over equally frequent values.

    Args:
        initial: The law.
        speeds: Speeds of the vehicle for which a neighbour is drawn [m/s], (n,).
        mean: The mean speed of the lane's traffic [m/s].
        ahead: The neighbour is ahead of it; else behind.
        factor: The follower's time gap in parts of a car's (`types.RoadUser.time_gap`).

    Returns:
        The share, (n,); and by reason the share that is refused for it, (n,), a draw for each of its reasons.
    """
    own, z = speeds[:, None, None], _NORMAL
    time_gap = factor * (initial.time_gap_shift + initial.time_gap_median * np.exp(initial.time_gap_sigma * z[:, None]))
    free_gap = initial.free_gap_low + (initial.free_gap_high - initial.free_gap_low) * _UNIFORM[:, None]
    accepted = np.zeros(speeds.size)
    refused = {name: np.zeros(speeds.size) for name in _REASONS}
    for follows, weight in ((True, initial.follow_share), (False, 1.0 - initial.follow_share)):
        gap = own * time_gap if follows else np.broadcast_to(free_gap, (speeds.size, _LEVELS, 1))
        spread = initial.rr_scale * (gap / 20.0) ** initial.rr_exponent
        part = np.minimum(spread / initial.speed_sd, 1.0)
        other = mean + np.sqrt(1.0 - part * part) * (own - mean) + part * initial.speed_sd * z
        if follows and not ahead:
            gap = other * time_gap
        closing = own - other if ahead else other - own
        reasons = {
            "speed": (other < initial.speed_low) | (other > initial.speed_high),
            "near": np.broadcast_to(gap < 1.0, other.shape),
            "far": np.broadcast_to(follows & (gap > initial.free_gap_low), other.shape),
            "ttc": gap < initial.min_ttc * closing,
        }
        accepted += weight * (~np.logical_or.reduce(list(reasons.values()))).mean(axis=(1, 2))
        for name, is_refused in reasons.items():
            refused[name] += weight * is_refused.mean(axis=(1, 2))
    return accepted, refused
