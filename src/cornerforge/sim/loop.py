"""The one loop: `advance` moves a world on; everything that drives is a thin caller of it.

Read `linked_advance` first, at the end: it is the loop, and the functions before it are its parts. A second begins
with the decisions of the AV, the critical BV and the other BVs, in this order. Ten substeps of motion follow; at some
of them the AV decides again. When a controller outside the kernels must decide, `advance` returns and says which one;
`answer_as_av` or `answer_as_bv` takes the answer, and the next `advance` goes on from there. The rest of the test
depends on the world and the setting only, so a world may be copied or stored wherever `advance` returns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel, shared_kernel
from cornerforge._philox import uniform
from cornerforge.sim.adversaries import choose_action
from cornerforge.sim.av_kinds import built_in_av_decides
from cornerforge.sim.chances import action_probabilities, remember_action
from cornerforge.sim.controllers import (
    HIDDEN,
    LIKELIEST,
    NOBODY,
    POLICY,
    RAILS,
    RECORDED,
    SCRIPTED,
    TOLD,
    critical_of,
    is_outside,
)
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.keep import record_choice
from cornerforge.sim.neighbours import nearest_bv, sort_by_x
from cornerforge.sim.observe import allowed_actions, observe, spend_budget
from cornerforge.sim.outcome import RUNNING
from cornerforge.sim.perception import lose_controlled, remember, show_as_is, show_as_seen
from cornerforge.sim.rails import name_actions
from cornerforge.sim.site.av import junction_av_decides
from cornerforge.sim.site.second import decide_at_site, follow_at_site
from cornerforge.sim.statistics import count_av, count_choices, count_states, count_travel
from cornerforge.sim.step import av_acts, begin_to_act, move_on
from cornerforge.sim.world import NO_ACTION, NO_VEHICLE
from cornerforge.site.tables import at_site
from cornerforge.types import (
    ACCELERATIONS,
    ACTION_SIDES,
    FIRST_ACCELERATION,
    HIGHEST_COMMAND,
    LOWEST_COMMAND,
    N_ACTIONS,
    SUBSTEPS,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.keep import Keep
    from cornerforge.sim.scratch import ChoiceScratch, Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "AV_MUST_ANSWER",
    "BV_MUST_ANSWER",
    "MILESTONE",
    "NEVER",
    "OVER",
    "advance",
    "answer_as_av",
    "answer_as_bv",
    "linked_advance",
    "look_as_bv",
    "steer_as_av",
]

OVER, AV_MUST_ANSWER, BV_MUST_ANSWER, MILESTONE = range(4)
"""Why `advance` returned. OVER: the test is over, `state.outcome` says how. AV_MUST_ANSWER, BV_MUST_ANSWER: it waits
for an answer from outside. MILESTONE: the seconds that were asked for have passed."""
NEVER = 2**62
"""Value of `until` in `advance` for no milestone."""
_NOBODY_MUST = -1
_ACCELERATIONS = ACCELERATIONS
_MIDDLE = np.uint64(2**31)
"""Random word of one half: the quantile of a given action is put into the middle of the interval that gives it."""


@inlined_kernel
def answer_as_av(w: World, command: float, lane: int) -> None:
    """Give the answer of an AV outside the kernels: acceleration [m/s2] that it holds from now on, and target lane."""
    av = w.av[0]
    av.has_answered = 1
    av.command = command
    av.lane = lane


@inlined_kernel
def steer_as_av(w: World, controls: NDArray[np.float64]) -> None:
    """Give the answer of a steering AV outside the kernels.

    Args:
        w: The world.
        controls: Acceleration [m/s2], cut to [-8, 2], and curvature [1/m] for each tenth of a second until it answers
            again, one pair after the other, at most 20 numbers.
    """
    av = w.av[0]
    av.steers = 1
    for k in range(0, controls.size, 2):
        av.controls[k] = min(max(controls[k], LOWEST_COMMAND), HIGHEST_COMMAND)
        av.controls[k + 1] = controls[k + 1]
    answer_as_av(w, av.controls[0], w.vehicles[0].target_lane)


@inlined_kernel
def answer_as_bv(w: World, action: int) -> None:
    """Give the answer for the critical BV, TOLD from outside: an allowed action; NO_ACTION lets it drive naturally."""
    state = w.state[0]
    state.bv_has_answered = 1
    state.bv_action = action


@inlined_kernel
def _likeliest(w: World, i: int, av_lane: int, setting: Setting, s: ChoiceScratch) -> int:
    """Index of the likeliest action of slot i, the lowest of several; fills `s.p` with all probabilities."""
    p = s.p
    action_probabilities(w, i, False, av_lane, setting.road, setting.tables, s.starters, p)
    best = 0
    for a in range(1, N_ACTIONS):
        if p[a] > p[best]:
            best = a
    return best


@kernel
def _follow_script(w: World, av_lane: int, setting: Setting, s: ChoiceScratch, chances: NDArray[np.float64]) -> None:
    """Write each BV's next action by the script into its `action`; where the script says NO_ACTION, the likeliest one.

    All choose at the same time, from the state before any vehicle acts. `av_lane` is the target lane that the AV has
    just chosen. The probabilities go into `chances` (K, N, 33) for the first K decisions.
    """
    v = w.vehicles
    step = w.state[0].decisions
    recorded = step < chances.shape[0]
    for i in range(1, w.state[0].n_vehicles):
        if v[i].present == 0:
            continue
        action: int = setting.who.script[step, i]
        if action >= HIDDEN + NO_ACTION:
            w.state[0].hidden = i
            action -= HIDDEN
        if recorded or action == NO_ACTION:
            likeliest = _likeliest(w, i, av_lane, setting, s)
            if action == NO_ACTION:
                action = likeliest
        if recorded:
            for a in range(N_ACTIONS):
                chances[step, i, a] = s.p[a]
        v[i].action = action


@kernel
def _remember_script(w: World, setting: Setting) -> None:
    """Let each BV remember its action of the script; called when all probabilities of the second are computed."""
    v = w.vehicles
    for i in range(1, w.state[0].n_vehicles):
        if v[i].present:
            v[i].quantile = uniform(remember_action(w, i, v[i].action, _MIDDLE, 0.5, 0.5, setting.road, setting.tables))


@kernel
def _drives_as_natural(w: World, substep: int, setting: Setting, s: Scratch) -> tuple[float, int]:
    """Let the AV take the naturalistic model's likeliest action at substep 0 and go on with it in the others.

    Returns:
        Acceleration [m/s2] and target lane.
    """
    v = w.vehicles
    if substep > 0:
        return v[0].commanded, v[0].target_lane
    action = _likeliest(w, 0, v[0].target_lane, setting, s.choice)
    v[0].quantile = uniform(remember_action(w, 0, action, _MIDDLE, 0.5, 0.5, setting.road, setting.tables))
    if action >= FIRST_ACCELERATION:
        return _ACCELERATIONS[action - FIRST_ACCELERATION], v[0].target_lane
    return 0.0, v[0].target_lane + ACTION_SIDES[action]


@shared_kernel
def _decides_by_what_it_sees(w: World, substep: int, setting: Setting, s: Scratch) -> tuple[float, int]:
    """Let a built-in AV decide in the world that it perceives, and keep what it notes there."""
    show_as_seen(w, substep, setting.road, s.av)
    if at_site(setting.road.site):
        command, lane = junction_av_decides(w, substep, setting.road, setting.av), w.vehicles[0].target_lane
    else:
        command, lane = built_in_av_decides(w, substep, setting.road, setting.av, s.av)
    show_as_is(w, setting.road, s.av)
    return command, lane


@inlined_kernel
def _av_decides(w: World, substep: int, setting: Setting, s: Scratch) -> tuple[float, int]:
    """Ask the AV's controller what the AV does from now on: acceleration [m/s2] and target lane."""
    av = w.av[0]
    if is_outside(setting.who):
        av.has_answered = 0
        return av.command, av.lane
    if setting.who.av == RECORDED:
        return w.vehicles[0].acceleration, w.vehicles[0].target_lane
    if setting.who.av == LIKELIEST and not at_site(setting.road.site):
        return _drives_as_natural(w, substep, setting, s)
    if setting.road.perception.on:
        return _decides_by_what_it_sees(w, substep, setting, s)
    if at_site(setting.road.site):
        return junction_av_decides(w, substep, setting.road, setting.av), w.vehicles[0].target_lane
    return built_in_av_decides(w, substep, setting.road, setting.av, s.av)


