"""Lane changes that people made, and how many of them hardly ever happen in a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cornerforge.experiment.experiments import Experiment
from cornerforge.ext.calibrate.judging import judged
from cornerforge.ext.calibrate.lane_observations import START_BEFORE, Transition, transitions_of
from cornerforge.ext.calibrate.readers import Reading
from cornerforge.intervals import binomial_interval
from cornerforge.results.validation import FactFound
from cornerforge.road.straight import along, lane_centre
from cornerforge.sim import Setting, World, all_current, allocate_worlds, chances, outcome, world_of
from cornerforge.types import ACTION_LEFT, ACTION_RIGHT, N_ACTIONS

__all__ = ["HARDLY", "chance_of", "compare_transitions", "rarities"]

ALLOWED = 0.10
"""Largest share of transitions that hardly ever happen."""
HARDLY = 1e-5
"""Chance per decision. A change that nothing hinders has one of 0.0075 to 0.03."""
_OWN_LANE = 1
_FAR_BEHIND = -1e5


def _scene(transition: Transition, setting: Setting, own: int, at: float | None) -> World:
    """Build the world of a transition: slot 1 changes lanes, from lane `own`; the AV, slot 0, is out of sight."""
    n = transition.along.size + 1
    world = world_of(allocate_worlds(1, n))
    v = world.vehicles
    target = own + 1 if transition.to_left else own - 1
    v["x"] = [_FAR_BEHIND, *(transition.along if at is None else along(transition.along[0] - at, transition.along))]
    v["speed"] = [transition.speed[0], *transition.speed]
    v["length"] = [setting.road.length, *transition.length]
    v["target_lane"] = own
    v["target_lane"][1:][transition.in_target] = target
    v["y"] = [lane_centre(int(lane), setting.road.lane_width) for lane in v["target_lane"]]
    v["lanes"] = 1 << v["target_lane"]
    v["present"] = 1
    v["action"] = -1
    world.order[:] = np.argsort(v["x"], kind="stable")
    world.state["n_vehicles"] = n
    world.state["outcome"] = outcome.RUNNING
    all_current(world)
    return world


def chance_of(transition: Transition, setting: Setting, *, lane: int = _OWN_LANE, at: float | None = None) -> float:
    """Compute the probability with which an attentive driver of the model starts this lane change at this moment.

    The road comes from `setting`; only the vehicles of the two lanes are there, each in the centre of its lane.

    Args:
        transition: The lane change.
        setting: Where the model drives.
        lane: Lane of that road from which it starts.
        at: Place of that road at which it starts [m]; None: the file's own.
    """
    world = _scene(transition, setting, lane, at)
    p = np.zeros(N_ACTIONS)
    chances.action_probabilities(
        world, 1, True, lane, setting.road, setting.tables, chances.allocate_starter_scratch(), p
    )
    return float(p[ACTION_LEFT if transition.to_left else ACTION_RIGHT])


def rarities(found: NDArray[np.float64], theme: str, when: str, fact: str) -> list[FactFound]:
    """Judge which share of recorded changes, whose probabilities are `found`, hardly ever happens; no row without any.

    The interval is the exact binomial one.
    """
    if found.size == 0:
        return []
    rare = int((found < HARDLY).sum())
    return [
        judged(
            rare / found.size, (0.0, ALLOWED), theme=theme, when=when, unit="", published=None, fact=fact,
            source="recorded: all of them happened", n=found.size, interval95=binomial_interval(rare, found.size),
        )
    ]  # fmt: skip


def compare_transitions(run: Experiment, names: Sequence[str], readings: Sequence[Reading]) -> list[FactFound]:
    """Compare the share of recorded lane changes that the model hardly ever makes with the allowed one, file by file.

    Files without lanes or lane changes have no row. A vehicle outside the recorded stretch counts as absent, so the
    true share is no smaller. The interval is the exact binomial one.

    Args:
        run: The experiment, on a road of at least three lanes.
        names, readings: The files.
    """
    rows: list[FactFound] = []
    for name, reading in zip(names, readings, strict=True):
        found = np.array([chance_of(one, run.setting) for one in transitions_of(reading) or ()])
        fact = f"share of lane changes of probability below {HARDLY:g}, {START_BEFORE:g} s before the crossing"
        rows += rarities(found, "transitions", name, fact)
    return rows
