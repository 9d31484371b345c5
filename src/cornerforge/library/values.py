"""Relations between the values of a library: of a case, of its trajectories, and of the two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge._objects import is_hex
from cornerforge._values import Ragged, Relation, case_namer, table_fault
from cornerforge.drivers.rails import POSE_NUMBERS
from cornerforge.fields import BODY, CASES, HISTORY_SHAPE, SERIES, Field
from cornerforge.library.schema import RAILS_TRACKS
from cornerforge.results.analysis import CrashType
from cornerforge.sim import LIMITS, START_FIELDS, n_slots
from cornerforge.types import FRAME_S, Odd

__all__ = ["CASE_RELATIONS", "TRACK_RELATIONS", "ShardFacts", "cases_fault", "tracks_fault"]

Holds = NDArray[np.bool_]
Values = Mapping[str, Any]

_CLOSE = 1e-6
_CLOSE_AS_FLOAT32 = 2e-3
"""Of positions and speeds below some kilometres, rounded to float32."""
_LIMITS = {f"{who}_max_{what}_mps2": most for who in ("av", "bv") for what, most in LIMITS.items()}
_LEAST_START = 10
"""Fewest numbers of a vehicle's start, as the earliest scripted cases have."""


@dataclass(frozen=True)
class ShardFacts:
    """Facts of a shard in the manifest.

    Attributes:
        seed: Of the run.
        odd: Road and rules.
        first_test, last_test: Of the shard.
        cases: The shard's cases, by column, for checks of its trajectories; None: not read.
    """

    seed: int
    odd: Odd
    first_test: int
    last_test: int
    cases: Mapping[str, Any] | None = None


_CRASH_TYPES = get_args(CrashType)


def _ascending(v: Values, facts: ShardFacts) -> Holds:
    test = v["test"]
    inside = (test >= facts.first_test) & (test <= facts.last_test)
    inside[1:] &= np.diff(test) > 0
    return np.asarray(inside)


def _named(v: Values, _: Any) -> Holds:
    pairs = zip(v["seed"].tolist(), v["test"].tolist(), v["case_id"].tolist(), strict=True)
    return np.array([name == f"{seed}:{test}" for seed, test, name in pairs], dtype=bool)


def _history(v: Values) -> NDArray[np.float64]:
    """The last known moment of AV and partner: x, y, speed, heading; (n, 2, 4)."""
    return np.asarray(v["history"].flat.reshape(-1, *HISTORY_SHAPE)[:, 0], dtype=np.float64)


def _far(found: NDArray[Any], stated: NDArray[Any], size: NDArray[Any] | float) -> Holds:
    """Are numbers apart by more than float32 explains, of numbers of this size?"""
    return np.asarray(np.abs(found - stated) > _CLOSE_AS_FLOAT32 + 1e-6 * np.abs(size))


def _is_hex(v: Values, _: Any) -> Holds:
    return np.array([is_hex(one) for one in v["trajectory_digest"].tolist()], np.bool_)


def _policies(v: Values, _: Any) -> Holds:
    return np.array([is_hex(one) and len(one) == 16 for one in v["policy"].tolist()], np.bool_)


def _known(column: str) -> Relation:
    """An acceleration of the AV is known where there are frames enough."""
    return Relation(
        column,
        "there, in a crash after 0.3 s or more",
        ("crash_time_s",),
        lambda v, _: np.isfinite(v[column]) | (v["crash_time_s"] < 0.3),
    )


def _whole_shortfall(v: Values, _: Any) -> Holds:
    """Tell where a value holds or is not recorded (NaN)."""
    whole, possible, implausible = v["shortfall_nats"], v["possible_shortfall_nats"], v["n_implausible"]
    unknown = np.isnan(whole) | np.isnan(possible) | np.isnan(implausible)
    wanted = np.where(implausible > 0, np.inf, possible)
    return np.asarray(unknown | (whole == wanted) | (np.abs(whole - possible) <= _CLOSE) & (implausible == 0))


