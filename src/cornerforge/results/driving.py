"""Results of `simulate`, `rate` and `generate`."""

from __future__ import annotations

from typing import Annotated, Literal

from cornerforge._schema import Whole, meant
from cornerforge.results.analysis import CrashType
from cornerforge.results.html import Result
from cornerforge.results.rates import Counted, Interval, Rate

__all__ = [
    "BvMilesEstimate",
    "CasesMade",
    "Cost",
    "CrashCircumstances",
    "Distributions",
    "Effort",
    "Filled",
    "KindRate",
    "ModelUncertainty",
    "NaturalRate",
    "Quantity",
    "Simulated",
]

_AV_CRASHES = meant("Tests that ended in a crash of the AV.")
_AV_FAULTS = meant("Tests left out, because an AV from outside raised, hung or gave no usable answer; 0 if built in.")
_BV_CRASHES = meant("Crashes between two BVs; they are taken off the road, and the test goes on.")
_SECONDS = meant("Wall-clock of the work, without loading and compiling.", "s")
_LIBRARY = meant("Folder of the case library.")
TtcLimit = Literal["3", "4", "5", "10", "15", "20"]
Percent = Literal["1", "5", "25", "50", "75", "95", "99"]


class Quantity(Result):
    """How a quantity is distributed over all BVs at decision times, exact to half a bin."""

    unit: Annotated[str, meant("Of mean, sd and quantiles.")]
    n: Annotated[Whole, meant("Values counted.")]
    mean: Annotated[float | None, meant("Mean; null: n is 0.", "`unit`")]
    sd: Annotated[float | None, meant("Standard deviation; null: n is 0.", "`unit`")]
    quantiles: Annotated[
        dict[Percent, float], meant("By percent: 1, 5, 25, 50, 75, 95, 99; empty where n is 0.", "`unit`")
    ]


class Distributions(Result):
    """Distributions of the traffic of BVs (`simulate --stats`)."""

    speed: Annotated[Quantity, meant("Speed along the road.")]
    gap: Annotated[
        Quantity, meant("Bumper-to-bumper distance of those that follow (to a vehicle at most 115.5 m ahead).")
    ]
    time_gap: Annotated[Quantity, meant("Gap over own speed, of those that follow.")]
    range_rate: Annotated[Quantity, meant("Speed of the vehicle ahead minus the own, of those that follow.")]
    acceleration: Annotated[Quantity, meant("Acceleration that is decided; a lane change counts as 0.")]
    ttc_share_below: Annotated[
        dict[TtcLimit, float | None],
        meant("Share of following states with a TTC below so many seconds; null: nobody followed."),
    ]
    following_share: Annotated[float | None, meant("Share of BVs that follow, 0 to 1; null: no BV.")]
    lane_changes_per_mile: Annotated[
        float | None, meant("Lane changes begun per mile of a BV; null: they drove none.", "per BV-mile")
    ]
    bv_miles: Annotated[float, meant("Distance that all BVs drove.", "miles")]


class Simulated(Rate):
    """Counts of tests."""

    av_crashes: Annotated[Whole, _AV_CRASHES]
    av_faults: Annotated[Whole, _AV_FAULTS]
    bv_crashes: Annotated[Whole, _BV_CRASHES]
    seconds: Annotated[float, _SECONDS]
    world_steps: Annotated[Whole, meant("Seconds of traffic that were begun: decisions of worlds.")]
    world_steps_per_second: Annotated[float, meant("`world_steps` over `seconds`.", "1/s")]
    tests_per_second: Annotated[float, meant("`tests` over `seconds`.", "1/s")]
    digest: Annotated[str, meant("SHA-256 over all outcomes in test order; the same for any threads and machine.")]
    distributions: Annotated[Distributions | None, meant("What traffic was like; with `--stats`.")] = None
    av: Annotated[str | None, meant("The AV, as it was named.")] = None
    bv: Annotated[tuple[str, ...] | None, meant("How background vehicles drove: names or files.")] = None
    cases: Annotated[Whole | None, meant("Cases in the library; with `--out`.")] = None
    library: Annotated[str | None, meant("Folder of the library; with `--out`.")] = None
    left_road: Annotated[Whole | None, meant("Tests that ended because the AV drove on where its lane had ended.")] = (
        None
    )


class CasesMade(Counted):
    """Cases of a library, and how often the tests that were driven for it ended in a crash."""

    cases: Annotated[Whole, meant("Cases in the library.")]
    av_crashes: Annotated[Whole, _AV_CRASHES]


