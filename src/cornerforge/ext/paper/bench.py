"""Adversaries and measurements for the items: each is made once, when an item first needs it, and kept."""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cornerforge.adversary.config import PRESETS, DqnConfig
from cornerforge.adversary.worlds import REWARDS, reward_numbers
from cornerforge.analysis.crash_types import CRASH_TYPES, STRIKERS
from cornerforge.analysis.mechanism import crash_type_of
from cornerforge.drivers.avs import AVS, ROAD_AVS, av_hash
from cornerforge.experiment.counting import drive_tests, rate_summary, simulate_experiment
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.output import code_hash, read_json_file, write_json
from cornerforge.experiment.policy_file import Policy, check_budget, load_policy, policy_hash, save_policy
from cornerforge.experiment.setting import experiment
from cornerforge.intervals import binomial_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import fill_library
from cornerforge.ndd.model import model_hash
from cornerforge.results import as_json
from cornerforge.sim import Tally, runner
from cornerforge.verbs.train import (
    EVALUATION_TESTS,
    checkpoint_beside,
    judge,
    learn,
    load_timed_policy,
    write_provenance_beside,
)
from cornerforge.work.progress import Progress
from cornerforge.world_options import WorldOptions

__all__ = [
    "BOUNDED",
    "FREE",
    "PAPER_BOUNDED_CASES",
    "PAPER_CASES",
    "PLAIN",
    "REPRODUCE_EFFORTS",
    "Adversary",
    "Bench",
    "Filled",
    "ReproduceEffort",
    "library_of",
    "missing_note",
    "pooled",
]

PLAIN = ("uniform", "lane-changer", "swerve")
"""Plain adversaries, shown beside every learned one."""
NATURAL_TESTS = 1 << 43
"""Number of the first natural test of a bench: far from the tests of training and generation."""


@dataclass(frozen=True)
class ReproduceEffort:
    """The amount of work, as counts, never as seconds, so that results do not depend on speed.

    Attributes:
        decisions: Length of a training without the bound.
        bounded_decisions: Length of a training with the bound; crashes are rarer there, so it needs more decisions.
        seeds: Trainings of each kind, each with a seed of its own.
        trained_on: AVs that adversaries are trained on; None for all built-in ones.
        rewards: Rewards that adversaries are trained for; None for all that kernels judge.
        tests: Evaluation tests of each adversary and AV.
        natural_tests: Tests of each AV in natural traffic.
        typed: Crashes of each adversary and AV that are driven again and classified, the first ones in test order.
        miles: Miles of the AV in each world of Figure 3; the paper has about 50.
        cases: Cases of the library on which timings are taken; the paper has about 50,000.
    """

    decisions: int
    bounded_decisions: int
    seeds: int
    trained_on: tuple[str, ...] | None
    rewards: tuple[str, ...] | None
    tests: int
    natural_tests: int
    typed: int
    miles: float
    cases: int


REPRODUCE_EFFORTS = {
    "quick": ReproduceEffort(
        decisions=1_000_000, bounded_decisions=2_000_000, seeds=1, trained_on=("idm-mobil",),
        rewards=("crash", "avoidable"), tests=1_024, natural_tests=20_000, typed=100, miles=100.0, cases=2_000,
    ),
    "standard": ReproduceEffort(
        decisions=2_000_000, bounded_decisions=4_000_000, seeds=3, trained_on=None, rewards=None,
        tests=4_096, natural_tests=200_000, typed=500, miles=500.0, cases=10_000,
    ),
    "full": ReproduceEffort(
        decisions=3_000_000, bounded_decisions=12_000_000, seeds=3, trained_on=None, rewards=None,
        tests=8_192, natural_tests=1_000_000, typed=1_000, miles=2_000.0, cases=50_000,
    ),
}  # fmt: skip
"""quick: about ten minutes on two cores; standard: about an hour; full: several hours (docs/results.md)."""


