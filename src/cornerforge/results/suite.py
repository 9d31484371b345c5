"""The result of `suite build`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.rates import Interval
from cornerforge.results.stating import meant

__all__ = ["LeftOutAll", "LeftOutAv", "SuiteAv", "SuiteBuilt"]

_PLACE = "Places among all AVs by crashes per case, suite against all cases; equals share their mean place."


@dataclass(frozen=True, kw_only=True)
class SuiteAv:
    """One AV of the zoo."""

    av: str = field(metadata=meant("The AV."))
    crashes_in_all: float = field(metadata=meant("Its crashes in all cases.", "per case"))
    crashes_in_suite: float = field(metadata=meant("In the suite, driven again from its files.", "per case"))


@dataclass(frozen=True, kw_only=True)
class LeftOutAv:
    """A suite chosen without one AV, asked about that AV."""

    av: str = field(metadata=meant("The AV that was left out."))
    cases: int = field(metadata=meant("Cases of the suite that was chosen without it."))
    found: bool = field(metadata=meant("It crashes in one of them."))
    told_apart: int = field(metadata=meant("AVs that do not crash in a case of them in which it crashes."))
    pairs: int = field(metadata=meant("The same in all cases."))
    share: float = field(metadata=meant("Its crashes in them.", "per case"))
    share_of_all: float = field(metadata=meant("Its crashes in all cases.", "per case"))
    off: float = field(metadata=meant(_PLACE, "places"))
    clear: int = field(metadata=meant("AVs that clearly crash more or less often than it in all cases (McNemar, 5 %)."))
    in_order: int = field(metadata=meant("How many of these are on the same side of it in them."))


@dataclass(frozen=True, kw_only=True)
class LeftOutAll:
    """All AVs left out one at a time, against random sets of as many cases."""

    found: float = field(metadata=meant("Share of the AVs that the suite finds."))
    told_apart: float = field(metadata=meant("`told_apart` over `pairs`, mean of the AVs."))
    share_off: float = field(metadata=meant("Distance of `share` from `share_of_all`, mean of the AVs.", "per case"))
    off: float = field(metadata=meant("`off`, mean of the AVs.", "places"))
    in_order: float = field(metadata=meant("`in_order` over `clear`, mean of the AVs."))
    random_sets: int = field(metadata=meant("Random sets for each AV."))
    random_found: float = field(metadata=meant("`found` of random sets, mean."))
    random_found_range95: Interval = field(metadata=meant("2.5 to 97.5 % of the random sets."))
    random_told_apart: float = field(metadata=meant("`told_apart` of random sets, mean."))
    random_told_apart_range95: Interval = field(metadata=meant("2.5 to 97.5 % of the random sets."))
    random_share_off: float = field(metadata=meant("`share_off` of random sets, mean.", "per case"))
    random_share_off_range95: Interval = field(metadata=meant("2.5 to 97.5 % of the random sets.", "per case"))
    random_off: float = field(metadata=meant("`off` of random sets, mean.", "places"))
    random_off_range95: Interval = field(metadata=meant("2.5 to 97.5 % of the random sets.", "places"))
    random_in_order: float = field(metadata=meant("`in_order` of random sets, mean."))
    random_in_order_range95: Interval = field(metadata=meant("2.5 to 97.5 % of the random sets."))


@dataclass(frozen=True, kw_only=True)
class SuiteBuilt:
    """A suite of cases."""

    cases: int = field(metadata=meant("Cases of the suite."))
    out: str = field(metadata=meant("The suite, itself a case library."))
    candidates: int = field(metadata=meant("Cases that it was chosen from."))
    left_out: int = field(metadata=meant("Further ones in which an AV raised, hung or gave no usable answer."))
    not_again: int = field(
        metadata=meant("Further ones in which the AV that made them does not crash again with others as recorded.")
    )
    findings: int = field(
        metadata=meant("What all cases find: an AV that crashes, or one that crashes where another one does not.")
    )
    findings_in_suite: int = field(metadata=meant("How many of these the suite finds, as it was chosen."))
    clear: int = field(
        metadata=meant("Pairs of AVs of which one clearly crashes more often in all cases (McNemar's test, 5 %).")
    )
    in_order: int = field(metadata=meant("How many of these are in the same order in the suite, as it was chosen."))
    rank_agreement: float | None = field(
        metadata=meant(
            "Kendall's tau-b of the AVs' crashes in the suite, driven again, and in all cases; null: all equal."
        )
    )
    avs: tuple[SuiteAv, ...] = field(metadata=meant("The AVs of the zoo."))
    left_out_avs: tuple[LeftOutAv, ...] = field(metadata=meant("The AVs left out one at a time, that crash at all."))
    left_out_summary: LeftOutAll | None = field(metadata=meant("The same together; null: fewer than two AVs crash."))
    seconds: float = field(metadata=meant("Wall-clock.", "s"))
