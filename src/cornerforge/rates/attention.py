"""Chance of each action of one vehicle in a test, with and without overlooking neighbours: was a crash an oversight?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.sim import (
    Setting,
    World,
    advance,
    allocate_scratch,
    allocate_worlds,
    away_chance,
    braking,
    built_in_av_decides,
    chances,
    controllers,
    keep_nothing,
    outcome,
    perception,
    reset_world,
    warn_of_left_out,
    world_of,
)
from cornerforge.site.tables import without_errors
from cornerforge.types import ACTION_RIGHT

__all__ = ["LOOK_BACK_S", "RARE_ACTION", "ActionChances", "Oversight", "action_chances", "oversight"]

RARE_ACTION = 1e-3
"""An action with a smaller chance under the attentive model counts as rare."""
LOOK_BACK_S = 5.0
"""Time before a crash in which decisions are judged [s]; a lane change of the default ODD takes 4 s."""


@dataclass(frozen=True)
class ActionChances:
    """One vehicle's actions in one test and their chances, decision by decision.

    Attributes:
        action: Index of the action, shape (K,); -1 where the vehicle is absent.
        attentive: Its chance under the attentive model (no driver looks away, and no vehicle is overlooked, neither a
            neighbour nor one that starts into the same lane at the same moment), shape (K,); NaN where absent.
        actual: Its chance under the model as it is, shape (K,); NaN where absent.
        looks: The chance that its driver looked at the road in that second, before its action is known, shape (K,).
        away: Its driver looked away in that second, shape (K,).
    """

    action: NDArray[np.int8]
    attentive: NDArray[np.float64]
    actual: NDArray[np.float64]
    looks: NDArray[np.float64]
    away: NDArray[np.bool_]


@dataclass(frozen=True)
class Oversight:
    """Judgement on the decisions in the last seconds before a crash.

    Attributes:
        rarest_chance: Smallest chance of an action under the attentive model, in [0, 1]; 0 is "an attentive driver
            never does that"; None without a decision.
        rare_action: That chance is below 1e-3. This alone is no proof: 5 of 300 ordinary stretches of 5 s have it.
        overlooked: A lane change was begun that more likely than not came about by overlooking a neighbour.
        looked_away: Its driver looked away from the road in one of these seconds.
    """

    rarest_chance: float | None
    rare_action: bool
    overlooked: bool
    looked_away: bool


class StepSecond(Protocol):
    """Drives an AV that decides outside the kernels, second by second."""

    def av_lane(self, world: World, setting: Setting) -> int:
        """The target lane that the AV chooses at this moment, when the BVs decide."""

    def __call__(self, world: World, setting: Setting) -> None:
        """Advance a running world by one decision of the BVs."""


def action_chances(
    setting: Setting, slots: int, *, seed: int, test: int, slot: int, step: StepSecond | None = None
) -> ActionChances:
    """Drive one natural test again and look up the chance of every action of the BV in `slot`.

    At a site the attentive model is that of the laws without errors.

    A BV that wanted to change lanes but gave way to another one's simultaneous change shows the acceleration it took;
    the chances of both include that, given what the AV chose at that moment.

    Args:
        setting, slots: The run, without an adversary, and its vehicle slots per world.
        seed, test: The test.
        slot: A BV, at least 1.
        step: Advances the world when the AV decides outside the kernels; None for `sim.advance`.

    Raises:
        InputError: The run has an adversary, BVs that follow the IDM, or the BV does not exist.
    """
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("test", test, low=0, high=2**62)
    if setting.who.critical != controllers.NOBODY or setting.who.others != controllers.NATURALISTIC:
        raise InputError("Chances of actions are those of natural traffic; this run has other drivers.")
    world = world_of(allocate_worlds(1, slots, setting.road))
    reset_world(world, seed, test, setting)
    check_integer("slot", slot, low=1, high=int(world.state["n_vehicles"][0]) - 1)
    scratch, keep = allocate_scratch(slots, setting.who.policy), keep_nothing(slots)
    p, starters = scratch.choice.p, scratch.choice.starters
    actions, rows, looks, away = [], [], [], []
    site = setting.road.site
    careful = without_errors(site)
    for second in range(setting.road.max_decisions):
        if world.state["outcome"][0] != outcome.RUNNING:
            break
        present = bool(world.vehicles["present"][slot])
        found = np.full((2, p.size), np.nan)
        if site.size:
            lane = 0
        elif step is not None:
            lane = step.av_lane(world, setting)
        else:
            perception.show_as_seen(world, 0, setting.road, scratch.av)
            _, lane = built_in_av_decides(world, 0, setting.road, setting.av, scratch.av)
            perception.show_as_is(world, setting.road, scratch.av)
        looks.append(
            1.0 - away_chance(world, slot, site)
            if site.size
            else 1.0 - braking.looks_away_chance(world.vehicles, slot, setting.road, setting.tables.memory)
        )
        for row, attentive in enumerate((True, False) if present else ()):
            road = setting.road._replace(site=careful) if attentive and site.size else setting.road
            chances.action_probabilities(world, slot, attentive, lane, road, setting.tables, starters, p)
            found[row] = p
        if step is not None:
            step(world, setting)
        else:
            advance(world, setting, scratch, keep, second + 1)
        action = int(world.vehicles["action"][slot]) if present else -1
        actions.append(action)
        away.append(present and bool(world.vehicles["away"][slot]))
        rows.append(found[:, action])
    warn_of_left_out(scratch)
    taken = np.array(rows, dtype=np.float64).reshape(int(world.state["decisions"][0]), 2)
    return ActionChances(np.array(actions, dtype=np.int8), taken[:, 0], taken[:, 1], np.array(looks), np.array(away))


def oversight(found: ActionChances, crash_time: float, overlook: float, overlook_conflict: float) -> Oversight:
    """Judge the decisions of the last 5 s before a crash.

    A lane change of attentive chance a and actual chance b > 0 was an attentive choice with probability
    l (1 - overlook)^2 (1 - overlook_conflict) a / b or more, l the chance that its driver looked at the road (exactly
    that with two neighbours in the target lane, and where another vehicle starts into it at the same moment): below one
    half it counts as overlooked. At a site the same holds for giving way and going, with `overlook` 0: an error is in
    the actual chance alone.

    Args:
        found: Chances of the crash partner.
        crash_time: Time of the contact [s], above 0; decisions are 1 s apart, the first at 0.
        overlook, overlook_conflict: The model's chances to overlook a neighbour, and one that starts into the same lane
            at the same moment.
    """
    first = max(0, math.ceil(crash_time - LOOK_BACK_S))
    last = min(math.ceil(crash_time), found.action.size)
    seen = np.arange(first, last)
    seen = seen[found.action[seen] >= 0]
    if seen.size == 0:
        return Oversight(None, rare_action=False, overlooked=False, looked_away=False)
    rarest = float(found.attentive[seen].min())
    changed = seen[found.action[seen] <= ACTION_RIGHT]
    open_eyes = (1.0 - overlook) ** 2 * (1.0 - overlook_conflict) * (found.looks * found.attentive)[changed]
    overlooked = bool((open_eyes < 0.5 * found.actual[changed]).any())
    return Oversight(rarest, rarest < RARE_ACTION, overlooked, bool(found.away[seen].any()))
