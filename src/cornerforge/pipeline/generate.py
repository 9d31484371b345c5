"""`generate`: fill a case library with recorded crashes; also where `simulate --out` stores its natural ones."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

import numpy as np

from cornerforge._checks import check_integer
from cornerforge.adversary.policy_file import save_policy
from cornerforge.errors import AvFaultError, CornerForgeError, InputError, OutputError
from cornerforge.foreign.process import DEFAULT_TIMEOUT
from cornerforge.library import CaseLibrary, CaseRecord, case_record
from cornerforge.ndd.model import save_model
from cornerforge.pipeline.output import code_hash, provenance, version, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.rates import binomial_interval
from cornerforge.sim.recorder import scenario_digest
from cornerforge.sim.runner import crashed_tests, simulate_chunks
from cornerforge.sim.world import AV_FAULT

__all__ = ["fill_library", "generate", "store_tests"]

_SHARD_CASES = 1000
_COMMIT_SECONDS = 20.0
_MAX_TESTS_PER_CASE = 100_000
POLICY_FILE = "policy.safetensors"
MODEL_FILE = "model.npz"


def _open_library(run: Experiment, out: Path, seed: int, *, resume: bool) -> CaseLibrary:
    """Start or take up the library of a run and put the policy and model that its replays need beside it."""
    identity = {**run.identity(seed), "cornerforge": version(), "code": code_hash()}
    library = (CaseLibrary.resume if resume else CaseLibrary.create)(out, identity, run.odd)
    if run.policy is not None and not (out / POLICY_FILE).exists():
        save_policy(run.policy, out / POLICY_FILE)
    try:
        if not (out / MODEL_FILE).exists():
            save_model(run.model, out / MODEL_FILE)
    except OSError as error:
        raise OutputError(f"Cannot write into {out}: {error.strerror}; choose another place.") from error
    return library


class _Filler:
    """Records crashes in the order of their tests and commits them shard by shard."""

    def __init__(self, run: Experiment, library: CaseLibrary, seed: int) -> None:
        self._library = library
        self._recorder = run.recorder()
        self._seed = seed
        self._pending: list[CaseRecord] = []
        self._committed_at = time.monotonic()
        self._earlier_faults = library.next_test - library.tests
        self._faults: list[int] = []

    def leave_out(self, tests: list[int]) -> None:
        """Note tests that the AV spoiled: they are done, and are no tests."""
        self._faults += tests

    @property
    def crashes(self) -> int:
        """Crashes stored so far, committed or not."""
        return self._library.crashes + len(self._pending)

    def record(self, test: int) -> None:
        """Drive a crashed test again, recording; a full shard is committed."""
        scenario = self._recorder.record(self._seed, test)
        self._pending.append(case_record(scenario, trajectory_digest=scenario_digest(scenario)))
        if len(self._pending) >= _SHARD_CASES:
            self.commit(test + 1)

    def commit(self, next_test: int) -> None:
        """Store what is recorded; all tests below `next_test` are done."""
        if next_test == self._library.next_test:
            return
        tests = next_test - self._earlier_faults - sum(test < next_test for test in self._faults)
        self._library.append(self._pending, next_test=next_test, tests=tests, crashes=self.crashes)
        self._pending = []
        self._committed_at = time.monotonic()

    def commit_if_due(self, next_test: int) -> None:
        """Where crashes are rare a shard takes long to fill: commit by the clock, or a kill would lose much."""
        if time.monotonic() - self._committed_at >= _COMMIT_SECONDS:
            self.commit(next_test)

    def rescue(self) -> None:
        """Keep what is recorded when the work is interrupted."""
        if self._pending:
            # An interrupt within a commit leaves a library that is ahead of this object and refuses to be written
            # twice; then the cases are safe already.
            with contextlib.suppress(CornerForgeError):
                self.commit(int(self._pending[-1].case_id.partition(":")[2]) + 1)


def fill_library(
    run: Experiment,
    out: Path,
    *,
    seed: int,
    cases: int | None = None,
    tests: int | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress: Progress = NO_PROGRESS,
    stage: str = "generate",
) -> dict[str, Any]:
    """Drive tests 0, 1, 2, ... of a seed and store every AV crash, until there are enough cases or tests.

    Args:
        run: The experiment.
        out: The library's folder.
        seed: Of the tests.
        cases: Stop at this many stored cases; the test of the last one is the last counted.
        tests: Stop after this many tests.
        threads, progress, stage: As for `simulate`.
        resume: Go on where an earlier call, or its kill, stopped.

    Raises:
        CornerForgeError: The place cannot be used, or crashes are so rare that `cases` is out of reach.
    """
    n_threads = check_threads(threads)
    run.warm_up()
    start = time.perf_counter()
    library = _open_library(run, out, seed, resume=resume)
    filler = _Filler(run, library, seed)
    try:
        _fill(run, filler, library.next_test, seed, cases, tests, n_threads, progress, stage)
    except (KeyboardInterrupt, AvFaultError):
        filler.rescue()
        raise
    library.finish()
    seconds = time.perf_counter() - start
    write_json(out / "provenance.json", provenance(library.identity, round(seconds, 3)))
    return _library_summary(library, seconds)


def _fill(
    run: Experiment, filler: _Filler, first: int, seed: int, cases: int | None, tests: int | None, threads: int,
    progress: Progress, stage: str,
) -> None:  # fmt: skip
    """Drive from test `first` on until there are enough cases or tests; everything is committed then."""
    if cases is not None and filler.crashes >= cases:
        return
    last = tests if tests is not None else _MAX_TESTS_PER_CASE * (cases or 1)
    next_test = first
    chunks = simulate_chunks(
        run.setting, run.slots, seed=seed, first=first, tests=max(0, last - first), threads=threads,
        drive=run.drive,
    )  # fmt: skip
    with contextlib.closing(chunks):
        for start, outcomes, _ in chunks:
            next_test = start + outcomes.code.size
            filler.leave_out([start + int(k) for k in np.flatnonzero(outcomes.code == AV_FAULT)])
            for test in crashed_tests(start, outcomes):
                filler.record(test)
                if filler.crashes == cases:
                    next_test = test + 1
                    break
            done, target = (next_test, last) if cases is None else (filler.crashes, cases)
            progress(stage, done, target)
            if filler.crashes == cases:
                break
            filler.commit_if_due(next_test)
            if cases is not None and filler.crashes == 0 and next_test >= _MAX_TESTS_PER_CASE:
                break
    filler.commit(next_test)
    if cases is not None and filler.crashes < cases:
        raise InputError(
            f"{filler.crashes} of {cases} cases after {next_test} tests: this adversary is too weak. Train it longer, "
            "or store what there is with: cornerforge simulate --bv POLICY --out LIB"
        )


def _library_summary(library: CaseLibrary, seconds: float) -> dict[str, Any]:
    """The object of `generate`: cases, and crashes per test of all tests that were driven for them."""
    low, high = binomial_interval(library.crashes, library.tests)
    return {
        "cases": len(library),
        "tests": library.tests,
        "av_crashes": library.crashes,
        "av_faults": library.next_test - library.tests,
        "crashes_per_test": library.crashes / library.tests,
        "interval95": [low, high],
        "seconds": round(seconds, 3),
        "library": str(library.path),
    }


def store_tests(
    run: Experiment, out: Path, *, tests: int, seed: int, threads: int | None, counting: bool, resume: bool,
    progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """`simulate --out`: store the crashes, then count as `simulate` does."""
    from cornerforge.pipeline.simulate import simulate_experiment, tally_summary

    filled = fill_library(
        run, out, seed=seed, tests=tests, threads=threads, resume=resume, progress=progress, stage="store"
    )
    tally, seconds = simulate_experiment(
        run, tests=tests, seed=seed, threads=threads, counting=counting, progress=progress
    )
    summary = tally_summary(tally, seconds, with_distributions=counting)
    return {**summary, "cases": filled["cases"], "library": str(out)}


def generate(
    *,
    policy: Path | str,
    cases: int,
    out: Path | str,
    av: str = "idm-mobil",
    resume: bool = False,
    lanes: int | None = None,
    odd: str = "default",
    model: Path | str | None = None,
    bounded: bool = False,
    seed: int = 0,
    threads: int | None = None,
    av_timeout: float = DEFAULT_TIMEOUT,
    progress: Progress = NO_PROGRESS,
) -> dict[str, Any]:
    """Fill a case library with crashes that an adversary makes.

    Args:
        policy: Policy file of `train`, or the name of a plain adversary.
        cases: How many, at least 1.
        out: The library's folder; must be new unless `resume`.
        av: The AV under test: a built-in name, `module:Class`, an `.onnx` or a Stable-Baselines3 `.zip` file.
        resume: Go on where an earlier call, or its kill, stopped.
        lanes, odd, model: The world, as for `simulate`.
        bounded: Keep a plain adversary to what the naturalistic model calls possible; a policy brings its own answer.
        seed: Of the tests, 0 or more.
        threads: None for all cores; does not change the result.
        av_timeout: How long an AV that is not built in may take for an answer [s].
        progress: Told how far it is.

    Returns:
        The object that `cornerforge generate --json` prints.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    check_integer("cases", cases, low=1, high=10**8)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    run = experiment(
        av=av, odd=odd, lanes=lanes, model=None if model is None else Path(model), bv=str(policy), bounded=bounded,
        takes_foreign=True, seed=seed, av_timeout=av_timeout,
    )  # fmt: skip
    if run.bv in ("nde", "idm"):
        raise InputError(
            f"policy = {run.bv!r} is no adversary; to store natural crashes: cornerforge simulate --out LIB"
        )
    return fill_library(run, Path(out), seed=seed, cases=cases, threads=threads, resume=resume, progress=progress)
