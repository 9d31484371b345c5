"""Scratch of the kernels, allocated in one place: nothing in it outlives the call that fills it."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.policy import LEARNED_WIDTH, PolicyNumbers
from cornerforge.sim.av_features import N_AV_FEATURES
from cornerforge.sim.av_view import VIEW_COLUMNS, VIEW_ROWS
from cornerforge.sim.chances import MAX_SETS, MAX_STARTERS, StarterScratch, allocate_starter_scratch
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.steering import Steering, allocate_steering
from cornerforge.sim.world import VEHICLE
from cornerforge.types import MAX_LANES, N_ACTIONS

__all__ = ["AvScratch", "ChoiceScratch", "Scratch", "allocate_av_scratch", "allocate_scratch", "warn_of_left_out"]

_N_NEAREST = 4
_LAYER_ROWS = 4


class AvScratch(NamedTuple):
    """Scratch for one decision of an AV: slots it sees, view, features; a learned AV's mask, layers and Q.

    `vehicles`, `is_seen`: the vehicles as they are, and which the AV sees, while the world is as it perceives it
    (`perception.show_as_seen`).
    """

    found: NDArray[np.int64]
    seen: NDArray[np.float32]
    features: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    layers: NDArray[np.float32]
    q: NDArray[np.float32]
    vehicles: NDArray[np.void]
    is_seen: NDArray[np.bool_]


class ChoiceScratch(NamedTuple):
    """Scratch for one choice of an adversary; `p`, `unseen` and `starters` are for probabilities of actions."""

    observation: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    p: NDArray[np.float64]
    unseen: NDArray[np.float64]
    q: NDArray[np.float32]
    layers: NDArray[np.float32]
    found: NDArray[np.int64]
    starters: StarterScratch


class Scratch(NamedTuple):
    """Scratch for one world at a time.

    Attributes:
        words: The random words with which each slot decides (`_philox.blocks`), uint64 (4, N).
        steering: Words to which slots are held in the coming second; only trees of tests fill it.
        front: Slot of the last vehicle passed in each lane in a walk from the front to the rear, (MAX_LANES,).
        least, most: How far a slot drives within the second at least and at most, (N,) [m].
        is_watched: Marks of `reach.choose_current`, (N,).
        ahead, behind: Upper bound of the distance to the AV's nearest vehicle in each lane, (MAX_LANES,) [m].
        av: Scratch of the AV.
        choice: Scratch of the adversary.
    """

    words: NDArray[np.uint64]
    steering: Steering
    front: NDArray[np.int64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]
    is_watched: NDArray[np.int64]
    ahead: NDArray[np.float64]
    behind: NDArray[np.float64]
    av: AvScratch
    choice: ChoiceScratch


def allocate_av_scratch(slots: int) -> AvScratch:
    """Allocate scratch for an AV in worlds of `slots` slots."""
    return AvScratch(
        found=np.zeros(max(slots, VIEW_ROWS - 1), dtype=np.int64),
        seen=np.zeros((VIEW_ROWS, VIEW_COLUMNS), dtype=np.float32),
        features=np.zeros(N_AV_FEATURES, dtype=np.float32),
        allowed=np.zeros(N_ACTIONS, dtype=np.bool_),
        layers=np.zeros((_LAYER_ROWS, LEARNED_WIDTH), dtype=np.float32),
        q=np.zeros(N_ACTIONS, dtype=np.float32),
        vehicles=np.zeros(slots, dtype=VEHICLE),
        is_seen=np.zeros(slots, dtype=np.bool_),
    )


def allocate_scratch(slots: int, policy: PolicyNumbers) -> Scratch:
    """Allocate scratch for worlds of `slots` slots and for a policy (`drivers.policy.NO_POLICY` where none drives)."""
    widest = max(policy.width, policy.n_inputs, N_ACTIONS)
    return Scratch(
        words=np.zeros((4, slots), dtype=np.uint64),
        steering=allocate_steering(slots),
        front=np.zeros(MAX_LANES, dtype=np.int64),
        least=np.zeros(slots),
        most=np.zeros(slots),
        is_watched=np.zeros(slots, dtype=np.int64),
        ahead=np.zeros(MAX_LANES),
        behind=np.zeros(MAX_LANES),
        av=allocate_av_scratch(slots),
        choice=ChoiceScratch(
            observation=np.zeros(N_OBSERVATION, dtype=np.float32),
            allowed=np.zeros(N_ACTIONS, dtype=np.bool_),
            p=np.zeros(N_ACTIONS),
            unseen=np.zeros(N_ACTIONS),
            q=np.zeros(N_ACTIONS, dtype=np.float32),
            layers=np.zeros((_LAYER_ROWS, widest), dtype=np.float32),
            found=np.zeros(_N_NEAREST, dtype=np.int64),
            starters=allocate_starter_scratch(),
        ),
    )


def warn_of_left_out(s: Scratch) -> None:
    """Warn if probabilities of actions left vehicles out (`StarterScratch.left_out`), and forget it.

    Everything that drives with scratch calls this before it gives its result.
    """
    if s.choice.starters.left_out[0]:
        s.choice.starters.left_out[0] = 0
        warnings.warn(
            f"More than {MAX_STARTERS} vehicles, or {MAX_SETS} sets of them, may start into one lane at the same "
            "moment: probabilities of some lane changes leave out those farthest ahead. Use less dense or shorter "
            "traffic.",
            stacklevel=3,
        )
