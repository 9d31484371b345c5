"""Scenarios driven by hand: vehicles that keep their speed but for a lane change or a braking, until two touch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from hand_built import WIDE

from cornerforge.geometry import Box, boxes_overlap
from cornerforge.types import Crash, Scenario

FRAMES = 200
CHANGE_S = 4.0


@dataclass(frozen=True)
class Driver:
    """Keeps its speed, but for at most two lane changes (at a time, to a lane) and one braking (from, until, m/s2).

    `drift` [m/s] is sideways motion without a target lane, such as a clumsy AV of a user might show.
    """

    x: float
    lane: int
    speed: float
    changes: tuple[tuple[float, int], ...] = ()
    braking: tuple[float, float, float] | None = None
    gone_at: float | None = None
    drift: float = 0.0


def drive(driver: Driver) -> dict[str, np.ndarray]:
    """Columns of a recording, 0.1 s apart."""
    time = np.arange(FRAMES) * 0.1
    acceleration = np.zeros(FRAMES)
    if driver.braking is not None:
        begin, end, level = driver.braking
        acceleration[(time >= begin - 1e-9) & (time < end - 1e-9)] = level
    speed = np.maximum(driver.speed + np.concatenate([[0.0], np.cumsum(acceleration)[:-1]]) * 0.1, 0.0)
    x = driver.x + np.concatenate([[0.0], np.cumsum(speed)[:-1]]) * 0.1
    y = 4.0 * driver.lane + 2.0 + driver.drift * time
    target = np.full(FRAMES, driver.lane)
    for begin, lane in driver.changes:
        start = round(begin * 10)
        s = np.clip((time[start:] - time[start]) / CHANGE_S, 0.0, 1.0)
        y[start:] = y[start] + (4.0 * lane + 2.0 - y[start]) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        target[start:] = lane
    heading = np.arctan2(np.gradient(y, 0.1), np.maximum(speed, 1.0))
    there = np.ones(FRAMES, dtype=np.bool_) if driver.gone_at is None else time < driver.gone_at - 1e-9
    return {
        "x": x, "y": y, "speed": speed, "heading": heading, "acceleration": acceleration,
        "target_lane": target, "present": there,
    }  # fmt: skip


def scenario_of(drivers: list[Driver], partner: int = 1, lanes: int = 4) -> Scenario:
    """The drive of all until the AV (the first) touches `partner`."""
    columns = [drive(driver) for driver in drivers]
    stacked = {name: np.stack([column[name] for column in columns], axis=1) for name in columns[0]}
    x, y, heading = stacked["x"], stacked["y"], stacked["heading"]
    for frame in range(1, FRAMES):
        a, b = ((x[frame, i], y[frame, i], heading[frame, i]) for i in (0, partner))
        if boxes_overlap(Box(*a, 5.0, 2.0), Box(*b, 5.0, 2.0)):
            break
    else:
        raise AssertionError("these two do not touch")
    cut = {name: values[: frame + 1] for name, values in stacked.items()}
    decisions = -(-frame // 10)
    return Scenario(
        seed=0,
        test=0,
        odd=replace(WIDE, n_lanes=lanes),
        slot=np.arange(len(drivers), dtype=np.int16),
        x=cut["x"],
        y=cut["y"],
        speed=cut["speed"],
        heading=cut["heading"],
        acceleration=cut["acceleration"],
        target_lane=np.where(cut["present"], cut["target_lane"], -1).astype(np.int8),
        present=cut["present"],
        action=np.full((decisions, len(drivers)), -1, dtype=np.int8),
        critical_bv=np.full(decisions, -1, dtype=np.int16),
        log_prob_nde=np.zeros(decisions),
        crash=Crash(frame * 0.1, 0, partner),
    )


def mirrored(scenario: Scenario) -> Scenario:
    """The same, left for right."""
    lanes = scenario.odd.n_lanes
    target = np.where(scenario.target_lane < 0, -1, lanes - 1 - scenario.target_lane).astype(np.int8)
    return replace(scenario, y=4.0 * lanes - scenario.y, heading=-scenario.heading, target_lane=target)
