"""The result of `analyse`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from cornerforge.results.rates import Interval
from cornerforge.results.stating import meant, share

__all__ = [
    "FAULTS",
    "PARTS",
    "Analysed",
    "AtFault",
    "Avoidability",
    "Cluster",
    "ClusterChoice",
    "Coverage",
    "CrashType",
    "FlawShown",
    "Judges",
    "Natural",
    "NaturalKind",
    "OwnDoing",
    "Prevented",
    "PreventedShare",
    "ShareAtReaction",
    "TopCase",
    "ValueFound",
]

AtFault = Literal["av", "bv", "both", "none"]
FAULTS: tuple[AtFault, ...] = get_args(AtFault)
"""Which vehicles broke a rule of RSS."""
CrashType = Literal["rear-end by AV", "rear-end by BV", "head-on", "sideswipe", "angle"]
"""Types 1 to 5 of the paper's Figure 4."""
PARTS = ("own_doing", "avoidability", "severity", "novelty")
"""Parts of the value of a case; fields of `TopCase`."""

_CASES = meant("Cases that were analysed.")


@dataclass(frozen=True, kw_only=True)
class Cluster:
    """One K-means cluster of the majority or the minority."""

    id: int = field(metadata=meant("From 0: the majority's clusters by size, then the minority's."))
    group: str = field(metadata=meant('"majority" or "minority".'))
    size: int = field(metadata=meant("Cases in it."))
    typical: tuple[str, ...] = field(metadata=meant("Up to three case ids, nearest to the centre first."))
    crash_types: dict[str, int] = field(metadata=meant("Cases by crash type, only those that occur."))


@dataclass(frozen=True, kw_only=True)
class ClusterChoice:
    """Why a group has as many clusters as it has."""

    k: int = field(metadata=meant("Number of clusters, 1 to 8."))
    silhouettes: dict[str, float] = field(
        metadata=meant("Mean silhouette by number of clusters, -1 to 1; empty where the group is too small to ask.")
    )
    bound: float | None = field(
        metadata=meant("What the largest must exceed, else there is one cluster; null where there are none.")
    )


@dataclass(frozen=True, kw_only=True)
class Avoidability:
    """Shares of the drawn cases with a way out."""

    cases: int = field(metadata=meant("Cases drawn, for which a way out was searched."))
    reaction_s: float = field(metadata=meant("Time that the AV needs to react.", "s"))
    labels: dict[str, int] = field(metadata=meant("Drawn cases by the kind of way out, zeros included."))
    not_judged: int = field(metadata=meant("Drawn cases without a label."))
    avoidable_share: float = field(metadata=share("Share of the drawn cases with a way out, 0 to 1."))
    interval95: Interval = field(metadata=meant("Exact interval of `avoidable_share`."))
    median_time_to_react_s: float | None = field(
        metadata=meant(
            "Median of the time from the manoeuvre's begin to the last way out; negative: before it; null: no way out.",
            "s",
        )
    )


@dataclass(frozen=True, kw_only=True)
class PreventedShare:
    """How many crashes a reference driver would have prevented."""

    cases: int = field(metadata=meant("Cases that it would have prevented."))
    share: float = field(metadata=share("Of the judged cases, 0 to 1."))
    interval95: Interval = field(metadata=meant("Exact interval of `share`."))
    by_braking: int = field(metadata=meant("Of `cases` those in which holding the speed is not enough."))


@dataclass(frozen=True, kw_only=True)
class Prevented:
    """Crashes that reference drivers would have prevented in the AV's place (docs/adr/0039)."""

    cases: int = field(metadata=meant("Cases that were judged."))
    by: dict[str, PreventedShare] = field(metadata=meant("By reference driver."))
    any: PreventedShare = field(metadata=meant("By at least one of them."))
    held: int = field(metadata=meant("Cases in which holding the speed is enough, whoever drives."))


@dataclass(frozen=True, kw_only=True)
class ShareAtReaction:
    """How many of the cases a judge calls preventable at one reaction time."""

    reaction_s: float = field(metadata=meant("From the begin of the manoeuvre, or from seeing danger.", "s"))
    cases: int = field(metadata=meant("Cases that could have been prevented."))
    share: float = field(metadata=share("Of the cases that were compared, 0 to 1."))
    interval95: Interval = field(metadata=meant("Exact interval of `share`."))


@dataclass(frozen=True, kw_only=True)
class Judges:
    """The judges against each other on the drawn cases (docs/adr/0044): reference drivers, ways out, a held speed."""

    cases: int = field(metadata=meant("Cases drawn that all of them judged."))
    both: dict[str, dict[str, int]] = field(
        metadata=meant("Cases that two judges both call preventable; of one with itself: that it calls so.")
    )
    agreement: dict[str, dict[str, float]] = field(
        metadata=meant("Share of the cases of which two judges say the same, 0 to 1.")
    )
    avoidable: tuple[ShareAtReaction, ...] = field(
        metadata=meant("Cases with a way out that may begin so long after the manoeuvre began, or later.")
    )
    lead: ShareAtReaction = field(
        metadata=meant("The one of `avoidable` that is told first: with the reaction time that the user gave, or 1 s.")
    )
    prevented: dict[str, tuple[ShareAtReaction, ...]] = field(
        metadata=meant(
            "By reference driver: cases that it would have prevented, had it braked so long after it saw danger; what "
            "it calls danger stays as it is."
        )
    )


