"""All vehicles of a recorded road at every tenth of a second, from the trajectory files that `ndd` reads.

Positions along and across the road are smoothed (Savitzky-Golay, order 2; the window stands in the layout's `Scene`),
then speeds are taken of them, as the data's own speeds are noisy. Rows that cannot be used are left out, counted and
named, as in `ext.calibrate.readers`.

The simulator's road is straight. Coordinates that are already along and across a road (NGSIM's `Local_Y` and
`Local_X`, `s_m` and `d_m`) are taken as they are: a bend is straightened by definition, distances in a lane stay what
they were in those coordinates. Where a file has a picture's coordinates (highD, TGSIM), the road must run along one of
its axes; else the file is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.errors import DataError
from cornerforge.ext.calibrate.decisions import smooth_tracks
from cornerforge.ext.calibrate.highd import RecordingMeta, read_classes
from cornerforge.ext.calibrate.layouts import CREDITS, DATA_FORMATS, Layout, Scene
from cornerforge.ext.calibrate.readers import (
    Rows,
    guess_format,
    read_rows,
    ticks,
    with_tracks,
)
from cornerforge.ext.calibrate.row_checks import MEAN_LENGTH, drivers
from cornerforge.ext.calibrate.tables import Table, file_sha256
from cornerforge.ext.calibrate.whole_tracks import direction_of_travel, position_along
from cornerforge.ext.interchange.differences import rates
from cornerforge.types import CAR, CLASSES, FRAME_S, MAX_LANES, MOTORCYCLE, TRUCK

__all__ = ["Traffic", "TrafficFile", "read_traffic"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_UNKNOWN_CREDIT = "not known to cornerforge: heed the licence of the source file"
_LEAST_ROWS_A_SECOND = 5
_BRIDGED = 0.5
"""Gaps in a track up to this long are bridged by a straight line before smoothing [s]; longer ones split it."""
_SHORT_WINDOW = 0.5
"""Stretches shorter than the layout's window are smoothed over this one [s]."""
_BACKWARDS = 2.0
"""Faster reversing than this [m/s] is a tracking error, as in `ext.calibrate.readers`."""
_STEADY_SPEED = 3.0
"""Below it a heading is that of the same lateral speed at this speed [m/s]: noise does not turn a standing vehicle."""
_SIDEWAYS = 0.2
"""Lateral speed below which no vehicle changes lanes [m/s]: within a lane vehicles of US-101 wander at 0.2 m/s."""
_LANE_WIDTHS = (2.5, 6.0)
"""Lane widths that can be driven [m]."""
_LONE_LANE = 3.6
"""Width of the lane of a road on which one lane only was recorded [m]."""
_STRAIGHT = 1.25
"""Within a lane nine in ten positions lie within this many lane widths; else the road does not run along an axis."""
_ROOM, _MOST_IN_ROOM = 100.0, 250
"""More vehicles than this within so many metres stand on no road [m]."""
_USUAL_WIDTH = {CAR: 1.9, TRUCK: 2.5, MOTORCYCLE: CLASSES[MOTORCYCLE].width}
_TRUCK_FROM, _MOTORCYCLE_UP_TO = 8.0, (3.2, 1.3)
"""Where a file names no classes: length of the shortest truck [m]; length and width of the largest motorcycle [m]."""


