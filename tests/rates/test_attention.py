"""Chances of one vehicle's actions, and what they say of an oversight."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge._elementary import log
from cornerforge.errors import InputError
from cornerforge.ndd.model import NddModel
from cornerforge.rates.attention import ActionChances, action_chances, oversight
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.world import n_slots

ODD = WIDE
SLOTS = n_slots(ODD)


def test_chances_are_those_that_the_recorder_wrote_down(model: NddModel) -> None:
    """The recorder keeps the log-probability of the nearest BV's action: the same number, from another path."""
    setting = setting_of(model, ODD)
    compared = 0
    for test in range(6):
        scenario = Recorder(setting, ODD).record(5, test)
        for slot in set(scenario.critical_bv.tolist()) - {-1}:
            chances = action_chances(setting, SLOTS, seed=5, test=test, slot=slot)
            assert chances.action.tolist() == scenario.action[:, slot].tolist()
            at = np.flatnonzero(scenario.critical_bv == slot)
            logs = [log(chance) for chance in chances.actual[at]]
            np.testing.assert_array_equal(logs, scenario.log_prob_nde[at])
            compared += at.size
    assert compared > 30


def test_without_overlooking_both_chances_are_one(model: NddModel) -> None:
    setting = setting_of(
        replace(model, overlook=0.0, overlook_conflict=0.0, memory=replace(model.memory, away=0.0)), ODD
    )
    chances = action_chances(setting, SLOTS, seed=1, test=3, slot=4)
    np.testing.assert_array_equal(chances.attentive, chances.actual)
    assert (chances.actual > 0.0).all()


def test_a_driver_that_overlooks_everything_is_found_out(model: NddModel) -> None:
    """All neighbours overlooked: some lane change among many is one that an attentive driver never begins."""
    awake = replace(model.memory, away=0.0)
    changing = replace(model, overlook=1.0, lc_base=np.full(21, 0.2, dtype=np.float32), memory=awake)
    setting = setting_of(changing, ODD)
    never = 0
    for test, slot in itertools.product(range(4), range(1, 11)):
        chances = action_chances(setting, SLOTS, seed=2, test=test, slot=slot)
        changed = (chances.action == 0) | (chances.action == 1)
        assert (chances.attentive[changed] <= chances.actual[changed]).all()
        never += int((chances.attentive[changed] == 0.0).sum())
    assert never > 3


def test_only_natural_traffic_has_chances(model: NddModel) -> None:
    for setting in (setting_of(model, ODD, adversary="uniform"), setting_of(model, ODD, idm_bvs=True)):
        with pytest.raises(InputError, match="natural traffic"):
            action_chances(setting, SLOTS, seed=0, test=0, slot=1)
    for slot in (0, SLOTS):
        with pytest.raises(InputError, match="slot"):
            action_chances(setting_of(model, ODD), SLOTS, seed=0, test=0, slot=slot)


def chances_of(
    action: list[int], attentive: list[float], actual: list[float], looks: float = 1.0, away: int | None = None
) -> ActionChances:
    """`away`: the second in which the driver looks away."""
    seconds = np.arange(len(action))
    return ActionChances(
        np.array(action, dtype=np.int8), np.array(attentive), np.array(actual), np.full(seconds.size, looks),
        seconds == away,
    )  # fmt: skip


KEEP, LEFT = 22, 0


@pytest.mark.parametrize(
    ("chances", "crash_time", "rarest", "rare", "overlooked"),
    [
        (chances_of([KEEP] * 3, [0.2, 0.1, 0.3], [0.2, 0.1, 0.3]), 3.0, 0.1, False, False),
        (chances_of([KEEP, LEFT], [0.2, 0.0], [0.2, 1e-6]), 2.0, 0.0, True, True),
        # with overlook 0.1: open eyes 0.81 * 0.003 against half of the actual chance
        (chances_of([LEFT], [3e-3], [4.8e-3]), 0.5, 3e-3, False, False),
        (chances_of([LEFT], [3e-3], [4.9e-3]), 0.5, 3e-3, False, True),
        (chances_of([LEFT], [9e-4], [9.1e-4]), 0.5, 9e-4, True, False),
        (chances_of([KEEP], [9e-4], [9e-4]), 0.5, 9e-4, True, False),  # rare, but no lane change
        # contact at 7.0 s: decisions at 2 .. 6 s count, that at 1 s does not
        (chances_of([KEEP, LEFT, *[KEEP] * 5], [0.1, 0.0, *[0.1] * 5], [0.1, 1e-5, *[0.1] * 5]), 7.0, 0.1, 0, 0),
        (chances_of([KEEP, LEFT, *[KEEP] * 5], [0.1, 0.0, *[0.1] * 5], [0.1, 1e-5, *[0.1] * 5]), 6.0, 0.0, 1, 1),
        (chances_of([KEEP, -1], [0.2, np.nan], [0.2, np.nan]), 2.0, 0.2, False, False),
        (chances_of([-1], [np.nan], [np.nan]), 1.0, None, False, False),
    ],
)
def test_oversights_by_hand(
    chances: ActionChances, crash_time: float, rarest: float | None, rare: bool, overlooked: bool
) -> None:
    found = oversight(chances, crash_time, overlook=0.1, overlook_conflict=0.0)
    assert (found.rarest_chance, found.rare_action, found.overlooked) == (rarest, rare, overlooked)


def test_who_looks_away_is_counted_and_begins_no_change() -> None:
    change = [LEFT], [3e-3], [4.8e-3]
    assert not oversight(chances_of(*change), 0.5, overlook=0.1, overlook_conflict=0.0).overlooked
    assert oversight(chances_of(*change, looks=0.5), 0.5, overlook=0.1, overlook_conflict=0.0).overlooked
    for away, counted in ((None, False), (0, False), (1, False), (2, True), (6, True), (7, False)):
        chances = chances_of([KEEP] * 8, [0.1] * 8, [0.1] * 8, away=away)
        assert oversight(chances, 7.0, overlook=0.1, overlook_conflict=0.0).looked_away == counted
