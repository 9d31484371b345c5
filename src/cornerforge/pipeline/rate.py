"""`rate`: the AV's natural crash rate, with its exact interval; every finished block of tests is kept."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from cornerforge._checks import check_in, check_integer, check_number
from cornerforge.library import CaseLibrary, case_record
from cornerforge.ndd.model import save_model
from cornerforge.pipeline.generate import MODEL_FILE
from cornerforge.pipeline.output import code_hash, open_output, provenance, read_json_file, version, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.pipeline.simulate import rate_summary
from cornerforge.rates import binomial_interval
from cornerforge.rates.monte_carlo import MonteCarlo, relative_half_width
from cornerforge.sim.recorder import Recorder, scenario_digest
from cornerforge.sim.runner import METRES_PER_MILE, Tally, crashed_tests, simulate_chunks, warm_up

__all__ = ["rate"]

_BLOCK = 65_536
"""Tests between two saved states; the digest is a chain over blocks, so it is fixed."""


def _drive_block(run: Experiment, first: int, tests: int, seed: int, threads: int) -> tuple[Tally, tuple[int, ...]]:
    tally = Tally()
    crashed: list[int] = []
    for start, outcomes, counts in simulate_chunks(
        run.setting, run.slots, seed=seed, first=first, tests=tests, threads=threads, chunk=2048
    ):
        tally.add(outcomes, counts)
        crashed += crashed_tests(start, outcomes)
    return tally, tuple(crashed)


def _count(
    run: Experiment,
    counts: MonteCarlo,
    save: Path | None,
    *,
    seed: int,
    threads: int,
    target: float,
    max_tests: int,
    progress: Progress,
) -> MonteCarlo:
    """Drive blocks until the interval is narrow enough or `max_tests` are done; saves after each block."""
    while counts.tests < max_tests and not counts.is_enough(target):
        start = time.perf_counter()
        tests = min(_BLOCK, max_tests - counts.tests)
        tally, crashed = _drive_block(run, counts.tests, tests, seed, threads)
        counts = counts.plus(
            tests=tests,
            bv_crashes=tally.bv_crashes,
            world_steps=tally.decisions,
            millimetres=tally.millimetres,
            seconds=time.perf_counter() - start,
            crashed=crashed,
            digest=tally.digest.hexdigest(),
        )
        if save is not None:
            write_json(save, counts.to_json())
        progress(f"rate ({counts.av_crashes} crashes)", counts.tests, max_tests)
    return counts


def _store(run: Experiment, counts: MonteCarlo, folder: Path, seed: int) -> None:
    """Record every crash by driving its test again, into a library like any other."""
    identity = {**run.identity(seed), "cornerforge": version(), "code": code_hash()}
    library = CaseLibrary.resume(folder, identity, run.odd)
    if not (folder / MODEL_FILE).exists():
        save_model(run.model, folder / MODEL_FILE)
    recorder = Recorder(run.setting, run.odd)
    fresh = [recorder.record(seed, test) for test in counts.crashed if test >= library.next_test]
    records = [case_record(scenario, trajectory_digest=scenario_digest(scenario)) for scenario in fresh]
    if counts.tests > library.next_test:
        library.append(records, next_test=counts.tests, tests=counts.tests, crashes=counts.av_crashes)
    library.finish()


def rate(
    *,
    method: str = "mc",
    av: str = "idm-mobil",
    target_rhw: float = 0.3,
    max_tests: int = 1_000_000,
    out: Path | str | None = None,
    resume: bool = False,
    lanes: int | None = None,
    odd: str = "default",
    model: Path | str | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> dict[str, Any]:
    """The AV's natural crash rate in 400 m tests, without bias.

    Args:
        method: "mc", plain Monte Carlo.
        av: Name of the AV under test.
        target_rhw: Stop when half the exact 95 % interval is at most this share of the rate, 0.001 to 10.
        max_tests: Stop here at the latest.
        out: Folder for `rate.json`, the counts so far, and `library/` with all crashes; None keeps nothing.
        resume: Go on with that folder.
        lanes, odd, model: The world, as for `simulate`.
        seed: 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.

    Returns:
        The object that `cornerforge rate --json` prints.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    check_in("method", method, ("mc",))
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("max_tests", max_tests, low=1, high=10**12)
    check_number("target_rhw", target_rhw, low=1e-3, high=10.0)
    run = experiment(av=av, odd=odd, lanes=lanes, model=None if model is None else Path(model))
    counts, save = MonteCarlo(), None
    identity = {**run.identity(seed), "method": method, "cornerforge": version(), "code": code_hash()}
    if out is not None:
        save = Path(out) / "counts.json"
        if open_output(Path(out), identity, resume=resume) and save.exists():
            counts = MonteCarlo.from_json(read_json_file(save))
    warm_up(run.setting, run.slots)
    counts = _count(
        run,
        counts,
        save,
        seed=seed,
        threads=check_threads(threads),
        target=target_rhw,
        max_tests=max_tests,
        progress=progress,
    )
    summary = _summary(run, counts, method)
    if out is not None:
        _store(run, counts, Path(out) / "library", seed)
        write_json(Path(out) / "rate.json", summary)
        write_json(Path(out) / "provenance.json", provenance(identity, round(counts.seconds, 3)))
    return summary


def _summary(run: Experiment, counts: MonteCarlo, method: str) -> dict[str, Any]:
    miles = counts.millimetres / 1000.0 / METRES_PER_MILE
    low, high = binomial_interval(counts.av_crashes, counts.tests)
    return {
        "method": method,
        "av": run.av.name,
        "odd": run.odd.name,
        "lanes": run.odd.n_lanes,
        **rate_summary(counts.av_crashes, counts.tests, miles),
        "relative_half_width": relative_half_width(low, high, counts.av_crashes / counts.tests),
        "av_crashes": counts.av_crashes,
        "bv_crashes": counts.bv_crashes,
        "bv_crashes_per_test": counts.bv_crashes / counts.tests,
        "effective_sample_size": counts.tests,
        "acceleration": 1.0,
        "seconds": round(counts.seconds, 3),
        "tests_per_second": round(counts.tests / counts.seconds, 1) if counts.seconds else None,
        "digest": counts.digest,
    }