@shared_kernel
def look_as_bv(
    w: World, setting: Setting, s: Scratch, observation: NDArray[np.float32], allowed: NDArray[np.bool_]
) -> int:
    """Note the critical BV as the controlled one, and fill its observation and action mask.

    Returns:
        Its slot; NO_VEHICLE without one, and then nothing is filled.
    """
    state = w.state[0]
    bv = nearest_bv(w, setting.road)
    state.controlled = bv
    if bv >= 0:
        bounded = critical_of(state.seed, state.test, setting.who)[1].bounded
        observe(w, bv, setting.road, s.choice.found, observation)
        allowed_actions(w, bv, bounded, setting.road, setting.tables, s.choice.starters, s.choice.p, allowed)
    return bv


@inlined_kernel
def _adversary_acts(w: World, bv: int, setting: Setting, s: Scratch) -> tuple[int, float]:
    """Let the adversary choose for the critical BV, and take the action's cost from the likelihood budget.

    Returns:
        The action, NO_ACTION where it lets the BV drive naturally; the natural log of the action's probability under
        the policy, 0 without one.
    """
    state = w.state[0]
    who, c = setting.who, s.choice
    log_prob_policy = 0.0
    if who.critical == TOLD:
        action = state.bv_action
        if action == NO_ACTION:
            return action, 0.0
    else:
        policy, mask = critical_of(state.seed, state.test, who)
        allowed_actions(w, bv, mask.bounded, setting.road, setting.tables, c.starters, c.p, c.allowed)
        if who.critical == POLICY or at_site(setting.road.site):
            observe(w, bv, setting.road, c.found, c.observation)
        action, log_prob_policy = choose_action(w, bv, who.critical, 0.0, who.temperature, policy, c)
    state.controlled = bv
    spend_budget(w, bv, action, setting.road, setting.tables, c.starters, c.p)
    lose_controlled(w, bv, setting.road)
    return action, log_prob_policy


