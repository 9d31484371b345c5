"""Choices of BVs: how likely each is stated to be, and how often it is drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.sim.chances import action_probabilities, allocate_starter_scratch
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.scratch import Scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import World

__all__ = ["SEED", "draw", "stated"]

SEED = 21


def stated(
    world: World, slot: int, setting: Setting, av_lane: int, *, attentive: bool = False, alone: bool = False
) -> np.ndarray:
    """P(action); `alone`: as it was stated before giving way was counted, as if nothing else could start."""
    p, scratch = np.full(33, np.nan), allocate_starter_scratch()
    lane = int(world.vehicles["target_lane"][0]) if alone else av_lane
    tables = setting.tables
    if alone:  # a driver that overlooks whatever starts ahead of it goes as if it were alone
        tables = tables._replace(overlook_conflict=1.0, overlook=0.0 if attentive else tables.overlook)
        attentive = False
    action_probabilities(world, slot, attentive, lane, setting.road, tables, scratch, p)
    assert scratch.left_out[0] == 0
    return p


def draw(w: World, av_lane: int, setting: Setting, s: Scratch, drawn: NDArray[np.int64]) -> None:
    """Let everybody decide in test k of the seed, for each row k of `drawn`; each time on the same state."""
    _draw(w, av_lane, setting, s, w.vehicles.copy(), drawn)


@kernel
def _draw(
    w: World, av_lane: int, setting: Setting, s: Scratch, before: NDArray[np.void], drawn: NDArray[np.int64]
) -> None:
    state = w.state[0]
    state.seed = SEED
    for test in range(drawn.shape[0]):
        state.test = test
        decide_bvs(w, -1, av_lane, setting, s)
        for i in range(drawn.shape[1]):
            drawn[test, i] = w.vehicles[i].action
            w.vehicles[i].quantile = before[i].quantile
            w.vehicles[i].away = before[i].away
