"""`suite run` and `r157` drive an AV through a suite of scenarios, beside the reference drivers (ADR 42 and 80)."""

from __future__ import annotations

import csv
import io
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._options import verb
from cornerforge.drivers.careful import CAREFUL, HOLDS, drives_into
from cornerforge.errors import AvFaultError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import (
    check_new_file,
    check_new_folder,
    code_hash,
    open_output,
    provenance,
    version,
    write_json,
    write_text,
)
from cornerforge.experiment.setting import AV_LOG, experiment, road_of
from cornerforge.ext.studies.aeb_scenarios import AEB
from cornerforge.ext.studies.options import R157, SuiteRun
from cornerforge.ext.studies.r157_roads import closing_at_least, cut_in_density
from cornerforge.ext.studies.r157_scenarios import R157 as R157_SUITE
from cornerforge.ext.studies.scenarios import KMH, Driven, Panel, Suite, panels, rails_of_panel, road_of_suite
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.harvester import CaseRoom
from cornerforge.library.schema import ON_RAILS, SCRIPTED
from cornerforge.ndd.model import save_model
from cornerforge.results import Regulated, as_json
from cornerforge.results.r157 import RegulatedFamily, RegulatedPair, RegulatedRoads, RegulatedTest
from cornerforge.road.straight import along
from cornerforge.sim import Setting, controllers, outcome, rails, runner
from cornerforge.types import FRAME_S, Scenario
from cornerforge.verbs.retest_files import write_tests
from cornerforge.work import in_order

__all__ = ["SUITES", "fails_the_suite", "r157", "suite_run", "suite_run_text"]

SUITES = {suite.name: suite for suite in (AEB, R157_SUITE)}
_CHUNK = 128
_SHARD_CASES = 1000
_HELD = "held speed"
_DRIVERS = {**CAREFUL, _HELD: HOLDS}
_OUTCOMES = {outcome.AV_CRASH: "failed", outcome.AV_FAULT: "fault"}


@verb(SuiteRun)
def suite_run(options: SuiteRun) -> Regulated:
    """Drive an AV through a suite of scenarios, and say where it touches another vehicle and reference drivers do not.

    In each scenario the AV drives at first as fast as it is set to. The other vehicles move as the scenario says,
    independent of it. The AV may brake, accelerate, and change lanes where one is open; it fails if it touches another
    vehicle or is touched. Beside it each reference driver drives the same scenario (`drivers.careful.drives_into`).

    Returns:
        What `cornerforge suite run --json` prints.

    Raises:
        CornerForgeError: A name is not known, a place cannot be used, or an AV from outside fails too often.
    """
    return _run(SUITES[options.suite], options, None if options.junit is None else Path(options.junit))


@verb(R157)
def r157(options: R157) -> Regulated:
    """Drive an AV through the scenarios of UN Regulation 157: cut-in, cut-out, deceleration of the lead.

    The same as `suite_run("r157")`, whose command has JUnit XML and an exit status too.

    Returns:
        What `cornerforge r157 --json` prints.

    Raises:
        CornerForgeError: A name is not known, the folder cannot be used, or an AV from outside fails too often.
    """
    return _run(R157_SUITE, options, None)


def fails_the_suite(found: Regulated) -> str | None:
    """Say that the command fails, which its text has told already; None if the AV does what is demanded of it.

    It fails where it touches and each reference driver passes, where it touches faster than a regulation allows, and
    where it gives no usable answer.
    """
    return "" if found.failed_but_prevented_by_all or found.beyond_allowed or found.av_faults else None


