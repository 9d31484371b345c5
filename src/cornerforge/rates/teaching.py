"""Teach a network how dangerous a BV near the AV is, from trees of tests: what was seen, and which crashes followed.

What is dangerous is nearly the same for all AVs. So it was taught at length, once, with the built-in AVs (`make
danger`), and lies beside this file; here it is adjusted to the AV at hand: in tests in which acts near the AV are
followed by chance, for dangers that no other AV has, and then in trees that branch by what is known so far, where the
danger is. What the network says decides how fast a rate is found, never which (`rates.branching`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge._checksums import read_arrays
from cornerforge.errors import MissingExtraError
from cornerforge.rates.branching import (
    BUILT_IN_TREES,
    DrivenTrees,
    Plan,
    Tilt,
    TrainingTable,
    TreeDriver,
    danger,
    drive_trees,
)
from cornerforge.sim import Setting, controllers

try:
    import torch
except ImportError as error:
    raise MissingExtraError("torch", "learn") from error

__all__ = [
    "TEACHING_TREES",
    "DangerLearner",
    "Taught",
    "blind_plan",
    "level_of",
    "plan_of",
    "shipped_network",
    "teach",
    "tilted_plan_of",
    "wide_plan_of",
]

Floats = NDArray[np.float64]

_EXPLORING = 16_000
_ROUNDS = (32_000, 64_000)
TEACHING_TREES = _EXPLORING + sum(_ROUNDS)
"""Number of trees that are driven to teach a network."""
_SHIPPED = Path(__file__).with_name("danger.npz")
_LEVEL = 3.0
_EXPLORE, _EXPLORE_LATER = 0.1, 0.05
_FLOOR = 0.1
_LEAST_RISE = 0.1
_FORGET = 10.0
_LOOK_AHEAD_S = 2.0
_SHARES, _POWERS, _CANDIDATES = (0.1, 0.5, 0.4), (0.0, 1.0, 1.6), 3
"""Proposals of a tilt: nature; by the danger; more than by the danger, because unlisted acts change it too."""
_PILOT = 4_000
_STEPS = 4_000
_NOTHING = 1e-9
_LEAST_LEVEL = 1e-15
_BATCH, _FASTEST, _POWER = 2048, 3e-3, 0.8
_LOG_LIMITS = (-30.0, 0.0)
_MOST_FOLLOWED = 2.0
_SAMPLES_OF_ONE_TREE = 800.0
_DULL = 0.3


@dataclass(frozen=True)
class Taught:
    """Result of teaching.

    Attributes:
        network: The danger.
        level: Mean danger at the start of a test; about the crash rate, if the network is right.
        tests: Trees driven.
        cpu_seconds: Processor time of driving and learning.
    """

    network: danger.Network
    level: float
    tests: int
    cpu_seconds: float


def plan_of(network: danger.Network, level: float, explore: float = _EXPLORE_LATER) -> Plan:
    """Make the plan by which trees branch with a network; `level`: what weight times danger should be."""
    return Plan(level, _FLOOR * level, _LEAST_RISE, explore, 1, _FORGET, _LOOK_AHEAD_S, network)


def blind_plan() -> Plan:
    """Make the plan of trees that know nothing: acts near the AV are followed by chance."""
    return Plan(1.0, _NOTHING, -1.0, _EXPLORE, 0, _FORGET, 0.0, danger.untaught(_NOTHING))


def wide_plan_of(network: danger.Network, level: float) -> Plan:
    """Make the plan of trees to teach with: many cheap ones teach more than few dear ones."""
    return plan_of(network, _LEVEL * level)


def tilted_plan_of(network: danger.Network, level: float) -> Plan:
    """Make the plan by which tests are drawn from proposals with a network, instead of copied; `level`: mean danger."""
    return plan_of(network, level)._replace(tilt=Tilt(np.array(_SHARES), np.array(_POWERS), _CANDIDATES))


def level_of(network: danger.Network, setting: Setting, slots: int, seed: int, threads: int) -> tuple[float, float]:
    """Estimate the mean danger at the start of a test; returns it and the CPU seconds it took."""
    nothing = plan_of(network, 1e30)._replace(floor=0.0)  # no tree is driven, so an AV from outside is not asked
    pilot = drive_trees(
        setting.with_drivers(av=controllers.BUILT_IN), slots, nothing, seed=seed, first=0, tests=_PILOT, threads=threads
    )
    return max(_LEAST_LEVEL, float(pilot.trees["danger"].mean())), pilot.cpu_seconds


def shipped_network() -> danger.Network:
    """Read the network that was taught at length.

    Raises:
        FileFormatError: Its file is damaged.
    """
    arrays = read_arrays(_SHIPPED, "network of dangers")
    return danger.Network(**{name: arrays[name] for name in danger.Network._fields})


def teach(
    setting: Setting,
    slots: int,
    *,
    seed: int,
    threads: int,
    driver: TreeDriver = BUILT_IN_TREES,
    tell: Callable[[str, DrivenTrees], None] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Taught:
    """Adjust the network to an AV and its world, in about 100 s of CPU time; at a site it begins with none.

    Args:
        setting, slots: The run, natural.
        seed: Seed of the trees and of the order of learning.
        threads: Pool size; does not change the result.
        driver: As of `drive_trees`.
        tell: Called with name and trees of each round.
        progress: Called with the number of driven trees of `TEACHING_TREES`.
    """
    tables: list[TrainingTable] = []
    begun, cpu = 0, 0.0
    learner = DangerLearner(seed, None if setting.road.site.size else shipped_network())
    plan, name = blind_plan(), "explore"
    for tests in (_EXPLORING, *_ROUNDS):
        driven = drive_trees(
            setting, slots, plan, seed=seed, first=begun, tests=tests, threads=threads, learning=True, driver=driver,
            progress=None if progress is None else partial(_told_from, progress, begun),
        )  # fmt: skip
        if tell is not None:
            tell(name, driven)
        assert driven.training is not None
        tables.append(driven.training)
        begun += tests
        cpu += driven.cpu_seconds + learner.learn(tables, steps=_STEPS)
        network = learner.network()
        level, spent = level_of(network, setting, slots, seed, threads)
        cpu += spent
        plan, name = wide_plan_of(network, level), f"level {level:.2g}"
    return Taught(network, level, begun, cpu)


def _told_from(progress: Callable[[int], None], begun: int, done: int) -> None:
    """Tell how many trees are driven in all rounds, from how many are in this one."""
    progress(begun + done)


class DangerLearner:
    """A network that learns.

    Args:
        seed: Seed of its first weights and of the order of learning.
        known: The network that it begins with; None: random weights.
    """

    def __init__(self, seed: int, known: danger.Network | None = None) -> None:
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            width = danger.WIDTH
            self._layers = [
                torch.nn.Linear(danger.N_SEEN, width),
                torch.nn.Linear(width, width),
                torch.nn.Linear(width, 1),
            ]
        with torch.no_grad():
            self._layers[-1].bias.fill_(-14.0)
        first, second, last = self._layers
        if known is not None:
            matrices, biases = (
                (known.first, known.second, known.last[:-1, None]),
                (known.first_bias, known.second_bias, known.last[-1:]),
            )
            with torch.no_grad():
                for layer, matrix, bias in zip(self._layers, matrices, biases, strict=True):
                    layer.weight.copy_(torch.from_numpy(matrix.T.copy()))
                    layer.bias.copy_(torch.from_numpy(bias.copy()))
        self._net = torch.nn.Sequential(first, torch.nn.ReLU(), second, torch.nn.ReLU(), last)
        self._rng = np.random.Generator(np.random.Philox(seed))

    def network(self) -> danger.Network:
        """Give the network as kernels take it."""
        first, second, last = self._layers
        with torch.no_grad():
            matrices = [np.ascontiguousarray(layer.weight.numpy().T, dtype=np.float32) for layer in (first, second)]
            biases = [layer.bias.numpy().copy() for layer in (first, second, last)]
            row = np.concatenate([last.weight.numpy()[0], biases[2]]).astype(np.float32)
        return danger.Network(matrices[0], biases[0], matrices[1], biases[1], row)

    def learn(self, tables: list[TrainingTable], *, steps: int) -> float:
        """Learn from samples in so many steps; returns CPU seconds."""
        begun = time.process_time()
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            seen, followed, weight = zip(*(self._picked(table) for table in tables), strict=True)
            self._fit(np.concatenate(seen), np.concatenate(followed), np.concatenate(weight), steps)
        finally:
            torch.set_num_threads(threads)
        return time.process_time() - begun

    def _danger(self, seen: NDArray[np.float32]) -> Floats:
        with torch.no_grad():
            parts = np.array_split(seen, max(1, len(seen) // 200_000))
            logs = [self._net(torch.from_numpy(part))[:, 0].clamp(*_LOG_LIMITS) for part in parts]
            return torch.exp(torch.cat(logs)).numpy().astype(np.float64)

    def _picked(self, table: TrainingTable) -> tuple[NDArray[np.float32], Floats, Floats]:
        """Pick samples, mostly dangerous ones; returns what was seen, what followed, and the weight of each."""
        followed = np.minimum(table.followed, _MOST_FOLLOWED)
        score = np.sqrt(np.maximum(followed, self._danger(table.seen))) + 1e-4
        chance = np.minimum(1.0, score / np.quantile(score, 0.99) + _DULL)
        _, family = np.unique(table.test, return_inverse=True)
        share = np.minimum(1.0, _SAMPLES_OF_ONE_TREE / np.bincount(family, weights=chance))[family]
        picked = self._rng.random(followed.size) < chance * share
        return table.seen[picked], followed[picked], (table.weight / chance)[picked]

    def _fit(self, seen: NDArray[np.float32], followed: Floats, weight: Floats, steps: int) -> None:
        """Regress what followed on what was seen: Poisson deviance over the danger to a power below 1.

        That lies between absolute errors, in which only great dangers count, and relative ones, which are mostly
        scatter.
        """
        optimiser = torch.optim.Adam(self._net.parameters(), lr=_FASTEST)
        pace = torch.optim.lr_scheduler.OneCycleLR(optimiser, _FASTEST, total_steps=steps + 1)
        x, y = torch.from_numpy(seen), torch.from_numpy(followed.astype(np.float32))
        w = torch.from_numpy((weight / weight.mean()).astype(np.float32))
        for _ in range(steps):
            batch = torch.from_numpy(self._rng.integers(0, len(y), _BATCH))
            log = self._net(x.index_select(0, batch))[:, 0].clamp(*_LOG_LIMITS)
            mean = torch.exp(log)
            loss = (
                w.index_select(0, batch)
                * (mean - y.index_select(0, batch) * log)
                / (mean.detach() + _NOTHING) ** _POWER
            ).mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self._net.parameters(), 5.0)
            optimiser.step()
            pace.step()
