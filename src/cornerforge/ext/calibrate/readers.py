"""Readers of trajectory files: each is recognised by its columns (`layouts`), and ends as `Decisions` at one a second.

Positions of tracks are smoothed (Savitzky-Golay, order 2; the window stands in the layout) before speeds are taken, as
the data's own speeds are noisy. A test split that a file marks itself is held out; else the end of the recording is.
Rows that cannot be used are left out, counted and named (`row_checks`); oddities of a whole file are warnings, and
stand in `Reading.notes`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.errors import DataError, InputError
from cornerforge.ext.calibrate.decisions import (
    Decisions,
    decide_each_second,
    leader_by_lane,
    leader_by_name,
    smooth_tracks,
)
from cornerforge.ext.calibrate.highd import RecordingMeta, is_companion, read_recording_meta
from cornerforge.ext.calibrate.layouts import (
    DATA_FORMATS,
    FOREIGN,
    LAYOUTS,
    Layout,
    Scene,
    matching_layouts,
    required_columns,
)
from cornerforge.ext.calibrate.row_checks import GAP_RANGE, LANE_LIMIT, MEAN_LENGTH, check_rows, drivers, time_step
from cornerforge.ext.calibrate.tables import BadRows, Table, file_sha256, read_header, read_table
from cornerforge.ext.calibrate.whole_tracks import cut_tracks, direction_of_travel, position_along
from cornerforge.ndd.model import GAPS

__all__ = [
    "GAP_RANGE",
    "Reading",
    "Rows",
    "guess_format",
    "read_decisions",
    "read_rows",
    "reading_names",
    "ticks",
    "with_tracks",
]

_BACKWARDS = 2.0
"""Faster reversing than this [m/s] is a tracking error; slower reversing is noise of a standing vehicle."""
_FREE = -2
"""Partner of a driver that is known to have no leader; -1 means that the leader is not known."""


@dataclass(frozen=True)
class Reading:
    """The decisions of one file, and notes on its rows.

    Attributes:
        path: The file.
        sha256: SHA-256 of its bytes.
        layout: The layout it was recognised as, with the file's own frame rate.
        decisions: One a second.
        table: Its usable rows, sorted by vehicle and time, and those left out; jumps, of which no decision is made, are
            in both.
        vehicles: Vehicles of the other rows; of pairs, pairs.
        notes: Oddities of the file as a whole, one or two plain sentences each; also given as warnings.
    """

    path: Path
    sha256: str
    layout: Layout
    decisions: Decisions
    table: Table
    vehicles: int
    notes: tuple[str, ...] = ()

    @property
    def rows_used(self) -> int:
        """Rows that passed every check."""
        return self.table.rows_read - self.table.bad.total


def read_decisions(
    paths: Sequence[Path], data_format: str | None = None, *, window_factor: float = 1.0
) -> list[Reading]:
    """Read trajectory files; warn of oddities of a file as a whole, such as units that look like feet.

    Args:
        paths: The files, CSV or gzipped CSV. highD's meta files among them are read with their tracks.
        data_format: One of `DATA_FORMATS`; None to tell it from the columns (`guess_format`).
        window_factor: Factor of the layouts' smoothing windows, to see how far these matter.

    Raises:
        UnknownNameError: The format is unknown.
        InputError: The format is not given, and the columns leave it open.
        DataError: A file is missing, empty, cut off, or has other columns than the format.
    """
    data_format = (
        guess_format(paths) if data_format is None else check_in("trajectory format", data_format, DATA_FORMATS)
    )
    readings = [_read(path, data_format, window_factor) for path in with_tracks(paths)]
    for reading in readings:
        for note in reading.notes:
            warnings.warn(note, stacklevel=2)
    return readings


def reading_names(readings: Sequence[Reading]) -> list[str]:
    """Return file names, as full paths where two files have the same name.

    Raises:
        InputError: A file is given twice.
    """
    digests = [reading.sha256 for reading in readings]
    for i, digest in enumerate(digests):
        if digest in digests[:i]:
            twin = readings[digests.index(digest)].path
            raise InputError(f"{readings[i].path} and {twin} are the same file; name it once.")
    short = [reading.path.name for reading in readings]
    return [name if short.count(name) == 1 else str(r.path) for name, r in zip(short, readings, strict=True)]


def guess_format(paths: Sequence[Path]) -> str:
    """Find the one format with columns that all these files have.

    A format named after its publisher (`ngsim`) is the answer only for columns that no other format has: for plain
    pairs and tracks the answer is `pairs` or `tracks`.

    Raises:
        InputError: No file, or more than one format fits, or the files differ; the message says which fit.
        DataError: A file is missing or empty, or its columns fit no format.
    """
    if not paths:
        raise InputError("No trajectory file; name at least one.")
    found: dict[str, Path] = {}
    for path in with_tracks(paths):
        header = read_header(path)
        fits = matching_layouts(header)
        if not fits:
            raise _no_fit(path, header, LAYOUTS, "any known format")
        names = list(dict.fromkeys(layout.formats[0] for layout in fits))
        if len(names) > 1:
            raise InputError(
                f"The columns of {path} fit more than one format: {', '.join(names)}; say which with --format."
            )
        found.setdefault(names[0], path)
    if len(found) > 1:
        each = ", ".join(f"{path.name} looks like {name}" for name, path in found.items())
        shared = [name for name in DATA_FORMATS if all(name in _formats_of(path) for path in found.values())]
        hint = f"use --format {shared[0]} if that is where all come from" if shared else "name files of one format only"
        raise InputError(f"The files are of different formats: {each}; {hint}.")
    return next(iter(found))


def _formats_of(path: Path) -> set[str]:
    return {name for layout in matching_layouts(read_header(path)) for name in layout.formats}


def with_tracks(paths: Sequence[Path]) -> list[Path]:
    """Leave out the files that only accompany highD's tracks.

    Raises:
        DataError: No other file is left.
    """
    tracks = [Path(path) for path in paths if not is_companion(Path(path))]
    if paths and not tracks:
        raise DataError(f"{paths[0]} holds no trajectories; name the XX_tracks.csv beside it.")
    return tracks


@dataclass(frozen=True)
class Rows:
    """The usable rows of one file, sorted by vehicle and time.

    Attributes:
        layout: The layout it was recognised as, with the file's own frame rate.
        table: The rows; those left out are named in it. More may be dropped from it.
        notes: Oddities of the file as a whole.
        meta: highD's meta file, if there is one.
    """

    layout: Layout
    table: Table
    notes: list[str]
    meta: RecordingMeta | None


def read_rows(path: Path, data_format: str, *, scene: bool = False) -> Rows:
    """Read and check the rows of a trajectory file.

    Args:
        path: The file.
        data_format: One of `DATA_FORMATS`.
        scene: Read what `Layout.scene` names, too: `lateral`, `width` (numbers), `kind` (a text).

    Raises:
        DataError: The file is missing, empty, cut off, has other columns than the format, or no usable row.
    """
    header = read_header(path)
    layout = _recognise(path, header, data_format)
    notes: list[str] = []
    meta = read_recording_meta(path) if data_format == "highd" else None
    if meta is not None:
        frames = (layout.numbers["time"][0], 1.0 / meta.frames_per_second)
        layout = replace(layout, numbers={**layout.numbers, "time": frames})
        notes += meta.notes(path.name)
    if scene and layout.scene is not None:
        layout = _with_scene(layout, layout.scene)
    numbers = {name: column for name, column in layout.numbers.items() if column[0] in header}
    texts = {name: column for name, column in layout.texts.items() if column in header}
    table = read_table(path, numbers, texts)
    for name in (*layout.optional, "width"):  # an empty column is none
        if np.isnan(table.numbers.get(name, np.nan)).all() and np.max(table.texts.get(name, -1)) < 0:
            table.numbers.pop(name, None)
            table.texts.pop(name, None)
    notes += [*table.notes, *check_rows(table, layout)]
    if table.line.size == 0:
        hint = f" {notes[0]}" if notes else ""
        raise DataError(f"Trajectory file {path} holds no usable row; first fault: {_first_fault(table.bad)}.{hint}")
    notes += [*_lane_note(table), *cut_tracks(table, layout)]
    return Rows(layout, table, notes, meta)


def _lane_note(table: Table) -> list[str]:
    """Note that vehicles, more than 5 %, are in lane 0 throughout, which stands for an unknown lane."""
    known = np.bincount(drivers(table), weights=table.numbers.get("lane", np.ones(table.line.size)) > 0.0)
    said = f"{table.name}: vehicles are in lane 0 throughout, which means that it is not known; number lanes from 1."
    return [said] if np.mean(known == 0.0) > 0.05 else []


def _with_scene(layout: Layout, scene: Scene) -> Layout:
    """Let the columns of a scene be read like the others."""
    more = {name: column for name, column in (("lateral", scene.across), ("width", scene.width)) if column is not None}
    texts = layout.texts if scene.kind is None else {**layout.texts, "kind": scene.kind}
    return replace(layout, numbers={**layout.numbers, **more}, texts=texts)


def _read(path: Path, data_format: str, window_factor: float) -> Reading:
    rows = read_rows(path, data_format)
    layout = replace(rows.layout, window=rows.layout.window * window_factor)
    table, notes = replace(rows.table), rows.notes
    vehicles = int(drivers(table).max()) + 1
    decisions = _pairs(table, layout) if layout.kind == "pairs" else _tracks(table, layout)
    return Reading(path, file_sha256(path), layout, decisions, rows.table, vehicles, tuple(notes))


def _recognise(path: Path, header: list[str], data_format: str) -> Layout:
    """The first layout of the format with all its columns present."""
    fits = matching_layouts(header, data_format)
    if not fits:
        known = [layout for layout in LAYOUTS if data_format in layout.formats]
        raise _no_fit(path, header, known, f"format {data_format}")
    return fits[0]


def _no_fit(path: Path, header: list[str], known: Sequence[Layout], what: str) -> DataError:
    """Make the error that names the columns that the nearest layout needs."""

    def missing(layout: Layout) -> list[str]:
        return [name for name in required_columns(layout) if name not in header]

    foreign = next((one for one in FOREIGN if one.columns <= set(header)), None)
    if foreign is not None:
        return DataError(foreign.refusal(path))
    nearest = min(known, key=lambda layout: len(missing(layout)) / len(required_columns(layout)))
    others = matching_layouts(header)
    hint = f" It looks like {others[0].name}: --format {others[0].formats[0]}." if others else ""
    return DataError(
        f"Trajectory file {path} does not have the columns of {what}: "
        f"missing {', '.join(missing(nearest))} ({nearest.name} needs {', '.join(required_columns(nearest))}); "
        f"found {', '.join(header[:20])}.{hint}"
    )


def _first_fault(bad: BadRows) -> str:
    reason, (count, line) = next(iter(bad.reasons.items()))
    return f"{reason} ({count} row(s), first at line {line})"


def ticks(table: Table, driver: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Time in steps, and the number of steps in a second.

    Raises:
        DataError: The file's time step does not divide a second.
    """
    time = table.numbers["time"]
    step = time_step(driver, time)
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
    driver = drivers(table)
    tick, per_second = ticks(table, driver)
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
    driver = drivers(table)
    along, _ = position_along(table, layout)
    forward = direction_of_travel(table, along)
    along = np.where(forward, along, -along)
    tick, per_second = ticks(table, driver)
    position, speed = smooth_tracks(driver, tick, along, 1.0 / per_second, layout.window)
    length = table.numbers.get("length", np.full(speed.size, MEAN_LENGTH))
    if layout.kind == "leaders":
        leader = leader_by_name(table.texts["vehicle"], tick, _named_leader(table))
        partner = np.where(leader >= 0, driver[leader], -1)
    else:
        leader, partner = _leader_in_lane(table, driver, tick, along, forward)
    between = length[leader] if layout.front else (length[leader] + length) / 2.0
    alone = partner == _FREE
    gap = np.where(alone, np.inf, position[leader] - position - between)
    range_rate = np.where(alone, 0.0, speed[leader] - speed)
    backwards = speed < -_BACKWARDS
    table.bad.add(f"vehicle reverses (faster than {_BACKWARDS:g} m/s)", table.line[backwards])
    led = ~backwards & (partner >= 0)
    overlap = led & (gap < 0.0)
    table.bad.add("overlaps the vehicle ahead (two vehicles in one place)", table.line[overlap])
    wrong = led & ((gap < GAP_RANGE[0]) | (gap > GAP_RANGE[1]))
    outside = wrong & ~overlap
    table.bad.add(f"gap to the leader outside {GAP_RANGE[0]:g} to {GAP_RANGE[1]:g} m", table.line[outside])
    usable = (partner != -1) & ~wrong & ~backwards & np.isfinite(speed) & np.isfinite(range_rate)
    standing = np.maximum(speed, 0.0)  # noise lets a standing vehicle creep back
    states = Decisions(standing, gap, range_rate, np.zeros_like(speed), driver, _held_out(table, layout, driver))
    return decide_each_second(states, tick, partner, usable, per_second)


