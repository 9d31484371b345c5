"""Could the AV have avoided its crash, how, and until when? For one recording, and for the tables of a whole library.

Definitions and what they cost: docs/adr/0014-avoidability.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge._arrow import arrow_fields
from cornerforge._checks import check_in, check_integer, check_number
from cornerforge._schema import check_fields, meant
from cornerforge.analysis.site_avoid import others_at_site, poses_on_route, touches_at, ways_out_at_site
from cornerforge.analysis.site_case import SiteCase, case_of, site_case
from cornerforge.counterfactual import (
    BRAKING,
    COMBINED,
    MANOEUVRES,
    OWN_MANOEUVRES,
    STEERING,
    CaseScratch,
    Manoeuvres,
    SpeedSearch,
    WaysOut,
    allocate_case_scratch,
    allocate_speed_search,
    allocate_ways_out,
    search_cases,
)
from cornerforge.errors import InputError
from cornerforge.fields import BEFORE_CONTACT, REALS, Field
from cornerforge.recordings import Recordings, recordings_of, recordings_of_tracks
from cornerforge.road.straight import road_numbers
from cornerforge.types import FRAME_S, Odd, Scenario
from cornerforge.work import Rooms, in_order

__all__ = [
    "AVOIDABILITY_COLUMNS",
    "AVOIDABILITY_SCHEMA",
    "LABELS",
    "OTHERS",
    "AvoidParams",
    "Avoidability",
    "WayOut",
    "Witness",
    "avoidability",
    "avoidability_of_library",
    "avoidability_table",
    "manoeuvres_of",
    "problem_of",
    "problems_of",
]

LABELS: dict[str, str] = {
    "unavoidable": "nothing that the AV may do helps once the manoeuvre that led to the crash has begun",
    "by braking": "accelerations on the path that it is on help, lane changes at constant speed do not",
    "by steering": "lane changes at constant speed help, accelerations on the path that it is on do not",
    "by both": "each of the two alone helps",
    "by combination": "only both together help",
    "undecided": "no way out was found, and not all could be tried",
}
"""Label and meaning."""

OTHERS = ("all", "partner")
"""Vehicles to avoid after the contact: all, or the partner alone as for the reward `avoidable` (ADR 11)."""

_CHUNK = 32
_PARTS = 3
"""Places in a lane at which an AV that steers may drive: its centre, and a third of its width on both sides."""
_DEFAULT_ACCELERATIONS = (-8.0, -4.0, 0.0, 2.0)


@dataclass(frozen=True)
class AvoidParams:
    """Manoeuvres that the AV may try, and the condition of an avoided crash.

    Raises:
        InputError: A field is out of range, or they do not fit together.
    """

    decision_s: Annotated[float, meant("Between two decisions of the AV, a multiple of 0.1 s.", "s", 0.1, 0.5)] = 0.5
    delay_s: Annotated[
        float,
        meant("From the begin of a manoeuvre of another until a way out may begin.", "s", 0, 5),
    ] = 0.0
    accelerations_mps2: Annotated[
        tuple[float, ...], meant("Held between decisions: 0, at least one below 0, all in [-20, 10].", "m/s2")
    ] = _DEFAULT_ACCELERATIONS
    max_lateral_acceleration_mps2: Annotated[
        float, meant("Of its lane changes, whose length follows from it.", "m/s2", 1, 20)
    ] = 4.0
    lane_changes: Annotated[int, meant("Most decisions on another lane; an abort is one.", "", 0, 4)] = 2
    horizon_s: Annotated[float, meant("Time after the contact in which no vehicle may touch it.", "s", 0, 10)] = 3.0
    lookback_s: Annotated[float, meant("Longest time from a way out's begin to the contact.", "s", FRAME_S, 60)] = 5.0
    others: Annotated[str, meant("Which vehicles count after the contact, one of `OTHERS`.")] = "all"
    steers: Annotated[
        bool, meant("It may also drive a third of a lane beside a lane's centre, past an obstacle within its lane.")
    ] = False

    def __post_init__(self) -> None:
        check_fields(self, "")
        if abs(self.decision_s / FRAME_S - round(self.decision_s / FRAME_S)) > 1e-6:
            raise InputError(f"decision_s = {self.decision_s} s is not a multiple of {FRAME_S} s; round it to one.")
        check_in("choice of others", self.others, OTHERS)
        for value in self.accelerations_mps2:
            check_number("accelerations_mps2", value, low=-20.0, high=10.0, unit="m/s2")
        distinct = len(set(self.accelerations_mps2)) == len(self.accelerations_mps2)
        if not distinct or 0.0 not in self.accelerations_mps2 or min(self.accelerations_mps2, default=0.0) >= 0.0:
            raise InputError(
                f"accelerations_mps2 = {self.accelerations_mps2} must hold 0, one below 0, and none of them twice."
            )


@dataclass(frozen=True)
class WayOut:
    """The AV on another way than the recorded one.

    Attributes:
        begin_s: Its begin, before the contact [s].
        x, y, speed, heading: The AV every 0.1 s from then on, as in `Scenario`, shape (W,).
    """

    begin_s: float = field(metadata={"unit": "s"})
    x: NDArray[np.float64] = field(metadata={"unit": "m"})
    y: NDArray[np.float64] = field(metadata={"unit": "m"})
    speed: NDArray[np.float64] = field(metadata={"unit": "m/s"})
    heading: NDArray[np.float64] = field(metadata={"unit": "rad"})


@dataclass(frozen=True)
class Witness(WayOut):
    """A way out (glossary) that was driven and touches no vehicle, from its first decision to the end of the horizon.

    Attributes:
        acceleration: Held from each decision on [m/s2], shape (D,).
        lane: Target lane from each decision on, int64, shape (D,); of an AV that steers the lane of the place to which
            it moves.
    """

    acceleration: NDArray[np.float64] = field(metadata={"unit": "m/s2"})
    lane: NDArray[np.int64]


@dataclass(frozen=True)
class Avoidability:
    """Answer for one crash. Times are seconds before the contact, None where no moment of this kind exists.

    Attributes:
        label: A key of `LABELS`.
        manoeuvre_s: Begin of the manoeuvre that led to the crash (`counterfactual.begin.manoeuvre_begin`).
        braking_s: Latest moment from which accelerations alone help, not before the manoeuvre's begin.
        steering_s: The same for lane changes alone.
        latest_s: The last way out: latest moment from which anything helps; it may lie before the manoeuvre's begin.
        time_to_react_s: From the manoeuvre's begin to `latest_s`; negative when the AV would have had to foresee it.
        exhaustive: False if some search ran out of memory, so that a later moment, or another kind, may exist.
        witness: A way out from `latest_s` on, None if there is none.
    """

    label: str
    manoeuvre_s: float = field(metadata={"unit": "s"})
    braking_s: float | None = field(metadata={"unit": "s"})
    steering_s: float | None = field(metadata={"unit": "s"})
    latest_s: float | None = field(metadata={"unit": "s"})
    time_to_react_s: float | None = field(metadata={"unit": "s"})
    exhaustive: bool
    witness: Witness | None


AVOIDABILITY_COLUMNS: tuple[Field, ...] = (
    Field("case_id", "string", "", "Name of the case, seed:test."),
    Field("avoidability", "string", "", f"{', '.join(LABELS)}; null: see avoidability_problem.", nullable=True),
    Field("avoidability_problem", "string", "", "Why the case cannot be judged; null: it was.", nullable=True),
    Field("manoeuvre_begin_s", "float64", "s", "Begin of the manoeuvre that led to it, before the contact; null: not "
          "judged.", BEFORE_CONTACT, nullable=True),
    Field("latest_braking_s", "float64", "s", "Latest moment, before the contact, from which accelerations "
          "alone help, at a site braking until it stands; null: none since the manoeuvre began.",
          BEFORE_CONTACT, nullable=True),
    Field("latest_steering_s", "float64", "s", "The same of lane changes at constant speed alone; null: none.",
          BEFORE_CONTACT, nullable=True),
    Field("latest_any_s", "float64", "s", "The last way out: the same of anything, before "
          "the manoeuvre began too; null: none.", BEFORE_CONTACT, nullable=True),
    Field("time_to_react_s", "float64", "s", "From the manoeuvre's begin to latest_any_s; negative: the AV "
          "would have had to foresee it; null: no way out.", (-1e5, 1e5), nullable=True),
    Field("avoidability_exhaustive", "bool", "", "False: a search ran out of room, more ways may exist; null: not "
          "looked at.", nullable=True),
    Field("witness_x_m", "list of float32", "m", "AV on the way out from latest_any_s on, every 0.1 s; null: no way "
          "out.", (-1e5, 1e5), nullable=True),
    Field("witness_y_m", "list of float32", "m", "Likewise, to the left of the right road edge; null likewise.",
          (-1e5, 1e5), nullable=True),
    Field("witness_speed_mps", "list of float32", "m/s", "Likewise, along the road; null likewise.", (-100.0, 200.0),
          nullable=True),
    Field("witness_heading_rad", "list of float32", "rad", "Likewise, counter-clockwise from the road's direction; "
          "null likewise.", (-13.0, 13.0), nullable=True),
    Field("witness_acceleration_mps2", "list of float32", "m/s2", "Commanded from each of its decisions on; null "
          "likewise.", (-100.0, 100.0), nullable=True),
    Field("witness_lane", "list of int8", "", "Target lane from each of its decisions on, at a site the route; "
          "null likewise.", (0, 63),
          nullable=True),
)  # fmt: skip
"""Columns of `avoidability_table`."""

AVOIDABILITY_SCHEMA: pa.Schema = pa.schema(arrow_fields(AVOIDABILITY_COLUMNS))
"""Their Arrow schema, with unit and meaning as field metadata."""


def avoidability(scenario: Scenario, params: AvoidParams | None = None) -> Avoidability:
    """Look for the latest way out of one recorded crash.

    Args:
        scenario: Recording of a test that ended in a crash of the AV; vehicles that never came near may be missing.
        params: What the AV may do and what counts; None: the defaults.

    Raises:
        InputError: There is no crash of the AV, the recording does not hold its contact, the AV is absent before it,
            or a value of a present vehicle is not finite.
    """
    params = params or AvoidParams()
    recordings = recordings_of(scenario)
    (name,) = recordings.case_ids
    problem = problem_of(recordings, -1, scenario.odd)
    if problem is not None:
        raise InputError(f"Test {name}: {problem}.")
    if scenario.odd.site is not None:
        return _answer_at_site(case_of(scenario), params)
    out = _search(recordings, scenario.odd, params, threads=1)
    _check_witnesses([name], out)
    return _answer(recordings, out, params)


def avoidability_table(
    cases: pa.Table, tracks: pa.Table, odd: Odd, params: AvoidParams | None = None, *, threads: int = 1
) -> pa.Table:
    """Look for the latest ways out of many recorded crashes.

    Args:
        cases: One row a case: `case_id`, `crash_time_s` and `bv_slot` of the case library; other columns are ignored.
        tracks: The trajectories of the same cases in the same order, as the case library stores them.
        odd: Road and rules of all of them.
        params: What the AV may do and what counts; None: the defaults.
        threads: Size of the pool; does not change the result.

    Returns:
        `AVOIDABILITY_SCHEMA`, one row a case in the order of `cases`. A case that cannot be judged says why.

    Raises:
        InputError: The tables are not of the same cases, or `threads` is out of range.
    """
    check_integer("threads", threads, low=1, high=1024)
    params = params or AvoidParams()
    recordings = recordings_of_tracks(cases, tracks)
    if not recordings.n_cases:
        return AVOIDABILITY_SCHEMA.empty_table()
    problems = problems_of(recordings, cases.column("bv_slot").to_pylist(), odd)
    judged = np.array([problem is None for problem in problems])
    recordings = recordings._replace(partner=np.where(judged, recordings.partner, 0))
    if odd.site is not None:
        return _table_at_site(problems, recordings, odd, params)
    out = _search(recordings, odd, params, threads)
    _check_witnesses(recordings.case_ids, out)
    return _table(problems, recordings, out, params)


def avoidability_of_library(
    shards: Iterable[tuple[pa.Table, pa.Table]], odd: Odd, params: AvoidParams | None = None, *, threads: int = 1
) -> pa.Table:
    """Do the same for all shards of a library, one after the other; only one shard's trajectories are in memory.

    Args:
        shards: Cases and tracks of each (`CaseLibrary.shards`).
        odd, params, threads: As for `avoidability_table`.
    """
    tables = [avoidability_table(cases, tracks, odd, params, threads=threads) for cases, tracks in shards]
    return pa.concat_tables([AVOIDABILITY_SCHEMA.empty_table(), *tables])


_SPEED_TOLERANCE = 1e-3


def problem_of(case: Recordings, bv_slot: int, odd: Odd) -> str | None:
    """Say why one case with crash partner `bv_slot` cannot be judged; None: it can."""
    frames, last, partner = int(case.frames[0]), int(case.last[0]), int(case.partner[0])
    there = case.present.reshape(-1, frames)
    speed = case.speed[case.present]
    if partner == 0:
        return f"slot {bv_slot}, which the AV touched, is not in the recording"
    if not 0 <= last < frames or not there[[0, partner], last].all():
        return f"its contact at {FRAME_S * last:.1f} s is not in the recording of {frames} frames"
    if not there[0, : last + 1].all():
        return f"the AV is absent at {FRAME_S * int(np.argmin(there[0])):.1f} s, before the contact"
    if not all(np.isfinite(getattr(case, name)[case.present]).all() for name in REALS):
        return "a value of a vehicle that is present is not finite"
    if speed.min() < -_SPEED_TOLERANCE or speed.max() > odd.max_speed + _SPEED_TOLERANCE:
        return f"a speed is outside [0, {odd.max_speed}] m/s"
    return None


def problems_of(recordings: Recordings, bv_slots: Sequence[int], odd: Odd) -> list[str | None]:
    """Say of each case why it cannot be judged, given the slot that its AV touched; None: it can."""
    return [problem_of(block, bv_slots[c], odd) for c, block in enumerate(recordings.blocks(1))]


def manoeuvres_of(odd: Odd, params: AvoidParams) -> Manoeuvres:
    """Turn the parameters into what the kernel takes.

    A lane change from rest to rest over a way w within T has the peak acceleration 10 / sqrt(3) w / T^2.
    """
    road = road_numbers(odd)
    bound = float(params.max_lateral_acceleration_mps2)
    parts = _PARTS if params.steers else 1
    shortest = float(np.sqrt(10.0 / np.sqrt(3.0) * odd.lane_width / bound))
    return Manoeuvres(
        np.array(params.accelerations_mps2, dtype=np.float64),
        every=round(params.decision_s / FRAME_S),
        horizon=round(params.horizon_s / FRAME_S),
        lane_changes=int(params.lane_changes),
        stopping=-min(params.accelerations_mps2),
        lookback=round(params.lookback_s / FRAME_S),
        only_partner=int(params.others == "partner"),
        road=road,
        evasive=road._replace(
            lane_change_duration=shortest,
            max_lateral_acceleration=bound,
            n_lanes=parts * road.n_lanes,
            lane_width=road.lane_width / parts,
            lanes=road.lanes._replace(stretches=np.repeat(road.lanes.stretches, parts, axis=0)),
        ),
        parts=parts,
    )


def _search(recordings: Recordings, odd: Odd, params: AvoidParams, threads: int) -> WaysOut:
    """Search all cases in a pool of threads, each of which takes a few cases at a time."""
    manoeuvres = manoeuvres_of(odd, params)
    n = recordings.n_cases
    frames, vehicles = int(recordings.frames.max()), int(recordings.vehicles.max())
    rooms = Rooms(partial(allocate_case_scratch, manoeuvres, frames, vehicles))
    search = partial(_search_range, recordings, manoeuvres, rooms)
    parts = list(in_order(search, 0, n, chunk=_CHUNK, threads=threads))
    return WaysOut(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _search_range(
    recordings: Recordings, manoeuvres: Manoeuvres, rooms: Rooms[CaseScratch], first: int, count: int
) -> WaysOut:
    out = allocate_ways_out(manoeuvres, count)
    with rooms.lend() as scratch:
        search_cases(recordings, first, first + count, manoeuvres, scratch, out)
    return out


def _check_witnesses(ids: Sequence[str], out: WaysOut) -> None:
    """Drive each way out and raise an error if a vehicle touches the AV on it: that is a mistake of the search."""
    wrong = np.argwhere(out.touched >= 0)
    if wrong.size:
        c, kind = wrong[0].tolist()
        raise RuntimeError(
            f"Case {ids[c]}: on its way out of kind {kind} the AV is touched at frame {int(out.touched[c, kind])}. "
            "This is a mistake in cornerforge; please report it with the case."
        )


def _labels(out: WaysOut, params: AvoidParams) -> list[str]:
    reacts = ~np.isin(np.array(list(MANOEUVRES))[out.manoeuvre], OWN_MANOEUVRES)
    in_time = (out.moment >= 0) & (out.moment >= (out.begin + reacts * round(params.delay_s / FRAME_S))[:, None])
    names = np.full(len(in_time), "unavoidable", dtype=object)
    names[out.gave_up != 0] = "undecided"
    names[in_time[:, COMBINED]] = "by combination"
    names[in_time[:, BRAKING]] = "by braking"
    names[in_time[:, STEERING]] = "by steering"
    names[in_time[:, BRAKING] & in_time[:, STEERING]] = "by both"
    return [str(name) for name in names]


def _seconds(frames: NDArray[np.int64], known: NDArray[np.bool_]) -> list[float | None]:
    return [round(n * FRAME_S, 1) if there else None for n, there in zip(frames.tolist(), known.tolist(), strict=True)]


def _answer(recordings: Recordings, out: WaysOut, params: AvoidParams) -> Avoidability:
    last, moment = int(recordings.last[0]), out.moment[0]
    braking, steering, latest = _seconds(last - moment, moment >= 0)
    begin = round((last - int(out.begin[0])) * FRAME_S, 1)
    witness = None
    if latest is not None:
        steps, every = int(out.steps[0]), round(params.decision_s / FRAME_S)
        x, y, speed, heading = out.track[0, : steps * every + 1].T.copy()
        held, lane = out.acceleration[0, :steps].copy(), out.lane[0, :steps] // (_PARTS if params.steers else 1)
        witness = Witness(latest, x, y, speed, heading, held, lane)
    return Avoidability(
        label=_labels(out, params)[0],
        manoeuvre_s=begin,
        braking_s=braking,
        steering_s=steering,
        latest_s=latest,
        time_to_react_s=None if latest is None else round(begin - latest, 1),
        exhaustive=not out.gave_up[0],
        witness=witness,
    )


def _answer_at_site(case: SiteCase, params: AvoidParams, scratch: SpeedSearch | None = None) -> Avoidability:
    """Look for the latest way out of a crash at a site, where the AV can choose its speed and nothing else."""
    out = ways_out_at_site(case, params, scratch or allocate_speed_search())
    if out.latest >= 0 and touches_at(case, others_at_site(case, params), out.latest, out.track) >= 0:
        raise RuntimeError("The AV is touched on its way out. This is a mistake in cornerforge; please report it.")
    before = [None if frame < 0 else round((case.last - frame) * FRAME_S, 1) for frame in (out.braking, out.latest)]
    begin = round((case.last - out.begin) * FRAME_S, 1)
    braking, latest = before
    witness = None
    if latest is not None:
        x, y, speed, heading = poses_on_route(case, out.track).T.copy()
        held = out.commands[:: round(params.decision_s / FRAME_S)].copy()
        witness = Witness(latest, x, y, speed, heading, held, np.full(held.size, case.route[0]))
    return Avoidability(
        label="by braking" if out.in_time else "unavoidable" if out.proven else "undecided",
        manoeuvre_s=begin,
        braking_s=None if braking is None or braking > begin else braking,
        steering_s=None,
        latest_s=latest,
        time_to_react_s=None if latest is None else round(begin - latest, 1),
        exhaustive=out.proven,
        witness=witness,
    )


def _table_at_site(
    problems: list[str | None], recordings: Recordings, odd: Odd, params: AvoidParams
) -> pa.Table:  # fmt: skip
    """Make the rows of cases at a site, as `_table` does those of roads."""
    scratch = allocate_speed_search()
    rows = []
    for problem, block in zip(problems, recordings.blocks(1), strict=True):
        row: dict[str, Any] = dict.fromkeys(AVOIDABILITY_SCHEMA.names)
        row |= {"case_id": block.case_ids[0], "avoidability_problem": problem}
        if problem is None:
            found = _answer_at_site(site_case(block, odd), params, scratch)
            row |= {
                "avoidability": found.label, "manoeuvre_begin_s": found.manoeuvre_s,
                "latest_braking_s": found.braking_s, "latest_any_s": found.latest_s,
                "time_to_react_s": found.time_to_react_s, "avoidability_exhaustive": found.exhaustive,
            }  # fmt: skip
            if found.witness is not None:
                of = found.witness
                row |= {
                    "witness_x_m": of.x, "witness_y_m": of.y, "witness_speed_mps": of.speed,
                    "witness_heading_rad": of.heading, "witness_acceleration_mps2": of.acceleration,
                    "witness_lane": of.lane,
                }  # fmt: skip
        rows.append(row)
    columns = {name: [row[name] for row in rows] for name in AVOIDABILITY_SCHEMA.names}
    return pa.table(columns, schema=AVOIDABILITY_SCHEMA)


def _lists(values: NDArray[Any], lengths: NDArray[np.int64], kind: pa.DataType) -> pa.Array:
    """Rows of an array (S, room) cut to their lengths, null where that is 0."""
    kept = np.arange(values.shape[1]) < lengths[:, None]
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    flat = pa.array(values[kept], type=kind)
    return pa.ListArray.from_arrays(pa.array(offsets), flat, mask=pa.array(lengths == 0))


def _table(problems: list[str | None], recordings: Recordings, out: WaysOut, params: AvoidParams) -> pa.Table:
    judged = np.array([problem is None for problem in problems])
    known = out.moment >= 0
    before = recordings.last[:, None] - out.moment
    frames = np.where(out.steps > 0, out.steps * round(params.decision_s / FRAME_S) + 1, 0)
    columns = [
        pa.array(recordings.case_ids),
        pa.array([label if ok else None for label, ok in zip(_labels(out, params), judged, strict=True)]),
        pa.array(problems, type=pa.string()),
        pa.array(_seconds(recordings.last - out.begin, judged), type=pa.float64()),
        *(pa.array(_seconds(before[:, k], known[:, k]), type=pa.float64()) for k in (BRAKING, STEERING, COMBINED)),
        pa.array(_seconds(out.moment[:, COMBINED] - out.begin, known[:, COMBINED]), type=pa.float64()),
        pa.array((out.gave_up == 0).tolist(), mask=~judged),
        *(_lists(out.track[:, :, q].astype(np.float32), frames, pa.float32()) for q in range(4)),
        _lists(out.acceleration.astype(np.float32), out.steps, pa.float32()),
        _lists((out.lane // (_PARTS if params.steers else 1)).astype(np.int8), out.steps, pa.int8()),
    ]
    return pa.Table.from_arrays(columns, schema=AVOIDABILITY_SCHEMA)