@dataclass(frozen=True)
class TrafficFile:
    """A file and what became of its rows.

    Attributes:
        name: Its name, without folders.
        sha256: SHA-256 of its bytes.
        layout: Name of the layout that it was recognised as.
        credit: Publisher of the data, and what to check before passing on results made of them.
        window: Smoothing window of positions [s].
        rows_read: All rows.
        left_out: Rows left out: reason -> (count, line of the first).
        notes: Oddities and assumptions about the file, in plain sentences.
    """

    name: str
    sha256: str
    layout: str
    credit: str
    window: float = field(metadata={"unit": "s"})
    rows_read: int
    left_out: Mapping[str, tuple[int, int]]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Traffic:
    """All vehicles of one recording that drive in one direction.

    Rows are sorted by vehicle, then frame. A vehicle is absent in the gaps of its track.

    Attributes:
        file: Where it is from.
        recording: Name of the recording, or clip; empty where the file has none.
        direction: "forward", towards growing positions of the file, or "backward".
        began: Time of frame 0, in the file's own time [s].
        lanes: Number of lanes.
        lane_width: [m].
        names: What the file calls each vehicle, (V,).
        kind: Class of each, int8 (V,).
        length, width: Size of each [m], (V,).
        vehicle: Which vehicle, int64 (n,).
        frame: When, in tenths of a second, int64 (n,).
        x: Box centre along the road [m], (n,); it grows in the direction of travel.
        y: Box centre, to the left of the right edge of the road [m], (n,).
        speed: Along the road, 0 or more [m/s], (n,).
        lateral_speed: To the left positive [m/s], (n,).
        heading: Counter-clockwise from the road's direction [rad], (n,).
        acceleration: Along the road [m/s2], (n,).
        lane: Lane that it keeps or goes to, 0 = rightmost, int64 (n,): that of the centre, but while it is moving
            over to another lane, and does cross the marking, already that one.
    """

    file: TrafficFile
    recording: str
    direction: str
    began: float = field(metadata={"unit": "s"})
    lanes: int
    lane_width: float = field(metadata={"unit": "m"})
    names: tuple[str, ...]
    kind: NDArray[np.int8]
    length: Floats = field(metadata={"unit": "m"})
    width: Floats = field(metadata={"unit": "m"})
    vehicle: Ints
    frame: Ints
    x: Floats = field(metadata={"unit": "m"})
    y: Floats = field(metadata={"unit": "m"})
    speed: Floats = field(metadata={"unit": "m/s"})
    lateral_speed: Floats = field(metadata={"unit": "m/s"})
    heading: Floats = field(metadata={"unit": "rad"})
    acceleration: Floats = field(metadata={"unit": "m/s2"})
    lane: Ints


@dataclass(frozen=True)
class _Tracks:
    """Rows on the way to a `Traffic`: one time step, one direction of travel each, sorted by vehicle and tick.

    `line` is 0 for a row that bridges a gap.
    """

    vehicle: Ints
    tick: Ints
    line: Ints
    along: Floats
    left: Floats

    def where(self, mask: Bools | Ints) -> _Tracks:
        return _Tracks(self.vehicle[mask], self.tick[mask], self.line[mask], self.along[mask], self.left[mask])


def read_traffic(paths: Sequence[Path], data_format: str | None = None) -> list[Traffic]:
    """Read all vehicles of trajectory files.

    Args:
        paths: The files, CSV or gzipped CSV. highD's meta files are found beside their tracks.
        data_format: One of `ext.calibrate.layouts.DATA_FORMATS`; None to tell it from the columns.

    Returns:
        One for each file, recording and direction of travel, in this order; recordings by name. A file that is given
        twice counts once, with a note.

    Raises:
        UnknownNameError, InputError: The format is unknown, or the columns do not determine it.
        DataError: A file is missing, empty, cut off, has other columns, has no position across the road, less than 5
            rows a second, more vehicles than fit onto a road or no usable stretch, or its road cannot be driven: lanes
            below 2.5 m or above 6 m (feet taken for metres?), a bend.
    """
    data_format = (
        guess_format(paths) if data_format is None else check_in("trajectory format", data_format, DATA_FORMATS)
    )
    of: dict[str, list[Traffic]] = {}
    for path in with_tracks(paths):
        digest = _digest(path)
        if digest in of:
            note = f"{path.name} was given again, the same to the bit; it counts once"
            of[digest] = [replace(one, file=replace(one.file, notes=(*one.file.notes, note))) for one in of[digest]]
        else:
            of[digest] = _read_file(path, data_format)
    return [traffic for parts in of.values() for traffic in parts]


