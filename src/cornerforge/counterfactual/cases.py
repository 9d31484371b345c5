"""Ways out of many recorded crashes: the kernel that a pool of threads runs over ranges of cases."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.counterfactual.begin import manoeuvre_begin
from cornerforge.counterfactual.motion import continue_recording
from cornerforge.counterfactual.search import (
    COMBINED,
    KINDS,
    Manoeuvres,
    Plans,
    SearchScratch,
    allocate_plans,
    allocate_search,
    latest_ways_out,
    stopping_frames,
)
from cornerforge.counterfactual.witness import drive_way_out
from cornerforge.recordings import BODY_FIELDS, Recordings, Trajectories, unpack
from cornerforge.sim import allocate_recording

if TYPE_CHECKING:
    from numpy.typing import NDArray


__all__ = [
    "CaseScratch",
    "WaysOut",
    "allocate_case_scratch",
    "allocate_ways_out",
    "search_cases",
]


class WaysOut(NamedTuple):
    """The ways out found, one row a case.

    Attributes:
        begin: Frame at which the manoeuvre that led to the crash began (`begin.manoeuvre_begin`), int64 (C,).
        manoeuvre: Its place in `MANOEUVRES`, int64 (C,).
        moment: Frame of the latest way out of each kind, -1 for none, int64 (C, KINDS).
        touched: Frame at which a vehicle touches the AV when the way out is driven, -1 for none, int64 (C, KINDS).
        gave_up: 1 where a search gave up, int64 (C,).
        states: Number of states that the searches of a case saw, int64 (C,).
        steps: Number of decisions of the latest way out of any kind, int64 (C,).
        acceleration, lane: These decisions: acceleration held [m/s2] and target lane, (C, decisions).
        track: The AV's motion on it, from its moment on, [x m, y m, speed m/s, heading rad], (C, frames, 4).
    """

    begin: NDArray[np.int64]
    manoeuvre: NDArray[np.int64]
    moment: NDArray[np.int64]
    touched: NDArray[np.int64]
    gave_up: NDArray[np.int64]
    states: NDArray[np.int64]
    steps: NDArray[np.int64]
    acceleration: NDArray[np.float64]
    lane: NDArray[np.int64]
    track: NDArray[np.float64]


class CaseScratch(NamedTuple):
    """Memory for `search_cases`; one serves one thread. `tail`: frames in which the fastest vehicle comes to a stop."""

    frames: NDArray[np.void]
    bodies: NDArray[np.void]
    search: SearchScratch
    plans: Plans
    track: NDArray[np.float64]
    tail: int


def _decisions(m: Manoeuvres) -> int:
    return -(-(m.lookback + m.horizon) // m.every)


def allocate_case_scratch(m: Manoeuvres, frames: int, vehicles: int) -> CaseScratch:
    """Allocate memory for cases of at most so many frames and vehicles."""
    decisions = _decisions(m)
    tail = stopping_frames(m.road, m.stopping)
    longest = frames + m.horizon + m.every + tail
    return CaseScratch(
        allocate_recording(longest, vehicles),
        np.zeros(vehicles, dtype=BODY_FIELDS),
        allocate_search(decisions, longest, vehicles),
        allocate_plans(decisions),
        np.zeros((decisions * m.every + 1, 4)),
        tail,
    )


def allocate_ways_out(m: Manoeuvres, cases: int) -> WaysOut:
    """Allocate the results of so many cases."""
    decisions = _decisions(m)
    return WaysOut(
        begin=np.zeros(cases, dtype=np.int64),
        manoeuvre=np.zeros(cases, dtype=np.int64),
        moment=np.full((cases, KINDS), -1, dtype=np.int64),
        touched=np.full((cases, KINDS), -1, dtype=np.int64),
        gave_up=np.zeros(cases, dtype=np.int64),
        states=np.zeros(cases, dtype=np.int64),
        steps=np.zeros(cases, dtype=np.int64),
        acceleration=np.zeros((cases, decisions)),
        lane=np.zeros((cases, decisions), dtype=np.int64),
        track=np.zeros((cases, decisions * m.every + 1, 4)),
    )


@kernel
def search_cases(r: Recordings, first: int, stop: int, m: Manoeuvres, s: CaseScratch, out: WaysOut) -> None:
    """Search cases first .. stop - 1, and drive each way out that is found (`witness.drive_way_out`).

    Args:
        r: The recordings; a case with partner 0 is left out.
        first, stop: Range of cases.
        m: What the AV may do.
        s: Scratch.
        out: Holds stop - first rows, for the cases in order.
    """
    road = m.road
    for c in range(first, stop):
        row = c - first
        if r.partner[c] == 0:
            continue
        n = r.vehicles[c]
        last = r.last[c]
        unpack(r, c, s.frames, s.bodies)
        test = Trajectories(s.frames, s.bodies, n)
        out.begin[row], out.manoeuvre[row] = manoeuvre_begin(s.frames, r.partner[c], last, road)
        until = last + m.horizon + m.every + s.tail
        continue_recording(test, last, until, r.partner[c], m.only_partner, road, s.search.rows)
        earliest = max(0, last - m.lookback)
        s.search.counts[2] = 0
        since = max(earliest, out.begin[row])
        out.gave_up[row] = latest_ways_out(test, last, since, earliest, m, s.search, s.plans)
        out.states[row] = s.search.counts[2]
        for kind in range(KINDS):
            moment = s.plans.moment[kind]
            steps = s.plans.steps[kind]
            out.moment[row, kind] = moment
            if moment < 0:
                continue
            out.touched[row, kind] = drive_way_out(
                test, moment, s.plans.acceleration[kind, :steps], s.plans.lane[kind, :steps], m, s.search.rows, s.track,
            )  # fmt: skip
            if kind == COMBINED:
                out.steps[row] = steps
                for k in range(steps):
                    out.acceleration[row, k] = s.plans.acceleration[kind, k]
                    out.lane[row, k] = s.plans.lane[kind, k]
                for f in range(steps * m.every + 1):
                    for q in range(4):
                        out.track[row, f, q] = s.track[f, q]
