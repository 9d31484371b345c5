"""Published and judged numbers of the laws at a site: where no data tell a law, `site fit` takes these.

Each row says whether its source was read (an abstract or an excerpt), recalled without it at hand, or is a judgement.
Docs/sites.md shows them with what each leaves out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cornerforge.ext.calibrate.site_following import PUBLISHED_IDM
from cornerforge.site.laws import Laws

__all__ = ["PUBLISHED", "Published"]


@dataclass(frozen=True)
class Published:
    """One number.

    Attributes:
        value: It, in the unit of `Laws`.
        low, high: What other sources or other readings of this one would give.
        checked: read, recalled or judged.
        source: Where it is from, and how it was converted.
        leaves_out: What a reader should doubt.
    """

    value: float | tuple[float, ...]
    low: float
    high: float
    checked: str
    source: str
    leaves_out: str


_HEADWAY, _STANDSTILL, _ACCELERATION, _BRAKING = PUBLISHED_IDM
_GAP_SPREAD = 0.25


def _median(mean: float) -> float:
    """Median of a log-normal gap with this mean and the spread that is taken for all of them."""
    return round(mean * math.exp(-0.5 * _GAP_SPREAD**2), 3)


_DECIDES = 0.5
_HALF, _MOST = 4.0, 5.5
_APPROACH = (15.6, 20.1)
_HALF_STOP = [v / (2.0 * (_HALF - _DECIDES)) for v in _APPROACH]
_MOST_STOP = [v / (2.0 * (_MOST - _DECIDES)) for v in _APPROACH]
_SCALE = [(half - most) / math.log(9.0) for half, most in zip(_HALF_STOP, _MOST_STOP, strict=True)]
"""Amber: half stop 4 s before the line, 90 % stop 5.5 s before it, at 35 and 45 mph. Drivers of the simulator decide at
whole seconds, so 0.5 s after amber in the mean."""
_RUNNERS, _LATE = 237 / 15_392, 0.05
"""Red-light runners of all vehicles that a change to red met near the line (9 approaches); 2 s late and more."""

_TOWN = "town traffic in Treiber and Kesting 2013"
_HCM = "base critical headways of the Highway Capacity Manual, two-way stop, means"
_LOW_END = (
    "The low end of three chances is taken: with 1e-4, 4e-4 and 1e-3 for vehicles, people and kerbs the traffic of "
    "mcity-signal crashed 14 times as often as people do (18 crashes of 1.66 million vehicles)"
)
_HEART = "HEART (Williams 1986), generic task of a familiar routine: 4e-4, from 8e-5 to 9e-3"
_WHOLE = "Utah's crossings as a whole (urban/README)"
_GAPS = "DFKI's crossings as a whole, Germany (urban/README); Japan 6.05 s and 0.30"

PUBLISHED: dict[str, Published] = {
    "headway": Published(_HEADWAY, 0.8, 1.5, "recalled", _TOWN, "other streets and years"),
    "headway_spread": Published(0.25, 0.15, 0.5, "judged", "as of critical gaps", "no source"),
    "standstill": Published(_STANDSTILL, 1.5, 3.0, "recalled", _TOWN, "trucks"),
    "acceleration": Published(_ACCELERATION, 0.8, 2.0, "recalled", _TOWN, "electric cars"),
    "braking": Published(_BRAKING, 1.0, 3.0, "recalled", _TOWN, "emergencies"),
    "stopping": Published(
        2.0, 1.5, 3.0, "read", "less than the first to stop at amber, 3.0 m/s2 (Gates et al. 2007)", "everyday stops"
    ),
    "noise": Published(0.4, 0.2, 0.8, "judged", "half of what differentiated recordings show", "no source"),
    "pace": Published(
        1.0, 0.9, 1.1, "judged", "no limit is in the data, and no vehicle there is faster than 15.8 m/s",
        "places where everybody is faster than the limit",
    ),
    "pace_spread": Published(
        0.1, 0.08, 0.15, "recalled", "free speeds in streets scatter by about a tenth of their mean",
        "who drives and the hour",
    ),
    "lateral": Published(
        2.5, 2.0, 2.9, "read", "0.2 to 0.3 g is called comfortable (McHenry Software's forum on reconstruction)",
        "no measurement behind it was read",
    ),
    "start_up": Published(
        1.9, 1.0, 2.05, "read", "mean response of drivers to green 2.05 s (abstract of a study of start-up loss); "
        "median of a log-normal with a coefficient of 0.4, which is judged; start-up lost time of a queue 2 s (HCM)",
        "signal phases are not recorded at Lankershim, so nothing here checks it",
    ),
    "amber_braking": Published(
        round(sum(_HALF_STOP) / 2.0, 2), round(_HALF_STOP[0], 2), round(_HALF_STOP[1], 2), "read",
        "indecision zone 2.5 to 5.5 s before the line, first to stop respond after 1.0 s and brake by 2.2, 3.0 and 3.9 "
        "m/s2 (15, 50, 85 %; 463 vehicles, Gates et al. 2007, abstract); that its ends are 10 and 90 % is recalled",
        "it is the braking needed 0.5 s after amber, before the driver reacts; slower streets have a smaller one",
    ),
    "amber_spread": Published(
        round(sum(_SCALE) / 2.0, 2), round(_SCALE[0], 2), round(_SCALE[1], 2), "recalled",
        "from the same two points", "a driver's own habit",
    ),
    "gap_left": Published(
        _median(4.87), _median(4.1), _median(5.3), "read",
        "mean 4.87 s of 2,500 drivers at 45 approaches (Claros et al. 2021, abstract); 4.1 s in the HCM",
        "no standard deviation was found: the median is the mean with `gap_spread`",
    ),
    "gap_right": Published(
        _median(6.2), _median(4.5), _median(6.9), "recalled", f"6.2 s, or 6.9 s into four lanes: {_HCM}",
        "right turns on red, which often take less",
    ),
    "gap_cross": Published(
        _median(6.5), _median(5.5), _median(7.5), "recalled", f"6.5 s: {_HCM}", "wide streets take more"
    ),
    "gap_enter": Published(
        _median(5.0), _median(4.2), _median(5.9), "recalled",
        "mean about 5.0 s, follow-up 2.6 s; sites in the US 4.2 to 5.9 s (NCHRP 572)",
        "a second lane; no follow-up headway is in `Laws`",
    ),
    "gap_spread": Published(
        _GAP_SPREAD, 0.2, 0.35, "recalled",
        "published standard deviations are a fifth to a third of the mean; people at DFKI 0.26 and 0.29",
        "one number for four manoeuvres",
    ),
    "gap_error": Published(0.1, 0.05, 0.25, "judged", "less than half of `gap_spread`", "no source"),
    "right_on_red": Published(
        0.5, 0.3, 0.9, "read",
        "18 % of right turns are made on red (Ray 1956, as cited), 3 to 4 % of all vehicles of an approach (Mamlouk "
        "1976, abstract); about 40 % of right turns come on red as the first of their lane, which is judged",
        "laws then and there; drivers that had no gap count as such that did not want to",
    ),
    "to_people": Published(2.5, 1.0, 5.0, "judged", "no source", "all"),
    "to_people_spread": Published(0.5, 0.25, 1.0, "judged", "no source", "all"),
    "after_people": Published(2.5, 1.0, 6.0, "judged", "no source", "all"),
    "walks": Published(Laws().walks, 0.7, 4.0, "read", f"{_WHOLE}; the ends are judged", "bicycles"),
    "walk_change": Published(0.004, 0.002, 0.02, "judged", "no source", "all"),
    "obeys": Published(
        0.47, 0.4, 0.6, "read", f"53 % leave on solid don't walk with no vehicle in the next 10 s: {_WHOLE}",
        "people that had no time to leave before walk count as obedient",
    ),
    "patience": Published(15.0, 5.0, 60.0, "judged", "no source", "all"),
    "starts_early": Published(0.1, 0.05, 0.2, "judged", "no source", "all"),
    "gap_walk": Published(4.95, 4.5, 6.05, "read", _GAPS, "gaps in the street may be shorter"),
    "gap_walk_spread": Published(0.25, 0.2, 0.3, "read", _GAPS, "the same person varies too"),
    "gives_way": Published(1.5, 0.5, 3.0, "judged", "no source", "all"),
    "gives_way_spread": Published(0.5, 0.25, 1.0, "judged", "no source", "all"),
    "after_vehicles": Published(4.0, 2.0, 7.0, "judged", "no source", "all"),
    "steps_back": Published(0.5, 0.3, 0.9, "judged", "no source", "all"),
    "runs_red": Published(
        round(_RUNNERS * _LATE, 6), 3e-4, round(3.0 * _RUNNERS * _LATE, 6), "read",
        "1.5 % of vehicles near the line at the change run the red (237 of 15,392 at nine sites, excerpt of a report), "
        "5 % of runs are 2 s late or more (541 runs, Bonneson and Zimmerman 2004, as cited; 15 % in Virginia): such "
        "drivers could have stopped. 6.3 runs an hour and intersection (8,587, Hunter, abstract) give the lower end",
        "the first 2 s of red belong to the law of amber; who comes later in red runs it more rarely",
    ),
    "overlooks_vehicle": Published(
        2e-5, 2e-5, 4e-4, "recalled", f"between a supervised routine (2e-5) and {_HEART}. {_LOW_END}",
        "how rates at junctions check it: its size was chosen with one in view",
    ),
    "overlooks_person": Published(
        8e-5, 8e-5, 0.07, "recalled",
        f"{_HEART}. {_LOW_END}; in a simulator 4 to 9 % of left turns went without a look at the crosswalk (Hurwitz, "
        "news, read)",
        "who does not look before the turn may still see in it; the upper end is no rate of crashes",
    ),
    "looks_away": Published(
        4e-4, 1e-4, 0.0085, "judged",
        "the same law, to look away and go on, fits crashes on motorways with 4e-4 (ADR 27); looks up to 1 s are "
        "within the time in which drivers decide. "
        "Upper end: 17 % of time off the road, looks of about 1 s, 5 % of them over "
        "2 s (recalled), if such looks came at any time",
        "people look away while the gap stays the same (abstract of a study of car following, 2015, read): in streets "
        "they may look away more often, at times at which it does not matter",
    ),
    "looks_back": Published(
        0.7, 0.5, 0.8, "recalled", "5 to 10 % of looks are over 2 s: 0.3 goes on in each second", "texting"
    ),
    "walks_blindly": Published(
        8e-5, 8e-5, 3e-3, "judged",
        "between a routine's error (HEART, recalled) and the share of crossings in virtual reality that end in a "
        f"collision. {_LOW_END}; 7 to 8 % of people text while they cross (10,543 and 1,102 people, abstracts read)",
        "no source counts people that step off without a look",
    ),
}  # fmt: skip
"""By field of `Laws`."""
