"""The AV's own mistakes at a site: the rule that it broke (`site_fault`), else that it did not react as it could.

Where the other came out from behind a vehicle within 3 s before, the mistake is not to have reckoned with it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.fault import (
    DID_NOT_BRAKE_FOR,
    DID_NOT_GIVE_WAY,
    DID_NOT_GIVE_WAY_TO_PERSON,
    DROVE_IN,
    RAN_RED,
    RULES,
)  # fmt: skip
from cornerforge.analysis.site_case import SiteCase, kind_at_site, site_case
from cornerforge.analysis.site_fault import faults_at_site
from cornerforge.recordings import Recordings
from cornerforge.sim import NO_VEHICLE
from cornerforge.types import FRAME_S, Odd

__all__ = ["conduct_at_site", "side_at_site"]

_OF_RULE = {
    RULES[RAN_RED]: "runs-red",
    RULES[DID_NOT_GIVE_WAY]: "does-not-yield",
    RULES[DID_NOT_GIVE_WAY_TO_PERSON]: "does-not-yield-to-people",
    RULES[DROVE_IN]: "enters-blocked",
    RULES[DID_NOT_BRAKE_FOR]: "drives-on",
}
_OVERLOOKS = ("does-not-yield", "does-not-yield-to-people", "enters-blocked", "drives-on", "reacts-late")
"""Mistakes that are those of one that does not reckon with what it cannot see, where the other came out of hiding."""
_SECOND = round(1.0 / FRAME_S)
_BRAKES = -1.0


def conduct_at_site(
    recordings: Recordings, odd: Odd, reacts: NDArray[np.int64]
) -> list[tuple[str, int, int]]:  # fmt: skip
    """Say of each case what the AV did wrong: a key of `conduct.CONDUCTS`, the side, and how many frames before.

    Args:
        recordings: The cases.
        odd: Site and rules of them.
        reacts: `Prevention.reacts`.

    Returns:
        For each case conduct, side of the other a second before (0 ahead or behind, 1 left, 2 right), frames.
    """
    faults = faults_at_site(recordings, odd).columns()
    found = []
    for k, block in enumerate(recordings.blocks(1)):
        case = site_case(block, odd)
        rule, broken_s = str(faults["av_rule"][k]), float(faults["av_fault_s"][k])
        before = 0.0 if math.isnan(broken_s) else broken_s / FRAME_S
        name = _OF_RULE.get(rule, "none")
        if rule.startswith("longitudinal"):
            braked = np.nanmin(case.acceleration[-1 - _SECOND :, 0]) <= _BRAKES
            name = "brakes-late" if braked else "does-not-brake"
        elif name == "none" and reacts[k] >= 0 and kind_at_site(case) != "rear-end-by-bv":
            name, before = "reacts-late", float(reacts[k])
        if name in _OVERLOOKS and case.came_out[0] != NO_VEHICLE:
            name = "overlooks-hidden-people" if case.is_person(case.partner) else "overlooks-hidden"
        found.append((name, side_at_site(case), round(before)))
    return found


def side_at_site(case: SiteCase) -> int:
    """Say on which side of the AV the other was a second before: 0 ahead or behind, 1 left, 2 right."""
    frame = max(case.first, case.last - _SECOND)
    dx, dy = (float(v[frame, case.partner] - v[frame, 0]) for v in (case.x, case.y))
    heading = float(case.heading[frame, 0])
    aside = dy * math.cos(heading) - dx * math.sin(heading)
    if abs(aside) < 0.5 * float(case.sizes[[0, case.partner], 1].sum()):
        return 0
    return 1 if aside > 0.0 else 2
