"""The result of `retest`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.rates import Interval
from cornerforge.results.stating import meant

__all__ = ["Compared", "Difference", "Retested", "RetestedCase"]

_DIFFERENCE = "Crashes of the AV minus crashes of the baseline; above 0: it crashes more often."

_PICKED = "null: the tests were picked because an AV crashed in them, so another one can hardly do worse."


@dataclass(frozen=True, kw_only=True)
class Difference:
    """How two AVs differ in the same tests."""

    fixed: int = field(metadata=meant("Tests in which only the baseline crashed."))
    still_crashing: int = field(metadata=meant("Tests in which both crashed."))
    new_crashes: int = field(metadata=meant("Tests in which only the AV crashed."))
    rate_difference: float | None = field(metadata=meant(f"{_DIFFERENCE} {_PICKED}", "per test"))
    interval95: Interval | None = field(
        metadata=meant("Of `rate_difference` (Agresti and Min 2005); null with it.", "per test")
    )


@dataclass(frozen=True, kw_only=True)
class Compared(Difference):
    """Two AVs in the same tests."""

    tests: int = field(metadata=meant("Tests, or cases, that both drove."))
    left_out: int = field(metadata=meant("Further ones in which an AV raised, hung or gave no usable answer."))
    baseline_crashes: int = field(metadata=meant("Of the baseline."))
    av_crashes: int = field(metadata=meant("Of the AV."))
    verdict: str | None = field(
        metadata=meant(
            'Of a sequential test: "worse" or "better" (wrong at most 1 in 20 times), "alike" (within a factor of two, '
            'wrong at most 1 in 10 times), or "open"; null with `rate_difference`.'
        )
    )
    verdict_after: int | None = field(
        metadata=meant("Tests after which it was clear, all of them if it is open; null with `verdict`.")
    )


@dataclass(frozen=True, kw_only=True)
class RetestedCase:
    """Outcome of one case."""

    case: str = field(metadata=meant("Case id, or name of the case file."))
    recorded: str = field(metadata=meant('Others as recorded: "fixed", "still crashing", "new", "never" or "failed".'))
    reacting: str | None = field(metadata=meant("Others who react: the same; null: the case is no test of a seed."))
    striker: str | None = field(
        metadata=meant(
            "Who strikes in the crash of the AV: av, bv or mutual; null: no crash, or the case of a library."
        )
    )
    words: str | None = field(
        metadata=meant("What happened with the AV, in words; null: it failed, or the case of a library.")
    )
    failure: str | None = field(
        metadata=meant("How the AV (not the baseline) failed; null: it did not, or the case of a library.")
    )


@dataclass(frozen=True, kw_only=True)
class Retested(Difference):
    """Another AV in the cases of a library. What differs is of `reacting`, or of `recorded` where there is none."""

    library: str = field(metadata=meant("The library, or the case files."))
    av: str = field(metadata=meant("The AV."))
    baseline: str = field(metadata=meant("What it is compared with."))
    cases: int = field(metadata=meant("Cases of the library."))
    got_worse: bool = field(
        metadata=meant(
            'Is a verdict "worse", or is there a case file with a new crash, or in which the AV failed? Then the exit '
            "status is 1."
        )
    )
    note: str | None = field(metadata=meant("What a reader must know about the tests; null: nothing."))
    recorded: Compared = field(metadata=meant("The cases, others as recorded."))
    reacting: Compared | None = field(
        metadata=meant("All tests of the library, others who react; null: its cases are no tests of a seed.")
    )
    natural: Compared | None = field(metadata=meant("Natural tests; null: none were asked for."))
    each: tuple[RetestedCase, ...] = field(metadata=meant("Case by case."))
    seconds: float = field(metadata=meant("Wall-clock.", "s"))
