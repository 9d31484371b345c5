"""The lane-change prior: how often a driver wants to change lanes, and which gaps in the next lane it accepts.

The shipped model's data hold no tracks of all lanes at 20-40 m/s (NGSIM US-101 is a weaving section, far above the
usual rate). So no value here is fitted to trajectories (`lane_fit` fits some of them to a user's): the rate is set to
about 0.36 lane changes per vehicle-mile (between 0.36, Lee, Olsen, Wierwille 2004, and 0.20, Krajewski et al. 2018),
desire grows behind a slower leader, and gap acceptance was fitted so that simulated cut-ins at 25-35 m/s have the gaps,
time gaps, times to collision and closing speeds, and these together, of the 44,373 recorded ones of the Safety Pilot
Model Deployment (docs/adr/0070-joint-law.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS

__all__ = ["LaneChange"]

Floats = NDArray[np.float64]

_UNSEEN = 1e-9
"""A vehicle that closes no faster [m/s] is never seen to grow."""
_SURE = 0.999
"""Share from which on all drivers accept: a gap that 999 of 1000 accept, all accept."""


@dataclass(frozen=True)
class LaneChange:
    """Desire and gap acceptance of a lane change.

    The gap ahead is accepted with the chance Phi((ln gap - ln G) / `lead_doubt`), G = `lead_standstill` +
    `lead_reaction` c + c^2 / (2 `accept_braking`), c the closing speed. It is 0 only where the bodies overlap
    lengthwise; so is the chance for the gap behind.

    The gap behind must be long enough, Phi((ln gap - ln `rear_standstill`) / `rear_doubt`), and the vehicle there must
    not be seen to close. People see that by how fast its image grows, as c / gap^2 (Hoffmann and Mortimer 1996,
    Accident Analysis and Prevention 28: 415-421): Phi((ln(gap^2 / c) - ln `rear_looming`) / `rear_looming_doubt`). The
    share `misjudge` does not see it so, and judges as by the gap ahead, with the numbers `misjudge_...`. That is an
    error that attentive drivers make too. With the chance `overlook` a driver does not look at all.

    The desire has a factor of this kind for the driver's own leader, the numbers `own_...`: hardly any driver begins a
    change, which holds its speed for a second, close behind a leader or closing in on one fast.

    A driver in a running change turns back for a critical gap: one at which, after `reaction` seconds at constant
    speeds, the vehicle behind must brake harder than `braking` to keep `standstill`.

    `rate` is per 1 s decision and side at a desire of 1.
    """

    rate: float = 0.0133
    slower_leader: float = field(default=1.0, metadata={"unit": "s/m"})
    near: float = field(default=60.0, metadata={"unit": "m"})
    desire_free: float = 0.5
    standstill: float = field(default=6.0, metadata={"unit": "m"})
    rear_doubt: float = 0.7
    rear_standstill: float = field(default=12.0, metadata={"unit": "m"})
    rear_looming: float = field(default=20000.0, metadata={"unit": "m s"})
    rear_looming_doubt: float = 1.5
    lead_doubt: float = 0.45
    lead_standstill: float = field(default=11.0, metadata={"unit": "m"})
    lead_reaction: float = field(default=2.0, metadata={"unit": "s"})
    misjudge: float = 0.4
    misjudge_gap: float = field(default=28.0, metadata={"unit": "m"})
    misjudge_reaction: float = field(default=1.0, metadata={"unit": "s"})
    misjudge_doubt: float = 0.15
    accept_braking: float = field(default=4.0, metadata={"unit": "m/s2"})
    reaction: float = field(default=3.5, metadata={"unit": "s"})
    braking: float = field(default=6.0, metadata={"unit": "m/s2"})
    own_standstill: float = field(default=9.0, metadata={"unit": "m"})
    own_doubt: float = 0.35
    own_reaction: float = field(default=1.0, metadata={"unit": "s"})
    own_braking: float = field(default=3.0, metadata={"unit": "m/s2"})
    overlook: float = 0.0008
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
        looming = np.sqrt(self.rear_looming * np.maximum(-RANGE_RATES, _UNSEEN))
        sees = _accept(looming, 0.5 * self.rear_looming_doubt, sure)
        careful = _accept(np.full(RANGE_RATES.size, self.rear_standstill), self.rear_doubt, sure) * sees
        usual = _critical_gap(RANGE_RATES, self.misjudge_gap, self.misjudge_reaction, self.accept_braking)
        return (1.0 - self.misjudge) * careful + self.misjudge * _accept(usual, self.misjudge_doubt, sure)

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