@dataclass(frozen=True, kw_only=True)
class FlawShown:
    """A flaw of the AV that its crashes show."""

    flaw: str = field(metadata=meant("Its name, of `analysis.flaw.FLAWS`."))
    cases: int = field(metadata=meant("Cases that show it."))
    share: float = field(
        metadata=share("Of all crashes, 0 to 1; of natural cases by how often each happens, else of their number.")
    )
    interval95: Interval = field(
        metadata=meant("Interval of `share`; of natural cases that of its rate over the rate of all (chance only).")
    )
    typical: tuple[str, ...] = field(metadata=meant("Up to five case ids that show it, most valuable first."))


@dataclass(frozen=True, kw_only=True)
class OwnDoing:
    """The AV's own mistakes (docs/adr/0041)."""

    text: str = field(metadata=meant("What it does wrong, in a sentence; or that nothing was found."))
    flaws: tuple[FlawShown, ...] = field(metadata=meant("Flaws that stand out, largest share first; empty: none does."))
    conducts: dict[str, int] = field(metadata=meant("Cases by what the AV did wrong in them, only those that occur."))


@dataclass(frozen=True, kw_only=True)
class TopCase:
    """A case that is worth a look, with the parts of its value (docs/adr/0017)."""

    case_id: str = field(metadata=meant("Name of the case, seed:test."))
    value: float = field(metadata=share("Weighted mean of its parts, 0 to 1."))
    own_doing: float = field(metadata=share("Part of the value, 0 to 1."))
    avoidability: float = field(metadata=share("Part of the value, 0 to 1."))
    severity: float = field(metadata=share("Part of the value, 0 to 1."))
    novelty: float = field(metadata=share("Part of the value, 0 to 1."))
    crash_type: str = field(metadata=meant("Name of its crash type."))
    fault: AtFault | None = field(metadata=meant("Who is at fault by RSS; null: not judged."))
    prevented_by: str | None = field(
        default=None,
        metadata=meant('Reference drivers that would have prevented it, or "nobody"; missing: nobody looked.'),
    )
    held_speed_prevents: bool | None = field(
        default=None, metadata=meant("Would holding the speed have been enough? Missing: nobody looked.")
    )
    conduct: str | None = field(
        default=None,
        metadata=meant('What the AV did wrong, of `analysis.conduct.CONDUCTS`, or "none"; missing: nobody looked.'),
    )
    text: str = field(metadata=meant("What happened, in a sentence."))


@dataclass(frozen=True, kw_only=True)
class ValueFound:
    """Case to look at first."""

    weights: dict[str, float] = field(metadata=meant("Weight of each part of a value; they sum to 1."))
    top: tuple[TopCase, ...] = field(metadata=meant("Up to ten cases, most valuable first."))


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """Kinds of crash that were seen, and how likely the next case is of a new one."""

    cases: int = field(metadata=meant("Cases that were put into cells."))
    axes: dict[str, tuple[str, ...]] = field(metadata=meant("Axes of the grid, each with its labels."))
    cells: dict[str, int] = field(metadata=meant("Cases of each filled cell, fullest first."))
    empty: tuple[str, ...] = field(metadata=meant("Names of the empty cells."))
    discovery_curve: tuple[tuple[float, float], ...] = field(
        metadata=meant("Number of cases, and kinds that so many show on average.")
    )
    unseen_kind_chance: float = field(
        metadata=share("Chance that the next case is of a new kind (Good-Turing), 0 to 1.")
    )
    unseen_kind_interval95: Interval = field(metadata=meant("Interval of `unseen_kind_chance`."))


@dataclass(frozen=True, kw_only=True)
class NaturalKind:
    """How often crashes of one kind happen in natural traffic."""

    cases: int = field(metadata=meant("Cases of this kind."))
    share: float = field(metadata=share("Share of all natural crashes, 0 to 1."))
    crashes_per_test: float = field(metadata=meant("How often it happens.", "per test"))
    interval95: Interval = field(metadata=meant("Its interval (Fay and Feuer); it covers chance only.", "per test"))
    miles_between: float = field(metadata=meant("Miles of the AV from one to the next, at full test length.", "miles"))
    interval95_miles: Interval = field(metadata=meant("Interval of `miles_between`.", "miles"))


