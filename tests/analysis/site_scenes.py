"""Crashes at a site that are put together by hand: agents that move along routes, up to the first touch of the AV."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cornerforge.experiment.sites import odd_at, site_named
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.road.straight import road_numbers
from cornerforge.site.laws import Demand, Laws
from cornerforge.site.signals import first_clock
from cornerforge.site.tables import pose_at
from cornerforge.types import CAR, CLASSES, FRAME_S, PERSON, Crash, Odd, Scenario

LONGEST_S = 12.0


def odd_of(site: str) -> Odd:
    """The ODD of a site that ships."""
    return odd_at(Odd(), site_named(site), Laws(), Demand())


@dataclass(frozen=True)
class Agent:
    """An agent: its route, and its place along it [m] as a function of the time [s]."""

    route: int
    place: Callable[[float], float]
    kind: int = CAR


def steady(route: int, at: float, when: float, speed: float, kind: int = CAR) -> Agent:
    """An agent at a steady speed, at a place at a moment; a person waits at the kerb until it goes."""
    return Agent(route, lambda t: max(at + speed * (t - when), 0.0 if kind == PERSON else -1e9), kind)


def name_at(odd: Odd, clock: float) -> int:
    """A number of a test at which begin the signals are within 0.5 s of a time of their programme."""
    assert odd.site is not None
    return next(
        n
        for n in range(5000)
        if abs(first_clock(sum(phase.seconds for phase in odd.site.programme), 0, n) - clock) < 0.5
    )


def scene(odd: Odd, agents: Sequence[Agent], test: int = 0) -> Scenario:
    """Record the agents, the AV first, until it touches one."""
    site = road_numbers(odd).site
    frames = round(LONGEST_S / FRAME_S)
    n = len(agents)
    sizes = np.array([odd.size_of(one.kind) if one.kind != PERSON else (
        CLASSES[PERSON].length, CLASSES[PERSON].width) for one in agents])  # fmt: skip
    s = np.array([[one.place(t * FRAME_S) for one in agents] for t in range(frames)])
    pose = np.array([[pose_at(site, one.route, s[t, k]) for k, one in enumerate(agents)] for t in range(frames)])
    last, partner = next(
        (t, k)
        for t in range(frames)
        for k in range(1, n)
        if boxes_overlap(Box(*pose[t, 0], *sizes[0]), Box(*pose[t, k], *sizes[k]))
    )
    speed = np.gradient(s, FRAME_S, axis=0)
    kept = slice(0, last + 1)
    decisions = -(-last // 10)
    return Scenario(
        seed=0, test=test, odd=odd, slot=np.arange(n, dtype=np.int16),
        x=pose[kept, :, 0], y=pose[kept, :, 1], heading=pose[kept, :, 2], speed=speed[kept],
        acceleration=np.gradient(speed, FRAME_S, axis=0)[kept],
        target_lane=np.tile(np.array([one.route for one in agents], np.int8), (last + 1, 1)),
        present=np.ones((last + 1, n), np.bool_), action=np.full((decisions, n), -1, np.int8),
        critical_bv=np.full(decisions, -1, np.int16), log_prob_nde=np.zeros(decisions),
        crash=Crash(last * FRAME_S, 0, partner), kind=np.array([one.kind for one in agents], np.int8),
        length=sizes[:, 0].copy(), width=sizes[:, 1].copy(),
    )  # fmt: skip


def middle(odd: Odd, own: int, other: int) -> tuple[float, float]:
    """Where two routes meet first, along each: the middles of the zone [m]."""
    zone = road_numbers(odd).site[0]["zone"][own, other, 0]
    return 0.5 * float(zone["begin"] + zone["end"]), 0.5 * float(zone["other_begin"] + zone["other_end"])


def meeting(
    odd: Odd, own: int, other: int, speeds: tuple[float, float], kind: int = CAR, when: float = 5.0
) -> list[Agent]:
    """AV and another at steady speeds, both in the middle of their zone at a moment."""
    here, there = middle(odd, own, other)
    return [steady(own, here, when, speeds[0]), steady(other, there, when, speeds[1], kind)]
