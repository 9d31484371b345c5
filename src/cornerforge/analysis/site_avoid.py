"""Ways out and a careful driver at a site, where the AV's path is its route (docs/adr/0085-judges-at-sites.md).

*Avoidability*. The AV may choose its accelerations; the others drive as recorded, and after the contact as
`counterfactual.at_site.carry_on` says. A way out is driven as the simulator drives and touches nobody at any tenth of a
second until the end of the horizon: it is exact. That there is none is said only where the set of all that the AV can
reach, bounded from outside, is empty from the begin of the manoeuvre on; else the answer is "undecided".

*Begin of the manoeuvre*. Of routes that cross or join: when the one at fault began to come into the other's way: a
person when it left the kerb, a vehicle when it could no longer stop before the zone (a red light: its line) with
4 m/s2; if the AV is at fault it is its own manoeuvre. Behind one another: as on roads, the braking of the one ahead, or
since when the one behind was faster.

*A careful driver*: `cc-human` of UN Regulation 157, the others of `CAREFUL` know lanes and are left out. The regulation
gives no driver for crossing traffic or people; it asks for no crash with a person that crosses at up to 5 km/h before a
vehicle of up to 60 km/h (5.2.5.3). So this is stated here: the driver keeps the rules that it is bound by (it stops
before the zone, or the line, with 3 m/s2 at most where the AV did not), but knows of nothing that a vehicle that moves
hides; where one stands it stops too: none may pass a vehicle that stands at a crosswalk (Uniform Vehicle Code,
11-502(d)). It sees danger when the other is in sight, on the road (a person) or could stop no longer with 4 m/s2 (a
vehicle), and both would be in the zone within 0.5 s of one another at their speeds; behind another, when the time to
collision falls below 2 s. That has to last 0.4 s; 0.75 s later it brakes, with 0.774 g at most and 12.65 m/s3 (Annex 3,
its times for a cut-in), until it stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.fault import (
    DID_NOT_GIVE_WAY,
    DID_NOT_GIVE_WAY_TO_PERSON,
    DROVE_IN,
    LEFT_BEFORE,
    LEFT_ON_DONT_WALK,
    NO_RULE,
    RAN_RED,
    WALKED_INTO,
)  # fmt: skip
from cornerforge.analysis.site_case import SiteCase
from cornerforge.analysis.site_fault import AT_SITE, broken_at_site
from cornerforge.counterfactual import (
    SpeedSearch,
    carry_on,
    drive_profile,
    first_touch,
    forbid,
    may_exist,
    search_speeds,
)  # fmt: skip
from cornerforge.drivers.careful import CC_BRAKING, CC_DELAY
from cornerforge.sim import NO_VEHICLE
from cornerforge.site.tables import pose_at
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from cornerforge.analysis.avoidability import AvoidParams

__all__ = [
    "CarefulAtSite", "SiteWaysOut", "careful_at_site", "manoeuvre_at_site", "others_at_site", "poses_on_route",
    "touches_at", "ways_out_at_site",
]  # fmt: skip

GRID = 0.1
_COMFORTABLE, _COMMITTED = 3.0, 4.0
_SEES_S = 0.4
_TTC = 2.0
_NEAR_S = 0.5
_LOOKS_BACK_S = 10.0
_STANDS = 0.3
_BRAKES = -1.0
OTHER_MOVES, OTHER_BRAKES, AV_MOVES, AV_BRAKES, APPROACH, OTHER_CROSSES, AV_CROSSES = range(7)
"""Places in `counterfactual.MANOEUVRES`."""


@dataclass(frozen=True)
class SiteWaysOut:
    """Latest ways out of one crash; frames, -1 for none.

    Attributes:
        manoeuvre, begin: Place in `counterfactual.MANOEUVRES`, and frame at which it began.
        braking: Latest frame from which braking alone, as hard as it may, until it stands, helps.
        latest: Latest frame from which any accelerations help.
        commands: Accelerations of the way out from `latest`, one each tenth of a second [m/s2].
        track: Place, speed, acceleration along the route from `latest` on, (W, 3).
        proven: There is no way out in time, and none can exist; or there is one.
        in_time: There is one from the begin on, or from so long after it as a driver that reacts needs.
    """

    manoeuvre: int
    begin: int
    braking: int
    latest: int
    commands: NDArray[np.float64]
    track: NDArray[np.float64]
    proven: bool
    in_time: bool


@dataclass(frozen=True)
class CarefulAtSite:
    """Outcome of one crash at a site with a careful driver in the AV's place.

    Attributes:
        prevents: It prevents it, in one of the two ways.
        keeps_rules: It keeps the rule that the AV broke, braking with 3 m/s2 at most, and touches nobody.
        brakes: It touches nobody by braking once it sees danger.
        holds: To hold the speed from then on is enough.
        sees: Frame at which it sees danger; -1: never.
        begin: Frame at which it leaves the AV's motion; -1: it does not.
        braking_mps2: Its hardest braking.
        track: Place, speed, acceleration along the route from `begin` on, (W, 3).
    """

    prevents: bool
    keeps_rules: bool
    brakes: bool
    holds: bool
    sees: int
    begin: int
    track: NDArray[np.float64]
    braking_mps2: float = field(metadata={"unit": "m/s2"})


def others_at_site(case: SiteCase, params: AvoidParams) -> NDArray[np.float64]:
    """Give the places of all agents along their routes, (frames, N) [m], until the horizon's end; NaN where absent."""
    horizon = round(params.horizon_s / FRAME_S)
    s = np.concatenate([case.s, np.full((horizon, case.route.size), np.nan)])
    behind = case.in_line[-1] < case.s[-1, 0]
    behind[case.partner] = False
    if params.others == "partner":
        behind = np.arange(case.route.size) != case.partner
    rate = np.nan_to_num(case.acceleration[-1])
    carry_on(case.road.site, case.route, case.last, behind, s, np.nan_to_num(case.speed[-1]), rate)
    return s


