"""Alternatives to a recorded crash: the search for ways out (docs/adr/0014-avoidability.md).

`search_cases` takes recordings and gives, for each, the latest moments from which the AV could still have avoided the
crash. Within it: `search` tries every sequence of manoeuvres, `witness` drives what was found once more, `motion`
continues a recording after its contact, `begin` finds where the manoeuvre began.
`judge_cases` lets reference drivers drive in the AV's place (`careful`). `is_avoidable` asks whether braking would
have been enough (`braking`). All motion is the simulator's own. At a site the
AV's path is fixed: `at_site` looks for ways out along it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.counterfactual.at_site import (
        SpeedSearch,
        allocate_speed_search,
        carry_on,
        drive_profile,
        first_touch,
        forbid,
        may_exist,
        places_along,
        rooms_to,
        search_speeds,
    )
    from cornerforge.counterfactual.begin import MANOEUVRES, OWN_MANOEUVRES
    from cornerforge.counterfactual.braking import Braking, is_avoidable
    from cornerforge.counterfactual.careful import (
        Judgements,
        JudgeScratch,
        allocate_judge_scratch,
        allocate_judgements,
        judge_cases,
        no_tracks,
    )
    from cornerforge.counterfactual.cases import (
        CaseScratch,
        WaysOut,
        allocate_case_scratch,
        allocate_ways_out,
        search_cases,
    )
    from cornerforge.counterfactual.search import BRAKING, COMBINED, STEERING, Manoeuvres

__all__ = [
    "BRAKING",
    "COMBINED",
    "MANOEUVRES",
    "OWN_MANOEUVRES",
    "STEERING",
    "Braking",
    "CaseScratch",
    "JudgeScratch",
    "Judgements",
    "Manoeuvres",
    "SpeedSearch",
    "WaysOut",
    "allocate_case_scratch",
    "allocate_judge_scratch",
    "allocate_judgements",
    "allocate_speed_search",
    "allocate_ways_out",
    "carry_on",
    "drive_profile",
    "first_touch",
    "forbid",
    "is_avoidable",
    "judge_cases",
    "may_exist",
    "no_tracks",
    "places_along",
    "rooms_to",
    "search_cases",
    "search_speeds",
]

FOR_PROGRAMS = ("BRAKING", "COMBINED", "STEERING")
"""The kinds of ways out, by number; the kernels of the search are for the other packages."""

__getattr__ = door(
    "cornerforge.counterfactual",
    {
        "MANOEUVRES": "begin",
        "OWN_MANOEUVRES": "begin",
        "BRAKING": "search",
        "COMBINED": "search",
        "STEERING": "search",
        "Braking": "braking",
        "is_avoidable": "braking",
        "Manoeuvres": "search",
        "WaysOut": "cases",
        "allocate_case_scratch": "cases",
        "allocate_ways_out": "cases",
        "CaseScratch": "cases",
        "search_cases": "cases",
        "SpeedSearch": "at_site",
        "allocate_speed_search": "at_site",
        "carry_on": "at_site",
        "drive_profile": "at_site",
        "forbid": "at_site",
        "may_exist": "at_site",
        "places_along": "at_site",
        "rooms_to": "at_site",
        "search_speeds": "at_site",
        "first_touch": "at_site",
        "Judgements": "careful",
        "JudgeScratch": "careful",
        "allocate_judge_scratch": "careful",
        "allocate_judgements": "careful",
        "judge_cases": "careful",
        "no_tracks": "careful",
    },
)
