"""How people and the AV decide, by formula and by table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from cornerforge.drivers.idm import IdmParams
from cornerforge.drivers.mobil import MobilParams
from cornerforge.drivers.rss import RssParams
from cornerforge.drivers.sight import Sight
from cornerforge.ndd.model import NddModel
from reference.philox import unit

__all__ = ["AvDriver", "Naturalistic", "Row", "fold"]


@dataclass(frozen=True)
class AvDriver:
    """IDM and MOBIL with their parameters, and what other kinds of AV make of them."""

    idm: IdmParams
    mobil: MobilParams
    sight: Sight
    kind: str = "plain"
    rss: RssParams = field(default_factory=RssParams)

    def desired_gap(self, speed: float, range_rate: float) -> float:
        """The IDM's s*."""
        p = self.idm
        root = 2.0 * math.sqrt(p.max_acceleration * p.comfortable_braking)
        return p.standstill_gap + max(0.0, speed * p.time_gap - speed * range_rate / root)

    def follow(self, speed: float, gap: float, range_rate: float) -> float:
        """The IDM's acceleration, within its limits."""
        p = self.idm
        square = (speed / p.desired_speed) * (speed / p.desired_speed)
        wish = self.desired_gap(speed, range_rate) / max(gap, 0.1)
        command = p.max_acceleration * (1.0 - square * square - wish * wish)
        return min(max(command, -p.max_braking), p.max_acceleration)

    def gain(
        self,
        speed: float,
        now: float,
        lead: tuple[float, float] | None,
        rear: tuple[float, float] | None,
        rear_now: float,
    ) -> float | None:
        """MOBIL's gain of a lane with these neighbours, each (gap, speed) or None; None where it is not safe."""
        lead_gap, lead_speed = lead if lead is not None else (math.inf, speed)
        rear_gap, rear_speed = rear if rear is not None else (math.inf, speed)
        if min(lead_gap, rear_gap) <= 0.0:
            return None
        rear_after = self.follow(rear_speed, rear_gap, speed - rear_speed)
        own_after = self.follow(speed, lead_gap, lead_speed - speed)
        if min(rear_after, own_after) < -self.mobil.max_imposed_braking:
            return None
        gain = own_after - now
        if rear is not None:
            gain += self.mobil.politeness * (rear_after - rear_now)
        return gain

    def rss_ahead(self, speed: float, lead_speed: float) -> float:
        """Safe distance behind a lead."""
        p = self.rss
        return safe_distance(speed, lead_speed, p.response_time, p.max_acceleration, p.min_braking, p.lead_braking)

    def rss_behind(self, rear_speed: float, speed: float) -> float:
        """Safe distance of a driver behind the AV."""
        p = self.rss
        return safe_distance(
            rear_speed, speed, p.rear_response_time, p.rear_acceleration, p.rear_braking, p.lead_braking
        )

    def proper_response(self, speed: float, gap: float, lead_speed: float) -> float:
        """Acceleration that RSS allows at most behind a lead."""
        if gap >= self.rss_ahead(speed, lead_speed):
            return math.inf
        if gap <= 0.0:
            return -8.0
        brakes, braking = self.rss.lead_braking, self.rss.min_braking
        enough = speed * speed / (2.0 * (gap + lead_speed * lead_speed / (2.0 * brakes)))
        if lead_speed < speed and speed / enough < lead_speed / brakes:
            enough = brakes + (speed - lead_speed) ** 2 / (2.0 * gap)
        return -min(max(enough, braking), 8.0)


def safe_distance(
    rear: float, lead: float, response: float, acceleration: float, rear_braking: float, lead_braking: float
) -> float:
    """Room that the one behind needs, at the end or, if it is sooner slower than the one ahead, at that moment [m]."""
    path = rear * response + 0.5 * acceleration * response * response
    reached = rear + response * acceleration
    needed = path + reached * reached / (2.0 * rear_braking) - lead * lead / (2.0 * lead_braking)
    if rear_braking > lead_braking and response < lead / lead_braking:
        left = lead - lead_braking * response
        if left < reached and reached / rear_braking < left / lead_braking:
            gained = path - 0.5 * (lead + left) * response
            needed = gained + (reached - left) * (reached - left) / (2.0 * (rear_braking - lead_braking))
    return max(0.0, needed)


