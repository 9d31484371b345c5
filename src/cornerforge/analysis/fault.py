"""Fault for a crash, found by the rules of responsibility-sensitive safety, RSS, from the recorded motion.

Definitions follow Shalev-Shwartz, Shammah and Shashua (2017), arXiv:1708.06374; what they leave open, and why our
numbers are what they are, stands in docs/adr/0015-fault.md. For the AV and the vehicle that it touched first:

1. A moment is *dangerous* when both the longitudinal and the lateral distance are below the safe one.
2. The danger that ended in the crash began, on each axis, after the last moment at which that axis was safe. The later
   of the two is the *blame time*, and its axis says which rule holds from there on (both, if they coincide).
3. *Proper response*. Longitudinal: the vehicle behind at the blame time accelerates with at most `max_acceleration`
   until its response time is over and then brakes with at least `min_braking`, until it stands; the one ahead does not
   brake harder than `max_braking`. Lateral: both accelerate at most with `lateral_acceleration` towards each other
   until their response times are over; then a vehicle that still moves towards the other brakes laterally with at
   least `lateral_braking`, and any other does not begin to move so, unless the two overlap sideways already.
4. A vehicle is at fault if it broke a rule that held for it at any time from the blame time to the contact. So one
   is, both are, or none is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._schema import check_fields, meant
from cornerforge.analysis.pair import AV, BV, PairMotion, pair_motion
from cornerforge.fields import BEFORE_CONTACT, Field
from cornerforge.metrics.rss import rss_lateral, rss_longitudinal, rss_margin
from cornerforge.recordings import Recordings
from cornerforge.results.analysis import FAULTS
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Odd

__all__ = [
    "FAULTS", "FAULT_COLUMNS", "RULES", "Duties", "Faults", "RssRules", "assign_fault", "faults_of_motion",
    "pair_margins",
]  # fmt: skip

RULES = (
    "none",
    "longitudinal: vehicle behind did not brake",
    "longitudinal: vehicle behind sped up",
    "longitudinal: vehicle ahead braked harder than allowed",
    "lateral: moved in below the safe distance",
    "lateral: did not stop moving in",
    "light: passed the stop line on red",
    "right of way: did not give way to a vehicle",
    "right of way: did not give way to a person on a crosswalk",
    "right of way: did not brake for one in its way",
    "right of way: drove in before another had left",
    "person: left the kerb on Don't Walk",
    "person: left the kerb right before a vehicle",
    "person: walked into a vehicle that was there",
)
"""Rules by which a vehicle can be at fault; `Faults.rule`, `av_rule` and `bv_rule` hold places in this tuple."""

FAULT_COLUMNS: tuple[Field, ...] = (
    Field("fault", "string", "", f"Who broke a rule of RSS, or of the site: {', '.join(FAULTS)}."),
    Field("fault_rule", "string", "", "The rule that was broken first; \"none\" where neither broke one."),
    Field("fault_s", "float64", "s", "When it was first broken, before contact; null: neither broke one.",
          BEFORE_CONTACT, nullable=True),
    Field("av_rule", "string", "", "The rule that the AV broke first, or \"none\"."),
    Field("av_fault_s", "float64", "s", "When, before contact; null: none.", BEFORE_CONTACT, nullable=True),
    Field("bv_rule", "string", "", "The rule that the crash partner broke first, or \"none\"."),
    Field("bv_fault_s", "float64", "s", "When, before contact; null: none.", BEFORE_CONTACT, nullable=True),
    Field("blame_axis", "string", "", "Whose rules held: longitudinal, lateral, or both; at a site "
          "longitudinal, or right of way."),
    Field("blame_s", "float64", "s", "How long the danger lasted that ended in the crash.", BEFORE_CONTACT),
    Field("blame_from_start", "bool", "", "The danger is older than the recording, so all this is less sure."),
)  # fmt: skip
"""Columns that `Faults.columns` makes, in its order."""

NO_RULE = 0
_NONE, _DID_NOT_BRAKE, _SPED_UP, _BRAKED_HARD, _MOVED_IN, _DID_NOT_STOP = range(6)
(
    RAN_RED, DID_NOT_GIVE_WAY, DID_NOT_GIVE_WAY_TO_PERSON, DID_NOT_BRAKE_FOR, DROVE_IN, LEFT_ON_DONT_WALK, LEFT_BEFORE,
    WALKED_INTO,
) = range(6, len(RULES))  # fmt: skip
BOTH = 2
"""Place in `FAULTS`."""

_BLOCK = 128
"""Cases at a time: few enough that their arrays stay in the processor's cache, which halves the time."""
# Accelerations are differences of recorded float32 values, wrong by up to 0.001 m/s2. Actions are 0.2 m/s2 apart, so
# this tells them apart, and no rounding error becomes a fault.
_ACCELERATION_TOLERANCE = 0.05
_SPEED_TOLERANCE = 0.05


