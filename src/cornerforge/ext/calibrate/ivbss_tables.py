"""The published tables: rows of probabilities, checked and scaled, and lane changes, reduced to our product form.

The lane-change tables hold P(change) by speed and the states to two neighbours at a time: leader (no adjacent vehicle),
leader and adjacent leader, leader and adjacent follower, both adjacent ones. Our model is a product (`NddModel`):
base(speed) desire(leader) accept_lead(adjacent leader) accept_rear(adjacent follower). The reduction keeps the tables'
totals and loses all that is not a product; `misfit` says how much:

- base and desire: the product nearest (least Kullback-Leibler divergence) to the first table, so that the total chance
  is kept for each speed and each state. Only their product has a meaning; desire is scaled to the mean of the base
  model's desire over the same states.
- each acceptance: the changes in its table for a state of the neighbour, divided by the changes that base and desire
  give in the same cells; at most 1.
- the table with both adjacent vehicles holds no state of the leader and is only compared with the product.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError
from cornerforge.ext.calibrate.ivbss_files import Coordinates
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel

__all__ = ["LAST_AXIS", "Cells", "cells_of", "checked_cumulative", "checked_rows", "reduce_lane_changes", "table_shape"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

EXACT = 1e-6
"""A row with a sum this near to 1 is used unchanged."""
TOLERANCE = 0.01
"""A row with a sum this near to 1 is divided by the sum; any other row is refused: it holds no probabilities."""
_NOISE = 1e-9
"""Negative numbers up to this size are rounding errors and count as 0."""
LAST_AXIS = (2, 3)
"""Lengths of the last axis: (change to the side, keep), or (left, keep, right); our model is the mean of both sides."""
STATE_SHAPE = (GAPS.size, RANGE_RATES.size)
_STATES = GAPS.size * RANGE_RATES.size
_ROUNDS = 500
_STILL = 1e-12


def _check_numbers(name: str, values: Floats) -> None:
    """Refuse NaN, infinite and negative numbers (beyond rounding of 1e-9) in `values`, any shape."""
    odd = ~np.isfinite(values)
    below = values < -_NOISE
    if odd.any() or below.any():
        place = [int(i) for i in np.argwhere(odd | below)[0]]
        raise FileFormatError(
            f"{name} holds {int(odd.sum())} NaN or infinite and {int(below.sum())} negative number(s), the first at "
            f"{place}; mend the file."
        )


def checked_rows(name: str, table: Floats) -> tuple[Floats, Bools, dict[str, int]]:
    """Check rows of probabilities, shape (*d, k), and scale them to sum 1.

    Returns:
        The rows (an empty one stays 0), which rows hold data, shape (*d), and how many there are: all `rows`, `empty`
        ones, which are filled from the base model, and those `renormalised`, divided by their sum.

    Raises:
        FileFormatError: A number is no probability, or a sum is farther than `TOLERANCE` from 1.
    """
    _check_numbers(name, table)
    rows = np.maximum(table, 0.0)
    total = rows.sum(axis=-1)
    known = total > 0.0
    off = known & (np.abs(total - 1.0) > EXACT)
    far = known & (np.abs(total - 1.0) > TOLERANCE)
    if far.any():
        place = tuple(int(i) for i in np.argwhere(far)[0])
        raise FileFormatError(
            f"{name}: {int(far.sum())} of {known.size} rows do not sum to 1 within {TOLERANCE:g}, the first at "
            f"{list(place)} with {total[place]:.6g}; divide each row by its sum if it holds counts."
        )
    rows = np.where(off[..., None], rows / np.where(off, total, 1.0)[..., None], rows)
    return rows, known, {"rows": known.size, "empty": int((~known).sum()), "renormalised": int(off.sum())}


def checked_cumulative(name: str, table: Floats) -> tuple[Floats, Bools, dict[str, int]]:
    """Check rows of cumulative probabilities, shape (n, k), and return probabilities; a row of NaN is empty.

    Returns:
        As `checked_rows`.

    Raises:
        FileFormatError: A number is no probability, or a row falls or does not end at 1.
    """
    empty = np.asarray(np.isnan(table).all(axis=-1))
    table = np.where(empty[:, None], 0.0, table)
    _check_numbers(name, table)
    falls = np.diff(table, axis=-1) < -_NOISE
    if falls.any():
        place = [int(i) for i in np.argwhere(falls)[0]]
        raise FileFormatError(
            f"{name}: cumulative probabilities fall {int(falls.sum())} time(s), first after {place}; it is no "
            "cumulative distribution."
        )
    return checked_rows(name, np.maximum(np.diff(table, axis=-1, prepend=0.0), 0.0))


def table_shape(role: str) -> tuple[int, ...]:
    """Return all axes of a lane-change table but the last: speed, then (gap, range rate) of one or two neighbours."""
    return (SPEEDS.size, *STATE_SHAPE) if role == "lc_alone" else (SPEEDS.size, *STATE_SHAPE, *STATE_SHAPE)


class Cells(NamedTuple):
    """The states of a table that hold data.

    Attributes:
        speed: Index of the speed, shape (n,).
        first: Index gap * 19 + range rate of the first neighbour in the table, shape (n,).
        second: Index of the second neighbour, in the same form; 0 where the table has only one.
        change: Chance of a change to one given side, shape (n,).
        counts: `cells` with data out of `rows`, `renormalised`, and `unnormalised` (the sum differs from 1 by more than
            0.01; the chance of a change is then used unchanged, as in the released code).
    """

    speed: Ints
    first: Ints
    second: Ints
    change: Floats
    counts: Mapping[str, int]


def cells_of(name: str, table: Coordinates) -> Cells:
    """Check a lane-change table and return its cells.

    Raises:
        FileFormatError: NaN, negative numbers, or chances above 1.
    """
    _check_numbers(name, table.value)
    value = np.maximum(table.value, 0.0)
    place, owner = np.unique(table.place, return_inverse=True)
    sides = (0,) if table.shape[-1] == 2 else (0, 2)
    total = _sums(owner, value, place.size)
    change = _sums(owner, np.where(np.isin(table.last, sides), value, 0.0), place.size) / len(sides)
    known = total > 0.0
    place, total, change = place[known], total[known], change[known]
    off = np.abs(total - 1.0) > EXACT
    near = off & (np.abs(total - 1.0) <= TOLERANCE)
    change = np.where(near, change / total, change)
    above = change > 1.0 + EXACT
    if above.any():
        at = np.unravel_index(int(place[np.argmax(above)]), table.shape[:-1])
        raise FileFormatError(
            f"{name}: {int(above.sum())} chances of a lane change are above 1, the first at {[int(i) for i in at]} "
            f"with {change[np.argmax(above)]:.6g}; divide each row by its sum if it holds counts."
        )
    two = len(table.shape) == 6
    state, second = np.divmod(place, _STATES) if two else (place, np.zeros_like(place))
    counts = {
        "rows": int(np.prod(table.shape[:-1])),
        "cells": int(place.size),
        "renormalised": int(near.sum()),
        "unnormalised": int((off & ~near).sum()),
    }
    return Cells(state // _STATES, state % _STATES, second, np.minimum(change, 1.0), counts)


def _sums(owner: Ints, value: Floats, n: int) -> Floats:
    """Sum `value` for each owner 0..n-1, shape (n,)."""
    return np.bincount(owner, weights=value, minlength=n).astype(np.float64)


def reduce_lane_changes(base: NddModel, tables: Mapping[str, Cells]) -> tuple[NddModel, dict[str, dict[str, float]]]:
    """Make a model with lane changes from the tables where they hold data, else from `base`.

    Args:
        base: Model to start from.
        tables: Cells of `lc_alone`, `lc_lead`, `lc_rear` and `lc_both`; any may be missing.

    Returns:
        The model, and for each table what was filled from `base`, clipped, and the misfit of the product: sum of
        |table - product| over the sum of the table.
    """
    found: dict[str, dict[str, float]] = {}
    model = base
    if "lc_alone" in tables:
        model, found["lc_alone"] = _with_wish(model, tables["lc_alone"])
    for role, name in (("lc_lead", "lc_accept_lead"), ("lc_rear", "lc_accept_rear")):
        if role in tables:
            changed: dict[str, Any] = {}
            changed[name], found[role] = _acceptance(model, tables[role], getattr(base, name))
            model = replace(model, **changed)
    if "lc_both" in tables:
        cells = tables["lc_both"]
        product = _flat(model.lc_accept_lead)[cells.first] * _flat(model.lc_accept_rear)[cells.second]
        product *= model.lc_base.astype(np.float64)[cells.speed]
        scale = cells.change.sum() / product.sum() if product.sum() > 0.0 else 0.0
        found["lc_both"] = {"misfit": _misfit(cells.change, scale * product)}
    return model, found


def _flat(table: NDArray[np.float32]) -> Floats:
    return table.astype(np.float64).reshape(-1)


def _misfit(table: Floats, product: Floats) -> float:
    total = float(table.sum())
    return float(np.abs(table - product).sum()) / total if total > 0.0 else 0.0


def _with_wish(model: NddModel, cells: Cells) -> tuple[NddModel, dict[str, float]]:
    """Fit base and desire by alternating updates, which keep the sums over each speed and each state."""
    chance, known = np.zeros((SPEEDS.size, _STATES)), np.zeros((SPEEDS.size, _STATES))
    chance[cells.speed, cells.first] = cells.change
    known[cells.speed, cells.first] = 1.0
    by_speed, by_state = np.ones(SPEEDS.size), np.ones(_STATES)
    for _ in range(_ROUNDS):
        before = by_speed
        by_speed = _ratio(chance.sum(axis=1), known @ by_state)
        by_state = _ratio(chance.sum(axis=0), known.T @ by_speed)
        if np.allclose(by_speed, before, rtol=_STILL, atol=0.0):
            break
    seen_speed, seen_state = known.any(axis=1), known.any(axis=0)
    own = _flat(model.lc_desire)
    total = float(by_state[seen_state].sum())
    scale = float(own[seen_state].sum()) / total if total > 0.0 else 1.0
    desire = np.where(seen_state, by_state * scale, own) if total > 0.0 else own
    base = np.where(seen_speed, by_speed / scale, model.lc_base)
    product = base[cells.speed] * desire[cells.first]
    found: dict[str, float] = {
        "speeds_filled": int((~seen_speed).sum()),
        "states_filled": int((~seen_state).sum()),
        "clipped": int((base > 1.0).sum()),
        "misfit": _misfit(cells.change, product),
    }
    changed = replace(
        model,
        lc_base=np.minimum(base, 1.0).astype(np.float32),
        lc_desire=desire.reshape(STATE_SHAPE).astype(np.float32),
    )
    return changed, found


def _ratio(above: Floats, below: Floats) -> Floats:
    """Divide two arrays of one shape; 0 where `below` is 0."""
    return np.divide(above, below, out=np.zeros_like(above), where=below > 0.0)


def _acceptance(
    model: NddModel, cells: Cells, own: NDArray[np.float32]
) -> tuple[NDArray[np.float32], dict[str, float]]:
    wish = model.lc_base.astype(np.float64)[cells.speed] * _flat(model.lc_desire)[cells.first]
    wished, done = _sums(cells.second, wish, _STATES), _sums(cells.second, cells.change, _STATES)
    seen = wished > 0.0
    accept = np.where(seen, _ratio(done, wished), _flat(own))
    clipped = int((accept > 1.0 + EXACT).sum())
    accept = np.minimum(accept, 1.0)
    found: dict[str, float] = {
        "states_filled": int((~seen).sum()),
        "clipped": clipped,
        "misfit": _misfit(cells.change, wish * accept[cells.second]),
    }
    return accept.reshape(STATE_SHAPE).astype(np.float32), found