@dataclass(frozen=True)
class Row:
    """One row of 31 probabilities."""

    cumulative: list[float]
    """Running sums as the table has them; the last is 1 to float32."""
    cuts: list[int]
    """Running sums as shares of 2^32; the last is 2^32."""

    @classmethod
    def of(cls, p: NDArray[np.float32]) -> Row:
        """From float32 probabilities."""
        cumulative = list(accumulate(float(value) for value in p))
        return cls(cumulative, [math.floor(value / cumulative[-1] * 2.0**32) for value in cumulative])

    def draw(self, word: int) -> int:
        """The first acceleration whose cut lies above the word."""
        return next(index for index, cut in enumerate(self.cuts) if word < cut)


def _grid_place(gap: float, range_rate: float, rounding: float = 0.5) -> tuple[int, int] | None:
    """(gap, range rate) of the grid; None where nobody is near enough to follow.

    The nearest gap; of the range rates beside the true one the upper where its fraction and `rounding` reach 1.
    """
    if range_rate < -10.0 and gap > 4.0:
        share = 10.0 / -range_rate
        gap = 4.0 + (gap - 4.0) * share * share
    if gap > 115.5:
        return None
    nearest_gap = math.floor(gap + 0.5)
    rate = math.floor(range_rate + rounding)
    return min(max(nearest_gap, 0), 115), min(max(rate, -10), 8) + 10


def _speed_place(speed: float) -> int:
    return min(max(math.floor(speed + 0.5), 20), 40) - 20


def fold(u: float) -> float:
    """A quantile that left 0 to 1 by at most 1, reflected where it left."""
    u = abs(u)
    return min(u, 2.0 - u)


def _word_at(u: float) -> int:
    """The 32 bits whose slot in 0 to 1 holds u; the last one is never used."""
    return min(math.floor(u * 2.0**32), 2**32 - 2)


def rank_of(share: float, noise: float) -> float:
    """P(a driver of this noise level is below a quantile of all drivers): density 1 + noise in the outer quarters."""
    if share <= 0.25:
        return share + noise * share
    return share + noise * (0.5 - share if share <= 0.75 else share - 1.0)


def look_up_word(word: int, noise: float) -> int:
    """The word to look up for a driver's own one: its rank is so far from the median at the two densities."""
    off = unit(word) - 0.5
    inner = min(abs(off), 0.25 * (1.0 - noise))
    factor = 1.0 / (1.0 - noise * noise)
    way = (1.0 + noise) * factor * inner + (1.0 - noise) * factor * (abs(off) - inner)
    return _word_at(0.5 + way if off >= 0.0 else 0.5 - way)