def _plausible(v: Values, _: Any) -> Holds:
    """Whether no limit is broken; NaN, of what was not seen, breaks none."""
    broken = np.zeros(v["physically_plausible"].size, dtype=bool)
    for column, most in _LIMITS.items():
        broken |= v[column] > most
    return np.asarray(v["physically_plausible"] == ~broken)


CASE_RELATIONS: tuple[Relation, ...] = (
    Relation("seed", "the seed of the library's run", (), lambda v, f: v["seed"] == f.seed),
    Relation("test", "ascending, within what the manifest says of the shard", (), _ascending),
    Relation("case_id", "seed:test", ("seed", "test"), _named),
    Relation("n_vehicles", "at most the slots of the road", (), lambda v, f: v["n_vehicles"] <= n_slots(f.odd)),
    Relation("trajectory_digest", "1 to 64 hex digits", (), _is_hex),
    Relation(
        "crash_type", f"one of: {', '.join(_CRASH_TYPES)}", ("mechanism",),
        lambda v, _: np.isin(v["crash_type"].astype(np.str_), _CRASH_TYPES),
    ),
    Relation("policy", "16 hex digits", ("log_prob_policy",), _policies),
    Relation(
        "crash_time_s", "at most the time limit of a test", (), lambda v, f: v["crash_time_s"] <= f.odd.time_limit + 1.0
    ),
    Relation(
        "duration_s", "crash_time_s", ("crash_time_s",),
        lambda v, _: np.abs(v["duration_s"] - v["crash_time_s"]) <= FRAME_S + _CLOSE,
    ),
    Relation(
        "impact_speed_difference_mps", "bv_speed_mps - av_speed_mps", ("av_speed_mps", "bv_speed_mps"),
        lambda v, _: np.abs(v["bv_speed_mps"] - v["av_speed_mps"] - v["impact_speed_difference_mps"]) <= _CLOSE,
    ),
    Relation(
        "n_decisions", "one for each second before the contact", ("crash_time_s",),
        lambda v, _: np.abs(v["n_decisions"] - v["crash_time_s"]) <= 1.0 + FRAME_S + _CLOSE,
    ),
    Relation(
        "n_impossible", "at most n_decisions", ("n_decisions",), lambda v, _: v["n_impossible"] <= v["n_decisions"]
    ),
    Relation(
        "n_implausible", "at most n_decisions", ("n_decisions",), lambda v, _: ~(v["n_implausible"] > v["n_decisions"])
    ),
    Relation(
        "log_prob_nde", "missing where n_impossible is above 0, and there alone", ("n_impossible",),
        lambda v, _: np.isnan(v["log_prob_nde"]) == (v["n_impossible"] > 0),
    ),
    Relation(
        "shortfall_nats", "inf where n_implausible is above 0, else possible_shortfall_nats",
        ("n_implausible", "possible_shortfall_nats"), _whole_shortfall,
    ),
    *(_known(f"av_max_{what}_mps2") for what in LIMITS),
    Relation("physically_plausible", "true where no acceleration is beyond its limit", tuple(_LIMITS), _plausible),
    Relation(
        "possible_shortfall_nats", "at most shortfall_nats", ("shortfall_nats",),
        lambda v, _: ~(v["possible_shortfall_nats"] > v["shortfall_nats"] + _CLOSE),
    ),
    Relation(
        "critical_bv_action", "one for each decision", ("n_decisions",),
        lambda v, _: v["critical_bv_action"].sizes == v["n_decisions"],
    ),
    Relation(
        "av_speed_mps", "the AV's speed in the last second of history", ("history",),
        lambda v, _: ~_far(_history(v)[:, 0, 2], v["av_speed_mps"], 1.0),
    ),
    Relation(
        "bv_speed_mps", "the partner's speed in the last second of history", ("history",),
        lambda v, _: ~_far(_history(v)[:, 1, 2], v["bv_speed_mps"], 1.0),
    ),
    Relation(
        "relative_lat_m", "the difference of y in the last second of history", ("history",),
        lambda v, _: ~_far(_history(v)[:, 1, 1] - _history(v)[:, 0, 1], v["relative_lat_m"], _history(v)[:, 0, 1]),
    ),
)  # fmt: skip
"""Of the cases of a shard."""


