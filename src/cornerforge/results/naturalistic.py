"""Results of `ndd fit`, `ndd import` and `ndd show`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.html import Result
from cornerforge.results.rates import Interval

__all__ = [
    "BadRows",
    "FitReport",
    "FitTraffic",
    "FitVariant",
    "FittedLaneChanges",
    "FittedLaneNumber",
    "FittedPart",
    "HeldOutScore",
    "ImportReport",
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


class ShownFollowing(Result):
    """Accelerations of a model's drivers behind a leader."""

    speed_mps: Annotated[tuple[float, ...], _SPEEDS]
    gap_m: Annotated[tuple[float, ...], _GAPS]
    range_rate_mps: Annotated[tuple[float, ...], _RATES]
    mean_mps2: Annotated[Table, meant("Mean, by speed, gap and range rate.", "m/s2")]
    sd_mps2: Annotated[Table, meant("Standard deviation, by speed, gap and range rate.", "m/s2")]


class ShownSupport(Result):
    """How many of the 31 accelerations are possible in the states of a model."""

    following_possible_min: Annotated[Whole, meant("Fewest in a following state.")]
    following_possible_mean: Annotated[float, meant("Mean over following states.")]
    following_possible_max: Annotated[Whole, meant("Most in a following state.")]
    following_states_with_one: Annotated[Whole, meant("Following states in which only one is possible.")]
    following_states_that_allow_hardest_braking: Annotated[
        float, meant("Share of following states in which -4 m/s2 is possible, 0 to 1.")
    ]
    free_possible_min: Annotated[Whole, meant("Fewest at a speed of free flow.")]
    free_possible_max: Annotated[Whole, meant("Most at a speed of free flow.")]


class PublishedFree(Result):
    """Published accelerations in free flow at one speed (IVBSS)."""

    speed_mps: Annotated[float, meant("The speed.", "m/s")]
    sd_mps2: Annotated[float, meant("Standard deviation.", "m/s2")]
    share_braking_1_mps2: Annotated[float, meant("Share at or below -1 m/s2, 0 to 1.")]
    mean_mps2: Annotated[tuple[float, float], meant("Ends of the range of the mean.", "m/s2")]


class ShownFreeFlow(Result):
    """Accelerations of a model's drivers without a leader."""

    speed_mps: Annotated[tuple[float, ...], meant("All speeds of the grid.", "m/s")]
    mean_mps2: Annotated[tuple[float, ...], meant("Mean, by speed.", "m/s2")]
    sd_mps2: Annotated[tuple[float, ...], meant("Standard deviation, by speed.", "m/s2")]
    share_braking_1_mps2: Annotated[tuple[float, ...], meant("Share at or below -1 m/s2, by speed, 0 to 1.")]
    published: Annotated[tuple[PublishedFree, ...], meant("Published facts.")]
    pull_per_s: Annotated[
        float,
        meant("Mean acceleration of a driver, above the mean, per m/s that it lacks to its desired speed.", "1/s"),
    ]


