"""Measures of every case: how near the AV came to others, and how hard the crash was. One row a case, in columns.

Definitions of the single measures stand in `metrics/`; the columns are documented in `MEASURES`, in the manner of
`library/schema.py`. NaN stands for null: the value does not exist.

A vehicle is in the AV's path if it overlaps the AV sideways, boxes taken as parallel to the road, in any frame before
the contact. It is level with the AV if its centre is less than half of both lengths together ahead or behind. The
partner is the vehicle that the AV touches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_number
from cornerforge.analysis.contact import find_contact
from cornerforge.analysis.fault import RssRules, pair_margins
from cornerforge.analysis.pair import AV, BV, PairMotion, pair_motion
from cornerforge.analysis.site_case import in_av_frame
from cornerforge.analysis.site_measures import path_velocity, straightened, until_both
from cornerforge.fields import Field
from cornerforge.metrics.delta_v import FRICTION, delta_v
from cornerforge.metrics.drac import drac
from cornerforge.metrics.injury import injury_probability
from cornerforge.metrics.pet import pet
from cornerforge.metrics.rss import rss_longitudinal, rss_margin
from cornerforge.metrics.thw import thw
from cornerforge.metrics.ttc import ttc
from cornerforge.recordings import Recordings
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Odd

__all__ = ["MEASURES", "Impact", "measure_cases"]


_INF = float("inf")
_RANGES = {
    "m": (-1e5, 1e5),
    "s": (0.0, _INF),
    "m/s": (0.0, 1e3),
    "m/s2": (0.0, _INF),
    "rad": (-4.0, 4.0),
    "": (0.0, 1.0),
}
"""Range of each unit, wide: values outside mean damage, not rarity."""


def _column(name: str, unit: str, meaning: str) -> Field:
    return Field(name, "float64", unit, meaning, _RANGES[unit])


def _or_null(name: str, unit: str, meaning: str) -> Field:
    return replace(_column(name, unit, meaning), nullable=True)


MEASURES: tuple[Field, ...] = (
    _or_null("min_bbd_front_m", "m", "Least bumper distance to the vehicle ahead in the AV's path; null: none."),
    _or_null("min_bbd_rear_m", "m", "Least bumper distance to the vehicle behind in the AV's path; null: none."),
    _or_null("min_ttc_front_s", "s", "Least TTC of the AV to a vehicle ahead in its path; null: none, or not closing."),
    _or_null("min_ttc_rear_s", "s", "Least TTC of the vehicle behind in the AV's path; null: none, never closing."),
    _or_null("min_thw_front_s", "s", "Least time headway of the AV to the vehicle ahead in its path; null: none."),
    _or_null("min_thw_rear_s", "s", "Least time headway of the vehicle behind in the AV's path; null: none, standing."),
    _or_null(
        "max_drac_front_mps2", "m/s2",
        "Most braking that the AV needed for the vehicle ahead in its path; 0: never closing; inf: level; null: none.",
    ),
    _or_null(
        "max_drac_rear_mps2", "m/s2",
        "Most braking that the vehicle behind in the AV's path needed; 0: never closing; inf: level; null: none.",
    ),
    _or_null(
        "min_rss_margin_front_m", "m",
        "Least room beyond the RSS distance of the AV to the vehicle ahead in its path; < 0: unsafe; null: none.",
    ),
    _or_null(
        "min_rss_margin_rear_m", "m",
        "Least room beyond the RSS distance of the vehicle behind in the AV's path; < 0: unsafe; null: none.",
    ),
    _or_null(
        "min_rss_margin_m", "m",
        "Least RSS margin of AV and partner before contact, that along or across, whichever is larger; < 0: danger; "
        "null: no frame.",
    ),
    _or_null("rss_margin_1s_m", "m", "That margin 1 s before contact; null: not recorded then."),
    _or_null("bbd_1s_m", "m", "BBD to the partner 1 s before contact, in any lane, at a site "
              "between the middles less both half lengths; < 0: level; null: not recorded."),
    _or_null("ttc_1s_s", "s", "TTC with the partner then, in any lane, at a site by closing of "
              "the middles; 0: level; null: not closing or not recorded."),
    _or_null(
        "pet_s", "s",
        "From one entering the other's path until the rear one is where the front one's rear was then; 0: level; null: "
        "they were in one path from the start.",
    ),
    _column("impact_speed_mps", "m/s", "Size of the relative velocity of AV and partner at contact."),
    _column("impact_angle_rad", "rad", "Angle between the headings at contact, in [0, pi]; 0: the same direction."),
    _column(
        "av_force_direction_rad", "rad",
        "Where the force on the AV comes from, from its heading counter-clockwise, in [-pi, pi]: 0 ahead, pi/2 left; "
        "0 without an impact.",
    ),
    _column("bv_force_direction_rad", "rad", "The same of the partner."),
    _column("av_delta_v_mps", "m/s", "Change of the AV's velocity; too large for a blow past its centre of mass."),
    _column("bv_delta_v_mps", "m/s", "The same of the partner."),
    _column("av_injury_probability", "", "P(MAIS 3+) of an occupant of the AV, by delta-v and the force's direction."),
    _column("bv_injury_probability", "", "The same of the partner."),
)  # fmt: skip
"""Columns that `measure_cases` makes, in its order."""

_BLOCK = 128  # as in fault.py
_SECOND = round(1.0 / FRAME_S)


@dataclass(frozen=True)
class Impact:
    """Assumptions about an impact; by default it is perfectly plastic, with friction, between equal masses.

    A vehicle's class and size do not change its mass.

    Attributes:
        av_mass: Relative to `bv_mass`, in any unit.
        bv_mass: Mass of the BV, in the same unit.
        restitution: 0 plastic, 1 elastic.
        friction: Between the two bodies where they slide along each other.

    Raises:
        InputError: A value is out of range.
    """

    av_mass: float = 1.0
    bv_mass: float = 1.0
    restitution: float = 0.0
    friction: float = FRICTION

    def __post_init__(self) -> None:
        check_number("impact.av_mass", self.av_mass, low=1e-6, high=1e6)
        check_number("impact.bv_mass", self.bv_mass, low=1e-6, high=1e6)
        check_number("impact.restitution", self.restitution, low=0.0, high=1.0)
        check_number("impact.friction", self.friction, low=0.0, high=1e3)


def measure_cases(
    recordings: Recordings, rules: RssRules | None = None, impact: Impact | None = None, odd: Odd | None = None
) -> dict[str, NDArray[np.float64]]:
    """Measure every case.

    Args:
        recordings: The cases.
        rules: Numbers of RSS; None: the default ones.
        impact: Masses and restitution; None: equal masses, perfectly plastic.
        odd: Of the cases; without one they are of a road. At a site those are in the AV's path that are in its lane
            along its route, and measures of the pair that only a common lane gives are null.

    Returns:
        A column of shape (S,) for each of `MEASURES`, in their order; NaN for null. Mirroring a road (left for right)
        changes nothing but the signs of the two force directions, and with them near and far side.

    Raises:
        InputError: A case does not hold its contact (see `pair_motion`).
    """
    chosen, crash = rules or RssRules(), impact or Impact()
    parts = []
    for block in recordings.blocks(_BLOCK):
        motion = pair_motion(block)
        if odd is not None and odd.site is not None:
            nothing = np.full(block.n_cases, np.nan)
            of_pair = dict.fromkeys(("min_rss_margin_m", "rss_margin_1s_m", "pet_s"), nothing) | until_both(motion)
            parts.append(
                _in_path(straightened(block, odd), chosen) | of_pair | _at_contact(motion, crash, path_velocity(motion))
            )
            continue
        parts.append(_in_path(block, chosen) | _of_pair(motion, chosen) | _at_contact(motion, crash))
    return {column.name: np.concatenate([np.empty(0), *(part[column.name] for part in parts)]) for column in MEASURES}


def _in_path(recordings: Recordings, rules: RssRules) -> dict[str, NDArray[np.float64]]:
    """Worst values over all frames before the contact and all vehicles in the AV's path."""
    entry, of_av, case, half_lengths = _entries_in_path(recordings)
    r = recordings
    dx = along(r.x[of_av], r.x[entry].astype(np.float64))
    ahead = dx > 0.0
    own, other = r.speed[of_av].astype(np.float64), r.speed[entry].astype(np.float64)
    distance = np.abs(dx) - half_lengths
    av, bv = rules.av, rules.bv
    found: dict[str, NDArray[np.float64]] = {}
    for side, chosen in (("front", np.flatnonzero(ahead)), ("rear", np.flatnonzero(~ahead))):
        subject, lead = (own, other) if side == "front" else (other, own)
        follower, leader = (av, bv) if side == "front" else (bv, av)
        bbd, v, v_lead = distance[chosen], subject[chosen], lead[chosen]
        safe = rss_longitudinal(
            v, v_lead, follower.response_time, follower.max_acceleration, follower.min_braking, leader.max_braking
        )
        worst = _Worst(case[chosen], r.n_cases)
        found[f"min_bbd_{side}_m"] = worst.least(bbd)
        found[f"min_ttc_{side}_s"] = _null_if_infinite(worst.least(ttc(bbd, v_lead - v)))
        found[f"min_thw_{side}_s"] = _null_if_infinite(worst.least(thw(bbd, v)))
        found[f"max_drac_{side}_mps2"] = worst.most(drac(bbd, v_lead - v))
        found[f"min_rss_margin_{side}_m"] = worst.least(rss_margin(bbd, safe))
    return found


