"""Results of `ndd fit`, `ndd import` and `ndd show`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.rates import Interval
from cornerforge.results.stating import meant

__all__ = [
    "BadRows",
    "FitTraffic",
    "FitVariant",
    "FittedLaneChanges",
    "FittedLaneNumber",
    "FittedPart",
    "HeldOutScore",
    "NddFitted",
    "NddImported",
    "NddShown",
    "PublishedFree",
    "ShownCounts",
    "ShownFollowing",
    "ShownFreeFlow",
    "ShownInitial",
    "ShownLaneChanges",
    "ShownOrigin",
    "ShownQuantiles",
    "ShownSpeeds",
    "ShownSupport",
]

_MODEL_HASH = meant("Hash of everything in the model that decides how vehicles drive.")
_NOTES = meant("What a reader must know, one sentence each.")
_OUT = meant("File of the model.")
_SPEEDS = meant("Speeds of the grid that are shown.", "m/s")
_GAPS = meant("Gaps of the grid that are shown.", "m")
_RATES = meant("Range rates of the grid that are shown; negative is closing.", "m/s")
_QUANTILES = meant("By percent: 5, 25, 50, 75, 95.", "as the key of this object says")
_PUBLISHED = meant("Published quantiles (IVBSS), by the same percents.", "as the key of this object says")

Table = tuple[tuple[tuple[float, ...], ...], ...]


@dataclass(frozen=True, kw_only=True)
class ShownFollowing:
    """Accelerations of a model's drivers behind a leader."""

    speed_mps: tuple[float, ...] = field(metadata=_SPEEDS)
    gap_m: tuple[float, ...] = field(metadata=_GAPS)
    range_rate_mps: tuple[float, ...] = field(metadata=_RATES)
    mean_mps2: Table = field(metadata=meant("Mean, by speed, gap and range rate.", "m/s2"))
    sd_mps2: Table = field(metadata=meant("Standard deviation, by speed, gap and range rate.", "m/s2"))


@dataclass(frozen=True, kw_only=True)
class ShownSupport:
    """How many of the 31 accelerations are possible in the states of a model."""

    following_possible_min: int = field(metadata=meant("Fewest in a following state."))
    following_possible_mean: float = field(metadata=meant("Mean over following states."))
    following_possible_max: int = field(metadata=meant("Most in a following state."))
    following_states_with_one: int = field(metadata=meant("Following states in which only one is possible."))
    following_states_that_allow_hardest_braking: float = field(
        metadata=meant("Share of following states in which -4 m/s2 is possible, 0 to 1.")
    )
    free_possible_min: int = field(metadata=meant("Fewest at a speed of free flow."))
    free_possible_max: int = field(metadata=meant("Most at a speed of free flow."))


@dataclass(frozen=True, kw_only=True)
class PublishedFree:
    """Published accelerations in free flow at one speed (IVBSS)."""

    speed_mps: float = field(metadata=meant("The speed.", "m/s"))
    sd_mps2: float = field(metadata=meant("Standard deviation.", "m/s2"))
    share_braking_1_mps2: float = field(metadata=meant("Share at or below -1 m/s2, 0 to 1."))
    mean_mps2: tuple[float, float] = field(metadata=meant("Ends of the range of the mean.", "m/s2"))


@dataclass(frozen=True, kw_only=True)
class ShownFreeFlow:
    """Accelerations of a model's drivers without a leader."""

    speed_mps: tuple[float, ...] = field(metadata=meant("All speeds of the grid.", "m/s"))
    mean_mps2: tuple[float, ...] = field(metadata=meant("Mean, by speed.", "m/s2"))
    sd_mps2: tuple[float, ...] = field(metadata=meant("Standard deviation, by speed.", "m/s2"))
    share_braking_1_mps2: tuple[float, ...] = field(metadata=meant("Share at or below -1 m/s2, by speed, 0 to 1."))
    published: tuple[PublishedFree, ...] = field(metadata=meant("Published facts."))
    pull_per_s: float = field(
        metadata=meant(
            "Mean acceleration of a driver, above the mean, per m/s that it lacks to its desired speed.", "1/s"
        )
    )