class Filled(CasesMade):
    """A case library, and how often the tests that were driven for it ended in a crash."""

    av_faults: Annotated[Whole, _AV_FAULTS]
    seconds: Annotated[float, _SECONDS]
    library: Annotated[str, _LIBRARY]


class BvMilesEstimate(Result):
    """Sample from which the distance of the BVs is known."""

    tests: Annotated[Whole, meant("Tests of the sample, 4096 at most.")]
    relative_error: Annotated[
        float | None, meant("Standard error of the mean distance over the mean; null: fewer than 128 tests.")
    ]


class CrashCircumstances(Result):
    """Crashes with something that matters to their reading; these overlap."""

    at_start: Annotated[Whole, meant("Less than 4 s after the start of the test.")]
    rare_action: Annotated[
        Whole, meant("The partner did within 5 s what an attentive driver does with a chance below 1e-3.")
    ]
    overlooked: Annotated[Whole, meant("The partner more likely than not overlooked a neighbour.")]
    looked_away: Annotated[Whole, meant("The partner's driver looked away from the road in the last 5 s.")]


class _RatedAv(Result):
    """AV and method of a rate."""

    method: Annotated[str, meant('"mc", plain Monte Carlo; "splitting", trees of tests; "is", importance sampling.')]
    reason: Annotated[str, meant("Why by this method, in words.")]
    av: Annotated[str, meant("Name of the AV.")]
    odd: Annotated[str, meant("Name of the ODD.")]
    lanes: Annotated[Whole, meant("Lanes of the road, 2 to 6.")]


class Cost(Result):
    """Cost of a part of the work."""

    tests: Annotated[Whole, meant("Tests, or trees of tests.")]
    cpu_seconds: Annotated[float, meant("Time on processors, over all threads and sessions.", "s")]


class Effort(Result):
    """Cost of a rate, part by part; for mc all of it is plain."""

    plain: Annotated[Cost, meant("Tests as nature has them.")]
    teaching: Annotated[Cost, meant("Trees that a network learned from: which moments are dangerous.")]
    estimation: Annotated[Cost, meant("Trees or weighted tests that the rate comes from.")]


class KindRate(Result):
    """How often one kind of crash happens in nature."""

    crashes: Annotated[Whole, meant("Crashes of this kind that were looked at.")]
    crashes_per_test: Annotated[float, meant("How often it happens.", "per test")]
    interval95: Annotated[
        Interval,
        meant("Exact (Garwood) for mc; else that of Fay and Feuer, at this number of trees or tests.", "per test"),
    ]


class ModelUncertainty(Result):
    """How uncertain a rate is because the naturalistic model is, from rates in models drawn about it (ADR 34)."""

    draws: Annotated[Whole, meant("Models drawn.")]
    effective_draws: Annotated[
        float, meant("So many equal ones tell as much: those whose BVs crash unlike people count for less.")
    ]
    bv_crashes: Annotated[Whole, meant("Crashes between BVs in plain tests of all drawn models.")]
    bv_miles: Annotated[float, meant("Distance that BVs drove in these, from that of the rate.", "miles")]
    tests_each: Annotated[Whole, meant("Tests, or trees of tests, of each.")]
    effective_each: Annotated[
        float,
        meant("Median of the crashes of one model, or of so many equal ones that would tell as much as its trees."),
    ]
    cv: Annotated[
        float,
        meant(
            "Standard deviation of the rate between models over its mean, without chance; 0: no difference was seen."
        ),
    ]
    cv_interval95: Annotated[Interval, meant("Its 95 % interval (profile likelihood); from 0: may be chance.")]
    log_sd_used: Annotated[
        float,
        meant(
            "Standard deviation of the rate's logarithm that `interval95` takes; its upper 95 % bound where `cv` is 0."
        ),
    ]
    median_crashes_per_test: Annotated[
        float, meant("Median rate of the drawn models; the middle of `interval95` is the rate itself.", "per test")
    ]
    interval95: Annotated[
        Interval,
        meant("95 % interval of the rate with the model's own uncertainty, wider than sampling's.", "per test"),
    ]
    interval95_per_mile: Annotated[Interval | None, meant("The same per mile; null: the AV drove no mile.", "per mile")]
    doubts: Annotated[tuple[str, ...], meant("Why it should be read with care, in words.")]
    cost: Annotated[Cost, meant("What it took; not part of `effort`, `seconds` and `cpu_seconds` of the rate.")]


