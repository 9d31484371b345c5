"""Comparisons of recorded with simulated traffic, and of recorded with predicted decisions, state by state.

Simulated traffic is free-running at 20-40 m/s; recordings are often slower. So only states from 19.5 m/s on are
compared, and the simulated side is matched by speed: for each class of 1 m/s it gives the distribution of the quantity,
and these distributions are mixed in the shares that the recorded decisions have in the classes. Where too little was
recorded at these speeds for a fair comparison, the answer is a sentence and no number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.free_running import Quantity, speeds_of
from cornerforge.ext.calibrate.lane_observations import LaneObservations, observe_lane_changes
from cornerforge.ext.calibrate.prior import SafeLaw
from cornerforge.ext.calibrate.readers import Reading, reading_names
from cornerforge.ext.calibrate.resampling import distance, resampled_weights
from cornerforge.ext.calibrate.scores import Predictor, grid_place, law_predictor, simulated
from cornerforge.ext.calibrate.validate import FEWEST_VEHICLES, decisions_to_score, observed_and_predicted, stated_law
from cornerforge.ndd.grids import GAP_GRID, SPEED_GRID
from cornerforge.ndd.model import NddModel
from cornerforge.types import ACCELERATIONS

__all__ = ["compare_decisions", "compare_traffic", "shares_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLOWEST = SPEED_GRID.lower
"""Speed from which the model's tables hold [m/s]."""
FREE_RUNNING_SHARE = 0.9
"""Least share of a file's decisions from 19.5 m/s on; with less its speeds are not typical of free-running traffic."""
FEWEST_STATES = 200
"""Least number of simulated states in a speed class; a class with fewer is left out."""
FEWEST_OBSERVATIONS = 100
FEWEST_GAPS = 30
"""Least number of accepted gaps for a comparison."""
FEWEST_MILES = 20.0
TTC_LIMITS = (3.0, 5.0, 10.0, 20.0)
SPEED_BANDS = (10.0, 15.0, SLOWEST, 22.0, 25.0, 30.0, SPEED_GRID.upper)
"""Borders of the speed bands in which predictions are compared [m/s]."""
STEADY = 0.5
"""Range rates up to this [m/s] are neither closing nor opening."""
_FREE_GAP = GAP_GRID.upper


Result = dict[str, object]


def compare_traffic(
    model: NddModel, readings: Sequence[Reading], traffic: Mapping[str, Quantity], changes_per_mile: float
) -> dict[str, dict[str, Result]]:
    """Compare recorded with free-running simulated traffic.

    Args:
        model: The model.
        readings: The files.
        traffic: Quantities by name: gap, time_gap, range_rate, acceleration_following, acceleration_free, inverse_ttc,
            accepted_lead_gap, accepted_rear_gap.
        changes_per_mile: Simulated lane changes per vehicle-mile, over all speeds.

    Returns:
        Quantity -> file -> either `not_compared` (the reason, in words) or the fields of `Distance` (of a rate: both
        sides) with `recorded` and `simulated`: shares of the bins (`low`, `width`) for a picture. `caution`, if there
        is one, says with what reservation to read the result.
    """
    found: dict[str, dict[str, Result]] = {}
    for name, reading in zip(reading_names(readings), readings, strict=True):
        decisions = decisions_to_score(reading.decisions)
        seen = observe_lane_changes(reading, fast=SLOWEST)
        rows = _states(decisions, traffic) | _lanes(model, seen, traffic, changes_per_mile)
        for quantity, row in rows.items():
            found.setdefault(quantity, {})[name] = row
    return found


