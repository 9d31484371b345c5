"""Crashes made by hand: cars with places, accelerations and lane changes, recorded up to the AV's first contact."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from hand_built import WIDE

from cornerforge.geometry import Box, boxes_overlap
from cornerforge.types import Crash, Scenario

DT = 0.1
RIGHT, MIDDLE, LEFT = 2.0, 6.0, 10.0
"""Middles of the lanes [m]."""


class Turn(NamedTuple):
    """A lane change: begins at [s], takes [s], ends at y [m]."""

    at: float
    takes: float
    y: float


class Car(NamedTuple):
    """A vehicle: place, speed, accelerations from given times on, lane changes."""

    x: float
    y: float
    speed: float
    pulls: tuple[tuple[float, float], ...] = ()
    turns: tuple[Turn, ...] = ()


def motion(car: Car, seconds: float = 40.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """x, y, speed and heading of a car, frame by frame."""
    times = np.arange(round(seconds / DT) + 1) * DT
    pull = np.zeros(len(times))
    for since, value in car.pulls:
        pull[times >= since - 1e-9] = value
    speed = np.maximum(0.0, car.speed + np.concatenate([[0.0], np.cumsum(pull[:-1] * DT)]))
    x = car.x + np.concatenate([[0.0], np.cumsum(0.5 * DT * (speed[1:] + speed[:-1]))])
    y, sideways = np.full(len(times), car.y), np.zeros(len(times))
    begin = car.y
    for turn in car.turns:
        s = np.clip((times - turn.at) / turn.takes, 0.0, 1.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)  # smooth at both ends
        y = np.where(times >= turn.at, begin + (turn.y - begin) * share, y)
        rate = 30.0 * s**2 * (1.0 - s) ** 2 * (turn.y - begin) / turn.takes
        sideways = np.where(times >= turn.at, rate, sideways)
        begin = turn.y
    return x, y, speed, np.arctan2(sideways, np.maximum(speed, 0.1))


def crash(av: Car, *bvs: Car, test: int = 0) -> Scenario:
    """The recording up to the AV's first contact, found by the simulator's own overlap test."""
    series = [np.stack(part, axis=-1) for part in zip(*(motion(car) for car in (av, *bvs)), strict=True)]
    x, y, speed, heading = series
    odd = WIDE

    def touched(frame: int, other: int) -> bool:
        a, b = ((x[frame, i], y[frame, i], heading[frame, i]) for i in (0, other))
        return bool(boxes_overlap(*(Box(*pose, odd.vehicle_length, odd.vehicle_width) for pose in (a, b))))

    touches = ((t, i) for t in range(len(x)) for i in range(1, x.shape[1]) if touched(t, i))
    frame, partner = next(touches)
    n = frame + 1
    nobody = np.full((1, x.shape[1]), -1, np.int8)
    return Scenario(
        seed=3,
        test=test,
        odd=odd,
        slot=np.arange(x.shape[1], dtype=np.int16),
        x=x[:n],
        y=y[:n],
        speed=speed[:n],
        heading=heading[:n],
        acceleration=np.gradient(speed, DT, axis=0)[:n],
        target_lane=np.floor(y[:n] / 4.0).astype(np.int8),
        present=np.ones((n, x.shape[1]), np.bool_),
        action=nobody,
        critical_bv=np.full(1, -1, np.int16),
        log_prob_nde=np.zeros(1),
        crash=Crash(time=frame * DT, slot_a=0, slot_b=partner),
    )


def mirrored(scenario: Scenario) -> Scenario:
    return replace(scenario, y=12.0 - scenario.y, heading=-scenario.heading)
