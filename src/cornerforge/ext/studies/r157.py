"""`r157` drives an AV through the scenarios of UN Regulation 157, beside the reference drivers."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._options import verb
from cornerforge.drivers.careful import CAREFUL, HOLDS, SCENARIOS, drives_into
from cornerforge.errors import AvFaultError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import (
    check_new_folder,
    code_hash,
    open_output,
    provenance,
    version,
    write_json,
    write_text,
)
from cornerforge.experiment.setting import AV_LOG, experiment, road_of
from cornerforge.ext.studies.options import R157
from cornerforge.ext.studies.r157_roads import closing_at_least, cut_in_density
from cornerforge.ext.studies.r157_scenarios import FAMILIES, Driven, Panel, panels, rails_of_panel, road_of_r157
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.harvester import CaseRoom
from cornerforge.library.schema import ON_RAILS, SCRIPTED
from cornerforge.ndd.model import save_model
from cornerforge.results import Regulated
from cornerforge.results.r157 import RegulatedFamily, RegulatedPair, RegulatedRoads
from cornerforge.sim import Setting, controllers, outcome, rails, runner
from cornerforge.work import in_order

__all__ = ["r157", "r157_text"]

_CHUNK = 128
_SHARD_CASES = 1000
_KMH = 3.6
_HELD = "held speed"
_DRIVERS = {**CAREFUL, _HELD: HOLDS}
_OUTCOMES = {outcome.AV_CRASH: "failed", outcome.AV_FAULT: "fault"}
_UP = {"cut-in": "lateral_speed_mps", "cut-out": "lateral_speed_mps", "deceleration": "deceleration_mps2"}
_ACROSS = {"cut-in": "gap_m", "cut-out": "gap_ahead_of_lead_m", "deceleration": "time_gap_s"}
"""Family -> column of what changes along a picture's axes."""


@verb(R157)
def r157(options: R157) -> Regulated:
    """Drive an AV through the scenarios of UN Regulation 157: cut-in, cut-out, deceleration of the lead.

    In each scenario the AV drives at first as fast as it is set to. The other vehicles move as the scenario says,
    independent of it. The AV may brake, accelerate and change lanes; it fails if it touches another vehicle or is
    touched. Beside it each reference driver drives through the same scenario (`drivers.careful.drives_into`).

    Returns:
        What `cornerforge r157 --json` prints.

    Raises:
        CornerForgeError: A name is not known, the folder cannot be used, or an AV from outside fails too often.
    """
    began = time.perf_counter()
    n_threads = check_threads(options.threads)
    world = options.world()
    odd = road_of_r157(road_of(world))
    families = [options.families] if isinstance(options.families, str) else options.families
    wanted, too_fast = panels(FAMILIES if list(families) == ["all"] else families, odd)
    place = None if options.out is None else Path(options.out)
    if place is not None:
        from cornerforge.ext.studies.r157_page import check_r157_page

        check_r157_page()
        check_new_folder(place)  # before an AV from outside starts
    run = experiment(world, road=odd, takes_foreign=True, seed=options.seed)
    if place is not None:
        open_output(place, _identity(run, wanted, options.seed), resume=None)
        run.keep_printed(place / AV_LOG)
    total = sum(map(len, wanted))
    forecast(run, options.threads, f"{total:,} scenarios", tests=total)
    driven: list[Driven] = []
    library = None if place is None else _open_library(run, place / "library", options.seed)
    for panel in wanted:
        course = rails_of_panel(panel, odd)
        setting = _setting(run.setting, panel, course)
        driven.append(
            Driven(panel, _drive(run, setting, panel, options.seed, n_threads), _judge(panel, course, n_threads))
        )
        options.progress("scenarios", sum(len(one.panel) for one in driven), total)
        if library is not None:
            _keep(replace(run, setting=setting), driven[-1], course, library, options.seed)
    if not any(one.known.any() for one in driven):
        raise AvFaultError(f"The AV {run.av.name} failed to answer in all of {total:,} scenarios.")
    result = _result(run, driven, too_fast)
    if place is None or library is None:
        return replace(result, seconds=round(time.perf_counter() - began, 3))
    library.finish()
    write_json(library.path / "provenance.json", provenance(library.identity))
    write_text(place / "scenarios.csv", _csv(driven))
    from cornerforge.ext.studies.r157_page import write_r157_page

    result = replace(result, library=str(library.path), page=str(place / "r157.html"))
    write_r157_page(place / "r157.html", result, driven)
    result = replace(result, seconds=round(time.perf_counter() - began, 3))
    write_json(place / "provenance.json", provenance(_identity(run, wanted, options.seed), result.seconds))
    return result


def _identity(run: Experiment, wanted: Sequence[Panel], seed: int) -> dict[str, Any]:
    """Name what decides the result."""
    return {**run.identity(seed), "families": ",".join(dict.fromkeys(panel.family for panel in wanted))}