def _states(decisions: Decisions, q: Mapping[str, Quantity]) -> dict[str, Result]:
    """Compare the quantities that need only states."""
    fast = decisions.where((decisions.speed >= SLOWEST) & (decisions.speed < SPEED_GRID.upper))
    share = fast.size / max(decisions.size, 1)
    why = _too_few(np.unique(fast.vehicle).size, fast.size, f"at {SLOWEST} m/s and above ({share:.1%} of the file)")
    follows = fast.gap <= _FREE_GAP
    led, alone = fast.where(follows), fast.where(~follows)
    closing = np.maximum(-led.range_rate, 0.0) / np.maximum(led.gap, 0.01)
    speeds = speeds_of(q, SLOWEST)
    speeds = speeds._replace(counts=np.tile(speeds.counts, (41, 1)))
    found: dict[str, Result] = {
        "speed": _distance(fast, fast.speed, speeds, why)
        if why or share >= FREE_RUNNING_SHARE
        else {
            "not_compared": f"{1.0 - share:.0%} of the decisions are slower than {SLOWEST} m/s: congested or slow "
            "traffic has a speed of its own, of which the model says nothing."
        },
        "gap": _distance(led, led.gap, q["gap"], why),
        "time_gap": _distance(led, led.gap / np.maximum(led.speed, 0.1), q["time_gap"], why),
        "range_rate": _distance(led, led.range_rate, q["range_rate"], why),
        "acceleration_following": _distance(led, led.acceleration, q["acceleration_following"], why),
        "acceleration_free": _distance(alone, alone.acceleration, q["acceleration_free"], why),
        "ttc_share_below": _ttc_shares(led, closing, q["inverse_ttc"], why),
    }
    if share < FREE_RUNNING_SHARE:
        caution = (
            f"Only {share:.0%} of the decisions are at {SLOWEST} m/s and above: the fastest moments of slower traffic, "
            "in which drivers keep other gaps and are about to slow down. Read it as a hint."
        )
        found = {name: row if "not_compared" in row else row | {"caution": caution} for name, row in found.items()}
    return found


def _too_few(vehicles: int, number: int, what: str, fewest: int = FEWEST_OBSERVATIONS) -> str:
    """Say why a comparison would not be fair; empty if it is fair."""
    if vehicles >= FEWEST_VEHICLES and number >= fewest:
        return ""
    return (
        f"{number} observation(s) of {vehicles} vehicle(s) {what}: too few for a fair comparison with free-running "
        f"traffic at 20-40 m/s ({fewest} of {FEWEST_VEHICLES} vehicles are needed)."
    )


class _Matched(NamedTuple):
    """Recorded counts by vehicle and bin, shape (V, k), and what simulated traffic expects at the same speeds."""

    observed: Floats
    expected: Floats
    left_out: int


def _match(vehicle: Ints, speed: Floats, place: Ints, simulated: Quantity) -> _Matched | None:
    """Match by speed; None if the simulated traffic has too few states at each of these speeds."""
    sizes = simulated.counts.sum(axis=1)
    speed_class = np.clip(np.floor(speed + 0.5), 0, sizes.size - 1).astype(np.int64)
    known = sizes[speed_class] >= FEWEST_STATES
    if not known.any():
        return None
    vehicles, owner = np.unique(vehicle[known], return_inverse=True)
    by_bin = np.zeros((vehicles.size, simulated.counts.shape[1]))
    np.add.at(by_bin, (owner, place[known]), 1.0)
    by_speed = np.zeros((vehicles.size, sizes.size))
    np.add.at(by_speed, (owner, speed_class[known]), 1.0)
    shares = simulated.counts / np.maximum(sizes, 1)[:, None]
    return _Matched(by_bin, by_speed @ shares, int((~known).sum()))


def _distance(
    of: Decisions | tuple[Ints, Floats],
    values: Floats,
    simulated: Quantity,
    why: str,
    fewest: int = FEWEST_OBSERVATIONS,
) -> Result:
    """Compare one quantity of recorded decisions, or of vehicles and speeds, with simulated traffic at these speeds."""
    vehicle, speed = of if isinstance(of, tuple) else (of.vehicle, of.speed)
    why = why or _too_few(np.unique(vehicle).size, values.size, "in such a state", fewest)
    if why:
        return {"not_compared": why}
    matched = _match(vehicle, speed, simulated.place(values), simulated)
    if matched is None:
        return {"not_compared": "The simulated traffic holds too few states at these speeds."}
    size = matched.observed.sum()
    return {
        **asdict(distance(matched.observed, matched.expected, simulated.width, simulated.unit)),
        "speeds_not_simulated": matched.left_out,
        "low": simulated.low,
        "width": simulated.width,
        "recorded": shares_of(matched.observed, size),
        "simulated": shares_of(matched.expected, size),
    }


