"""Fitting the lane changes: penalised maximum likelihood over seconds at risk (docs/adr/0025-fitting-lane-changes.md).

In each trial of `lane_risk` a change begins with the probability that the simulator gives it (`sim.chances.side_chance`
of an ordinary driver, before giving way): rate x desire x acceptance of the vehicle ahead x acceptance of the one
behind, read from the tables that the parameters make. The logarithm of each fitted parameter has a normal prior about
its shipped value. Intervals come from the curvature of the penalised log-likelihood at its maximum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.ext.calibrate.lane_change import LaneChange
from cornerforge.ext.calibrate.lane_risk import BEGINS_BEFORE, SecondsAtRisk, joined_seconds, seconds_at_risk
from cornerforge.ext.calibrate.readers import Reading
from cornerforge.ext.calibrate.scores import gap_seen
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID
from cornerforge.results.naturalistic import FittedLaneChanges, FittedLaneNumber

__all__ = [
    "FEWEST_CHANGES",
    "LANE_CHANGE_CHOICES",
    "WIDTHS",
    "change_chances",
    "fit_lane_changes",
    "maximise",
    "not_fitted",
    "notes_on",
    "told_by_data",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LANE_CHANGE_CHOICES = ("fit", "prior")
"""Values of `ndd fit --lane-changes`."""
FEWEST_CHANGES = 30
"""Least number of changes to fit to."""
WIDTHS: Mapping[str, float] = {
    "rate": 1.0, "near": 0.5,
    "lead_standstill": 0.5, "lead_doubt": 0.3,
    "rear_standstill": 0.5, "rear_doubt": 0.3,
}  # fmt: skip
"""The parameters of `LaneChange` that are fitted, and the prior's standard deviation of the logarithm of each."""
_UNITS = {f.name: f.metadata.get("unit", "") for f in fields(LaneChange)} | {"rate": "1/s"}
_STEP = 0.01
"""Step of the logarithms in differences."""
_FARTHEST = math.log(20.0)
_NORMAL_95 = 1.959964
_MOST = 1.0 - 1e-12
_UNTOLD = 0.75
"""Share of the prior's interval; a parameter with a wider interval is reported as hardly determined by the data."""


def told_by_data(number: FittedLaneNumber) -> bool:
    """Tell whether the data narrow the prior's interval by at least a quarter, on a logarithmic scale."""
    low, high = number.interval95
    prior_low, prior_high = number.prior_interval95
    return math.log(high / low) < _UNTOLD * math.log(prior_high / prior_low)


def notes_on(fit: FittedLaneChanges) -> tuple[str, ...]:
    """Describe in plain sentences the fit and the left-out changes; `parts` says where the rest comes from."""
    each = [f"{why}: {seconds:,} ({fit.changes_left_out.get(why, 0)})" for why, seconds in fit.left_out.items()]
    left = (f"Left out of the lane changes, seconds (changes among them): {'; '.join(each)}.",) if each else ()
    if not fit.fitted:
        return left
    untold = [name for name, number in fit.numbers.items() if not told_by_data(number)]
    hardly = f" These files hardly tell {', '.join(untold)}: as in the prior, give or take." if untold else ""
    return (
        f"Lane changes: fitted to {fit.changes} changes in {fit.seconds:,} seconds at risk (each to one side, "
        f"median speed {fit.speed_median:.1f} m/s) of {fit.vehicles} vehicles; "
        f"{', '.join(_told(name, number) for name, number in fit.numbers.items())}.{hardly}",
        "The intervals of the lane changes are from the curvature of the likelihood with its prior. They leave out "
        f"errors of the tracks, differences between drivers, that a change is taken to begin {BEGINS_BEFORE:g} s "
        "before the crossing, and that nobody sees who gave way. Parameters not named are as shipped. Changes that "
        "a ramp forces count as wishes.",
        *left,
    )


def _told(name: str, number: FittedLaneNumber) -> str:
    low, high = number.interval95
    return f"{name} {number.estimate:.3g} ({low:.3g} to {high:.3g}; prior {number.prior:.3g}) {number.unit}".rstrip()


def not_fitted(why: str) -> FittedLaneChanges:
    """Make the report on lane changes that stay the prior."""
    return FittedLaneChanges(
        fitted=False, why=why, changes=0, seconds=0, vehicles=0, speed_median=None, left_out={}, changes_left_out={},
        numbers={},
    )  # fmt: skip


def fit_lane_changes(readings: Sequence[Reading], choice: str = "fit") -> tuple[LaneChange, FittedLaneChanges]:
    """Fit the lane changes of files, or say why they stay the prior.

    Args:
        readings: The files, at least one; files without lanes add nothing.
        choice: "fit", or "prior" to keep the shipped values in any case.

    Raises:
        UnknownNameError: The choice is unknown.
    """
    if check_in("choice of lane changes", choice, LANE_CHANGE_CHOICES) == "prior":
        return LaneChange(), not_fitted("that was asked for")
    parts = [part for part in map(seconds_at_risk, readings) if part is not None]
    if not parts:
        return LaneChange(), not_fitted("no file gives the lane of each row")
    seconds = joined_seconds(parts)
    lanes = "" if seconds.size else "; nobody was seen for long enough with a lane beside its own"
    found = FittedLaneChanges(
        fitted=False,
        why=f"{seconds.changes} lane change(s) can be used, and at least {FEWEST_CHANGES} are needed{lanes}",
        changes=seconds.changes,
        seconds=seconds.size,
        vehicles=int(np.unique(seconds.vehicle).size),
        speed_median=float(np.median(seconds.speed)) if seconds.size else None,
        left_out=dict(seconds.left_out),
        changes_left_out=dict(seconds.changes_left_out),
        numbers={},
    )
    if seconds.changes < FEWEST_CHANGES:
        return LaneChange(), found
    law, numbers = maximise(seconds)
    return law, replace(found, fitted=True, why="", numbers=numbers)


