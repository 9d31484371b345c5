"""The result of `ndd validate`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.driving import Distributions
from cornerforge.results.rates import Interval
from cornerforge.results.stating import meant

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


@dataclass(frozen=True, kw_only=True)
class BaselineDifference:
    """Log-likelihood of a model minus that of a baseline, decision by decision."""

    difference: float = field(metadata=meant("Mean; above 0 the model is better.", "nat"))
    interval95: Interval = field(metadata=meant("Its 95 % interval, by bootstrap over vehicles.", "nat"))


@dataclass(frozen=True, kw_only=True)
class PartLikelihood:
    """How likely a part of a model holds the decisions of one file."""

    decisions: int = field(metadata=meant("Decisions that were scored."))
    vehicles: int = field(metadata=_VEHICLES)
    model: float = field(metadata=meant("Mean log-likelihood; -3.43 for uniform guessing.", "nat"))
    interval95: Interval = field(metadata=meant("Its 95 % interval, by bootstrap over vehicles.", "nat"))
    baselines: dict[str, float] = field(metadata=meant("Mean log-likelihood, by baseline.", "nat"))
    model_minus: dict[str, BaselineDifference] = field(metadata=meant("Model minus baseline, by baseline."))


@dataclass(frozen=True, kw_only=True)
class PartDistance:
    """How far observed accelerations lie from those that a part of a model predicts."""

    decisions: int = field(metadata=_DECISIONS)
    vehicles: int = field(metadata=_VEHICLES)
    unit: str = field(metadata=_UNIT)
    wasserstein: float = field(metadata=_FAR)
    wasserstein_interval95: Interval = field(metadata=_FAR_ENDS)
    kolmogorov_smirnov: float = field(metadata=_KS)
    kolmogorov_smirnov_interval95: Interval = field(metadata=_KS_ENDS)


@dataclass(frozen=True, kw_only=True)
class _Recorded:
    """A recorded quantity against simulated traffic at the same speeds."""

    not_compared: str | None = field(default=None, metadata=_NOT_COMPARED)
    decisions: int | None = field(default=None, metadata=_DECISIONS)
    vehicles: int | None = field(default=None, metadata=_VEHICLES)
    unit: str | None = field(default=None, metadata=_UNIT)
    wasserstein: float | None = field(default=None, metadata=_FAR)
    wasserstein_interval95: Interval | None = field(default=None, metadata=_FAR_ENDS)
    kolmogorov_smirnov: float | None = field(default=None, metadata=_KS)
    kolmogorov_smirnov_interval95: Interval | None = field(default=None, metadata=_KS_ENDS)
    speeds_not_simulated: int | None = field(
        default=None, metadata=meant("Observations left out: simulated traffic has too few states at their speed.")
    )
    low: float | None = field(default=None, metadata=meant("Lower edge of the first bin.", "`unit`"))
    width: float | None = field(default=None, metadata=meant("Width of a bin.", "`unit`"))
    recorded: tuple[float, ...] | None = field(default=None, metadata=meant("Recorded share of each bin."))
    simulated: tuple[float, ...] | None = field(default=None, metadata=meant("Simulated share of each bin."))


@dataclass(frozen=True, kw_only=True)
class RecordedQuantity(_Recorded):
    """A quantity of recorded states against simulated traffic at the same speeds, from 19.5 m/s on."""

    caution: str | None = field(default=None, metadata=_CAUTION)


@dataclass(frozen=True, kw_only=True)
class AcceptedGaps(_Recorded):
    """Gaps that drivers accepted when they changed lanes, against simulated traffic at the same speeds."""

    accepted_by_drivers: int | None = field(
        default=None, metadata=meant("Gaps accepted at any speed; missing where the file does not give lanes.")
    )
    thereof_impossible_to_the_model: int | None = field(
        default=None, metadata=meant("Those of them that an attentive driver of the model never accepts.")
    )


@dataclass(frozen=True, kw_only=True)
class TtcShare:
    """Share of following states with a TTC below some limit."""

    recorded: float = field(metadata=meant("Recorded, 0 to 1."))
    recorded_interval95: Interval = field(metadata=meant("Its 95 % interval, by bootstrap over vehicles."))
    simulated: float = field(metadata=meant("Simulated at the same speeds, 0 to 1."))


@dataclass(frozen=True, kw_only=True)
class RecordedTtc:
    """Shares of recorded following states with a short TTC against simulated traffic at the same speeds."""

    not_compared: str | None = field(default=None, metadata=_NOT_COMPARED)
    decisions: int | None = field(default=None, metadata=_DECISIONS)
    vehicles: int | None = field(default=None, metadata=_VEHICLES)
    shares: dict[str, TtcShare] | None = field(default=None, metadata=meant("By limit: 3, 5, 10, 20 s."))
    caution: str | None = field(default=None, metadata=_CAUTION)


@dataclass(frozen=True, kw_only=True)
class LaneChangeRate:
    """How often lanes are changed, recorded at all speeds and simulated."""

    not_compared: str | None = field(default=None, metadata=_NOT_COMPARED)
    vehicles: int | None = field(default=None, metadata=meant("Recorded vehicles."))
    recorded: float | None = field(default=None, metadata=meant("Recorded.", "per vehicle-mile"))
    recorded_interval95: Interval | None = field(
        default=None, metadata=meant("Its 95 % interval, by bootstrap over vehicles.", "per vehicle-mile")
    )
    recorded_miles: float | None = field(default=None, metadata=meant("Distance recorded.", "miles"))
    simulated: float | None = field(default=None, metadata=meant("Simulated.", "per vehicle-mile"))


@dataclass(frozen=True, kw_only=True)
class TrafficDistances:
    """Recorded against predicted accelerations and simulated traffic, by quantity and file."""

    acceleration: dict[str, dict[str, PartDistance]] = field(
        metadata=meant("Observed and predicted accelerations, by file and part of the model.")
    )
    speed: dict[str, RecordedQuantity] = field(metadata=meant("Speed, by file."))
    gap: dict[str, RecordedQuantity] = field(metadata=meant("Gap of vehicles that follow, by file."))
    time_gap: dict[str, RecordedQuantity] = field(metadata=meant("Time gap of vehicles that follow, by file."))
    range_rate: dict[str, RecordedQuantity] = field(metadata=meant("Range rate of vehicles that follow, by file."))
    acceleration_following: dict[str, RecordedQuantity] = field(
        metadata=meant("Acceleration of vehicles that follow, by file.")
    )
    acceleration_free: dict[str, RecordedQuantity] = field(metadata=meant("Acceleration in free flow, by file."))
    ttc_share_below: dict[str, RecordedTtc] = field(metadata=meant("Short TTCs, by file."))
    lane_changes_per_mile: dict[str, LaneChangeRate] = field(metadata=meant("Lane changes, by file."))
    accepted_lead_gap: dict[str, AcceptedGaps] = field(metadata=meant("Accepted gaps ahead, by file."))
    accepted_rear_gap: dict[str, AcceptedGaps] = field(metadata=meant("Accepted gaps behind, by file."))


@dataclass(frozen=True, kw_only=True)
class OneStepCell:
    """Recorded accelerations in like states, and those predicted from these states."""

    speed_mps: tuple[float, float] = field(metadata=meant("Ends of the band of speed.", "m/s"))
    state: str = field(metadata=meant("free, closing, steady or opening."))
    by: str = field(metadata=meant("What predicts: table, or law below 19.5 m/s."))
    recorded_mean_sd: tuple[float, float] = field(metadata=meant("Recorded mean and standard deviation.", "m/s2"))
    predicted_mean_sd: tuple[float, float] = field(metadata=meant("Predicted mean and standard deviation.", "m/s2"))
    decisions: int = field(metadata=_DECISIONS)
    vehicles: int = field(metadata=_VEHICLES)
    unit: str = field(metadata=_UNIT)
    wasserstein: float = field(metadata=_FAR)
    wasserstein_interval95: Interval = field(metadata=_FAR_ENDS)
    kolmogorov_smirnov: float = field(metadata=_KS)
    kolmogorov_smirnov_interval95: Interval = field(metadata=_KS_ENDS)
    recorded: tuple[float, ...] = field(metadata=meant("Recorded share of each of the 31 accelerations."))
    predicted: tuple[float, ...] = field(metadata=meant("Predicted share of each of the 31 accelerations."))


@dataclass(frozen=True, kw_only=True)
class FactFound:
    """A published fact, and what free-running traffic has of it in one window."""

    theme: str = field(metadata=meant("The table that it belongs to, a key of `themes`."))
    when: str = field(metadata=meant("Window: seconds after the start; or the file."))
    fact: str = field(metadata=meant("The quantity, in words."))
    unit: str = field(metadata=meant("Of the numbers."))
    published: float | tuple[float, float] | None = field(
        metadata=meant("Published value, or ends of a range; null: none for just this.", "`unit`")
    )
    source: str = field(metadata=meant("Of the published value."))
    found: float | None = field(metadata=meant("What was found; null: it was not seen at all.", "`unit`"))
    n: int = field(metadata=meant("States, events or pairs behind it."))
    interval95: Interval | None = field(
        metadata=meant(
            "95 % interval of `found` (of all crashes: 0 and the exact upper bound); null: unknown.", "`unit`"
        )
    )
    allowed: tuple[float, float] | None = field(metadata=meant("Ends of what is allowed; null: shown only.", "`unit`"))
    within: bool | None = field(metadata=meant("Whether it is within `allowed`; null: shown only."))
    crashes: int | None = field(default=None, metadata=meant("Crashes counted; only with crashes."))
    miles: float | None = field(default=None, metadata=meant("Distance counted; only with crashes.", "vehicle-miles"))


@dataclass(frozen=True, kw_only=True)
class Theme:
    """A table of facts."""

    title: str = field(metadata=meant("Its heading."))
    meaning: str = field(metadata=meant("What the facts in it mean, in one or two sentences."))


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Distribution of a quantity in bins of one width."""

    low: float = field(metadata=meant("Lower edge of the first bin.", "`unit`"))
    width: float = field(metadata=meant("Width of a bin.", "`unit`"))
    unit: str = field(metadata=_UNIT)
    shares: tuple[float, ...] = field(metadata=meant("Share of each bin."))


