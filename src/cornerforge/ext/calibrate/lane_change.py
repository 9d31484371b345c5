"""The lane-change prior: how often a driver wants to change lanes, and which gaps in the next lane it accepts.

The shipped model's data hold no tracks of all lanes at 20-40 m/s (NGSIM US-101 is a weaving section, far above the
usual rate). So no value here is fitted to trajectories (`lane_fit` fits some of them to a user's): the rate is set to
about 0.34 lane changes per vehicle-mile (between 0.36, Lee, Olsen, Wierwille 2004, and 0.20, Krajewski et al. 2018),
desire grows behind a slower leader, and gap acceptance was chosen so that simulated cut-ins at 25-35 m/s have the gaps,
time gaps, times to collision and closing speeds of the 44,394 recorded ones of the Safety Pilot Model Deployment
(docs/adr/0024-natural-traffic.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS

__all__ = ["LaneChange"]

Floats = NDArray[np.float64]

_SURE = 0.999
"""Share from which on all drivers accept: a gap that 999 of 1000 accept, all accept."""


@dataclass(frozen=True)
class LaneChange:
    """Desire and gap acceptance of a lane change.

    A gap is accepted with the chance Phi((ln gap - ln G) / doubt), G = standstill + reaction c + c^2 / (2 braking), c
    the closing speed: `lead_standstill`, `lead_reaction`, `lead_doubt` for the vehicle ahead, `rear_...` for the one
    behind, `accept_braking` for both. It is 0 only where the bodies overlap lengthwise.

    People change ahead of a vehicle that hardly closes, or ahead of one that closes by several m/s, and seldom between:
    half of the recorded closing cut-ins close by less than 0.56 m/s, one in twenty by more than 3.2. So most drivers
    wait for a vehicle behind that closes (`rear_reaction` is long), and the share `misjudge` looks at the gap alone.
    That is an error that attentive drivers make too. With the chance `overlook` a driver does not look at all.

    The desire has a factor of this kind for the driver's own leader, the numbers `own_...`: hardly any driver begins a
    change, which holds its speed for a second, close behind a leader or closing in on one fast.

    A driver in a running change turns back for a critical gap: one at which, after `reaction` seconds at constant
    speeds, the vehicle behind must brake harder than `braking` to keep `standstill`.

    `rate` is per 1 s decision and side at a desire of 1.
    """

    rate: float = 0.0150
    slower_leader: float = field(default=1.0, metadata={"unit": "s/m"})
    near: float = field(default=60.0, metadata={"unit": "m"})
    desire_free: float = 0.5
    standstill: float = field(default=6.0, metadata={"unit": "m"})
    rear_doubt: float = 0.95
    rear_standstill: float = field(default=25.0, metadata={"unit": "m"})
    rear_reaction: float = field(default=300.0, metadata={"unit": "s"})
    lead_doubt: float = 0.45
    lead_standstill: float = field(default=11.0, metadata={"unit": "m"})
    lead_reaction: float = field(default=2.0, metadata={"unit": "s"})
    misjudge: float = 0.07
    accept_braking: float = field(default=4.0, metadata={"unit": "m/s2"})
    reaction: float = field(default=1.0, metadata={"unit": "s"})
    braking: float = field(default=3.0, metadata={"unit": "m/s2"})
    own_standstill: float = field(default=9.0, metadata={"unit": "m"})
    own_doubt: float = 0.35
    own_reaction: float = field(default=1.0, metadata={"unit": "s"})
    own_braking: float = field(default=3.0, metadata={"unit": "m/s2"})
    overlook: float = 0.0015
    overlook_conflict: float = 1e-4

    def base(self) -> Floats:
        """Return the chance per 1 s decision and side, without desire and gaps, shape (21,); the same at all speeds."""
        return np.full(SPEEDS.size, self.rate)

    def desire(self) -> Floats:
        """Return the factor of the chance by (gap, range rate) to the leader, shape (116, 19).

        It rises with the closing speed and approaches `desire_free` for large gaps; hardly above 0 where the leader is
        too near to begin a change.
        """
        gap, closing = GAPS[:, None], np.maximum(-RANGE_RATES, 0.0)[None, :]
        wish = self.desire_free + (0.5 + self.slower_leader * closing) * np.exp(-gap / self.near)
        usual = _critical_gap(RANGE_RATES, self.own_standstill, self.own_reaction, self.own_braking)
        return np.asarray(wish * _accept(usual, self.own_doubt, _SURE))

    def accept_lead(self, *, sure: float = _SURE) -> Floats:
        """Return the acceptance of the gap to the vehicle ahead by (gap, range rate), shape (116, 19).

        A gap that more than the share `sure` accept, all accept: a vehicle with a surely accepted gap is left out of
        the sum over vehicles that may start at the same moment (`sim.chances`). With 1 the acceptance is smooth.
        """
        usual = _critical_gap(RANGE_RATES, self.lead_standstill, self.lead_reaction, self.accept_braking)
        return _accept(usual, self.lead_doubt, sure)

    def accept_rear(self, *, sure: float = _SURE) -> Floats:
        """Return the same for the vehicle behind; range rate front minus rear, < 0: closing."""
        usual = _critical_gap(RANGE_RATES, self.rear_standstill, self.rear_reaction, self.accept_braking)
        careful = _accept(usual, self.rear_doubt, sure)
        by_gap_alone = _accept(np.full(RANGE_RATES.size, self.rear_standstill), self.rear_doubt, sure)
        return (1.0 - self.misjudge) * careful + self.misjudge * by_gap_alone

    def turn_back(self) -> Floats:
        """Return the chance to turn back for a neighbour by (gap, range rate), shape (116, 19): 0 or 1."""
        critical = _critical_gap(RANGE_RATES, self.standstill, self.reaction, self.braking)
        return np.asarray(GAPS[:, None] <= critical[None, :], dtype=np.float64)


def _accept(usual: Floats, doubt: float, sure: float) -> Floats:
    """Return the chance to accept each gap of the grid, shape (116, 19): one half at the `usual` gap (19,)."""
    from scipy.special import ndtr

    above = np.log(np.maximum(GAPS, 0.5))[:, None] - np.log(usual)[None, :]
    chance = ndtr(above / doubt)
    return np.where(chance > sure, 1.0, chance)


def _critical_gap(range_rate: Floats, standstill: float, reaction: float, braking: float) -> Floats:
    """Return the largest gap [m] that an attentive driver refuses; range rate front minus rear, < 0 when closing."""
    closing = np.maximum(-range_rate, 0.0)
    return np.asarray(standstill + reaction * closing + closing**2 / (2.0 * braking))
