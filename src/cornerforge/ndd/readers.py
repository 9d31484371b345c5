"""Readers of trajectory files: each is recognised by its columns (`layouts`), and ends as `Decisions` at one a second.

Positions of tracks are smoothed (Savitzky-Golay, order 2; the window stands in the layout) before speeds are taken, as
the data's own speeds are noisy. A test split that a file marks itself is held out; else the end of the recording is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.errors import DataError
from cornerforge.ndd.decisions import (
    Decisions,
    decide_each_second,
    leader_by_lane,
    leader_by_name,
    smooth_tracks,
)
from cornerforge.ndd.layouts import DATA_FORMATS, LAYOUTS, Layout
from cornerforge.ndd.model import GAPS
from cornerforge.ndd.tables import BadRows, Table, file_sha256, read_header, read_table

__all__ = ["GAP_RANGE", "Reading", "read_decisions"]

GAP_RANGE = (1.0, 500.0)
"""Gaps outside this are measuring errors [m]."""
MEAN_LENGTH = 4.9
"""Length of a vehicle where the file has none [m]: NGSIM I-80."""

_SPEED_RANGE = (0.0, 70.0)
_BACKWARDS = 2.0
"""A vehicle seen to reverse faster than this [m/s] is a tracking error; up to it, noise of a standing one."""
_LENGTH_RANGE = (1.0, 40.0)
_POSITION_LIMIT = 1e7
_TIME_LIMIT = 1e10
_LANE_LIMIT = 999
_FREE = -2
"""Partner of a driver that is known to have no leader; -1 is "not known"."""


@dataclass(frozen=True)
class Reading:
    """What came out of one file.

    Attributes:
        path: The file.
        sha256: Of its bytes.
        layout: The layout it was recognised as.
        decisions: One a second.
        rows_read: All rows.
        bad: Rows left out, by reason.
    """

    path: Path
    sha256: str
    layout: Layout
    decisions: Decisions
    rows_read: int
    bad: BadRows

    @property
    def rows_used(self) -> int:
        """Rows that passed every check."""
        return self.rows_read - self.bad.total


def read_decisions(paths: Sequence[Path], data_format: str) -> list[Reading]:
    """Read trajectory files.

    Args:
        paths: The files, CSV or gzipped CSV.
        data_format: One of `DATA_FORMATS`.

    Raises:
        UnknownNameError: No such format.
        DataError: A file is missing, empty, cut off, or has other columns than the format.
    """
    check_in("trajectory format", data_format, DATA_FORMATS)
    return [_read(Path(path), data_format) for path in paths]


def _read(path: Path, data_format: str) -> Reading:
    header = read_header(path)
    layout = _recognise(path, header, data_format)
    numbers = {name: column for name, column in layout.numbers.items() if column[0] in header}
    texts = {name: column for name, column in layout.texts.items() if column in header}
    table = read_table(path, numbers, texts)
    _check_rows(table, layout)
    if table.line.size == 0:
        raise DataError(f"Trajectory file {path} holds no usable row; first fault: {_first_fault(table.bad)}.")
    decisions = _pairs(table, layout) if layout.kind == "pairs" else _tracks(table, layout)
    return Reading(path, file_sha256(path), layout, decisions, table.rows_read, table.bad)


def _recognise(path: Path, header: list[str], data_format: str) -> Layout:
    """The first layout of the format whose columns are all there."""
    known = [layout for layout in LAYOUTS if data_format in layout.formats]
    missing = {layout.name: [name for name in _required(layout) if name not in header] for layout in known}
    for layout in known:
        if not missing[layout.name]:
            return layout
    nearest = min(known, key=lambda layout: len(missing[layout.name]) / len(_required(layout)))
    raise DataError(
        f"Trajectory file {path} does not have the columns of format {data_format}: "
        f"missing {', '.join(missing[nearest.name])} ({nearest.name} needs {', '.join(_required(nearest))}); "
        f"found {', '.join(header[:20])}."
    )


def _required(layout: Layout) -> list[str]:
    numbers = [column for name, (column, _) in layout.numbers.items() if name not in layout.optional]
    return [*numbers, *(column for name, column in layout.texts.items() if name not in layout.optional)]


def _first_fault(bad: BadRows) -> str:
    reason, (count, line) = next(iter(bad.reasons.items()))
    return f"{reason} ({count} row(s), first at line {line})"


def _check_rows(table: Table, layout: Layout) -> None:
    """Take out and name the rows that cannot be used."""
    for name in list(table.texts):
        if name != "leader" or layout.kind == "pairs":  # a track without a leader names none
            table.drop(f"{layout.texts[name]} is empty", table.texts[name] < 0)
    for name in table.numbers:
        missing = ~np.isfinite(table.numbers[name])
        if name == "spacing":  # only a row with a leader has a spacing
            missing &= table.texts["leader"] >= 0
        table.drop(f"{layout.numbers[name][0]} is not a number", missing)
    _check_ranges(table, layout)
    _check_times(table, layout)


def _check_ranges(table: Table, layout: Layout) -> None:
    low_gap, high_gap = GAP_RANGE
    ranges = {
        "speed": (*_SPEED_RANGE, "m/s"),
        "lead_speed": (*_SPEED_RANGE, "m/s"),
        "length": (*_LENGTH_RANGE, "m"),
        "gap": (low_gap, high_gap, "m"),
        "spacing": (low_gap + MEAN_LENGTH, high_gap + MEAN_LENGTH, "m"),
        "position": (-_POSITION_LIMIT, _POSITION_LIMIT, "m"),
        "across": (-_POSITION_LIMIT, _POSITION_LIMIT, "m"),
        "time": (-_TIME_LIMIT, _TIME_LIMIT, "s"),
        "lane": (0.0, _LANE_LIMIT, ""),
    }
    for name, (low, high, unit) in ranges.items():
        if name in table.numbers:
            values = table.numbers[name]  # NaN passes: a spacing where there is no leader
            outside = (values < low) | (values > high)
            table.drop(f"{layout.numbers[name][0]} outside {low:g} to {high:g} {unit}".rstrip(), outside)


def _check_times(table: Table, layout: Layout) -> None:
    """Sort by vehicle and time; name times that do not increase (or, in unordered files, that come twice)."""
    driver = _driver(table)
    time = table.numbers["time"]
    order = np.argsort(driver, kind="stable") if layout.ordered else np.lexsort((time, driver))
    same = np.diff(driver[order]) == 0
    back = np.zeros(time.size, dtype=bool)
    back[order[1:]] = same & (np.diff(time[order]) <= 0.0)
    column = layout.numbers["time"][0]
    table.drop(f"{column} does not increase" if layout.ordered else f"{column} twice for one vehicle", back)
    table.take(np.lexsort((table.numbers["time"], _driver(table))))


def _driver(table: Table) -> NDArray[np.int64]:
    """A number for each vehicle of each recording (and leader, in pairs), shape (n,)."""
    codes = [table.texts[name] for name in ("recording", "vehicle") if name in table.texts]
    if "lead_speed" in table.numbers:
        codes.append(table.texts["leader"])
    number = np.zeros(table.line.size, dtype=np.int64)
    for column in codes:
        number = number * (int(column.max(initial=0)) + 1) + column
    return np.unique(number, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _ticks(table: Table, driver: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Time in steps, and the number of steps in a second.

    Raises:
        DataError: The file's time step does not divide a second.
    """
    time = table.numbers["time"]
    steps = np.diff(time)[np.diff(driver) == 0]
    step = float(np.median(steps)) if steps.size else 1.0
    per_second = max(round(1.0 / step), 1)
    if abs(per_second * step - 1.0) > 0.02:
        raise DataError(
            f"{table.name} has a row every {step:g} s; a whole number of rows a second is needed (such as every 0.1 s)."
        )
    return np.rint((time - time.min()) * per_second).astype(np.int64), per_second


