"""`ndd validate`: a model against held-out trajectories, and its free-running traffic against published facts."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cornerforge._checks import check_integer
from cornerforge.ndd.model import model_hash
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import experiment
from cornerforge.pipeline.simulate import simulate_experiment, tally_summary

__all__ = ["FACTS", "FREE_RUNNING_TESTS", "Fact", "compare_with_facts", "ndd_validate", "validation_text"]

FREE_RUNNING_TESTS = 2_000
"""Tests of free-running traffic: about 150 states with a TTC below 5 s, the rarest fact."""


class Fact(NamedTuple):
    """A published fact about motorway traffic and what is allowed of simulated traffic; `low` <= found <= `high`.

    `path` leads to it in the distributions of `simulate(stats=True)`.
    """

    name: str
    unit: str
    path: tuple[str, ...]
    low: float
    high: float


def _time_gap(percent: str, published: float, tolerance: float) -> Fact:
    low, high = published * (1.0 - tolerance), published * (1.0 + tolerance)
    return Fact(f"time gap, {percent} %", "s", ("time_gap", "quantiles", percent), low, high)


def _ttc_share(limit: str, published: float) -> Fact:
    path = ("ttc_share_below", limit)
    return Fact(f"share of following states with TTC below {limit} s", "", path, published / 2.5, published * 2.5)


FACTS = (
    _time_gap("5", 0.55, 0.15),
    _time_gap("25", 0.80, 0.10),
    _time_gap("50", 1.14, 0.10),
    _time_gap("75", 1.78, 0.10),
    _time_gap("95", 2.90, 0.15),
    Fact("speed, mean", "m/s", ("speed", "mean"), 29.05, 31.05),
    Fact("speed, sd", "m/s", ("speed", "sd"), 3.48 * 0.8, 3.48 * 1.2),
    Fact("share of vehicles that follow", "", ("following_share",), 0.582, 0.782),
    Fact("range rate, sd", "m/s", ("range_rate", "sd"), 1.1, 1.5),
    Fact("acceleration, sd", "m/s2", ("acceleration", "sd"), 0.35, 0.55),
    _ttc_share("5", 1.5e-4),
    _ttc_share("10", 3.4e-3),
    Fact("lane changes", "per vehicle-mile", ("lane_changes_per_mile",), 0.2, 0.4),
)
"""Computed from the published IVBSS tables (Feng et al. 2023, doi:10.1038/s41586-023-05732-2); lane changes: highD
(0.20; Krajewski et al. 2018) and a NHTSA naturalistic study (0.36; Lee, Olsen, Wierwille 2004). Tolerances are ours."""


def compare_with_facts(distributions: dict[str, Any]) -> list[dict[str, Any]]:
    """Each of `FACTS` with what was found in distributions as `simulate(stats=True)` gives them.

    Returns:
        Objects with `fact`, `unit`, `found`, `allowed` [low, high] and `within`. What was not seen at all (null) is
        not within.
    """
    rows = []
    for fact in FACTS:
        found: Any = distributions
        for key in fact.path:
            found = None if found is None else found.get(key)
        within = found is not None and fact.low <= found <= fact.high
        allowed = [round(fact.low, 6), round(fact.high, 6)]
        rows.append({"fact": fact.name, "unit": fact.unit, "found": found, "allowed": allowed, "within": within})
    return rows


def ndd_validate(
    model: Path | str,
    *,
    against: Sequence[Path | str],
    data_format: str | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> dict[str, Any]:
    """Compare a model with held-out trajectories and with published facts.

    Args:
        model: Model file.
        against: Trajectory files, all of one format. Their held-out decisions are scored (all, where none is held
            out); the others fit the baselines.
        data_format: "ngsim", "pairs", "tracks", "tgsim" or "highd"; None to tell it from the columns.
        seed: Of the free-running traffic, 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.

    Returns:
        The object that `cornerforge ndd validate --json` prints. `passed` means: more likely than the IDM and than
        uniform guessing on every file, with the whole 95 % interval, and every fact within what is allowed.

    Raises:
        CornerForgeError: Input or files are not right.
    """
    from cornerforge.ndd.readers import read_decisions
    from cornerforge.ndd.validate import validate_readings

    start = time.perf_counter()
    check_integer("seed", seed, low=0, high=2**63 - 1)
    run = experiment(model=Path(model))
    progress("validate: reading", 0, 1)
    readings = read_decisions([Path(file) for file in against], data_format)
    progress("validate: scoring", 0, 1)
    scores = validate_readings(run.model, readings)
    tally, seconds = simulate_experiment(
        run, tests=FREE_RUNNING_TESTS, seed=seed, threads=threads, counting=True, progress=progress
    )
    facts = compare_with_facts(tally_summary(tally, seconds, with_distributions=True)["distributions"])
    return {
        "model": str(model),
        "model_hash": model_hash(run.model),
        **scores.to_json(),
        "facts": facts,
        "tests": FREE_RUNNING_TESTS,
        "passed": scores.passed and all(fact["within"] for fact in facts),
        "seconds": round(time.perf_counter() - start, 3),
    }


def validation_text(result: dict[str, Any]) -> str:
    """What `ndd_validate` found, as a table for people."""
    from cornerforge.ndd.validate import GATES

    lines = ["Log-likelihood per decision; model minus baseline with 95 % interval"]
    for name, parts in result["log_likelihood_per_decision"].items():
        for part, score in parts.items():
            far = result["distances"]["acceleration"][name][part]
            lines.append(
                f"{name}, {part}: {score['model']:.3f} ({score['decisions']:,} decisions, {score['vehicles']:,} "
                f"vehicles); accelerations: Wasserstein {far['wasserstein']:.3f} m/s2, "
                f"Kolmogorov-Smirnov {far['kolmogorov_smirnov']:.3f}"
            )
            for baseline, versus in score["model_minus"].items():
                low, high = versus["interval95"]
                value = score["baselines"][baseline]
                worse = "  NOT BETTER" if baseline in GATES and low <= 0.0 else ""
                numbers = f"{value:>8.3f}{versus['difference']:>+9.3f}  ({low:+.3f} to {high:+.3f})"
                lines.append(f"  {baseline:<10}{numbers}{worse}")
    lines.append(f"Free-running traffic, {result['tests']:,} tests, against published facts")
    for fact in result["facts"]:
        found = "none" if fact["found"] is None else f"{fact['found']:.3g}"
        low, high = fact["allowed"]
        verdict = "" if fact["within"] else "  OUTSIDE"
        lines.append(f"  {fact['fact']:<46}{found:>9}  ({low:.3g} to {high:.3g}) {fact['unit']}".rstrip() + verdict)
    lines += [f"Note: {note}" for note in result["notes"]]
    return "\n".join([*lines, "Passed." if result["passed"] else "NOT passed."])