def _digest(path: Path) -> str:
    """Tell files apart by their content; files that cannot be read, by name (the reader will say why)."""
    try:
        return file_sha256(path)
    except OSError:
        return str(path)


def _read_file(path: Path, data_format: str) -> list[Traffic]:
    rows = read_rows(path, data_format, scene=True)
    layout, table, scene = rows.layout, rows.table, rows.layout.scene
    if scene is None or not ({"lateral", "across"} & set(table.numbers)):
        column = f" (column {scene.across[0]})" if scene is not None and scene.across is not None else ""
        raise DataError(
            f"Trajectory file {path} ({layout.name}) does not say where vehicles are across the road{column}; cases "
            "are made of files that do: highD, official NGSIM, TGSIM, or tracks with lanes and d_m."
        )
    forward, along, left = _directed(table, layout, scene)
    driver = drivers(table)
    tick, per_second = ticks(table, driver)
    if per_second < _LEAST_ROWS_A_SECOND:
        raise DataError(
            f"Trajectory file {path} has {per_second} row(s) a second for each vehicle; {_LEAST_ROWS_A_SECOND} and "
            "more are needed to tell how critical a moment is."
        )
    recording = table.texts.get("recording", np.zeros_like(driver))
    _check_room(path, table, 2 * recording + forward, tick, along)
    groups = list(zip(*np.unique(np.stack([recording, ~forward]), axis=1).tolist(), strict=True))
    roads = _roads(path, rows, scene, groups, recording, forward, left)
    parts = []
    for number, back in groups:
        group = _Group(path, rows, scene, int(number), not back, (recording == number) & (forward != bool(back)))
        parts.append(_traffic(group, roads[int(number), not back], driver, tick, per_second, along, left))
    if not any(part is not None for part in parts):
        reasons = "; ".join(f"{reason} ({count})" for reason, (count, _) in table.bad.reasons.items())
        raise DataError(f"Trajectory file {path} holds no stretch of {_SHORT_WINDOW:g} s on the road: {reasons}.")
    file = TrafficFile(
        name=path.name, sha256=file_sha256(path), layout=layout.name,
        credit=CREDITS.get(data_format, _UNKNOWN_CREDIT), window=scene.window,
        rows_read=table.rows_read, left_out=dict(table.bad.reasons), notes=(*rows.notes, *_sizes_note(table)),
    )  # fmt: skip
    return [replace(part, file=file) for part in parts if part is not None]


def _check_room(path: Path, table: Table, road: Ints, tick: Ints, along: Floats) -> None:
    """Refuse more vehicles in one place than a road holds.

    Args:
        path: For the message.
        table: The rows.
        road: Recording and direction, as one number, (n,).
        tick: When, (n,).
        along: Where [m], (n,).

    Raises:
        DataError: There are.
    """
    order = np.lexsort((along, tick, road))
    place, moment = along[order], np.cumsum(np.diff(tick[order], prepend=0) != 0)
    key = moment * (float(np.ptp(place)) + 2.0 * _ROOM) + place - place.min()
    ahead = np.searchsorted(key, key + _ROOM, side="right") - np.arange(key.size)
    worst = int(np.argmax(ahead))
    if ahead[worst] > _MOST_IN_ROOM:
        raise DataError(
            f"Trajectory file {path}: {ahead[worst]:,} vehicles are within {_ROOM:g} m at one time (first at line "
            f"{table.line[order[worst]]}), which no road holds. Are positions in metres, and recordings kept apart?"
        )


def _directed(table: Table, layout: Layout, scene: Scene) -> tuple[Bools, Floats, Floats]:
    """Return which rows drive forward, the centre's position in the direction of travel, and across it, to the left."""
    position, swapped = position_along(table, layout)
    forward = direction_of_travel(table, position)
    way = np.where(forward, 1.0, -1.0)
    if swapped:  # a quarter turn: along the road becomes across it
        left = -scene.left * way * table.numbers["position"]
    else:
        across = table.numbers["lateral"] if "lateral" in table.numbers else table.numbers["across"]
        if layout.corner and "width" in table.numbers:
            across = across + table.numbers["width"] / 2.0
        left = scene.left * way * across
    along = way * position
    if layout.front:
        along = along - 0.5 * table.numbers.get("length", np.full(along.size, MEAN_LENGTH))
    return forward, along, left


