"""The paper's features of a crash (equation 10), and their scaling."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in, check_integer
from cornerforge.errors import InputError

__all__ = [
    "FEATURES",
    "MAX_STEPS",
    "Features",
    "Scaling",
    "ShortCases",
    "check_history",
    "crash_features",
    "row_blocks",
    "scaling_of",
]

FEATURES = ("r_lon", "r_lat", "rr", "h_CAV", "h_BV")
"""Names as in the paper's equation 10. Units: m, m, m/s, rad, rad."""

MAX_STEPS = 15
"""Longest history that the paper looks at [s]."""

ShortCases = Literal["pad", "exclude"]
"""Treatment of a case that began less than `steps` seconds before its crash."""

_HEADING = 3
_BLOCK = 65_536


@dataclass(frozen=True)
class Features:
    """Features of the cases that are analysed.

    Attributes:
        names: One per column, such as `r_lon_1s`: the feature and how long before the crash.
        values: Features in SI units, not scaled, shape (S', 5 x steps), finite.
        kept: Rows of the input that `values` stands for, ascending, shape (S',).
        padded: How many of them began too late and repeat their earliest recorded second.
        excluded: How many rows were left out for that reason.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    kept: NDArray[np.intp]
    padded: int
    excluded: int


def crash_features(history: NDArray[np.floating], steps: int = 1, *, short: ShortCases = "pad") -> Features:
    """Give the relative motion of the AV and the crash partner in each of the last `steps` seconds.

    Each second k = 1..steps before the crash gives r_lon = x_BV - x_AV, r_lat = y_BV - y_AV, rr = v_BV - v_AV and the
    headings of both, as recorded. A case counts as recorded up to the last k before the first gap. One that crashed in
    its first second has no k = 1 at all and uses the moment of contact, k = 0, instead.

    At a site the history is in the AV's frame of each second (`site_case.in_av_frame`): r_lon and r_lat are along and
    to the left of the AV's heading, rr is the closing speed along it, h_BV is the angle between the headings, and h_CAV
    is 0 and tells nothing.

    Args:
        history: [x m, y m, speed m/s, heading rad] of the AV (0) and the crash partner (1) at k seconds before the
            crash, shape (S, 16, 2, 4); NaN where the test had not begun.
        steps: Seconds before the crash to look at, 1 to 15 (paper: 1, 2, 3, 5, 7, 9, 12, 15).
        short: "pad" repeats the earliest recorded second of a case that began too late, "exclude" leaves it out.

    Raises:
        InputError: The shape is wrong, a contact (k = 0) is not finite, or `steps` or `short` is not allowed.
    """
    check_history(history)
    check_integer("steps", steps, low=1, high=MAX_STEPS)
    check_in("short-case policy", short, ("pad", "exclude"))
    last = np.concatenate([_last_recorded(block) for block in _blocks_of(history)])
    is_short = last < steps
    kept = np.flatnonzero(~is_short) if short == "exclude" else np.arange(len(history))
    seconds = np.arange(1, steps + 1)
    values = np.empty((len(kept), steps, len(FEATURES)))
    for begin in range(0, len(kept), _BLOCK):
        rows = kept[begin : begin + _BLOCK]
        scene = history[rows[:, None], np.minimum(seconds, last[rows, None])]
        av, bv = scene[:, :, 0].astype(np.float64), scene[:, :, 1].astype(np.float64)
        values[begin : begin + _BLOCK, :, :3] = bv[..., :3] - av[..., :3]
        values[begin : begin + _BLOCK, :, 3] = av[..., _HEADING]
        values[begin : begin + _BLOCK, :, 4] = bv[..., _HEADING]
    return Features(
        names=tuple(f"{name}_{k}s" for k in seconds for name in FEATURES),
        values=values.reshape(len(kept), steps * len(FEATURES)),
        kept=kept,
        padded=int(is_short[kept].sum()),
        excluded=len(history) - len(kept),
    )


def _blocks_of(history: NDArray[np.floating]) -> Iterator[NDArray[np.floating]]:
    for begin in range(0, len(history), _BLOCK):
        yield history[begin : begin + _BLOCK]


def _last_recorded(history: NDArray[np.floating]) -> NDArray[np.intp]:
    """The last second before the first gap of each case, 0 for none, shape (S,)."""
    is_recorded = np.isfinite(history).all(axis=(2, 3))
    return np.asarray(np.logical_and.accumulate(is_recorded[:, 1:], axis=1).sum(axis=1), np.intp)


def check_history(history: NDArray[np.floating]) -> None:
    """Check the shape of a history and that every contact is there.

    Raises:
        InputError: The shape is wrong, or a contact is missing.
    """
    wanted = (MAX_STEPS + 1, 2, 4)
    if history.ndim != 4 or history.shape[1:] != wanted:
        raise InputError(f"history has shape {history.shape}; allowed: (cases, {', '.join(map(str, wanted))}).")
    if len(history) == 0:
        raise InputError("There are no cases to analyse; generate some first.")
    bad = np.flatnonzero(~np.isfinite(history[:, 0]).all(axis=(1, 2)))
    if bad.size:
        raise InputError(
            f"history[{bad[0]}, 0] (the moment of contact) is not finite, as in {bad.size} case(s) of {len(history)}; "
            "leave these cases out."
        )


@dataclass(frozen=True)
class Scaling:
    """Means and spreads that turn features into z-scores, (values - mean) / spread; by blocks, without a second table.

    Attributes:
        mean: Mean of each column, in SI units, shape (F,).
        spread: Standard deviation of each column (divisor n), shape (F,); inf for constant ones, so that they become 0.
    """

    mean: NDArray[np.float64]
    spread: NDArray[np.float64]

    @property
    def is_trivial(self) -> bool:
        """All cases are alike."""
        return bool(np.isinf(self.spread).all())

    def scaled(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The z-scores of some rows, shape (S, F)."""
        result: NDArray[np.float64] = (values - self.mean) / self.spread
        return result


def scaling_of(values: NDArray[np.float64]) -> Scaling:
    """Means and standard deviations of features (divisor n); constant columns will become 0.

    Metres, m/s and radians have no common scale: unscaled, `r_lon` alone would be the first principal component.

    Args:
        values: Shape (S, F), S >= 1, finite.

    Returns:
        The scaling. A column counts as constant when its spread is rounding error (below 1e-9 of its size).

    >>> scaling_of(np.array([[1.0, 7.0], [3.0, 7.0]])).scaled(np.array([[1.0, 7.0]])) + 0.0
    array([[-1.,  0.]])
    """
    mean = values.mean(axis=0)
    square, size = np.zeros(len(mean)), np.zeros(len(mean))
    for block in row_blocks(values):
        square += ((block - mean) ** 2).sum(axis=0)
        size = np.maximum(size, np.abs(block).max(axis=0))
    spread = np.sqrt(square / len(values))
    return Scaling(mean, np.where(spread <= 1e-9 * size, np.inf, spread))


def row_blocks(values: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """The rows, some ten thousand at a time."""
    for begin in range(0, len(values), _BLOCK):
        yield values[begin : begin + _BLOCK]
