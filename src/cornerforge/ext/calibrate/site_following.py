"""Following in a street at 0 to 15 m/s: pairs found by geometry, IDM parameters by driving followers again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.drivers.idm import IdmNumbers, idm_acceleration
from cornerforge.ext.calibrate.resampling import bootstrap_mean
from cornerforge.ext.calibrate.site_data import interval_of, kept_apart, owners, quantiles, words
from cornerforge.ext.calibrate.tables import Table

__all__ = [
    "PUBLISHED_IDM",
    "Following",
    "FollowingFit",
    "Score",
    "Turning",
    "driven",
    "fit_following",
    "following_of",
    "turning_of",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_DT = 0.1
_LIMIT = 15.65
"""Speed limit of that street [m/s], 35 mph: recalled, the file has none; no vehicle in it is faster than 15.8 m/s."""
_BRAKING = 8.0
PUBLISHED_IDM = (1.0, 2.0, 1.0, 1.5)
"""Headway [s], standstill [m], acceleration and braking [m/s2] in towns (Treiber and Kesting 2013; recalled)."""
_NAMES = ("headway", "standstill", "acceleration", "braking")
_BOUNDS = ((0.3, 4.0), (0.5, 6.0), (0.5, 4.0), (0.5, 5.0))
_ASIDE, _TURNED, _FARTHEST = 1.5, 0.35, 60.0
"""A leader is less than so far beside the way ahead [m], turned by less [rad], and nearer [m]."""
_JUMP = 0.5
"""A gap that differs by more from what the speeds say breaks a run [m]."""
_LEAST = 31
"""Rows of a run, at least: 3 s."""
_AHEAD, _DRAWS, _FEWEST = 50, 64, 20
"""A prediction is scored after so many steps, over so many drawn drivers; least drivers."""


@dataclass(frozen=True)
class Following:
    """Runs of followers one after another; run r is rows start[r] to start[r + 1].

    Attributes:
        start: Shape (R + 1,).
        driver: Number of each run's driver, shape (R,).
        gap: Bumper to bumper [m], shape (n,).
        speed, leader: Speeds [m/s], shape (n,).
        moved: How far the follower has come since its run began [m], shape (n,).
    """

    start: Ints
    driver: Ints
    gap: Floats
    speed: Floats
    leader: Floats
    moved: Floats

    def of(self, runs: NDArray[np.bool_]) -> Following:
        """Keep some runs, mask of shape (R,)."""
        size = np.diff(self.start)
        rows = np.repeat(runs, size)
        start = np.concatenate([[0], np.cumsum(size[runs])]).astype(np.int64)
        columns = (column[rows] for column in (self.gap, self.speed, self.leader, self.moved))
        return Following(start, self.driver[runs], *columns)


@dataclass(frozen=True)
class Score:
    """How far a law is from recorded gaps.

    Attributes:
        error: Root mean square of the gap's error over runs, driven without noise [m].
        crps: Continuous ranked probability score of the gap after 5 s, mean over runs [m]; lower is better.
        beside: 95 % interval over drivers of its difference from the fairly fitted IDM's.
    """

    error: float
    crps: float
    beside: tuple[float, float]


@dataclass(frozen=True)
class FollowingFit:
    """Numbers fitted to the runs, and how well they predict others.

    Attributes:
        values: `headway`, `standstill`, `acceleration`, `braking`, `noise`, `headway_spread`.
        intervals: The same, low and high over resampled drivers.
        scores: Name of a law -> how far it is from runs kept apart.
        drivers, runs: How many were fitted; apart_drivers, apart_runs: kept apart for the scores.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    scores: dict[str, Score]
    drivers: int
    runs: int
    apart_drivers: int
    apart_runs: int


@dataclass(frozen=True)
class Turning:
    """Vehicles that turn by 0.5 to 2.2 rad, that start from a stand as the first, and that stop from 8 m/s or more.

    Attributes:
        lateral: Most acceleration across the way, over 1 s [m/s2]: median, its interval over vehicles, and how many.
        starting: The same of the mean acceleration in the first 3 s, with nobody within 15 m ahead.
        stopping: The same of v^2 / 2d, d the way from 8 m/s to a stand.
    """

    lateral: tuple[float, float, float, int]
    starting: tuple[float, float, float, int]
    stopping: tuple[float, float, float, int]