@dataclass(frozen=True)
class _Road:
    """Where lanes are: number, width [m], and the right edge in the coordinate that grows to the left [m]."""

    lanes: int
    lane_width: float
    right_edge: float


@dataclass(frozen=True)
class _Group:
    """One recording and direction of a file, and which rows of its table are of it."""

    path: Path
    rows: Rows
    scene: Scene
    recording: int
    forward: bool
    mask: Bools


def _roads(
    path: Path, rows: Rows, scene: Scene, groups: Sequence[tuple[int, int]], recording: Ints, forward: Bools,
    left: Floats,
) -> dict[tuple[int, bool], _Road]:  # fmt: skip
    """Find the road of each recording and direction."""
    roads: dict[tuple[int, bool], _Road] = {}
    for number, back in groups:
        ahead = not back
        mask = forward == ahead
        if not scene.one_road:
            mask &= recording == number
        elif (same := next((road for (_, way), road in roads.items() if way == ahead), None)) is not None:
            roads[int(number), ahead] = same
            continue
        marked = _marked(rows.meta, scene, ahead)
        lane = np.rint(rows.table.numbers["lane"][mask]).astype(np.int64) if "lane" in rows.table.numbers else None
        road = marked or _road_of_lanes(path, lane, left[mask], rows.notes)
        roads[int(number), ahead] = road
    return roads


def _marked(meta: RecordingMeta | None, scene: Scene, forward: bool) -> _Road | None:
    """Take the road from lane markings; None without markings, or if the marked road cannot be driven."""
    marks = () if meta is None else (meta.lower if forward else meta.upper)
    if len(marks) < 2:
        return None
    left = np.sort(scene.left * (1.0 if forward else -1.0) * np.array(marks))
    lanes = len(marks) - 1
    width = float(left[-1] - left[0]) / lanes
    usable = _LANE_WIDTHS[0] <= width <= _LANE_WIDTHS[1] and lanes <= MAX_LANES
    return _Road(lanes, width, float(left[0])) if usable else None


def _road_of_lanes(path: Path, lane: Ints | None, left: Floats, notes: Sequence[str]) -> _Road:
    """Fit lanes of one width to where the vehicles of each lane drive.

    The width is the slope, and the right edge the offset, of the line of least squares through the medians of lanes:
    the road is moved as a whole, nothing across it is stretched. Of more than 6 lanes the 6 side by side with the most
    rows are taken (NGSIM's ramps have lanes of their own).
    """
    lane = np.ones(left.size, dtype=np.int64) if lane is None else lane
    numbers, rows = np.unique(lane[lane > 0], return_counts=True)  # lane 0 means "unknown" in these data
    numbers = numbers[rows >= 0.002 * rows.sum()] if rows.size else numbers
    if numbers.size == 0:
        raise DataError(f"Trajectory file {path} names no lane (lane 0 means that it is not known).")
    middle = np.array([np.median(left[lane == number]) for number in numbers])
    spread = np.array([np.ptp(np.percentile(left[lane == number], [5.0, 95.0])) for number in numbers])
    weight = np.array([np.count_nonzero(lane == number) for number in numbers])
    order = np.argsort(middle)
    middle, spread, weight = middle[order], spread[order], weight[order]
    hint = f" {notes[0]}" if notes else ""
    steps = np.diff(middle)
    apart = steps[steps > 0.5 * np.median(steps)] if steps.size else steps  # ramps of one place share a middle
    width = float(np.median(apart)) if apart.size else _LONE_LANE
    if float(np.median(spread)) > _STRAIGHT * min(width, _LANE_WIDTHS[1]):
        raise DataError(
            f"Trajectory file {path}: within one lane vehicles are spread over {np.median(spread):.3g} m across the "
            "road, so the road does not run along an axis of its coordinates. Give positions along and across the road."
        )
    if not _LANE_WIDTHS[0] <= width <= _LANE_WIDTHS[1]:
        raise DataError(
            f"Trajectory file {path}: lanes are {width:.3g} m apart, where {_LANE_WIDTHS[0]:g} to {_LANE_WIDTHS[1]:g} "
            f"m can be driven. Are positions in metres, and lanes numbered side by side?{hint}"
        )
    place = np.concatenate([[0], np.cumsum(np.maximum(np.rint(steps / width), 0.0))]).astype(np.int64)
    count = int(place[-1]) + 1
    first = 0
    if count > MAX_LANES:
        held = np.bincount(place, weights=weight, minlength=count)
        first = int(np.argmax(np.convolve(held, np.ones(MAX_LANES), mode="valid")))
        count = MAX_LANES
    kept = (place >= first) & (place < first + count)
    at = place[kept] - first + 0.5
    slope = width
    if np.unique(at).size > 1:
        slope = float(np.clip(np.polyfit(at, middle[kept], 1)[0], *_LANE_WIDTHS))
    return _Road(count, slope, float(np.mean(middle[kept] - slope * at)))


