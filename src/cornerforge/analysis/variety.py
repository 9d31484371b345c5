"""Variety of a set of cases: how they spread over cells of type x side x striker (or avoidability), and the entropy.

A library from one greedy policy holds few kinds of crash; the yield does not show that, variety does
(docs/adr/0012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.analysis.contact import FRONT, REAR, find_contact
from cornerforge.analysis.crash_types import CRASH_TYPES, STRIKERS, classify_crashes
from cornerforge.errors import InputError

__all__ = ["SIDES", "Variety", "crash_cells", "unseen_chance", "variety_of"]

SIDES = ("front", "rear", "left", "right")
"""Part of the AV that was touched first."""
_AVOIDABLE = ("avoidable", "unavoidable")
_RESAMPLES = 1000
_Z95 = 1.959963984540054


@dataclass(frozen=True)
class Variety:
    """How cases spread over cells.

    Attributes:
        cases: Number of cases, at least 1.
        cells: Name of each filled cell, such as "sideswipe | left | bv", and its cases; the fullest first.
        possible: Number of all cells, filled or not; some of them cannot happen.
        entropy: -sum p ln p over the cells' shares [nats]; 0 when all cases fall into one cell.
        entropy_interval95: Its 95 % interval, by the basic bootstrap over cases (1000 resamples), within [0, ln
            possible].
        effective: exp(entropy): the number of equally full cells with the same entropy.
        unseen: Good-Turing estimate of the chance that the next case falls into a cell not filled yet.
        unseen_interval95: Its 95 % interval (see `unseen_chance`).
    """

    cases: int
    cells: dict[str, int]
    possible: int
    entropy: float
    entropy_interval95: tuple[float, float]
    effective: float
    unseen: float
    unseen_interval95: tuple[float, float]

    def to_json(self) -> dict[str, object]:
        """Plain JSON values, with the number of filled cells under `filled`."""
        return {
            "cases": self.cases,
            "filled": len(self.cells),
            "possible": self.possible,
            "entropy": self.entropy,
            "entropy_interval95": list(self.entropy_interval95),
            "effective": self.effective,
            "unseen": self.unseen,
            "unseen_interval95": list(self.unseen_interval95),
            "cells": dict(self.cells),
        }


def crash_cells(
    pose: NDArray[np.floating],
    *,
    avoidable: NDArray[np.bool_] | None = None,
    vehicle_length: float | NDArray[np.floating] = 5.0,
    vehicle_width: float | NDArray[np.floating] = 2.0,
) -> tuple[NDArray[np.intp], tuple[str, ...]]:
    """The cell of each crash: its type, the side of the AV that was touched, and the striker (or avoidability).

    Args:
        pose: [x m, y m, speed m/s, heading rad] of the AV (0) and the crash partner (1) at first contact, shape
            (S, 2, 4).
        avoidable: Whether the AV could have avoided it, shape (S,); it takes the place of the striker.
        vehicle_length, vehicle_width: Size of the vehicles [m], one number or shape (S, 2).

    Returns:
        Index of each crash's cell, shape (S,), and the names of all cells.

    Raises:
        InputError: A shape is wrong, a value is not finite, or two boxes do not touch.
    """
    types = classify_crashes(pose, vehicle_length, vehicle_width)
    sector = find_contact(pose, vehicle_length, vehicle_width).av_sector
    is_left = pose[:, 1, 1] >= pose[:, 0, 1]
    side = np.where(sector == FRONT, 0, np.where(sector == REAR, 1, np.where(is_left, 2, 3)))
    labels: tuple[str, ...] = STRIKERS
    label = types.striker.astype(np.intp)
    if avoidable is not None:
        if avoidable.shape != (len(pose),):
            raise InputError(f"avoidable has shape {avoidable.shape}; allowed: ({len(pose)},), one for each crash.")
        labels = _AVOIDABLE
        label = np.where(avoidable, 0, 1)
    names = tuple(" | ".join(cell) for cell in product(CRASH_TYPES.values(), SIDES, labels))
    index = ((types.code.astype(np.intp) - 1) * len(SIDES) + side) * len(labels) + label
    return index, names


def unseen_chance(counts: NDArray[np.integer]) -> tuple[float, tuple[float, float]]:
    """Chance that the next case is of a kind not seen yet, and its 95 % interval.

    Args:
        counts: Cases of each kind, at least 0, one case in all at least.

    Returns:
        Good-Turing's f1 / n, where f1 is the number of kinds seen once; the interval has the half-width
        1.96 sqrt(f1 (1 - f1 / n) + 2 f2) / n, its end is at least 1 - 0.05^(1/n) (about 3 / n), within [0, 1].

    Raises:
        InputError: There is no case.

    Source: Good (1953); interval: Esty (1983).

    >>> unseen_chance(np.array([90, 9, 1]))[0]
    0.01
    """
    n = int(counts.sum())
    if n < 1:
        raise InputError("There are no cases, so nothing can be said of kinds not seen yet; generate some first.")
    once, twice = int((counts == 1).sum()), int((counts == 2).sum())
    share = once / n
    half = _Z95 * math.sqrt(once * (1.0 - share) + 2.0 * twice) / n
    least = 1.0 - 0.05 ** (1.0 / n)
    return share, (max(0.0, share - half), min(1.0, max(share + half, least)))


def variety_of(cell: NDArray[np.integer], names: tuple[str, ...], *, seed: int = 0) -> Variety:
    """Measure how varied cases are.

    Args:
        cell: Index of each case's cell, 0 to len(names) - 1, shape (S,), S at least 1.
        names: Names of all cells.
        seed: Seed of the bootstrap, 0 to 2^32 - 1.

    Raises:
        InputError: There are no cases, or an index is out of range.

    >>> found = variety_of(np.array([0, 0, 2, 2]), ("a", "b", "c"))
    >>> found.cells, round(found.effective, 3)
    ({'a': 2, 'c': 2}, 2.0)
    """
    check_integer("seed", seed, low=0, high=2**32 - 1)
    if cell.size == 0:
        raise InputError("There are no cases, so there is no variety; generate some first.")
    if cell.min() < 0 or cell.max() >= len(names):
        raise InputError(f"cell index {cell.min()} to {cell.max()}; allowed: 0 to {len(names) - 1}.")
    counts = np.bincount(cell, minlength=len(names))
    entropy = float(_entropies(counts[None])[0])
    draws = np.random.default_rng(seed).multinomial(cell.size, counts / cell.size, size=_RESAMPLES)
    low, high = np.quantile(_entropies(draws), [0.025, 0.975])
    most = math.log(len(names))
    unseen, interval = unseen_chance(counts)
    order = np.argsort(-counts, kind="stable")
    return Variety(
        cases=int(cell.size),
        cells={names[k]: int(counts[k]) for k in order if counts[k]},
        possible=len(names),
        entropy=entropy,
        # A resample is as much less varied than the sample as the sample is than the truth: hence reflected.
        entropy_interval95=(
            min(most, max(0.0, 2.0 * entropy - float(high))),
            min(most, max(0.0, 2.0 * entropy - float(low))),
        ),
        effective=math.exp(entropy),
        unseen=unseen,
        unseen_interval95=interval,
    )


def _entropies(counts: NDArray[np.integer]) -> NDArray[np.float64]:
    """Entropy of each row of counts [nats]."""
    share = counts / counts.sum(axis=1, keepdims=True)
    logs = np.log(share, out=np.zeros_like(share), where=share > 0.0)
    return np.asarray(np.abs((share * logs).sum(axis=1)), np.float64)
