"""What holds between the values of a row that cornerforge writes: of a case, its trajectories, and its analysis."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import pyarrow.parquet as pq

from cornerforge.analysis.avoidability import LABELS
from cornerforge.analysis.conduct import CONDUCTS
from cornerforge.analysis.fault import FAULTS
from cornerforge.drivers.rails import POSE_NUMBERS
from cornerforge.fields import BODY, HISTORY_SHAPE, SERIES
from cornerforge.library import CaseLibrary
from cornerforge.results.analysis import CrashType
from cornerforge.sim import n_slots, scripted
from cornerforge.sim.harvest import LIMITS
from cornerforge.types import FRAME_S, Odd

__all__ = ["ANALYSIS", "RELATIONS", "Relation", "Row", "analysed_rows", "broken", "rows_of"]


class Row(NamedTuple):
    """A case `c` and its trajectories `t`, by column, null as None; and the ODD."""

    c: Mapping[str, Any]
    t: Mapping[str, Any]
    odd: Odd


class Relation(NamedTuple):
    """What a column must be: completes "it must be ..."."""

    column: str
    must: str
    holds: Callable[[Row], bool]


def _close(a: float, b: float, far: float = 1e-6) -> bool:
    return abs(a - b) <= far


def _last(row: Row) -> np.ndarray:
    """AV and partner in the last second of history: x, y, speed, heading; float32, so some millimetres off."""
    return np.reshape(np.array(row.c["history"], np.float64), HISTORY_SHAPE)[0]


def _sizes(name: str, many: Callable[[Row], int]) -> Callable[[Row], bool]:
    return lambda r: len(r.t[name]) == many(r)


def _vehicles(r: Row) -> int:
    return len(r.t["slot"])


def _within_limits(r: Row) -> bool:
    """NaN and null, of what was not seen, break no limit."""
    found = {f"{who}_max_{what}_mps2": most for who in ("av", "bv") for what, most in LIMITS.items()}
    return all(r.c[name] is None or not r.c[name] > most for name, most in found.items())


def _known(name: str) -> Callable[[Row], bool]:
    return lambda r: r.c[name] is not None or r.c["crash_time_s"] < 0.3


def _as_long_as(name: str, other: str) -> Callable[[Row], bool]:
    return lambda r: len(r.t[name] or ()) == len(r.t[other] or ())


def _there_with_latest(name: str) -> Callable[[Row], bool]:
    return lambda r: bool(r.t[name]) == (r.t["latest_any_s"] is not None)


def _shortfall(r: Row) -> bool:
    whole, possible, implausible = (r.c[n] for n in ("shortfall_nats", "possible_shortfall_nats", "n_implausible"))
    if None in (whole, possible, implausible):
        return True
    return bool(whole == math.inf if implausible else _close(whole, possible))


RELATIONS: tuple[Relation, ...] = (
    Relation("case_id", "seed:test", lambda r: r.c["case_id"] == f"{r.c['seed']}:{r.c['test']}"),
    Relation("n_vehicles", "at most the slots of the road", lambda r: r.c["n_vehicles"] <= n_slots(r.odd)),
    Relation(
        "trajectory_digest", "1 to 64 hex digits",
        lambda r: bool(re.fullmatch("[0-9a-f]{1,64}", r.c["trajectory_digest"])),
    ),
    Relation(
        "policy", "16 hex digits, where policies drive",
        lambda r: "log_prob_policy" not in r.c or bool(re.fullmatch("[0-9a-f]{16}", r.c.get("policy", "0" * 16))),
    ),
    Relation(
        "crash_time_s", "at most the time limit of a test", lambda r: r.c["crash_time_s"] <= r.odd.time_limit + 1.0
    ),
    Relation(
        "duration_s", "crash_time_s", lambda r: _close(r.c["duration_s"], r.c["crash_time_s"], FRAME_S + 1e-6)
    ),
    Relation(
        "impact_speed_difference_mps", "bv_speed_mps - av_speed_mps",
        lambda r: _close(r.c["bv_speed_mps"] - r.c["av_speed_mps"], r.c["impact_speed_difference_mps"]),
    ),
    Relation(
        "n_decisions", "one for each second before the contact",
        lambda r: _close(r.c["n_decisions"], r.c["crash_time_s"], 1.0 + FRAME_S + 1e-6),
    ),
    Relation("n_impossible", "at most n_decisions", lambda r: r.c["n_impossible"] <= r.c["n_decisions"]),
    Relation("n_implausible", "at most n_decisions", lambda r: (r.c["n_implausible"] or 0) <= r.c["n_decisions"]),
    Relation(
        "log_prob_nde", "missing where n_impossible is above 0, and there alone",
        lambda r: (r.c["log_prob_nde"] is None) == (r.c["n_impossible"] > 0),
    ),
    Relation("shortfall_nats", "inf where n_implausible is above 0, else possible_shortfall_nats", _shortfall),
    *(
        Relation(
            f"av_max_{what}_mps2", "there, in a crash after 0.3 s or more",
            _known(f"av_max_{what}_mps2"),
        )
        for what in LIMITS
    ),
    Relation(
        "physically_plausible", "true where no acceleration is beyond its limit",
        lambda r: r.c["physically_plausible"] == _within_limits(r),
    ),
    Relation(
        "critical_bv_action", "one for each decision", lambda r: len(r.c["critical_bv_action"]) == r.c["n_decisions"]
    ),
    Relation(
        "av_speed_mps", "the AV's speed in the last second of history",
        lambda r: _close(_last(r)[0, 2], r.c["av_speed_mps"], 2e-3),
    ),
    Relation(
        "bv_speed_mps", "the partner's speed in the last second of history",
        lambda r: _close(_last(r)[1, 2], r.c["bv_speed_mps"], 2e-3),
    ),
    Relation(
        "relative_lat_m", "the difference of y in the last second of history",
        lambda r: _close(_last(r)[1, 1] - _last(r)[0, 1], r.c["relative_lat_m"], 2e-3),
    ),
    Relation("case_id", "that of the same row of the cases file", lambda r: r.t["case_id"] == r.c["case_id"]),
    Relation(
        "slot", "at least two, ascending, the AV's 0 first",
        lambda r: _vehicles(r) >= 2 and r.t["slot"] == sorted(set(r.t["slot"])) and r.t["slot"][0] == 0,
    ),
    Relation("slot", "with the crash partner among them", lambda r: r.c["bv_slot"] in r.t["slot"]),
    Relation("slot", "at most n_vehicles of the case", lambda r: _vehicles(r) <= r.c["n_vehicles"]),
    Relation(
        "n_frames", "one each 0.1 s until crash_time_s",
        lambda r: _close((r.t["n_frames"] - 1) * FRAME_S, r.c["crash_time_s"], FRAME_S + 1e-6),
    ),
    *(Relation(one.column.name, "one for each vehicle of slot", _sizes(one.column.name, _vehicles)) for one in BODY),
    *(
        Relation(
            one.column.name, "n_frames for each vehicle of slot",
            _sizes(one.column.name, lambda r: _vehicles(r) * r.t["n_frames"]),
        )
        for one in SERIES
    ),
    Relation("critical_bv", "one for each decision of the case", _sizes("critical_bv", lambda r: r.c["n_decisions"])),
    Relation(
        "action", "one for each decision of each vehicle of slot",
        _sizes("action", lambda r: _vehicles(r) * r.c["n_decisions"]),
    ),
    Relation(
        "decision_log_prob_nde", "one for each decision", _sizes("decision_log_prob_nde", lambda r: r.c["n_decisions"])
    ),
    Relation(
        "critical_bv", "-1, or an index into slot", lambda r: max(r.t["critical_bv"], default=-1) < _vehicles(r)
    ),
    Relation("target_lane", "a lane of the road, or -1", lambda r: max(r.t["target_lane"]) < r.odd.n_lanes),
    Relation(
        "x_m", "finite where the vehicle is present, NaN elsewhere",
        lambda r: np.array_equal(np.isfinite(r.t["x_m"]), r.t["present"]),
    ),
    Relation("present", "true of the AV in all frames", lambda r: all(r.t["present"][: r.t["n_frames"]])),
    Relation(
        "speed_mps", "at the end, of the AV, av_speed_mps of the case",
        lambda r: _close(r.t["speed_mps"][r.t["n_frames"] - 1], r.c["av_speed_mps"], 2e-3),
    ),
    Relation(
        "start", "the numbers of a start for each vehicle of slot",
        lambda r: "start" not in r.t or len(r.t["start"]) == _vehicles(r) * len(scripted.START_FIELDS),
    ),
    Relation(
        "rails", f"{POSE_NUMBERS} numbers for each vehicle of slot at each of some frames",
        lambda r: "rails" not in r.t or ((n := len(r.t["rails"])) > 0 and n % (POSE_NUMBERS * _vehicles(r)) == 0),
    ),
)  # fmt: skip
"""Of a case of a library."""


def _one_of(column: str, known: tuple[str | None, ...]) -> Relation:
    return Relation(column, f"one of: {', '.join(map(str, known))}", lambda r: r.c[column] in known)


ANALYSIS: tuple[Relation, ...] = (
    _one_of("group", ("majority", "minority")),
    _one_of("crash_type", get_args(CrashType)),
    _one_of("fault", tuple(FAULTS)),
    _one_of("conduct", tuple(CONDUCTS)),
    _one_of("avoidability", (*LABELS, None)),
    *(
        Relation(
            name, "as long as witness_x_m", _as_long_as(name, "witness_x_m")
        )
        for name in ("witness_y_m", "witness_speed_mps", "witness_heading_rad")
    ),
    Relation(
        "witness_lane", "as long as witness_acceleration_mps2",
        _as_long_as("witness_lane", "witness_acceleration_mps2"),
    ),
    *(
        Relation(
            name, "there where latest_any_s is, and only there",
            _there_with_latest(name),
        )
        for name in ("witness_x_m", "witness_lane")
    ),
)  # fmt: skip
"""Of a case in `cases.parquet`, and in `witnesses.parquet` (empty where its ways out were not searched)."""


def rows_of(library: CaseLibrary) -> Iterator[Row]:
    """Read all cases, in order."""
    for cases, tracks in library.shards():
        for c, t in zip(cases.to_pylist(), tracks.to_pylist(), strict=True):
            yield Row(c, t, library.odd)


def analysed_rows(analysis: Path, odd: Odd) -> Iterator[Row]:
    """Read all rows of an analysis."""
    ways = {one["case_id"]: one for one in pq.read_table(analysis / "witnesses.parquet").to_pylist()}
    nothing = dict.fromkeys(pq.read_schema(analysis / "witnesses.parquet").names)
    for case in pq.read_table(analysis / "cases.parquet").to_pylist():
        yield Row(case, ways.get(case["case_id"], nothing), odd)


def broken(row: Row, relations: tuple[Relation, ...] = RELATIONS) -> list[str]:
    """Name the relations that do not hold."""
    return [f'"{one.column}" must be {one.must}' for one in relations if not one.holds(row)]
