"""`plausibility` measures and plots what an adversary reaches within each likelihood budget."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cornerforge._checks import check_integer
from cornerforge._options import verb
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import (
    code_hash,
    open_output,
    provenance,
    read_json_file,
    version,
    write_json,
    writing,
)
from cornerforge.experiment.policy_file import check_budget, policy_hash, save_policy
from cornerforge.experiment.setting import AV_LOG, experiment
from cornerforge.ext.studies.options import PlausibilityStudy
from cornerforge.intervals import binomial_interval
from cornerforge.library.filling import harvest_tests
from cornerforge.report.drawing import BLUE, GREY, ORANGE, check_matplotlib, new_figure, png_of
from cornerforge.results import Plausibility, as_json, from_json
from cornerforge.results.cases import NaturalPlausibility, PlausibilityRow, PlausibilityRun
from cornerforge.verbs.train import EVALUATION_TESTS, evaluate, learn, training_faults
from cornerforge.work.progress import Progress
from cornerforge.world_options import BUDGETS

__all__ = ["plausibility", "plausibility_text"]

_NATURAL_TESTS = 500


@verb(PlausibilityStudy)
def plausibility(options: PlausibilityStudy) -> Plausibility:
    """Train an adversary for each budget and training seed, also without a budget (the paper's mask) and without mask.

    Returns:
        What `cornerforge plausibility --json` prints: a row for each budget, and natural drivers.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    check_matplotlib()
    check_integer("seed", options.seed, low=0, high=2**32 - 1)
    for nats in options.budgets:
        check_budget(nats, bounded=True)
    if len(set(options.budgets)) != len(options.budgets):
        raise InputError(f"budgets = {list(options.budgets)} names one twice; give each once.")
    config = preset_named("fast")
    if options.decisions is not None:
        config = replace(config, decisions=options.decisions)
    world = options.world().without_mask()
    natural = experiment(world, takes_foreign=True, seed=options.seed)
    folder = Path(options.out)
    identity = {
        **natural.identity(options.seed),
        "budgets": " ".join(f"{budget:g}" for budget in sorted(options.budgets)),
        **({} if options.budget_of == BUDGETS[0] else {"budget_of": options.budget_of}),
        "decisions": config.decisions,
        "seeds": options.seeds,
        "tests": options.tests,
        "cornerforge": version(),
        "code": code_hash(),
    }
    open_output(folder, identity, resume=options.resume)
    natural.keep_printed(folder / AV_LOG)
    n_threads = check_threads(options.threads)
    masks: list[tuple[float | None, bool]] = [(budget, True) for budget in sorted(options.budgets)]
    masks += [(None, True), (None, False)]
    forecast(
        natural, options.threads, f"{len(masks) * options.seeds} trainings and their tests",
        decisions=len(masks) * options.seeds * config.decisions, tests=2 * len(masks) * options.seeds * options.tests,
    )  # fmt: skip
    rows = []
    for budget, bounded in masks:
        run = experiment(
            world, bv="uniform", bounded=bounded, budget=budget, takes_foreign=True, seed=options.seed,
            budget_of=BUDGETS[0] if budget is None else options.budget_of,
        )  # fmt: skip
        run.keep_printed(folder / AV_LOG)
        runs = tuple(
            _one(folder, run, config, options, options.seed + k, n_threads) for k in range(options.seeds)
        )  # fmt: skip
        rows.append(PlausibilityRow(budget=budget, bounded=bounded, runs=runs))
    result = Plausibility(
        rows=tuple(rows), natural=_natural(natural, options.seed), out=str(folder), tests=options.tests
    )
    write_json(folder / "plausibility.json", as_json(result))
    _draw(folder / "plausibility.png", result, options.budget_of)
    write_json(folder / "provenance.json", provenance(identity, 0.0))
    return result


def _one(
    folder: Path, run: Experiment, config: TrainConfig, options: PlausibilityStudy, train_seed: int, threads: int
) -> PlausibilityRun:
    """Train and measure one policy; keep the result in a file of its own."""
    mask = "unbounded" if not run.bounded else "bounded" if run.budget is None else f"{run.budget:g}"
    done = folder / f"{mask}-{train_seed}.json"
    kept = folder / f"{mask}-{train_seed}.safetensors"
    if done.exists() and kept.exists():
        return from_json(PlausibilityRun, read_json_file(done))
    seed, tests, progress = options.seed, options.tests, options.progress
    policy, result = learn(run, config, seed=train_seed, threads=threads, progress=progress)
    save_policy(policy, kept)
    hostile = experiment(options.world().without_mask(), policy=policy, takes_foreign=True, seed=seed)
    hostile.keep_printed(folder / AV_LOG)
    found = PlausibilityRun(
        train_seed=train_seed,
        decisions=result.decisions,
        seconds=round(result.seconds, 3),
        policy_hash=policy_hash(policy),
        av_faults=training_faults(run),
        **vars(evaluate(hostile, tests=tests, seed=seed, threads=threads, progress=progress)),
        **_likelihood(hostile, tests, seed, threads, progress),
    )
    write_json(done, as_json(found))
    return found


def _likelihood(run: Experiment, tests: int, seed: int, threads: int, progress: Progress) -> dict[str, Any]:
    """Measure how plausible the adversary's actions are in the crashes of the evaluation tests."""
    names = ("log_prob_nde", "n_decisions", "possible_shortfall_nats", "n_implausible")
    parts: list[np.ndarray[Any, Any]] = []
    for done, harvested in harvest_tests(run, seed, EVALUATION_TESTS, tests, threads):
        columns = [harvested.cases.column(name).to_numpy().astype(np.float64) for name in names]
        parts.append(np.stack(columns))
        progress("plausibility", done, tests)
    log_prob, decisions, shortfall, implausible = np.concatenate(parts, axis=1)
    if decisions.size == 0:
        return dict.fromkeys(("log_prob_per_decision", "shortfall_per_test", "implausible_per_test"))
    return {
        "log_prob_per_decision": None if np.isnan(log_prob).any() else float(log_prob.sum() / decisions.sum()),
        "shortfall_per_test": float(shortfall.mean()),
        "implausible_per_test": float(implausible.mean()),
    }


def _natural(run: Experiment, seed: int) -> NaturalPlausibility:
    """Measure how plausible natural drivers are: the BV nearest to the AV in each second, over whole tests."""
    recorder, count = run.recorder(), 0
    log_prob = shortfall = 0.0
    for test in range(EVALUATION_TESTS, EVALUATION_TESTS + _NATURAL_TESTS):
        driven = recorder.record(seed, test)
        count += driven.log_prob_nde.size
        log_prob += float(driven.log_prob_nde.sum())
        # A natural driver may overlook a neighbour, which is impossible for an attentive one.
        falls = np.array(driven.shortfall)
        shortfall += float(falls[np.isfinite(falls)].sum())
    return NaturalPlausibility(
        tests=_NATURAL_TESTS,
        log_prob_per_decision=log_prob / count,
        shortfall_per_test=shortfall / _NATURAL_TESTS,
    )


def _mask_name(row: PlausibilityRow) -> str:
    if row.budget is not None:
        return f"{row.budget:g}"
    return "mask only" if row.bounded else "unbounded"


def _draw(path: Path, result: Plausibility, limits: str) -> None:
    """Draw every policy's yield with its exact interval, on a log scale, from the tightest budget to none.

    Without any crash only the upper end is drawn. `limits`: what budgets limit.
    """
    figure, (panel,) = new_figure(1, 1, 7.2, 4.4)
    rows = result.rows
    for share, (name, ends, label, colour, marker) in enumerate(
        (
            ("crashes_per_test", "interval95", "crashes", BLUE, "o"),
            ("avoidable_per_test", "avoidable_interval95", "avoidable by braking", ORANGE, "s"),
        )
    ):
        for place, row in enumerate(rows):
            known = [(getattr(run, name), *getattr(run, ends)) for run in row.runs]
            for k, (value, low, high) in enumerate(known):
                x = place - 0.3 + (share + (k + 0.5) / len(known)) * 0.3
                panel.plot([x, x], [low if value else high, high], color=colour, linewidth=1.2)
                panel.plot([x], [value or high], marker if value else "v", color=colour, markersize=5,
                           fillstyle="full" if value else "none")  # fmt: skip
        panel.plot([], [], marker, color=colour, label=label)
    panel.plot([], [], "v", color=GREY, fillstyle="none", label="none seen: upper end")
    panel.set_yscale("log")
    panel.set_ylim(top=1.2)
    panel.set_xticks(range(len(rows)), [_mask_name(row) for row in rows])
    spent = result.natural.shortfall_per_test
    about = f"budget of {limits} in a test [nats]; natural drivers fall {spent:.1f} short of the likeliest on average"
    panel.set_xlabel(about, fontsize=9)
    panel.set_ylabel("per test, 95 % interval, each training seed", fontsize=9)
    panel.legend(fontsize=8)
    with writing(path) as part:
        part.write_bytes(png_of(figure))


def plausibility_text(result: Plausibility) -> str:
    """Write one line per budget, with the worst seed's lower limit."""
    natural = result.natural
    lines = [
        f"natural drivers: {natural.log_prob_per_decision:.2f} nats per decision, shortfall "
        f"{natural.shortfall_per_test:.1f} nats per test"
    ]
    for row in result.rows:
        budget = "no budget" if row.budget is None else f"{row.budget:g} nats"
        name = budget if row.bounded else "unbounded"
        rate = min(row.runs, key=lambda run: run.crashes_per_test)
        low = binomial_interval(round(rate.crashes_per_test * rate.tests), rate.tests)[0]
        line = f"{name:>10}: {rate.crashes_per_test:.4f} crashes per test "
        line += f"(worst of {len(row.runs)}; at least {low:.4f})"
        avoidable = [run.avoidable_per_test for run in row.runs if run.avoidable_per_test is not None]
        if len(avoidable) == len(row.runs):
            line += f", {min(avoidable):.4f} avoidable"
        known = [run.log_prob_per_decision for run in row.runs if run.log_prob_per_decision is not None]
        if len(known) == len(row.runs):
            line += f"; {min(known):.2f} nats per decision"
        if rate.shortfall_per_test is not None:
            line += f", shortfall {rate.shortfall_per_test:.1f} per crash"
            line += f", {rate.implausible_per_test:.1f} impossible decisions per crash"
        lines.append(line)
    return "\n".join(lines)