@inlined_kernel
def _critical_bv_acts(w: World, av_lane: int, recorded: bool, setting: Setting, s: Scratch) -> tuple[int, int, float]:
    """Find the critical BV and let the adversary, if there is one, choose what it does.

    With `recorded`, the probabilities of all actions go into the scratch for `record_choice`, because they depend on
    the state before any vehicle moves and a natural driver's action is known only later: into `p` with `av_lane`, the
    target lane that the AV has just chosen, into `unseen` with its earlier one. The adversary does not see `av_lane`.

    Returns:
        Slot of the critical BV, NO_VEHICLE for none; its action, NO_ACTION where it drives naturally; the natural log
        of the action's probability under the policy.
    """
    bv = nearest_bv(w, setting.road)
    action = NO_ACTION
    log_prob_policy = 0.0
    if bv < 0:
        return bv, action, log_prob_policy
    if setting.who.critical != NOBODY:
        action, log_prob_policy = _adversary_acts(w, bv, setting, s)
    if recorded:
        road, tables, c = setting.road, setting.tables, s.choice
        action_probabilities(w, bv, False, av_lane, road, tables, c.starters, c.p)
        now = w.vehicles[0].target_lane
        if av_lane != now:
            action_probabilities(w, bv, False, now, road, tables, c.starters, c.unseen)
        else:
            for a in range(N_ACTIONS):
                c.unseen[a] = c.p[a]
    return bv, action, log_prob_policy


@inlined_kernel
def _is_counted(step: int, keep: Keep, road: RoadNumbers) -> bool:
    """Does the second `step` go into the counts? They are of roads."""
    return keep.census.on and not at_site(road.site) and keep.census.first <= step < keep.census.until