def _named_leader(table: Table) -> NDArray[np.int64]:
    """Code, as of vehicles, of the leader that the row names, shape (n,); -1 where none, or not in the file."""
    labels = table.labels["vehicle"]
    code_of = dict(zip(labels, range(len(labels)), strict=True))
    codes = np.array([code_of.get(label, -1) for label in table.labels["leader"]] + [-1], dtype=np.int64)
    return codes[table.texts["leader"]]


def _leader_in_lane(
    table: Table, driver: NDArray[np.int64], tick: NDArray[np.int64], along: NDArray[np.float64],
    forward: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """Return the leader's row (-1: none) and the partner: leader and lane as one number, `_FREE`, or -1 (not known)."""
    lane = np.rint(table.numbers["lane"]).astype(np.int64)
    recording = 2 * table.texts.get("recording", np.zeros_like(driver)) + forward
    leader = leader_by_lane(recording, lane, tick, along)
    end = np.full(int(recording.max()) + 1, -np.inf)
    np.maximum.at(end, recording, along)
    alone = (leader < 0) & (along + GAPS[-1] < end[recording])
    partner = np.where(leader >= 0, driver[leader] * (LANE_LIMIT + 1) + lane, np.where(alone, _FREE, -1))
    return leader, np.where(lane > 0, partner, -1)  # lane 0 means "unknown" in these data