class ShownLaneChanges(Result):
    """How a model's drivers change lanes."""

    base_per_decision_and_side: Annotated[
        tuple[float, float], meant("Smallest and largest base chance over speeds, 0 to 1.", "per decision and side")
    ]
    desire_free: Annotated[float, meant("Factor on the base chance without a leader.")]
    gap_m: Annotated[tuple[float, ...], _GAPS]
    range_rate_mps: Annotated[tuple[float, ...], _RATES]
    desire: Annotated[
        tuple[tuple[float, ...], ...], meant("Factor on the base chance, by gap and range rate to the leader.")
    ]
    gap_accepted_half_lead_m: Annotated[
        tuple[float | None, ...],
        meant("Smallest gap ahead that half or more accept, by range rate; null: none on the grid.", "m"),
    ]
    gap_accepted_half_rear_m: Annotated[
        tuple[float | None, ...],
        meant("Smallest gap behind that half or more accept, by range rate; null: none on the grid.", "m"),
    ]
    gap_always_refused_rear_m: Annotated[
        tuple[float | None, ...],
        meant("Largest gap behind up to which all are refused, by range rate; null: none is.", "m"),
    ]
    gap_turned_back_for_m: Annotated[
        tuple[float | None, ...],
        meant("Largest gap up to which all turn back in a running change, by range rate; null: none does.", "m"),
    ]
    overlook: Annotated[float, meant("Chance to overlook a neighbour when changing lanes, 0 to 1.")]
    overlook_conflict: Annotated[
        float, meant("Chance to overlook another vehicle that moves to the same place, 0 to 1.")
    ]
    duration_median_s: Annotated[float | None, meant("Median time of a lane change; null: as the ODD says.", "s")]
    signal_share: Annotated[float, meant("Drivers who set the indicator before they change lanes, 0 to 1.")]
    away_per_second: Annotated[float, meant("Chance per second to look away from the road, 0 to 1.")]
    away_again: Annotated[float, meant("Chance to look away in the next second too, 0 to 1.")]


class ShownSpeeds(Result):
    """Speeds at the start."""

    mean: Annotated[float, meant("Mean.", "m/s")]
    sd: Annotated[float, meant("Standard deviation.", "m/s")]
    quantiles: Annotated[dict[str, float], _QUANTILES]
    published: Annotated[dict[str, float], _PUBLISHED]


class ShownQuantiles(Result):
    """Quantiles of gaps or time gaps at the start."""

    quantiles: Annotated[dict[str, float], _QUANTILES]
    published: Annotated[dict[str, float], _PUBLISHED]


class ShownInitial(Result):
    """Traffic at the start of a test."""

    parameters: Annotated[dict[str, float], meant("Parameters of its law, by name.", "as its name says")]
    speed_mps: Annotated[ShownSpeeds, meant("Speeds.", "m/s")]
    gap_m: Annotated[ShownQuantiles, meant("Gaps of vehicles that follow.", "m")]
    time_gap_s: Annotated[ShownQuantiles, meant("Time gaps of vehicles that follow.", "s")]
    range_rate_sd_mps: Annotated[float, meant("Standard deviation of the range rates of vehicles that follow.", "m/s")]
    follow_share: Annotated[float, meant("Share of vehicles that follow, 0 to 1.")]


class ShownCounts(Result):
    """Recorded decisions that a model rests on."""

    following_decisions: Annotated[Whole, meant("Decisions counted behind a leader.")]
    following_states: Annotated[Whole, meant("Following states with at least one of them.")]
    following_states_total: Annotated[Whole, meant("Following states of the grid.")]
    following_decisions_by_speed: Annotated[tuple[Whole, ...], meant("The decisions by speed of the grid.")]
    free_decisions_by_speed: Annotated[
        tuple[Whole, ...] | None, meant("Decisions counted in free flow, by speed of the grid; null: not stated.")
    ]
    prior_strength: Annotated[float | None, meant("Decisions that the prior is worth in each state; null: not stated.")]
    data_share_of_states: Annotated[
        float | None, meant("Share of the table that is counts, not prior, mean over states, 0 to 1; null: not stated.")
    ]


class ShownOrigin(Result):
    """Where a model comes from, as its file says."""

    made_by: Annotated[str | None, meant("Program and version; null: not stated.")]
    attribution: Annotated[str | None, meant("Whose data it is made of; null: not stated.")]
    licence: Annotated[str | None, meant("Licence of the data; null: not stated.")]
    files: Annotated[tuple[str | None, ...], meant("Names of the data files; null: a file without a name.")]
    filled: Annotated[tuple[str, ...], meant("What an import took from another model, in plain words.")]