def _driver(table: Table) -> Ints:
    """Number the drivers; a name counts within its recording, and clips of one recording may hold a driver twice."""
    recording = np.array([name.rsplit("_", 2)[0] for name in words(table, "scenario")])
    return owners(recording, words(table, "id"))


def _leaders(table: Table, clip: Ints, frame: Ints) -> tuple[Ints, Floats]:
    """Find the nearest vehicle ahead of each row in its lane, by place and heading; -1, NaN for none."""
    n = table.numbers
    lead, gap = np.full(clip.size, -1), np.full(clip.size, np.nan)
    order = np.lexsort((frame, clip))
    begins = np.flatnonzero(np.diff(clip[order], prepend=-1) | np.diff(frame[order], prepend=-1))
    for rows in np.split(order, begins[1:]):
        dx, dy = (n[k][rows][None, :] - n[k][rows][:, None] for k in ("x", "y"))
        c, s = np.cos(n["heading"][rows])[:, None], np.sin(n["heading"][rows])[:, None]
        along, aside = dx * c + dy * s, dy * c - dx * s
        turned = np.cos(n["heading"][rows][None, :] - n["heading"][rows][:, None])
        ahead = np.where((along > 0.5) & (np.abs(aside) < _ASIDE) & (turned > math.cos(_TURNED)), along, np.inf)
        near = ahead.argmin(axis=1)
        away = ahead[np.arange(rows.size), near]
        seen = away < np.inf
        lead[rows[seen]] = rows[near[seen]]
        gap[rows[seen]] = (away - 0.5 * (n["length"][rows] + n["length"][rows[near]]))[seen]
    return lead, gap


def following_of(table: Table) -> Following:
    """Find the runs in which a vehicle follows the same leader for 3 s or more, and moves in some of them.

    Standing pairs stay in as long as their run moves at all. Vehicles are their boxes' centres.
    """
    n = table.numbers
    clip, frame = table.texts["scenario"], np.rint(n["t"] / _DT).astype(np.int64)
    lead, gap = _leaders(table, clip, frame)
    order = np.lexsort((frame, table.texts["id"], clip))
    lead, gap, clip, frame = lead[order], gap[order], clip[order], frame[order]
    driver, who = _driver(table)[order], table.texts["id"][order]
    speed = n["v"][order]
    ahead = np.where(lead >= 0, n["v"][lead], np.nan)
    leader = np.where(lead >= 0, table.texts["id"][lead], -1)
    step = np.concatenate([[0.0], np.hypot(np.diff(n["x"][order]), np.diff(n["y"][order]))])
    said = 0.5 * _DT * np.convolve(ahead - speed, [1.0, 1.0])[: gap.size]
    same = [np.diff(column, prepend=-1) == 0 for column in (clip, who, leader)]
    goes_on = same[0] & same[1] & same[2] & (np.diff(frame, prepend=-9) == 1)
    goes_on &= np.abs(np.diff(gap, prepend=np.nan) - said) < _JUMP
    fine = (leader >= 0) & (gap > 0.2) & (gap < _FARTHEST)
    run = np.cumsum(~(goes_on & fine & np.concatenate([[False], fine[:-1]])))
    size = np.bincount(run[fine], minlength=run[-1] + 1)
    moves = np.zeros(size.size)
    np.maximum.at(moves, run[fine], speed[fine])
    rows = np.flatnonzero(fine & (size[run] >= _LEAST) & (moves[run] > 1.0))
    begins = np.flatnonzero(np.diff(run[rows], prepend=-1))
    start = np.append(begins, rows.size).astype(np.int64)
    far = np.cumsum(step)[rows]
    moved = far - np.repeat(far[begins], np.diff(start))
    return Following(start, owners(driver[rows[begins]]), gap[rows], speed[rows], ahead[rows], moved)