@inlined_kernel
def _begin_second(w: World, command: float, lane: int, setting: Setting, s: Scratch, keep: Keep) -> None:
    """Let the BVs decide and every vehicle begin to act, the AV with `command` [m/s2] and target `lane`."""
    state = w.state[0]
    who = setting.who
    step = state.decisions
    recorded = step < keep.decisions.controlled.size
    bv = NO_VEHICLE
    action = NO_ACTION
    log_prob_policy = 0.0
    state.controlled = NO_VEHICLE
    state.hidden = NO_VEHICLE
    if who.others == SCRIPTED and at_site(setting.road.site):
        follow_at_site(w, setting, s, keep.chances)
    elif who.others == SCRIPTED:  # first: what follows leaves in the scratch what `record_choice` reads
        sort_by_x(w)
        _follow_script(w, lane, setting, s.choice, keep.chances)
    if who.others != RAILS and step >= state.steers_from and (who.critical != NOBODY or recorded):
        bv, action, log_prob_policy = _critical_bv_acts(w, lane, recorded, setting, s)
    state.bv_has_answered = 0
    if _is_counted(step, keep, setting.road):
        count_av(w, setting.road, keep.counts)
        state.travel += count_states(w, step, keep.counts, keep.census)
    state.bv_crashes_before = state.bv_crashes
    if who.others == SCRIPTED:
        if not at_site(setting.road.site):
            _remember_script(w, setting)
    elif who.others == RAILS:
        sort_by_x(w)
        name_actions(w, who.rails)
    elif at_site(setting.road.site):
        decide_at_site(w, action, setting, s)
    else:
        decide_bvs(w, action, lane, setting, s)
    if recorded:
        record_choice(w, bv, log_prob_policy, setting.road, s.choice, keep.decisions)
    is_looked_at = keep.recording.shape[0] > SUBSTEPS * step or is_outside(who) or who.others >= SCRIPTED
    begin_to_act(w, command, lane, is_looked_at, setting, s)


@inlined_kernel
def _count_second(w: World, road: RoadNumbers, keep: Keep) -> None:
    """Count what the BVs did in the second that is over."""
    if _is_counted(w.state[0].decisions - 1, keep, road):
        count_choices(w, road, keep.counts)


@inlined_kernel
def _who_must_answer(w: World, substep: int, setting: Setting) -> int:
    """Say which controller outside the kernels must answer now: AV_MUST_ANSWER, BV_MUST_ANSWER or _NOBODY_MUST."""
    state = w.state[0]
    if is_outside(setting.who) and w.av[0].has_answered == 0:
        return AV_MUST_ANSWER
    is_told = setting.who.critical == TOLD and state.decisions >= state.steers_from
    if substep == 0 and is_told and state.bv_has_answered == 0:
        return BV_MUST_ANSWER
    return _NOBODY_MUST


@kernel
def linked_advance(w: World, setting: Setting, s: Scratch, keep: Keep, until: int) -> int:
    """Do what `advance` does, as a part of the program that calls it: 2 % quicker in bulk, half a minute to compile."""
    state = w.state[0]
    if state.outcome != RUNNING:
        return OVER
    road = setting.road
    while True:
        if state.substep == 0 and state.decisions >= until:
            return MILESTONE
        for substep in range(state.substep, SUBSTEPS):
            if road.perception.late > 0:
                remember(w, substep)
            if substep % road.av_substeps == 0:
                must = _who_must_answer(w, substep, setting)
                if must != _NOBODY_MUST:
                    state.substep = substep
                    return must
                command, lane = _av_decides(w, substep, setting, s)
                if substep == 0:
                    _begin_second(w, command, lane, setting, s, keep)
                else:
                    av_acts(w, command, lane, road)
            if move_on(w, substep, setting, keep.recording):
                _count_second(w, road, keep)
                if keep.census.on:
                    count_travel(w, keep.counts)
                return OVER
        state.substep = 0
        _count_second(w, road, keep)


@shared_kernel
def advance(w: World, setting: Setting, s: Scratch, keep: Keep, until: int) -> int:
    """Move a world on until its test is over, a program outside must answer, or `until` seconds of it have passed.

    When a test ends within a second, vehicles that nothing can touch or see stand where the second began;
    `step.bring_up_to_date` moves them to the end.

    Args:
        w: The world, put at the start of a test (`traffic.reset_world`) or left by an earlier call.
        setting: What is constant in the run.
        s: Scratch.
        keep: Records to fill.
        until: Seconds since the start of the test; NEVER for no milestone.

    Returns:
        OVER, AV_MUST_ANSWER, BV_MUST_ANSWER or MILESTONE.
    """
    return linked_advance(w, setting, s, keep, until)
