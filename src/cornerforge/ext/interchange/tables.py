"""Cases as plain tables, .csv or .parquet: one row for each vehicle and tenth of a second.

Parquet files hold road, facts and the meaning of columns as metadata of the table (`cornerforge`, a JSON object) and of
the columns (`unit`, `meaning`). A CSV file NAME.csv holds the table alone; the rest is in NAME.facts.json beside it.
CSV files that begin with comments instead (`# road: ...`), as earlier versions wrote, are read too. CSV has six
decimals, Parquet double precision.
"""

from __future__ import annotations

import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cornerforge._arrow import arrow_fields
from cornerforge._files import reason, writing
from cornerforge._schema import parse
from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import DataError, FileFormatError, InputError
from cornerforge.ext.interchange.differences import jumps, rates
from cornerforge.ext.interchange.left_out import gaps, in_lanes, nearest, within
from cornerforge.ext.interchange.site_lanes import within_a_turn
from cornerforge.fields import Field
from cornerforge.library.out_case import ONE_LANE, Fact, MovingCase, OutCase, safe_name, straight_road
from cornerforge.types import CLASSES, FRAME_S, MAX_LANES, Odd, Scenario

__all__ = ["COLUMNS", "read_table", "write_table"]

COLUMNS = (
    Field("frame", "int32", "", "Number of the tenth of a second, from 0 on."),
    Field("time_s", "float64", "s", "Time from the start: a tenth of the frame."),
    Field("slot", "int32", "", "Number of the vehicle; 0 is the AV."),
    Field("class", "string", "", "Class of the vehicle: car, truck or motorcycle."),
    Field("length_m", "float64", "m", "Length of its box."),
    Field("width_m", "float64", "m", "Width of its box."),
    Field("x_m", "float64", "m", "Box centre along the road."),
    Field("y_m", "float64", "m", "Box centre, to the left of the right road edge."),
    Field("speed_mps", "float64", "m/s", "Along the road."),
    Field("heading_rad", "float64", "rad", "Counter-clockwise from the road's direction."),
    Field("acceleration_mps2", "float64", "m/s2", "Along the road."),
    Field("lane", "int32", "", "Lane kept or changed to; 0 is the rightmost."),
)
"""Columns of a table, in this order; rows are ordered by frame and slot."""
_AT_SITE = {
    "class": "Class of the vehicle: car or truck, or person.", "x_m": "Box centre, east.", "y_m": "Box centre, north.",
    "speed_mps": "Along its way.", "heading_rad": "Counter-clockwise from east.",
    "acceleration_mps2": "Along its way.", "lane": "Index of its route.",
}  # fmt: skip
"""Meaning of columns at a site, where it is another. No table of a site is read back."""

_MARK = "cornerforge case"
_KEY = b"cornerforge"
_VERSION = 1
_ROW = "%d,%.1f,%d,%s,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%d\n"
_MOST_BYTES = 64 * 2**20
_MOST_ROWS = 1_000_000
_MOST_FRAMES = 6_001
_MOST_SLOT = 9_999
_LIMITS = {
    "time_s": (0.0, 600.0), "length_m": (0.5, 30.0), "width_m": (0.3, 4.0), "x_m": (-1e6, 1e6), "y_m": (-1e3, 1e3),
    "speed_mps": (0.0, 1e3), "heading_rad": (-math.pi, math.pi), "acceleration_mps2": (-1e3, 1e3),
    "frame": (0, _MOST_FRAMES - 1), "slot": (0, _MOST_SLOT), "lane": (0, MAX_LANES - 1),
}  # fmt: skip
_FARTHEST_M = 15.0
"""A vehicle goes at most as far from one frame to the next: 150 m/s."""
_POSES = {
    "x_m": X, "y_m": Y, "speed_mps": SPEED, "heading_rad": HEADING, "acceleration_mps2": ACCELERATION, "lane": LANE,
}  # fmt: skip


