"""The result of `analyse`."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from cornerforge._schema import Share, Whole, meant
from cornerforge.results.html import Result
from cornerforge.results.rates import Interval

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


class Cluster(Result):
    """One K-means cluster of the majority or the minority."""

    id: Annotated[Whole, meant("From 0: the majority's clusters by size, then the minority's.")]
    group: Annotated[str, meant('"majority" or "minority".')]
    size: Annotated[Whole, meant("Cases in it.")]
    typical: Annotated[tuple[str, ...], meant("Up to three case ids, nearest to the centre first.")]
    crash_types: Annotated[dict[str, Whole], meant("Cases by crash type, only those that occur.")]


class ClusterChoice(Result):
    """Why a group has as many clusters as it has."""

    k: Annotated[Whole, meant("Number of clusters, 1 to 8.")]
    silhouettes: Annotated[
        dict[str, float],
        meant("Mean silhouette by number of clusters, -1 to 1; empty where the group is too small to ask."),
    ]
    bound: Annotated[
        float | None, meant("What the largest must exceed, else there is one cluster; null where there are none.")
    ]


class Avoidability(Result):
    """Shares of the drawn cases with a way out."""

    cases: Annotated[Whole, meant("Cases drawn, for which a way out was searched.")]
    reaction_s: Annotated[float, meant("Time that the AV needs to react.", "s")]
    labels: Annotated[dict[str, Whole], meant("Drawn cases by the kind of way out, zeros included.")]
    not_judged: Annotated[Whole, meant("Drawn cases without a label.")]
    avoidable_share: Annotated[Share, meant("Share of the drawn cases with a way out, 0 to 1.")]
    interval95: Annotated[Interval, meant("Exact interval of `avoidable_share`.")]
    median_time_to_react_s: Annotated[
        float | None,
        meant(
            "Median of the time from the manoeuvre's begin to the last way out; negative: before it; null: no way out.",
            "s",
        ),
    ]


class PreventedShare(Result):
    """How many crashes a reference driver would have prevented."""

    cases: Annotated[Whole, meant("Cases that it would have prevented.")]
    share: Annotated[Share, meant("Of the judged cases, 0 to 1.")]
    interval95: Annotated[Interval, meant("Exact interval of `share`.")]
    by_braking: Annotated[Whole, meant("Of `cases` those in which holding the speed is not enough.")]


class Prevented(Result):
    """Crashes that reference drivers would have prevented in the AV's place (docs/adr/0039)."""

    cases: Annotated[Whole, meant("Cases that were judged.")]
    by: Annotated[dict[str, PreventedShare], meant("By reference driver.")]
    any: Annotated[PreventedShare, meant("By at least one of them.")]
    held: Annotated[Whole, meant("Cases in which holding the speed is enough, whoever drives.")]
    careful: Annotated[
        PreventedShare | None,
        meant(
            "By a careful driver (docs/adr/0069): at least three of the four by braking, or by leaving out a mistake "
            "that the AV began; missing in files of earlier versions."
        ),
    ] = None


class ShareAtReaction(Result):
    """How many of the cases a judge calls preventable at one reaction time."""

    reaction_s: Annotated[float, meant("From the begin of the manoeuvre, or from seeing danger.", "s")]
    cases: Annotated[Whole, meant("Cases that could have been prevented.")]
    share: Annotated[Share, meant("Of the cases that were compared, 0 to 1.")]
    interval95: Annotated[Interval, meant("Exact interval of `share`.")]


class Judges(Result):
    """The judges against each other on the drawn cases (docs/adr/0044): reference drivers, ways out, a held speed."""

    cases: Annotated[Whole, meant("Cases drawn that all of them judged.")]
    both: Annotated[
        dict[str, dict[str, Whole]],
        meant("Cases that two judges both call preventable; of one with itself: that it calls so."),
    ]
    agreement: Annotated[
        dict[str, dict[str, Share]], meant("Share of the cases of which two judges say the same, 0 to 1.")
    ]
    avoidable: Annotated[
        tuple[ShareAtReaction, ...],
        meant("Cases with a way out that may begin so long after the manoeuvre began, or later."),
    ]
    lead: Annotated[
        ShareAtReaction,
        meant("The one of `avoidable` that is told first: with the reaction time that the user gave, or 1 s."),
    ]
    prevented: Annotated[
        dict[str, tuple[ShareAtReaction, ...]],
        meant(
            "By reference driver: cases that it would have prevented, had it braked so long after it saw danger; what "
            "it calls danger stays as it is."
        ),
    ]