def _entries_in_path(
    recordings: Recordings,
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Find the entries of others in the AV's path before contact, ascending.

    Returns them, the AV's entries at the same frames, their cases, and half of both vehicles' lengths together [m].
    """
    r = recordings
    frames = np.repeat(r.frames, r.vehicles)
    begin = np.cumsum(frames) - frames
    of_case = np.repeat(np.arange(r.n_cases), r.vehicles)
    av = r.vehicle_at[of_case]
    vehicle = np.repeat(np.arange(frames.size), frames)
    entry = np.arange(r.x.size)
    of_av = entry - (begin - r.at[of_case])[vehicle]  # from a vehicle's series back to the AV's in its case
    chosen = r.present & (np.abs(r.y - r.y[of_av]) < (0.5 * (r.width[av] + r.width))[vehicle])
    chosen &= (of_av != entry) & (entry < (begin + r.last[of_case])[vehicle])
    found = np.flatnonzero(chosen)
    who = vehicle[found]
    return found, of_av[found], of_case[who], (0.5 * (r.length[av] + r.length))[who]


class _Worst:
    """Minimum and maximum over the values of each case, which lie side by side; NaN where a case has none."""

    def __init__(self, case: NDArray[np.intp], n: int) -> None:
        self._n = n
        is_first = np.ones(case.size, np.bool_)
        is_first[1:] = np.diff(case) != 0
        self._first = np.flatnonzero(is_first)
        self._case = case[self._first]

    def least(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._spread(np.minimum.reduceat(values, self._first) if self._first.size else np.empty(0))

    def most(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._spread(np.maximum.reduceat(values, self._first) if self._first.size else np.empty(0))

    def _spread(self, found: NDArray[np.float64]) -> NDArray[np.float64]:
        result = np.full(self._n, np.nan)
        result[self._case] = found
        return result


def _null_if_infinite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isinf(values), np.nan, values)


def _of_pair(motion: PairMotion, rules: RssRules) -> dict[str, NDArray[np.float64]]:
    """Measures between the AV and its crash partner before the contact."""
    longitudinal, lateral = pair_margins(motion, rules)
    margin = np.where(motion.recorded, np.maximum(longitudinal, lateral), np.nan)[:, :-1]
    least = np.min(margin, axis=1, initial=np.inf, where=~np.isnan(margin))
    found = {
        "min_rss_margin_m": _null_if_infinite(least),
        "pet_s": _encroachment(motion),
    }
    column = motion.recorded.shape[1] - 1 - _SECOND
    nothing = np.full(len(least), np.nan)
    if column < 0:
        return found | {"rss_margin_1s_m": nothing, "bbd_1s_m": nothing, "ttc_1s_s": nothing}
    known = motion.recorded[:, column]
    dx = along(motion.x[AV, :, column], motion.x[BV, :, column])
    bbd = np.abs(dx) - motion.half_lengths
    rate = (motion.speed[BV, :, column] - motion.speed[AV, :, column]) * np.sign(dx)
    found["rss_margin_1s_m"] = margin[:, column]
    found["bbd_1s_m"] = np.where(known, bbd, np.nan)
    found["ttc_1s_s"] = np.where(known, _null_if_infinite(ttc(bbd, rate)), np.nan)
    return found


def _encroachment(motion: PairMotion) -> NDArray[np.float64]:
    """Post-encroachment time of AV and partner; the conflict area is where the front one's rear was on entering.

    A pair that never overlaps sideways as parallel boxes touched with a corner, side by side.
    """
    apart = (np.abs(motion.y[BV] - motion.y[AV]) >= motion.half_widths[:, None]) & motion.recorded
    n, contact = apart.shape[0], apart.shape[1] - 1
    rows = np.arange(n)
    last_apart = np.where(apart, np.arange(contact + 1), -1).max(axis=1)
    entered = np.minimum(last_apart + 1, contact)
    dx = along(motion.x[AV, rows, entered], motion.x[BV, rows, entered])
    front = np.where(dx > 0.0, BV, AV)
    mark = along(0.5 * motion.length[front, rows], motion.x[front, rows, entered])
    behind = 1 - front
    bumper = along(-0.5 * motion.length[behind, rows][:, None], motion.x[behind, rows])
    past = (bumper >= mark[:, None]) & (np.arange(contact + 1) >= entered[:, None])
    reached = np.where(past.any(axis=1), past.argmax(axis=1), contact)
    before = np.maximum(reached - 1, entered)
    here, earlier = bumper[rows, reached], bumper[rows, before]
    moved = np.where(here > earlier, here - earlier, 1.0)
    part = np.where(before < reached, np.clip((mark - earlier) / moved, 0.0, 1.0), 0.0)
    # On a clock that starts when one enters: then its rear leaves the mark, at once.
    between = pet(0.0, 0.0, (before - entered + part) * FRAME_S, np.inf)
    return np.where(last_apart < 0, np.nan, between)


def _at_contact(
    motion: PairMotion, impact: Impact, along_ways: NDArray[np.float64] | None = None
) -> dict[str, NDArray[np.float64]]:
    """Speeds, directions and severity of the impact, from the velocities in the contact's frame.

    `along_ways`: these velocities at a site, (2, S, 2).
    """
    heading = motion.heading[:, :, -1]
    lengthwise = motion.speed[:, :, -1]  # that along the road; a heading is the direction of the path
    velocity = np.stack([lengthwise, lengthwise * np.tan(heading)], axis=-1) if along_ways is None else along_ways
    relative = velocity[BV] - velocity[AV]
    between = np.abs((heading[BV] - heading[AV] + math.pi) % (2.0 * math.pi) - math.pi)
    found = {"impact_speed_mps": np.hypot(relative[:, 0], relative[:, 1]), "impact_angle_rad": between}
    pose = np.stack([motion.x[:, :, -1], motion.y[:, :, -1], lengthwise, heading], axis=-1).swapaxes(0, 1)
    if along_ways is None:
        normal = find_contact(pose, motion.length.T, motion.width.T).normal
    else:
        turned = find_contact(in_av_frame(pose), motion.length.T, motion.width.T).normal
        cos, sin = np.cos(heading[AV]), np.sin(heading[AV])
        normal = np.stack([turned[:, 0] * cos - turned[:, 1] * sin, turned[:, 0] * sin + turned[:, 1] * cos], axis=-1)
    apart = (relative * normal).sum(axis=1)
    closing = np.maximum(0.0, -apart)
    slide = relative - apart[:, None] * normal  # of the BV along the AV's face, which friction pulls with it
    sliding = np.hypot(slide[:, 0], slide[:, 1])
    direction = slide / np.where(sliding > 0.0, sliding, 1.0)[:, None]
    masses = (impact.av_mass, impact.bv_mass)
    for who, name in ((AV, "av"), (BV, "bv")):
        sign = 1.0 if who == AV else -1.0
        across, rubbed = delta_v(closing, sliding, masses[who], masses[1 - who], impact.restitution, impact.friction)
        push = sign * (rubbed[:, None] * direction - across[:, None] * normal)
        change = np.hypot(push[:, 0], push[:, 1])
        came_from = np.arctan2(-push[:, 1], -push[:, 0]) - heading[who]
        came_from = np.where(change > 0.0, np.arctan2(np.sin(came_from), np.cos(came_from)), 0.0)
        found[f"{name}_force_direction_rad"] = came_from
        found[f"{name}_delta_v_mps"] = change
        found[f"{name}_injury_probability"] = injury_probability(change, came_from)
    return found