class NddShown(Result):
    """Key numbers of a naturalistic model, read off its tables at grid points."""

    model: Annotated[str, meant("File of the model.")]
    model_hash: Annotated[str, _MODEL_HASH]
    following: Annotated[ShownFollowing, meant("Acceleration behind a leader.")]
    support: Annotated[ShownSupport, meant("Which accelerations are possible.")]
    free_flow: Annotated[ShownFreeFlow, meant("Acceleration without a leader.")]
    lane_change: Annotated[ShownLaneChanges, meant("Lane changes.")]
    memory: Annotated[
        dict[str, float],
        meant("Weights and widths of the memory of followers, by name, 0 to 1; see `ndd.memory.Memory`."),
    ]
    initial: Annotated[ShownInitial, meant("Traffic at the start.")]
    counted: Annotated[ShownCounts | None, meant("Decisions that it rests on; null: it does not say.")]
    provenance: Annotated[ShownOrigin, meant("Where it comes from.")]
    figures: Annotated[tuple[str, ...], meant("Files of the figures; none without `--out`; not in `numbers.json`.")]


class ImportReport(Result):
    """Sources of the parts of a naturalistic model that was made of published arrays."""

    files: Annotated[
        dict[str, dict[str, float | str]],
        meant(
            "By array: `name` and `sha256` of its file, and numbers that say what was done with it: rows, cells, those "
            "empty, filled or renormalised, and the misfit of a fitted law; the keys depend on the array."
        ),
    ]
    missing: Annotated[tuple[str, ...], meant("Arrays that are not there.")]
    filled: Annotated[tuple[str, ...], meant("What comes from the other model, in plain words.")]
    unused: Annotated[tuple[str, ...], meant("Files left unused because a preferred one is there.")]
    notes: Annotated[tuple[str, ...], _NOTES]
    model_hash: Annotated[str, _MODEL_HASH]


class NddImported(ImportReport):
    """A naturalistic model made of published arrays, and what came from where."""

    report: Annotated[str, meant("File of the report: this object without `report` and `out`.")]
    out: Annotated[str, _OUT]


class BadRows(Result):
    """Rows of a file that were left out for one reason."""

    rows: Annotated[Whole, meant("How many.")]
    first_line: Annotated[Whole, meant("Line of the first, from 1.")]


class HeldOutScore(Result):
    """How likely a fit holds the decisions of one file that it has not seen."""

    law: Annotated[
        float | None, meant("Mean log-likelihood of the car-following law, at all speeds; null: no law.", "nat")
    ]
    table: Annotated[
        float | None, meant("Mean log-likelihood of the table, from 19.5 m/s on; null: no decision there.", "nat")
    ]


class FittedLaneNumber(Result):
    """One parameter of lane changes, fitted."""

    estimate: Annotated[float, meant("Where the penalised likelihood is greatest.", "`unit`")]
    interval95: Annotated[
        tuple[float, float], meant("Its 95 % interval, from the curvature of the penalised likelihood.", "`unit`")
    ]
    prior: Annotated[float, meant("The shipped value.", "`unit`")]
    prior_interval95: Annotated[tuple[float, float], meant("The 95 % interval with which the prior enters.", "`unit`")]
    unit: Annotated[str, meant('Unit of these numbers, "" for none.')]


class FittedLaneChanges(Result):
    """Where the lane changes of a fitted model come from."""

    fitted: Annotated[bool, meant("They were fitted to these files; else they are the shipped prior.")]
    why: Annotated[str, meant("Why they are the prior; empty if they were fitted.")]
    changes: Annotated[Whole, meant("Lane changes that can be used.")]
    seconds: Annotated[
        Whole, meant("Seconds at risk of a change, each of one vehicle to one side, changes among them.", "s")
    ]
    vehicles: Annotated[Whole, meant("Drivers of these seconds.")]
    speed_median: Annotated[float | None, meant("Median speed in these seconds; null: there are none.", "m/s")]
    left_out: Annotated[dict[str, Whole], meant("Seconds left out, changes among them, by reason.", "s")]
    changes_left_out: Annotated[dict[str, Whole], meant("Changes left out, by reason.")]
    numbers: Annotated[
        dict[str, FittedLaneNumber],
        meant("By name, the fitted parameters of `ext.calibrate.lane_change.LaneChange`; empty for the prior."),
    ]


