"""Vehicles on rails: others that follow given motions, independent of the AV.

The rails of a test say where each other vehicle is at every tenth of a second. No driver decides there, so a manoeuvre
that no natural driver of the simulator can make (a constant lateral speed, braking by 1 g, a recorded trajectory) can
be put before the AV. All else is as in every test: the loop, contacts of the AV, what it sees, and what is recorded.
Others that touch each other go on: on rails, contacts between them mean nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import InputError
from cornerforge.road.straight import lane_bits
from cornerforge.sim.actions import nearest_action
from cornerforge.sim.world import VEHICLE, all_current, list_all
from cornerforge.types import SUBSTEPS

if TYPE_CHECKING:
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = ["NO_RAILS", "Rails", "name_actions", "put_on_rails", "rails_of", "ride", "set_speed_of"]


class Rails(NamedTuple):
    """Starts and rails of some tests: first, first + 1, ...

    Attributes:
        start: States of all vehicles at frame 0, (S, N) of `world.VEHICLE`; slot 0 is the AV. What its rails say
            of another vehicle comes before its state here.
        poses: Where the others are at each frame, float64 (S, F, N, POSE_NUMBERS) (`drivers.rails`), NaN where one
            is absent; column 0, the AV's, is read only where it drives as recorded. After the last frame they go on
            standing there.
        first: Number of the first test.
    """

    start: NDArray[np.void]
    poses: NDArray[np.float64]
    first: int


NO_RAILS = Rails(np.zeros((0, 0), dtype=VEHICLE), np.zeros((0, 0, 0, POSE_NUMBERS)), 0)


def rails_of(start: NDArray[np.void], poses: NDArray[np.float64], first: int = 0) -> Rails:
    """Check rails and make them.

    Raises:
        InputError: The shapes do not match, a vehicle is there in part, or there is no frame.
    """
    wanted = (*start.shape[:1], poses.shape[1] if poses.ndim == 4 else 0, *start.shape[1:], POSE_NUMBERS)
    if start.dtype != VEHICLE or start.ndim != 2 or poses.shape != wanted or poses.shape[1] == 0:
        raise InputError(
            f"Rails are starts (tests, vehicles) and poses (tests, frames, vehicles, {POSE_NUMBERS}); these are "
            f"{start.shape} and {poses.shape}."
        )
    there = np.isfinite(poses[:, :, 1:])
    if (there.any(axis=3) != there.all(axis=3)).any():
        raise InputError("On rails a vehicle is there with finite numbers, or absent with NaN in all of them.")
    return Rails(np.ascontiguousarray(start), np.ascontiguousarray(poses, dtype=np.float64), first)


def set_speed_of(start: NDArray[np.void]) -> float | None:
    """Look up the set speed of the AV in a start on rails [m/s]; None: the AV drives at its own speed."""
    speed = float(start[0]["desired_speed"])
    return speed if speed > 0.0 else None


@kernel
def ride(w: World, frame: int, rails: Rails, road: RoadNumbers, from_slot: int) -> None:
    """Put the vehicles from a slot on (1: the others, 0: the AV too) where their rails say that they are at a frame.

    A vehicle that moves sideways is seen to do so like one that changes lanes: it is on a path of constant speed.
    """
    v = w.vehicles
    row = w.state[0].test - rails.first
    at = min(frame, rails.poses.shape[1] - 1)
    for i in range(from_slot, w.state[0].n_vehicles):
        pose = rails.poses[row, at, i]
        if np.isnan(pose[X]):
            v[i].present = 0
            continue
        v[i].present = 1
        v[i].x = v[i].x_held = pose[X]
        v[i].y = pose[Y]
        v[i].speed = v[i].speed_held = pose[SPEED]
        v[i].lateral_speed = pose[LATERAL_SPEED]
        v[i].heading = pose[HEADING]
        v[i].acceleration = v[i].commanded = v[i].acceleration_held = pose[ACCELERATION]
        v[i].target_lane = np.int64(pose[LANE])
        v[i].clock = 0.0
        v[i].duration = 1.0 if pose[LATERAL_SPEED] != 0.0 else 0.0
        v[i].c0 = pose[Y]
        v[i].c1 = pose[LATERAL_SPEED]
        v[i].c2 = v[i].c3 = v[i].c4 = v[i].c5 = 0.0
        v[i].lanes = lane_bits(v[i].y, 0.5 * v[i].width, v[i].target_lane, road.lane_width)
    list_all(w)


@kernel
def put_on_rails(w: World, rails: Rails, road: RoadNumbers) -> None:
    """Put an empty world at the start of its test."""
    state = w.state[0]
    start = rails.start[state.test - rails.first]
    state.n_vehicles = start.size
    for i in range(start.size):
        w.vehicles[i] = start[i]
        w.order[i] = i
    ride(w, 0, rails, road, 1)
    all_current(w)


@inlined_kernel
def name_actions(w: World, rails: Rails) -> None:
    """Name what each other vehicle will do in the coming second by the action nearest to it: its mean acceleration."""
    v = w.vehicles
    state: Any = w.state[0]
    row = state.test - rails.first
    last = rails.poses.shape[1] - 1
    now = min(SUBSTEPS * state.decisions, last)
    later = min(now + SUBSTEPS, last)
    for i in range(1, state.n_vehicles):
        if v[i].present:
            change = rails.poses[row, later, i, SPEED] - rails.poses[row, now, i, SPEED]
            v[i].action = nearest_action(0.0 if np.isnan(change) else change)
