"""The result of `ndd validate`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.driving import Distributions
from cornerforge.results.html import Result
from cornerforge.results.rates import Interval

__all__ = [
    "AcceptedGaps",
    "BaselineDifference",
    "Curve",
    "FactFound",
    "FreeTraffic",
    "LaneChangeRate",
    "NddValidated",
    "OneStepCell",
    "PartDistance",
    "PartLikelihood",
    "RecordedQuantity",
    "RecordedTtc",
    "Theme",
    "TrafficDistances",
    "TtcShare",
]

_DECISIONS = meant("Recorded observations.")
_VEHICLES = meant("Drivers who made them.")
_UNIT = meant("Of the quantity.")
_FAR = meant("Earth mover's distance.", "`unit`")
_FAR_ENDS = meant("95 % interval of `wasserstein`, by bootstrap over vehicles.", "`unit`")
_KS = meant("Kolmogorov-Smirnov: largest difference of the two distribution functions, 0 to 1.")
_KS_ENDS = meant("95 % interval of `kolmogorov_smirnov`, by bootstrap over vehicles.")
_NOT_COMPARED = meant("Why a comparison would not be fair; only then.")
_CAUTION = meant("With what caution to read it; only where there is reason.")
_WHEN = meant("Window: seconds after the start.", "s")


class BaselineDifference(Result):
    """Log-likelihood of a model minus that of a baseline, decision by decision."""

    difference: Annotated[float, meant("Mean; above 0 the model is better.", "nat")]
    interval95: Annotated[Interval, meant("Its 95 % interval, by bootstrap over vehicles.", "nat")]


class PartLikelihood(Result):
    """How likely a part of a model holds the decisions of one file."""

    decisions: Annotated[Whole, meant("Decisions that were scored.")]
    vehicles: Annotated[Whole, _VEHICLES]
    model: Annotated[float, meant("Mean log-likelihood; -3.43 for uniform guessing.", "nat")]
    interval95: Annotated[Interval, meant("Its 95 % interval, by bootstrap over vehicles.", "nat")]
    baselines: Annotated[dict[str, float], meant("Mean log-likelihood, by baseline.", "nat")]
    model_minus: Annotated[dict[str, BaselineDifference], meant("Model minus baseline, by baseline.")]


class PartDistance(Result):
    """How far observed accelerations lie from those that a part of a model predicts."""

    decisions: Annotated[Whole, _DECISIONS]
    vehicles: Annotated[Whole, _VEHICLES]
    unit: Annotated[str, _UNIT]
    wasserstein: Annotated[float, _FAR]
    wasserstein_interval95: Annotated[Interval, _FAR_ENDS]
    kolmogorov_smirnov: Annotated[float, _KS]
    kolmogorov_smirnov_interval95: Annotated[Interval, _KS_ENDS]


class _Recorded(Result):
    """A recorded quantity against simulated traffic at the same speeds."""

    not_compared: Annotated[str | None, _NOT_COMPARED] = None
    decisions: Annotated[Whole | None, _DECISIONS] = None
    vehicles: Annotated[Whole | None, _VEHICLES] = None
    unit: Annotated[str | None, _UNIT] = None
    wasserstein: Annotated[float | None, _FAR] = None
    wasserstein_interval95: Annotated[Interval | None, _FAR_ENDS] = None
    kolmogorov_smirnov: Annotated[float | None, _KS] = None
    kolmogorov_smirnov_interval95: Annotated[Interval | None, _KS_ENDS] = None
    speeds_not_simulated: Annotated[
        Whole | None, meant("Observations left out: simulated traffic has too few states at their speed.")
    ] = None
    low: Annotated[float | None, meant("Lower edge of the first bin.", "`unit`")] = None
    width: Annotated[float | None, meant("Width of a bin.", "`unit`")] = None
    recorded: Annotated[tuple[float, ...] | None, meant("Recorded share of each bin.")] = None
    simulated: Annotated[tuple[float, ...] | None, meant("Simulated share of each bin.")] = None


class RecordedQuantity(_Recorded):
    """A quantity of recorded states against simulated traffic at the same speeds, from 19.5 m/s on."""

    caution: Annotated[str | None, _CAUTION] = None


class AcceptedGaps(_Recorded):
    """Gaps that drivers accepted when they changed lanes, against simulated traffic at the same speeds."""

    accepted_by_drivers: Annotated[
        Whole | None, meant("Gaps accepted at any speed; missing where the file does not give lanes.")
    ] = None
    thereof_impossible_to_the_model: Annotated[
        Whole | None, meant("Those of them that an attentive driver of the model never accepts.")
    ] = None


class TtcShare(Result):
    """Share of following states with a TTC below some limit."""

    recorded: Annotated[float, meant("Recorded, 0 to 1.")]
    recorded_interval95: Annotated[Interval, meant("Its 95 % interval, by bootstrap over vehicles.")]
    simulated: Annotated[float, meant("Simulated at the same speeds, 0 to 1.")]


class RecordedTtc(Result):
    """Shares of recorded following states with a short TTC against simulated traffic at the same speeds."""

    not_compared: Annotated[str | None, _NOT_COMPARED] = None
    decisions: Annotated[Whole | None, _DECISIONS] = None
    vehicles: Annotated[Whole | None, _VEHICLES] = None
    shares: Annotated[dict[str, TtcShare] | None, meant("By limit: 3, 5, 10, 20 s.")] = None
    caution: Annotated[str | None, _CAUTION] = None


class LaneChangeRate(Result):
    """How often lanes are changed, recorded at all speeds and simulated."""

    not_compared: Annotated[str | None, _NOT_COMPARED] = None
    vehicles: Annotated[Whole | None, meant("Recorded vehicles.")] = None
    recorded: Annotated[float | None, meant("Recorded.", "per vehicle-mile")] = None
    recorded_interval95: Annotated[
        Interval | None, meant("Its 95 % interval, by bootstrap over vehicles.", "per vehicle-mile")
    ] = None
    recorded_miles: Annotated[float | None, meant("Distance recorded.", "miles")] = None
    simulated: Annotated[float | None, meant("Simulated.", "per vehicle-mile")] = None


class TrafficDistances(Result):
    """Recorded against predicted accelerations and simulated traffic, by quantity and file."""

    acceleration: Annotated[
        dict[str, dict[str, PartDistance]],
        meant("Observed and predicted accelerations, by file and part of the model."),
    ]
    speed: Annotated[dict[str, RecordedQuantity], meant("Speed, by file.")]
    gap: Annotated[dict[str, RecordedQuantity], meant("Gap of vehicles that follow, by file.")]
    time_gap: Annotated[dict[str, RecordedQuantity], meant("Time gap of vehicles that follow, by file.")]
    range_rate: Annotated[dict[str, RecordedQuantity], meant("Range rate of vehicles that follow, by file.")]
    acceleration_following: Annotated[
        dict[str, RecordedQuantity], meant("Acceleration of vehicles that follow, by file.")
    ]
    acceleration_free: Annotated[dict[str, RecordedQuantity], meant("Acceleration in free flow, by file.")]
    ttc_share_below: Annotated[dict[str, RecordedTtc], meant("Short TTCs, by file.")]
    lane_changes_per_mile: Annotated[dict[str, LaneChangeRate], meant("Lane changes, by file.")]
    accepted_lead_gap: Annotated[dict[str, AcceptedGaps], meant("Accepted gaps ahead, by file.")]
    accepted_rear_gap: Annotated[dict[str, AcceptedGaps], meant("Accepted gaps behind, by file.")]


class OneStepCell(Result):
    """Recorded accelerations in like states, and those predicted from these states."""

    speed_mps: Annotated[tuple[float, float], meant("Ends of the band of speed.", "m/s")]
    state: Annotated[str, meant("free, closing, steady or opening.")]
    by: Annotated[str, meant("What predicts: table, or law below 19.5 m/s.")]
    recorded_mean_sd: Annotated[tuple[float, float], meant("Recorded mean and standard deviation.", "m/s2")]
    predicted_mean_sd: Annotated[tuple[float, float], meant("Predicted mean and standard deviation.", "m/s2")]
    decisions: Annotated[Whole, _DECISIONS]
    vehicles: Annotated[Whole, _VEHICLES]
    unit: Annotated[str, _UNIT]
    wasserstein: Annotated[float, _FAR]
    wasserstein_interval95: Annotated[Interval, _FAR_ENDS]
    kolmogorov_smirnov: Annotated[float, _KS]
    kolmogorov_smirnov_interval95: Annotated[Interval, _KS_ENDS]
    recorded: Annotated[tuple[float, ...], meant("Recorded share of each of the 31 accelerations.")]
    predicted: Annotated[tuple[float, ...], meant("Predicted share of each of the 31 accelerations.")]


class FactFound(Result):
    """A published fact, and what free-running traffic has of it in one window."""

    theme: Annotated[str, meant("The table that it belongs to, a key of `themes`.")]
    when: Annotated[str, meant("Window: seconds after the start; or the file.")]
    fact: Annotated[str, meant("The quantity, in words.")]
    unit: Annotated[str, meant("Of the numbers.")]
    published: Annotated[
        float | tuple[float, float] | None,
        meant("Published value, or ends of a range; null: none for just this.", "`unit`"),
    ]
    source: Annotated[str, meant("Of the published value.")]
    found: Annotated[float | None, meant("What was found; null: it was not seen at all.", "`unit`")]
    n: Annotated[Whole, meant("States, events or pairs behind it.")]
    interval95: Annotated[
        Interval | None,
        meant("95 % interval of `found` (of all crashes: 0 and the exact upper bound); null: unknown.", "`unit`"),
    ]
    allowed: Annotated[tuple[float, float] | None, meant("Ends of what is allowed; null: shown only.", "`unit`")]
    within: Annotated[bool | None, meant("Whether it is within `allowed`; null: shown only.")]
    crashes: Annotated[Whole | None, meant("Crashes counted; only with crashes.")] = None
    miles: Annotated[float | None, meant("Distance counted; only with crashes.", "vehicle-miles")] = None


class Theme(Result):
    """A table of facts."""

    title: Annotated[str, meant("Its heading.")]
    meaning: Annotated[str, meant("What the facts in it mean, in one or two sentences.")]


class Curve(Result):
    """Distribution of a quantity in bins of one width."""

    low: Annotated[float, meant("Lower edge of the first bin.", "`unit`")]
    width: Annotated[float, meant("Width of a bin.", "`unit`")]
    unit: Annotated[str, _UNIT]
    shares: Annotated[tuple[float, ...], meant("Share of each bin.")]


class FreeTraffic(Result):
    """Free-running traffic in one window."""

    when: Annotated[str, _WHEN]
    worlds: Annotated[Whole, meant("Worlds that were driven.")]
    miles: Annotated[float, meant("Distance counted.", "vehicle-miles")]
    vehicles_per_km: Annotated[float, meant("Mean density of the counted stretch, all lanes.", "1/km")]
    distributions: Annotated[Distributions, meant("What the traffic was like.")]
    curves: Annotated[dict[str, Curve], meant("Distributions for pictures, by quantity.")]


class NddValidated(Result):
    """A naturalistic model against held-out trajectories, and its traffic against published facts."""

    model: Annotated[str, meant("File of the model.")]
    model_hash: Annotated[str, meant("Hash of everything in the model that decides how vehicles drive.")]
    log_likelihood_per_decision: Annotated[
        dict[str, dict[str, PartLikelihood]], meant("By file and part of the model: law, table, law_on_grid.")
    ]
    idm: Annotated[
        dict[str, dict[str, float]], meant("By name, the parameters of the IDMs that were compared with.", "m, s, m/s2")
    ]
    distances: Annotated[TrafficDistances, meant("Recorded against predicted and simulated.")]
    one_step_ahead: Annotated[
        dict[str, tuple[OneStepCell, ...]], meant("By file, accelerations in like states; cells with enough decisions.")
    ]
    facts: Annotated[tuple[FactFound, ...], meant("Published facts, theme by theme, window by window.")]
    themes: Annotated[dict[str, Theme], meant("By name, the tables of the facts, in order.")]
    traffic: Annotated[tuple[FreeTraffic, ...], meant("Free-running traffic, by window.")]
    notes: Annotated[tuple[str, ...], meant("What a reader must know, one sentence each.")]
    passed: Annotated[
        bool, meant("Whether law and table are better than the IDM and uniform guessing, and all facts are within.")
    ]
    seconds: Annotated[float, meant("Wall-clock of this call.", "s")]
    out: Annotated[str | None, meant("Folder of everything; with `--out`.")] = None
    report: Annotated[str | None, meant("File of the page; with `--out`.")] = None