@dataclass(frozen=True, kw_only=True)
class ShownLaneChanges:
    """How a model's drivers change lanes."""

    base_per_decision_and_side: tuple[float, float] = field(
        metadata=meant("Smallest and largest base chance over speeds, 0 to 1.", "per decision and side")
    )
    desire_free: float = field(metadata=meant("Factor on the base chance without a leader."))
    gap_m: tuple[float, ...] = field(metadata=_GAPS)
    range_rate_mps: tuple[float, ...] = field(metadata=_RATES)
    desire: tuple[tuple[float, ...], ...] = field(
        metadata=meant("Factor on the base chance, by gap and range rate to the leader.")
    )
    gap_accepted_half_lead_m: tuple[float | None, ...] = field(
        metadata=meant("Smallest gap ahead that half or more accept, by range rate; null: none on the grid.", "m")
    )
    gap_accepted_half_rear_m: tuple[float | None, ...] = field(
        metadata=meant("Smallest gap behind that half or more accept, by range rate; null: none on the grid.", "m")
    )
    gap_always_refused_rear_m: tuple[float | None, ...] = field(
        metadata=meant("Largest gap behind up to which all are refused, by range rate; null: none is.", "m")
    )
    gap_turned_back_for_m: tuple[float | None, ...] = field(
        metadata=meant(
            "Largest gap up to which all turn back in a running change, by range rate; null: none does.", "m"
        )
    )
    overlook: float = field(metadata=meant("Chance to overlook a neighbour when changing lanes, 0 to 1."))
    overlook_conflict: float = field(
        metadata=meant("Chance to overlook another vehicle that moves to the same place, 0 to 1.")
    )
    duration_median_s: float | None = field(metadata=meant("Median time of a lane change; null: as the ODD says.", "s"))
    signal_share: float = field(metadata=meant("Drivers who set the indicator before they change lanes, 0 to 1."))
    away_per_second: float = field(metadata=meant("Chance per second to look away from the road, 0 to 1."))
    away_again: float = field(metadata=meant("Chance to look away in the next second too, 0 to 1."))


@dataclass(frozen=True, kw_only=True)
class ShownSpeeds:
    """Speeds at the start."""

    mean: float = field(metadata=meant("Mean.", "m/s"))
    sd: float = field(metadata=meant("Standard deviation.", "m/s"))
    quantiles: dict[str, float] = field(metadata=_QUANTILES)
    published: dict[str, float] = field(metadata=_PUBLISHED)


@dataclass(frozen=True, kw_only=True)
class ShownQuantiles:
    """Quantiles of gaps or time gaps at the start."""

    quantiles: dict[str, float] = field(metadata=_QUANTILES)
    published: dict[str, float] = field(metadata=_PUBLISHED)


@dataclass(frozen=True, kw_only=True)
class ShownInitial:
    """Traffic at the start of a test."""

    parameters: dict[str, float] = field(metadata=meant("Parameters of its law, by name.", "as its name says"))
    speed_mps: ShownSpeeds = field(metadata=meant("Speeds.", "m/s"))
    gap_m: ShownQuantiles = field(metadata=meant("Gaps of vehicles that follow.", "m"))
    time_gap_s: ShownQuantiles = field(metadata=meant("Time gaps of vehicles that follow.", "s"))
    range_rate_sd_mps: float = field(
        metadata=meant("Standard deviation of the range rates of vehicles that follow.", "m/s")
    )
    follow_share: float = field(metadata=meant("Share of vehicles that follow, 0 to 1."))


@dataclass(frozen=True, kw_only=True)
class ShownCounts:
    """Recorded decisions that a model rests on."""

    following_decisions: int = field(metadata=meant("Decisions counted behind a leader."))
    following_states: int = field(metadata=meant("Following states with at least one of them."))
    following_states_total: int = field(metadata=meant("Following states of the grid."))
    following_decisions_by_speed: tuple[int, ...] = field(metadata=meant("The decisions by speed of the grid."))
    free_decisions_by_speed: tuple[int, ...] | None = field(
        metadata=meant("Decisions counted in free flow, by speed of the grid; null: not stated.")
    )
    prior_strength: float | None = field(
        metadata=meant("Decisions that the prior is worth in each state; null: not stated.")
    )
    data_share_of_states: float | None = field(
        metadata=meant("Share of the table that is counts, not prior, mean over states, 0 to 1; null: not stated.")
    )


@dataclass(frozen=True, kw_only=True)
class ShownOrigin:
    """Where a model comes from, as its file says."""

    made_by: str | None = field(metadata=meant("Program and version; null: not stated."))
    attribution: str | None = field(metadata=meant("Whose data it is made of; null: not stated."))
    licence: str | None = field(metadata=meant("Licence of the data; null: not stated."))
    files: tuple[str | None, ...] = field(metadata=meant("Names of the data files; null: a file without a name."))
    filled: tuple[str, ...] = field(metadata=meant("What an import took from another model, in plain words."))


