"""The result of `retest`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.html import Result
from cornerforge.results.rates import Interval

__all__ = ["Compared", "Difference", "Retested", "RetestedCase"]

_DIFFERENCE = "Crashes of the AV minus crashes of the baseline; above 0: it crashes more often."

_PICKED = "null: the tests were picked because an AV crashed in them, so another one can hardly do worse."


class Difference(Result):
    """How two AVs differ in the same tests."""

    fixed: Annotated[Whole, meant("Tests in which only the baseline crashed.")]
    still_crashing: Annotated[Whole, meant("Tests in which both crashed.")]
    new_crashes: Annotated[Whole, meant("Tests in which only the AV crashed.")]
    rate_difference: Annotated[float | None, meant(f"{_DIFFERENCE} {_PICKED}", "per test")]
    interval95: Annotated[
        Interval | None, meant("Of `rate_difference` (Agresti and Min 2005); null with it.", "per test")
    ]


class Compared(Difference):
    """Two AVs in the same tests."""

    tests: Annotated[Whole, meant("Tests, or cases, that both drove.")]
    rounded: Annotated[
        Whole,
        meant(
            "Cases in which the same AV does not crash again, by the rounding of their scripts (docs/adr/0040); 0 of "
            "another AV, whose are `fixed`."
        ),
    ]
    left_out: Annotated[Whole, meant("Further ones in which an AV raised, hung or gave no usable answer.")]
    baseline_crashes: Annotated[Whole, meant("Of the baseline.")]
    av_crashes: Annotated[Whole, meant("Of the AV.")]
    verdict: Annotated[
        str | None,
        meant(
            'Of a sequential test: "worse" or "better" (wrong at most 1 in 20 times), "alike" (within a factor of two, '
            'wrong at most 1 in 10 times), or "open"; null with `rate_difference`.'
        ),
    ]
    verdict_after: Annotated[
        Whole | None, meant("Tests after which it was clear, all of them if it is open; null with `verdict`.")
    ]


class RetestedCase(Result):
    """Outcome of one case."""

    case: Annotated[str, meant("Case id, or name of the case file.")]
    recorded: Annotated[
        str, meant('Others as recorded: "fixed", "rounded", "still crashing", "new", "never" or "failed".')
    ]
    reacting: Annotated[str | None, meant("Others who react: the same; null: the case is no test of a seed.")]
    striker: Annotated[
        str | None,
        meant("Who strikes in the crash of the AV: av, bv or mutual; null: no crash, or the case of a library."),
    ]
    words: Annotated[
        str | None, meant("What happened with the AV, in words; null: it failed, or the case of a library.")
    ]
    failure: Annotated[
        str | None, meant("How the AV (not the baseline) failed; null: it did not, or the case of a library.")
    ]


class Retested(Difference):
    """Another AV in the cases of a library. What differs is of `reacting`, or of `recorded` where there is none."""

    library: Annotated[str, meant("The library, or the case files.")]
    av: Annotated[str, meant("The AV.")]
    baseline: Annotated[str, meant("What it is compared with.")]
    cases: Annotated[Whole, meant("Cases of the library.")]
    same_av: Annotated[
        bool, meant("The AV is the one that made the library, without another baseline; false for case files.")
    ]
    got_worse: Annotated[
        bool,
        meant(
            'Is a verdict "worse", or is there a case file with a new crash, or in which the AV failed? Then the exit '
            "status is 1."
        ),
    ]
    note: Annotated[str | None, meant("What a reader must know about the tests; null: nothing.")]
    recorded: Annotated[Compared, meant("The cases, others as recorded.")]
    reacting: Annotated[
        Compared | None, meant("All tests of the library, others who react; null: its cases are no tests of a seed.")
    ]
    natural: Annotated[Compared | None, meant("Natural tests; null: none were asked for.")]
    each: Annotated[tuple[RetestedCase, ...], meant("Case by case.")]
    seconds: Annotated[float, meant("Wall-clock.", "s")]