def _traffic(
    group: _Group, road: _Road, driver: Ints, tick: Ints, per_second: int, along: Floats, left: Floats
) -> Traffic | None:
    """Make the traffic of one recording and direction; None if nothing of it can be used."""
    table, mask = group.rows.table, group.mask
    if not mask.any():
        return None
    first_row = np.flatnonzero(mask)
    codes, vehicle = np.unique(driver[mask], return_inverse=True)
    vehicle = vehicle.reshape(-1).astype(np.int64)
    began = int(tick[mask].min())
    tracks = _Tracks(vehicle, tick[mask] - began, table.line[mask], along[mask], left[mask] - road.right_edge)
    tracks = _bridged(tracks, per_second)
    moving = _smoothed(tracks, 1.0 / per_second, group.scene.window)
    table.bad.add(f"stretch shorter than {_SHORT_WINDOW:g} s", _lines(tracks, np.isnan(moving["x"])))
    reverses = moving["speed"] < -_BACKWARDS
    table.bad.add(f"vehicle reverses (faster than {_BACKWARDS:g} m/s)", _lines(tracks, reverses))
    outside = (moving["y"] < 0.0) | (moving["y"] > road.lanes * road.lane_width)
    table.bad.add("beside the lanes (ramp or shoulder)", _lines(tracks, outside))
    usable = np.isfinite(moving["x"]) & ~reverses & ~outside
    tracks, moving = tracks.where(usable), {name: values[usable] for name, values in moving.items()}
    tracks, moving = _each_tenth(tracks, moving, per_second)
    if tracks.tick.size == 0:
        return None
    speed = np.maximum(moving["speed"], 0.0)  # noise lets a standing vehicle creep back
    start = _starts(tracks)
    names = table.labels["vehicle"]
    of = table.texts["vehicle"][first_row][np.unique(vehicle, return_index=True)[1]]
    length, width, kind = _sizes(group, vehicle, codes.size, [names[code] for code in of])
    return Traffic(
        file=TrafficFile("", "", "", "", 0.0, 0, {}, ()),  # `_read_file` puts it in when all rows are counted
        recording=table.labels["recording"][group.recording] if "recording" in table.texts else "",
        direction="forward" if group.forward else "backward",
        began=float(table.numbers["time"].min()) + began / per_second,
        lanes=road.lanes,
        lane_width=road.lane_width,
        names=tuple(names[code] for code in of),
        kind=kind, length=length, width=width,
        vehicle=tracks.vehicle, frame=tracks.tick,
        x=_never_back(moving["x"], start), y=moving["y"],
        speed=speed,
        lateral_speed=moving["lateral_speed"],
        heading=np.arctan2(moving["lateral_speed"], np.maximum(speed, _STEADY_SPEED)),
        acceleration=_slope(speed, start),
        lane=_lanes(moving["y"], moving["lateral_speed"], start, road),
    )  # fmt: skip