def _held_out(table: Table, layout: Layout, driver: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Rows of the file's own test split, else of vehicles first seen late in the recording."""
    if "split" in table.texts:
        labels = [label.lower() != "train" for label in table.labels["split"]]
        return np.array([*labels, True])[table.texts["split"]]
    time = table.numbers["time"]
    first = np.full(int(driver.max()) + 1, np.inf)
    np.minimum.at(first, driver, time)
    border = time.min() + layout.held_out_from * (time.max() - time.min())
    return np.asarray(first[driver] > border)


def _pairs(table: Table, layout: Layout) -> Decisions:
    """Decisions from rows that hold the leader's speed and the gap."""
    driver = _driver(table)
    tick, per_second = _ticks(table, driver)
    speed = table.numbers["speed"]
    states = Decisions(
        speed=speed,
        gap=table.numbers["gap"],
        range_rate=table.numbers["lead_speed"] - speed,
        acceleration=np.zeros_like(speed),
        vehicle=driver,
        held_out=_held_out(table, layout, driver),
    )
    return decide_each_second(states, tick, np.zeros_like(driver), np.ones(speed.size, dtype=bool), per_second)


def _tracks(table: Table, layout: Layout) -> Decisions:
    """Decisions from tracks: smooth, find the leader, take the gap between bumpers."""
    along = _along_road(table, layout, _driver(table))
    jump = _jumps(table, along)
    table.drop(f"{layout.numbers['position'][0]} jumps (faster than {_SPEED_RANGE[1]:g} m/s)", jump)
    along, driver = along[~jump], _driver(table)
    tick, per_second = _ticks(table, driver)
    position, speed = smooth_tracks(driver, tick, along, 1.0 / per_second, layout.window)
    length = table.numbers.get("length", np.full(speed.size, MEAN_LENGTH))
    if layout.kind == "leaders":
        leader = leader_by_name(driver, tick, _leader_driver(table, driver))
        partner = np.where(leader >= 0, table.texts["leader"], -1)
    else:
        leader, partner = _leader_in_lane(table, driver, tick, along)
    between = length[leader] if layout.front else (length[leader] + length) / 2.0
    alone = partner == _FREE
    gap = np.where(alone, np.inf, position[leader] - position - between)
    range_rate = np.where(alone, 0.0, speed[leader] - speed)
    backwards = speed < -_BACKWARDS
    table.bad.add(f"vehicle reverses (faster than {_BACKWARDS:g} m/s)", table.line[backwards])
    wrong = ~backwards & (partner >= 0) & ((gap < GAP_RANGE[0]) | (gap > GAP_RANGE[1]))
    table.bad.add(f"gap to the leader outside {GAP_RANGE[0]:g} to {GAP_RANGE[1]:g} m", table.line[wrong])
    usable = (partner != -1) & ~wrong & ~backwards & np.isfinite(speed) & np.isfinite(range_rate)
    standing = np.maximum(speed, 0.0)  # noise lets a standing vehicle creep back
    states = Decisions(standing, gap, range_rate, np.zeros_like(speed), driver, _held_out(table, layout, driver))
    return decide_each_second(states, tick, partner, usable, per_second)


def _jumps(table: Table, along: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Rows that a vehicle cannot have reached from its row before, shape (n,): smoothing would hide them."""
    driver = _driver(table)
    jump = np.zeros(along.size, dtype=bool)
    same = np.diff(driver) == 0
    jump[1:] = same & (np.abs(np.diff(along)) > _SPEED_RANGE[1] * np.diff(table.numbers["time"]))
    return jump


def _along_road(table: Table, layout: Layout, driver: NDArray[np.int64]) -> NDArray[np.float64]:
    """Position in the direction of travel [m], shape (n,): the longer axis, turned round in lanes that run backward."""
    position = table.numbers["position"]
    if layout.corner:
        position = position + table.numbers["length"] / 2.0
    across = table.numbers.get("across", position)
    if np.ptp(across) > np.ptp(position):
        position = across
    if "lane" not in table.numbers:
        return position
    lane = np.unique(table.numbers["lane"], return_inverse=True)[1]
    moved = np.where(np.diff(driver) == 0, np.diff(position), 0.0)
    forward = np.bincount(lane[1:], weights=moved, minlength=int(lane.max()) + 1) >= 0.0
    return np.where(forward[lane], position, -position)


def _leader_driver(table: Table, driver: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of the driver that the row names as leader, shape (n,); -1 where none, or not in the file."""
    labels = table.labels["vehicle"]
    number = np.full(len(labels), -1, dtype=np.int64)
    number[table.texts["vehicle"]] = driver
    number_of = dict(zip(labels, number.tolist(), strict=True))
    named = np.array([number_of.get(label, -1) for label in table.labels["leader"]] + [-1], dtype=np.int64)
    return named[table.texts["leader"]]


def _leader_in_lane(
    table: Table, driver: NDArray[np.int64], tick: NDArray[np.int64], along: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row of the leader (-1: none), and what must stay for a second: leader and lane, `_FREE`, or -1 (not known)."""
    lane = np.rint(table.numbers["lane"]).astype(np.int64)
    recording = table.texts.get("recording", np.zeros_like(driver))
    leader = leader_by_lane(recording, lane, tick, along)
    end = np.full(int(recording.max()) + 1, -np.inf)
    np.maximum.at(end, recording, along)
    alone = (leader < 0) & (along + GAPS[-1] < end[recording])
    partner = np.where(leader >= 0, driver[leader] * (_LANE_LIMIT + 1) + lane, np.where(alone, _FREE, -1))
    return leader, np.where(lane > 0, partner, -1)  # lane 0 means "unknown" in these data