def _run(suite: Suite, options: R157, junit: Path | None) -> Regulated:
    began = time.perf_counter()
    n_threads = check_threads(options.threads)
    world = options.world()
    odd = road_of_suite(suite, road_of(world))
    families = [options.families] if isinstance(options.families, str) else options.families
    every = [family.name for family in suite.families]
    wanted, too_fast = panels(suite, every if list(families) == ["all"] else families, odd)
    place = None if options.out is None else Path(options.out)
    if junit is not None:
        check_new_file(junit)
    if place is not None:
        from cornerforge.ext.studies.suite_run_page import check_suite_page

        check_suite_page()
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
        on_course = replace(run, setting=_setting(run.setting, panel, course))
        driven.append(_drive(on_course, panel, course, options.seed, n_threads))
        if library is not None or suite.has_tests:
            _keep(on_course, suite, driven[-1], course, library, options.seed)
        options.progress("scenarios", sum(len(one.panel) for one in driven), total)
    if not any(one.known.any() for one in driven):
        raise AvFaultError(f"The AV {run.av.name} failed to answer in all of {total:,} scenarios.")
    result = _result(run, suite, driven, too_fast)
    if junit is not None:
        name = f"cornerforge suite run {suite.name}"
        write_tests(junit, name, run.av.name, _junit(suite, driven), round(time.perf_counter() - began, 3))
    if place is None or library is None:
        return replace(result, seconds=round(time.perf_counter() - began, 3))
    library.finish()
    write_json(library.path / "provenance.json", provenance(library.identity))
    write_text(place / "scenarios.csv", _csv(suite, driven))
    from cornerforge.ext.studies.suite_run_page import write_suite_page

    result = replace(result, library=str(library.path), page=str(place / f"{suite.name}.html"))
    write_suite_page(place / f"{suite.name}.html", suite, result, driven)
    result = replace(result, seconds=round(time.perf_counter() - began, 3))
    write_json(place / "suite.json", as_json(result))
    write_json(place / "provenance.json", provenance(_identity(run, wanted, options.seed), result.seconds))
    return result


def _identity(run: Experiment, wanted: Sequence[Panel], seed: int) -> dict[str, Any]:
    """Name what decides the result."""
    return {**run.identity(seed), "families": ",".join(dict.fromkeys(panel.family.name for panel in wanted))}


def _setting(setting: Setting, panel: Panel, course: rails.Rails) -> Setting:
    """Put the others on rails, and set the AV to the speed that it has."""
    on_rails = setting.with_drivers(critical=controllers.NOBODY, others=controllers.RAILS, rails=course)
    return on_rails.with_set_speed(panel.av_kmh / KMH)


def _drive(run: Experiment, panel: Panel, course: rails.Rails, seed: int, threads: int) -> Driven:
    """Drive the AV, and each reference driver in its place."""
    chunks = [out for _, out, _ in runner.simulate_chunks(
        run.setting, run.slots, seed=seed, first=panel.first, tests=len(panel), threads=run.processes(threads),
        chunk=run.range_size(_CHUNK, len(panel), threads), drive=run.drive,
    )]  # fmt: skip
    code = np.concatenate([out.code for out in chunks])
    return Driven(panel, code, _judge(panel, course, threads), np.full(len(panel), np.nan))


def _judge(panel: Panel, course: rails.Rails, threads: int) -> dict[str, NDArray[np.bool_]]:
    """Let each reference driver drive in the AV's place."""
    sizes = np.stack([course.start["length"][0], course.start["width"][0]], axis=1)
    av = course.start[0, 0]
    place, speed = (float(av["x"]), float(av["y"])), float(av["speed"])

    def judge(first: int, count: int) -> list[list[bool]]:
        poses = course.poses[first : first + count]
        kind = panel.family.scenario
        return [[drives_into(code, kind, speed, place, sizes, one) >= 0 for code in _DRIVERS.values()]
                for one in poses]  # fmt: skip

    rows = [row for part in in_order(judge, 0, len(panel), chunk=_CHUNK, threads=threads) for row in part]
    return dict(zip(_DRIVERS, np.array(rows, dtype=np.bool_).T, strict=True))


def _open_library(run: Experiment, place: Path, seed: int) -> CaseLibrary:
    identity = {**run.identity(seed), SCRIPTED: True, ON_RAILS: True, "cornerforge": version(), "code": code_hash()}
    library = CaseLibrary.create(place, identity, run.odd)
    save_model(run.model, place / MODEL_FILE)
    return library


