"""The lane-change prior: how often a driver wants to change lanes, and which gaps in the next lane it accepts.

The data hold no trajectories of all lanes at 20-40 m/s (NGSIM US-101 is a weaving section, far above the usual rate).
So nothing here is fitted: the rate is set to about 0.3 lane changes per vehicle-mile (between 0.36, Lee, Olsen,
Wierwille 2004, and 0.20, Krajewski et al. 2018), desire grows behind a slower leader, gap acceptance is kinematic.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS

__all__ = ["LaneChange"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LaneChange:
    """Desire and gap acceptance of a lane change that takes about 4 s.

    A gap is critical when, after `reaction` seconds at constant speeds, the one behind must brake harder than `braking`
    to keep `standstill`: critical = standstill + reaction c + c^2 / (2 braking), c the closing speed. At or below it
    acceptance is exactly 0; above, it is 1 - exp(-((gap - critical) / smooth)^2). Desire has the same factor for the
    leader, with the numbers `own_...`: no driver begins a change, which holds its speed for a second, close behind a
    leader or closing in on one fast. Without this factor these changes made most of the crashes between BVs.

    `rate` is per 1 s decision and side at a desire of 1: 0.0111 gives 0.30 changes a mile in traffic as at the start of
    a test (simulated).
    """

    rate: float = 0.0111
    slower_leader: float = field(default=1.0, metadata={"unit": "s/m"})
    near: float = field(default=40.0, metadata={"unit": "m"})
    desire_free: float = 0.5
    standstill: float = field(default=6.0, metadata={"unit": "m"})
    smooth: float = field(default=10.0, metadata={"unit": "m"})
    reaction: float = field(default=2.0, metadata={"unit": "s"})
    braking: float = field(default=2.0, metadata={"unit": "m/s2"})
    own_standstill: float = field(default=4.0, metadata={"unit": "m"})
    own_smooth: float = field(default=6.0, metadata={"unit": "m"})
    own_reaction: float = field(default=1.0, metadata={"unit": "s"})
    own_braking: float = field(default=3.0, metadata={"unit": "m/s2"})
    overlook: float = 1e-4
    overlook_conflict: float = 1e-4

    def base(self) -> Floats:
        """Return the chance per 1 s decision and side, without desire and gaps, shape (21,); the same at all speeds."""
        return np.full(SPEEDS.size, self.rate)

    def desire(self) -> Floats:
        """Return the factor of the chance by (gap, range rate) to the leader, shape (116, 19).

        It rises with the closing speed and tends to `desire_free` for large gaps; 0 where the leader is too near to
        begin a change.
        """
        gap, closing = GAPS[:, None], np.maximum(-RANGE_RATES, 0.0)[None, :]
        wish = self.desire_free + (0.5 + self.slower_leader * closing) * np.exp(-gap / self.near)
        critical = _critical_gap(RANGE_RATES, self.own_standstill, self.own_reaction, self.own_braking)
        return np.asarray(wish * _acceptance(critical, self.own_smooth))

    def accept(self) -> Floats:
        """Return the acceptance by (gap, range rate), shape (116, 19); range rate front minus rear, < 0: closing."""
        critical = _critical_gap(RANGE_RATES, self.standstill, self.reaction, self.braking)
        return _acceptance(critical, self.smooth)


def _critical_gap(range_rate: Floats, standstill: float, reaction: float, braking: float) -> Floats:
    """Return the largest gap [m] that an attentive driver refuses; range rate front minus rear, < 0 when closing."""
    closing = np.maximum(-range_rate, 0.0)
    return np.asarray(standstill + reaction * closing + closing**2 / (2.0 * braking))


def _acceptance(critical: Floats, smooth: float) -> Floats:
    """Return the chance to accept each gap of the grid, shape (116, 19); 0 at and below the critical gap (19,)."""
    above = np.maximum(GAPS[:, None] - critical[None, :], 0.0)
    return np.asarray(-np.expm1(-((above / smooth) ** 2)))
