"""All that may happen from a start, with its exact chance: a sum over every driver's choices in every second.

Nothing is drawn. It needs drivers whose choices are few, table rows with one or two accelerations, and who are alike:
without a noise level of their own, and without memory of accelerations (`Memory.near`, `far` and `habit` are 0). Then a
test of a few seconds has some thousand futures.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

from reference.philox import Stream
from reference.simulator import AV_CRASH, HOLD, TIME_UP, Simulator, _Test
from reference.world import Vehicle, World

__all__ = ["Futures", "futures_of"]

LEFT, RIGHT = 0, 1


@dataclass
class Futures:
    """What came of all futures.

    Attributes:
        crashes: Chance that the AV crashes, by the slot that it crashes with, and by whether the driver there looked
            away in the last second.
        total: Sum of the chances of all ends; 1 but for rounding.
        ends: How many there are.
    """

    crashes: dict[tuple[int, bool], float] = field(default_factory=dict)
    total: float = 0.0
    ends: int = 0

    @property
    def chance(self) -> float:
        """Chance that the AV crashes."""
        return sum(self.crashes.values())


@dataclass(frozen=True)
class _Choices:
    """What all BVs do in a second, and how likely that is: actions, and who looks away, by slot."""

    chance: float
    actions: dict[int, int]
    away: frozenset[int]


class _Second(_Test):
    """A test that is driven on by choices that are given, and keeps no record."""

    def record(self) -> None:
        """Keep nothing: only how it ends counts."""


def futures_of(simulator: Simulator, start: World) -> Futures:
    """Add up all futures of a world in which nobody has decided yet; natural driving, without an adversary."""
    memory = simulator.model.memory
    assert memory.near == memory.far == memory.habit == 0.0, "accelerations must not depend on earlier ones"
    assert all(bv.noise == 0.0 for bv in start.bvs())
    assert simulator.adversary is None
    found = Futures()
    _follow(simulator, start, 0, 1.0, found)
    return found


def _follow(simulator: Simulator, world: World, step: int, chance: float, found: Futures) -> None:
    wish = simulator.av_wish(world)
    for choices in _choices(simulator, world, wish[1]):
        copy = World(world.odd, [replace(vehicle) for vehicle in world.vehicles])
        test = _Second(simulator, Stream(0, 0), copy, step=step + 1)
        for bv in copy.bvs():
            bv.away = bv.slot in choices.away
            bv.act(choices.actions[bv.slot], simulator.odd)
        test.av_acts(wish)
        test.move_for_a_second()
        after = chance * choices.chance
        if not test.drive.outcome and test.step >= simulator.odd.time_limit:
            test.drive.outcome = TIME_UP
        if not test.drive.outcome:
            _follow(simulator, copy, step + 1, after, found)
            continue
        found.total += after
        found.ends += 1
        if test.drive.outcome == AV_CRASH:
            partner = copy.vehicles[test.drive.contact[1]]
            kind = partner.slot, partner.away
            found.crashes[kind] = found.crashes.get(kind, 0.0) + after


def _choices(simulator: Simulator, world: World, av_lane: int) -> Iterator[_Choices]:
    """List all that the BVs may do in the coming second; from the front to the rear, as they give way."""
    bvs = sorted(world.bvs(), key=lambda v: (-v.x, -v.slot))
    yield from _of_the_rest(simulator, world, bvs, {0: av_lane - world.av.target_lane}, _Choices(1.0, {}, frozenset()))


def _of_the_rest(
    simulator: Simulator, world: World, bvs: list[Vehicle], sides: dict[int, int], so_far: _Choices
) -> Iterator[_Choices]:
    """Choices of the BVs from one on, given those ahead of it; `sides`: to which side those begin a change."""
    if not bvs:
        yield so_far
        return
    bv = bvs[0]
    for share, action, away in _of_one(simulator, world, bv, sides):
        side = {LEFT: 1, RIGHT: -1}.get(action, 0)
        choices = _Choices(
            so_far.chance * share,
            {**so_far.actions, bv.slot: action},
            so_far.away | {bv.slot} if away else so_far.away,
        )
        yield from _of_the_rest(simulator, world, bvs[1:], {**sides, bv.slot: side}, choices)


def _of_one(simulator: Simulator, world: World, bv: Vehicle, sides: dict[int, int]) -> list[tuple[float, int, bool]]:
    """What one BV may do, given who ahead of it begins a change: (chance above 0, action, does it look away)."""
    away = simulator.chance_to_look_away(bv)
    looks = 1.0 - away
    found = [(away, HOLD, True)]
    keeps = 1.0
    for action, wants in enumerate(simulator.side_chances(world, bv, simulator.model.overlook)):
        goes = wants * _goes(simulator, world, bv, bv.target_lane + (1 if action == LEFT else -1), sides)
        keeps -= goes
        found.append((looks * goes, action, False))
    found += [(looks * keeps * share, 2 + index, False) for index, share in enumerate(_shares(simulator, world, bv))]
    return [choice for choice in found if choice[0] > 0.0]


def _shares(simulator: Simulator, world: World, bv: Vehicle) -> list[float]:
    """P(acceleration) of a BV that keeps its lane; of the rows behind several leads the smallest one, by one word."""
    limits = {1.0 - (rate - math.floor(rate)) for _, rate in simulator.states(world, bv)} | {0.0, 1.0}
    shares = [0.0] * 31
    for low, high in pairwise(sorted(limits)):
        rows = simulator.rows(world, bv, 0.5 * (low + high))
        sums = [max(values) for values in zip(*(row.cumulative for row in rows), strict=True)]
        for index, (below, up_to) in enumerate(pairwise([0.0, *sums])):
            shares[index] += (high - low) * (up_to - below) / sums[-1]
    return shares


def _goes(simulator: Simulator, world: World, bv: Vehicle, lane: int, sides: dict[int, int]) -> float:
    """P(a BV that wants into a lane does not wait for those ahead of it that start into the lane at this moment)."""
    if bv.path is not None:  # it turns back
        return 1.0
    rivals = [
        other
        for other in world.vehicles
        if other.present
        and sides.get(other.slot, 0)
        and other.target_lane + sides[other.slot] == lane
        and (other.x, other.slot) > (bv.x, bv.slot)
    ]
    least = min((simulator.chance_to_go_too(world, bv, other) for other in rivals), default=1.0)
    overlooks = simulator.model.overlook_conflict
    return overlooks + (1.0 - overlooks) * least