def _has(name: str, size: Any) -> Any:
    """Make a check of the length of lists."""
    return lambda v, f: v[name].sizes == size(v, f)


def _vehicles(v: Values, _: Any = None) -> NDArray[np.int64]:
    return np.asarray(v["slot"].sizes)


def _frames(v: Values, _: Any = None) -> NDArray[np.int64]:
    return np.asarray(v["slot"].sizes * v["n_frames"])


def _decisions(v: Values, _: Any = None) -> NDArray[np.int64]:
    return np.asarray(v["slot"].sizes * v["critical_bv"].sizes)


def _all(rows: NDArray[np.int64], holds: Holds, n: int) -> Holds:
    """Does it hold for all values of each row?"""
    whole = np.ones(n, dtype=bool)
    whole[rows[~holds]] = False
    return whole


def _slots(v: Values, _: Any) -> Holds:
    slot: Ragged = v["slot"]
    fine = slot.sizes >= 2
    fine &= slot.flat[np.minimum(slot.first, max(slot.flat.size - 1, 0))] == 0 if slot.flat.size else False
    rises = np.diff(slot.flat) > 0
    same = np.diff(slot.row) == 0
    return np.asarray(fine & _all(slot.row[1:], rises | ~same, slot.sizes.size))


def _lanes(v: Values, facts: ShardFacts) -> Holds:
    lane: Ragged = v["target_lane"]
    return _all(lane.row, lane.flat < facts.odd.n_lanes, lane.sizes.size)


def _presence(v: Values, _: Any) -> Holds:
    x: Ragged = v["x_m"]
    return _all(x.row, np.isfinite(x.flat) == v["present"].flat.astype(bool), x.sizes.size)


def _av_present(v: Values, _: Any) -> Holds:
    present: Ragged = v["present"]
    of_av = np.arange(present.flat.size) - present.first[present.row] < v["n_frames"][present.row]
    return _all(present.row, present.flat.astype(bool) | ~of_av, present.sizes.size)


def _critical(v: Values, _: Any) -> Holds:
    critical: Ragged = v["critical_bv"]
    return _all(critical.row, critical.flat < v["slot"].sizes[critical.row], critical.sizes.size)


def _start(v: Values, _: Any) -> Holds:
    numbers, rest = np.divmod(v["start"].sizes, v["slot"].sizes)
    return np.asarray((rest == 0) & (numbers >= _LEAST_START) & (numbers <= len(START_FIELDS)))


def _same_case(v: Values, facts: ShardFacts) -> Holds:
    return np.asarray(v["case_id"] == facts.cases["case_id"]) if facts.cases is not None else _unknown(v)


def _unknown(v: Values) -> Holds:
    return np.ones(v["n_frames"].size, dtype=bool)


def _as_the_case(v: Values, facts: ShardFacts) -> Holds:
    if facts.cases is None or "crash_time_s" not in facts.cases:
        return _unknown(v)
    return np.asarray(np.abs((v["n_frames"] - 1) * FRAME_S - facts.cases["crash_time_s"]) <= FRAME_S + _CLOSE)


def _decided_as_the_case(v: Values, facts: ShardFacts) -> Holds:
    if facts.cases is None or "n_decisions" not in facts.cases:
        return _unknown(v)
    return np.asarray(v["critical_bv"].sizes == facts.cases["n_decisions"])


def _ends_as_the_case(name: str, column: str) -> Any:
    """Make a check of the AV's last value against the case."""

    def holds(v: Values, facts: ShardFacts) -> Holds:
        if facts.cases is None or column not in facts.cases:
            return _unknown(v)
        series: Ragged = v[name]
        last = series.flat[series.first + v["n_frames"] - 1].astype(np.float64)
        return ~_far(last, facts.cases[column], 1.0)

    return holds


