"""The chance to change lanes among drivers that mind each other: a sum over everything that all of them may do."""

from __future__ import annotations

from reference.simulator import Simulator
from reference.world import SIGHT, Vehicle, World

__all__ = ["change_chances"]

Starts = dict[Vehicle, int]


def _goes(simulator: Simulator, world: World, driver: Vehicle, lane: int, starts: Starts, conflict: float) -> float:
    """P(a driver that wants into a lane goes) where these others, all ahead of it, start into these lanes."""
    least = 1.0
    for other, goal in starts.items():
        if goal == lane and other.x - driver.x < SIGHT:
            gap, rate = world.gap(other, driver), other.speed - driver.speed
            least = min(least, simulator.tables.accepts(gap, rate, rear=False, overlook=0.0))
    return conflict + (1.0 - conflict) * least


def change_chances(
    simulator: Simulator, world: World, subject: Vehicle, *, attentive: bool, av_lane: int
) -> tuple[float, float]:
    """P(left), P(right) of a BV: a sum over all that those ahead of it may want and over who of them waits.

    Nothing is left out or put together: k drivers that may want to both sides are 5^k cases. The AV has chosen.
    """
    model = simulator.model
    front_to_rear = [v for v in reversed(world.from_rear_to_front()) if (v.x, v.slot) >= (subject.x, subject.slot)]

    def outcomes(place: int, starts: Starts, chance: float) -> tuple[float, float]:
        driver = front_to_rear[place]
        is_subject = driver is subject
        overlook = 0.0 if attentive and is_subject else model.overlook
        conflict = 0.0 if attentive and is_subject else model.overlook_conflict
        if driver is world.av:
            goals = {av_lane: 1.0} if av_lane != driver.target_lane else {}
        else:
            looks = 1.0 if attentive and is_subject else 1.0 - simulator.chance_to_look_away(driver)
            left, right = (looks * chance for chance in simulator.side_chances(world, driver, overlook))
            goals = {driver.target_lane + 1: left, driver.target_lane - 1: right}
            if driver.path is None:
                goals = {
                    lane: wants * _goes(simulator, world, driver, lane, starts, conflict)
                    for lane, wants in goals.items()
                }
        if is_subject:
            return chance * goals[subject.target_lane + 1], chance * goals[subject.target_lane - 1]
        total = [0.0, 0.0]
        stays = 1.0 - sum(goals.values())
        for after, share in [(starts, stays), *(({**starts, driver: lane}, goals[lane]) for lane in goals)]:
            if share > 0.0:
                left, right = outcomes(place + 1, after, chance * share)
                total[0] += left
                total[1] += right
        return total[0], total[1]

    return outcomes(0, {}, 1.0)
