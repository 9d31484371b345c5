"""`run` does the whole job in stages; each finished stage leaves a file, so a killed run goes on after it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from cornerforge._checks import check_in
from cornerforge._options import verb
from cornerforge._words import spoken
from cornerforge.errors import InputError
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import identity_in
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.pace import announce
from cornerforge.library.filling import fill_library
from cornerforge.results import RunDone
from cornerforge.verbs.options.whole import STAND_IN, Run
from cornerforge.verbs.rate import PLAIN_TESTS, TREES_TAKE_TESTS, rate, rate_without_copies
from cornerforge.verbs.stages import HOURS, Counted, Job
from cornerforge.verbs.train import evaluate

__all__ = ["EFFORTS", "Effort", "run"]

EXPOSURE_TESTS_START = 1 << 42
"""Number of the first test whose distances and TTC are counted with the adversary."""


@dataclass(frozen=True)
class Effort:
    """The amount of work in a run, as counts, never as seconds, so that results do not depend on speed.

    The natural rate ends at a relative half-width of `natural_rhw`, at the latest after `natural_tests` tests.
    """

    nde_tests: int
    natural_tests: int
    natural_rhw: float
    decisions: int
    evaluation_tests: int
    exposure_tests: int
    cases: int


EFFORTS = {
    "quick": Effort(
        nde_tests=65_536, natural_tests=716_000, natural_rhw=0.3, decisions=2_500_000, evaluation_tests=2_048,
        exposure_tests=1_024, cases=1_500,
    ),
    "standard": Effort(
        nde_tests=1_000_000, natural_tests=3_000_000, natural_rhw=0.15, decisions=6_000_000, evaluation_tests=8_192,
        exposure_tests=4_096, cases=10_000,
    ),
    "paper": Effort(
        nde_tests=10_000_000, natural_tests=10_000_000, natural_rhw=0.1, decisions=20_000_000, evaluation_tests=8_192,
        exposure_tests=8_192, cases=50_000,
    ),
}  # fmt: skip
"""quick: within 4 minutes on two cores, several times that with an AV from outside, however fast it answers; standard:
within 15; paper: as many cases as the paper had (about 50,000)."""
FIRST_PAGE_HOURS = 0.16
"""A run of a slow AV, without an effort asked for, has its page after so long."""
_OUTSIDE = 0.85
"""Share of `natural_tests` that an AV from outside drives, which is asked in all of them."""


class _ByEffort(Job):
    """The whole job, as much of it as an effort counts."""

    def __init__(self, options: Run) -> None:
        self.effort = check_in("effort", options.effort or "quick", tuple(EFFORTS))
        super().__init__(options)
        self._size = size = EFFORTS[self.effort]
        self.mask = experiment(self.world, bv="uniform", takes_foreign=True, seed=self.seed)
        asked = self.natural.asked is not None
        self._rate = rate_without_copies if asked else rate
        self._natural_tests = round(_OUTSIDE * size.natural_tests) if asked else size.natural_tests
        self.settings = {"effort": asdict(size), "train": asdict(self.learning(size.decisions))}

    def _work(self, natural_tests: int) -> dict[str, float]:
        """Count the tests and decisions of all of it, with so many for the natural rate."""
        size = self._size
        tests = size.nde_tests + natural_tests + 8 * size.evaluation_tests + size.exposure_tests
        return {"tests": tests, "decisions": size.decisions}

    def announce(self) -> None:
        forecast(
            self.natural, self.options.threads, "all that this effort asks for",
            **self._work(min(self._natural_tests, PLAIN_TESTS)), bound="at least ",
            advice="If that is too long: --hours H does what fits into H hours.",
        )  # fmt: skip

    def first_hours(self) -> float | None:
        """Say how many hours to spend for a first page, where no effort was asked for; None: all that the effort is.

        A run that is resumed does as it did before.
        """
        if self.options.effort is not None or self.natural.asked is None:
            return None
        before = identity_in(self.folder).get("effort") if self.options.resume else None
        if isinstance(before, str):
            return float(before.removesuffix(HOURS)) if before.endswith(HOURS) else None
        seconds = self.natural.seconds_of(self.options.threads, **self._work(PLAIN_TESTS + TREES_TAKE_TESTS))
        if seconds <= 3600.0 * FIRST_PAGE_HOURS:
            return None
        announce(
            f"The quick effort would take about {spoken(seconds)} with this AV. So that there is a page after "
            f"{spoken(3600.0 * FIRST_PAGE_HOURS)}, this run does what fits into that time, as --hours "
            f"{FIRST_PAGE_HOURS:g} does. For all of it: --effort quick."
        )
        for run in (self.natural, self.mask):
            run.rest()
        return FIRST_PAGE_HOURS

    def works(self) -> dict[str, Callable[[], Any]]:
        size, tests, reward = self._size, self._size.evaluation_tests, self.options.reward
        library = self.folder / "library"
        return {
            "nde": self._drive,
            "natural": lambda: self.rate(self._natural_tests, by=self._rate, target_rhw=size.natural_rhw),
            "train": lambda: self.train(self.mask, size.decisions),
            "evaluate": lambda: evaluate(self.hostile, tests=tests, reward=reward, **self.how),
            "baselines": lambda: self.plain_rates(self.mask, tests),
            "exposure": lambda: self.count(self.hostile, size.exposure_tests, EXPOSURE_TESTS_START, "exposure"),
            "generate": lambda: fill_library(self.hostile, library, cases=size.cases, resume=True, **self.how),
        }

    def _drive(self) -> Counted:
        counted = self.count(self.natural, self._size.nde_tests, 0, "natural traffic")
        self.natural.rest()
        return counted


@verb(Run)
def run(options: Run) -> RunDone:
    """Do the whole job: natural traffic, natural crash rate, training, cases, analyses, report.

    Returns:
        What `cornerforge run --json` prints, and `summary.json` holds: the result of each stage.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    if options.hours is None:
        if options.stand_in != STAND_IN:
            raise InputError(
                f"stand_in = {options.stand_in!r} has no effect without hours: --hours H --stand-in {options.stand_in}"
            )
        job = _ByEffort(options)
        hours = job.first_hours()
        if hours is None:
            return job.do(numbered=True)
    elif options.effort is not None:
        raise InputError(f"effort = {options.effort} and hours = {options.hours:g} exclude each other; leave one out.")
    else:
        hours = options.hours
    from cornerforge.verbs.spend import spend

    return spend(options, hours)
