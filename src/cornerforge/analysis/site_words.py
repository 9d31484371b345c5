"""A crash at a site in the words of a traffic engineer."""

from __future__ import annotations

import math

import numpy as np

from cornerforge.analysis.fault import (
    DID_NOT_BRAKE_FOR,
    DID_NOT_GIVE_WAY,
    DROVE_IN,
    LEFT_BEFORE,
    LEFT_ON_DONT_WALK,
    NO_RULE,
    RAN_RED,
    WALKED_INTO,
)  # fmt: skip
from cornerforge.analysis.site_case import SiteCase, case_of, kind_at_site
from cornerforge.analysis.site_conduct import side_at_site
from cornerforge.analysis.site_fault import AT_SITE, broken_at_site
from cornerforge.sim import NO_VEHICLE
from cornerforge.site.tables import GREEN, YELLOW
from cornerforge.types import CLASSES, FRAME_S, Scenario

__all__ = ["said_of", "what_happened_at_site"]

_STANDS = 0.05
_TURNING = {"left": "turning left", "right": "turning right", "back": "turning back", "straight": "going straight on"}
_TURNED = {"left": "turned left", "right": "turned right", "back": "turned back", "straight": "came straight on"}
_HERE = math.radians(45.0)


def what_happened_at_site(scenario: Scenario) -> str:
    """Say what happened, in a sentence.

    Such as "The AV, turning left at 4 m/s, hit a car that came straight on from ahead at 7 m/s with the right of way".

    Raises:
        InputError: There is no crash of the AV, or the recording does not hold its contact.
    """
    return said_of(case_of(scenario))


def said_of(case: SiteCase) -> str:
    """Say what happened in a case."""
    other, kind = case.partner, kind_at_site(case)
    own = f"The AV, {_doing(case)}"
    if case.is_person(other):
        return f"{own}, {_met(case)} a person {_walking(case)}{_by_rules(case)}{_from_behind(case)}"
    name = _name(case)
    speed = float(case.speed[-1, other])
    if kind == "rear-end-by-av":
        stood = "that stood" if speed < _STANDS else f"that drove at {_fast(speed)}"
        return f"{own}, ran into the rear of a {name} {stood} ahead of it{_by_rules(case)}"
    if kind == "rear-end-by-bv":
        return f"{own}, was hit from behind by a {name} at {_fast(speed)}{_by_rules(case)}"
    at = "and had stopped" if speed < _STANDS else f"at {_fast(speed)}"
    did = f"{_TURNED[case.way(other).turn]}{_whence(case)} {at}"
    return f"{own}, {_met(case)} a {name} that {did}{_by_rules(case)}{_from_behind(case)}"


def _fast(speed: float) -> str:
    """Say a speed, to a tenth where it is low."""
    return f"{speed:.0f} m/s" if speed >= 0.95 else f"{speed:.1f} m/s"


def _name(case: SiteCase) -> str:
    return CLASSES[int(case.kind[case.partner])].name


def _from_behind(case: SiteCase) -> str:
    """Say behind what the other was hidden from the AV until shortly before."""
    hider, frame = case.came_out
    if hider == NO_VEHICLE:
        return ""
    stood = "stood" if case.hider_stood else f"drove at {_fast(float(case.speed[frame, hider]))}"
    what = f"a {CLASSES[int(case.kind[hider])].name} that {stood}"
    if frame == case.last:
        return f"; {what} hid it from the AV"
    return f"; {what} hid it from the AV until {(case.last - frame) * FRAME_S:.1f} s before"


def _doing(case: SiteCase) -> str:
    """Say what the AV was doing at the contact."""
    speed = float(case.speed[-1, 0])
    turning = _TURNING[case.way(0).turn]
    before_line = case.s[-1, 0] + 0.5 * case.sizes[0, 0] < case.way(0).stop
    if speed < _STANDS:
        return "standing before its stop line" if before_line else f"standing while {turning}"
    return f"coming to its stop line at {_fast(speed)}" if before_line else f"{turning} at {_fast(speed)}"