def maximise(seconds: SecondsAtRisk, prior: LaneChange | None = None) -> tuple[LaneChange, dict[str, FittedLaneNumber]]:
    """Find the parameters at which the penalised likelihood is greatest, and their intervals.

    Thanks to the rounding to 4 significant digits a second fit gives the same bytes, mostly on another machine too.

    Args:
        seconds: The trials, at least one.
        prior: About which the prior stands; the shipped values by default.
    """
    from scipy.optimize import minimize

    prior = prior or LaneChange()
    names, widths = list(WIDTHS), np.array(list(WIDTHS.values()))
    chance_of = _chances(seconds)

    def law_at(shift: Floats, form: str = ".17g") -> LaneChange:
        moved = {
            name: float(format(getattr(prior, name) * math.exp(by), form))
            for name, by in zip(names, shift, strict=True)
        }
        return replace(prior, **moved)

    def cost(shift: Floats) -> float:
        p = np.minimum(chance_of(law_at(shift)), _MOST)
        penalty = 0.5 * float(((shift / widths) ** 2).sum())
        return penalty - float(np.log(p[seconds.changed]).sum() + np.log1p(-p[~seconds.changed]).sum())

    def slope(shift: Floats) -> Floats:
        steps = np.eye(shift.size) * _STEP
        return np.array([(cost(shift + step) - cost(shift - step)) / (2.0 * _STEP) for step in steps])

    bounds = [(-_FARTHEST, _FARTHEST)] * len(names)
    minimum = minimize(cost, np.zeros(len(names)), jac=slope, method="L-BFGS-B", bounds=bounds)
    best = np.array(minimum.x.tolist())
    steps = np.eye(best.size) * _STEP
    curvature = np.array([(slope(best + step) - slope(best - step)) / (2.0 * _STEP) for step in steps])
    spread = np.sqrt(np.diag(np.linalg.inv(0.5 * (curvature + curvature.T))))
    law = law_at(best, ".4g")
    return law, {
        name: FittedLaneNumber(
            estimate=getattr(law, name),
            interval95=_interval(getattr(law, name), sd),
            prior=getattr(prior, name),
            prior_interval95=_interval(getattr(prior, name), width),
            unit=_UNITS[name],
        )
        for name, sd, width in zip(names, spread.tolist(), widths.tolist(), strict=True)
    }


def _interval(middle: float, sd: float) -> tuple[float, float]:
    low, high = (float(format(middle * math.exp(sign * _NORMAL_95 * sd), ".4g")) for sign in (-1.0, 1.0))
    return low, high


def change_chances(law: LaneChange, seconds: SecondsAtRisk) -> Floats:
    """Return the probability with which a driver of `law` begins the change in each trial, shape (m,)."""
    return _chances(seconds)(law)


def _chances(seconds: SecondsAtRisk) -> Callable[[LaneChange], Floats]:
    """Look up where the trials are on the grids; return the function that gives their probabilities for a law.

    As `drivers.naturalistic.lane_change_base` and `accept_chance` do: the nearest gap, own leaders at the nearest range
    rate, neighbours between two range rates.
    """
    own_row, free = _gap_row(seconds.own_gap, seconds.own_rate)
    own_column = RANGE_RATE_GRID.place(seconds.own_rate)
    lead = _Neighbour(seconds.lead_gap, seconds.lead_rate)
    rear = _Neighbour(seconds.rear_gap, seconds.rear_rate)

    def chances(law: LaneChange) -> Floats:
        base = law.rate * np.where(free, law.desire_free, law.desire()[own_row, own_column])
        accepts = (lead.accepts(law.accept_lead(sure=1.0)), rear.accepts(law.accept_rear(sure=1.0)))
        seen = [law.overlook + (1.0 - law.overlook) * accept for accept in accepts]
        return np.asarray(base * seen[0] * seen[1])

    return chances


class _Neighbour:
    """Where one neighbour of each trial is on the grids."""

    def __init__(self, gap: Floats, rate: Floats) -> None:
        self._row, self._beyond = _gap_row(gap, rate)
        self._overlaps = gap <= 0.0
        place = (rate - RANGE_RATE_GRID.low) / RANGE_RATE_GRID.step
        self._column = np.clip(np.floor(place).astype(np.int64), 0, RANGE_RATE_GRID.bins - 2)
        self._share = np.clip(place - self._column, 0.0, 1.0)

    def accepts(self, table: Floats) -> Floats:
        """Return the chance that an attentive driver accepts it; `table` (116, 19)."""
        low, high = table[self._row, self._column], table[self._row, self._column + 1]
        chance = (1.0 - self._share) * low + self._share * high
        return np.where(self._overlaps, 0.0, np.where(self._beyond, 1.0, chance))


def _gap_row(gap: Floats, rate: Floats) -> tuple[Ints, NDArray[np.bool_]]:
    """Return the row of the grid of gaps, and whether the gap is beyond it (`drivers.naturalistic.table_row`)."""
    seen = gap_seen(gap, rate)
    return GAP_GRID.place(np.minimum(seen, GAP_GRID.upper)), seen > GAP_GRID.upper
