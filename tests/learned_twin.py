"""The built-in AV `rl` outside the kernels' loop: the same network, asked through the view that AVs from outside get.

It decides at every fifth tenth of a second and goes on in between, as the built-in one; whatever door it drives
through, the same tests must come out to the bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.avs import numbers_of_av
from cornerforge.drivers.policy import best_action, q_values
from cornerforge.experiment.av_file import av_of
from cornerforge.road.straight import RoadNumbers, lane_centre, road_numbers
from cornerforge.sim.av_features import DECIDES_EVERY, av_features
from cornerforge.sim.scratch import AvScratch, allocate_scratch
from cornerforge.types import ACCELERATIONS, Odd

__all__ = ["Twin", "TwinOfMany"]

_HOLD = 22
"""Action index of acceleration 0."""


def _allowed(seen: NDArray[np.float32], road: RoadNumbers, allowed: NDArray[np.bool_]) -> None:
    lane = int(seen[0, 6])
    allowed[:] = True
    allowed[0], allowed[1] = lane + 1 < road.n_lanes, lane > 0
    if seen[0, 7]:
        allowed[0 if seen[0, 2] < lane_centre(lane, road.lane_width) else 1] = False


class TwinOfMany:
    """Answers for B worlds, each with its own clock."""

    def __init__(self, odd: Odd, n: int) -> None:
        self._road = road_numbers(odd)
        self._network = numbers_of_av(av_of("rl")).network
        self._scratch: AvScratch = allocate_scratch(1, self._network).av
        self._calls = np.zeros(n, dtype=np.int64)
        self._held = np.zeros(n, dtype=np.int64)

    def begin(self, worlds: Any) -> None:
        """These worlds begin a test."""
        self._calls[worlds] = 0

    def action(self, b: int, seen: NDArray[np.float32]) -> int:
        """Action index of world b for what its AV sees now."""
        due = self._calls[b] % DECIDES_EVERY == 0
        self._calls[b] += 1
        if not due:
            return int(self._held[b])
        s = self._scratch
        _allowed(seen, self._road, s.allowed)
        av_features(np.ascontiguousarray(seen), self._road, s.features)
        q_values(self._network, s.features, s.layers, s.q)
        action = int(best_action(s.q, s.allowed))
        self._held[b] = action if action >= 2 else _HOLD
        return action


class Twin:
    """The same as a foreign AV (docs/foreign-avs.md)."""

    def setup(self, context: Any) -> None:
        odd = Odd(
            n_lanes=context.n_lanes, lane_width=context.lane_width, vehicle_length=context.vehicle_length,
            vehicle_width=context.vehicle_width,
        )  # fmt: skip
        self._twin = TwinOfMany(odd, context.batch)

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:  # noqa: ARG002
        self._twin.begin(worlds)

    def act(self, view: NDArray[np.float32]) -> NDArray[np.float64]:
        answers = np.zeros((len(view), 2))
        for b in np.flatnonzero(view[:, 0, 0]):
            action = self._twin.action(int(b), view[b])
            answers[b] = (ACCELERATIONS[action - 2], 0.0) if action >= 2 else (0.0, 1.0 - 2.0 * action)
        return answers