def _setting(setting: Setting, panel: Panel, course: rails.Rails) -> Setting:
    """Put the others on rails, and set the AV to the speed that it has."""
    return setting.with_drivers(critical=controllers.NOBODY, others=controllers.RAILS, rails=course).with_set_speed(
        panel.av_kmh / _KMH
    )


def _drive(run: Experiment, setting: Setting, panel: Panel, seed: int, threads: int) -> NDArray[np.uint8]:
    chunks = runner.simulate_chunks(
        setting, run.slots, seed=seed, first=panel.first, tests=len(panel), threads=run.processes(threads),
        chunk=run.range_size(_CHUNK, len(panel), threads), drive=run.drive,
    )  # fmt: skip
    return np.concatenate([out.code for _, out, _ in chunks])


def _judge(panel: Panel, course: rails.Rails, threads: int) -> dict[str, NDArray[np.bool_]]:
    """Let each reference driver drive in the AV's place."""
    sizes = np.stack([course.start["length"][0], course.start["width"][0]], axis=1)
    av = course.start[0, 0]
    place, speed = (float(av["x"]), float(av["y"])), float(av["speed"])

    def judge(first: int, count: int) -> list[list[bool]]:
        poses = course.poses[first : first + count]
        scenario = SCENARIOS[panel.family]
        return [[drives_into(code, scenario, speed, place, sizes, one) >= 0 for code in _DRIVERS.values()]
                for one in poses]  # fmt: skip

    rows = [row for part in in_order(judge, 0, len(panel), chunk=_CHUNK, threads=threads) for row in part]
    return dict(zip(_DRIVERS, np.array(rows, dtype=np.bool_).T, strict=True))


def _open_library(run: Experiment, place: Path, seed: int) -> CaseLibrary:
    identity = {**run.identity(seed), SCRIPTED: True, ON_RAILS: True, "cornerforge": version(), "code": code_hash()}
    library = CaseLibrary.create(place, identity, run.odd)
    save_model(run.model, place / MODEL_FILE)
    return library


def _keep(run: Experiment, one: Driven, course: rails.Rails, library: CaseLibrary, seed: int) -> None:
    """Record the scenarios that the AV fails in, and store them."""
    recorder = run.recorder()
    room = CaseRoom(run.slots, int(run.setting.road.max_decisions))
    columns = _columns(one)
    for k in np.flatnonzero(one.failed).tolist():
        recorder.drive(seed, one.panel.first + k)
        extra = {name: values[k] for name, values in columns.items()}
        # All of the rails: another AV may go on where this one crashed.
        room.add(recorder, extra, start=course.start[k], poses=course.poses[k])
    after = one.panel.first + len(one.panel)
    done, crashes = library.tests + len(one.panel), library.crashes + len(room)
    library.fill(*room.take(), next_test=after, tests=done, crashes=crashes, shard_cases=_SHARD_CASES)


def _columns(one: Driven) -> dict[str, list[Any]]:
    """Make the columns of the scenario and of the AVs that crash in it; NaN where a quantity does not apply."""
    panel = one.panel
    x, y = panel.points
    nothing = np.full(len(panel), np.nan)
    values = dict.fromkeys((*_ACROSS.values(), *_UP.values()), nothing)
    values[_ACROSS[panel.family]], values[_UP[panel.family]] = x, y
    return {
        "family": [panel.family] * len(panel),
        "av_kmh": [panel.av_kmh] * len(panel),
        "other_kmh": [panel.other_kmh] * len(panel),
        **{name: column.tolist() for name, column in values.items()},
        **{f"crash_{name.replace('-', '_').replace(' ', '_')}": one.crashes[name].tolist() for name in _DRIVERS},
    }


def _csv(driven: Sequence[Driven]) -> str:
    """List all scenarios, one a line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for number, one in enumerate(driven):
        columns = _columns(one)
        if number == 0:
            writer.writerow(["scenario", "av", *columns])
        for k, row in enumerate(zip(*columns.values(), strict=True)):
            shown = ["" if isinstance(v, float) and np.isnan(v) else int(v) if isinstance(v, bool) else v for v in row]
            writer.writerow([one.panel.first + k, _OUTCOMES.get(int(one.code[k]), "passed"), *shown])
    return text.getvalue()


def _verdicts(driven: Sequence[Driven]) -> dict[str, Any]:
    """Count over panels: the fields that all results share."""
    by_all = [np.logical_and.reduce([one.prevented(name) for name in CAREFUL]) for one in driven]
    return {
        "scenarios": sum(int(one.known.sum()) for one in driven),
        "failed": sum(int(one.failed.sum()) for one in driven),
        "failed_but_prevented_by": {n: sum(int(one.prevented(n).sum()) for one in driven) for n in CAREFUL},
        "failed_but_prevented_by_all": sum(int(one.sum()) for one in by_all),
        "failed_but_held_speed_passes": sum(int(one.prevented(_HELD).sum()) for one in driven),
        "reference_crashes": {n: sum(int((one.crashes[n] & one.known).sum()) for one in driven) for n in CAREFUL},
    }  # fmt: skip


def _weights(one: Driven) -> NDArray[np.float64] | None:
    """How often each of a panel's cut-ins happens, relative to each other; None: not known."""
    panel = one.panel
    if panel.family != "cut-in":
        return None
    x, y = panel.points
    closing = (panel.av_kmh - panel.other_kmh) / _KMH
    density = cut_in_density(panel.other_kmh / _KMH, closing, x, y)
    if density is None:
        return None
    weights = np.where(one.known, density * (panel.across[1] - panel.across[0]), 0.0)
    return weights if weights.sum() > 0.0 else None


