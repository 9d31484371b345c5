"""The result of `suite build`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Share, Whole, meant
from cornerforge.results.html import Result
from cornerforge.results.rates import Interval

__all__ = ["LeftOutAll", "LeftOutAv", "SuiteAv", "SuiteBuilt"]

_PLACE = "Places among all AVs by crashes per case, suite against all cases; equals share their mean place."


class SuiteAv(Result):
    """One AV of the zoo."""

    av: Annotated[str, meant("The AV.")]
    crashes_in_all: Annotated[float, meant("Its crashes in all cases.", "per case")]
    crashes_in_suite: Annotated[float, meant("In the suite, driven again from its files.", "per case")]


class LeftOutAv(Result):
    """A suite chosen without one AV, asked about that AV."""

    av: Annotated[str, meant("The AV that was left out.")]
    cases: Annotated[Whole, meant("Cases of the suite that was chosen without it.")]
    found: Annotated[bool, meant("It crashes in one of them.")]
    told_apart: Annotated[Whole, meant("AVs that do not crash in a case of them in which it crashes.")]
    pairs: Annotated[Whole, meant("The same in all cases.")]
    share: Annotated[float, meant("Its crashes in them.", "per case")]
    share_of_all: Annotated[float, meant("Its crashes in all cases.", "per case")]
    off: Annotated[float, meant(_PLACE, "places")]
    clear: Annotated[Whole, meant("AVs that clearly crash more or less often than it in all cases (McNemar, 5 %).")]
    in_order: Annotated[Whole, meant("How many of these are on the same side of it in them.")]
    apfd: Annotated[
        Share | None,
        meant(
            "How early they show, in their order, what they show of it (APFD, 0 to 1); null: they show nothing of it."
        ),
    ]


class LeftOutAll(Result):
    """All AVs left out one at a time, against random sets of as many cases."""

    found: Annotated[float, meant("Share of the AVs that the suite finds.")]
    told_apart: Annotated[float, meant("`told_apart` over `pairs`, mean of the AVs.")]
    share_off: Annotated[float, meant("Distance of `share` from `share_of_all`, mean of the AVs.", "per case")]
    off: Annotated[float, meant("`off`, mean of the AVs.", "places")]
    in_order: Annotated[float, meant("`in_order` over `clear`, mean of the AVs.")]
    random_sets: Annotated[Whole, meant("Random sets for each AV.")]
    random_found: Annotated[float, meant("`found` of random sets, mean.")]
    random_found_range95: Annotated[Interval, meant("2.5 to 97.5 % of the random sets.")]
    random_told_apart: Annotated[float, meant("`told_apart` of random sets, mean.")]
    random_told_apart_range95: Annotated[Interval, meant("2.5 to 97.5 % of the random sets.")]
    random_share_off: Annotated[float, meant("`share_off` of random sets, mean.", "per case")]
    random_share_off_range95: Annotated[Interval, meant("2.5 to 97.5 % of the random sets.", "per case")]
    random_off: Annotated[float, meant("`off` of random sets, mean.", "places")]
    random_off_range95: Annotated[Interval, meant("2.5 to 97.5 % of the random sets.", "places")]
    random_in_order: Annotated[float, meant("`in_order` of random sets, mean.")]
    random_in_order_range95: Annotated[Interval, meant("2.5 to 97.5 % of the random sets.")]
    apfd: Annotated[
        Share | None, meant("Mean `apfd` of the AVs of which the suite shows something, 0 to 1; null: of none.")
    ]
    random_apfd: Annotated[Share | None, meant("The same in as many random orders, mean, 0 to 1; null: likewise.")]
    random_apfd_range95: Annotated[Interval | None, meant("2.5 to 97.5 % of the random orders; null: likewise.")]


class SuiteBuilt(Result):
    """A suite of cases."""

    cases: Annotated[Whole, meant("Cases of the suite.")]
    out: Annotated[str, meant("The suite, itself a case library.")]
    candidates: Annotated[Whole, meant("Cases that it was chosen from.")]
    left_out: Annotated[Whole, meant("Further ones in which an AV raised, hung or gave no usable answer.")]
    not_again: Annotated[
        Whole, meant("Further ones in which the AV that made them does not crash again with others as recorded.")
    ]
    findings: Annotated[
        Whole, meant("What all cases find: an AV that crashes, or one that crashes where another one does not.")
    ]
    findings_in_suite: Annotated[Whole, meant("How many of these the suite finds, as it was chosen.")]
    cases_needed: Annotated[Whole, meant("So many of its first cases find all of these.")]
    random_cases_needed: Annotated[float, meant("The same of all cases in 200 random orders, mean.", "cases")]
    random_cases_needed_range95: Annotated[Interval, meant("2.5 to 97.5 % of the random orders.", "cases")]
    clear: Annotated[
        Whole, meant("Pairs of AVs of which one clearly crashes more often in all cases (McNemar's test, 5 %).")
    ]
    in_order: Annotated[Whole, meant("How many of these are in the same order in the suite, as it was chosen.")]
    rank_agreement: Annotated[
        float | None,
        meant("Kendall's tau-b of the AVs' crashes in the suite, driven again, and in all cases; null: all equal."),
    ]
    avs: Annotated[tuple[SuiteAv, ...], meant("The AVs of the zoo.")]
    left_out_avs: Annotated[tuple[LeftOutAv, ...], meant("The AVs left out one at a time, that crash at all.")]
    left_out_summary: Annotated[LeftOutAll | None, meant("The same together; null: fewer than two AVs crash.")]
    seconds: Annotated[float, meant("Wall-clock.", "s")]
