"""Cases as pictures show them: boxes at some moments, in a frame that moves along the road with the AV."""

from __future__ import annotations

from typing import Any

from cornerforge.analysis.in_words import what_happened
from cornerforge.analysis.mechanism import mechanism_of
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Scenario

__all__ = ["drawn_case", "number_of_cases"]

_SHOWN_S = (3.0, 2.0, 1.0, 0.0)
_NEAR_M = 30.0


def drawn_case(scenario: Scenario) -> dict[str, Any]:
    """A crash at 3, 2, 1 and 0 s before contact (as far as it goes back), its mechanism, what happened, and the road.

    Each of `moments` holds the boxes `av`, `bv` (of the crash; None where it was not there) and `others` near the AV as
    [x ahead of the AV, y, heading, length, width] in m and rad.
    """
    moments = [moment for moment in _SHOWN_S if moment <= _contact_time(scenario)]
    return {
        "mechanism": mechanism_of(scenario).name,
        "happened": what_happened(scenario),
        "lanes": scenario.odd.n_lanes,
        "lane_width": scenario.odd.lane_width,
        "moments": [{"before": moment, **_boxes(scenario, moment)} for moment in moments],
    }


def number_of_cases(n: int, kind: str = "") -> str:
    """The number in words.

    >>> number_of_cases(1, "bounded"), number_of_cases(1627)
    ('1 bounded case', '1,627 cases')
    """
    return " ".join(word for word in (f"{n:,}", kind, "case" if n == 1 else "cases") if word)


def _contact_time(scenario: Scenario) -> float:
    assert scenario.crash is not None  # every case is a crash
    return float(scenario.crash.time)


def _boxes(scenario: Scenario, before: float) -> dict[str, Any]:
    assert scenario.crash is not None
    frame = round((_contact_time(scenario) - before) / FRAME_S)
    here = {
        int(slot): [
            round(float(value), 4)
            for value in (
                along(scenario.x[frame, 0], scenario.x[frame, column]),
                scenario.y[frame, column],
                scenario.heading[frame, column],
                scenario.length[column],
                scenario.width[column],
            )
        ]
        for column, slot in enumerate(scenario.slot)
        if scenario.present[frame, column]
    }
    partner = scenario.crash.slot_b
    others = [box for slot, box in here.items() if slot not in (0, partner) and abs(box[0]) <= _NEAR_M]
    return {"av": here[0], "bv": here.get(partner), "others": others}
