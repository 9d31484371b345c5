"""Checks of trajectory rows: unusable rows are left out, counted and named; oddities of a file are noted.

Rows are left out for: empty names, no number, values out of range, overlapping vehicles, the same vehicle twice at one
time. Notes are about the whole file: rows out of order (they are sorted), and units that look like feet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.layouts import Layout
from cornerforge.ext.calibrate.tables import Table

__all__ = ["GAP_RANGE", "LANE_LIMIT", "MEAN_LENGTH", "SPEED_RANGE", "check_rows", "drivers", "speed_note", "time_step"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

GAP_RANGE = (1.0, 500.0)
"""Gaps outside this are measuring errors [m]."""
MEAN_LENGTH = 4.9
"""Length of a vehicle where the file has none [m]: NGSIM I-80."""
SPEED_RANGE = (0.0, 70.0)
"""Speeds outside this are measuring errors [m/s]."""
LANE_LIMIT = 999
IMPLAUSIBLE_SPEED = 60.0
"""Limit of the 95th percentile of speeds [m/s]; above it the file is in other units than it says."""
PLAUSIBLE_LENGTH = (2.5, 10.0)
"""The median vehicle length is within this [m]: cars have 4 to 5, which in feet are 13 to 16."""
_LENGTH_RANGE = (1.0, 40.0)
_WIDTH_RANGE = (0.3, 4.0)
_STEP_TOLERANCE = 0.1
"""Two time steps that differ by less than this share are the same."""
_POSITION_LIMIT = 1e7
_TIME_LIMIT = 1e10


def check_rows(table: Table, layout: Layout) -> list[str]:
    """Take out and name the rows that cannot be used; sort the others by vehicle and time.

    Args:
        table: Table that is changed.
        layout: What its columns mean.

    Returns:
        Notes on the file as a whole, one or two plain sentences each.
    """
    for name in list(table.texts):
        if name != "leader" or layout.kind == "pairs":  # a track without a leader names none
            table.drop(f"{layout.texts[name]} is empty", table.texts[name] < 0)
    for name in table.numbers:
        missing = ~np.isfinite(table.numbers[name])
        if name == "spacing":  # only a row with a leader has a spacing
            missing &= table.texts["leader"] >= 0
        table.drop(f"{layout.numbers[name][0]} is not a number", missing)
    notes = _unit_notes(table, layout)  # before values out of range, such as all speeds in feet, are gone
    _check_ranges(table, layout)
    _drop_twins(table, layout)
    notes += _sort(table, layout)
    _drop_other_steps(table, layout)
    return notes


def _check_ranges(table: Table, layout: Layout) -> None:
    low_gap, high_gap = GAP_RANGE
    ranges = {
        "speed": (*SPEED_RANGE, "m/s"),
        "lead_speed": (*SPEED_RANGE, "m/s"),
        "length": (*_LENGTH_RANGE, "m"),
        "width": (*_WIDTH_RANGE, "m"),
        "gap": (low_gap, high_gap, "m"),
        "spacing": (low_gap + MEAN_LENGTH, high_gap + MEAN_LENGTH, "m"),
        "position": (-_POSITION_LIMIT, _POSITION_LIMIT, "m"),
        "across": (-_POSITION_LIMIT, _POSITION_LIMIT, "m"),
        "lateral": (-_POSITION_LIMIT, _POSITION_LIMIT, "m"),
        "time": (-_TIME_LIMIT, _TIME_LIMIT, "s"),
        "lane": (0.0, LANE_LIMIT, ""),
    }
    if "gap" in table.numbers:
        table.drop(f"{layout.numbers['gap'][0]} below 0 m: the vehicles overlap", table.numbers["gap"] < 0.0)
    for name, (low, high, unit) in ranges.items():
        if name in table.numbers:
            values = table.numbers[name]  # NaN passes: a spacing where there is no leader
            outside = (values < low) | (values > high)
            table.drop(f"{layout.numbers[name][0]} outside {low:g} to {high:g} {unit}".rstrip(), outside)


def drivers(table: Table) -> Ints:
    """A number for each vehicle of each recording (and leader, in pairs; and part of a track), shape (n,)."""
    codes = [table.texts[name] for name in ("recording", "vehicle") if name in table.texts]
    if "lead_speed" in table.numbers:
        codes.append(table.texts["leader"])
    codes.append(table.part)
    number = np.zeros(table.line.size, dtype=np.int64)
    for column in codes:
        number = number * (int(column.max(initial=0)) + 1) + column
    return np.unique(number, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _drop_twins(table: Table, layout: Layout) -> None:
    """Keep the first of equal rows of one vehicle and time; keep none of rows that contradict each other."""
    driver, time = drivers(table), table.numbers["time"]
    order = np.lexsort((time, driver))
    twin = np.zeros(order.size, dtype=bool)
    twin[1:] = (np.diff(driver[order]) == 0) & (np.diff(time[order]) == 0.0)
    if not twin.any():
        return
    moment = np.cumsum(~twin) - 1
    contradicts = np.zeros(int(moment[-1]) + 1, dtype=bool)
    contradicts[moment[twin & ~_like_the_row_before(table, order)]] = True
    bad = np.zeros((2, order.size), dtype=bool)
    bad[0, order] = contradicts[moment]
    bad[1, order] = twin & ~contradicts[moment]
    column = layout.numbers["time"][0]
    table.drop(f"{column} twice for one vehicle, with different values", bad[0])
    table.drop(f"{column} twice for one vehicle", bad[1][~bad[0]])


def _like_the_row_before(table: Table, order: Ints) -> Bools:
    """Tell whether a row equals the previous row in `order`, shape (n,); False for the first."""
    same = np.ones(order.size, dtype=bool)
    same[:1] = False
    for numbers in table.numbers.values():
        value = numbers[order]
        same[1:] &= (value[1:] == value[:-1]) | (np.isnan(value[1:]) & np.isnan(value[:-1]))
    for codes in table.texts.values():
        same[1:] &= np.diff(codes[order]) == 0
    return same


def _sort(table: Table, layout: Layout) -> list[str]:
    """Sort by vehicle and time; note how much of it was needed where the layout is usually in order."""
    driver, time = drivers(table), table.numbers["time"]
    in_file = np.argsort(driver, kind="stable")
    back = in_file[1:][(np.diff(driver[in_file]) == 0) & (np.diff(time[in_file]) < 0.0)]
    notes = []
    if layout.ordered and back.size:
        notes.append(
            f"{table.name}: {back.size} row(s) stand after a later one of the same vehicle (first at line "
            f"{int(table.line[back].min())}); the rows were sorted by {layout.numbers['time'][0]}."
        )
    table.take(np.lexsort((time, driver)))
    return notes


def _drop_other_steps(table: Table, layout: Layout) -> None:
    """Leave out the vehicles with another time step than the file; rows are sorted."""
    driver, time = drivers(table), table.numbers["time"]
    same = np.diff(driver) == 0
    steps, owner = np.diff(time)[same], driver[1:][same]
    usual = time_step(driver, time)
    order = np.lexsort((steps, owner))
    number, first, count = np.unique(owner[order], return_index=True, return_counts=True)
    median = steps[order][first + count // 2]  # the upper one of two
    other = (count > 1) & (np.abs(median / usual - 1.0) > _STEP_TOLERANCE)
    column = layout.numbers["time"][0]
    table.drop(
        f"{column} has another step than the file's {usual:g} s (give files of one frame rate each)",
        np.isin(driver, number[other]),
    )


def time_step(driver: Ints, time: Floats) -> float:
    """Return the usual time from a row to the next of the same vehicle [s]; 1 without any.

    Args:
        driver: Shape (n,), sorted.
        time: Shape (n,), rising within a driver [s].
    """
    steps = np.diff(time)[np.diff(driver) == 0]
    return float(np.median(steps)) if steps.size else 1.0


def _unit_notes(table: Table, layout: Layout) -> list[str]:
    """Notes on speeds and lengths that are not plausible in the units that the layout says."""
    notes = [
        note
        for name in ("speed", "lead_speed")
        if name in table.numbers
        for note in speed_note(table.name, layout.numbers[name][0], table.numbers[name])
    ]
    if "length" not in table.numbers or not table.line.size:
        return notes
    column, factor = layout.numbers["length"]
    middle = float(np.median(table.numbers["length"]))
    low, high = PLAUSIBLE_LENGTH
    if middle > high and factor == 1.0:
        notes.append(
            f"{table.name}: the median of {column} is {middle:.1f} m, where cars have 4 to 5: is the file in feet? "
            "Convert it to metres first (1 ft = 0.3048 m)."
        )
    if middle < low and factor != 1.0:
        notes.append(
            f"{table.name}: the median of {column} is {middle / factor:.1f} ft, where cars have 13 to 16: is the file "
            "in metres already? Convert it back to feet, or rename its columns to those of format tracks."
        )
    return notes


def speed_note(file: str, column: str, speed: Floats) -> list[str]:
    """A note if the 95th percentile of `speed`, shape (n,) [m/s], is above 60 m/s; none for an empty array."""
    if not speed.size:
        return []
    high = float(np.percentile(np.abs(speed), 95.0))
    if high <= IMPLAUSIBLE_SPEED:
        return []
    return [
        f"{file}: 5 % of the speeds from {column} are above {high:.0f} m/s, which is not plausible: is the file in "
        "feet, or are times in another unit? Convert it to metres and seconds first (1 ft = 0.3048 m)."
    ]
