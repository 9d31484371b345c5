"""The plain adversaries: how the controlled BV picks one of its allowed actions."""

from __future__ import annotations

import math
from collections.abc import Callable

from reference.philox import EXPLORE, Stream, unit
from reference.world import Vehicle, World

__all__ = ["ADVERSARIES", "Adversary"]

LEFT, RIGHT = 0, 1
Adversary = Callable[[World, Vehicle, list[int], tuple[float, float]], int]
"""(world, controlled BV, allowed actions in order, two numbers in (0, 1)) -> action."""


def draws(stream: Stream, step: int, slot: int) -> tuple[float, float]:
    """The two random numbers of a controlled BV's choice."""
    words = stream.words(step, slot, EXPLORE)
    return unit(words[0]), unit(words[1])


def _any_of(actions: list[int], draw: float) -> int:
    return actions[min(len(actions) - 1, math.floor(draw * len(actions)))]


def uniform(_world: World, _bv: Vehicle, allowed: list[int], draw: tuple[float, float]) -> int:
    """Any allowed action."""
    return _any_of(allowed, draw[1])


def lane_changer(_world: World, _bv: Vehicle, allowed: list[int], draw: tuple[float, float]) -> int:
    """A lane change two times in three where one is allowed, else any acceleration."""
    changes = [action for action in allowed if action < 2]
    if draw[0] < 2.0 / 3.0 and changes:
        return _any_of(changes, draw[1])
    accelerations = [action for action in allowed if action >= 2]
    return _any_of(accelerations or allowed, draw[1])


def swerve(world: World, bv: Vehicle, allowed: list[int], _draw: tuple[float, float]) -> int:
    """Draw level with the AV, a metre behind, in the next lane; then change into the AV's lane."""
    av = world.av
    dx = bv.x - av.x
    lanes_away = av.target_lane - bv.target_lane
    toward = LEFT if lanes_away > 0 else RIGHT
    if toward in allowed and (abs(lanes_away) > 1 or (abs(lanes_away) == 1 and abs(dx + 1.0) < 3.0)):
        return toward
    if lanes_away == 0 and bv.path is None and abs(dx) > 10.0:
        for change in (LEFT, RIGHT):
            if change in allowed:
                return change
    wish = 0.4 * (-1.0 - dx) + (av.speed - bv.speed)
    accelerations = [action for action in allowed if action >= 2]
    if not accelerations:
        return allowed[0]
    return min(accelerations, key=lambda action: abs(-4.0 + 0.2 * (action - 2) - wish))


ADVERSARIES: dict[str, Adversary] = {"uniform": uniform, "lane-changer": lane_changer, "swerve": swerve}
