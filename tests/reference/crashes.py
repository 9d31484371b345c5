"""Small crashes of moved objects: an AV among others that hold an acceleration and change lanes."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from hand_built import WIDE

from cornerforge.types import Crash, Scenario
from reference.avoid import Traffic
from reference.world import Vehicle

__all__ = ["ODD", "Mover", "crash", "drive", "random_crash", "scenario_of"]

ODD = WIDE
TAIL = 70
"""Frames after the contact: horizon, one decision more, and stopping."""


@dataclass(frozen=True)
class Mover:
    """A vehicle that holds an acceleration [m/s2] from frame `acts` on, and then changes lanes by `side`.

    The change takes `change_time` seconds.
    """

    x: float
    lane: int
    speed: float
    acceleration: float = 0.0
    side: int = 0
    acts: int = 0
    change_time: float = 4.0


def drive(*movers: Mover, frames: int = 90) -> Traffic | None:
    """All of them until the first contact of the first, the AV, then as the package says; None if it touches nobody."""
    now = [Vehicle(i, m.x, 4.0 * m.lane + 2.0, m.speed, m.lane, {m.lane}) for i, m in enumerate(movers)]
    rows: list[list[Vehicle]] = []
    for vehicle, mover in zip(now, movers, strict=True):
        vehicle.hold(0.0, ODD)
        vehicle.change_time = mover.change_time
    last = -1
    for f in range(frames):
        for vehicle, mover in zip(now, movers, strict=True):
            if f == mover.acts and last < 0:
                vehicle.hold(mover.acceleration, ODD)
                if mover.side:
                    vehicle.change_lane(mover.lane + mover.side, ODD)
        rows.append([copy(vehicle) for vehicle in now])
        if last < 0:
            touched = [i for i in range(1, len(now)) if now[0].box().overlaps(now[i].box())]
            if touched and f == 0:
                return None
            if touched:
                last = f
                for i, vehicle in enumerate(now):
                    vehicle.hold(min(vehicle.acceleration, 0.0) if i == touched[0] else 0.0, ODD)
        if last >= 0 and f == last + TAIL:
            return Traffic(ODD, rows, last)
        for vehicle in now:
            vehicle.move(ODD)
    return None if last < 0 else drive(*movers, frames=last + TAIL + 1)


def scenario_of(traffic: Traffic, partner: int | None = None) -> Scenario:
    """What was recorded of it; `partner` is whom the AV touched, None: who overlaps it."""
    rows = traffic.rows[: traffic.last + 1]

    def column(name: str) -> np.ndarray:
        return np.array([[getattr(vehicle, name) for vehicle in row] for row in rows])

    n, end = len(rows[0]), rows[-1]
    if partner is None:
        partner = next(i for i in range(1, n) if end[0].box().overlaps(end[i].box()))
    decided = -(-traffic.last // 10)
    return Scenario(
        seed=0, test=0, odd=ODD, slot=np.arange(n, dtype=np.int16), x=column("x"), y=column("y"), speed=column("speed"),
        heading=column("heading"), acceleration=column("acceleration"),
        target_lane=column("target_lane").astype(np.int8),
        present=np.ones((len(rows), n), dtype=np.bool_), action=np.zeros((decided, n), dtype=np.int8),
        critical_bv=np.ones(decided, dtype=np.int16), log_prob_nde=np.zeros(decided),
        crash=Crash(round(0.1 * traffic.last, 1), 0, partner), change_time=column("change_time")[0],
    )  # fmt: skip


def crash(*movers: Mover, frames: int = 90) -> Scenario:
    """The recording of a crash that happens within so many frames."""
    traffic = drive(*movers, frames=frames)
    assert traffic is not None
    return scenario_of(traffic)


def random_crash(rng: np.random.Generator) -> Traffic | None:
    """An AV among two to four others that are close and do things, with a contact after 0.5 to 3 s."""
    speed = rng.uniform(18.0, 35.0)  # while it is recorded nobody gets below 5 m/s, where lane changes slow down
    movers = [Mover(200.0, 1, speed, rng.choice([-2.0, 0.0, 0.0, 2.0]), int(rng.choice([-1, 0, 0, 1])), 3)]
    for _ in range(rng.integers(2, 5)):
        lane = int(rng.integers(0, 3))
        side = int(rng.choice([-1, 0, 1])) if lane == 1 else int(rng.choice([0, 1 if lane == 0 else -1]))
        pull = float(rng.choice([-4.0, -2.0, 0.0, 2.0]))
        far = rng.uniform(-22.0, 28.0)
        other_speed, change_time = float(np.clip(speed + rng.normal(0.0, 5.0), 17.5, 40.0)), rng.uniform(3.0, 8.0)
        movers.append(Mover(200.0 + far, lane, other_speed, pull, side, 3, change_time))
    traffic = drive(*movers, frames=31)
    return traffic if traffic is not None and traffic.last >= 5 else None