@dataclass(frozen=True, kw_only=True)
class NddShown:
    """Key numbers of a naturalistic model, read off its tables at grid points."""

    model: str = field(metadata=meant("File of the model."))
    model_hash: str = field(metadata=_MODEL_HASH)
    following: ShownFollowing = field(metadata=meant("Acceleration behind a leader."))
    support: ShownSupport = field(metadata=meant("Which accelerations are possible."))
    free_flow: ShownFreeFlow = field(metadata=meant("Acceleration without a leader."))
    lane_change: ShownLaneChanges = field(metadata=meant("Lane changes."))
    memory: dict[str, float] = field(
        metadata=meant("Weights and widths of the memory of followers, by name, 0 to 1; see `ndd.memory.Memory`.")
    )
    initial: ShownInitial = field(metadata=meant("Traffic at the start."))
    counted: ShownCounts | None = field(metadata=meant("Decisions that it rests on; null: it does not say."))
    provenance: ShownOrigin = field(metadata=meant("Where it comes from."))
    figures: tuple[str, ...] = field(
        metadata=meant("Files of the figures; none without `--out`; not in `numbers.json`.")
    )


@dataclass(frozen=True, kw_only=True)
class NddImported:
    """A naturalistic model made of published arrays, and what came from where."""

    files: dict[str, dict[str, float | str]] = field(
        metadata=meant(
            "By array: `name` and `sha256` of its file, and numbers that say what was done with it: rows, cells, those "
            "empty, filled or renormalised, and the misfit of a fitted law; the keys depend on the array."
        )
    )
    missing: tuple[str, ...] = field(metadata=meant("Arrays that are not there."))
    filled: tuple[str, ...] = field(metadata=meant("What comes from the other model, in plain words."))
    unused: tuple[str, ...] = field(metadata=meant("Files left unused because a preferred one is there."))
    notes: tuple[str, ...] = field(metadata=_NOTES)
    model_hash: str = field(metadata=_MODEL_HASH)
    report: str = field(metadata=meant("File of the report: this object without `report` and `out`."))
    out: str = field(metadata=_OUT)


@dataclass(frozen=True, kw_only=True)
class BadRows:
    """Rows of a file that were left out for one reason."""

    rows: int = field(metadata=meant("How many."))
    first_line: int = field(metadata=meant("Line of the first, from 1."))


@dataclass(frozen=True, kw_only=True)
class HeldOutScore:
    """How likely a fit holds the decisions of one file that it has not seen."""

    law: float | None = field(
        metadata=meant("Mean log-likelihood of the car-following law, at all speeds; null: no law.", "nat")
    )
    table: float | None = field(
        metadata=meant("Mean log-likelihood of the table, from 19.5 m/s on; null: no decision there.", "nat")
    )


@dataclass(frozen=True, kw_only=True)
class FittedLaneNumber:
    """One parameter of lane changes, fitted."""

    estimate: float = field(metadata=meant("Where the penalised likelihood is greatest.", "`unit`"))
    interval95: tuple[float, float] = field(
        metadata=meant("Its 95 % interval, from the curvature of the penalised likelihood.", "`unit`")
    )
    prior: float = field(metadata=meant("The shipped value.", "`unit`"))
    prior_interval95: tuple[float, float] = field(
        metadata=meant("The 95 % interval with which the prior enters.", "`unit`")
    )
    unit: str = field(metadata=meant('Unit of these numbers, "" for none.'))


@dataclass(frozen=True, kw_only=True)
class FittedLaneChanges:
    """Where the lane changes of a fitted model come from."""

    fitted: bool = field(metadata=meant("They were fitted to these files; else they are the shipped prior."))
    why: str = field(metadata=meant("Why they are the prior; empty if they were fitted."))
    changes: int = field(metadata=meant("Lane changes that can be used."))
    seconds: int = field(
        metadata=meant("Seconds at risk of a change, each of one vehicle to one side, changes among them.", "s")
    )
    vehicles: int = field(metadata=meant("Drivers of these seconds."))
    speed_median: float | None = field(metadata=meant("Median speed in these seconds; null: there are none.", "m/s"))
    left_out: dict[str, int] = field(metadata=meant("Seconds left out, changes among them, by reason.", "s"))
    changes_left_out: dict[str, int] = field(metadata=meant("Changes left out, by reason."))
    numbers: dict[str, FittedLaneNumber] = field(
        metadata=meant("By name, the fitted parameters of `ext.calibrate.lane_change.LaneChange`; empty for the prior.")
    )