def _met(case: SiteCase) -> str:
    """Say whether the AV hit the other, with its front, or was hit."""
    pair = np.array([case.x[-1], case.y[-1]])[:, [0, case.partner]]
    dx, dy = pair[:, 1] - pair[:, 0]
    heading = float(case.heading[-1, 0])
    ahead = dx * math.cos(heading) + dy * math.sin(heading)
    if case.speed[-1, 0] >= _STANDS and (case.is_person(case.partner) or ahead > 0.25 * case.sizes[0, 0]):
        return "hit"
    return "was walked into by" if case.is_person(case.partner) else "was hit by"


def _walking(case: SiteCase) -> str:
    """Say how the person walked."""
    speed = float(case.speed[-1, case.partner])
    at = "standing on" if speed < _STANDS else f"walking at {speed:.1f} m/s on"
    leaving = case.s[-1, 0] > 0.5 * (case.way(0).stop + case.way(0).leaves)
    where = "the crosswalk of the road that it turned into" if leaving and case.way(0).turn != "straight" else (
        "a crosswalk"
    )  # fmt: skip
    return f"{at} {where}"


def _whence(case: SiteCase) -> str:
    """Say where the other came from, seen along the AV's way at its begin; in a ring, where it was a second before."""
    if case.route[0] == case.route[case.partner]:
        return ""
    same = case.way(0).points[0] == case.way(case.partner).points[0]
    places = case.road.site[0]["place"]
    own, other = (float(places[case.route[i], 0]["heading"]) for i in (0, case.partner))
    turned = (other - own + math.pi) % (2.0 * math.pi) - math.pi
    if abs(turned) < _HERE:
        return " from the same lane" if same else ("", " from the left", " from the right")[side_at_site(case)]
    if abs(turned) > math.pi - _HERE:
        return " from ahead"
    return " from the left" if turned < 0.0 else " from the right"


def _by_rules(case: SiteCase) -> str:
    """Say who went first, and who did not keep to it."""
    broken = broken_at_site(case, AT_SITE)
    if broken is None:
        return ""
    (av, _), (bv, _) = broken.av, broken.bv
    other = case.partner
    if case.is_person(other):
        left = case.leaves_kerb(other)
        light = ""
        if case.way(other).signal >= 0:
            letter = case.walk(other, left)
            light = {
                GREEN: ", which had left the kerb on Walk",
                YELLOW: ", which had left the kerb on flashing Don't Walk",
            }.get(letter, ", which had left the kerb on Don't Walk")
        said = {
            LEFT_ON_DONT_WALK: light, LEFT_BEFORE: ", which had left the kerb right before it",
            WALKED_INTO: ", which left the kerb when the AV was on the crosswalk already",
        }.get(bv, light or ", which went first")  # fmt: skip
        more = {RAN_RED: "; the AV had run a red light", DID_NOT_BRAKE_FOR: "; the AV did not brake as it had to"}
        return said + more.get(av, "")
    parts = []
    if bv == RAN_RED:
        parts.append(" on a red light")
    elif bv == DID_NOT_GIVE_WAY:
        parts.append(", although the AV went first")
    elif bv == DROVE_IN:
        parts.append(", although the AV had not left the junction yet")
    elif av in (DID_NOT_GIVE_WAY, RAN_RED):
        parts.append(" with the right of way")
    if av == RAN_RED:
        parts.append("; the AV had run a red light")
    elif av == DROVE_IN:
        parts.append("; the other had not left the junction yet")
    elif av == DID_NOT_BRAKE_FOR:
        parts.append("; the AV did not brake as it had to")
    if bv == DID_NOT_BRAKE_FOR:
        parts.append(
            "; the other did not brake as it had to"
            if av != NO_RULE
            else "; the gap was enough, but the other did not brake as it had to"
        )
    return "".join(parts)