def _keep(
    run: Experiment, suite: Suite, one: Driven, course: rails.Rails, library: CaseLibrary | None, seed: int
) -> None:
    """Record the scenarios that the AV fails in, note the speeds of its contacts, and store them in a library."""
    recorder = run.recorder()
    room = CaseRoom(run.slots, int(run.setting.road.max_decisions))
    columns = _columns(suite, one)
    for k in np.flatnonzero(one.failed).tolist():
        recorder.drive(seed, one.panel.first + k)
        one.touch_kmh[k] = KMH * _touch_speed(recorder.scenario())
        if library is not None:
            extra = {name: values[k] for name, values in columns.items()}
            # All of the rails: another AV may go on where this one crashed.
            room.add(recorder, extra, start=course.start[k], poses=course.poses[k])
    if library is not None:
        after = one.panel.first + len(one.panel)
        done, crashes = library.tests + len(one.panel), library.crashes + len(room)
        library.fill(*room.take(), next_test=after, tests=done, crashes=crashes, shard_cases=_SHARD_CASES)


def _touch_speed(driven: Scenario) -> float:
    """Compute the relative speed along the road at the AV's contact [m/s].

    A contact is seen at the next tenth of a second. Where the bumpers met in between, the square of the relative speed
    is taken to change evenly with the way, as it does while both brake evenly.
    """
    assert driven.crash is not None
    last = round(driven.crash.time / FRAME_S)
    other = int(np.flatnonzero(driven.slot == driven.crash.slot_b)[0])
    two = slice(max(0, last - 1), last + 1)
    gap = np.abs(along(driven.x[two, 0], driven.x[two, other])) - 0.5 * (driven.length[0] + driven.length[other])
    before, after = (driven.speed[two, 0] - driven.speed[two, other])[[0, -1]] ** 2
    part = gap[0] / (gap[0] - gap[-1]) if gap[0] > 0.0 >= gap[-1] else 1.0
    return float(np.sqrt(before + part * (after - before)))


def _columns(suite: Suite, one: Driven) -> dict[str, list[Any]]:
    """Make the columns of the scenario and of the AVs that crash in it; NaN where a quantity does not apply."""
    panel = one.panel
    values = dict.fromkeys(suite.columns, np.full(len(panel), np.nan))
    values |= zip((panel.family.across.column, panel.family.up.column), panel.points, strict=True)
    return {
        "family": [panel.family.name] * len(panel),
        "av_kmh": [panel.av_kmh] * len(panel),
        "other_kmh": [panel.other_kmh] * len(panel),
        **{name: values[name].tolist() for name in suite.columns},
        **{f"crash_{name.replace('-', '_').replace(' ', '_')}": one.crashes[name].tolist() for name in _DRIVERS},
        **({"is_test": panel.tests.tolist(), "allowed_kmh": one.allowed_kmh.tolist()} if suite.has_tests else {}),
    }


def _point(suite: Suite, one: Driven, k: int) -> dict[str, float]:
    """Give what a scenario is made of besides its speeds, by column."""
    axes = (one.panel.family.across.column, one.panel.family.up.column)
    return {name: float(at[k]) for name, at in zip(axes, one.panel.points, strict=True) if name in suite.columns}


def _verdict(one: Driven, k: int) -> str:
    others = {outcome.AV_CRASH: "touched", outcome.AV_FAULT: "no answer", outcome.LEFT_ROAD: "left its lane"}
    return others.get(int(one.code[k]), "avoided")


def _tests(suite: Suite, driven: Sequence[Driven]) -> tuple[RegulatedTest, ...]:
    """List the tests that the protocols demand."""
    return tuple(
        RegulatedTest(
            scenario=one.panel.first + k,
            family=one.panel.family.name,
            av_kmh=one.panel.av_kmh,
            other_kmh=one.panel.other_kmh,
            point=_point(suite, one, k),
            verdict=_verdict(one, k),
            touch_kmh=_number(one.touch_kmh[k]),
            allowed_kmh=_number(one.allowed_kmh[k]),
            reference_touched=tuple(name for name in CAREFUL if one.crashes[name][k]),
        )
        for one in driven
        for k in np.flatnonzero(one.panel.tests).tolist()
    )


def _number(value: float) -> float | None:
    return None if np.isnan(value) else round(float(value), 2)


