"""`rate` measures the AV's natural crash rate with its interval; it keeps every finished block of tests or trees.

The output folder holds `rate.json`, and what `plain` (counting), `splitting` (trees) and `model_draws` keep.
"""

from __future__ import annotations

import importlib.util
import math
import warnings
from dataclasses import replace
from pathlib import Path

from cornerforge._extensions import extension
from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.counting import rate_of
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import code_hash, provenance, version, write_json
from cornerforge.experiment.setting import experiment
from cornerforge.rates.crashes import kind_counts
from cornerforge.rates.monte_carlo import BLOCK, MonteCarlo
from cornerforge.rates.plain import ASKED, ENOUGH_TO_FORESEE, PlainTests, cost_of, kept_if_interrupted
from cornerforge.rates.splitting import TREES, Splitting, kind_rates
from cornerforge.results import NaturalRate, as_json
from cornerforge.results.driving import Effort
from cornerforge.site.laws import ERRORS, Laws
from cornerforge.verbs.options.driving import Rate

__all__ = ["rate", "rate_without_copies", "why_only_counting"]

PLAIN_TESTS = 4 * BLOCK
"""Plain tests that trees begin with: kinds of crash that a network does not know show there, if they are frequent."""
_TREES_TAKE_S = 300.0
TREES_TAKE_TESTS = 1_000_000
"""For an AV from outside: so many plain tests last as long."""
_MANY_TESTS = 10_000_000
_SELDOM = 0.01
"""At a site trees are for errors that are no likelier than this (ADR 86)."""
_NO_CRASH = "no tree found a crash, so rate and interval are those of the plain tests"


@verb(Rate)
def rate(options: Rate) -> NaturalRate:
    """Measure the AV's natural crash rate in 400 m tests, without bias.

    Returns:
        What `cornerforge rate --json` prints: the rate, its precision and cost, and what kinds of crash there were.
        With `doubts` it cannot be trusted yet.

    Raises:
        CornerForgeError: Input, files or output place are not right.
        KeyboardInterrupt: Interrupted; with `out`, all finished blocks are kept.
    """
    return _measured(options, "splitting")


@verb(Rate)
def rate_without_copies(options: Rate) -> NaturalRate:
    """Measure the rate as `rate` does, but where method auto finds counting too slow, by importance sampling.

    That asks an AV from outside no question twice.

    Returns, raises:
        As `rate`.
    """
    return _measured(options, "is")


def _measured(options: Rate, weighted: str) -> NaturalRate:
    """Measure the rate; `weighted`: what method auto does where counting would take too long."""
    if options.resume and options.out is None:
        raise InputError("There is nothing to resume without out; name the folder: --out FOLDER --resume")
    if options.out is None and options.max_tests > _MANY_TESTS:
        warnings.warn(
            f"Nothing of up to {options.max_tests:,} tests survives a stop; --out FOLDER keeps them.", stacklevel=2
        )
    run = experiment(options.world(), takes_foreign=True, seed=options.seed)
    if options.model_draws:
        extension("model draws").check_model_draws(options.model_draws, run.model)
    only_mc = why_only_counting(options.max_tests, run.odd.laws)
    if options.method in ("is", "splitting") and only_mc is not None:
        raise InputError(f"Method {options.method} cannot be used: {only_mc}")
    folder = None if options.out is None else Path(options.out)
    session = PlainTests(run, options.seed, folder, threads=check_threads(options.threads), progress=options.progress)
    identity = {**run.identity(options.seed), "method": options.method, "cornerforge": version(), "code": code_hash()}
    forecast(
        run, options.threads, f"{options.max_tests:,} tests", tests=options.max_tests, bound="up to ",
        advice="If that is too long: --max-tests, or run --hours, which counts as many as fit.",
    )  # fmt: skip
    session.start(identity, resume=options.resume)
    split: Splitting | None = None
    if options.method == "mc" or only_mc is not None:
        session.reason = ASKED if options.method == "mc" else only_mc or ""
        summary = _count(session, options.target_rhw, options.max_tests)
    else:
        with kept_if_interrupted(session):
            state = session.drive(options.target_rhw, PLAIN_TESTS)
        wanted = (
            "plain tests are enough" if state == "target" else _why_counting(run, session.counts, options.target_rhw)
        )
        if options.method == "auto" and wanted is not None:
            session.reason = wanted
            summary = _count(session, options.target_rhw, options.max_tests)
        else:
            reason = _why_trees(session.counts) if options.method == "auto" else ASKED
            split = Splitting(
                run,
                options.seed,
                folder,
                threads=run.processes(options.threads),
                progress=options.progress,
                tilted=(weighted if options.method == "auto" else options.method) == "is",
            )
            summary = _split(session, split, reason, options.target_rhw, options.max_tests)
    summary = replace(summary, target_rhw=options.target_rhw)
    if options.model_draws:
        summary = extension("model draws").with_model_draws(
            summary, run, model_draws=options.model_draws, seed=options.seed, out=folder,
            threads=check_threads(options.threads), progress=options.progress,
            by_trees=None if split is None else split.branching,
        )  # fmt: skip
    if folder is not None:
        write_json(folder / "rate.json", as_json(summary))
        write_json(folder / "provenance.json", provenance(identity, summary.seconds))
    run.rest()  # importing torch may keep this frame, and what it holds, until memory is tidied
    return summary