@dataclass(frozen=True)
class Duties:
    """Numbers that RSS assumes of a vehicle, and duties that it gives it.

    Raises:
        InputError: A value is out of range.
    """

    response_time: Annotated[float, meant("Time until it reacts to danger (rho).", "s", 0, 5)]
    max_acceleration: Annotated[float, meant("Its largest acceleration meanwhile.", "m/s2", 0, 10)]
    min_braking: Annotated[float, meant("Its least braking afterwards, when it is behind.", "m/s2", 0.1, 12)]
    max_braking: Annotated[float, meant("The hardest that it may brake when it is ahead.", "m/s2", 0.1, 12)]
    hardest_braking: Annotated[
        float, meant("The hardest that it can brake; doing so fulfils any `min_braking`.", "m/s2", 0.1, 12)
    ]

    def __post_init__(self) -> None:
        check_fields(self, "duties.")


@dataclass(frozen=True)
class RssRules:
    """All numbers of the rules; the paper leaves them open (values and reasons: docs/adr/0015-fault.md).

    Attributes:
        av: The AV's duties.
        bv: A BV's duties.
        free_evasion: A vehicle that did not move in may steer either way once the two overlap sideways; False: as the
            RSS paper says it.

    Raises:
        InputError: A value is out of range.
    """

    av: Duties = Duties(0.5, 2.0, 4.0, 6.0, 8.0)
    bv: Duties = Duties(1.0, 2.0, 6.0, 4.0, 4.0)
    lateral_acceleration: Annotated[
        float, meant("The most that a vehicle may accelerate towards another while it responds.", "m/s2", 0, 10)
    ] = 0.2
    lateral_braking: Annotated[
        float, meant("Its least lateral braking afterwards, while it still moves towards the other.", "m/s2", 0.1, 10)
    ] = 0.8
    lateral_margin: Annotated[float, meant("Space that must be left beside a vehicle (mu).", "m", 0, 1)] = 0.1
    free_evasion: bool = True

    def __post_init__(self) -> None:
        check_fields(self, "rules.")