@kernel
def _drive(
    start: Ints, rows: tuple[Floats, Floats, Floats, Floats], own: Floats, noise: Floats, p: IdmNumbers, out: Floats
) -> None:
    """Drive each follower from its first row on behind its recorded leader, and write its gap into `out` (n,).

    `rows`: `gap`, `speed`, `moved` and `leader` of the runs. `own`: factor of each run's headway (R,). `noise`:
    acceleration added at each row (n,).
    """
    gap, speed, moved, leader = rows
    for r in range(len(start) - 1):
        first = start[r]
        driver = IdmNumbers(
            p.max_acceleration, p.comfortable_braking, p.standstill_gap, p.time_gap * own[r], p.desired_speed,
            p.max_braking,
        )  # fmt: skip
        v, here, s = speed[first], 0.0, gap[first]
        out[first] = s
        for i in range(first, start[r + 1] - 1):
            a = idm_acceleration(v, s, leader[i] - v, driver) + noise[i]
            faster = max(0.0, v + a * 0.1)
            here += 0.05 * (v + faster)
            v = faster
            s = gap[i + 1] + moved[i + 1] - here
            out[i + 1] = s


def _numbers(x: Floats) -> IdmNumbers:
    headway, standstill, acceleration, braking = (float(one) for one in x)
    return IdmNumbers(acceleration, braking, standstill, headway, _LIMIT, _BRAKING)


def driven(runs: Following, x: Floats, own: Floats | None = None, noise: Floats | None = None) -> Floats:
    """Drive all followers with headway, standstill, acceleration and braking `x` (4,): their gaps [m], shape (n,)."""
    out = np.empty_like(runs.gap)
    own = np.ones(runs.driver.size) if own is None else own
    noise = np.zeros_like(out) if noise is None else noise
    _drive(runs.start, (runs.gap, runs.speed, runs.moved, runs.leader), own, noise, _numbers(x), out)
    return out


def _fitted(runs: Following, weight: Floats, begin: Floats | None) -> Floats:
    """Fit the four numbers by least squares of the gap.

    Each run counts by its driver's weight (drivers,). Without a place to begin the whole box is searched first
    (differential evolution, fixed seed).
    """
    from scipy.optimize import differential_evolution, least_squares

    size = np.diff(runs.start)
    root = np.repeat(np.sqrt(weight[runs.driver]), size)

    def errors(x: Floats) -> Floats:
        return np.asarray(root * (driven(runs, x) - runs.gap))

    low, high = np.array(_BOUNDS).T
    if begin is None:
        found = differential_evolution(
            lambda x: float(np.square(errors(x)).sum()), _BOUNDS, rng=2021, popsize=10, maxiter=40, polish=False
        )
        begin = found.x
    inner = np.clip(begin, low + 1e-3, high - 1e-3)
    return np.asarray(least_squares(errors, inner, bounds=(low, high), x_scale=high - low, diff_step=1e-3).x)


def _seconds(runs: Following, x: Floats) -> tuple[Floats, Ints, Floats]:
    """Give, for each whole second of moving followers, what the acceleration differs by from the law, and its driver.

    Third comes the headway that the driver keeps there by the law's steady state, NaN where speeds differ by 0.5 m/s
    or more, or below 3 m/s. Speeds are means over 0.5 s, since the recording differentiates places.
    """
    smooth = np.convolve(runs.speed, np.full(5, 0.2), "same")
    inner = np.concatenate([np.arange(a + 2, b - 12, 10) for a, b in zip(runs.start, runs.start[1:], strict=False)])
    inner = inner[(smooth[inner] > 1.0) & (smooth[inner] < 15.0)]
    driver = np.repeat(runs.driver, np.diff(runs.start))[inner]
    shifted = Following(
        np.append(np.arange(inner.size) * 11, inner.size * 11), driver,
        *(c[(inner[:, None] + np.arange(11)).ravel()] for c in (runs.gap, smooth, runs.leader, runs.moved)),
    )  # fmt: skip
    moved = shifted.moved - np.repeat(shifted.moved[::11], 11)
    shifted = Following(shifted.start, driver, shifted.gap, shifted.speed, shifted.leader, moved)
    ahead = driven(shifted, x)
    out = (shifted.gap + moved - ahead).reshape(-1, 11)  # how far the law comes
    law = (out[:, 10] - out[:, 9]) / _DT
    v, gap = smooth[inner], runs.gap[inner]
    steady = (np.abs(runs.leader[inner] - v) < 0.5) & (v > 3.0) & (v < 14.0)
    wish = gap * np.sqrt(np.maximum(1.0 - (v / _LIMIT) ** 4, 0.0)) - x[1]
    kept = np.where(steady & (wish > 0.1 * v) & (wish < 5.0 * v), wish / v, np.nan)
    return smooth[inner + 10] - law, driver, kept