def write_table(case: OutCase, path: Path) -> tuple[str, ...]:
    """Write a case as a table; returns the names of the files.

    Args:
        case: The case.
        path: The file; its ending says the format, .csv or .parquet.

    Raises:
        InputError: Another ending.
        OutputError: The file cannot be written.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path.name}: a table ends in .csv or .parquet.")
    odd = case.scenario.odd
    road: dict[str, Any] = {"lanes": odd.n_lanes, "lane_width_m": odd.lane_width}
    if odd.site is not None:
        road = {"site": odd.site.name, "routes": [route.name for route in odd.site.routes]}
    about = {"version": _VERSION, "name": case.name, "road": road, "facts": dict(case.facts)}
    columns = _columns_of(case.scenario)
    beside = _facts_file(path)
    if path.suffix == ".csv":
        about["columns"] = {c.name: {"unit": c.unit, "meaning": c.meaning} for c in _meant(odd)}
        with writing(beside, "the facts of the table") as part:
            part.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    with writing(path, "the table") as part:
        if path.suffix == ".parquet":
            _write_parquet(part, columns, about, _meant(odd))
        else:
            rows = "".join([_ROW % row for row in zip(*columns.values(), strict=True)])
            part.write_bytes((",".join(columns) + "\n" + rows).encode())
    return (path.name, beside.name) if path.suffix == ".csv" else (path.name,)


def _meant(odd: Odd) -> tuple[Field, ...]:
    """Say what the columns mean: at a site places lie in its plane, and a lane is a route."""
    if odd.site is None:
        return COLUMNS
    return tuple(replace(one, meaning=_AT_SITE.get(one.name, one.meaning)) for one in COLUMNS)


def _facts_file(path: Path) -> Path:
    """Name the file beside a CSV file."""
    return path.with_name(f"{path.stem}.facts.json")


def _columns_of(scenario: Scenario) -> dict[str, list[Any]]:
    """Make the columns, rows ordered by frame and slot."""
    order = np.argsort(scenario.slot, kind="stable")
    frame, at = np.nonzero(scenario.present[:, order])
    vehicle = order[at]
    classes = [user.name for user in CLASSES]
    series: tuple[NDArray[Any], ...] = (
        frame, np.round(FRAME_S * frame, 1), scenario.slot[vehicle], scenario.kind[vehicle],
        scenario.length[vehicle], scenario.width[vehicle], scenario.x[frame, vehicle], scenario.y[frame, vehicle],
        scenario.speed[frame, vehicle], within_a_turn(scenario.heading[frame, vehicle]), scenario.acceleration[frame, vehicle],
        scenario.target_lane[frame, vehicle],
    )  # fmt: skip
    columns = {column.name: values.tolist() for column, values in zip(COLUMNS, series, strict=True)}
    columns["class"] = [classes[kind] for kind in columns["class"]]
    return columns


def _write_parquet(part: Path, columns: dict[str, list[Any]], about: dict[str, Any], meant: tuple[Field, ...]) -> None:
    schema = pa.schema(arrow_fields(meant), metadata={_KEY: json.dumps(about)})
    with part.open("wb") as file:  # Arrow takes a path like run-10:30 for an address
        pq.write_table(pa.table(columns, schema=schema), file)


def read_table(path: Path) -> MovingCase:
    """Read a table that `write_table` wrote, or one of the same columns with the same facts beside it or within.

    Lateral speeds are differences of `y_m`. The case's frames are those of slot 0, the AV. If slot 0 has a single row,
    its motion is unknown, and all frames are read.

    Raises:
        InputError: The file is missing, it has another ending, or road and vehicles cannot be driven.
        FileFormatError: It is damaged, or not a table of this kind.
        DataError: A value is missing, not finite or impossible.
    """
    read = {".csv": _read_csv, ".parquet": _read_parquet}.get(path.suffix)
    if read is None:
        raise InputError(f"{path.name}: a table ends in .csv or .parquet.")
    try:
        if not path.is_file():
            raise InputError(f"No file {path}.")
        if path.stat().st_size > _MOST_BYTES:
            raise FileFormatError(f"{path.name} has more than {_MOST_BYTES >> 20} MB; cut it in parts.")
        table, about = read(path)
    except OSError as error:
        raise InputError(f"Cannot read {path}: {reason(error)}.") from error
    if isinstance(about.get("road"), dict) and "site" in about["road"]:
        _fault(path.name, "it is a case at a junction, and only cases on a straight road are read")
    return _case_of(path.name, _checked(path.name, table), about)


def _fault(name: str, what: str) -> NoReturn:
    raise FileFormatError(f"{name}: {what}.")


def _read_csv(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path.name} is no text in UTF-8 ({error.reason}); save it as such.") from None
    comments = next((at for at, line in enumerate(lines) if not line.startswith("#")), len(lines))
    facts: dict[str, Any] = {}
    about: dict[str, Any] = {"facts": facts} if comments else _read_facts(_facts_file(path))
    for number, line in enumerate(lines[:comments], 1):
        found = re.fullmatch(r'# (cornerforge case|name|road|fact ("(?:[^"\\]|\\.)*")): (.*?)\r?', line)
        if found is None:
            continue
        try:
            value = parse(found[3])
            if found[2]:
                facts[parse(found[2])] = value
            else:
                about[{_MARK: "version"}.get(found[1], found[1])] = value
        except ValueError:
            _fault(path.name, f"line {number} holds no JSON after the colon: {line[:60]}")
    body = "\n".join(lines[comments:]).encode()
    if "".join(lines[comments : comments + 1]).strip() and "," not in lines[comments]:
        _fault(path.name, f"line {comments + 1} holds no comma; put commas between fields, and points into numbers")
    types = {field.name: field.type for field in arrow_fields(COLUMNS)}
    try:
        table = pa_csv.read_csv(
            io.BytesIO(body),
            read_options=pa_csv.ReadOptions(use_threads=False),
            convert_options=pa_csv.ConvertOptions(column_types=types, strings_can_be_null=True),
        )
    except pa.ArrowInvalid as error:
        _fault(path.name, f"it is no such table: {str(error).splitlines()[0][:200]}")
    return table, about


def _read_facts(path: Path) -> dict[str, Any]:
    """Read the file beside a CSV file; {} where there is none.

    Raises:
        FileFormatError: It is no JSON object.
    """
    try:
        found = parse(path.read_text(encoding="utf-8-sig")) if path.is_file() else {}
    except ValueError as error:
        _fault(path.name, f"it holds no JSON ({error})")
    if not isinstance(found, dict):
        _fault(path.name, "it holds no JSON object")
    return found


def _read_parquet(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    try:
        with pq.ParquetFile(path) as file:
            if file.metadata.num_rows > _MOST_ROWS:  # before they take memory
                _fault(path.name, f"there are {file.metadata.num_rows:,} rows; 1 to {_MOST_ROWS:,} are read")
            about = parse((file.schema_arrow.metadata or {}).get(_KEY, b"{}").decode())
            table = file.read()
    except (pa.ArrowException, ValueError) as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(f"{path.name} is no whole Parquet file: {str(error).splitlines()[0][:200]}.") from None
    if not isinstance(about, dict):
        _fault(path.name, 'its metadata "cornerforge" is no JSON object')
    return table, about


def _checked(name: str, table: pa.Table) -> dict[str, NDArray[Any]]:
    """Take the columns as arrays, each value where it can be.

    Raises:
        FileFormatError: A column is missing, twice there, or of another type.
        DataError: A value is missing or impossible.
    """
    missing = [column.name for column in COLUMNS if table.column_names.count(column.name) != 1]
    if missing:
        _fault(name, f"a case needs each of these columns once: {', '.join(missing)}")
    if not 1 <= table.num_rows <= _MOST_ROWS:
        raise DataError(f"{name}: there are {table.num_rows:,} rows; 1 to {_MOST_ROWS:,} are read.")
    columns: dict[str, NDArray[Any]] = {}
    for column, field in zip(COLUMNS, arrow_fields(COLUMNS), strict=True):
        try:
            values = table[column.name].cast(field.type)
        except (pa.ArrowException, ValueError):
            _fault(name, f"column {column.name} holds other values than {column.type}")
        if values.null_count:
            row = values.is_null().index(True).as_py()
            raise DataError(f"{name}: {column.name} is missing in row {row + 1}.")
        columns[column.name] = np.array(values.to_pylist())
        if column.name not in _LIMITS:
            continue
        low, high = _LIMITS[column.name]
        bad = ~((columns[column.name] >= low) & (columns[column.name] <= high))
        if bad.any():
            row = int(bad.argmax())
            raise DataError(
                f"{name}: {column.name} = {columns[column.name][row]:g} in row {row + 1}; allowed: {low:.7g} to "
                f"{high:.7g}{f' {column.unit}' if column.unit else ''}."
            )
    return columns


def _case_of(name: str, columns: dict[str, NDArray[Any]], about: dict[str, Any]) -> MovingCase:
    lanes, lane_width = _road_of(name, about)
    frame, slot = columns["frame"], columns["slot"]
    if np.abs(columns["time_s"] - FRAME_S * frame).max() > 0.01:
        raise DataError(f"{name}: time_s is not a tenth of frame; a case has ten frames a second.")
    slots, vehicle = np.unique(slot, return_inverse=True)
    if slots[0] != 0:
        raise DataError(f"{name}: there is no slot 0, the AV.")
    if np.unique(np.stack([frame, slot]), axis=1).shape[1] != frame.size:
        raise DataError(f"{name}: a vehicle has two rows for one frame.")
    _check_ways(name, columns)
    if columns["lane"].max() >= lanes:
        raise DataError(f"{name}: lane {columns['lane'].max()} in a road of {lanes} lanes; 0 is the rightmost.")
    own = frame[slot == 0]
    first, last = int(own.min()), int(own.max() if own.size > 1 else frame.max())
    kind, length, width = _bodies(name, columns, vehicle)
    fastest, seconds = float(columns["speed_mps"].max()), FRAME_S * (last - first)
    poses = np.full((int(frame.max()) + 1, slots.size, POSE_NUMBERS), np.nan)
    for column, number in _POSES.items():
        poses[frame, vehicle, number] = columns[column]
    poses = poses[first : last + 1]
    odd = straight_road(
        lanes=lanes, lane_width=lane_width, vehicles=slots.size, seconds=seconds, fastest=fastest,
        av_size=(float(length[0]), float(width[0])), start=float(poses[0, 0, X]),
    )  # fmt: skip
    for at in range(slots.size):
        poses[:, at, LATERAL_SPEED] = rates(poses[:, at, Y])
        if jumps(poses[:, at]).any():
            raise DataError(f"{name}: slot {slots[at]} is not where its speed takes it.")
    there = np.isfinite(poses[:, :, X]).any(axis=0)
    notes = [f"slot {gone} is left out: it is not there while the AV is." for gone in slots[~there]]
    for at in np.flatnonzero(there & (kind < 0)).tolist():
        gap = gaps(poses[:, 0], (length[0], width[0]), poses[:, at], (length[at], width[at]))
        over = in_lanes(poses[:, at], (length[at], width[at]), lanes * lane_width)
        when, near = nearest(gap, over)
        called = f'slot {slots[at]}, of class "{columns["class"][vehicle == at][0][:20]}",'
        if near:
            raise DataError(f"{name}: {called} cannot be held and is in the AV's way; {within(gap, when)}.")
        notes.append(f"{called} is left out: it is none that can be driven; {within(gap, when)}.")
    there &= kind >= 0
    notes += [ONE_LANE] * (lanes == 1)
    stem = safe_name(str(about.get("name") or Path(name).stem))
    facts: dict[str, Fact] = {
        str(key): value
        for key, value in about.get("facts", {}).items()
        if value is None or isinstance(value, (bool, int, float, str))
    }
    return MovingCase(
        stem, odd, kind[there], length[there], width[there], poses[:, there], facts, tuple(notes),
        tuple(f"slot {one}" for one in slots[there]),
    )  # fmt: skip


def _check_ways(name: str, columns: dict[str, NDArray[Any]]) -> None:
    """Refuse vehicles that go away and come back, or move faster than anything on a road."""
    order = np.lexsort((columns["frame"], columns["slot"]))
    slot, frame = columns["slot"][order], columns["frame"][order]
    is_same = np.diff(slot) == 0
    away = is_same & (np.diff(frame) > 1)
    if away.any():
        at = int(away.argmax())
        raise DataError(
            f"{name}: slot {slot[at]} has no row for frame {frame[at] + 1}, but for later ones; one that comes back is "
            "another vehicle and needs a slot of its own."
        )
    for column in ("x_m", "y_m"):
        far = is_same & (np.abs(np.diff(columns[column][order])) > _FARTHEST_M)
        if far.any():
            at = int(far.argmax())
            raise DataError(
                f"{name}: {column} of slot {slot[at]} jumps by more than {_FARTHEST_M:g} m after frame {frame[at]}."
            )


def _road_of(name: str, about: dict[str, Any]) -> tuple[int, float]:
    """Read lanes and lane width [m]."""
    road = about.get("road")
    if about.get("version", _VERSION) != _VERSION:
        _fault(name, f"it is of version {about['version']!r}; {_VERSION} is read. Install a newer cornerforge")
    if not isinstance(road, dict) or not isinstance(about.get("facts", {}), dict):
        _fault(
            name,
            f"the road is not given; {_facts_file(Path(name)).name} beside a CSV file holds it, as "
            '{"road": {"lanes": 3, "lane_width_m": 3.5}}',
        )
    lanes, width = road.get("lanes"), road.get("lane_width_m")
    if type(lanes) is not int or not isinstance(width, (int, float)):
        _fault(name, f"the road is {json.dumps(road)[:80]}; it needs lanes, a whole number, and lane_width_m")
    return lanes, float(width)


def _bodies(
    name: str, columns: dict[str, NDArray[Any]], vehicle: NDArray[np.int64]
) -> tuple[NDArray[np.int8], NDArray[np.float64], NDArray[np.float64]]:
    """Find class, length and width of each vehicle, which must not change; class -1: none of ours."""
    codes = {user.name: code for code, user in enumerate(CLASSES)}
    of_av = columns["class"][columns["slot"] == 0]
    unknown = set(of_av.tolist()) - set(codes)
    if unknown:
        raise DataError(f'{name}: class "{min(unknown)[:20]}" of slot 0, the AV, is none of {", ".join(codes)}.')
    kinds = np.array([codes.get(kind, -1) for kind in columns["class"].tolist()], dtype=np.int8)
    _, first = np.unique(vehicle, return_index=True)
    given = kinds, columns["length_m"], columns["width_m"]
    for what, values in zip(("class", "length_m", "width_m"), given, strict=True):
        changed = values != values[first][vehicle]
        if changed.any():
            row = int(changed.argmax())
            raise DataError(f"{name}: {what} of slot {columns['slot'][row]} changes in row {row + 1}.")
    return kinds[first], columns["length_m"][first], columns["width_m"][first]
