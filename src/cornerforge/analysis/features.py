"""The paper's features of a crash (equation 10), and their scaling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in, check_integer
from cornerforge.errors import InputError

__all__ = ["FEATURES", "MAX_STEPS", "Features", "ShortCases", "check_history", "crash_features", "standardise"]

FEATURES = ("r_lon", "r_lat", "rr", "h_CAV", "h_BV")
"""Names as in the paper's equation 10. Units: m, m, m/s, rad, rad."""

MAX_STEPS = 15
"""Longest history that the paper looks at [s]."""

ShortCases = Literal["pad", "exclude"]
"""What happens to a case that began less than `steps` seconds before its crash."""

_X, _Y, _SPEED, _HEADING = range(4)


@dataclass(frozen=True)
class Features:
    """Features of the cases that are analysed.

    Attributes:
        names: One per column, such as `r_lon_1s`: the feature and how long before the crash.
        values: In SI units, not scaled, shape (S', 5 x steps), finite.
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
    """Relative motion of the AV and the crash partner in each of the last `steps` seconds.

    Each second k = 1..steps before the crash gives r_lon = x_BV - x_AV, r_lat = y_BV - y_AV, rr = v_BV - v_AV and the
    headings of both, as recorded. A case counts as recorded up to the last k before the first gap. One that crashed in
    its first second has no k = 1 at all and uses the moment of contact, k = 0, instead.

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
    is_recorded = np.isfinite(history).all(axis=(2, 3))
    last = np.logical_and.accumulate(is_recorded[:, 1:], axis=1).sum(axis=1)
    is_short = last < steps
    kept = np.flatnonzero(~is_short) if short == "exclude" else np.arange(len(history))
    seconds = np.arange(1, steps + 1)
    scene = history[kept[:, None], np.minimum(seconds, last[kept, None])].astype(np.float64)
    av, bv = scene[:, :, 0], scene[:, :, 1]
    parts = [bv[..., i] - av[..., i] for i in (_X, _Y, _SPEED)] + [av[..., _HEADING], bv[..., _HEADING]]
    return Features(
        names=tuple(f"{name}_{k}s" for k in seconds for name in FEATURES),
        values=np.stack(parts, axis=-1).reshape(len(kept), steps * len(FEATURES)),
        kept=kept,
        padded=int(is_short[kept].sum()),
        excluded=len(history) - len(kept),
    )


def check_history(history: NDArray[np.floating]) -> None:
    """Check the shape of a history and that every contact is there.

    Raises:
        InputError: They are not.
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


def standardise(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale every column to mean 0 and standard deviation 1 (z-scores, divisor n); constant columns become 0.

    Metres, m/s and radians have no common scale: unscaled, `r_lon` alone would be the first principal component.

    Args:
        values: Shape (S, F), finite.

    Returns:
        Shape (S, F). A column counts as constant when its spread is rounding error (below 1e-9 of its size).

    >>> standardise(np.array([[1.0, 7.0], [3.0, 7.0]]))
    array([[-1.,  0.],
           [ 1.,  0.]])
    """
    if len(values) == 0:
        return values.copy()
    centred = values - values.mean(axis=0)
    spread = centred.std(axis=0)
    is_constant = spread <= 1e-9 * np.abs(values).max(axis=0)
    scaled: NDArray[np.float64] = np.where(is_constant, 0.0, centred / np.where(is_constant, 1.0, spread))
    return scaled