@dataclass
class Naturalistic:
    """The tables of a model, looked up as written in `cornerforge.ndd.model`."""

    model: NddModel
    _rows: dict[tuple[int, ...], Row] = field(default_factory=dict)

    def row(self, speed: float, desired_speed: float, gap: float, range_rate: float, rounding: float) -> Row:
        """The accelerations of a state; a gap of +inf is free flow.

        In free flow a driver of `desired_speed` has a mean acceleration above that of all drivers at its speed, by
        the model's pull times what it lacks, to the nearest half m/s and at most 6 m/s.
        """
        place = _grid_place(gap, range_rate, rounding)
        halves = min(max(math.floor(2.0 * (desired_speed - speed) + 0.5), -12), 12)
        key = (_speed_place(speed), *(place or (halves,)))
        if key not in self._rows:
            self._rows[key] = Row.of(self.tilted(key[0], halves) if place is None else self.model.following[key])
        return self._rows[key]

    def tilted(self, speed_place: int, halves: int) -> NDArray[np.float32]:
        """The free row of all drivers times exp(theta a), theta such that its mean is what this driver's should be."""
        p = [float(value) for value in self.model.free[speed_place]]
        accelerations = [-4.0 + 0.2 * k for k in range(31)]
        if halves == 0 or self.model.free_pull == 0.0:
            return self.model.free[speed_place]

        def mean_above(theta: float) -> float:
            weights = [value * math.exp(theta * a) for value, a in zip(p, accelerations, strict=True)]
            return sum(w * a for w, a in zip(weights, accelerations, strict=True)) / sum(weights)

        goal = mean_above(0.0) + self.model.free_pull * halves / 2.0
        theta = brentq(lambda x: mean_above(x) - goal, -32.0, 32.0, xtol=1e-14)
        weights = [value * math.exp(theta * a) for value, a in zip(p, accelerations, strict=True)]
        return np.array([weight / sum(weights) for weight in weights], dtype=np.float32)

    def remember(self, word: int, before: float, habit: float) -> int:
        """The word that a follower's memory makes of a random one: one draw picks what is remembered, and how far off.

        Args:
            word: 32 random bits.
            before: Quantile of the second before.
            habit: Quantile that the driver tends to.
        """
        draw = unit(word)
        least = 0.0
        for weight, centre, width in self._kinds(before, habit):
            if least <= draw < least + weight:
                slope = 2.0 * width / weight
                return _word_at(fold(-width - slope * least + centre + slope * draw))
            least += weight
        slope = 1.0 / (1.0 - least)
        return word if least == 0.0 else _word_at(fold(-slope * least + slope * draw))

    def share_below(self, x: float, before: float, habit: float) -> float:
        """P(a follower's quantile is at most x).

        A folded number is at most x where it was, before folding, within x of 0 or of 2, whichever is nearer.
        """
        kinds = self._kinds(before, habit)
        share = x * (1.0 - sum(weight for weight, _, _ in kinds))
        for weight, centre, width in kinds:
            lengths = (
                min(high, centre + width) - max(low, centre - width) for low, high in ((-x, x), (2.0 - x, 2.0 + x))
            )
            share += weight * sum(max(0.0, length) for length in lengths) / (2.0 * width)
        return share

    def _kinds(self, before: float, habit: float) -> tuple[tuple[float, float, float], ...]:
        """(weight, centre, width) of all that may be remembered."""
        m = self.model.memory
        return (
            (m.near, before, m.near_width),
            (m.far, before, m.far_width),
            (m.habit, habit, m.habit_width),
        )

    def wish_to_change(self, speed: float, gap: float, range_rate: float) -> float:
        """Chance of wanting to one given side."""
        place = _grid_place(gap, range_rate)
        desire = self.model.lc_desire_free if place is None else float(self.model.lc_desire[place])
        return float(self.model.lc_base[_speed_place(speed)]) * desire

    def flees(self, gap: float, range_rate: float) -> float:
        """Chance that a driver in a running change turns back for one neighbour."""
        place = _grid_place(gap, range_rate)
        if gap <= 0.0:
            return 1.0
        return 0.0 if place is None else float(self.model.lc_turn_back[place])

    def accepts(self, gap: float, range_rate: float, *, rear: bool, overlook: float) -> float:
        """Chance to accept the gap to a neighbour, who is overlooked with chance `overlook`."""
        place = _grid_place(gap, range_rate)
        if gap <= 0.0:
            attentive = 0.0
        elif place is None:
            attentive = 1.0
        else:
            table = self.model.lc_accept_rear if rear else self.model.lc_accept_lead
            beside = math.floor(min(max(range_rate, -10.0), 7.999))
            between = min(max(range_rate - beside, 0.0), 1.0)
            slower, faster = (float(table[place[0], beside + 10 + more]) for more in (0, 1))
            attentive = (1.0 - between) * slower + between * faster
        return overlook + (1.0 - overlook) * attentive
