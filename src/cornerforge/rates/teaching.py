"""Teach a network how dangerous a BV near the AV is, from trees of tests: what was seen, and which crashes followed.

What is dangerous is nearly the same for all AVs. So it was taught at length, once, with the built-in AVs (`make
danger`), and lies beside this file; here it is adjusted to the AV at hand: in tests in which acts near the AV are
followed by chance, for dangers that no other AV has, and then in trees that branch by what is known so far, where the
danger is. What the network says decides how fast a rate is found, never which (`rates.branching`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checksums import read_arrays
from cornerforge.errors import MissingExtraError
from cornerforge.ndd.model import model_hash
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
from cornerforge.types import Odd

try:
    import torch
except ImportError as error:
    raise MissingExtraError("torch", "learn") from error

if TYPE_CHECKING:
    from cornerforge.experiment.experiments import Experiment

__all__ = [
    "TEACHING_TREES", "DangerLearner", "Taught", "blind_plan", "level_of", "own_bias", "plan_of", "shipped_network",
    "teach", "tilted_plan_of",
]  # fmt: skip

Floats = NDArray[np.float64]

_EXPLORING = 16_000
_ROUNDS = (32_000, 64_000)
TEACHING_TREES = _EXPLORING + sum(_ROUNDS)
"""Number of trees that are driven to teach a network."""
_SHIPPED = Path(__file__).with_name("danger.npz")
_WIDE = 3.0
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
    """Make the plan by which trees branch with a network; `level`: mean danger at the start of a test.

    They are wide: weight times danger should be some times the mean danger. Heavy kinds of crash show per tree, not per
    branch, so many cheap trees tell more than few dear ones.
    """
    target = _WIDE * level
    return Plan(target, _FLOOR * target, _LEAST_RISE, explore, 1, _FORGET, _LOOK_AHEAD_S, network)


def blind_plan() -> Plan:
    """Make the plan of trees that know nothing: acts near the AV are followed by chance."""
    return Plan(1.0, _NOTHING, -1.0, _EXPLORE, 0, _FORGET, 0.0, danger.untaught(_NOTHING))


def tilted_plan_of(network: danger.Network, level: float) -> Plan:
    """Make the plan by which tests are drawn from proposals with a network, instead of copied; `level`: mean danger."""
    tilt = Tilt(np.array(_SHARES), np.array(_POWERS), _CANDIDATES)
    return plan_of(network, level)._replace(floor=_FLOOR * level, tilt=tilt)


def level_of(network: danger.Network, setting: Setting, slots: int, seed: int, threads: int) -> tuple[float, float]:
    """Estimate the mean danger at the start of a test; returns it and the CPU seconds it took."""
    nothing = plan_of(network, 1e30)._replace(floor=0.0)  # no tree is driven, so an AV from outside is not asked
    pilot = drive_trees(
        setting.with_drivers(av=controllers.BUILT_IN), slots, nothing, seed=seed, first=0, tests=_PILOT, threads=threads
    )
    return max(_LEAST_LEVEL, float(pilot.trees["danger"].mean())), pilot.cpu_seconds


def own_bias(run: Experiment) -> str | None:
    """Name the array of the shipped file that would hold what the run's AV has of its own; None: its road is another.

    The number of lanes does not matter: a network looks at the AV's lane and those beside it.
    """
    if replace(run.odd, n_lanes=Odd().n_lanes) != Odd():
        return None
    return f"first_bias of {run.av_hash} with {model_hash(run.model)}"


def shipped_network(own: str | None = None) -> tuple[danger.Network, bool]:
    """Read the network that was taught at length: of a mean AV, or of the one that `own_bias` names.

    Returns:
        The network, and whether it is the AV's own.

    Raises:
        FileFormatError: Its file is damaged.
    """
    arrays = read_arrays(_SHIPPED, "network of dangers")
    network = danger.Network(**{name: arrays[name] for name in danger.Network._fields})
    if own is None or own not in arrays:
        return network, False
    return network._replace(first_bias=arrays[own]), True


def teach(
    setting: Setting,
    slots: int,
    *,
    seed: int,
    threads: int,
    own: str | None = None,
    driver: TreeDriver = BUILT_IN_TREES,
    tell: Callable[[str, DrivenTrees], None] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Taught:
    """Adjust the network to an AV and its world, in about 100 s of CPU time; with one of its own there is no need.

    Args:
        setting, slots: The run, natural.
        seed: Seed of the trees and of the order of learning.
        threads: Pool size; does not change the result.
        own: As `own_bias` names what the AV has of its own; it is not taught then.
        driver: As of `drive_trees`.
        tell: Called with name and trees of each round.
        progress: Called with the number of driven trees of `TEACHING_TREES`.
    """
    network, is_own = shipped_network(own)
    learner, tables = DangerLearner(seed, network), list[tuple[int, TrainingTable]]()
    begun, cpu = 0, 0.0
    plan, name = blind_plan(), "explore"
    level, spent = level_of(network, setting, slots, seed, threads)
    for tests in () if is_own else (_EXPLORING, *_ROUNDS):
        driven = drive_trees(
            setting, slots, plan, seed=seed, first=begun, tests=tests, threads=threads, learning=True, driver=driver,
            progress=None if progress is None else partial(_told_from, progress, begun),
        )  # fmt: skip
        if tell is not None:
            tell(name, driven)
        assert driven.training is not None
        tables.append((0, driven.training))
        begun += tests
        cpu += spent + driven.cpu_seconds + learner.learn(tables, steps=_STEPS)
        network = learner.network()
        level, spent = level_of(network, setting, slots, seed, threads)
        plan, name = plan_of(network, level), f"level {level:.2g}"
    return Taught(network, level, begun, cpu + spent)


def _told_from(progress: Callable[[int], None], begun: int, done: int) -> None:
    """Tell how many trees are driven in all rounds, from how many are in this one."""
    progress(begun + done)


class DangerLearner:
    """A network that learns, for one AV or for several at once, which then share all but a bias of the first layer.

    Args:
        seed: Seed of its first weights and of the order of learning.
        known: The network that it begins with; None: random weights.
        avs: How many AVs there are.
    """

    def __init__(self, seed: int, known: danger.Network | None = None, avs: int = 1) -> None:
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            width = danger.WIDTH
            self._first, self._second, self._last = (
                torch.nn.Linear(danger.N_SEEN, width),
                torch.nn.Linear(width, width),
                torch.nn.Linear(width, 1),
            )
        self._own = torch.zeros(avs, danger.WIDTH, requires_grad=True)
        with torch.no_grad():
            self._last.bias.fill_(-14.0)
            if known is not None:
                for layer, matrix, bias in (
                    (self._first, known.first, known.first_bias),
                    (self._second, known.second, known.second_bias),
                    (self._last, known.last[:-1, None], known.last[-1:]),
                ):
                    layer.weight.copy_(torch.from_numpy(matrix.T.copy()))
                    layer.bias.copy_(torch.from_numpy(bias.copy()))
        self._rng = np.random.Generator(np.random.Philox(seed))

    def network(self, av: int | None = 0) -> danger.Network:
        """Give the network of an AV as kernels take it; None: of a mean AV."""
        with torch.no_grad():
            own = (self._own.mean(0) if av is None else self._own[av]) + self._first.bias
            first, second, row = (layer.weight.numpy().T.copy() for layer in (self._first, self._second, self._last))
            last = np.concatenate([row[:, 0], self._last.bias.numpy()])
            return danger.Network(first, own.numpy().copy(), second, self._second.bias.numpy().copy(), last)

    def learn(self, tables: Sequence[tuple[int, TrainingTable]], *, steps: int) -> float:
        """Learn from samples of AVs, each table with the AV's number, in so many steps; returns CPU seconds."""
        begun = time.process_time()
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            picked = [self._picked(av, table) for av, table in tables]
            seen, followed, weight = (np.concatenate(parts) for parts in zip(*picked, strict=True))
            av = np.repeat([av for av, _ in tables], [len(one[0]) for one in picked])
            self._fit(seen, av, followed, weight, steps)
        finally:
            torch.set_num_threads(threads)
        return time.process_time() - begun

    def _log_danger(self, seen: torch.Tensor, av: torch.Tensor) -> torch.Tensor:
        first = torch.relu(self._first(seen) + self._own.index_select(0, av))
        log: torch.Tensor = self._last(torch.relu(self._second(first)))[:, 0].clamp(*_LOG_LIMITS)
        return log

    def _danger(self, seen: NDArray[np.float32], av: int) -> Floats:
        with torch.no_grad():
            parts = np.array_split(seen, max(1, len(seen) // 200_000))
            logs = [self._log_danger(torch.from_numpy(part), torch.full((len(part),), av)) for part in parts]
            return torch.exp(torch.cat(logs)).numpy().astype(np.float64)

    def _picked(self, av: int, table: TrainingTable) -> tuple[NDArray[np.float32], Floats, Floats]:
        """Pick samples, mostly dangerous ones; returns what was seen, what followed, and the weight of each."""
        followed = np.minimum(table.followed, _MOST_FOLLOWED)
        score = np.sqrt(np.maximum(followed, self._danger(table.seen, av))) + 1e-4
        chance = np.minimum(1.0, score / np.quantile(score, 0.99) + _DULL)
        _, family = np.unique(table.test, return_inverse=True)
        share = np.minimum(1.0, _SAMPLES_OF_ONE_TREE / np.bincount(family, weights=chance))[family]
        picked = self._rng.random(followed.size) < chance * share
        return table.seen[picked], followed[picked], (table.weight / chance)[picked]

    def _fit(
        self, seen: NDArray[np.float32], av: NDArray[np.int64], followed: Floats, weight: Floats, steps: int
    ) -> None:
        """Regress what followed on what was seen: Poisson deviance over the danger to a power below 1.

        That lies between absolute errors, in which only great dangers count, and relative ones, which are mostly
        scatter.
        """
        taught = [self._own, *(p for layer in (self._first, self._second, self._last) for p in layer.parameters())]
        optimiser = torch.optim.Adam(taught, lr=_FASTEST)
        pace = torch.optim.lr_scheduler.OneCycleLR(optimiser, _FASTEST, total_steps=steps + 1)
        x, who, y = torch.from_numpy(seen), torch.from_numpy(av), torch.from_numpy(followed.astype(np.float32))
        w = torch.from_numpy((weight / weight.mean()).astype(np.float32))
        for _ in range(steps):
            batch = torch.from_numpy(self._rng.integers(0, len(y), _BATCH))
            log = self._log_danger(x.index_select(0, batch), who.index_select(0, batch))
            mean = torch.exp(log)
            loss: Any = (
                w.index_select(0, batch)
                * (mean - y.index_select(0, batch) * log)
                / (mean.detach() + _NOTHING) ** _POWER
            ).mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(taught, 5.0)
            optimiser.step()
            pace.step()
