"""The parametric prior of the naturalistic model at 20-40 m/s, where trajectories are thin: tables from a fitted law.

The most likely law (`laws.LogLaw`) is not safe in free running: errors in measured speeds and the mixture of drivers
make its response too weak. So where gaps are short or a collision is near, it is blended into a stronger response with
repulsion and a kinematic floor; this forbids nothing and only moves the centre of the distribution. At motorway speeds,
for which there are no trajectories, its noise shrinks as the published free-flow spread does, and its pull towards a
time gap keeps the published distribution of time gaps for half a minute. Its constants were set so that simulated
traffic meets the published facts with few crashes: docs/results.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.laws import ENDLESS, MIN_GAP, LogLaw, bin_probabilities
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS
from cornerforge.types import ACCELERATION_STEP, ACCELERATIONS

__all__ = ["FREE_PULL", "MEMORY", "SUPPORT_SD", "FreeFlow", "SafeLaw", "following_prior", "free_prior", "support"]

Floats = NDArray[np.float64]

MEMORY = Memory(near=0.12, near_width=0.091, far=0.35, far_width=0.32, away=0.0004, away_again=0.3)
"""The shipped model's memory. Maximum likelihood on the NGSIM training halves gives these widths, and the weights 0.33
and 0.43. But smoothing makes recorded accelerations more alike from one second to the next than they were: traffic with
those weights has range rates with a spread of 2 m/s, published 1.3. These weights keep the published spread."""
FREE_PULL = 0.22
"""Mean acceleration of a free driver, per m/s that it lacks to its desired speed [1/s]. In simulated traffic it keeps
the speeds within a stream, and the differences between lanes, for a minute."""
SUPPORT_SD = 5.0
"""Accelerations farther than this many standard deviations from the centre are impossible; 3 would forbid 2 % of the
recorded ones."""
_HALF_BIN = ACCELERATION_STEP / 2 + 1e-9
"""Half the step between two accelerations [m/s2]."""


@dataclass(frozen=True)
class SafeLaw:
    """A fitted law, blended into a safe response where the leader is near or the gap closes fast.

    The weight of the safe response is 1 below `time_gap_full` or `ttc_full`, 0 above both `time_gap_none` and
    `ttc_none`, smooth between. With it drivers follow a leader that draws away at all speeds: else streams slow down by
    themselves. It is for motorway speeds: it fades out from `speed_full` down to `speed_none`, below
    which only the fitted law acts. (Queues crawl at time gaps that would be reckless on a motorway.)

    From `motorway_none` to `motorway_full`, `pull` and `headway` replace the law's own, and the noise shrinks to the
    share `calm`. `headway` is far below the usual time gap: it balances the repulsion and the kinematic floor, which
    widen gaps.
    """

    law: LogLaw
    response: float = 7.0
    reach: float = field(default=5.0, metadata={"unit": "m"})
    time_gap_full: float = field(default=0.4, metadata={"unit": "s"})
    time_gap_none: float = field(default=0.8, metadata={"unit": "s"})
    ttc_full: float = field(default=8.0, metadata={"unit": "s"})
    ttc_none: float = field(default=16.0, metadata={"unit": "s"})
    repulsion: float = field(default=2.0, metadata={"unit": "m/s2 per s"})
    repulsion_below: float = field(default=0.45, metadata={"unit": "s"})
    floor_margin: float = field(default=4.0, metadata={"unit": "m"})
    pull: float = field(default=0.12, metadata={"unit": "m/s2"})
    headway: float = field(default=0.62, metadata={"unit": "s"})
    calm: float = 0.64
    motorway_none: float = field(default=24.0, metadata={"unit": "m/s"})
    motorway_full: float = field(default=28.0, metadata={"unit": "m/s"})
    speed_none: float = field(default=16.0, metadata={"unit": "m/s"})
    speed_full: float = field(default=21.0, metadata={"unit": "m/s"})

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the Student-t noise."""
        return self.law.degrees

    def weight(self, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
        """Weight of the safe response, in [0, 1]; never falls as the pair closes faster."""
        time_gap = gap / np.maximum(speed, 1.0)
        inverse_ttc = np.maximum(-range_rate, 0.0) / np.maximum(gap, MIN_GAP)
        near = (self.time_gap_none - time_gap) / (self.time_gap_none - self.time_gap_full)
        fast = (inverse_ttc - 1.0 / self.ttc_none) / (1.0 / self.ttc_full - 1.0 / self.ttc_none)
        ramp = np.clip(np.maximum(near, fast), 0.0, 1.0)
        return np.asarray(ramp * ramp * (3.0 - 2.0 * ramp))

    def mean(self, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
        """Return the centre of the acceleration's distribution [m/s2]; below -4 the lowest bin takes all."""
        gap = np.maximum(gap, MIN_GAP)
        closing = np.maximum(-range_rate, 0.0)
        fitted = self.law.mean(speed, gap, range_rate)
        always = replace(self.law, opening=ENDLESS).mean(speed, gap, range_rate)
        share = np.clip((speed - self.speed_none) / (self.speed_full - self.speed_none), 0.0, 1.0)
        fitted += share * (always - fitted)
        extra = self.response / (gap + self.reach) - self.law.response / (gap + self.law.reach)
        stronger = -np.maximum(extra, 0.0) * closing * (speed + 1.0) ** 0.24
        time_gap = gap / np.maximum(speed, 1.0)
        own = self.pull * np.log(time_gap / self.headway) - self.law.pull * np.log(time_gap / self.law.headway)
        closer = self._motorway(speed) * own
        repelled = closer - self.repulsion * np.maximum(self.repulsion_below - time_gap, 0.0)
        safe = fitted + self.weight(speed, gap, range_rate) * stronger + repelled
        floor = -(closing**2) / (2.0 * np.maximum(gap - self.floor_margin, MIN_GAP))
        safe = np.where(closing > 0.0, np.minimum(safe, floor), safe)
        return np.asarray(fitted + share * (safe - fitted))

    def _motorway(self, speed: Floats) -> Floats:
        """0 up to `motorway_none`, 1 from `motorway_full` on."""
        return np.asarray(np.interp(speed, [self.motorway_none, self.motorway_full], [0.0, 1.0]))

    def scale(self, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
        """Scale of the Student-t noise [m/s2]."""
        return np.asarray((1.0 - (1.0 - self.calm) * self._motorway(speed)) * self.law.scale(speed, gap, range_rate))


@dataclass(frozen=True)
class FreeFlow:
    """Acceleration with no leader within 115 m, after the published IVBSS facts.

    Spread: standard deviation 0.61, 0.38, 0.32 m/s2 at 20, 30, 36 m/s. Centre: the acceleration that keeps a normal
    distribution of speeds stationary under that spread, times `pull`, plus `offset`. (Followers feel the pull only
    through their leaders; 0.2 is a compromise between a stationary distribution and the published mean of 0.02-0.05
    m/s2 at all speeds.)
    """

    speed_mean: float = field(default=30.05, metadata={"unit": "m/s"})
    speed_sd: float = field(default=3.48, metadata={"unit": "m/s"})
    pull: float = 0.2
    offset: float = field(default=0.02, metadata={"unit": "m/s2"})
    degrees: float = 12.0

    def sd(self, speed: Floats) -> Floats:
        """Standard deviation [m/s2] by speed [m/s]; 0.61 below 20, 0.32 above 36."""
        return np.interp(speed, [20.0, 30.0, 36.0], [0.61, 0.38, 0.32])

    def mean(self, speed: Floats) -> Floats:
        """Centre of the acceleration's distribution [m/s2]."""
        pull = -self.pull * self.sd(speed) ** 2 / 2.0 * (speed - self.speed_mean) / self.speed_sd**2
        return np.asarray(pull + self.offset)


def support(mean: Floats, scale: Floats, degrees: float) -> NDArray[np.bool_]:
    """Tell which of the 31 accelerations are possible, shape (*d, 31): within 5 standard deviations, at least one.

    However small the spread, the nearest acceleration is possible; with 2 degrees of freedom or fewer, all are.
    """
    if degrees <= 2.0:
        return np.ones((*np.shape(mean), ACCELERATIONS.size), dtype=np.bool_)
    sd = scale * np.sqrt(degrees / (degrees - 2.0))
    reach = np.maximum(SUPPORT_SD * sd, _HALF_BIN)
    centre = np.clip(mean, ACCELERATIONS[0], ACCELERATIONS[-1])
    return np.asarray(np.abs(ACCELERATIONS - centre[..., None]) <= reach[..., None])


def _table(mean: Floats, scale: Floats, degrees: float) -> Floats:
    rows = bin_probabilities(mean, scale, degrees) * support(mean, scale, degrees)
    return np.asarray(rows / rows.sum(axis=-1, keepdims=True))


def following_prior(law: SafeLaw, speeds: Floats = SPEEDS) -> Floats:
    """P(acceleration | speed, gap, range rate) on the model's grid, shape (speeds, 116, 19, 31), rows sum to 1."""
    state = np.meshgrid(speeds, GAPS, RANGE_RATES, indexing="ij")
    return _table(law.mean(*state), law.scale(*state), law.degrees)


def free_prior(law: FreeFlow) -> Floats:
    """P(acceleration | speed) without a leader, shape (21, 31), rows sum to 1."""
    scale = law.sd(SPEEDS) * np.sqrt((law.degrees - 2.0) / law.degrees)
    return _table(law.mean(SPEEDS), scale, law.degrees)