def _forbidden(case: SiteCase, s: NDArray[np.float64], first: int) -> tuple[NDArray[np.bool_], float]:
    """Find the places that the others forbid from a frame on, (frames, places), and the first place [m]."""
    begin = float(case.s[first, 0]) - 1.0
    most = float(np.nanmax(case.speed[first:, 0])) + 2.0
    end = min(begin + most * 1.5 * (len(s) - first) * FRAME_S + 5.0, float(case.way(0).length) + 1.0)
    forbidden = np.zeros((len(s) - first, max(2, math.ceil((end - begin) / GRID) + 1)), np.bool_)
    forbid(case.road.site, case.route, case.sizes, s, first, begin, forbidden)
    return forbidden, begin


def _state(case: SiteCase, frame: int) -> tuple[float, float, float]:
    """Place, speed and acceleration of the AV in a frame."""
    acceleration = min(max(float(np.nan_to_num(case.acceleration[frame, 0])), -8.0), 4.0)
    return float(case.s[frame, 0]), max(0.0, float(case.speed[frame, 0])), acceleration


def _driven(case: SiteCase, frame: int, commands: NDArray[np.float64]) -> NDArray[np.float64]:
    """Drive the AV from its recorded state in a frame: rows of place, speed, acceleration, (K + 1, 3)."""
    track = np.empty((commands.size + 1, 3))
    drive_profile(_state(case, frame), commands, case.road, track)
    return track


def touches_at(case: SiteCase, s: NDArray[np.float64], frame: int, track: NDArray[np.float64]) -> int:
    """Find the first frame in which the AV's box on a track from a frame on touches another; -1: none."""
    return int(first_touch(case.road.site, case.route, case.sizes, s, frame, track))


def _held(
    case: SiteCase, s: NDArray[np.float64], frame: int, command: float
) -> tuple[bool, NDArray[np.float64]]:  # fmt: skip
    """Let the AV hold a command from a frame to the end; say whether it touches nobody."""
    track = _driven(case, frame, np.full(len(s) - 1 - frame, command))
    return touches_at(case, s, frame, track) < 0, track