def _roads(one: Driven) -> RegulatedRoads | None:
    weights = _weights(one)
    other, closing = one.panel.other_kmh / _KMH, (one.panel.av_kmh - one.panel.other_kmh) / _KMH
    at_least = closing_at_least(other, closing)
    if weights is None or at_least is None:
        return None
    total = weights.sum()
    return RegulatedRoads(
        at_least=at_least,
        failed=float(weights[one.failed].sum() / total),
        failed_but_prevented_by={name: float(weights[one.prevented(name)].sum() / total) for name in CAREFUL},
    )


def _result(run: Experiment, driven: Sequence[Driven], too_fast: Sequence[int]) -> Regulated:
    every = _verdicts(driven)
    n = max(1, every["scenarios"])
    weighed = [(one, weights) for one in driven if (weights := _weights(one)) is not None]
    total = sum(float(weights.sum()) for _, weights in weighed)
    families = []
    for family in dict.fromkeys(one.panel.family for one in driven):
        counted = _verdicts([one for one in driven if one.panel.family == family])
        share = counted["failed"] / max(1, counted["scenarios"])
        families.append(RegulatedFamily(**counted, family=family, share_failed=share))
    return Regulated(
        **every,
        av=run.av.name,
        odd=run.odd.name,
        share_failed=every["failed"] / n,
        share_failed_but_prevented_by_all=every["failed_but_prevented_by_all"] / n,
        av_faults=sum(int((~one.known).sum()) for one in driven),
        too_fast_kmh=tuple(too_fast),
        roads_failed=sum(float(w[one.failed].sum()) for one, w in weighed) / total if weighed else None,
        roads_failed_but_prevented_by={
            name: sum(float(w[one.prevented(name)].sum()) for one, w in weighed) / total for name in CAREFUL
        } if weighed else None,
        families=tuple(families),
        pairs=tuple(
            RegulatedPair(
                **_verdicts([one]), family=one.panel.family, av_kmh=one.panel.av_kmh, other_kmh=one.panel.other_kmh,
                on_roads=_roads(one),
            )
            for one in driven
        ),
        library=None,
        page=None,
        seconds=0.0,
    )  # fmt: skip


def r157_text(r: Regulated) -> str:
    """Tell the result in text."""
    lines = [
        f"{r.av} in {r.scenarios:,} scenarios of UN R157 (ODD {r.odd}): failed {r.failed:,} ({r.share_failed:.2%})"
    ]
    if r.av_faults:
        lines[0] += f"; left out {r.av_faults:,} in which the AV gave no usable answer"
    for family in r.families:
        by = ", ".join(f"{name} {n:,}" for name, n in family.failed_but_prevented_by.items())
        refs = ", ".join(f"{name} {n:,}" for name, n in family.reference_crashes.items())
        lines.append(
            f"  {family.family}: failed {family.failed:,} of {family.scenarios:,}; of these prevented by {by}; by all "
            f"four {family.failed_but_prevented_by_all:,}; by holding the speed {family.failed_but_held_speed_passes:,}"
            f" (crashes of the reference drivers: {refs})"
        )
    if r.roads_failed is not None and r.roads_failed_but_prevented_by is not None:
        by = ", ".join(f"{name} {_small(part)}" for name, part in r.roads_failed_but_prevented_by.items())
        lines.append(
            f"  Cut-ins weighted as often as SPMD's fit has them: the AV fails in a share of {_small(r.roads_failed)}; "
            f"and the driver does not: {by}"
        )
    if r.too_fast_kmh:
        lines.append(f"  Left out, the ODD is slower: {', '.join(map(str, r.too_fast_kmh))} km/h")
    lines.append("  A grid is no sample of the road: shares of scenarios are no rates.")
    if r.page is not None:
        lines.append(f"Library: {r.library}; page: {r.page}")
    return "\n".join(lines)


def _small(part: float) -> str:
    """Write a share; so near as that, cut-ins are not on record."""
    return "below 1e-6" if 0.0 < part < 1e-6 else f"{part:.2g}"