@dataclass(frozen=True, kw_only=True)
class FittedPart:
    """Source of a part of a fitted model."""

    name: str = field(metadata=meant("The part, in words."))
    source: str = field(metadata=meant("fitted, fitted in part, or prior."))
    why: str = field(metadata=meant("On how many data, or why it stays the prior."))


@dataclass(frozen=True, kw_only=True)
class FitTraffic:
    """How often the traffic of a fit crashes, with the AV `idm-mobil` among it."""

    tests: int = field(metadata=meant("Tests driven."))
    av_crashes: int = field(metadata=meant("Tests that ended in a crash of the AV."))
    av_crashes_per_test: float = field(metadata=meant("`av_crashes` over `tests`.", "per test"))
    av_interval95: Interval = field(metadata=meant("Its exact interval (Clopper-Pearson).", "per test"))
    bv_crashes: int = field(metadata=meant("Crashes between two BVs."))
    bv_miles: float = field(metadata=meant("Distance that all BVs drove, from the mean of a sample.", "miles"))
    bv_crashes_per_mile: float = field(metadata=meant("`bv_crashes` over `bv_miles`.", "per BV-mile"))
    bv_interval95: Interval = field(metadata=meant("Its exact interval (Garwood).", "per BV-mile"))


@dataclass(frozen=True, kw_only=True)
class FitVariant:
    """The same files fitted with one choice changed."""

    variant: str = field(metadata=meant("What was changed, in words; the fit itself is the first."))
    held_out: dict[str, HeldOutScore] = field(metadata=meant("By file, its scores."))
    probes: tuple[tuple[float, float], ...] = field(
        metadata=meant(
            "Mean and standard deviation of the table's acceleration, at 20 and 30 m/s, each 30 m behind a leader at "
            "range rates 0 and -2 m/s.",
            "m/s2",
        )
    )
    traffic: FitTraffic | None = field(metadata=meant("How often its traffic crashes; null: it was not driven."))


@dataclass(frozen=True, kw_only=True)
class NddFitted:
    """A naturalistic model fitted to trajectories: what went in and what came out."""

    rows_read: int = field(metadata=meant("Rows of all files."))
    rows_used: int = field(metadata=meant("Rows that passed every check."))
    bad_rows: dict[str, dict[str, BadRows]] = field(metadata=meant("Rows left out, by file and reason."))
    decisions_fitted: int = field(metadata=meant("Decisions that were fitted on, one a second."))
    decisions_on_grid: int = field(metadata=meant("Decisions counted into the following table."))
    states: int = field(metadata=meant("Following states with at least one counted decision."))
    states_total: int = field(metadata=meant("Following states of the grid."))
    data_share_of_states: float = field(
        metadata=meant("Share of the table's probability that is counts, not prior, mean over all states, 0 to 1.")
    )
    data_share_where_data: float = field(
        metadata=meant("The same, mean over the counted decisions; 0 where there are none.")
    )
    speed_99_percent: float = field(metadata=meant("99 % point of the fitted decisions' speeds.", "m/s"))
    held_out_log_likelihood: dict[str, dict[str, float]] = field(
        metadata=meant(
            "By file with held-out decisions: their number (`decisions`, `table_decisions` from 19.5 m/s on), and the "
            "mean log-likelihood by `uniform`, `table` and each law, also on the decisions from 19.5 m/s on "
            "(`..._on_grid`).",
            "nat",
        )
    )
    notes: tuple[str, ...] = field(metadata=_NOTES)
    parts: tuple[FittedPart, ...] = field(metadata=meant("What each part of the model comes from."))
    lane_changes: FittedLaneChanges = field(metadata=meant("How its lane changes were fitted."))
    sensitivity: tuple[FitVariant, ...] = field(
        metadata=meant("What other choices would have given; empty without `--study`.")
    )
    format: str = field(metadata=meant("Format of the files: the one named, or else the one guessed."))
    model_hash: str = field(metadata=_MODEL_HASH)
    report: str = field(metadata=meant("File of the report."))
    out: str = field(metadata=_OUT)