def ways_out_at_site(case: SiteCase, params: AvoidParams, scratch: SpeedSearch) -> SiteWaysOut:
    """Look for the latest moments from which braking alone, and any accelerations, avoid all contact."""
    first = max(0, case.last - round(params.lookback_s / FRAME_S))
    s = others_at_site(case, params)
    forbidden, origin = _forbidden(case, s, first)
    manoeuvre, begin = manoeuvre_at_site(case)
    may = begin if manoeuvre in (AV_BRAKES, AV_CROSSES) else begin + round(params.delay_s / FRAME_S)
    hardest, strongest = -min(params.accelerations_mps2), max(params.accelerations_mps2)
    every = round(params.decision_s / FRAME_S)
    commands = np.array(params.accelerations_mps2)
    braking = latest = -1
    for frame in range(case.last - 1, first - 1, -1):
        if _held(case, s, frame, -hardest)[0]:
            braking = frame
            break
    found = np.empty(0)
    for frame in range(case.last - 1, first - 1, -1):
        count = search_speeds(
            forbidden, frame - first, _state(case, frame), origin, commands, every, case.road, scratch
        )
        if count <= 0:
            continue
        profile = np.repeat(scratch.found[:count], every)[: len(s) - 1 - frame]
        if touches_at(case, s, frame, _driven(case, frame, profile)) < 0:
            latest, found = frame, profile
            break
    if braking > latest:
        latest, found = braking, np.full(len(s) - 1 - braking, -hardest)
    start = min(max(may, first), case.last)
    proven = latest >= may or not may_exist(
        forbidden, start - first, _state(case, start), origin, hardest, strongest, case.road, scratch
    )
    track = _driven(case, latest, found) if latest >= 0 else np.empty((0, 3))
    return SiteWaysOut(manoeuvre, begin, braking, latest, found, track, proven, latest >= may)


