"""`rate --method splitting` and `--method is`: a natural crash rate from weighted tests, kept block by block.

First a network is taught what is dangerous for this AV (`rates.teaching`), then tests branch into trees by it until
the interval is narrow enough (`rates.branching`), or tests are drawn from proposals by it; a test that is drawn so is a
tree of one branch, and all here is the same for both. The output folder holds `taught.npz` and `trees/`, one file for
each block of trees; at the end `weighted/` is made (again, if it exists), a library of crashes picked by weight: nearly
a sample of what happens.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checksums import read_arrays, write_arrays
from cornerforge.analysis.mechanism import crash_type_of, mechanism_of
from cornerforge.errors import FileFormatError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import code_hash, remove_folder, version
from cornerforge.intervals import poisson_interval, weighted_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.harvester import CaseRoom
from cornerforge.library.schema import SCRIPTED
from cornerforge.ndd.model import save_model
from cornerforge.rates.branching import BUILT_IN_TREES, ForeignTrees, Plan, TreeDriver, danger, drive_trees, tree_of
from cornerforge.rates.monte_carlo import MonteCarlo
from cornerforge.rates.weighted import (
    LEAST_EFFECTIVE,
    LEAST_TREES,
    WeightedRate,
    always_valid_interval,
    first_guess,
    plain_doubts,
    weighted_rate,
)
from cornerforge.results.driving import Cost, KindRate
from cornerforge.sim import Script
from cornerforge.work.progress import Progress

__all__ = ["ALL_CRASHES", "TREES", "PickedCrash", "Splitting", "kind_rates", "pick"]

TREES = 10_000
"""Trees between two saved states."""
ALL_CRASHES = "any kind"
_TEACH, _ESTIMATE, _PICK = range(3)
_MOST_CASES = 1000
_MOST_UNSEEN = 0.01
_SHARD_CASES = 500
_TESTS_AT_ONCE = 256
_BLOCK_FIELDS = {
    "weight": ("float64", 1), "crashes": ("int64", 0), "lost": ("int64", 0), "cpu_seconds": ("float64", 0),
    "seconds": ("float64", 0), "test": ("int64", 1), "begun": ("int64", 1), "actions": ("int8", 3),
    "answers": ("float64", 3), "asked": ("int64", 0), "strayed": ("int64", 0),
}  # fmt: skip
"""Type and number of axes of each array of a block."""
_MOST_WEIGHT = 1e9
"""A tree's weight has the mean of a chance; far from it, but not as far as this, roulette may take it."""


@dataclass(frozen=True)
class PickedCrash:
    """One crash of a tree, standing for others.

    Attributes:
        weight: For how much of the sum over all trees it stands; with the others' that sum.
        crash_type, mechanism: What it is.
    """

    weight: float
    crash_type: str
    mechanism: str