def _within(values: Floats, owner: Ints, weight: Floats) -> tuple[float, float]:
    """Give standard deviations within and between owners, by analysis of variance; each owner counts by its weight."""
    n = np.bincount(owner, minlength=weight.size).astype(np.float64)
    sums = np.bincount(owner, values, weight.size)
    mean = sums / np.maximum(n, 1.0)
    left = np.bincount(owner, (values - mean[owner]) ** 2, weight.size)
    total, groups = float((weight * n).sum()), float(weight[n > 0].sum())
    within = float((weight * left).sum()) / max(total - groups, 1.0)
    grand = float((weight * sums).sum()) / total
    between = float((weight * n * (mean - grand) ** 2).sum()) / max(groups - 1.0, 1.0)
    each = (total - float((weight * n * n).sum()) / total) / max(groups - 1.0, 1.0)
    return math.sqrt(within), math.sqrt(max(0.0, (between - within) / each))


def _spreads(runs: Following, x: Floats, weight: Floats) -> tuple[float, float]:
    """Give the noise of a second's acceleration within a driver, and the spread of log headway between drivers."""
    off, driver, kept = _seconds(runs, x)
    told = np.isfinite(kept)
    return _within(off, driver, weight)[0], _within(np.log(kept[told]), driver[told], weight)[1]


def _crps(runs: Following, drawn: Floats) -> Floats:
    """Continuous ranked probability score of each run's gap after 5 s [m]; drawn is (draws, n). Lower is better."""
    at = runs.start[:-1] + _AHEAD
    at = at[at < runs.start[1:]]
    cases, seen = drawn[:, at], runs.gap[at]
    apart = np.abs(cases[:, None, :] - cases[None, :, :]).sum(axis=(0, 1))
    pairs = max(1, len(cases) * (len(cases) - 1))
    return np.asarray(np.abs(cases - seen).mean(axis=0) - 0.5 * apart / pairs)


def _scored(runs: Following, laws: dict[str, tuple[Floats, float, float]]) -> dict[str, Score]:
    """Score laws (numbers, noise, spread of log headway) on runs, all with the same random numbers.

    Each law's CRPS is compared with that of the last but one of them.
    """
    size = np.diff(runs.start)
    rng = np.random.Generator(np.random.Philox(7))
    own, second = rng.standard_normal((_DRAWS, size.size)), rng.standard_normal((_DRAWS, runs.gap.size))
    place = np.arange(runs.gap.size) - np.repeat(runs.start[:-1], size)
    held = np.arange(runs.gap.size) - place % 10
    errors, crps = {}, {}
    for name, (x, noise, spread) in laws.items():
        plain = driven(runs, x) - runs.gap
        errors[name] = math.sqrt(np.mean(np.add.reduceat(plain**2, runs.start[:-1]) / size))
        draws = range(_DRAWS if noise or spread else 1)
        cases = [driven(runs, x, np.exp(spread * own[k]), noise * second[k][held]) for k in draws]
        crps[name] = _crps(runs, np.array(cases))
    owner, beside = runs.driver[size > _AHEAD], crps[list(laws)[-2]]
    return {
        name: Score(errors[name], float(crps[name].mean()), bootstrap_mean(crps[name] - beside, owner)) for name in laws
    }


