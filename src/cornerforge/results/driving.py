"""Results of `simulate`, `rate` and `generate`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.rates import INTERVAL95, PER_TEST, TESTS, Interval, Rate
from cornerforge.results.stating import meant

__all__ = ["BvMilesEstimate", "CrashCircumstances", "Distributions", "Filled", "NaturalRate", "Quantity", "Simulated"]

_AV_CRASHES = meant("Tests that ended in a crash of the AV.")
_AV_FAULTS = meant("Tests left out, because an AV from outside raised, hung or gave no usable answer; 0 if built in.")
_BV_CRASHES = meant("Crashes between two BVs; they are taken off the road, and the test goes on.")
_SECONDS = meant("Wall-clock of the work, without loading and compiling.", "s")
_LIBRARY = meant("Folder of the case library.")


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """How a quantity is distributed over all BVs at decision times, exact to half a bin."""

    unit: str = field(metadata=meant("Of mean, sd and quantiles."))
    n: int = field(metadata=meant("Values counted."))
    mean: float | None = field(metadata=meant("Mean; null: n is 0.", "`unit`"))
    sd: float | None = field(metadata=meant("Standard deviation; null: n is 0.", "`unit`"))
    quantiles: dict[str, float] = field(
        metadata=meant("By percent: 1, 5, 25, 50, 75, 95, 99; empty where n is 0.", "`unit`")
    )


@dataclass(frozen=True, kw_only=True)
class Distributions:
    """What the traffic of BVs was like (`simulate --stats`)."""

    speed: Quantity = field(metadata=meant("Speed along the road."))
    gap: Quantity = field(
        metadata=meant("Bumper-to-bumper distance of those that follow (to a vehicle at most 115.5 m ahead).")
    )
    time_gap: Quantity = field(metadata=meant("Gap over own speed, of those that follow."))
    range_rate: Quantity = field(metadata=meant("Speed of the vehicle ahead minus the own, of those that follow."))
    acceleration: Quantity = field(metadata=meant("Acceleration that is decided; a lane change counts as 0."))
    ttc_share_below: dict[str, float | None] = field(
        metadata=meant("Share of following states with a TTC below so many seconds; null: nobody followed.")
    )
    following_share: float | None = field(metadata=meant("Share of BVs that follow, 0 to 1; null: no BV."))
    lane_changes_per_mile: float | None = field(
        metadata=meant("Lane changes begun per mile of a BV; null: they drove none.", "per BV-mile")
    )
    bv_miles: float = field(metadata=meant("Distance that all BVs drove.", "miles"))


@dataclass(frozen=True, kw_only=True)
class Simulated(Rate):
    """What tests came to, counted."""

    av_crashes: int = field(metadata=_AV_CRASHES)
    av_faults: int = field(metadata=_AV_FAULTS)
    bv_crashes: int = field(metadata=_BV_CRASHES)
    seconds: float = field(metadata=_SECONDS)
    world_steps: int = field(metadata=meant("Seconds of traffic that were begun: decisions of worlds."))
    world_steps_per_second: float = field(metadata=meant("`world_steps` over `seconds`.", "1/s"))
    tests_per_second: float = field(metadata=meant("`tests` over `seconds`.", "1/s"))
    digest: str = field(
        metadata=meant("SHA-256 over all outcomes in test order; the same for any threads and machine.")
    )
    distributions: Distributions | None = field(default=None, metadata=meant("What traffic was like; with `--stats`."))
    cases: int | None = field(default=None, metadata=meant("Cases in the library; with `--out`."))
    library: str | None = field(default=None, metadata=meant("Folder of the library; with `--out`."))


@dataclass(frozen=True, kw_only=True)
class Filled:
    """A case library, and how often the tests that were driven for it ended in a crash."""

    cases: int = field(metadata=meant("Cases in the library."))
    tests: int = field(metadata=TESTS)
    av_crashes: int = field(metadata=_AV_CRASHES)
    av_faults: int = field(metadata=_AV_FAULTS)
    crashes_per_test: float = field(metadata=PER_TEST)
    interval95: Interval = field(metadata=INTERVAL95)
    seconds: float = field(metadata=_SECONDS)
    library: str = field(metadata=_LIBRARY)


@dataclass(frozen=True, kw_only=True)
class BvMilesEstimate:
    """From what sample the distance of the BVs is known."""

    tests: int = field(metadata=meant("Tests of the sample, 4096 at most."))
    relative_error: float | None = field(
        metadata=meant("Standard error of the mean distance over the mean; null: fewer than 128 tests.")
    )


@dataclass(frozen=True, kw_only=True)
class CrashCircumstances:
    """Crashes with something that matters to their reading; these overlap."""

    at_start: int = field(metadata=meant("Less than 4 s after the start of the test."))
    rare_action: int = field(
        metadata=meant("The partner did within 5 s what an attentive driver does with a chance below 1e-3.")
    )
    overlooked: int = field(metadata=meant("The partner more likely than not overlooked a neighbour."))
    looked_away: int = field(metadata=meant("The partner's driver looked away from the road in the last 5 s."))


@dataclass(frozen=True, kw_only=True)
class _RatedAv:
    """Whose rate it is, and how it was found."""

    method: str = field(metadata=meant('"mc", plain Monte Carlo.'))
    av: str = field(metadata=meant("Name of the AV."))
    odd: str = field(metadata=meant("Name of the ODD."))
    lanes: int = field(metadata=meant("Lanes of the road, 2 to 6."))


@dataclass(frozen=True, kw_only=True)
class NaturalRate(Rate, _RatedAv):
    """The AV's natural crash rate, with what kinds of crash it is made of."""

    relative_half_width: float | None = field(
        metadata=meant("Half the width of `interval95` over `crashes_per_test`; null: no crash.")
    )
    av_crashes: int = field(metadata=_AV_CRASHES)
    av_faults: int = field(metadata=_AV_FAULTS)
    bv_crashes: int = field(metadata=_BV_CRASHES)
    bv_crashes_per_test: float = field(metadata=meant("`bv_crashes` over `tests`.", "per test"))
    bv_crashes_per_bv_mile: float | None = field(
        metadata=meant("`bv_crashes` over `bv_miles`; null: BVs drove none.", "per BV-mile")
    )
    interval95_bv_crashes_per_bv_mile: Interval | None = field(
        metadata=meant("Its exact interval (Garwood); null: BVs drove none.", "per BV-mile")
    )
    bv_miles: float = field(metadata=meant("Distance that all BVs drove, from the mean of a sample.", "miles"))
    bv_miles_estimate: BvMilesEstimate = field(metadata=meant("The sample."))
    effective_sample_size: int = field(metadata=meant("Tests of plain Monte Carlo that tell as much; `tests` for mc."))
    acceleration: float = field(
        metadata=meant("Tests that plain Monte Carlo would need for the same half-width over `tests`; 1 for mc.")
    )
    seconds: float = field(metadata=meant("Wall-clock of driving, over all sessions.", "s"))
    cpu_seconds: float = field(metadata=meant("Time on processors, over all threads and sessions.", "s"))
    tests_per_second: float | None = field(metadata=meant("Tests driven over `seconds`; null: `seconds` is 0.", "1/s"))
    digest: str = field(metadata=meant("Chain of SHA-256 over blocks of tests; the same for any threads and resumes."))
    state: str = field(
        metadata=meant(
            'Why it ends: "target" (narrow enough) or "max_tests"; in `rate.json` also "running" and "interrupted".'
        )
    )
    crash_types: dict[str, int] = field(metadata=meant("Crashes of the AV by type, zeros included."))
    mechanisms: dict[str, int] = field(metadata=meant("Crashes of the AV by what led to them, zeros included."))
    crash_circumstances: CrashCircumstances = field(metadata=meant("Crashes with circumstances that matter."))