def _junit(suite: Suite, driven: Sequence[Driven]) -> list[tuple[str, str | None, str]]:
    """List all scenarios as tests; a touch that a reference driver has too is skipped, as what goes on in `retest`."""
    tests: list[tuple[str, str | None, str]] = []
    for one in driven:
        failures = one.prevented_by_all | one.beyond
        for k in range(len(one.panel)):
            at = "".join(f", {name} {value:g}" for name, value in _point(suite, one, k).items())
            tags = {"avoided": None, "no answer": "error"}
            tag = "failure" if failures[k] else tags.get(_verdict(one, k), "skipped")
            speed = "" if np.isnan(one.touch_kmh[k]) else f" at {one.touch_kmh[k]:.1f} km/h"
            limit = f"; allowed: {one.allowed_kmh[k]:g} km/h" if one.beyond[k] else ""
            by = ", ".join(name for name in CAREFUL if not one.crashes[name][k])
            words = f"{_verdict(one, k)}{speed}{limit}; prevented by {by or 'no reference driver'}"
            tests.append((f"{one.panel.family.name} {one.panel.av_kmh} to {one.panel.other_kmh} km/h{at}", tag, words))
    return tests


def _csv(suite: Suite, driven: Sequence[Driven]) -> str:
    """List all scenarios, one a line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for number, one in enumerate(driven):
        columns = _columns(suite, one)
        if suite.has_tests:
            verdicts = [_verdict(one, k) for k in range(len(one.panel))]
            columns |= {"verdict": verdicts, "touch_kmh": one.touch_kmh.tolist()}
        if number == 0:
            writer.writerow(["scenario", "av", *columns])
        for k, row in enumerate(zip(*columns.values(), strict=True)):
            shown = ["" if isinstance(v, float) and np.isnan(v) else int(v) if isinstance(v, bool) else v for v in row]
            writer.writerow([one.panel.first + k, _OUTCOMES.get(int(one.code[k]), "passed"), *shown])
    return text.getvalue()


def _verdicts(driven: Sequence[Driven]) -> dict[str, Any]:
    """Count over panels: the fields that all results share."""
    return {
        "scenarios": sum(int(one.known.sum()) for one in driven),
        "failed": sum(int(one.failed.sum()) for one in driven),
        "failed_but_prevented_by": {n: sum(int(one.prevented(n).sum()) for one in driven) for n in CAREFUL},
        "failed_but_prevented_by_all": sum(int(one.prevented_by_all.sum()) for one in driven),
        "failed_but_held_speed_passes": sum(int(one.prevented(_HELD).sum()) for one in driven),
        "reference_crashes": {n: sum(int((one.crashes[n] & one.known).sum()) for one in driven) for n in CAREFUL},
    }  # fmt: skip


def _weights(one: Driven) -> NDArray[np.float64] | None:
    """How often each of a panel's cut-ins happens, relative to each other; None: not known."""
    panel = one.panel
    if not panel.family.is_weighed:
        return None
    x, y = panel.points
    closing = (panel.av_kmh - panel.other_kmh) / KMH
    density = cut_in_density(panel.other_kmh / KMH, closing, x, y)
    if density is None:
        return None
    weights = np.where(one.known, density * (panel.across[1] - panel.across[0]), 0.0)
    return weights if weights.sum() > 0.0 else None


def _roads(one: Driven) -> RegulatedRoads | None:
    weights = _weights(one)
    other, closing = one.panel.other_kmh / KMH, (one.panel.av_kmh - one.panel.other_kmh) / KMH
    at_least = closing_at_least(other, closing)
    if weights is None or at_least is None:
        return None
    total = weights.sum()
    return RegulatedRoads(
        at_least=at_least,
        failed=float(weights[one.failed].sum() / total),
        failed_but_prevented_by={name: float(weights[one.prevented(name)].sum() / total) for name in CAREFUL},
    )