@dataclass(frozen=True, kw_only=True)
class Natural:
    """How often the crashes of a library happen in natural traffic; each dictionary begins with the most frequent."""

    effective_cases: float = field(metadata=meant("Cases that would tell as much if all weighed the same."))
    all: NaturalKind = field(metadata=meant("All crashes of the AV."))
    clusters: dict[str, NaturalKind] = field(metadata=meant("By `id` of the cluster."))
    crash_types: dict[str, NaturalKind] = field(metadata=meant("By crash type."))
    mechanisms: dict[str, NaturalKind] = field(
        metadata=meant("By what led to it; empty if the library does not say so.")
    )
    fault: dict[str, NaturalKind] = field(metadata=meant("By who is at fault (RSS)."))
    avoidable: NaturalKind | None = field(
        metadata=meant(
            "Those with a way out that may begin `avoidable_after_s` after the manoeuvre began, or later, from the "
            "cases drawn for it; null: none was, or none had one."
        )
    )
    avoidable_after_s: float | None = field(
        default=None,
        metadata=meant(
            "Time to react that `avoidable` leaves the AV; missing in files of earlier versions, where 0.", "s"
        ),
    )
    prevented_by: dict[str, NaturalKind] | None = field(
        default=None,
        metadata=meant(
            "What each reference driver would have prevented, and as `NAME, by braking` where holding the speed is not "
            "enough; missing in files of earlier versions."
        ),
    )
    conducts: dict[str, NaturalKind] | None = field(
        default=None,
        metadata=meant('By what the AV did wrong, "none" among them; missing in files of earlier versions.'),
    )
    serious_injuries: NaturalKind = field(
        metadata=meant("Crashes in which somebody in the AV is seriously injured (MAIS 3 or more), from its chance.")
    )


@dataclass(frozen=True, kw_only=True)
class Analysed:
    """Kinds of crash in a library, typical and rare cases, and what each is worth."""

    cases: int = field(metadata=_CASES)
    steps: int = field(metadata=meant("Seconds before the crash that the features cover, 1 to 15.", "s"))
    features: tuple[str, ...] = field(metadata=meant("Names of the features."))
    padded: int = field(metadata=meant("Cases shorter than `steps`, which repeat their earliest recorded second."))
    excluded: int = field(metadata=meant("Cases shorter than `steps` that were left out."))
    explained_variance: tuple[float, ...] = field(metadata=meant("Share of variance of each principal component."))
    loadings: dict[str, tuple[float, ...]] = field(metadata=meant("By feature, its weight in each component."))
    eps: float | None = field(
        metadata=meant("Radius of DBSCAN, in the plane of the components; null: there was no split.")
    )
    min_samples: int | None = field(
        metadata=meant("Cases within `eps`, itself included, that make a core; null: there was no split.")
    )
    majority: int = field(metadata=meant("Cases that DBSCAN calls dense."))
    minority: int = field(metadata=meant("The other cases."))
    clusters: tuple[Cluster, ...] = field(metadata=meant("Clusters, the majority's first."))
    choices: dict[str, ClusterChoice] = field(metadata=meant("By group, why it has so many clusters."))
    rare: tuple[str, ...] = field(metadata=meant("Up to ten case ids of outliers, farthest first."))
    crash_types: dict[CrashType, int] = field(metadata=meant("Cases by crash type, zeros included."))
    striker: dict[str, int] = field(metadata=meant("Cases by who struck: av, bv or mutual."))
    seconds: dict[str, float] = field(metadata=meant("Wall-clock by stage, and `total`.", "s"))
    note: str | None = field(default=None, metadata=meant("Why there was no split; only then."))
    fault: dict[AtFault, int] = field(metadata=meant("Cases by who is at fault (RSS), only those that occur."))
    fault_rules: dict[str, int] = field(metadata=meant("Cases by the rule that was broken, only those that occur."))
    severity: dict[str, dict[str, float]] = field(
        metadata=meant("By measure, its 5, 50, 95 and 99 % quantiles.", "as its name says")
    )
    avoidability: Avoidability | None = field(metadata=meant("Ways out; null: none was searched."))
    prevented: Prevented | None = field(
        default=None,
        metadata=meant("What reference drivers would have prevented; missing in files of earlier versions."),
    )
    judges: Judges | None = field(
        default=None,
        metadata=meant("The judges against each other; missing: no ways out were searched, or an earlier version."),
    )
    own_doing: OwnDoing | None = field(
        default=None, metadata=meant("What the AV itself does wrong; missing in files of earlier versions.")
    )
    value: ValueFound = field(metadata=meant("Cases that are worth a look."))
    coverage: Coverage = field(metadata=meant("Kinds that were seen."))
    natural: Natural | None = field(
        default=None, metadata=meant("Natural rates; missing if the cases come from an adversary, which has none.")
    )
    purpose: str | None = field(
        default=None,
        metadata=meant(
            'What comes first: "road", what happens most; "attack", most valued. Missing in files of earlier versions.'
        ),
    )