# Choosing


def why_only_counting(max_tests: int, laws: Laws | None) -> str | None:
    """Say why only counting is possible, by the laws of a site too; None if trees and importance sampling are."""
    if importlib.util.find_spec("torch") is None:
        return 'teaching needs torch; install it with: pip install "cornerforge[learn]"'
    from cornerforge.rates.teaching import TEACHING_TREES

    least = PLAIN_TESTS + TEACHING_TREES + TREES
    if max_tests < least:
        return f"--max-tests is below {least:,}, too few to learn what is dangerous."
    often = [] if laws is None else [name for name in ERRORS if getattr(laws, name) > _SELDOM]
    if often:
        return (
            f"people err in more than {_SELDOM:.0%} of their chances to ({', '.join(often)}), so trees would branch "
            "without end; such crashes are counted soon (--method mc)."
        )
    return None


def _why_counting(run: Experiment, counts: MonteCarlo, target: float) -> str | None:
    """Say why counting is the faster way; None if trees are, or if it is not known."""
    if run.setting.road.stops:
        return "where lanes end or traffic stops, what is dangerous would have to be learned anew, for hours"
    if run.odd.site is not None:
        return "at a site what is dangerous would have to be learned anew, which --method splitting does"
    width = counts.half_width()
    if counts.av_crashes < ENOUGH_TO_FORESEE or width is None:
        return None
    cost, unit = run.cost(counts.cpu_seconds, counts.seconds)
    trees = _TREES_TAKE_S if run.asked is None else cost / counts.valid_tests * TREES_TAKE_TESTS
    takes = cost * (width / target) ** 2
    return None if takes > trees else f"plain tests will take about {takes:.0f} s {unit}, trees {trees:.0f} s or more"


def _why_trees(counts: MonteCarlo) -> str:
    return f"{counts.valid_tests:,} plain tests had {counts.av_crashes} crashes, so counting would take longer"


# Both ways


def _count(session: PlainTests, target: float, max_tests: int) -> NaturalRate:
    """Count to the end."""
    with kept_if_interrupted(session):
        return session.store(session.drive(target, max_tests))


def _split(session: PlainTests, split: Splitting, reason: str, target: float, max_tests: int) -> NaturalRate:
    """Find the rate by trees of tests; if they find no crash, the plain tests' rate and interval stand, in doubt."""
    plain = session.counts
    session.leave_to_trees()
    split.start()
    state = split.drive(target, max(TREES, max_tests - plain.tests - split.taught.tests))
    found = split.rate
    picked = split.picked() if found.rate > 0.0 else []
    mechanisms = kind_rates(picked, "mechanism", found)
    cpu = plain.cpu_seconds + split.taught.cpu_seconds + split.cost.cpu_seconds
    seconds = plain.seconds + split.seconds
    spent, counting = (session.run.cost(*one)[0] for one in ((cpu, seconds), (plain.cpu_seconds, plain.seconds)))
    at_site = session.run.odd.site is not None
    by_trees = rate_of(found.rate, split.interval, found.n, plain.miles, plain.valid_tests, at_site=at_site)
    return NaturalRate(
        **vars(by_trees if picked else session.rate()),
        **session.plain_part(),
        **kind_counts(((crash.crash_type, crash.mechanism) for crash in picked), at_site=at_site),
        method="is" if split.tilted else "splitting",
        reason=reason,
        relative_half_width=split.half_width if picked else None,
        relative_half_width_90=found.half_width_90 if picked else None,
        doubts=split.doubts(plain, session.kinds(), mechanisms) if picked else (_NO_CRASH,),
        effort=Effort(plain=cost_of(plain), teaching=split.taught, estimation=split.cost),
        av_crashes=split.crashes,
        effective_sample_size=round(found.effective),
        largest_share=found.largest if picked else None,
        halves=found.halves,
        tail_index=found.tail if found.tail is None or math.isfinite(found.tail) else None,
        acceleration=found.counted_tests * counting / plain.valid_tests / spent,
        seconds=round(seconds, 3),
        cpu_seconds=round(cpu, 3),
        tests_per_second=round(found.n / split.seconds, 1),
        digest=split.digest,
        state=state if picked else "no crash",
        crash_type_rates=kind_rates(picked, "crash_type", found),
        mechanism_rates=mechanisms,
        crash_circumstances=None,
    )
