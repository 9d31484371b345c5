"""Search for aggressive cut-ins and lane conflicts that a bounded adversary could make, and what they would cost it.

    .venv/bin/python benchmarks/cut_ins.py --odd default --tests 500

In each test natural drivers have the road until the adversary begins to steer. From there all plans are driven in which
the BV nearest to the AV takes one acceleration, or the likeliest action, for 0 to 3 s, changes lanes towards the AV,
takes one acceleration for some seconds, and then the likeliest action until 7 s after the begin of the change. Where
the mask forbids an acceleration, the nearest that it allows is taken. The cheapest plan of each kind of crash counts,
in nats of shortfall and of excess; a plan ends where another BV becomes the nearest one.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from cornerforge.adversary.worlds.rewards import av_strikes
from cornerforge.experiment.setting import experiment
from cornerforge.sim import (
    OVER,
    World,
    advance,
    allocate_scratch,
    allocate_worlds,
    answer_as_bv,
    controllers,
    copy_of,
    keep_nothing,
    look_as_bv,
    observe,
    outcome,
    reset_world,
    world_of,
)
from cornerforge.types import ACTION_ACCELERATIONS, ACTION_LEFT, ACTION_RIGHT, FIRST_ACCELERATION
from cornerforge.world_options import BUDGETS

LIKELIEST = math.nan
APPROACHES = (LIKELIEST, -2.0, -1.0, 1.0, 2.0)
AFTER = ((LIKELIEST, 0), (-4.0, 1), (-4.0, 2), (-4.0, 6), (-2.0, 1), (-2.0, 3), (-1.0, 3), (1.0, 2))
WAITS, LEAST_S = 3, 6
BUDGETS_SHOWN = (8.0, 10.0, 12.0, 15.0, 20.0, 30.0, math.inf)
KINDS = ("cut-in", "conflict", "other")
_RICH = 1_000.0


@dataclass
class Search:
    """Drives plans from one moment of a test, and keeps the least costs of each kind of crash."""

    odd: str
    av: str

    def __post_init__(self) -> None:
        run = experiment(odd=self.odd, av=self.av, bv="uniform", budget=_RICH)
        self.setting = run.setting.with_drivers(critical=controllers.TOLD)
        self.scratch, self.keep = allocate_scratch(run.slots, run.setting.who.policy), keep_nothing(run.slots)
        self.start = world_of(allocate_worlds(1, run.slots))
        self.seen, self.allowed = np.zeros(observe.N_OBSERVATION, np.float32), np.zeros(33, np.bool_)
        self.least: dict[str, dict[str, float]] = {}

    def search(self, seed: int, test: int) -> dict[str, dict[str, float]]:
        """Return the least shortfall and excess of each kind of crash; what no plan reaches is left out."""
        self.least = {}
        w = self.start
        reset_world(w, seed, test, self.setting)
        first = int(w.state["steers_from"][0])
        if advance(w, self.setting, self.scratch, self.keep, first) == OVER or self._look(w) < 0:
            return {}
        bv = int(w.state["controlled"][0])
        for approach in APPROACHES:
            world, spent = copy_of(w), _Spent()
            for wait in range(WAITS + 1):
                if (math.isnan(approach) or wait > 0) and self._look(world) == bv:
                    self._change(world, spent, bv)
                if not self._go(world, spent, bv, self._nearest(approach)):
                    break
        return self.least

    def _change(self, before: World, spent: _Spent, bv: int) -> None:
        v = before.vehicles
        lanes = int(v["target_lane"][0] - v["target_lane"][bv])
        if lanes == 0:
            return
        side = ACTION_LEFT if lanes > 0 else ACTION_RIGHT
        if not self.allowed[side]:
            return
        changing, paid = copy_of(before), spent.copy()
        if not self._go(changing, paid, bv, side):
            self._note(changing, paid, bv)
            return
        for after, seconds in AFTER:
            world, own = copy_of(changing), paid.copy()
            for second in range(LEAST_S):
                wish = after if second < seconds else LIKELIEST
                if self._look(world) != bv or not self._go(world, own, bv, self._nearest(wish)):
                    break
            self._note(world, own, bv)

    def _look(self, world: World) -> int:
        if world.state["outcome"][0] != outcome.RUNNING:
            return -1
        return int(look_as_bv(world, self.setting, self.scratch, self.seen, self.allowed))

    def _nearest(self, acceleration: float) -> int:
        """Find the allowed action nearest to an acceleration [m/s2], LIKELIEST or where there is none the likeliest."""
        if math.isnan(acceleration) or not self.allowed[FIRST_ACCELERATION:].any():
            return int(np.where(self.allowed, self.scratch.choice.p, -1.0).argmax())
        away = np.abs(ACTION_ACCELERATIONS[FIRST_ACCELERATION:] - acceleration)
        return FIRST_ACCELERATION + int(np.where(self.allowed[FIRST_ACCELERATION:], away, np.inf).argmin())

    def _go(self, world: World, spent: _Spent, bv: int, action: int) -> bool:
        """Drive a second with an action of the BV; False: the test is over, or another BV is the nearest."""
        if self._look(world) != bv:
            return False
        if not self.allowed[action]:
            action = self._nearest(LIKELIEST)
        p = self.scratch.choice.p
        spent.add(p / p.sum(), action)
        answer_as_bv(world, action)
        until = int(world.state["decisions"][0]) + 1
        return bool(advance(world, self.setting, self.scratch, self.keep, until) != OVER)

    def _note(self, world: World, spent: _Spent, bv: int) -> None:
        state = world.state[0]
        if state["outcome"] != outcome.AV_CRASH or state["slot_b"] != bv:
            return
        v = world.vehicles
        kind = "other"
        if v["duration"][0] > 0.0 and v["duration"][bv] > 0.0:
            kind = "conflict"
        elif v["duration"][0] == 0.0 and v["x"][bv] > v["x"][0] and av_strikes(v, 0, bv, True):
            kind = "cut-in"
        known = self.least.setdefault(kind, dict.fromkeys(BUDGETS, math.inf))
        for name, nats in zip(BUDGETS, (spent.shortfall, spent.excess), strict=True):
            known[name] = min(known[name], nats)


@dataclass
class _Spent:
    shortfall: float = 0.0
    excess: float = 0.0
    stretch: float = 0.0

    def copy(self) -> _Spent:
        return _Spent(self.shortfall, self.excess, self.stretch)

    def add(self, p: np.ndarray, action: int) -> None:
        some = p[p > 0.0]
        self.shortfall += float(np.log(p.max()) - np.log(p[action]))
        self.stretch = max(0.0, self.stretch + float((some * np.log(some)).sum() - np.log(p[action])))
        self.excess = max(self.excess, self.stretch)


def main() -> None:
    parser = argparse.ArgumentParser(description="Search for aggressive cut-ins and lane conflicts within a budget.")
    parser.add_argument("--odd", default="default")
    parser.add_argument("--av", default="idm-mobil", help="a built-in AV")
    parser.add_argument("--tests", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    search = Search(given.odd, given.av)
    found = [search.search(given.seed, test) for test in range(given.tests)]
    print(f"{given.tests} tests of seed {given.seed}, {given.av}, ODD {given.odd}: tests in which a plan exists within")
    print("| kind | of | " + " | ".join(f"{nats:g} nats" for nats in BUDGETS_SHOWN) + " |")
    print("| --- | --- |" + " ---: |" * len(BUDGETS_SHOWN))
    for kind in KINDS:
        for name in BUDGETS:
            least = np.array([one[kind][name] if kind in one else np.nan for one in found])
            counts = " | ".join(str(int((least <= nats).sum())) for nats in BUDGETS_SHOWN)
            print(f"| {kind} | {name} | {counts} |")


if __name__ == "__main__":
    main()
