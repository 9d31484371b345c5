"""`site fit`: the laws of drivers and people at a site, from data where they tell them, else from publications."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from cornerforge._options import verb
from cornerforge._schema import hints_of, unit_of
from cornerforge.experiment.output import check_new_file
from cornerforge.ext.calibrate.options import SiteFit
from cornerforge.ext.calibrate.site_data import SITE_FILES, kept_apart, owners, read_site_data, words
from cornerforge.ext.calibrate.site_following import FollowingFit, fit_following, following_of, turning_of
from cornerforge.ext.calibrate.site_people import (
    STATES,
    EncounterFit,
    Found,
    critical_gap,
    fit_encounters,
    gaps_of,
    share,
    step_back_of,
    walks_of,
)
from cornerforge.ext.calibrate.site_published import PUBLISHED
from cornerforge.ext.calibrate.tables import Table
from cornerforge.results.site_laws import LawFitted, SiteFact, SiteFitted
from cornerforge.results.stating import as_json
from cornerforge.site.laws import Laws
from cornerforge.work.files import write_json

__all__ = ["laws_of", "site_fit", "site_fit_text"]

_STATED_FIRST = (0.383, 0.329, 0.361, 0.494)
_STATED_LEAVE = (0.312, 0.53, 0.38, 0.25, 0.19)
_STATED_WALKS = (1.13, 1.31, 1.57, 1.95, 3.0)
_STATED_GAP = {"DE": (4.95, 0.25), "JP": (6.05, 0.30)}
"""Facts of the whole files (urban/README), of which a part is set aside elsewhere."""
_LEAVES_OUT = {
    "headway": "one street in Los Angeles, 2005, cars; vehicles are taken as boxes' centres, lanes by geometry",
    "headway_spread": "differences between streets and hours; it is of what drivers keep in steady following",
    "standstill": "people that leave a crossing or a driveway free",
    "acceleration": "speeds above 15 m/s",
    "braking": "hard braking; it is the IDM's alone: followers brake early and gently, and stop with `stopping`",
    "stopping": "stops for amber, which are harder (first to stop 3.0 m/s², Gates et al. 2007)",
    "noise": "errors of the recording, which it holds too: it is an upper bound",
    "lateral": "headings of the recording scatter, so it is an upper bound; one corner's radii",
    "walks": "bicycles; all of the crossing's width over whole seconds",
    "walk_change": "stops on the way (0.8 % of groups)",
    "obeys": "people to whom walk came before they had a chance count as obedient",
    "patience": "waits longer than 30 s count as 30 s; without that it is longer",
    "starts_early": "signal times are of a clock of their own, by up to some tenths of a second",
    "gap_walk": "Germany; Japan is in the facts. Virtual reality: gaps in a street may be shorter. One lane, no zebra",
    "gap_walk_spread": "it holds what one person varies by, too",
    "steps_back": "it takes each step back and each collision as one try over the median time on the lane",
    "to_people": "on walk and flashing don't walk; on solid drivers leave less, as the facts say. Right turns only",
    "to_people_spread": "between signals",
    "after_people": "median; its log's standard deviation between drivers, 0.21, is left out. Right turns only",
    "gives_way": "on walk; the arrival difference is taken as uniform",
    "gives_way_spread": "hardly told by whole seconds: see the interval",
    "after_vehicles": "median, of those up to 10 s; that it scatters between people as `gives_way` is judged",
}


@dataclass
class _Told:
    """Findings so far: by law its value, with data behind it; facts; notes."""

    laws: dict[str, tuple[tuple[float, ...], Found, str]] = field(default_factory=dict)
    facts: list[SiteFact] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def law(self, name: str, found: Found, source: str, values: tuple[float, ...] = ()) -> None:
        self.laws[name] = (values or (found.value,), found, source)

    def fact(
        self, fact: str, unit: str, found: Found, source: str, laws: float | None = None, stated: float | None = None
    ) -> None:
        ends = None if np.isnan(found.low) else (_short(found.low), _short(found.high))
        told = None if laws is None else _short(laws)
        self.facts.append(
            SiteFact(
                fact=fact, unit=unit, found=_short(found.value), interval95=ends, n=found.n, laws=told, stated=stated,
                source=source,
            )
        )  # fmt: skip

    def few(self, name: str, what: str) -> None:
        self.notes.append(f"{name}: too few {what}; the laws that they tell are as published.")


def _alone(value: float, n: int) -> Found:
    """Give a number without an interval."""
    return Found(value, np.nan, np.nan, n, 0)


def _short(value: float) -> float:
    """Four digits: beyond them processors differ, and so do resamples."""
    return float(f"{value:.4g}")


def laws_of(tables: Mapping[str, Table], say: Callable[[str], None]) -> tuple[Laws, SiteFitted, EncounterFit | None]:
    """Fit the laws to tables of `read_site_data`.

    Args:
        tables: By name of the file.
        say: Is told each step.

    Returns:
        The laws; what they rest on, with no file yet; and the fit of encounters, None without its file.
    """
    told = _Told()
    for file in SITE_FILES:
        if file.name not in tables:
            told.notes.append(f"{file.name} ({file.what}) is missing: its laws are as published.")
    encounters = None
    steps = {
        "ngsim_lankershim_clips": _following, "utah_ped_crossings": _walking, "dfki_street_crossing": _gaps,
        "dut_pet_events": _campus, "jaad_pedestrians": _dashcams,
    }  # fmt: skip
    for name, step in steps.items():
        if name in tables:
            say(name)
            step(tables[name], told)
    if (name := "utah_right_turn_conflicts") in tables:
        say(name)
        if (encounters := fit_encounters(tables[name])) is None:
            told.few(name, "encounters")
        else:
            _right_turns(encounters, told, name)
    rows = tuple(_row(one.name, told) for one in fields(Laws))
    chosen: dict[str, Any] = {row.name: row.values if row.name == "walks" else row.values[0] for row in rows}
    result = SiteFitted(laws=rows, facts=tuple(told.facts), notes=tuple(told.notes), files=())
    return Laws(**chosen), result, encounters


def _row(name: str, told: _Told) -> LawFitted:
    unit = unit_of(hints_of(Laws)[name].__metadata__[0])
    if name in told.laws:
        values, found, source = told.laws[name]
        return LawFitted(
            name=name, values=tuple(map(_short, values)), unit=unit,
            interval95=(_short(found.low), _short(found.high)), span=None, n=found.n, groups=found.groups,
            rests_on="data", source=source, leaves_out=_LEAVES_OUT[name],
        )  # fmt: skip
    row = PUBLISHED[name]
    values = row.value if isinstance(row.value, tuple) else (row.value,)
    return LawFitted(
        name=name, values=values, unit=unit, interval95=None, span=(row.low, row.high), n=0, groups=0,
        rests_on=row.checked, source=row.source, leaves_out=row.leaves_out,
    )  # fmt: skip


def _following(table: Table, told: _Told) -> None:
    name = "ngsim_lankershim_clips"
    if (turning := turning_of(table)) is None:
        told.few(name, "turns, starts or stops")
    else:
        told.law("lateral", _measured(turning.lateral), f"{name}, most of 1 s in a turn, median over vehicles")
        told.law("stopping", _measured(turning.stopping), f"{name}, v²/2d of stops from 8 m/s, median over vehicles")
        starts = _measured(turning.starting)
        told.fact("mean acceleration in the first 3 s from a stand, nobody ahead, median", "m/s2", starts, name)
    if (fit := fit_following(following_of(table))) is None:
        told.few(name, "drivers that follow somebody for 3 s")
        return
    for law, value in fit.values.items():
        told.law(law, Found(value, *fit.intervals[law], fit.runs, fit.drivers), f"{name}, followers driven again")
    _scores(fit, told, name)
    told.notes += [
        f"{name}: the pace that drivers wish cannot be told: the file has no limits and no speed above 15.8 m/s.",
        f"{name}: the delay at green cannot be told: signal phases are not recorded.",
    ]


def _measured(found: tuple[float, float, float, int]) -> Found:
    return Found(*found, found[3])


def _scores(fit: FollowingFit, told: _Told, name: str) -> None:
    where = f"{name}, drivers kept apart ({fit.apart_drivers} of {fit.drivers})"
    for law, score in fit.scores.items():
        told.fact(f"root mean square error of the gap, {law}", "m", _alone(score.error, fit.apart_runs), where)
        told.fact(f"CRPS of the gap after 5 s, {law}", "m", _alone(score.crps, fit.apart_runs), where)
        beside = Found(score.crps - fit.scores["fairly fitted IDM"].crps, *score.beside, fit.apart_runs, 0)
        if law != "fairly fitted IDM":
            told.fact(f"the same minus that of the fairly fitted IDM, {law}", "m", beside, where)


def _walking(table: Table, told: _Told) -> None:
    name = "utah_ped_crossings"
    if (walks := walks_of(table)) is None:
        told.few(name, "crossings")
        return
    told.law(
        "walks", walks.speeds[3], f"{name}, ends from the 1 and 99 % quantiles", tuple(s.value for s in walks.speeds)
    )
    told.law("walk_change", walks.changes, f"{name}, groups that changed speed over seconds walked")
    takes = walks.takes
    told.law("obeys", Found(1 - takes.value, 1 - takes.high, 1 - takes.low, takes.n, takes.groups), name)
    told.law("patience", walks.patience, f"{name}, people that leave the later, the fewer")
    told.law("starts_early", walks.early, f"{name}, of those that still wait 2.5 s before walk")
    for k, (part, stated) in enumerate(zip((5, 15, 50, 85, 95), _STATED_WALKS, strict=True)):
        speed, (here, there, n) = walks.speeds[k + 1], walks.apart
        told.fact(f"walking speed, {part} % quantile", "m/s", speed, name, speed.value, stated)
        told.fact("the same at signals kept apart, beside the others'", "m/s", _alone(here[k], n), name, there[k])
    words_of = ("all", "no vehicle in the next 10 s", "1 vehicle", "2 or 3", "4 or more")
    for what, leave, stated in zip(words_of, walks.leave, _STATED_LEAVE, strict=True):
        told.fact(f"share that leaves on solid don't walk, {what}", "", leave, name, stated=stated)


def _gaps(table: Table, told: _Told) -> None:
    name = "dfki_street_crossing"
    for country, (median, spread) in _STATED_GAP.items():
        gaps = gaps_of(table, country)
        fine, apart = gaps.missed < gaps.taken, kept_apart(gaps.person)
        if np.unique(gaps.person[fine]).size < 10 or not (fine & apart).any():
            told.few(name, f"people in {country}")
            continue
        fit = critical_gap(gaps)
        if country == "DE":
            told.law("gap_walk", fit.median, f"{name}, Germany, near lane, no zebra")
            told.law("gap_walk_spread", fit.spread, f"{name}, Germany, near lane, no zebra")
        where = f"{name}; {fit.inconsistent} took no larger gap than one that they let pass, and are left out"
        told.fact(f"median critical gap of people, {country}", "s", fit.median, where, stated=median)
        told.fact(f"standard deviation of its log, {country}", "", fit.spread, where, stated=spread)
        others = critical_gap(gaps.of(~apart)).median.value
        told.fact(
            f"median of people kept apart, beside the others', {country}",
            "s",
            critical_gap(gaps.of(apart)).median,
            where,
            others,
        )
    if (back := step_back_of(table)) is None:
        told.few(name, "step backs")
    else:
        told.law("steps_back", back, f"{name}, step backs and collisions")


def _right_turns(fit: EncounterFit, told: _Told, name: str) -> None:
    for law in ("to_people", "to_people_spread", "after_people", "gives_way", "gives_way_spread"):
        told.law(law, fit.values[law], f"{name}, by likelihood")
    told.law("after_vehicles", fit.values["after_vehicles"], f"{name}, people that let a vehicle go")
    for other in sorted(fit.values.keys() - told.laws.keys()):
        told.fact(f"median, {other}" if "spread" not in other else other, "s", fit.values[other], f"{name}, fitted")
    of_laws = [None, *(float(chance[:2].sum()) for chance in fit.expected)]
    near = [None, *(float(chance[:, :3].sum()) for chance in fit.expected)]
    whose = ("all", *(f"people on {state}" for state in STATES))
    for k, what in enumerate(whose):
        told.fact(f"vehicle first, {what}", "", fit.vehicle_first[k], name, of_laws[k], _STATED_FIRST[k])
    for k, what in enumerate(whose):
        stated = 0.272 if k == 0 else None
        told.fact(f"within 3 s of each other, {what}", "", fit.within_3[k], name, near[k], stated)
    likely, shares, n, signals = fit.apart
    told.fact(
        "mean log-likelihood of an encounter, beside that of the other signals' shares", "nats",
        _alone(shares, n), f"{name}, {signals} signals kept apart", likely,
    )  # fmt: skip
    told.notes.append(
        f"{name}: {fit.within_3[0].value:.1%} are within 3 s of each other, and 27.2 % were stated of the whole file: "
        "the part that is set aside differs, or that share was counted otherwise."
    )
    told.notes.append(
        f"{name}: {fit.left_out} encounters without a signal for people, at the same time or beyond 10 s are in the "
        "shares and not in the fit."
    )


def _campus(table: Table, told: _Told) -> None:
    time, clip = table.numbers["dt"], owners(words(table, "clip"))
    told.fact("vehicle first, campus in Dalian, no signals", "", share(time > 0, clip), "dut_pet_events, not fitted")
    told.fact("within 3 s of each other, the same", "", share(np.abs(time) <= 3, clip), "dut_pet_events, not fitted")


def _dashcams(table: Table, told: _Told) -> None:
    action, name = words(table, "vehicle_action_1s_before"), "jaad_pedestrians"
    seen = (table.numbers["crossing"] == 1) & ~np.isin(action, ("?", ""))
    if not seen.any():
        told.few(name, "crossings")
        return
    yields = share(np.isin(action[seen], ("decelerating", "stopped")), owners(words(table, "video")[seen]))
    told.fact("driver slows down or stands 1 s before a person crosses", "", yields, f"{name}, not fitted")


@verb(SiteFit)
def site_fit(options: SiteFit) -> SiteFitted:
    """Fit the laws of drivers and people at a site to a folder of data, and write them.

    Returns:
        What `cornerforge site fit --json` prints.

    Raises:
        DataError: A file is damaged or lacks a column, or the folder has none of the files.
        MissingExtraError: A report is wanted, and matplotlib is not installed.
        OutputError: A file cannot be written.
    """
    out = Path(options.out)
    check_new_file(out)
    page = None if options.report is None else Path(options.report)
    if page is not None:
        from cornerforge.report.drawing import check_matplotlib

        check_matplotlib()
        check_new_file(page)
    laws, result, encounters = laws_of(
        read_site_data(Path(options.data)), lambda step: options.progress(f"fit: {step}", 0, 1)
    )
    files = (str(out),) if page is None else (str(out), str(page))
    result = SiteFitted(laws=result.laws, facts=result.facts, notes=result.notes, files=files)
    write_json(out, as_json(laws))
    if page is not None:
        from cornerforge.ext.calibrate.site_page import write_site_page

        write_site_page(result, encounters, page)
    return result


def site_fit_text(result: SiteFitted) -> str:
    """Tell the result of `site_fit` in text: each law with its interval and source, then notes."""
    lines = []
    for law in result.laws:
        value = ", ".join(f"{one:g}" for one in law.values)
        ends = law.interval95 or law.span
        span = "" if ends is None else f" ({ends[0]:g} to {ends[1]:g})"
        lines.append(f"{law.name:<18}{value}{span} {law.unit}  {law.rests_on}: {law.source}")
    return "\n".join([*lines, *(f"Note: {note}" for note in result.notes), *(f"File: {name}" for name in result.files)])
