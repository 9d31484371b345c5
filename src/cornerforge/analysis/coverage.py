"""Coverage of a library: a grid of the kinds of crash, a discovery curve, the chance of a kind not seen yet."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.analysis.variety import unseen_chance
from cornerforge.errors import InputError

__all__ = ["SPEED_EDGES", "Coverage", "coverage_of", "discovery_curve"]

SPEED_EDGES = (0.0, 2.0, 5.0, 10.0)
"""Lower ends of the bands of impact speed [m/s]; the last is open."""
_CURVE_POINTS = 20


@dataclass(frozen=True)
class Coverage:
    """The kinds of crash that a library covers.

    Attributes:
        axes: Name of each axis of the grid to its labels: crash type, avoidability (left out where it was not looked
            for), impact speed.
        counts: Cases in each cell, one axis each.
        empty: Names of the cells without a case, such as "angle | by braking | 2-5 m/s".
        curve: (m, 2): number of cases looked at, and kinds (filled cells) expected among them.
        unseen: Good-Turing's chance that the next case is of a kind not seen yet.
        unseen_interval95: Its 95 % interval.
        cases: Number of cases in the grid.
    """

    axes: dict[str, tuple[str, ...]]
    counts: NDArray[np.int64]
    empty: tuple[str, ...]
    curve: NDArray[np.float64]
    unseen: float
    unseen_interval95: tuple[float, float]
    cases: int

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values: the grid as filled cells by name, the curve as pairs."""
        names = _cell_names(self.axes)
        flat = self.counts.ravel()
        order = np.argsort(-flat, kind="stable")
        return {
            "cases": self.cases,
            "axes": {name: list(labels) for name, labels in self.axes.items()},
            "cells": {names[k]: int(flat[k]) for k in order if flat[k]},
            "empty": list(self.empty),
            "discovery_curve": self.curve.tolist(),
            "unseen_kind_chance": self.unseen,
            "unseen_kind_interval95": list(self.unseen_interval95),
        }


def _cell_names(axes: dict[str, tuple[str, ...]]) -> list[str]:
    return [" | ".join(labels) for labels in product(*axes.values())]


def _speed_labels() -> tuple[str, ...]:
    bands = [f"{low:g}-{high:g} m/s" for low, high in pairwise(SPEED_EDGES)]
    return (*bands, f"{SPEED_EDGES[-1]:g} m/s and more")


def coverage_of(
    crash_type: NDArray[np.integer],
    impact_speed: NDArray[np.floating],
    avoidability: NDArray[np.integer] | None = None,
    avoidability_labels: tuple[str, ...] = (),
) -> Coverage:
    """Sort cases into kinds, and name the kinds without a case.

    Head-on crashes cannot happen on a one-way road; their cells are left out of the grid unless one did.

    Args:
        crash_type: Codes of `CRASH_TYPES`, shape (S,), S at least 1.
        impact_speed: Length of the vehicles' relative velocity at contact [m/s], shape (S,), at least 0.
        avoidability: Index into `avoidability_labels` of each case, shape (S,); None where it was not looked for.
        avoidability_labels: Names.

    Raises:
        InputError: There is no case, or an argument is not as described.
    """
    n = len(crash_type)
    if n == 0:
        raise InputError("There are no cases, so nothing is covered; generate some first.")
    if impact_speed.shape != (n,) or not (np.isfinite(impact_speed).all() and (impact_speed >= 0.0).all()):
        raise InputError(f"impact_speed has shape {impact_speed.shape}, or is negative or not finite; give one a case.")
    codes = np.array([code for code in CRASH_TYPES if code != 3 or (crash_type == code).any()])
    place = np.searchsorted(codes, crash_type)
    if (place >= len(codes)).any() or (codes[place] != crash_type).any():
        raise InputError(f"crash_type holds unknown codes; allowed: {', '.join(map(str, CRASH_TYPES))}.")
    axes: dict[str, tuple[str, ...]] = {"crash type": tuple(CRASH_TYPES[int(code)] for code in codes)}
    index: list[NDArray[np.integer]] = [place]
    if avoidability is not None:
        if avoidability.shape != (n,) or avoidability.min() < 0 or avoidability.max() >= len(avoidability_labels):
            raise InputError(f"avoidability must be one index below {len(avoidability_labels)} for each case.")
        axes["avoidability"] = tuple(avoidability_labels)
        index.append(avoidability)
    axes["impact speed"] = _speed_labels()
    index.append(np.searchsorted(np.array(SPEED_EDGES), impact_speed, side="right") - 1)
    shape = tuple(len(labels) for labels in axes.values())
    counts = np.bincount(np.ravel_multi_index(index, shape), minlength=int(np.prod(shape))).reshape(shape)
    names = _cell_names(axes)
    unseen, interval = unseen_chance(counts.ravel())
    return Coverage(
        axes=axes,
        counts=counts,
        empty=tuple(names[k] for k in np.flatnonzero(counts.ravel() == 0)),
        curve=discovery_curve(counts.ravel()),
        unseen=unseen,
        unseen_interval95=interval,
        cases=n,
    )


def discovery_curve(counts: NDArray[np.integer]) -> NDArray[np.float64]:
    """Give the number of kinds expected among m cases, over all orders of the cases (rarefaction).

    Args:
        counts: Cases of each kind, at least 0, one case in all at least.

    Returns:
        Shape (P, 2): m from 1 to all cases n, about evenly in its logarithm, and sum over kinds of
        1 - C(n - n_k, m) / C(n, m), which is exact; ends at (n, kinds seen).

    Source: Hurlbert (1971).

    >>> discovery_curve(np.array([2, 1, 0])).round(3).tolist()
    [[1.0, 1.0], [2.0, 1.667], [3.0, 2.0]]
    """
    from scipy.special import gammaln

    seen = counts[counts > 0].astype(np.float64)
    n = float(seen.sum())
    m = np.unique(np.rint(np.geomspace(1.0, n, _CURVE_POINTS)))
    missing = n - seen[:, None] - m  # cases of other kinds that are left when m of them are taken
    with np.errstate(invalid="ignore"):
        log_share = gammaln(n - seen[:, None] + 1.0) - gammaln(missing + 1.0) - gammaln(n + 1.0) + gammaln(n - m + 1.0)
    share = np.where(missing >= 0.0, np.exp(np.minimum(log_share, 0.0)), 0.0)
    return np.stack([m, (1.0 - share).sum(axis=0)], axis=1)
