"""Referee of `sim/harvest.keep_case`: the same from a `Scenario` in plain NumPy, written apart from it."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.fields import HISTORY_SHAPE, SHORTFALL
from cornerforge.metrics.ttc import ttc
from cornerforge.sim.harvest import MAX_ACCELERATION, MAX_BRAKING, MAX_LATERAL_ACCELERATION, NEAR_M, TOLERANCE
from cornerforge.sim.recorder import scenario_digest
from cornerforge.sim.scripted import START_FIELDS
from cornerforge.types import FRAME_S, Crash, Scenario

Scalar: TypeAlias = bool | int | float | str | None

_FRAMES_PER_SECOND = round(1.0 / FRAME_S)


def case_columns(
    scenario: Scenario, start: NDArray[np.void] | None = None
) -> tuple[dict[str, Scalar | NDArray[Any]], dict[str, Scalar | NDArray[Any]]]:
    """Values of the columns of `fields.CASES` and `fields.TRACKS` (with a start: `SCRIPTED_TRACKS`) of a crash."""
    crash, frame, partner = _contact(scenario)
    case: dict[str, Scalar | NDArray[Any]] = {
        "case_id": f"{scenario.seed}:{scenario.test}",
        "seed": int(scenario.seed),
        "test": int(scenario.test),
        "crash_time_s": float(crash.time),
        "duration_s": (len(scenario.x) - 1) * FRAME_S,
        "n_vehicles": len(scenario.slot),
        "trajectory_digest": scenario_digest(scenario),
    }
    kept = _near_columns(scenario, partner) if start is None else np.arange(len(scenario.slot))
    case |= _at_contact(scenario, frame, partner)
    case |= _peaks(scenario, frame, partner)
    case |= _decisions(scenario)
    case["min_ttc_s"] = _min_ttc(scenario, frame)
    case["history"] = _history(scenario, frame, partner)
    tracks = _tracks(scenario, str(case["case_id"]), kept)
    if start is not None:
        tracks["start"] = np.stack([start[name].astype(np.float64) for name in START_FIELDS], axis=1).ravel()
    return case, tracks


def _contact(scenario: Scenario) -> tuple[Crash, int, int]:
    """The crash, its frame, and the column of the partner."""
    name = f"{scenario.seed}:{scenario.test}"
    crash = scenario.crash
    if crash is None or crash.slot_a != 0:
        raise InputError(f"Test {name} holds no crash of the AV; only AV crashes are cases.")
    frame = round(crash.time / FRAME_S)
    found = np.flatnonzero(scenario.slot == crash.slot_b)
    if not 0 <= frame < len(scenario.x) or found.size != 1 or not scenario.present[frame, found[0]]:
        raise InputError(
            f"Test {name}: slot {crash.slot_b} is not in the recording of {len(scenario.x)} frames at {crash.time} s."
        )
    return crash, frame, int(found[0])


def _near_columns(scenario: Scenario, partner: int) -> NDArray[np.intp]:
    """Columns to store, ascending: the AV, the partner, all critical BVs, and who comes within `NEAR_M` of the AV."""
    near = np.any((np.abs(scenario.x - scenario.x[:, :1]) <= NEAR_M) & scenario.present, axis=0)
    near[0] = near[partner] = True
    near[scenario.critical_bv[scenario.critical_bv >= 0]] = True
    return np.flatnonzero(near)


def _at_contact(scenario: Scenario, frame: int, partner: int) -> dict[str, Scalar]:
    x, y, speed, heading = (
        (float(a[frame, 0]), float(a[frame, partner]))
        for a in (scenario.x, scenario.y, scenario.speed, scenario.heading)
    )
    lanes = [math.floor(side / scenario.odd.lane_width) for side in y]
    return {
        "bv_slot": int(scenario.slot[partner]),
        "bv_kind": int(scenario.kind[partner]),
        "bv_length_m": float(scenario.length[partner]),
        "bv_width_m": float(scenario.width[partner]),
        "av_speed_mps": speed[0],
        "bv_speed_mps": speed[1],
        "impact_speed_difference_mps": speed[1] - speed[0],
        "relative_heading_rad": (heading[1] - heading[0] + math.pi) % (2.0 * math.pi) - math.pi,
        "relative_lon_m": x[1] - x[0],
        "relative_lat_m": y[1] - y[0],
        "av_lane": lanes[0],
        "relative_lane": lanes[1] - lanes[0],
    }


def _peaks(scenario: Scenario, frame: int, partner: int) -> dict[str, Scalar]:
    """What AV and partner did to the physics, from what they did and not from what they were told to do."""
    found: dict[str, Scalar] = {}
    plausible = True
    for who, column in (("av", 0), ("bv", partner)):
        # A vehicle may be missing in early frames; differences with such a frame are NaN and drop out.
        along = np.diff(_seen(scenario, scenario.speed, frame, column)) / FRAME_S
        across = np.diff(_seen(scenario, scenario.y, frame, column), 2) / FRAME_S**2
        along = along[np.isfinite(along)]
        across = np.abs(across[np.isfinite(across)])
        acceleration = max(0.0, float(along.max())) if along.size else None
        braking = max(0.0, float(-along.min())) if along.size else None
        lateral = float(across.max()) if across.size else None
        found[f"{who}_max_acceleration_mps2"] = acceleration
        found[f"{who}_max_braking_mps2"] = braking
        found[f"{who}_max_lateral_acceleration_mps2"] = lateral
        plausible &= (acceleration or 0.0) <= MAX_ACCELERATION + TOLERANCE
        plausible &= (braking or 0.0) <= MAX_BRAKING + TOLERANCE
        plausible &= (lateral or 0.0) <= MAX_LATERAL_ACCELERATION + TOLERANCE
    found["physically_plausible"] = bool(plausible)
    return found


def _seen(scenario: Scenario, values: NDArray[np.float64], frame: int, column: int) -> NDArray[np.float64]:
    return np.where(scenario.present[: frame + 1, column], values[: frame + 1, column], np.nan)


def _decisions(scenario: Scenario) -> dict[str, Scalar | NDArray[Any]]:
    log_prob = scenario.log_prob_nde
    n_impossible = int(np.isneginf(log_prob).sum())
    rows = np.arange(len(scenario.critical_bv))
    chosen = scenario.action[rows, scenario.critical_bv]
    shortfall = scenario.shortfall
    worth: dict[str, Scalar] = dict.fromkeys(field.name for field in SHORTFALL)
    if shortfall is not None:
        possible = shortfall[np.isfinite(shortfall)]
        worth["possible_shortfall_nats"] = float(possible.sum())
        worth["n_implausible"] = len(shortfall) - len(possible)
        worth["shortfall_nats"] = float(shortfall.sum())
    if scenario.excess is not None:
        sums = np.concatenate([[0.0], np.cumsum(np.where(np.isinf(scenario.excess), 0.0, scenario.excess))])
        worst = max(sums[end] - sums[begin] for end in range(len(sums)) for begin in range(end + 1))
        worth["excess_nats"] = math.inf if np.isinf(scenario.excess).any() else float(worst)
    return {
        **worth,
        "n_decisions": len(log_prob),
        "log_prob_nde": None if n_impossible else float(log_prob.sum()),
        "n_impossible": n_impossible,
        "critical_bv_action": np.where(scenario.critical_bv >= 0, chosen, -1).astype(np.int8),
    }


def _min_ttc(scenario: Scenario, frame: int) -> float | None:
    """Smallest TTC [s] of the AV before contact with vehicles in its path, ahead or behind; None if never closing.

    In the path is who overlaps the AV laterally, boxes taken as parallel to the road; bbd <= 0 there gives 0 s.
    """
    y = scenario.y[:frame]
    beside = (scenario.width + scenario.width[0]) / 2.0
    counts = (np.abs(y - y[:, :1]) < beside) & scenario.present[:frame]
    counts[:, 0] = False
    frames, others = np.nonzero(counts)
    dx = scenario.x[frames, others] - scenario.x[frames, 0]
    range_rate = (scenario.speed[frames, others] - scenario.speed[frames, 0]) * np.sign(dx)
    shortest = float(
        ttc(np.abs(dx) - (scenario.length[others] + scenario.length[0]) / 2.0, range_rate).min(initial=math.inf)
    )
    return shortest if math.isfinite(shortest) else None


def _history(scenario: Scenario, frame: int, partner: int) -> NDArray[np.float32]:
    frames = frame - _FRAMES_PER_SECOND * np.arange(HISTORY_SHAPE[0])
    frames = frames[frames >= 0]
    pick = np.ix_(frames, np.array([0, partner]))
    history = np.full(HISTORY_SHAPE, np.nan, dtype=np.float32)
    stacked = np.stack([a[pick] for a in (scenario.x, scenario.y, scenario.speed, scenario.heading)], axis=-1)
    history[: len(frames)] = np.where(scenario.present[pick][..., None], stacked, np.nan)
    return history.ravel()


def _tracks(scenario: Scenario, case_id: str, kept: NDArray[np.intp]) -> dict[str, Scalar | NDArray[Any]]:
    """Storage form: the kept vehicles' series one after the other, because neighbours in time compress best."""
    column_of = np.full(len(scenario.slot) + 1, -1, dtype=np.int16)  # the last entry serves index -1, "none"
    column_of[kept] = np.arange(len(kept))
    absent = ~scenario.present.T[kept]
    hole = bool(absent.any())
    tracks: dict[str, Scalar | NDArray[Any]] = {
        "case_id": case_id,
        "n_frames": len(scenario.x),
        "slot": scenario.slot[kept],
        "kind": scenario.kind[kept],
        "length_m": scenario.length[kept],
        "width_m": scenario.width[kept],
        "change_time_s": scenario.change_time[kept],
        "present": ~absent.ravel(),
        "action": scenario.action.T[kept].ravel(),
        "critical_bv": column_of[scenario.critical_bv],
        "decision_log_prob_nde": scenario.log_prob_nde,
    }
    series: dict[str, NDArray[Any]] = {
        "x_m": scenario.x,
        "y_m": scenario.y,
        "speed_mps": scenario.speed,
        "heading_rad": scenario.heading,
        "acceleration_mps2": scenario.acceleration,
        "target_lane": scenario.target_lane,
    }
    for name, array in series.items():
        is_lane = name == "target_lane"
        values = array.T[kept].astype(np.int8 if is_lane else np.float32)
        if hole:
            values[absent] = -1 if is_lane else np.nan
        tracks[name] = values.ravel()
    return tracks
