"""Tracks of one vehicle each, and the direction in which each drives as a whole.

Recordings number their vehicles anew in each period, so that one name is often several vehicles. A leap from one of
them to the next is no motion: tracks are cut there before anything is summed over them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.layouts import Layout
from cornerforge.ext.calibrate.row_checks import SPEED_RANGE, drivers, speed_note
from cornerforge.ext.calibrate.tables import Table

__all__ = ["cut_tracks", "direction_of_travel", "position_along"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_LONGEST_GAP = 5.0
"""A name that comes back later than this is another vehicle [s]."""
_OTHER_LENGTH = 1.0
"""A name whose length changes by more than this from row to row is another vehicle [m]."""
_MOVES = 5.0
"""A track that ends nearer to its begin has no direction of its own [m]; none drives farther back from row to row."""
_UNDER_WAY = 2.0
"""Slower motion is noise of a standing vehicle [m/s]."""
_ASIDE, _FASTEST_ASIDE = 5.0, 4.0
"""No vehicle is farther aside from row to row [m], more than a lane, if it also goes there faster [m/s]."""
_BOTH_WAYS = 0.2
"""A lane number belongs to both directions where at least this share of its rows goes against the others."""


def cut_tracks(table: Table, layout: Layout) -> list[str]:
    """Number the parts of tracks that are of one vehicle each (`Table.part`), and take out single rows that are astray.

    Args:
        table: Table that is changed; rows are sorted by vehicle and time.
        layout: What its columns mean.

    Returns:
        Notes: speeds that are not plausible, and how many tracks were cut, and where.
    """
    notes = []
    if "position" in table.numbers:
        position, _ = position_along(table, layout)
        same = np.diff(drivers(table)) == 0
        column = layout.numbers["position"][0]
        notes += speed_note(table.name, column, np.diff(position)[same] / np.diff(table.numbers["time"])[same])
        astray = _astray(table, position, _across(table, layout))
        table.drop(f"{column} jumps (faster than {SPEED_RANGE[1]:g} m/s)", astray)
    time, same = table.numbers["time"], np.diff(drivers(table)) == 0
    cuts = np.diff(time) > _LONGEST_GAP
    if "position" in table.numbers:
        position, _ = position_along(table, layout)
        cuts |= _leaps(time, position, _across(table, layout)) | _turns(time, position, same)
    if "length" in table.numbers:
        cuts |= np.abs(np.diff(table.numbers["length"])) > _OTHER_LENGTH
    if "kind" in table.texts:
        cuts |= np.diff(table.texts["kind"]) != 0
    cuts &= same
    table.part = np.concatenate([[0], np.cumsum(cuts)])
    if not cuts.any():
        return notes
    hint = " Are times in other units?" if cuts.mean() > 0.5 else ""
    return [
        *notes,
        f"{table.name}: tracks were cut at {int(cuts.sum())} place(s) (first at line "
        f"{int(table.line[1:][cuts].min())}), where a name goes on after more than {_LONGEST_GAP:g} s, farther away "
        f"than a vehicle drives, or with another size or class; each part counts as a vehicle.{hint}",
    ]  # fmt: skip


def _leaps(time: Floats, position: Floats, across: Floats, apart: int = 1) -> Bools:
    """Tell between which rows, so many apart, a vehicle cannot have driven, shape (n - apart,)."""
    seconds, far, aside = (np.abs(values[apart:] - values[:-apart]) for values in (time, position, across))
    return np.asarray((far > SPEED_RANGE[1] * seconds) | (aside > np.maximum(_ASIDE, _FASTEST_ASIDE * seconds)))


def _across(table: Table, layout: Layout) -> Floats:
    """Position across the road [m], shape (n,); all 0 where it was not read."""
    along, swapped = position_along(table, layout)
    numbers = table.numbers
    return numbers["position"] if swapped else numbers.get("lateral", numbers.get("across", np.zeros_like(along)))


def _turns(time: Floats, position: Floats, same: Bools) -> Bools:
    """Tell between which rows the position falls back against the motion up to there, shape (n - 1,)."""
    step = np.diff(position)
    before = np.concatenate([[0.0], np.where(same, step, 0.0)[:-1]])
    seconds = np.concatenate([[1.0], np.diff(time)[:-1]])
    return np.asarray((np.abs(step) > _MOVES) & (step * before < 0.0) & (np.abs(before) > _UNDER_WAY * seconds))


def _astray(table: Table, position: Floats, across: Floats) -> Bools:
    """Mark single rows off a track that goes on without them, shape (n,)."""
    driver, time = drivers(table), table.numbers["time"]
    astray = np.zeros(position.size, dtype=np.bool_)
    if position.size < 3:
        return astray
    leap = _leaps(time, position, across)
    astray[1:-1] = leap[:-1] & leap[1:] & ~_leaps(time, position, across, 2) & (driver[2:] == driver[:-2])
    return astray


def position_along(table: Table, layout: Layout) -> tuple[Floats, bool]:
    """Return the position on the longer axis [m], shape (n,), and whether that is the one called `across`."""
    position = table.numbers["position"]
    if layout.corner:
        position = position + table.numbers["length"] / 2.0
    across = table.numbers.get("across", position)
    swapped = bool(np.ptp(across) > np.ptp(position))
    return (across if swapped else position), swapped


def direction_of_travel(table: Table, position: Floats) -> Bools:
    """Mark the rows of vehicles that drive towards growing positions, shape (n,); all where the file has no lanes.

    A lane's direction is that of the tracks in it, each as a whole; a vehicle's, that of most lanes it is in. Lane
    numbers that serve both directions say nothing of a vehicle that moves: its own way counts.
    """
    if "lane" not in table.numbers:
        return np.ones(position.size, dtype=np.bool_)
    driver = drivers(table)
    first = np.flatnonzero(np.diff(driver, prepend=-1))
    net = position[np.append(first[1:], driver.size) - 1] - position[first]
    lane = np.unique(table.numbers["lane"], return_inverse=True)[1].reshape(-1)
    own = np.where(np.abs(net) >= _MOVES, np.sign(net), 0.0)
    ahead, back = (np.bincount(lane, weights=own[driver] == sign) for sign in (1.0, -1.0))
    way = np.where(ahead >= back, 1.0, -1.0)
    both = np.minimum(ahead, back) >= np.maximum(_BOTH_WAYS * (ahead + back), 1.0)
    way_of_row = np.where(both[lane] & (own[driver] != 0.0), own[driver], way[lane])
    return np.asarray((np.bincount(driver, weights=way_of_row) >= 0.0)[driver])