def _result(run: Experiment, suite: Suite, driven: Sequence[Driven], too_fast: Sequence[int]) -> Regulated:
    every = _verdicts(driven)
    n = max(1, every["scenarios"])
    weighed = [(one, weights) for one in driven if (weights := _weights(one)) is not None]
    total = sum(float(weights.sum()) for _, weights in weighed)
    families = []
    for family in dict.fromkeys(one.panel.family.name for one in driven):
        counted = _verdicts([one for one in driven if one.panel.family.name == family])
        share = counted["failed"] / max(1, counted["scenarios"])
        families.append(RegulatedFamily(**counted, family=family, share_failed=share))
    return Regulated(
        **every,
        suite=suite.name,
        av=run.av.name,
        odd=run.odd.name,
        share_failed=every["failed"] / n,
        share_failed_but_prevented_by_all=every["failed_but_prevented_by_all"] / n,
        beyond_allowed=sum(int(one.beyond.sum()) for one in driven),
        tests=_tests(suite, driven),
        av_faults=sum(int((~one.known).sum()) for one in driven),
        too_fast_kmh=tuple(too_fast),
        roads_failed=sum(float(w[one.failed].sum()) for one, w in weighed) / total if weighed else None,
        roads_failed_but_prevented_by={
            name: sum(float(w[one.prevented(name)].sum()) for one, w in weighed) / total for name in CAREFUL
        } if weighed else None,
        families=tuple(families),
        pairs=tuple(
            RegulatedPair(
                **_verdicts([one]), family=one.panel.family.name, av_kmh=one.panel.av_kmh,
                other_kmh=one.panel.other_kmh,
                on_roads=_roads(one),
            )
            for one in driven
        ),
        library=None,
        page=None,
        seconds=0.0,
    )  # fmt: skip


def suite_run_text(r: Regulated) -> str:
    """Tell the result in text."""
    suite = SUITES[r.suite]
    told = f"{r.av} in {r.scenarios:,} scenarios of {suite.title} (ODD {r.odd}): failed {r.failed:,}"
    lines = [f"{told} ({r.share_failed:.2%})"]
    if r.av_faults:
        lines[0] += f"; left out {r.av_faults:,} in which the AV gave no usable answer"
    of_name = {family.name: family for family in suite.families}
    for family in r.families:
        by = ", ".join(f"{name} {n:,}" for name, n in family.failed_but_prevented_by.items())
        refs = ", ".join(f"{name} {n:,}" for name, n in family.reference_crashes.items())
        lines.append(
            f"  {family.family}: failed {family.failed:,} of {family.scenarios:,}; of these prevented by {by}; by "
            f"{of_name[family.family].all_in_words} {family.failed_but_prevented_by_all:,}; by holding the speed "
            f"{family.failed_but_held_speed_passes:,} (crashes of the reference drivers: {refs})"
        )
    if r.roads_failed is not None and r.roads_failed_but_prevented_by is not None:
        by = ", ".join(f"{name} {_small(part)}" for name, part in r.roads_failed_but_prevented_by.items())
        lines.append(
            f"  Cut-ins weighted as often as SPMD's fit has them: the AV fails in a share of {_small(r.roads_failed)}; "
            f"and the driver does not: {by}"
        )
    if r.too_fast_kmh:
        lines.append(f"  Left out, the ODD is slower: {', '.join(map(str, r.too_fast_kmh))} km/h")
    if r.tests:
        lines.append(f"  Of the {len(r.tests):,} tests that the protocols demand themselves:")
        lines += [f"    {text}" for text in _tests_text(r.tests)]
    lines.append(f"  {suite.meaning}")
    if r.page is not None:
        lines.append(f"Library: {r.library}; page: {r.page}")
    return "\n".join(lines)


def _small(part: float) -> str:
    """Write a share; so near as that, cut-ins are not on record."""
    return "below 1e-6" if 0.0 < part < 1e-6 else f"{part:.2g}"


def _tests_text(tests: Sequence[RegulatedTest]) -> list[str]:
    """Tell the tests of a protocol: a line for each touch, and one for all others of a family."""
    lines = []
    for family in dict.fromkeys(test.family for test in tests):
        here = [test for test in tests if test.family == family]
        ends = Counter(test.verdict for test in here)
        lines.append(f"{family}: {', '.join(f'{verdict} {n}' for verdict, n in ends.items())}")
        for test in (test for test in here if test.verdict == "touched"):
            at = "".join(f", {name} {value:g}" for name, value in test.point.items() if name != "ttc_s")
            limit = "" if test.allowed_kmh is None else f"; R152 allows {test.allowed_kmh:g}"
            drivers = ", ".join(test.reference_touched) or "none"
            lines.append(
                f"  {test.av_kmh} to {test.other_kmh} km/h{at}: touched at {test.touch_kmh:.1f} km/h{limit} (reference "
                f"drivers that touch: {drivers})"
            )
    return lines
