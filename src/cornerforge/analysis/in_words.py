"""One sentence that tells a reader what happened in a case, and whether the AV could have avoided it."""

from __future__ import annotations

import numpy as np

from cornerforge.analysis.mechanism import (
    MECHANISMS,
    LaneChange,
    entering_change,
    is_free,
    lane_changes_before,
    lane_in,
    mechanism_of,
)
from cornerforge.analysis.site_words import what_happened_at_site
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Scenario

__all__ = ["avoidance_in_words", "case_in_words", "what_happened"]


def what_happened(scenario: Scenario) -> str:
    """Say what happened, for example "BV cuts in from the left at 11 m with -4 m/s2".

    The distance is from bumper to bumper when the lane change began, the acceleration the strongest braking that the
    mover (for rear-ends: the one in front) held from then on.

    Raises:
        InputError: There is no crash of the AV, or the recording does not hold its contact.
    """
    if scenario.odd.site is not None:
        return what_happened_at_site(scenario)
    frame, partner = scenario.contact()
    name = mechanism_of(scenario).plain
    mover = {"bv-side": partner, "av-rear-bv-cut-in": partner, "bv-rear-bv-change": partner}.get(name)
    if mover is None and name in ("av-side", "bv-rear-av-cut-in", "av-rear-av-change"):
        mover = 0
    if mover is not None:
        return _lane_change(scenario, frame, mover, partner if mover == 0 else 0)
    if name.endswith("-braking"):
        front = 0 if name.startswith("bv") else partner
        who, whom = ("AV", "BV") if front == 0 else ("BV", "AV")
        return f"{who} brakes with {_hardest(scenario, frame, front, 0):.1f} m/s2 in front of the {whom}" + _place(
            scenario, frame
        )
    return MECHANISMS[name] + _place(scenario, frame)


def _lane_change(scenario: Scenario, frame: int, mover: int, other: int) -> str:
    """The mover changes lanes towards the other."""
    change = entering_change(scenario, frame, mover, other)
    assert change is not None  # or the mechanism were another
    start = change.start
    ahead = float(along(scenario.x[start, other], scenario.x[start, mover]))
    gap = abs(ahead) - 0.5 * (scenario.length[mover] + scenario.length[other])
    who, whom = ("AV", "BV") if mover == 0 else ("BV", "AV")
    side = "right" if change.side > 0 else "left"
    if gap < 0.0:
        text = f"{who} changes lanes from the {side} into the {whom} beside it"
    elif ahead > 0.0:
        text = f"{who} cuts in from the {side} at {gap:.0f} m"
    else:
        text = f"{who} changes lanes from the {side}, {gap:.0f} m behind the {whom}"
    if lane_changes_before(scenario, frame, mover)[0] != change:
        text += ", turns back too late"
    hardest = _hardest(scenario, frame, mover, start)
    return (f"{text} with {hardest:.1f} m/s2" if hardest <= -1.0 else text) + _reason(scenario, mover, change)


def _reason(scenario: Scenario, mover: int, change: LaneChange) -> str:
    """Say why the mover had to change lanes, as far as the road tells."""
    x = float(scenario.x[change.start, mover])
    old, new = (lane_in(scenario, slot, x) for slot in (change.target - change.side, change.target))
    if new is not None and new.kind == "deceleration":
        return ", to take the exit"
    if old is None or is_free(old, x):
        return ""
    return ", merging from the ramp" if old.kind == "acceleration" else ", as its lane ends"


def _place(scenario: Scenario, frame: int) -> str:
    """Say where the AV was, as far as the road tells."""
    x, y = float(scenario.x[frame, 0]), float(scenario.y[frame, 0])
    lane = lane_in(scenario, int(y // scenario.odd.lane_width), x)
    if lane is None or (lane.kind == "through" and is_free(lane, x)):
        return ""
    kinds = {"acceleration": "acceleration lane", "deceleration": "exit lane", "ramp": "ramp"}
    return f", on the {kinds[lane.kind]}" if lane.kind in kinds else ", where the lane ends"


def _hardest(scenario: Scenario, frame: int, column: int, start: int) -> float:
    """Strongest braking that a vehicle held within [start, frame) and 3 s before the contact [m/s2]; at most 0."""
    held = scenario.acceleration[max(start, frame - round(3.0 / FRAME_S)) : max(frame, 1), column]
    return min(0.0, float(np.nanmin(held, initial=0.0)))


def avoidance_in_words(label: str | None, latest_s: float | None, braking_s: float | None = 0.0) -> str:
    """Say for example "in hindsight avoidable by braking; last way out 1.2 s before contact"; "": nobody looked.

    The last way out is the latest of any kind, everywhere: for "by braking" it may begin with a lane change.

    Args:
        label: A key of `avoidability.LABELS`; None where it was not looked for.
        latest_s: `avoidability.Avoidability.latest_s`, column `latest_any_s`.
        braking_s: Its `braking_s`; None under the label "by braking", as at a site: only going faster helps.

    >>> avoidance_in_words("by both", 0.8)
    'in hindsight avoidable by braking or steering; last way out 0.8 s before contact'
    """
    if label is None:
        return ""
    if label == "unavoidable":
        return "in hindsight unavoidable"
    if label == "undecided":
        return "no way out found, not all tried"
    if label == "by braking" and braking_s is None:
        label = "by going faster"
    how = {"by both": "by braking or steering", "by combination": "by braking and steering together"}.get(label, label)
    return f"in hindsight avoidable {how}; last way out {latest_s:.1f} s before contact"


def case_in_words(scenario: Scenario, avoidance: str) -> str:
    """The sentence: what happened, and whether it could be avoided.

    Args:
        scenario: Recording of the case.
        avoidance: What `avoidance_in_words` says; "" where it was not looked for.

    Raises:
        InputError: There is no crash of the AV, or the recording does not hold its contact.
    """
    happened = what_happened(scenario)
    return f"{happened}; {avoidance}" if avoidance else happened