class Splitting:
    """A rate by trees of tests, driven and kept block by block: only the block in progress can be lost.

    Args:
        run: Natural traffic.
        seed: Seed from the user; teaching and trees have seeds of their own made from it.
        out: The output folder, or None.
        tilted: Tests are drawn from proposals instead of copied: importance sampling.
    """

    def __init__(
        self, run: Experiment, seed: int, out: Path | None, *, threads: int, progress: Progress, tilted: bool = False
    ) -> None:
        self._run, self._seed, self._out = run, seed, out
        self.tilted = tilted
        self._unit = "tests" if tilted else "trees"
        self._teacher = self._driver = _driver(run)
        if tilted:
            self._driver = _driver(run, places=_TESTS_AT_ONCE)
        self._threads, self._progress = threads, progress
        self._blocks: list[dict[str, Any]] = []
        self._judged: WeightedRate | None = None
        self._unseen = 0.0
        self._plan: Plan
        self._splitting_plan: Plan
        self.taught = Cost(tests=0, cpu_seconds=0.0)
        """Cost of teaching."""
        self._level = 0.0
        self._teaching_seconds = 0.0

    # Teaching and driving

    def start(self) -> None:
        """Teach a network, or continue with the content of the folder."""
        from cornerforge.rates.teaching import plan_of, tilted_plan_of  # needs the extra "learn"

        place = None if self._out is None else self._out / "taught.npz"
        network = self._read_taught(place) if place is not None and place.exists() else self._teach(place)
        self._splitting_plan = plan_of(network, self._level)
        self._plan = tilted_plan_of(network, self._level) if self.tilted else self._splitting_plan
        if self._out is not None:
            self._blocks = list(_read_blocks(self._out / "trees"))

    def _teach(self, place: Path | None) -> danger.Network:
        from cornerforge.rates.teaching import TEACHING_TREES, teach

        begun = time.perf_counter()
        rounds: list[NDArray[np.float64]] = []

        def tell(done: int) -> None:
            guess = first_guess(rounds) if rounds else 0.0
            about = f" (first guess: {guess:.1g})" if guess > 0.0 else ""
            self._progress(f"learn what is dangerous{about}", done, TEACHING_TREES)

        tell(0)  # the first trees know nothing and may take minutes
        taught = teach(
            self._run.setting,
            self._run.slots,
            seed=_independent(self._seed, _TEACH),
            threads=self._threads,
            driver=self._teacher,
            tell=lambda _, driven: rounds.append(driven.trees["weight"]),
            progress=tell,
        )
        self.taught = Cost(tests=taught.tests, cpu_seconds=taught.cpu_seconds)
        self._level, self._teaching_seconds = taught.level, time.perf_counter() - begun
        if place is not None:
            numbers = np.array([self._level, taught.tests, taught.cpu_seconds, self._teaching_seconds])
            write_arrays(place, {"numbers": numbers, **taught.network._asdict()})
        return taught.network

    def _read_taught(self, place: Path) -> danger.Network:
        found = _read(place, ("numbers", *danger.Network._fields))
        numbers, network = found.pop("numbers"), danger.Network(**found)
        like = danger.untaught(1.0)
        fits = all(a.shape == b.shape and a.dtype == b.dtype for a, b in zip(network, like, strict=True))
        finite = all(a.dtype.kind == "f" and np.isfinite(a).all() for a in (numbers, *network))
        if numbers.shape != (4,) or not fits or not finite:
            raise FileFormatError(
                f"{place} is damaged (other shapes or types, or not finite); remove it, or choose another place."
            )
        self._level, tests, cpu, self._teaching_seconds = (float(x) for x in numbers)
        self.taught = Cost(tests=int(tests), cpu_seconds=cpu)
        return network

    def drive(self, target: float, most: int) -> str:
        """Drive trees until the rate is exact enough and not in doubt ("target"), or there are `most` ("max_tests")."""
        while self.trees < most:
            if self.trees and self.is_enough(target):
                return "target"
            self._tell(target, most, 0)
            self._blocks.append(self._block(min(TREES, most - self.trees), target, most))
            if self._out is not None and self.trees % TREES == 0:
                place = self._out / "trees" / f"{len(self._blocks) - 1:06}.npz"
                write_arrays(place, self._blocks[-1])
        return "target" if self.is_enough(target) else "max_tests"

    def _block(self, tests: int, target: float, most: int) -> dict[str, Any]:
        begun = time.perf_counter()
        driven = drive_trees(
            self._run.setting,
            self._run.slots,
            self._plan,
            seed=self._tree_seed,
            first=self.trees,
            tests=tests,
            threads=self._threads,
            driver=self._driver,
            progress=lambda done: self._tell(target, most, done),
        )
        rng = np.random.default_rng([_independent(self._seed, _PICK), self.trees])
        one = _one_a_tree(driven.crashes, rng)
        return {
            "weight": driven.trees["weight"].copy(),
            "crashes": driven.trees["crashes"].sum(),
            "lost": driven.trees["lost"].sum(),
            "cpu_seconds": driven.cpu_seconds,
            "seconds": time.perf_counter() - begun,
            "test": driven.crashes["test"][one],
            "begun": driven.crashes["begun"][one],
            "actions": driven.actions[one],
            "answers": driven.answers[one],
            "asked": driven.asked,
            "strayed": driven.strayed,
        }

    @property
    def _tree_seed(self) -> int:
        return _independent(self._seed, _ESTIMATE)

    def _tell(self, target: float, most: int, done: int) -> None:
        """Report trees, with what they say so far."""
        total, text = most, ""
        if self.trees:
            found = self.rate
            needed = max(
                (self.half_width / target) ** 2, LEAST_EFFECTIVE / max(found.effective, 1.0), LEAST_TREES / self.trees
            )
            total = min(most, round(self.trees * needed)) if found.effective > 1.0 else most
            doubted = ", in doubt" if found.doubts else ""
            text = f" ({found.rate:.2g} +- {100.0 * min(self.half_width, 9.99):.0f} %{doubted})"
        self._progress(
            f"{'drive weighted tests' if self.tilted else 'drive trees'}{text}",
            self.trees + done,
            max(total, self.trees + done),
        )

    # What it comes to

    @property
    def branching(self) -> tuple[Plan, TreeDriver]:
        """How tests branch by what was taught, and what drives them; known once it has started."""
        return self._splitting_plan, self._teacher

    @property
    def trees(self) -> int:
        """Trees of the estimate so far."""
        return sum(block["weight"].size for block in self._blocks)

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weight of each tree."""
        return np.concatenate([block["weight"] for block in self._blocks])

    @property
    def rate(self) -> WeightedRate:
        """The rate, judged as if this number of trees had been fixed."""
        if self._judged is None or self._judged.n != self.trees:  # it is asked for often, and takes a while
            self._judged = weighted_rate(self.weights, self._unit)
        return self._judged

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval that holds however often one looks; (0, inf) without a crash."""
        return always_valid_interval(self.rate)

    @property
    def half_width(self) -> float:
        """Relative half-width of the interval that holds however often one looks; infinite without a crash."""
        low, high = self.interval
        return 0.5 * (high - low) / self.rate.rate if self.rate.rate > 0.0 else np.inf

    def is_enough(self, target: float) -> bool:
        """Is the rate exact enough, and not in doubt?"""
        return self.trees >= LEAST_TREES and self.half_width <= target and not self.rate.doubts

    def doubts(
        self, plain: MonteCarlo, plain_kinds: Mapping[str, int], kinds: Mapping[str, KindRate]
    ) -> tuple[str, ...]:
        """Say why the rate cannot be trusted, in words.

        `plain_kinds`: crashes of the plain tests by mechanism; `kinds`: rates of the picked crashes by mechanism.
        """
        found = self.rate
        told = list(found.doubts)
        if found.n < LEAST_TREES:
            told.append(f"it rests on {found.n:,} {self._unit}, fewer than {LEAST_TREES:,}")
        if lost := sum(int(block["lost"]) for block in self._blocks):
            told.append(f"{lost} copies of worlds found no room")
        if strayed := sum(int(block["strayed"]) for block in self._blocks):
            told.append(
                f"the AV answered otherwise when it was shown the same again, {strayed} times of {self.asked:,}, so "
                "copies of its tests do not go on as the tests did; make it repeat itself"
            )
        if self._unseen > _MOST_UNSEEN:
            told.append(f"crashes with {100.0 * self._unseen:.0f} % of it found no room, so their kinds are not known")
        each = found.rate / max(1, sum(kind.crashes for kind in kinds.values()))  # what one picked crash stands for
        most = {ALL_CRASHES: found.high}
        for name in plain_kinds:
            most[name] = kinds[name].interval95[1] if name in kinds else each * poisson_interval(0)[1]
        told += plain_doubts(most, {ALL_CRASHES: plain.av_crashes, **plain_kinds}, plain.valid_tests)
        return tuple(told)

    @property
    def crashes(self) -> int:
        """Branches that ended in a crash."""
        return sum(int(block["crashes"]) for block in self._blocks)

    @property
    def asked(self) -> int:
        """How often an AV from outside was asked while trees were driven; 0 for one of the kernels."""
        return sum(int(block["asked"]) for block in self._blocks)

    @property
    def cost(self) -> Cost:
        """Cost of driving, without teaching."""
        return Cost(tests=self.trees, cpu_seconds=float(sum(float(block["cpu_seconds"]) for block in self._blocks)))

    @property
    def seconds(self) -> float:
        """Wall-clock of teaching and driving [s]."""
        return self._teaching_seconds + sum(float(block["seconds"]) for block in self._blocks)

    @property
    def digest(self) -> str:
        """SHA-256 of the plan's level and all weights."""
        return hashlib.sha256(np.float64(self._level).tobytes() + self.weights.tobytes()).hexdigest()

    # Crashes

    def picked(self) -> list[PickedCrash]:
        """Pick crashes by weight, one a tree at most; drive them again, and store them if there is a folder."""
        weights = self.weights
        rng = np.random.default_rng(_independent(self._seed, _PICK))
        trees, stands_for = pick(weights, min(_MOST_CASES, max(1, round(self.rate.effective))), rng)
        kept = {
            tree_of(test, self._plan): (block, k, test)
            for block in self._blocks
            for k, test in enumerate(block["test"].tolist())
        }
        driver, branches = self._run.script_driver(), self._run.branch_recorder()
        seen = [tree in kept for tree in trees.tolist()]  # of others the crashes found no room
        self._unseen = 1.0 - float(stands_for[seen].sum() / stands_for.sum())
        trees, stands_for = trees[seen], stands_for[seen] * (weights.sum() / stands_for[seen].sum())
        picked: list[PickedCrash] = []
        room = CaseRoom(self._run.slots, driver.max_decisions)
        for done, (tree, weight) in enumerate(zip(trees.tolist(), stands_for.tolist(), strict=True)):
            self._progress("record crashes", done, trees.size)
            block, k, test = kept[tree]
            start = driver.start_of_test(self._tree_seed, test)
            actions = block["actions"][k, : block["begun"][k], : start.size]
            script = Script(np.arange(start.size, dtype=np.int16), start, actions, self._tree_seed, test)
            answers = block["answers"][k]
            scenario = branches.record_branch(script, answers[np.isfinite(answers[:, 0])])
            mechanism = mechanism_of(scenario)
            kind = crash_type_of(scenario)[0]
            picked.append(PickedCrash(weight, kind, mechanism.name))
            extra = {
                "crash_type": kind,
                "mechanism": mechanism.name,
                "at_start": mechanism.at_start,
                "weight": weight / weights.size,
            }
            room.add(branches, extra, start=script.start)
        self._progress("record crashes", trees.size, trees.size)
        if self._out is not None:
            self._store(self._out / "weighted", room)
        return picked

    def _store(self, place: Path, room: CaseRoom) -> None:
        """Write the library again: with more trees other crashes are picked."""
        remove_folder(place)
        seed = self._tree_seed
        identity = {**self._run.identity(seed), SCRIPTED: True, "cornerforge": version(), "code": code_hash()}
        library = CaseLibrary.create(place, identity, self._run.odd)
        save_model(self._run.model, place / MODEL_FILE)
        if crashes := len(room):
            cases, tracks = room.take()
            after = cases["test"][-1].as_py() + 1
            library.fill(cases, tracks, next_test=after, tests=after, crashes=crashes, shard_cases=_SHARD_CASES)
        library.finish()