@dataclass(frozen=True, kw_only=True)
class FreeTraffic:
    """Free-running traffic in one window."""

    when: str = field(metadata=_WHEN)
    worlds: int = field(metadata=meant("Worlds that were driven."))
    miles: float = field(metadata=meant("Distance counted.", "vehicle-miles"))
    vehicles_per_km: float = field(metadata=meant("Mean density of the counted stretch, all lanes.", "1/km"))
    distributions: Distributions = field(metadata=meant("What the traffic was like."))
    curves: dict[str, Curve] = field(metadata=meant("Distributions for pictures, by quantity."))


@dataclass(frozen=True, kw_only=True)
class NddValidated:
    """A naturalistic model against held-out trajectories, and its traffic against published facts."""

    model: str = field(metadata=meant("File of the model."))
    model_hash: str = field(metadata=meant("Hash of everything in the model that decides how vehicles drive."))
    log_likelihood_per_decision: dict[str, dict[str, PartLikelihood]] = field(
        metadata=meant("By file and part of the model: law, table, law_on_grid.")
    )
    idm: dict[str, dict[str, float]] = field(
        metadata=meant("By name, the parameters of the IDMs that were compared with.", "m, s, m/s2")
    )
    distances: TrafficDistances = field(metadata=meant("Recorded against predicted and simulated."))
    one_step_ahead: dict[str, tuple[OneStepCell, ...]] = field(
        metadata=meant("By file, accelerations in like states; cells with enough decisions.")
    )
    facts: tuple[FactFound, ...] = field(metadata=meant("Published facts, theme by theme, window by window."))
    themes: dict[str, Theme] = field(metadata=meant("By name, the tables of the facts, in order."))
    traffic: tuple[FreeTraffic, ...] = field(metadata=meant("Free-running traffic, by window."))
    notes: tuple[str, ...] = field(metadata=meant("What a reader must know, one sentence each."))
    passed: bool = field(
        metadata=meant("Whether law and table are better than the IDM and uniform guessing, and all facts are within.")
    )
    seconds: float = field(metadata=meant("Wall-clock of this call.", "s"))
    out: str | None = field(default=None, metadata=meant("Folder of everything; with `--out`."))
    report: str | None = field(default=None, metadata=meant("File of the page; with `--out`."))