@dataclass(frozen=True)
class Faults:
    """The fault in each case. Times are before the contact [s]; a later violation has a smaller one.

    Attributes:
        case_ids: Names of the cases, length S.
        fault: Places in `FAULTS`, int8, shape (S,).
        rule: Place in `RULES` of the first violation of all, int8, shape (S,); the AV's if both began at once.
        violation_s: Its time, shape (S,); NaN where no rule was broken.
        av_rule, bv_rule: Place in `RULES` of each vehicle's own first violation, int8, shape (S,).
        av_violation_s, bv_violation_s: Their times, shape (S,); NaN where it broke none.
        blame_s: Blame time, shape (S,): how long the danger lasted that ended in the crash.
        longitudinal, lateral: Whether the longitudinal and the lateral rules held, bool, shape (S,); at a site neither
            did where it was about right of way.
        av_behind: The AV's centre was behind the partner's at the blame time, bool, shape (S,).
        from_start: The danger was there from the first recorded frame on, so that the true blame time is earlier and
            which rule held is not known for certain, bool, shape (S,).
    """

    case_ids: tuple[str, ...]
    fault: NDArray[np.int8]
    rule: NDArray[np.int8]
    violation_s: NDArray[np.float64]
    av_rule: NDArray[np.int8]
    bv_rule: NDArray[np.int8]
    av_violation_s: NDArray[np.float64]
    bv_violation_s: NDArray[np.float64]
    blame_s: NDArray[np.float64]
    longitudinal: NDArray[np.bool_]
    lateral: NDArray[np.bool_]
    av_behind: NDArray[np.bool_]
    from_start: NDArray[np.bool_]

    def columns(self) -> dict[str, NDArray[Any]]:
        """A column of shape (S,) for each of `FAULT_COLUMNS`, in their order."""
        faults, rules = np.array(FAULTS), np.array(RULES)
        alone = np.where(self.lateral, "lateral", np.where(self.longitudinal, "longitudinal", "right of way"))
        axis = np.where(self.longitudinal & self.lateral, "both", alone)
        return {
            "fault": faults[self.fault],
            "fault_rule": rules[self.rule],
            "fault_s": self.violation_s,
            "av_rule": rules[self.av_rule],
            "av_fault_s": self.av_violation_s,
            "bv_rule": rules[self.bv_rule],
            "bv_fault_s": self.bv_violation_s,
            "blame_axis": axis,
            "blame_s": self.blame_s,
            "blame_from_start": self.from_start,
        }

    @classmethod
    def joined(cls, case_ids: tuple[str, ...], parts: list[Faults]) -> Faults:
        """Put faults of several cases one after the other."""
        names = [name for name in cls.__dataclass_fields__ if name != "case_ids"]
        parts = parts or [_no_faults()]
        return cls(case_ids, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def counts(self) -> dict[str, int]:
        """Cases by value of `FAULTS`, zeros included."""
        return {name: int((self.fault == index).sum()) for index, name in enumerate(FAULTS)}

    def rule_counts(self) -> dict[str, int]:
        """Cases by the first violation's rule, zeros included."""
        return {name: int((self.rule == index).sum()) for index, name in enumerate(RULES)}


def pair_margins(motion: PairMotion, rules: RssRules) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give the margins of a pair over the safe distances, longitudinal and lateral [m], shape (S, T) each.

    Below 0 is unsafe; overlap always is.
    """
    dx = along(motion.x[AV], motion.x[BV])
    av, bv, v_av, v_bv = rules.av, rules.bv, motion.speed[AV], motion.speed[BV]
    behind = rss_longitudinal(v_av, v_bv, av.response_time, av.max_acceleration, av.min_braking, bv.max_braking)
    ahead = rss_longitudinal(v_bv, v_av, bv.response_time, bv.max_acceleration, bv.min_braking, av.max_braking)
    longitudinal = rss_margin(motion.free_along, np.where(dx > 0.0, behind, ahead))
    dy = motion.y[BV] - motion.y[AV]
    sideways, side = _sideways_speed(motion), np.sign(dy)
    needed = rss_lateral(
        sideways[AV] * side, -sideways[BV] * side, av.response_time, bv.response_time,
        rules.lateral_acceleration, rules.lateral_braking, rules.lateral_margin,
    )  # fmt: skip
    return longitudinal, rss_margin(motion.free_across, needed)


def _sideways_speed(motion: PairMotion) -> NDArray[np.float64]:
    """Lateral speed [m/s] by central differences, one-sided at both ends of the recording, shape (2, S, T)."""
    if motion.y.shape[-1] == 1:
        return np.zeros_like(motion.y)
    speed = np.gradient(motion.y, FRAME_S, axis=-1)
    first = motion.recorded.argmax(axis=1)
    rows = np.flatnonzero(first > 0)
    speed[:, rows, first[rows]] *= 2.0  # the frame before repeats it, so half of a one-sided difference is there
    return speed


def assign_fault(recordings: Recordings, rules: RssRules | None = None, odd: Odd | None = None) -> Faults:
    """Say which vehicle was at fault in each case; the module's text states the rules.

    Args:
        recordings: The cases.
        rules: Numbers of the rules; None: the default ones.
        odd: Of the cases; without one they are of a road.

    Returns:
        One entry per case. Mirroring a road (left for right) changes nothing. "none" means that both responded
        properly, or that the crash came before they had to.

    Raises:
        InputError: A case does not hold its contact (see `pair_motion`).
    """
    if odd is not None and odd.site is not None:
        from cornerforge.analysis.site_fault import AT_SITE, faults_at_site  # here, because it stands on this module

        return faults_at_site(recordings, odd, rules or AT_SITE)
    chosen = rules or RssRules()
    blocks = recordings.blocks(_BLOCK)
    return Faults.joined(
        recordings.case_ids, [faults_of_motion(pair_motion(block), block.case_ids, chosen) for block in blocks]
    )


def _no_faults() -> Faults:
    code, time, yes = np.empty(0, np.int8), np.empty(0), np.empty(0, np.bool_)
    return Faults((), code, code, time, code, code, time, time, time, yes, yes, yes, yes)


def faults_of_motion(motion: PairMotion, case_ids: tuple[str, ...], rules: RssRules) -> Faults:
    """Say which of two vehicles along a road was at fault, from their motion."""
    longitudinal_margin, lateral_margin = pair_margins(motion, rules)
    contact = motion.recorded.shape[1] - 1
    safe_lon = _last_safe(longitudinal_margin, motion.recorded)
    safe_lat = _last_safe(lateral_margin, motion.recorded)
    first = motion.recorded.argmax(axis=1)
    blame = np.maximum(np.maximum(safe_lon, safe_lat), first)
    from_start = np.maximum(safe_lon, safe_lat) < first
    by_lon, by_lat = safe_lon >= safe_lat, safe_lat >= safe_lon
    rows = np.arange(len(case_ids))
    av_behind = motion.x[BV, rows, blame] > motion.x[AV, rows, blame]
    side = np.sign(motion.y[BV, rows, blame] - motion.y[AV, rows, blame])
    broken = [
        _broken_rules(motion, vehicle, duties, rules, blame, by_lon, by_lat, is_behind, towards)
        for vehicle, duties, is_behind, towards in (
            (AV, rules.av, av_behind, side),
            (BV, rules.bv, ~av_behind, -side),
        )
    ]
    (av_rule, av_frame), (bv_rule, bv_frame) = (_first(rules_of_one) for rules_of_one in broken)
    av_broke, bv_broke = av_rule != _NONE, bv_rule != _NONE
    of_av = av_broke & (~bv_broke | (av_frame <= bv_frame))
    frame = np.where(of_av, av_frame, bv_frame)
    fault = np.select([av_broke & bv_broke, av_broke, bv_broke], [2, 0, 1], default=3)
    return Faults(
        case_ids=case_ids,
        fault=fault.astype(np.int8),
        rule=np.where(of_av, av_rule, bv_rule),
        violation_s=_before_contact(frame, contact, av_broke | bv_broke),
        av_rule=av_rule,
        bv_rule=bv_rule,
        av_violation_s=_before_contact(av_frame, contact, av_broke),
        bv_violation_s=_before_contact(bv_frame, contact, bv_broke),
        blame_s=_before_contact(blame, contact, np.ones(len(rows), np.bool_)),
        longitudinal=by_lon,
        lateral=by_lat,
        av_behind=av_behind,
        from_start=from_start,
    )


def _last_safe(margin: NDArray[np.float64], recorded: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Column of the last recorded frame that was safe, -1 if none was. The contact is not safe, at any margin."""
    columns = np.arange(margin.shape[1] - 1)
    return np.asarray(np.where((margin[:, :-1] >= 0.0) & recorded[:, :-1], columns, -1).max(axis=1, initial=-1))


def _before_contact(frame: NDArray[np.intp], contact: int, known: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.where(known, np.round((contact - frame) * FRAME_S, 1), np.nan)


def _broken_rules(
    motion: PairMotion,
    vehicle: int,
    duties: Duties,
    rules: RssRules,
    blame: NDArray[np.intp],
    by_lon: NDArray[np.bool_],
    by_lat: NDArray[np.bool_],
    is_behind: NDArray[np.bool_],
    towards: NDArray[np.float64],
) -> NDArray[np.int8]:
    """The rule that one vehicle breaks from each frame to the next, `_NONE` where it keeps them, shape (S, T - 1).

    Args:
        motion: Motion of the pair.
        vehicle: `AV` or `BV`.
        duties: The vehicle's.
        rules: All numbers.
        blame: Column of the blame time, shape (S,).
        by_lon, by_lat: Which rules hold, shape (S,).
        is_behind: The vehicle is the one behind, shape (S,).
        towards: Side of the other at the blame time: 1 left, -1 right, 0 neither, shape (S,).
    """
    columns = np.arange(motion.recorded.shape[1] - 1)
    since = columns - blame[:, None]
    responding = since < round(duties.response_time / FRAME_S)
    holds = since > 0
    acceleration = np.diff(motion.speed[vehicle], axis=-1) / FRAME_S
    moving = motion.speed[vehicle, :, 1:] > _SPEED_TOLERANCE
    duty = min(duties.min_braking, duties.hardest_braking)
    lon, behind = holds & by_lon[:, None], is_behind[:, None]
    sped_up = lon & behind & responding & (acceleration > duties.max_acceleration + _ACCELERATION_TOLERANCE)
    no_braking = lon & behind & ~responding & moving & (acceleration > _ACCELERATION_TOLERANCE - duty)
    braked_hard = lon & ~behind & (acceleration < -duties.max_braking - _ACCELERATION_TOLERANCE)
    lat = holds & by_lat[:, None]
    moved_in, kept_on = _broken_sideways(motion, vehicle, rules, since, responding, towards)
    conditions = [no_braking, sped_up, braked_hard, lat & moved_in, lat & kept_on]
    codes = [_DID_NOT_BRAKE, _SPED_UP, _BRAKED_HARD, _MOVED_IN, _DID_NOT_STOP]
    return np.select(conditions, codes, default=_NONE).astype(np.int8)


def _broken_sideways(
    motion: PairMotion,
    vehicle: int,
    rules: RssRules,
    since: NDArray[np.intp],
    responding: NDArray[np.bool_],
    towards: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Say from each frame to the next whether a vehicle moves in, and whether it fails to stop, shape (S, T - 1) each.

    Once the two overlap sideways, a vehicle that was not moving in by itself may steer either way (`free_evasion`): it
    can no longer enter the other's path, only leave it.
    """
    steps = np.diff(motion.y[vehicle], axis=-1) / FRAME_S * towards[:, None]
    # The speed at a frame is the mean over the 0.1 s before it: what was decided later cannot be blamed on it.
    approach = np.concatenate([np.zeros((len(steps), 1)), steps], axis=-1)
    change = np.diff(approach, axis=-1) / FRAME_S
    moves, moves_on = approach[:, :-1] > _SPEED_TOLERANCE, approach[:, 1:] > _SPEED_TOLERANCE
    holds = (motion.free_across[:, :-1] >= 0.0) | (not rules.free_evasion)
    ever_since = np.logical_and.accumulate(moves | (since < 0), axis=1)
    gains = change > rules.lateral_acceleration + _ACCELERATION_TOLERANCE
    moved_in = holds & np.where(responding, gains, ~moves & moves_on)
    kept_on = (holds | ever_since) & ~responding & moves & moves_on
    kept_on &= change > _ACCELERATION_TOLERANCE - rules.lateral_braking
    return moved_in, kept_on


def _first(broken: NDArray[np.int8]) -> tuple[NDArray[np.int8], NDArray[np.intp]]:
    """The first rule that was broken and its column, (`_NONE`, 0) where none was."""
    if broken.shape[1] == 0:
        return np.full(len(broken), _NONE, np.int8), np.zeros(len(broken), np.intp)
    frame = (broken != _NONE).argmax(axis=1)
    return broken[np.arange(len(broken)), frame], frame