def fit_following(runs: Following) -> FollowingFit | None:
    """Fit the laws of following to runs, with intervals over drivers, and score them on drivers kept apart.

    None with fewer than `_FEWEST` drivers, or if no run of those kept apart is long enough to be scored.
    """
    drivers, apart = np.unique(runs.driver).size, kept_apart(runs.driver)
    if drivers < _FEWEST or not (np.diff(runs.start)[apart] > _AHEAD).any():
        return None
    even = np.ones(drivers)
    x = _fitted(runs, even, None)

    def again(weight: Floats) -> Floats:
        y = _fitted(runs, weight, x)
        return np.array([*y, *_spreads(runs, y, weight)])

    low, high = interval_of(again, drivers)
    names = (*_NAMES, "noise", "headway_spread")
    values = [*x, *_spreads(runs, x, even)]
    y = _fitted(runs.of(~apart), even, None)
    noise, spread = _spreads(runs.of(~apart), y, even)
    scores = _scored(
        runs.of(apart),
        {
            "these laws": (y, noise, spread),
            "fairly fitted IDM with noise": (y, noise, 0.0),
            "fairly fitted IDM": (y, 0.0, 0.0),
            "published IDM for towns": (np.array(PUBLISHED_IDM), 0.0, 0.0),
        },
    )
    return FollowingFit(
        {name: float(v) for name, v in zip(names, values, strict=True)},
        {name: (float(a), float(b)) for name, a, b in zip(names, low, high, strict=True)},
        scores, drivers, runs.driver.size, np.unique(runs.driver[apart]).size, int(apart.sum()),
    )  # fmt: skip


def _median(found: dict[int, float]) -> tuple[float, float, float, int]:
    values = np.array([found[who] for who in sorted(found)])

    def of(weight: Floats) -> float:
        return float(quantiles(values, weight, [0.5])[0])

    low, high = interval_of(of, values.size)
    return of(np.ones(values.size)), float(low), float(high), values.size


def turning_of(table: Table) -> Turning | None:
    """Measure turns, starts and stops, one of each kind a vehicle; None if the file has fewer than 10 of one kind."""
    n = table.numbers
    clip, frame = table.texts["scenario"], np.rint(n["t"] / _DT).astype(np.int64)
    gap = _leaders(table, clip, frame)[1]
    order = np.lexsort((frame, table.texts["id"], clip))
    driver = _driver(table)
    lateral: dict[int, float] = {}
    starting: dict[int, float] = {}
    stopping: dict[int, float] = {}
    ends = np.flatnonzero(np.diff(clip[order], prepend=-1) | np.diff(table.texts["id"][order], prepend=-1))
    for rows in np.split(order, ends[1:]):
        if rows.size < _LEAST:
            continue
        who, v, heading = int(driver[rows[0]]), n["v"][rows], np.unwrap(n["heading"][rows])
        far = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(n["x"][rows]), np.diff(n["y"][rows])))])
        if 0.5 < np.ptp(heading) < 2.2 and v.max() > 3.0 and far[-1] > 8.0:
            across = np.abs(heading[10:] - heading[:-10]) * 0.5 * (v[10:] + v[:-10])
            lateral[who] = max(lateral.get(who, 0.0), float(across.max()))
        stands = np.flatnonzero(v[: -_LEAST + 1] < 0.3)
        if stands.size and not (gap[rows[stands[-1] : stands[-1] + 20]] < 15.0).any() and v[stands[-1] :].max() > 6.0:
            starting.setdefault(who, float(v[stands[-1] + 30] / 3.0))
        stands = np.flatnonzero(v < 0.5)[:1]
        fast = np.flatnonzero(v[: stands[0]] >= 8.0)[-1:] if stands.size else stands
        if fast.size:
            stopping.setdefault(who, float(v[fast[0]] ** 2 / (2.0 * (far[stands[0]] - far[fast[0]]))))
    kinds = (lateral, starting, stopping)
    if min(map(len, kinds)) < 10:
        return None
    return Turning(*(_median(found) for found in kinds))