class FlawShown(Result):
    """A flaw of the AV that its crashes show."""

    flaw: Annotated[str, meant("Its name, of `analysis.flaw.FLAWS`.")]
    cases: Annotated[Whole, meant("Cases that show it.")]
    share: Annotated[
        Share, meant("Of all crashes, 0 to 1; of natural cases by how often each happens, else of their number.")
    ]
    interval95: Annotated[
        Interval, meant("Interval of `share`; of natural cases that of its rate over the rate of all (chance only).")
    ]
    typical: Annotated[tuple[str, ...], meant("Up to five case ids that show it, most valuable first.")]
    detail: Annotated[
        str | None, meant("What its cases are, if several kinds, and on which side the other was; missing: neither.")
    ] = None


class OwnDoing(Result):
    """The AV's own mistakes (docs/adr/0041)."""

    text: Annotated[str, meant("What it does wrong, in a sentence; or that nothing was found.")]
    flaws: Annotated[tuple[FlawShown, ...], meant("Flaws that stand out, largest share first; empty: none does.")]
    conducts: Annotated[dict[str, Whole], meant("Cases by what the AV did wrong in them, only those that occur.")]


class TopCase(Result):
    """A case that is worth a look, with the parts of its value (docs/adr/0017)."""

    case_id: Annotated[str, meant("Name of the case, seed:test.")]
    value: Annotated[Share, meant("Weighted mean of its parts, 0 to 1.")]
    own_doing: Annotated[Share, meant("Part of the value, 0 to 1.")]
    avoidability: Annotated[Share, meant("Part of the value, 0 to 1.")]
    severity: Annotated[Share, meant("Part of the value, 0 to 1.")]
    novelty: Annotated[Share, meant("Part of the value, 0 to 1.")]
    crash_type: Annotated[str, meant("Name of its crash type.")]
    fault: Annotated[AtFault | None, meant("Who is at fault by RSS; null: not judged.")]
    prevented_by: Annotated[
        str | None, meant('Reference drivers that would have prevented it, or "nobody"; missing: nobody looked.')
    ] = None
    held_speed_prevents: Annotated[bool | None, meant("Would holding the speed do? Missing: nobody looked.")] = None
    prevention: Annotated[str | None, meant("What would have prevented it; missing: nobody looked.")] = None
    conduct: Annotated[
        str | None, meant('What the AV did wrong, of `analysis.conduct.CONDUCTS`, or "none"; missing: nobody looked.')
    ] = None
    text: Annotated[str, meant("What happened, in a sentence.")]


class ValueFound(Result):
    """Case to look at first."""

    weights: Annotated[dict[str, Share], meant("Weight of each part of a value; they sum to 1.")]
    top: Annotated[tuple[TopCase, ...], meant("Up to ten cases, most valuable first.")]


class Coverage(Result):
    """Kinds of crash that were seen, and how likely the next case is of a new one."""

    cases: Annotated[Whole, meant("Cases that were put into cells.")]
    axes: Annotated[dict[str, tuple[str, ...]], meant("Axes of the grid, each with its labels.")]
    cells: Annotated[dict[str, Whole], meant("Cases of each filled cell, fullest first.")]
    empty: Annotated[tuple[str, ...], meant("Names of the empty cells.")]
    discovery_curve: Annotated[
        tuple[tuple[float, float], ...], meant("Number of cases, and kinds that so many show on average.")
    ]
    unseen_kind_chance: Annotated[Share, meant("Chance that the next case is of a new kind (Good-Turing), 0 to 1.")]
    unseen_kind_interval95: Annotated[Interval, meant("Interval of `unseen_kind_chance`.")]


class NaturalKind(Result):
    """How often crashes of one kind happen in natural traffic."""

    cases: Annotated[Whole, meant("Cases of this kind.")]
    share: Annotated[Share, meant("Share of all natural crashes, 0 to 1.")]
    crashes_per_test: Annotated[float, meant("How often it happens.", "per test")]
    interval95: Annotated[Interval, meant("Its interval (Fay and Feuer); it covers chance only.", "per test")]
    miles_between: Annotated[float, meant("Miles of the AV from one to the next, at full test length.", "miles")]
    interval95_miles: Annotated[Interval, meant("Interval of `miles_between`.", "miles")]