def _lines(tracks: _Tracks, mask: Bools) -> Ints:
    """Lines of the file of these rows, without rows that bridge a gap."""
    return tracks.line[mask & (tracks.line > 0)]


def _bridged(tracks: _Tracks, per_second: int) -> _Tracks:
    """Put a row at each missing tick of a short gap, on the straight line over the gap."""
    most = max(1, int(_BRIDGED * per_second))
    step = np.append(np.diff(tracks.tick), 1)
    same = np.append(np.diff(tracks.vehicle) == 0, False)
    count = np.where(same & (step <= most + 1), step, 1)
    base = np.repeat(np.arange(tracks.tick.size), count)
    offset = np.arange(base.size) - np.repeat(np.cumsum(count) - count, count)
    part = offset / count[base]
    after = np.minimum(base + 1, tracks.tick.size - 1)

    def between(values: Floats) -> Floats:
        return np.where(offset > 0, values[base] + part * (values[after] - values[base]), values[base])

    return _Tracks(
        vehicle=tracks.vehicle[base],
        tick=tracks.tick[base] + offset,
        line=np.where(offset == 0, tracks.line[base], 0),
        along=between(tracks.along),
        left=between(tracks.left),
    )


def _smoothed(tracks: _Tracks, step: float, window: float) -> dict[str, Floats]:
    """Smooth positions and take speeds of them; NaN in stretches shorter than the shortest window."""
    made: dict[str, Floats] = {}
    for position, speed, values in (("x", "speed", tracks.along), ("y", "lateral_speed", tracks.left)):
        place, rate = smooth_tracks(tracks.vehicle, tracks.tick, values, step, window)
        short = np.isnan(place)
        if short.any():
            place[short], rate[short] = smooth_tracks(
                tracks.vehicle[short], tracks.tick[short], values[short], step, min(window, _SHORT_WINDOW)
            )
        made[position], made[speed] = place, rate
    return made


