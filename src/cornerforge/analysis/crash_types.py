"""Crash types: five categories after the paper's Figure 4 and the FARS crash-type diagram (rules: ADR 0002)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.contact import FRONT, REAR, SIDE, find_contact
from cornerforge.results.analysis import CrashType

__all__ = ["CRASH_TYPES", "STRIKERS", "CrashTypes", "classify_crashes"]

CRASH_TYPES: dict[int, CrashType] = dict(enumerate(get_args(CrashType), start=1))
"""Code and name. Head-on cannot happen on a one-way road; it is there for completeness."""

STRIKERS = ("av", "bv", "mutual")

REAR_END_BELOW = math.radians(10.0)
SIDESWIPE_BELOW = math.radians(40.0)
HEAD_ON_ABOVE = math.radians(140.0)
_AV, _BV, _MUTUAL = range(3)
_MAIN_SHARE = 0.75
"""Share of the closing speed from which one vehicle alone counts as the striker of a sideswipe."""


@dataclass(frozen=True)
class CrashTypes:
    """Type and striker of each crash.

    Attributes:
        code: 1..5, keys of `CRASH_TYPES`, int8, shape (S,).
        striker: 0..2, indices into `STRIKERS`, int8, shape (S,).
    """

    code: NDArray[np.int8]
    striker: NDArray[np.int8]

    @property
    def names(self) -> list[str]:
        """Name of each crash's type."""
        return [CRASH_TYPES[int(code)] for code in self.code]

    def counts(self, rows: Sequence[int] | NDArray[np.intp] | None = None) -> dict[str, int]:
        """Crashes of each type, zeros included, in the order of the codes; of some rows only if given."""
        chosen = self.code if rows is None else self.code[np.asarray(rows, np.intp)]
        return {name: int((chosen == code).sum()) for code, name in CRASH_TYPES.items()}

    def striker_counts(self) -> dict[str, int]:
        """Crashes by striker, zeros included."""
        return {name: int((self.striker == index).sum()) for index, name in enumerate(STRIKERS)}


def classify_crashes(
    pose: NDArray[np.floating], length: float | NDArray[np.floating] = 5.0, width: float | NDArray[np.floating] = 2.0
) -> CrashTypes:
    """Classify crashes by which faces met first and how the headings stood.

    In this order: headings more than 140 degrees apart: head-on. A front or rear met a rear or front with headings less
    than 10 degrees apart: rear-end, struck by the vehicle with that front. A side took part with headings less than 40
    degrees apart: sideswipe, struck by the vehicle with at least 75 % of the closing speed across the road, else
    mutual. All other crashes: angle, struck by the vehicle with its front in it, mutual with both fronts or neither.

    Args:
        pose: [x m, y m, speed m/s, heading rad] of the AV (0) and the BV (1) in the first frame of contact,
            shape (S, 2, 4).
        length: Length of the vehicles [m], one number or shape (S, 2), each 0.1 to 50.
        width: Width of the vehicles [m], in the same form.

    Raises:
        InputError: A shape is wrong, a value is not finite or out of range, or two boxes do not touch (by more than
            0.1 m).

    An AV at 30 m/s that is 0.5 m deep in the rear of a BV at 20 m/s:
    >>> classify_crashes(np.array([[[0.0, 2.0, 30.0, 0.0], [4.5, 2.0, 20.0, 0.0]]])).names
    ['rear-end by AV']
    """
    contact = find_contact(pose, length, width)
    angle = contact.relative_heading
    av_front, bv_front = contact.av_sector == FRONT, contact.bv_sector == FRONT
    is_head_on = angle > HEAD_ON_ABOVE
    is_lengthwise = (av_front & (contact.bv_sector == REAR)) | (bv_front & (contact.av_sector == REAR))
    is_rear_end = is_lengthwise & (angle < REAR_END_BELOW)
    is_sideswipe = ((contact.av_sector == SIDE) | (contact.bv_sector == SIDE)) & (angle < SIDESWIPE_BELOW)
    by_front = np.where(av_front & ~bv_front, _AV, np.where(bv_front & ~av_front, _BV, _MUTUAL))
    code = np.select([is_head_on, is_rear_end & av_front, is_rear_end, is_sideswipe], [3, 1, 2, 4], default=5)
    swiper = _main_mover(contact.av_approach, contact.bv_approach)
    striker = np.select([is_head_on, is_sideswipe], [np.full_like(by_front, _MUTUAL), swiper], default=by_front)
    return CrashTypes(code.astype(np.int8), striker.astype(np.int8))


def _main_mover(av_approach: NDArray[np.float64], bv_approach: NDArray[np.float64]) -> NDArray[np.intp]:
    """Say which vehicle closed the gap across the road: `_AV`, `_BV` or `_MUTUAL`."""
    closing = av_approach + bv_approach
    is_closing = closing > 1e-9
    by_av = is_closing & (av_approach >= _MAIN_SHARE * closing)
    by_bv = is_closing & (bv_approach >= _MAIN_SHARE * closing)
    return np.where(by_av, _AV, np.where(by_bv, _BV, _MUTUAL))