def shares_of(rows: Floats | Ints, size: float) -> list[float]:
    """Give the shares of bins in all rows, (V, k), with 4 digits."""
    return [float(f"{share:.4g}") for share in rows.sum(axis=0) / size]


def _ttc_shares(led: Decisions, inverse: Floats, simulated: Quantity, why: str) -> Result:
    """Return the shares of following states with a TTC below some limits, recorded (with intervals) and simulated."""
    why = why or _too_few(np.unique(led.vehicle).size, led.size, "behind a leader")
    matched = None if why else _match(led.vehicle, led.speed, simulated.place(inverse), simulated)
    if matched is None:
        return {"not_compared": why or "The simulated traffic holds too few states at these speeds."}
    weights = resampled_weights(matched.observed.shape[0])
    rows: Result = {}
    sizes = matched.observed.sum(axis=1)
    for limit in TTC_LIMITS:
        first = round((1.0 / limit - simulated.low) / simulated.width)
        below = matched.observed[:, first:].sum(axis=1)
        low, high = np.percentile((weights @ below) / (weights @ sizes), [2.5, 97.5])
        rows[f"{limit:g}"] = {
            "recorded": float(below.sum() / sizes.sum()),
            "recorded_interval95": [float(low), float(high)],
            "simulated": float(matched.expected[:, first:].sum() / sizes.sum()),
        }
    return {"decisions": led.size, "vehicles": int(np.unique(led.vehicle).size), "shares": rows}


def _lanes(
    model: NddModel, seen: LaneObservations | None, traffic: Mapping[str, Quantity], changes_per_mile: float
) -> dict[str, Result]:
    """Compare the rate of lane changes and the accepted gaps."""
    names = ("lane_changes_per_mile", "accepted_lead_gap", "accepted_rear_gap")
    if seen is None:
        return {name: {"not_compared": "The file does not give each row's lane."} for name in names}
    changed = np.bincount(seen.vehicle, minlength=seen.vehicles).astype(np.float64)
    fast = np.nan_to_num(seen.speed) >= SLOWEST
    rate: Result = {}
    if seen.miles_fast.sum() < FEWEST_MILES:
        rate["not_compared"] = (
            f"{seen.miles_fast.sum():.1f} of {seen.miles.sum():.1f} miles were driven at {SLOWEST} m/s and above "
            f"({FEWEST_MILES:g} are needed): how often lanes are changed in slow traffic, or in a weaving section, "
            "says nothing of free-running traffic."
        )
    rate |= _rate(changed, seen.miles, changes_per_mile)
    found = {"lane_changes_per_mile": rate}
    for side, gap, closing in (("lead", seen.lead_gap, seen.lead_rate), ("rear", seen.rear_gap, seen.rear_rate)):
        known = np.isfinite(seen.speed) & ~np.isnan(gap) & np.isfinite(closing)
        use = known & fast
        quantity = traffic[f"accepted_{side}_gap"]
        what = f"changing lanes at {SLOWEST} m/s and above"
        why = _too_few(np.unique(seen.vehicle[use]).size, int(use.sum()), what, FEWEST_GAPS)
        row = _distance((seen.vehicle[use], seen.speed[use]), gap[use], quantity, why, FEWEST_GAPS)
        found[f"accepted_{side}_gap"] = row | _refused(getattr(model, f"lc_accept_{side}"), gap[known], closing[known])
    return found