def pick(
    weights: NDArray[np.float64], most: int, rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Pick about `most` of the weights above 0 so that every sum stays true in the mean.

    A weight above a threshold is kept as it is. A smaller one is kept with a chance, its share of the threshold; if it
    is kept, it stands for the threshold.

    Returns:
        Which are picked, rising, and what each stands for.

    >>> pick(np.array([0.0, 2.0, 1.0]), 5, np.random.default_rng(0))
    (array([1, 2]), array([2., 1.]))
    """
    above = np.flatnonzero(weights > 0.0)
    if above.size <= most:
        return above, weights[above]
    own = np.sort(weights[above])[::-1]
    rest = np.cumsum(own[::-1])[::-1]  # of all from each place on
    thresholds = rest / np.maximum(1.0, most - np.arange(own.size))
    whole = int(np.argmax(own <= thresholds))  # so many are above the threshold
    threshold = float(thresholds[whole])
    kept = rng.random(above.size) * threshold < weights[above]
    return above[kept], np.maximum(weights[above][kept], threshold)


def kind_rates(picked: Sequence[PickedCrash], of: str, found: WeightedRate) -> dict[str, KindRate]:
    """Split a rate by kinds of crash that were picked, "crash_type" or "mechanism"; they sum up to the whole rate."""
    largest = max((crash.weight for crash in picked), default=0.0)
    by_kind: dict[str, list[float]] = {}
    for crash in picked:
        by_kind.setdefault(getattr(crash, of), []).append(crash.weight)
    rates = {}
    for name, weights in sorted(by_kind.items()):
        low, high = weighted_interval(weights, largest)
        rates[name] = KindRate(
            crashes=len(weights), crashes_per_test=sum(weights) / found.n, interval95=(low / found.n, high / found.n)
        )
    return rates


def _driver(run: Experiment, **places: int) -> TreeDriver:
    """Take what drives trees of the run's AV."""
    return BUILT_IN_TREES if run.asked is None else ForeignTrees(run.asked, **places)


def _one_a_tree(crashes: NDArray[np.void], rng: np.random.Generator) -> NDArray[np.intp]:
    """Pick one crash of each tree, by weight."""
    first_to_ring = rng.exponential(size=crashes.size) / crashes["weight"]
    in_order = np.lexsort((first_to_ring, crashes["test"]))
    return in_order[np.unique(crashes["test"][in_order], return_index=True)[1]]


def _independent(seed: int, use: int) -> int:
    """Make a seed for one use, with tests that are independent of the user's seed."""
    return int(np.random.SeedSequence([seed, use]).generate_state(1, np.uint64)[0] >> np.uint64(1))


def _read_blocks(folder: Path) -> Iterator[dict[str, Any]]:
    """Read the blocks that were kept, in order."""
    number = 0
    while (place := folder / f"{number:06}.npz").exists():
        block = _read(place, tuple(_BLOCK_FIELDS))
        fault = _block_fault(block)
        if fault is not None:
            raise FileFormatError(f"{place} is damaged ({fault}); remove it, or choose another place.")
        yield block
        number += 1


def _block_fault(block: Mapping[str, NDArray[Any]]) -> str | None:
    """Say what is wrong with the arrays of a block, or None."""
    for name, (kind, axes) in _BLOCK_FIELDS.items():
        array = block[name]
        if array.dtype != kind or array.ndim != axes:
            return f"{name} is {array.dtype} with {array.ndim} axes; it must be {kind} with {axes}"
        if name == "weight" and (array > _MOST_WEIGHT).any():
            return f"weight holds {array.max():g}; it must be at most {_MOST_WEIGHT:g}"
        if name != "answers" and not (np.isfinite(array).all() and (array >= (-1 if name == "actions" else 0)).all()):
            return f"{name} holds a number below its least, or one that is not finite"
    return None


def _read(place: Path, names: Sequence[str]) -> dict[str, Any]:
    """Read arrays of a file of ours.

    Raises:
        FileFormatError: It is damaged.
    """
    arrays = read_arrays(place, "part of the rate")
    missing = [name for name in names if name not in arrays]
    if missing:
        raise FileFormatError(f"{place} is damaged (it lacks {missing[0]}); remove it, or choose another place.")
    return {name: arrays[name] for name in names}
