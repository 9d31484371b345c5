"""Importance sampling of a test: its start, and what happens in each second, are drawn from proposals, and weighted.

A *proposal* draws a branch of a second (`branches`) by its chance times its danger to some power, and the start among
candidates that nature drew. A test belongs to one proposal, but its weight comes from their mixture: 1 over the mean of
all proposals' densities of what happened, over the natural one (Owen and Zhou 2000, "Safe and effective importance
sampling"; the balance heuristic of Veach and Guibas 1995). One proposal is nature itself, so no weight is larger than 1
over its share, and every natural outcome remains possible, for any estimate of the danger.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._elementary import exp, log
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.rates.branching.branches import hold_to_branch, hold_to_no_act, list_branches
from cornerforge.rates.branching.population import draw, survey_world, value_of, wait
from cornerforge.sim import reset_world, world_row

if TYPE_CHECKING:
    from cornerforge.rates.branching.population import Plan, Pool, Population

__all__ = ["draw_branch", "draw_start"]


@inlined_kernel
def _power(danger: float, power: float, plan: Plan) -> float:
    """Raise a danger, at least the plan's floor, to a power."""
    return exp(power * log(max(danger, plan.floor)))


@inlined_kernel
def _weigh(row: int, plan: Plan, pool: Pool) -> None:
    """Give a row the weight of what has happened to it."""
    density = 0.0
    for c in range(plan.tilt.shares.size):
        density += plan.tilt.shares[c] * pool.ratio[row, c]
    pool.weight[row] = 1.0 / density


@kernel
def draw_start(seed: int, test: int, row: int, population: Population) -> None:
    """Draw a test's proposal, and by it one of the candidates for its start; put the row there."""
    plan, setting, pool = population.plan, population.setting, population.pool
    tilt = plan.tilt
    w = world_row(pool.worlds, row)
    first = test * tilt.candidates
    reset_world(w, seed, first, setting)
    u = draw(row, pool)
    proposal = 0
    while proposal < tilt.shares.size - 1 and u >= tilt.shares[proposal]:
        u -= tilt.shares[proposal]
        proposal += 1
    pool.proposal[row] = proposal
    ratio = pool.ratio[row]
    ratio[:] = 0.0
    chosen = 0
    danger = 1.0
    for k in range(tilt.candidates):  # candidate k takes the place of the one chosen so far by its share of the sum
        if k > 0:
            reset_world(w, seed, first + k, setting)
        total, _ = survey_world(w, population)
        value = value_of(total, population)
        for c in range(tilt.shares.size):
            ratio[c] += _power(value, tilt.powers[c], plan)
        if draw(row, pool) * ratio[proposal] < _power(value, tilt.powers[proposal], plan):
            chosen = k
            danger = value
    if chosen != tilt.candidates - 1:
        reset_world(w, seed, first + chosen, setting)
    for c in range(tilt.shares.size):
        ratio[c] = _power(danger, tilt.powers[c], plan) * tilt.candidates / ratio[c]
    _weigh(row, plan, pool)


@kernel
def draw_branch(row: int, total: float, population: Population) -> None:
    """Draw what happens to a surveyed row in its next second, by its proposal; hold it to that and let it wait.

    `total`: the danger if nothing more is known.
    """
    plan, pool = population.plan, population.pool
    tilt, branches, ratio = plan.tilt, pool.branches, pool.ratio[row]
    held = wait(row, pool)
    list_branches(1.0, pool.survey, branches)
    n = branches.n[0]
    if n == 0:
        return
    proposal = pool.proposal[row]
    own = tilt.powers[proposal]
    left = branches.rest[0] * _power(total, own, plan)
    for k in range(n):
        branch = branches.listed[k]
        left += branch.chance * _power(branch.danger, own, plan)
    left *= draw(row, pool)
    chosen = 0
    while chosen < n:
        branch = branches.listed[chosen]
        left -= branch.chance * _power(branch.danger, own, plan)
        if left < 0.0:
            break
        chosen += 1
    danger = total if chosen == n else branches.listed[chosen].danger
    for c in range(tilt.shares.size):
        whole = branches.rest[0] * _power(total, tilt.powers[c], plan)
        for k in range(n):
            branch = branches.listed[k]
            whole += branch.chance * _power(branch.danger, tilt.powers[c], plan)
        ratio[c] *= _power(danger, tilt.powers[c], plan) / whole
    _weigh(row, plan, pool)
    if chosen == n:
        hold_to_no_act(held, pool.survey)
    else:
        branch = branches.listed[chosen]
        hold_to_branch(branch.first, branch.second, held, pool.survey)