class FittedPart(Result):
    """Source of a part of a fitted model."""

    name: Annotated[str, meant("The part, in words.")]
    source: Annotated[str, meant("fitted, fitted in part, or prior.")]
    why: Annotated[str, meant("On how many data, or why it stays the prior.")]


class FitTraffic(Result):
    """How often the traffic of a fit crashes, with the AV `idm-mobil` among it."""

    tests: Annotated[Whole, meant("Tests driven.")]
    av_crashes: Annotated[Whole, meant("Tests that ended in a crash of the AV.")]
    av_crashes_per_test: Annotated[float, meant("`av_crashes` over `tests`.", "per test")]
    av_interval95: Annotated[Interval, meant("Its exact interval (Clopper-Pearson).", "per test")]
    bv_crashes: Annotated[Whole, meant("Crashes between two BVs.")]
    bv_miles: Annotated[float, meant("Distance that all BVs drove, from the mean of a sample.", "miles")]
    bv_crashes_per_mile: Annotated[float, meant("`bv_crashes` over `bv_miles`.", "per BV-mile")]
    bv_interval95: Annotated[Interval, meant("Its exact interval (Garwood).", "per BV-mile")]


class FitVariant(Result):
    """The same files fitted with one choice changed."""

    variant: Annotated[str, meant("What was changed, in words; the fit itself is the first.")]
    held_out: Annotated[dict[str, HeldOutScore], meant("By file, its scores.")]
    probes: Annotated[
        tuple[tuple[float, float], ...],
        meant(
            "Mean and standard deviation of the table's acceleration, at 20 and 30 m/s, each 30 m behind a leader at "
            "range rates 0 and -2 m/s.",
            "m/s2",
        ),
    ]
    traffic: Annotated[FitTraffic | None, meant("How often its traffic crashes; null: it was not driven.")]


class FitReport(Result):
    """Inputs and results of a fit of a naturalistic model."""

    rows_read: Annotated[Whole, meant("Rows of all files.")]
    rows_used: Annotated[Whole, meant("Rows that passed every check.")]
    bad_rows: Annotated[dict[str, dict[str, BadRows]], meant("Rows left out, by file and reason.")]
    decisions_fitted: Annotated[Whole, meant("Decisions that were fitted on, one a second.")]
    decisions_on_grid: Annotated[Whole, meant("Decisions counted into the following table.")]
    states: Annotated[Whole, meant("Following states with at least one counted decision.")]
    states_total: Annotated[Whole, meant("Following states of the grid.")]
    data_share_of_states: Annotated[
        float, meant("Share of the table's probability that is counts, not prior, mean over all states, 0 to 1.")
    ]
    data_share_where_data: Annotated[float, meant("The same, mean over the counted decisions; 0 where there are none.")]
    speed_99_percent: Annotated[float, meant("99 % point of the fitted decisions' speeds.", "m/s")]
    held_out_log_likelihood: Annotated[
        dict[str, dict[str, float]],
        meant(
            "By file with held-out decisions: their number (`decisions`, `table_decisions` from 19.5 m/s on), and the "
            "mean log-likelihood by `uniform`, `table` and each law, also on the decisions from 19.5 m/s on "
            "(`..._on_grid`).",
            "nat",
        ),
    ]
    notes: Annotated[tuple[str, ...], _NOTES]
    parts: Annotated[tuple[FittedPart, ...], meant("What each part of the model comes from.")]
    lane_changes: Annotated[FittedLaneChanges, meant("How its lane changes were fitted.")]
    sensitivity: Annotated[
        tuple[FitVariant, ...], meant("What other choices would have given; empty without `--study`.")
    ]


class NddFitted(FitReport):
    """A naturalistic model fitted to trajectories: what went in and what came out."""

    format: Annotated[str, meant("Format of the files: the one named, or else the one guessed.")]
    model_hash: Annotated[str, _MODEL_HASH]
    report: Annotated[str, meant("File of the report.")]
    out: Annotated[str, _OUT]
