"""Motion of the AV and the vehicle that it touches, of many cases at once, all ending at the contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.fields import POSE
from cornerforge.recordings import Recordings

__all__ = ["AV", "BV", "PairMotion", "pair_motion"]

AV, BV = 0, 1
"""First axis of the arrays of a pair."""


@dataclass(frozen=True)
class PairMotion:
    """The AV and its crash partner, all cases ending in the same column: the contact.

    Frames before both were present repeat the first frame in which both were, so that differences there are 0.

    Attributes:
        x, y, speed, heading: [m, m, m/s, rad], float64, shape (2, S, T); `AV` and `BV` on the first axis.
        recorded: The frame is of the recording, shape (S, T); the last column always is.
        free_along, free_across: Distance between the extents of the two boxes along and across the road [m],
            shape (S, T); negative: overlap. A turned box extends farther: that matters for vehicles that nearly stood
            while they changed lanes, and it makes every contact an overlap on both axes.
        length, width: [m], float64, shape (2, S).
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    speed: NDArray[np.float64]
    heading: NDArray[np.float64]
    recorded: NDArray[np.bool_]
    free_along: NDArray[np.float64]
    free_across: NDArray[np.float64]
    length: NDArray[np.float64]
    width: NDArray[np.float64]

    @property
    def half_lengths(self) -> NDArray[np.float64]:
        """Half of both lengths together [m], shape (S,): the distance of the centres when the bumpers touch."""
        return np.asarray(0.5 * (self.length[AV] + self.length[BV]))

    @property
    def half_widths(self) -> NDArray[np.float64]:
        """Half of both widths together [m], shape (S,)."""
        return np.asarray(0.5 * (self.width[AV] + self.width[BV]))


def pair_motion(recordings: Recordings) -> PairMotion:
    """Pick the AV and its crash partner, ending at the contact.

    Raises:
        InputError: The partner is not recorded, the contact is not, one of the two is absent then, or where they are is
            not a finite number.
    """
    r = recordings
    for wrong, what in (
        (r.partner == 0, "its crash partner is not among its vehicles once"),
        ((r.last < 0) | (r.last >= r.frames), "its contact is not in the recording"),
    ):
        if wrong.any():
            raise InputError(f"Case {r.case_ids[int(np.argmax(wrong))]}: {what}.")
    n_columns = int(r.last.max(initial=0)) + 1
    frame = (r.last + 1)[:, None] - n_columns + np.arange(n_columns)
    vehicle_start = np.stack([r.at, r.at + r.partner * r.frames])[:, :, None]
    within = np.maximum(frame, 0)
    absent = ~r.present[vehicle_start + within].all(axis=0)
    if absent[:, -1].any():
        case = r.case_ids[int(np.argmax(absent[:, -1]))]
        raise InputError(f"Case {case}: the AV or its crash partner is absent at the contact.")
    # Behind the last frame in which one of them was missing, both have been there ever since.
    first = np.where(absent, within + 1, 0).max(axis=1)
    entries = vehicle_start + np.maximum(frame, first[:, None])
    series = {name: np.asarray(getattr(r, name)[entries], np.float64) for name in POSE}
    for name, values in series.items():
        bad = ~np.isfinite(values).all(axis=(0, 2))
        if bad.any():
            raise InputError(
                f"Case {r.case_ids[int(np.argmax(bad))]}: {name} of the AV or its crash partner is not finite."
            )
    vehicle = np.stack([r.vehicle_at, r.vehicle_at + r.partner])
    length, width = r.length[vehicle], r.width[vehicle]
    cos, sin = np.abs(np.cos(series["heading"])), np.abs(np.sin(series["heading"]))
    apart_x, apart_y = (np.abs(series[name][BV] - series[name][AV]) for name in ("x", "y"))
    long, wide = length[:, :, None], width[:, :, None]
    return PairMotion(
        recorded=frame >= first[:, None],
        free_along=apart_x - 0.5 * (long * cos + wide * sin).sum(axis=0),
        free_across=apart_y - 0.5 * (wide * cos + long * sin).sum(axis=0),
        length=length,
        width=width,
        **series,
    )