def _rate(changed: Floats, miles: Floats, simulated: float) -> Result:
    """Compare lane changes per mile over all speeds of the file, with an interval over vehicles."""
    weights = resampled_weights(miles.size)
    low, high = np.percentile((weights @ changed) / np.maximum(weights @ miles, 1e-9), [2.5, 97.5])
    return {
        "vehicles": int(miles.size),
        "recorded": float(changed.sum() / max(miles.sum(), 1e-9)),
        "recorded_interval95": [float(low), float(high)],
        "recorded_miles": float(miles.sum()),
        "simulated": simulated,
    }


def _refused(accept: NDArray[np.float32], gap: Floats, closing: Floats) -> Result:
    """Count the accepted gaps that are impossible for the model's attentive driver, at any speed."""
    nobody = np.zeros_like(gap)
    states = Decisions(nobody + 20.0, gap, closing, nobody, nobody.astype(np.int64), nobody.astype(np.bool_))
    _, gap_index, rate_index, _, is_free = grid_place(states)
    refused = ~is_free & ((accept[gap_index, rate_index] <= 0.0) | (gap <= 0.0))
    return {"accepted_by_drivers": int(gap.size), "thereof_impossible_to_the_model": int(refused.sum())}


def compare_decisions(model: NddModel, readings: Sequence[Reading]) -> dict[str, list[Result]]:
    """Compare observed accelerations with the ones predicted from the same states, by speed and range rate.

    From 19.5 m/s on the table predicts; below it, the law in the model's provenance, if there is one.

    Returns:
        File -> cells with at least 10 vehicles and 100 decisions: `speed_mps` [low, high], `state` (free, closing,
        steady, opening), `by` (table, law), mean and sd of both sides, the fields of `Distance`, and the shares of the
        31 bins (`recorded`, `predicted`).
    """
    law = stated_law(model)
    found = {}
    for name, reading in zip(reading_names(readings), readings, strict=True):
        decisions = decisions_to_score(reading.decisions)
        cells = [
            cell
            for low, high in pairwise(SPEED_BANDS)
            for state in ("free", "closing", "steady", "opening")
            if (cell := _cell(model, law, decisions, low, high, state))
        ]
        found[name] = cells
    return found


def _in_state(d: Decisions, state: str) -> NDArray[np.bool_]:
    free = d.gap > _FREE_GAP
    rates = {
        "free": np.ones(d.size, dtype=bool),
        "closing": d.range_rate < -STEADY,
        "steady": np.abs(d.range_rate) <= STEADY,
        "opening": d.range_rate > STEADY,
    }
    return np.asarray(rates[state] & (free if state == "free" else ~free))


def _cell(
    model: NddModel, law: SafeLaw | None, decisions: Decisions, low: float, high: float, state: str
) -> Result | None:
    """Compare one cell; None if it has too few decisions or no prediction."""
    part = decisions.where((decisions.speed >= low) & (decisions.speed < high) & _in_state(decisions, state))
    if part.size < FEWEST_OBSERVATIONS or np.unique(part.vehicle).size < FEWEST_VEHICLES:
        return None
    predict: Predictor
    if low >= SLOWEST:
        predict, by = simulated(model), "table"
    elif law is not None and state != "free":
        predict, by = law_predictor(law), "law"
    else:
        return None
    observed, predicted = observed_and_predicted(predict, part)
    return {
        "speed_mps": [low, high],
        "state": state,
        "by": by,
        "recorded_mean_sd": _mean_sd(observed),
        "predicted_mean_sd": _mean_sd(predicted),
        **asdict(distance(observed, predicted, 0.2, "m/s2")),
        "recorded": shares_of(observed, part.size),
        "predicted": shares_of(predicted, part.size),
    }


def _mean_sd(rows: Floats) -> list[float]:
    share = rows.sum(axis=0) / rows.sum()
    mean = float(share @ ACCELERATIONS)
    return [mean, float(np.sqrt(share @ (ACCELERATIONS - mean) ** 2))]
