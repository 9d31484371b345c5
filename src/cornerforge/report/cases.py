"""Scenarios as compact JSON for the animation: rounded, trimmed to what the picture can show."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.avoidability import WayOut
from cornerforge.errors import FileFormatError, InputError
from cornerforge.metrics.risk import lane_ttc, plane_ttc
from cornerforge.perception import Perception
from cornerforge.report.site_surface import changes_of, site_surface
from cornerforge.report.surface import surface_of
from cornerforge.road.straight import along
from cornerforge.sim import perceived
from cornerforge.site.network import Site
from cornerforge.site.signals import clock_in
from cornerforge.types import ACTIONS, CLASSES, FRAME_S, PERSON, Scenario

__all__ = ["BEFORE_S", "case_data", "first_shown", "ghost", "load_scenarios", "unseen_s"]

SIGHT_M = 110.0
"""Vehicles are kept while they are this near to the AV along the road [m]; the widest view shows 100 m each way."""
BEFORE_S = 3.0
"""What an AV saw this long before a contact [s] is told in words."""
_DRIVING = ("gives way", "goes")
_WALKING = ("waits", "goes", "walks at 0.8 m/s", "walks at 1.3 m/s", "walks at 2.0 m/s", "runs at 3.0 m/s")
"""Names of the first actions of drivers and people at a site (docs/adr/0084-traffic-at-sites.md)."""
SHOWN_S = 30.0
"""Longest part of a test that is kept, counted back from its end [s]."""


def load_scenarios(library: Path, case_ids: Iterable[str]) -> Iterator[tuple[str, Scenario | None]]:
    """Read cases from a library, one at a time; None for cases that it does not hold or that lie in a damaged shard.

    Warns with `DamagedShardWarning` of files that do not hold what they should.

    Raises:
        FileFormatError: The folder is no library that can be read.
    """
    from cornerforge.library import CaseLibrary, DamagedShardWarning

    store = CaseLibrary.open(library)
    for case_id in case_ids:
        try:
            yield case_id, store.scenario(case_id).scenario
        except InputError:
            yield case_id, None
        except FileFormatError as error:
            if not any(fault in str(error) for fault in store.damaged):  # of these the library has warned
                warnings.warn(str(error), DamagedShardWarning, stacklevel=2)
            yield case_id, None


def case_data(
    case_id: str,
    scenario: Scenario,
    way_out: WayOut | None = None,
    *,
    first: int | None = None,
    partner: int | None = None,
) -> dict[str, Any]:
    """Return what the animation needs of a case, as JSON values.

    Positions are in metres (x counted from the AV's centre at its start), speeds in m/s, times in s, rounded to 3
    decimals, headings in rad, rounded to 4. `vehicles[0]` is the AV. A vehicle's lists begin at its frame `from`;
    `critical`, `action` and `p_nde` have one entry a decision (every 10 frames from the test's start, frame 0); `ttc`
    and `ttcPlane` one a shown frame, null for infinite. `first` is the index of the first frame shown. `wayOut` is like
    a vehicle: the AV on a way out, up to the last frame shown; null without a way out. `surface` holds the areas and
    lines of `report.surface`, as lists, null for infinite; it is absent on a road of `lanes` that all go on. At a site
    `site` holds `report.site_surface` instead, each shape as x, y, x, y, ..., each light with the frames from which it
    shows the letters; x is east of where the AV was at the start, y north, and no vehicle has a lane. Where the AV's
    perception is not perfect, `seenX` and `seenY` of a vehicle say where the AV saw it, null where it did not. At a
    site where it is, they are null where a vehicle hides it from the AV's middle, and `lineOfSight` is true.

    Args:
        case_id: Name of the case, `seed:test`.
        scenario: The case; vehicles far from the AV may have been left out.
        way_out: How the AV could have avoided the crash; None if no way is known.
        first: First frame that is shown; None: the start of the last `SHOWN_S`.
        partner: Slot of the vehicle for `ttc` and `ttcPlane`, which is always shown, where the AV crashed with none;
            None: no vehicle.
    """
    n_frames = len(scenario.x)
    if first is None:
        first = first_shown(scenario)
    struck = scenario.partner
    told = struck if struck is not None or partner is None else _column_of(scenario, partner)
    near = _near(scenario, first, told)
    columns = [int(c) for c in np.flatnonzero(near.any(axis=0))]
    position = {column: i for i, column in enumerate(columns)}
    told_all = scenario.odd.perception is None
    by_line = told_all and scenario.odd.site is not None
    odd = replace(scenario.odd, perception=Perception(occlusion=True)) if by_line else scenario.odd
    seen = None if odd.perception is None else perceived(replace(scenario, odd=odd))
    return {
        "id": case_id,
        "dt": FRAME_S,
        "first": first,
        "frames": n_frames - first,
        "lanes": scenario.odd.n_lanes,
        "laneWidth": scenario.odd.lane_width,
        **(_surface(scenario) if scenario.odd.site is None else _site(scenario, scenario.odd.site, first)),
        **({"lineOfSight": True} if by_line else {}),
        "maxSpeed": scenario.odd.max_speed,
        "vehicles": [_vehicle(scenario, column, near[:, column], first, seen) for column in columns],
        "wayOut": None if way_out is None else ghost(scenario, way_out, first),
        "critical": [position.get(int(c), -1) for c in scenario.critical_bv],
        "action": [_action(scenario, k) for k in range(len(scenario.critical_bv))],
        "p_nde": [_probability(scenario, k) for k in range(len(scenario.critical_bv))],
        "crash": None if scenario.crash is None else round(scenario.crash.time / FRAME_S) - first,
        "partner": -1 if struck is None else position.get(struck, -1),
        "ttc": [] if told is None or scenario.odd.site is not None else _rounded(lane_ttc(scenario, told)[first:]),
        "ttcPlane": [] if told is None else _rounded(plane_ttc(scenario, told)[first:]),
    }


def unseen_s(scenario: Scenario) -> float:
    """Say how long of the last `BEFORE_S` before contact the AV did not see its crash partner [s]."""
    if scenario.odd.perception is None or scenario.partner is None:
        return 0.0
    seen = perceived(scenario)[-round(BEFORE_S / FRAME_S) - 1 : -1, scenario.partner, 0]
    return round(float(np.isnan(seen).sum()) * FRAME_S, 1)


def _surface(scenario: Scenario) -> dict[str, Any]:
    odd = scenario.odd
    found, plain = surface_of(odd, float(scenario.x[0, 0])), surface_of(replace(odd, road=None, task="through"))
    if found == plain:
        return {}
    areas = [_rounded(np.array(area)) for area in found.areas]
    lines = [[*_rounded(np.array(line[:4])), line.mark] for line in found.lines]
    return {"surface": {"areas": areas, "lines": lines}}


def _site(scenario: Scenario, site: Site, first: int) -> dict[str, Any]:
    """Make what `case_data` says of a site; lights of frames before the first one shown are left out."""
    found, start = site_surface(site), np.array([scenario.x[0, 0], 0.0])
    clock = clock_in(scenario) + first * FRAME_S
    changes = changes_of(site, clock, len(scenario.x) - first, FRAME_S)

    def flat(points: NDArray[np.float64]) -> list[float | None]:
        return _rounded((points - start).ravel(), 2)

    lights = [
        {"at": flat(light.at), "walks": light.walks, "from": [frame for frame, _ in shown],
         "letters": "".join(letter for _, letter in shown)}
        for light, shown in zip(found.lights, changes, strict=True)
    ]  # fmt: skip
    shapes = {name: [flat(one) for one in getattr(found, name)] for name in ("lanes", "edges", "bars", "stops")}
    return {"site": {**shapes, "lights": lights}}


def first_shown(scenario: Scenario) -> int:
    """Return the first frame of the last `SHOWN_S` of a recording."""
    return max(0, len(scenario.x) - 1 - round(SHOWN_S / FRAME_S))


def _column_of(scenario: Scenario, slot: int) -> int | None:
    columns = np.flatnonzero(scenario.slot == slot)
    return int(columns[0]) if columns.size else None


def _near(scenario: Scenario, first: int, partner: int | None) -> NDArray[np.bool_]:
    """Mark vehicles that are present and near the AV, shape (T, N), none before `first`; `partner` is always near."""
    distance = np.abs(along(scenario.x[:, :1], np.where(scenario.present, scenario.x, np.inf)))
    if scenario.odd.site is not None:
        distance = np.hypot(distance, np.where(scenario.present, scenario.y, 0.0) - scenario.y[:, :1])
    near = scenario.present & (distance <= SIGHT_M)
    for column in (0,) if partner is None else (0, partner):
        near[:, column] = scenario.present[:, column]
    near[:first] = False
    return near


def _vehicle(
    scenario: Scenario, column: int, near: NDArray[np.bool_], first: int, seen: NDArray[np.float64] | None
) -> dict[str, Any]:
    frames = np.flatnonzero(near)
    rows = slice(int(frames[0]), int(frames[-1]) + 1)
    start = scenario.x[0, 0]
    of_it = None if seen is None or column == 0 else seen[rows, column]
    return {
        "slot": int(scenario.slot[column]),
        "kind": CLASSES[scenario.kind[column]].name,
        "length": round(float(scenario.length[column]), 3),
        "width": round(float(scenario.width[column]), 3),
        "from": rows.start - first,
        "x": _rounded(along(start, scenario.x[rows, column])),
        "y": _rounded(scenario.y[rows, column]),
        "v": _rounded(scenario.speed[rows, column]),
        "h": _rounded(scenario.heading[rows, column], 4),
        "lane": [-1] * (rows.stop - rows.start) if scenario.odd.site else scenario.target_lane[rows, column].tolist(),
        **({} if of_it is None else {"seenX": _rounded(along(start, of_it[:, 0])), "seenY": _rounded(of_it[:, 1])}),
    }


def ghost(scenario: Scenario, way_out: WayOut, first: int) -> dict[str, Any] | None:
    """Return the AV on another way, as a vehicle of `case_data`; None if it begins at the contact.

    Args:
        scenario: The case.
        way_out: The motion.
        first: First frame that is shown.
    """
    if scenario.crash is None:
        return None
    begin = round((scenario.crash.time - way_out.begin_s) / FRAME_S)
    rows = slice(max(0, first - begin), len(scenario.x) - begin)
    if len(way_out.x[rows]) < 2:
        return None
    return {
        "length": round(float(scenario.length[0]), 3),
        "width": round(float(scenario.width[0]), 3),
        "from": max(begin - first, 0),
        "x": _rounded(along(scenario.x[0, 0], way_out.x[rows])),
        "y": _rounded(way_out.y[rows]),
        "v": _rounded(way_out.speed[rows]),
        "h": _rounded(way_out.heading[rows], 4),
        "lane": [-1] * len(way_out.x[rows]),
    }


def _rounded(values: NDArray[np.float64], decimals: int = 3) -> list[float | None]:
    """Make JSON numbers; NaN and infinity, which JSON lacks, become None."""
    # Adding 0 turns -0.0 into 0.0, which is shorter to write.
    exact = np.round(values.astype(np.float64), decimals) + 0.0
    return [value if math.isfinite(value) else None for value in exact.tolist()]


def _action(scenario: Scenario, k: int) -> str:
    """Say what the critical BV decided."""
    column = int(scenario.critical_bv[k])
    index = int(scenario.action[k, column]) if column >= 0 else -1
    if index < 0:
        return ""
    if scenario.odd.site is None:
        return ACTIONS[index].name
    if scenario.kind[column] == PERSON:
        return _WALKING[index] if index < len(_WALKING) else ""
    return _DRIVING[index] if index < len(_DRIVING) else ACTIONS[index].name


def _probability(scenario: Scenario, k: int) -> float | None:
    """Probability of the critical BV's action in natural traffic, two digits; None where there is no critical BV."""
    if scenario.critical_bv[k] < 0:
        return None
    return float(f"{math.exp(float(scenario.log_prob_nde[k])):.2g}")