class NaturalRate(Rate, _RatedAv):
    """The AV's natural crash rate, with what kinds of crash it is made of.

    Of splitting, `tests` are the trees of the estimate, each begun from one test; of is, weighted tests. For both
    `interval95` holds however often one looks and stops (`rates.weighted`), and miles and crashes between BVs are those
    of the plain tests.
    """

    relative_half_width: Annotated[
        float | None, meant("Half the width of `interval95` over `crashes_per_test`; null: no crash.")
    ]
    relative_half_width_90: Annotated[
        float | None, meant("The same of the 90 % interval at this number of tests or trees; null: no crash.")
    ]
    doubts: Annotated[
        tuple[str, ...],
        meant("Why the rate cannot be trusted yet, in words; empty: it can. Exit status 1 if there are any."),
    ]
    effort: Annotated[Effort, meant("What it took, part by part.")]
    plain_tests: Annotated[Whole, meant("Tests as nature has them, of which `bv_crashes` are; `tests` for mc.")]
    av_crashes: Annotated[Whole, meant("Tests that ended in a crash of the AV; of splitting, branches of trees.")]
    av_faults: Annotated[Whole, _AV_FAULTS]
    bv_crashes: Annotated[Whole, _BV_CRASHES]
    bv_crashes_per_test: Annotated[float, meant("`bv_crashes` over `plain_tests`.", "per test")]
    bv_crashes_per_bv_mile: Annotated[
        float | None, meant("`bv_crashes` over `bv_miles`; null: BVs drove none.", "per BV-mile")
    ]
    interval95_bv_crashes_per_bv_mile: Annotated[
        Interval | None, meant("Its exact interval (Garwood); null: BVs drove none.", "per BV-mile")
    ]
    bv_miles: Annotated[float, meant("Distance that all BVs drove, from the mean of a sample.", "miles")]
    bv_miles_estimate: Annotated[BvMilesEstimate, meant("The sample.")]
    effective_sample_size: Annotated[
        Whole, meant("Trees or tests with a crash that would tell as much if all weighed the same; `tests` for mc.")
    ]
    largest_share: Annotated[
        float | None, meant("Largest share of the rate in one tree or test; null for mc, and without a crash.")
    ]
    halves: Annotated[
        tuple[float, float] | None,
        meant("Rate of the first and of the second half of the trees or tests; null for mc.", "per test"),
    ]
    tail_index: Annotated[
        float | None,
        meant("Hill's index of the largest weights: below 2 no finite variance shows; null: mc, or too few."),
    ]
    acceleration: Annotated[
        float,
        meant(
            "CPU time that plain Monte Carlo would need for the same half-width over that of all that was done here, "
            "plain tests and teaching included (for an AV from outside: time by the clock); 1 for mc, "
            "0 without a crash. Not to be trusted while there are doubts."
        ),
    ]
    seconds: Annotated[float, meant("Wall-clock of driving, over all sessions.", "s")]
    cpu_seconds: Annotated[float, meant("Time on processors, over all threads and sessions.", "s")]
    tests_per_second: Annotated[float | None, meant("Tests driven over `seconds`; null: `seconds` is 0.", "1/s")]
    digest: Annotated[str, meant("Chain of SHA-256 over blocks of tests; the same for any threads and resumes.")]
    state: Annotated[
        str,
        meant(
            'Why it ends: "target" (narrow enough), "max_tests", or "no crash"; in `rate.json` also "running" and '
            '"interrupted".'
        ),
    ]
    crash_types: Annotated[dict[CrashType, Whole], meant("Crashes of the AV by type, zeros included.")]
    mechanisms: Annotated[dict[str, Whole], meant("Crashes of the AV by what led to them, zeros included.")]
    crash_type_rates: Annotated[dict[str, KindRate], meant("How often each type that was seen happens.")]
    mechanism_rates: Annotated[dict[str, KindRate], meant("How often what led to them happens, where seen.")]
    crash_circumstances: Annotated[
        CrashCircumstances | None, meant("Crashes with circumstances that matter; null but for mc.")
    ]
    target_rhw: Annotated[float | None, meant("The `relative_half_width` that was asked for; missing: none was.")] = (
        None
    )
    model_uncertainty: Annotated[
        ModelUncertainty | None,
        meant(
            "How uncertain the model makes the rate, and an interval that takes it in; with `--model-draws`, if there "
            "was a crash. Missing: `interval95` is of sampling alone."
        ),
    ] = None

    @property
    def digits(self) -> int:
        """Number of significant digits to show; of trees and weighted tests two."""
        return super().digits if self.method == "mc" else 2