def _each_tenth(tracks: _Tracks, moving: Mapping[str, Floats], per_second: int) -> tuple[_Tracks, dict[str, Floats]]:
    """Take values at each tenth of a second, between rows where none stands there."""
    per_frame = per_second * FRAME_S
    if abs(per_frame - round(per_frame)) < 1e-9:
        whole = round(per_frame)
        at = np.flatnonzero(tracks.tick % whole == 0)
        chosen = tracks.where(at)
        return replace(chosen, tick=chosen.tick // whole), {name: values[at] for name, values in moving.items()}
    starts = _starts(tracks)
    vehicles, frames = [], []
    columns: dict[str, list[Floats]] = {name: [] for name in moving}
    for first, end in zip(starts, np.append(starts, tracks.tick.size)[1:], strict=True):
        when = tracks.tick[first:end] / per_frame
        frame = np.arange(np.ceil(when[0] - 1e-9), np.floor(when[-1] + 1e-9) + 1.0)
        frames.append(frame.astype(np.int64))
        vehicles.append(np.full(frame.size, tracks.vehicle[first]))
        for name, values in moving.items():
            columns[name].append(np.interp(frame, when, values[first:end]))
    frame_of = np.concatenate([np.zeros(0, dtype=np.int64), *frames])
    vehicle_of = np.concatenate([np.zeros(0, dtype=np.int64), *vehicles])
    nothing = np.zeros(frame_of.size)
    even = _Tracks(vehicle_of, frame_of, np.zeros_like(frame_of), nothing, nothing)
    return even, {name: np.concatenate([np.zeros(0), *parts]) for name, parts in columns.items()}


def _starts(tracks: _Tracks) -> Ints:
    """First row of each stretch of one vehicle without a gap."""
    if tracks.tick.size == 0:
        return np.zeros(0, dtype=np.int64)
    breaks = (np.diff(tracks.vehicle) != 0) | (np.diff(tracks.tick) != 1)
    return np.concatenate([[0], np.flatnonzero(breaks) + 1]).astype(np.int64)


def _never_back(x: Floats, starts: Ints) -> Floats:
    """Keep noise from moving vehicles backwards: each position is at least the one before in its stretch."""
    made = x.copy()
    for first, end in zip(starts, np.append(starts[1:], x.size), strict=True):
        made[first:end] = np.maximum.accumulate(x[first:end])
    return made


def _slope(speed: Floats, starts: Ints) -> Floats:
    """Acceleration [m/s2]: the slope of speeds within each stretch; 0 in one of a single row."""
    return np.concatenate([np.zeros(0), *map(rates, np.split(speed, starts[1:]))])


def _lanes(y: Floats, lateral_speed: Floats, starts: Ints, road: _Road) -> Ints:
    """Find the lane that each vehicle keeps or goes to, (n,).

    It is the lane of the centre; before the centre crosses a marking, the one that it goes to, as long as it has been
    moving there.
    """
    own = np.clip(np.floor(y / road.lane_width), 0, road.lanes - 1).astype(np.int64)
    lane = own.copy()
    for first, end in zip(starts, np.append(starts[1:], y.size), strict=True):
        for crossed in first + 1 + np.flatnonzero(np.diff(own[first:end])):
            side = np.sign(own[crossed] - own[crossed - 1])
            row = crossed - 1
            while row >= first and side * lateral_speed[row] > _SIDEWAYS and own[row] == own[crossed - 1]:
                lane[row] = own[crossed]
                row -= 1
    return lane


def _sizes(group: _Group, vehicle: Ints, count: int, names: Sequence[str]) -> tuple[Floats, Floats, NDArray[np.int8]]:
    """Length, width and class of each vehicle, (V,): medians over its rows; what the file lacks is taken as usual."""
    table, mask = group.rows.table, group.mask
    order = np.argsort(vehicle, kind="stable")
    bounds = np.searchsorted(vehicle[order], np.arange(count + 1))

    def medians(values: Floats) -> Floats:
        ordered = values[mask][order]
        return np.array([np.median(ordered[a:b]) for a, b in pairwise(bounds.tolist())])

    length = medians(table.numbers["length"]) if "length" in table.numbers else np.full(count, MEAN_LENGTH)
    width = medians(table.numbers["width"]) if "width" in table.numbers else None
    kind = _kinds(group, vehicle, count, names)
    if kind is None:
        narrow = width if width is not None else np.full(count, _USUAL_WIDTH[CAR])
        small = (length <= _MOTORCYCLE_UP_TO[0]) & (narrow <= _MOTORCYCLE_UP_TO[1])
        kind = np.where(small, MOTORCYCLE, np.where(length >= _TRUCK_FROM, TRUCK, CAR)).astype(np.int8)
    if width is None:
        width = np.array([_USUAL_WIDTH[int(one)] for one in kind])
    return length, width, kind


def _kinds(group: _Group, vehicle: Ints, count: int, names: Sequence[str]) -> NDArray[np.int8] | None:
    """Class of each vehicle, as the file, or highD's file beside it, says; None: it does not."""
    table, known = group.rows.table, group.scene.kinds
    if "kind" in table.texts:
        said = np.full(count, -1, dtype=np.int64)
        said[vehicle] = table.texts["kind"][group.mask]
        texts = [table.labels["kind"][code].lower() for code in said]
    else:
        classes = read_classes(group.path)
        if not classes:
            return None
        texts = [classes.get(name, "") for name in names]
    return np.array([known.get(text, CAR) for text in texts], dtype=np.int8)


def _sizes_note(table: Table) -> list[str]:
    """Say which sizes the file does not give."""
    missing = [name for name in ("length", "width") if name not in table.numbers]
    usual = {"length": f"{MEAN_LENGTH:g} m", "width": "the usual one of the class"}
    return [f"{table.name} gives no {name} of vehicles: {usual[name]} is taken." for name in missing]
