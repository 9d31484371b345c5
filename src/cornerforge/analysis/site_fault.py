"""Fault for a crash at a site: light, right of way, crosswalk, and RSS behind one another.

RSS says of routes that cross that right of way is given and not taken. So, for the AV and the agent that it touched:

1. *Light.* A vehicle whose front passes its stop line on red is at fault from then on, and has no right of way. A right
   turn on red after a stop is none, but yields to all.
2. *Right of way*, where the site says that one of two routes yields in the zone in which they met. The one that yields
   is at fault if, when it came into the zone, or into the other's way, the other was there, or would have been within
   `SHORT_GAP_S` at its speed, or could no longer stop before it: within its response time it speeds up, then it brakes
   with `min_braking` (RSS). Else the gap was enough. Where neither yields, the one that came later yields. One is in
   the other's way where the other would touch it by driving on along its route.
3. *Crosswalk.* A person that leaves the kerb on Walk goes first; where there is no light it does if the site says so
   and the AV could stop when it left. The AV is at fault if it comes into its way after that. Else the person is: on
   Don't Walk (flashing too), right before a vehicle, or into one that was in its way already.
4. *Nobody may drive on into danger.* A vehicle that goes first must brake for one that is in its way: from when that
   one is there, or on the road, in its sight, and it could not stop later, it has its response time, then brakes with
   at least `min_braking` until it stands. The AV sees what no vehicle hides (`SiteCase.hidden_by`).
5. *Following.* Front against rear on one way: the rules of RSS along it (`fault`), unless the one ahead came into the
   lane from a way that yields within the last `MERGED_S`; then rule 2.

A vehicle is at fault if it broke one of these; so one is, both are, or none is. Whether a vehicle could stop is judged
with the duties of `AT_SITE`: a driver that responds within 1 s (the AV within 0.5 s) and brakes with 4 m/s2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.fault import (
    BOTH,
    DID_NOT_BRAKE_FOR,
    DID_NOT_GIVE_WAY,
    DID_NOT_GIVE_WAY_TO_PERSON,
    DROVE_IN,
    LEFT_BEFORE,
    LEFT_ON_DONT_WALK,
    NO_RULE,
    RAN_RED,
    WALKED_INTO,
    Duties,
    Faults,
    RssRules,
    faults_of_motion,
)  # fmt: skip
from cornerforge.analysis.pair import PairMotion
from cornerforge.analysis.site_case import SiteCase, kind_at_site, site_case
from cornerforge.metrics.rss import rss_longitudinal
from cornerforge.recordings import Recordings
from cornerforge.site.tables import CROSS, GREEN
from cornerforge.types import FRAME_S, Odd

__all__ = ["AT_SITE", "Broken", "broken_at_site", "faults_at_site"]

AT_SITE = RssRules(av=Duties(0.5, 2.0, 4.0, 8.0, 8.0), bv=Duties(1.0, 2.0, 4.0, 8.0, 8.0))
"""Numbers of RSS at a site: all may brake as hard as they can, and must with 4 m/s2."""
SHORT_GAP_S = 3.0
"""Nobody is cut off by a gap that is longer [s]; 4 % of drivers take one so short to turn left (median 4.7 s)."""
MERGED_S = 3.0
"""One that came into a lane so short a while before is one that merged [s]."""
_STANDS = 0.1


@dataclass(frozen=True)
class Broken:
    """Rules that one agent and the other broke: place in `fault.RULES` and frame; and since when there was danger.

    Attributes:
        av, bv: Rule and frame of each one's first violation; (`NO_RULE`, 0) for none.
        since: Frame at which the danger began.
        first: First frame in which both are there.
    """

    av: tuple[int, int]
    bv: tuple[int, int]
    since: int
    first: int


def faults_at_site(recordings: Recordings, odd: Odd, rules: RssRules = AT_SITE) -> Faults:
    """Say which agent was at fault in each case at a site; the module's text states the rules.

    Raises:
        InputError: A case does not hold its contact.
    """
    found: list[Faults] = []
    for block in recordings.blocks(1):
        case = site_case(block, odd)
        broken = broken_at_site(case, rules)
        if broken is None:
            found.append(faults_of_motion(_in_line(case), block.case_ids, rules))
        else:
            found.append(_as_faults(broken, case, block.case_ids))
    return Faults.joined(recordings.case_ids, found)


def broken_at_site(case: SiteCase, rules: RssRules = AT_SITE) -> Broken | None:
    """Find the rules 1 to 4 that AV and partner broke; None: they followed one another, rule 5."""
    if case.zone is None or _follow(case):
        return None
    if case.is_person(case.partner):
        return _with_person(case, rules)
    return _of_vehicles(case, rules)


def _follow(case: SiteCase) -> bool:
    """Did one follow the other, by rule 5?"""
    kind = kind_at_site(case)
    if not kind.startswith("rear-end"):
        return False
    if case.route[0] == case.route[case.partner] or case.zone["kind"] == CROSS:
        return True
    entered = max(case.enters(0), case.enters(case.partner))
    yields = bool(case.zone["yields"]) or bool(case.zone["goes_first"])
    return not yields or (case.last - entered) * FRAME_S > MERGED_S


def _stops_within(speed: float, duties: Duties) -> float:
    """Way that a vehicle of a speed needs until it stands [m], by RSS."""
    return float(
        rss_longitudinal(
            np.array(speed), np.array(0.0), duties.response_time, duties.max_acceleration, duties.min_braking, 8.0
        )
    )


def _can_stop(case: SiteCase, i: int, frame: int, duties: Duties) -> bool:
    """Can agent i still stop before the other where that is? If it is not in its way, or has not come, it can.

    Before a person, who walks on: before the zone.
    """
    if np.isnan(case.s[frame, i]):
        return True
    room = case.room(i, frame)
    if case.is_person(case.partner):
        room = case.zone_of(i)[0] - float(case.s[frame, i])
    return room >= _stops_within(float(case.speed[frame, i]), duties)


def _is_cut_off(case: SiteCase, i: int, frame: int, duties: Duties) -> bool:
    """Is the gap too short for vehicle i, that goes first, when another comes into its way, or into the zone?"""
    speed = float(case.speed[frame, i])
    room = case.room(i, frame)
    if np.isinf(room):
        room = case.zone_of(i)[0] - float(case.s[frame, i])
    return bool(room < max(SHORT_GAP_S * speed, _stops_within(speed, duties) if speed > _STANDS else 0.0))


def _did_not_brake(case: SiteCase, i: int, since: int, duties: Duties) -> int:
    """Find when vehicle i did not brake for one that was in its way since a frame; -1: it did, or need not yet."""
    before = [f for f in range(since, case.last) if _can_stop(case, i, f, duties)]
    danger = before[-1] + 1 if before else since
    for frame in range(danger + round(duties.response_time / FRAME_S), case.last):
        change = (case.speed[frame + 1, i] - case.speed[frame, i]) / FRAME_S
        if case.speed[frame + 1, i] > _STANDS and change > 0.05 - duties.min_braking:
            return frame
    return -1


def _of_vehicles(case: SiteCase, rules: RssRules) -> Broken:
    other, duties = case.partner, {0: rules.av, case.partner: rules.bv}
    enters = {i: case.enters(i) for i in duties}
    red = {i: case.on_red(i) for i in duties}
    broken: dict[int, tuple[int, int]] = {i: (RAN_RED, red[i][1]) for i in duties if red[i][0]}
    yields = {0: bool(case.zone["yields"]), other: bool(case.zone["goes_first"])}
    for i, j in ((0, other), (other, 0)):
        if red[i][1] == -2:  # it turns right on red
            yields[i], yields[j] = True, False
    for i, j in ((0, other), (other, 0)):
        if red[i][0] and not red[j][0]:
            yields[i], yields[j] = True, False
    later = 0 if enters[0] > enters[other] else other
    if not any(yields.values()) and enters[0] != enters[other]:
        yields[later] = True
        rule = DROVE_IN
    else:
        rule = DID_NOT_GIVE_WAY
    since = min([*(frame for _, frame in broken.values()), *enters.values()])
    for i, j in ((0, other), (other, 0)):
        if not yields[i]:
            continue
        frame = enters[i]
        if rule == DROVE_IN:
            if i not in broken and _can_stop(case, i, min(enters[j], case.last), duties[i]):
                broken[i] = rule, frame
        elif i not in broken:
            soon = next((f for f in (case.comes_into_zone(i), frame) if _is_cut_off(case, j, f, duties[j])), frame)
            if frame >= enters[j] or _is_cut_off(case, j, soon, duties[j]):
                broken[i] = rule, soon
        seen = case.in_sight(frame) if j == 0 else frame
        late = _did_not_brake(case, j, seen, duties[j]) if seen < enters[j] else -1
        if late >= 0 and j not in broken:
            broken[j] = DID_NOT_BRAKE_FOR, late
    none = NO_RULE, 0
    return Broken(broken.get(0, none), broken.get(other, none), since, case.first)


def _with_person(case: SiteCase, rules: RssRules) -> Broken:
    person, duties = case.partner, rules.av
    left, entered = case.leaves_kerb(person), case.enters(0)
    red, when = case.on_red(0)
    av, other = (RAN_RED, when) if red else (NO_RULE, 0), (NO_RULE, 0)
    seen = max(left, case.first)
    if case.way(person).signal >= 0:
        first, excuse = case.walk(person, left) == GREEN, LEFT_ON_DONT_WALK
    else:
        first, excuse = (
            bool(case.zone["yields"]) and (left < case.first or _can_stop(case, 0, seen, duties)),
            LEFT_BEFORE,
        )
    if entered <= left and entered > case.first:
        other = WALKED_INTO, max(left, 0)
    elif not first and not red:
        other = excuse, max(left, 0)
    elif not red:
        av = DID_NOT_GIVE_WAY_TO_PERSON, entered
    if av[0] == NO_RULE and entered > left:
        late = _did_not_brake(case, 0, case.in_sight(seen), duties)
        av = (DID_NOT_BRAKE_FOR, late) if late >= 0 else av
    return Broken(av, other, min(seen, entered), case.first)


def _as_faults(broken: Broken, case: SiteCase, ids: tuple[str, ...]) -> Faults:
    """Write what was broken as the faults of one case."""
    (av, av_at), (bv, bv_at) = broken.av, broken.bv
    of_av = av != NO_RULE and (bv == NO_RULE or av_at <= bv_at)
    rule, frame = broken.av if of_av else broken.bv

    def before(at: int, known: bool) -> NDArray[np.float64]:
        return np.array([round((case.last - at) * FRAME_S, 1) if known else np.nan])

    code = BOTH if av != NO_RULE and bv != NO_RULE else 0 if av != NO_RULE else 1 if bv != NO_RULE else 3
    no = np.zeros(1, np.bool_)
    return Faults(
        ids, np.array([code], np.int8), np.array([rule], np.int8), before(frame, rule != NO_RULE),
        np.array([av], np.int8), np.array([bv], np.int8), before(av_at, av != NO_RULE), before(bv_at, bv != NO_RULE),
        before(broken.since, known=True), no, no, no, np.array([broken.since <= broken.first]),
    )  # fmt: skip


def _in_line(case: SiteCase) -> PairMotion:
    """Put AV and partner behind one another on a straight line, as far along the AV's way as they are."""
    first, pair = case.first, [0, case.partner]
    columns = np.maximum(np.arange(case.last + 1), first)
    x = np.stack([case.s[columns, 0], _along_av(case)[columns]])[:, None]
    speed = case.speed[columns][:, pair].T[:, None]
    length, width = case.sizes[pair, 0][:, None], case.sizes[pair, 1][:, None]
    free = np.abs(x[1] - x[0]) - 0.5 * length.sum(axis=0)
    zero = np.zeros_like(x)
    return PairMotion(
        x=x, y=zero, speed=speed, heading=zero, recorded=(np.arange(case.last + 1) >= first)[None],
        free_along=free, free_across=np.full_like(free, -0.5 * width.sum()), length=length, width=width,
    )  # fmt: skip


def _along_av(case: SiteCase) -> NDArray[np.float64]:
    """Give the partner's place along the AV's way [m], (T,): of a way that joins, as far before the join as it is."""
    if case.route[0] == case.route[case.partner] or case.zone is None or case.zone["kind"] == CROSS:
        return case.s[:, case.partner] + _offset(case)
    there: NDArray[np.float64] = case.zone["begin"] + case.s[:, case.partner] - case.zone["other_begin"]
    return there


def _offset(case: SiteCase) -> float:
    """Compute what makes the partner's place along its own way as far from the AV's as it is at the contact."""
    if case.route[0] == case.route[case.partner]:
        return 0.0
    dx, dy = (float(v[-1, case.partner] - v[-1, 0]) for v in (case.x, case.y))
    heading = float(case.heading[-1, 0])
    ahead = dx * np.cos(heading) + dy * np.sin(heading)
    return float(case.s[-1, 0] + ahead - case.s[-1, case.partner])