@dataclass(frozen=True)
class Adversary:
    """An adversary of a bench.

    Attributes:
        name: "learned", or one of `PLAIN`.
        bounded: Under the NDD-bounded mask.
        trained_on: The AV on which a learned adversary was trained; None for a plain one.
        reward: The reward of a learned adversary; None for a plain one.
    """

    name: str
    bounded: bool
    trained_on: str | None = None
    reward: str | None = None

    @property
    def key(self) -> str:
        """Name for files and progress, such as "idm-mobil.crash.free"."""
        what = self.name if self.trained_on is None else f"{self.trained_on}.{self.reward}"
        return f"{what}.{'bounded' if self.bounded else 'free'}"


FREE = Adversary("learned", bounded=False, trained_on="idm-mobil", reward="crash")
BOUNDED = Adversary("learned", bounded=True, trained_on="idm-mobil", reward="crash")
PAPER_CASES = 50_000
PAPER_BOUNDED_CASES = 1_627
_MAX_TESTS = 3_000_000
"""A library that would need more tests is left out."""
_TRIED = tuple(name for name in ROAD_AVS if AVS[name].kind not in ("careful", "flawed"))
"""Built-in AVs that are tried unless more are asked for: reference drivers are a yardstick, flawed ones a test."""


class Bench:
    """Adversaries and measurements of one folder.

    Args:
        folder: The output folder; policies go into `policies/`, measurements into `parts/`.
        size: How much of everything.
        world: What they all drive in.
        seed: Seed of tests; the k-th training of a kind has seed + k.
        threads: None for all cores.
        progress: Called with the progress.
        paper_policy: A policy of preset `paper`, trained elsewhere, for Figure 2; or None.
        more_avs: AVs besides the built-in ones, which the matrix shows too: files of `train-av`, or from outside.
        budget: How far bounded adversaries may fall short of the likeliest actions in a test [nats]; None: no limit.
    """

    def __init__(
        self, folder: Path, size: ReproduceEffort, world: WorldOptions, *, seed: int, threads: int | None,
        progress: Progress, paper_policy: Path | None = None, more_avs: Sequence[str] = (),
        budget: float | None = None,
    ) -> None:  # fmt: skip
        self.folder = folder
        self.size = size
        self.seed = seed
        self.threads = check_threads(threads)
        self.progress = progress
        self.paper_policy = None if paper_policy is None else load_timed_policy(paper_policy)
        self._world = world
        self._budget = check_budget(budget, bounded=True)
        self._more_avs = tuple(dict.fromkeys(name for name in more_avs if name not in _TRIED))
        self._av_hashes: dict[str, str] = {}
        self._policies: dict[tuple[str, int], Policy] = {}

    # --- names ---

    @property
    def avs(self) -> tuple[str, ...]:
        """All built-in AVs but the reference drivers, the paper's first; then the AVs that were asked for."""
        return ("idm-mobil", *(name for name in _TRIED if name != "idm-mobil"), *self._more_avs)

    def av_hash(self, av: str) -> str:
        """Hash an AV as it drives: with the weights of a learned one, the source or file of one from outside."""
        if av not in self._av_hashes:
            run = self.experiment(av)
            self._av_hashes[av] = run.av_hash
            run.rest()
        return self._av_hashes[av]

    @property
    def trained_on(self) -> tuple[str, ...]:
        """The AVs that adversaries are trained on, built-in ones."""
        wanted = self.size.trained_on
        return tuple(name for name in self.avs if name in _TRIED and (wanted is None or name in wanted))

    @property
    def rewards(self) -> tuple[str, ...]:
        """Rewards of learned adversaries: all that kernels judge, or the effort's."""
        wanted = self.size.rewards
        judged = [name for name, reward in REWARDS.items() if not reward.by_case]
        return tuple(name for name in judged if wanted is None or name in wanted)

    def inputs(self) -> dict[str, Any]:
        """Identity of a measurement beside its own arguments: code, seed, world, and the AVs."""
        run = self.experiment("idm-mobil")
        return {
            "code": code_hash(),
            "seed": self.seed,
            "size": json.loads(json.dumps(asdict(self.size))),
            "model": model_hash(run.model),
            "odd": run.odd.stated(),
            **({} if self._budget is None else {"budget": self._budget}),
        }

    # --- kept results ---

    def kept(self, name: str, inputs: dict[str, Any], work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Give what `parts/NAME.json` holds if it was made of the same inputs; else do the work and keep it."""
        return keep(self.folder / "parts" / f"{name}.json", {**self.inputs(), **inputs}, work)

    def forget(self, name: str) -> None:
        """Delete `parts/NAME.json` when the files that it describes are gone."""
        (self.folder / "parts" / f"{name}.json").unlink(missing_ok=True)

    def experiment(self, av: str, adversary: Adversary | None = None, k: int = 0) -> Experiment:
        """An AV in natural traffic, or among an adversary's (learned: its k-th training) vehicles."""
        if adversary is None:
            return experiment(self._world, av=av, takes_foreign=True, seed=self.seed)
        if adversary.trained_on is None:
            return experiment(self._masked(adversary), av=av, bv=adversary.name, takes_foreign=True, seed=self.seed)
        return experiment(self._world, av=av, policy=self.policy(adversary, k), takes_foreign=True, seed=self.seed)

    def _masked(self, adversary: Adversary) -> WorldOptions:
        """Return the world with an adversary's mask and budget."""
        return replace(self._world, bounded=adversary.bounded, budget=self._budget if adversary.bounded else None)

    def config(self, adversary: Adversary) -> DqnConfig:
        """Return the hyperparameters of a learned adversary: preset `fast` with the effort's length and its reward."""
        decisions = self.size.bounded_decisions if adversary.bounded else self.size.decisions
        return replace(PRESETS["fast"], decisions=decisions, reward=adversary.reward or "crash")

    def policy(self, adversary: Adversary, k: int = 0) -> Policy:
        """The k-th training of a learned adversary: from `policies/`, where it was made of the same, or trained now.

        An interrupted training goes on where it stopped. Policies are reused after changes of code, since training is
        expensive; each names the code that made it.
        """
        if (adversary.key, k) not in self._policies:
            self._policies[adversary.key, k] = self._trained(adversary, k)
        return self._policies[adversary.key, k]

    def timed_policy(self, adversary: Adversary, k: int = 0) -> Policy:
        """Return the same policy, with times in its curve."""
        self.policy(adversary, k)
        return load_timed_policy(self._place(adversary, k))

    def _place(self, adversary: Adversary, k: int) -> Path:
        return self.folder / "policies" / f"{adversary.key}.{k}.safetensors"

    def _trained(self, adversary: Adversary, k: int) -> Policy:
        assert adversary.trained_on is not None  # plain adversaries have no policy
        path = self._place(adversary, k)
        run = experiment(self._masked(adversary), av=adversary.trained_on, bv="uniform")
        config, seed = self.config(adversary), self.seed + k
        wanted: dict[str, Any] = {
            "seed": seed,
            "av_hash": av_hash(run.av),
            "model_hash": model_hash(run.model),
            "train": asdict(config),
            "odd": run.odd.stated(),
        }
        if path.exists():
            policy = load_policy(path)
            if policy.budget == run.budget and all(policy.about.get(key) == wanted[key] for key in wanted):
                return policy
        path.parent.mkdir(parents=True, exist_ok=True)
        checkpoint = checkpoint_beside(path, run, config, seed)
        policy, result = learn(
            run, config, seed=seed, threads=self.threads, checkpoint=checkpoint,
            progress=lambda stage, done, total: self.progress(f"{stage} ({adversary.key}, {k})", done, total),
        )  # fmt: skip
        write_provenance_beside(path, run, result, seed)
        save_policy(policy, path)  # last: where it is, the training is done
        checkpoint.remove()
        return load_policy(path)

    # --- measurements ---

    def natural(self, av: str) -> dict[str, Any]:
        """An AV's own crash rate in natural traffic: the object of `rate_summary`."""
        run = self.experiment(av)

        def work() -> dict[str, Any]:
            tally, _ = simulate_experiment(
                run, tests=self.size.natural_tests, seed=self.seed, first=NATURAL_TESTS, threads=self.threads,
                progress=self.progress, stage=f"natural traffic ({av})",
            )  # fmt: skip
            run.rest()
            return as_json(rate_summary(tally.av_crashes, tally.tests, tally.miles))

        return self.kept(f"natural.{_file_name(av)}", {"av_hash": run.av_hash}, work)

    def judged(self, adversary: Adversary, av: str, k: int = 0) -> dict[str, Any]:
        """Measure an adversary against an AV on evaluation tests, which no training uses.

        Returns:
            The object of `rate_summary` with `crashes`; how many of these are `avoidable` (by braking at 8 m/s2 from
            1 s after the manoeuvre began) and `struck` (the AV's front took part); `typed`, the number of crashes that
            were classified (the first ones in test order), of these `crash_types` and `strikers` by name.
        """
        return self._kept_judgement(self.experiment(av, adversary, k), f"{adversary.key}.{k}")

    def judged_policy(self, policy: Policy, av: str, name: str) -> dict[str, Any]:
        """Measure a policy from elsewhere in the same way; `name` is for files and progress."""
        return self._kept_judgement(experiment(self._world, av=av, policy=policy), name)

    def _kept_judgement(self, run: Experiment, name: str) -> dict[str, Any]:
        made_of = {"av_hash": run.av_hash, "policy": None if run.policy is None else policy_hash(run.policy)}
        av = run.av.name
        try:
            return self.kept(f"judged.{name}.{_file_name(av)}", made_of, lambda: self._judge(run, f"{name}, {av}"))
        finally:
            run.rest()

    def _judge(self, run: Experiment, label: str) -> dict[str, Any]:
        tests = self.size.tests
        run.warm_up()
        run.keep_scripts()  # crashes are judged by what the AV answered
        tally, crashed = Tally(), []
        for start, outcomes in drive_tests(
            run, tally, f"evaluate ({label})", seed=self.seed, first=EVALUATION_TESTS, tests=tests,
            threads=self.threads, progress=self.progress,
        ):  # fmt: skip
            crashed += runner.crashed_tests(start, outcomes)
        struck, avoidable = judge(run, self.seed, crashed, reward_numbers("avoidable"), self.threads)
        return {
            **as_json(rate_summary(tally.av_crashes, tally.tests, tally.miles)),
            "crashes": tally.av_crashes,
            "avoidable": int(avoidable.sum()),
            "struck": int(struck.sum()),
            **self._classified(run, crashed[: self.size.typed]),
        }

    def _classified(self, run: Experiment, crashed: list[int]) -> dict[str, Any]:
        recorder = run.recorder()
        found = [crash_type_of(recorder.record(self.seed, test)) for test in crashed]
        types, strikers = Counter(kind for kind, _ in found), Counter(striker for _, striker in found)
        return {
            "typed": len(found),
            "crash_types": {name: types[name] for name in CRASH_TYPES.values()},
            "strikers": {name: strikers[name] for name in STRIKERS},
        }


def _file_name(av: str) -> str:
    """Name an AV in the name of a file; `my_av:MyAv` and `nets/net.onnx` cannot be used there."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", av)


def keep(path: Path, inputs: dict[str, Any], work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Give the result that a file holds if it was made of the same inputs; else do the work and write it there.

    The result is always the one read back from JSON, so that a resumed run sees the same as an unbroken one.
    """
    if path.exists():
        content = read_json_file(path)
        if content.get("made_of") == inputs and isinstance(content.get("result"), dict):
            return dict(content["result"])
    write_json(path, {"made_of": inputs, "result": work()})
    return dict(read_json_file(path)["result"])


@dataclass(frozen=True)
class Filled:
    """A library of a bench.

    Attributes:
        folder: Where it is.
        cases: How many it holds.
        seconds: What generating and storing it took [s].
    """

    folder: Path
    cases: int
    seconds: float

    def open(self) -> CaseLibrary:
        """Open it for reading."""
        return CaseLibrary.open(self.folder)


def library_of(bench: Bench, adversary: Adversary) -> Filled | None:
    """The library of an adversary against the surrogate AV, filled now unless it is there; None if crashes are rare.

    It has the cases of the effort; the bounded one not more than the paper's 1,627.
    """
    cases = _wanted(bench, adversary)
    if bench.judged(adversary, "idm-mobil")["crashes_per_test"] * _MAX_TESTS < cases:
        return None
    run = bench.experiment("idm-mobil", adversary)
    folder = bench.folder / "libraries" / adversary.key

    def work() -> dict[str, Any]:
        if folder.exists():  # what an interrupted run left would be continued, and the time would be too short
            shutil.rmtree(folder)
        filled = fill_library(
            run, folder, seed=bench.seed, cases=cases, threads=bench.threads, progress=bench.progress,
            stage=f"generate ({adversary.key})",
        )  # fmt: skip
        return {"cases": cases, "seconds": filled.seconds}

    policy = None if run.policy is None else policy_hash(run.policy)
    name, made_of = f"library.{adversary.key}", {"policy": policy, "cases": cases}
    if not folder.exists():
        bench.forget(name)
    made = bench.kept(name, made_of, work)
    return Filled(folder, made["cases"], made["seconds"])


def missing_note(bench: Bench, adversary: Adversary) -> str:
    """Say why there is no library."""
    cases = _wanted(bench, adversary)
    return f"No library of {adversary.key}: its yield is too low for {cases:,} cases in {_MAX_TESTS:,} tests."


def _wanted(bench: Bench, adversary: Adversary) -> int:
    return min(PAPER_BOUNDED_CASES, bench.size.cases) if adversary.bounded else bench.size.cases


def pooled(judged: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The mean yield over seeds, with an interval that covers every seed's.

    Args:
        judged: What `Bench.judged` gave for each seed, at least one, of equal numbers of tests.

    Returns:
        `crashes_per_test`, the mean; `interval95`, from the lowest to the highest end of the seeds' exact intervals (so
        its lower end belongs to the worst seed); `tests`, `crashes`, `avoidable`, `struck`, `typed`, `crash_types` and
        `strikers` summed; the same mean and interval as `avoidable_per_test` and `avoidable_interval95` for avoidable
        crashes; `seeds`, each seed's own yield.
    """
    shares = [rate["crashes_per_test"] for rate in judged]
    ends = [rate["interval95"] for rate in judged]
    sums = {name: sum(rate[name] for rate in judged) for name in ("tests", "crashes", "avoidable", "struck", "typed")}
    avoidable = [binomial_interval(rate["avoidable"], rate["tests"]) for rate in judged]
    tables: dict[str, dict[str, int]] = {}
    for name in ("crash_types", "strikers"):
        total: Counter[str] = Counter()
        for rate in judged:
            total.update(rate[name])
        tables[name] = {key: total[key] for key in judged[0][name]}
    return {
        "crashes_per_test": sum(shares) / len(shares),
        "interval95": (min(low for low, _ in ends), max(high for _, high in ends)),
        "avoidable_per_test": sum(rate["avoidable"] / rate["tests"] for rate in judged) / len(judged),
        "avoidable_interval95": (min(low for low, _ in avoidable), max(high for _, high in avoidable)),
        **sums,
        **tables,
        "seeds": shares,
    }