def _of_the_vehicles(v: Values, facts: ShardFacts) -> Holds:
    """Some or all of them; cases that were made from others keep their slots, so these may be higher."""
    if facts.cases is None or "n_vehicles" not in facts.cases:
        return _unknown(v)
    return np.asarray(v["slot"].sizes <= facts.cases["n_vehicles"])


def _partner_stored(v: Values, facts: ShardFacts) -> Holds:
    if facts.cases is None or "bv_slot" not in facts.cases:
        return _unknown(v)
    slot: Ragged = v["slot"]
    found = np.zeros(slot.sizes.size, dtype=bool)
    found[slot.row[slot.flat == facts.cases["bv_slot"][slot.row]]] = True
    return found


_PER_FRAME = "n_frames for each vehicle of slot"
TRACK_RELATIONS: tuple[Relation, ...] = (
    Relation("case_id", "that of the same row of the cases file", ("n_frames",), _same_case),
    Relation("slot", "at least two, ascending, the AV's 0 first", (), _slots),
    Relation("slot", "with the crash partner among them", ("n_frames",), _partner_stored),
    Relation("slot", "at most n_vehicles of the case", ("n_frames",), _of_the_vehicles),
    Relation("n_frames", "one each 0.1 s until crash_time_s", (), _as_the_case),
    *(
        Relation(body.column.name, "one for each vehicle of slot", ("slot",), _has(body.column.name, _vehicles))
        for body in BODY
    ),
    *(
        Relation(one.column.name, _PER_FRAME, ("slot", "n_frames"), _has(one.column.name, _frames))
        for one in SERIES
    ),
    Relation("critical_bv", "one for each decision of the case", ("n_frames",), _decided_as_the_case),
    Relation(
        "action", "one for each decision of each vehicle of slot", ("slot", "critical_bv"), _has("action", _decisions)
    ),
    Relation(
        "decision_log_prob_nde", "one for each decision", ("critical_bv",),
        _has("decision_log_prob_nde", lambda v, _: v["critical_bv"].sizes),
    ),
    Relation("critical_bv", "-1, or an index into slot", ("slot",), _critical),
    Relation("target_lane", "a lane of the road, or -1", (), _lanes),
    Relation("x_m", "finite where the vehicle is present, NaN elsewhere", ("present",), _presence),
    Relation("present", "true of the AV in all frames", ("n_frames",), _av_present),
    Relation(
        "speed_mps", "at the end, of the AV, av_speed_mps of the case", ("n_frames",),
        _ends_as_the_case("speed_mps", "av_speed_mps"),
    ),
    Relation("start", "the numbers of a start for each vehicle of slot", ("slot",), _start),
    Relation(
        "rails", f"{POSE_NUMBERS} numbers for each vehicle of slot at each of some frames", ("slot",),
        lambda v, _: (v["rails"].sizes > 0) & (v["rails"].sizes % (POSE_NUMBERS * v["slot"].sizes) == 0),
    ),
)  # fmt: skip
"""Of the trajectories of a shard, and between them and its cases."""


def cases_fault(table: pa.Table, facts: ShardFacts, own: Sequence[Field] = ()) -> str | None:
    """Say the first thing that is wrong with some or all columns of a shard's cases, `own` ones too; or None."""
    return table_fault(table, (*CASES, *own), CASE_RELATIONS, facts, case_namer(table))


def tracks_fault(table: pa.Table, facts: ShardFacts) -> str | None:
    """Say the first thing that is wrong with a shard's trajectories, or with the same rows of both tables; or None."""
    if facts.cases is not None and len(facts.cases["case_id"]) != table.num_rows:
        return f"it holds {table.num_rows} rows; it must be as many as the cases file holds"
    return table_fault(table, _TRACKS, TRACK_RELATIONS, facts, case_namer(table))


_TRACKS: Sequence[Field] = RAILS_TRACKS