class Natural(Result):
    """How often the crashes of a library happen in natural traffic; each dictionary begins with the most frequent."""

    effective_cases: Annotated[float, meant("Cases that would tell as much if all weighed the same.")]
    all: Annotated[NaturalKind, meant("All crashes of the AV.")]
    clusters: Annotated[dict[str, NaturalKind], meant("By `id` of the cluster.")]
    crash_types: Annotated[dict[str, NaturalKind], meant("By crash type.")]
    mechanisms: Annotated[dict[str, NaturalKind], meant("By what led to it; empty if the library does not say so.")]
    fault: Annotated[dict[str, NaturalKind], meant("By who is at fault (RSS).")]
    avoidable: Annotated[
        NaturalKind | None,
        meant(
            "Those with a way out that may begin `avoidable_after_s` after the manoeuvre began, or later, from the "
            "cases drawn for it; null: none was, or none had one."
        ),
    ]
    avoidable_after_s: Annotated[
        float | None,
        meant("Time to react that `avoidable` leaves the AV; missing in files of earlier versions, where 0.", "s"),
    ] = None
    prevented_by: Annotated[
        dict[str, NaturalKind] | None,
        meant(
            "What `a careful driver` and each reference driver would have prevented, and as `NAME, by braking` where "
            "holding the speed is not enough; missing in files of earlier versions."
        ),
    ] = None
    conducts: Annotated[
        dict[str, NaturalKind] | None,
        meant('By what the AV did wrong, "none" among them; missing in files of earlier versions.'),
    ] = None
    serious_injuries: Annotated[
        NaturalKind,
        meant("Crashes in which somebody in the AV is seriously injured (MAIS 3 or more), from its chance."),
    ]


class Analysed(Result):
    """Kinds of crash in a library, typical and rare cases, and what each is worth."""

    cases: Annotated[Whole, _CASES]
    steps: Annotated[Whole, meant("Seconds before the crash that the features cover, 1 to 15.", "s")]
    features: Annotated[tuple[str, ...], meant("Names of the features.")]
    padded: Annotated[Whole, meant("Cases shorter than `steps`, which repeat their earliest recorded second.")]
    excluded: Annotated[Whole, meant("Cases shorter than `steps` that were left out.")]
    explained_variance: Annotated[tuple[Share, ...], meant("Share of variance of each principal component.")]
    loadings: Annotated[dict[str, tuple[float, ...]], meant("By feature, its weight in each component.")]
    eps: Annotated[float | None, meant("Radius of DBSCAN, in the plane of the components; null: there was no split.")]
    min_samples: Annotated[
        Whole | None, meant("Cases within `eps`, itself included, that make a core; null: there was no split.")
    ]
    majority: Annotated[Whole, meant("Cases that DBSCAN calls dense.")]
    minority: Annotated[Whole, meant("The other cases.")]
    clusters: Annotated[tuple[Cluster, ...], meant("Clusters, the majority's first.")]
    choices: Annotated[dict[str, ClusterChoice], meant("By group, why it has so many clusters.")]
    rare: Annotated[tuple[str, ...], meant("Up to ten case ids of outliers, farthest first.")]
    crash_types: Annotated[dict[CrashType, Whole], meant("Cases by crash type, zeros included.")]
    striker: Annotated[dict[str, Whole], meant("Cases by who struck: av, bv or mutual.")]
    seconds: Annotated[dict[str, float], meant("Wall-clock by stage, and `total`.", "s")]
    note: Annotated[str | None, meant("Why there was no split; only then.")] = None
    fault: Annotated[dict[AtFault, Whole], meant("Cases by who is at fault (RSS), only those that occur.")]
    fault_rules: Annotated[dict[str, Whole], meant("Cases by the rule that was broken, only those that occur.")]
    severity: Annotated[
        dict[str, dict[str, float]], meant("By measure, its 5, 50, 95 and 99 % quantiles.", "as its name says")
    ]
    avoidability: Annotated[Avoidability | None, meant("Ways out; null: none was searched.")]
    prevented: Annotated[
        Prevented | None, meant("What reference drivers would have prevented; missing in files of earlier versions.")
    ] = None
    judges: Annotated[
        Judges | None,
        meant("The judges against each other; missing: no ways out were searched, or an earlier version."),
    ] = None
    own_doing: Annotated[
        OwnDoing | None, meant("What the AV itself does wrong; missing in files of earlier versions.")
    ] = None
    value: Annotated[ValueFound, meant("Cases that are worth a look.")]
    coverage: Annotated[Coverage, meant("Kinds that were seen.")]
    natural: Annotated[
        Natural | None, meant("Natural rates; missing if the cases come from an adversary, which has none.")
    ] = None
    purpose: Annotated[
        str | None,
        meant(
            'What comes first: "road", what happens most; "attack", most valued. Missing in files of earlier versions.'
        ),
    ] = None