def poses_on_route(case: SiteCase, track: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give x, y [m], speed [m/s] and heading [rad] of the AV on a track along its route, (W, 4)."""
    poses = [pose_at(case.road.site, case.route[0], place) for place in track[:, 0].tolist()]
    return np.array(
        [(x, y, speed, heading) for (x, y, heading), speed in zip(poses, track[:, 1].tolist(), strict=True)]
    )


def manoeuvre_at_site(case: SiteCase) -> tuple[int, int]:
    """Say what led to the crash, its place in `MANOEUVRES`, and the frame at which it began, by the module's text."""
    broken = broken_at_site(case, AT_SITE)
    if broken is None:
        return _of_following(case)
    by_av = broken.av[0] != NO_RULE and (broken.bv[0] == NO_RULE or broken.av[1] <= broken.bv[1])
    if case.is_person(case.partner):
        by_av = broken.av[0] == RAN_RED or (broken.bv[0] not in (LEFT_ON_DONT_WALK, LEFT_BEFORE, WALKED_INTO) and by_av)
        if not by_av:
            return OTHER_CROSSES, max(case.first, case.leaves_kerb(case.partner))
    who = 0 if by_av else case.partner
    rule = broken.av[0] if by_av else broken.bv[0]
    return (AV_CROSSES if by_av else OTHER_CROSSES), commits(case, who, at_line=rule == RAN_RED)


def commits(case: SiteCase, i: int, *, at_line: bool = False, braking: float = _COMMITTED) -> int:
    """Find the last frame in which agent i could stop before the zone, or its line, with a braking [m/s2]."""
    goal = case.way(i).stop - 0.5 * case.sizes[i, 0] if at_line else case.zone_of(i)[0]
    room = goal - case.s[:, i]
    could = np.flatnonzero(0.5 * case.speed[:, i] ** 2 <= braking * room)
    return max(case.first, int(could[-1])) if could.size else case.first


def _of_following(case: SiteCase) -> tuple[int, int]:
    """Find when it began behind one another: the one ahead brakes in the last second, or the rear one is faster."""
    behind_av = case.is_behind_partner
    ahead = case.partner if behind_av else 0
    behind = 0 if behind_av else case.partner
    second = round(1.0 / FRAME_S)
    braked = np.flatnonzero(case.acceleration[: case.last, ahead] <= _BRAKES)
    if braked.size and case.last - braked[-1] <= second:
        begin = int(braked[-1])
        while begin > case.first and case.acceleration[begin - 1, ahead] <= _BRAKES:
            begin -= 1
        return (OTHER_BRAKES, begin) if behind_av else (AV_BRAKES, max(case.first, begin - 1))
    faster = np.flatnonzero(~(case.speed[: case.last, behind] > case.speed[: case.last, ahead]))
    return APPROACH, max(case.first, int(faster[-1]) + 1 if faster.size else 0)


def careful_at_site(case: SiteCase, params: AvoidParams, reaction_s: float | None = None) -> CarefulAtSite:
    """Let a careful driver drive in the AV's place; `reaction_s`: from danger to braking, None: its own."""
    s = others_at_site(case, params)
    keeps = _keeps_rules(case, s)
    sees = _sees_danger(case)
    delay = _SEES_S + CC_DELAY if reaction_s is None else reaction_s
    start = sees + round(delay / FRAME_S) if sees >= 0 else -1
    brakes = holds = False
    begin, track = -1, np.empty((0, 3))
    if 0 <= start < case.last:
        brakes, track = _held(case, s, start, -CC_BRAKING)
        begin = start
        holds = _held(case, s, sees, 0.0)[0]
    if keeps is not None:
        begin, track = keeps
    hardest = -float(track[:, 2].min(initial=0.0))
    return CarefulAtSite(keeps is not None or brakes, keeps is not None, brakes, holds, sees, begin, track, hardest)


def _keeps_rules(case: SiteCase, s: NDArray[np.float64]) -> tuple[int, NDArray[np.float64]] | None:
    """Stop before the zone, or the line, with comfortable braking, if the AV broke a rule: begin and track, or None.

    None, too, where it cannot, from the first frame looked at on, or is touched all the same.
    """
    broken = broken_at_site(case, AT_SITE)
    if broken is None or broken.av[0] not in (RAN_RED, DID_NOT_GIVE_WAY, DID_NOT_GIVE_WAY_TO_PERSON, DROVE_IN):
        return None
    begin = max(case.first, commits(case, 0, at_line=broken.av[0] == RAN_RED, braking=_COMFORTABLE) - 3)
    hider = int(case.hidden_by[begin])
    is_unknown = broken.av[0] != RAN_RED and hider != NO_VEHICLE and case.speed[begin, hider] > _STANDS
    if begin >= case.last or is_unknown:
        return None
    free, track = _held(case, s, begin, -_COMFORTABLE)
    return (begin, track) if free else None


def _sees_danger(case: SiteCase) -> int:
    """Find the first frame from which there is danger for as long as it takes to see it; -1: never."""
    first = max(case.first, case.last - round(_LOOKS_BACK_S / FRAME_S))
    danger = [_is_danger(case, frame) for frame in range(first, case.last)]
    lasts = round(_SEES_S / FRAME_S)
    for k in range(len(danger) - lasts + 1):
        if all(danger[k : k + lasts]):
            return first + k
    return -1


def _is_danger(case: SiteCase, frame: int) -> bool:
    other = case.partner
    if case.hidden_by[frame] != NO_VEHICLE:
        return False
    v_av, v = float(case.speed[frame, 0]), float(case.speed[frame, other])
    if np.isfinite(case.in_line[frame, other]):
        gap = float(case.in_line[frame, other] - case.s[frame, 0]) - 0.5 * float(case.sizes[[0, other], 0].sum())
        return -0.5 * float(case.sizes[0, 0]) < gap < _TTC * (v_av - v)
    if case.zone is None:
        return False
    own, theirs = case.zone_of(0), case.zone_of(other)
    to_own, to_theirs = own[0] - case.s[frame, 0], theirs[0] - case.s[frame, other]
    if case.s[frame, 0] > own[1] or case.s[frame, other] > theirs[1]:
        return False
    if case.is_person(other):
        if frame < case.leaves_kerb(other):
            return False
    elif 0.5 * v * v <= _COMMITTED * to_theirs:
        return False
    enters, leaves = (max(0.0, way) / max(v_av, _STANDS) for way in (to_own, own[1] - case.s[frame, 0]))
    comes, goes = (max(0.0, way) / max(v, _STANDS) for way in (to_theirs, theirs[1] - case.s[frame, other]))
    return bool(comes < leaves + _NEAR_S and enters < goes + _NEAR_S)
