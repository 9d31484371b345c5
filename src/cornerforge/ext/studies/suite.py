"""`suite build` chooses the fewest cases that find and rank the flaws of many AVs (ADR 43)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._options import verb
from cornerforge.analysis.contact import impact_speed
from cornerforge.drivers.avs import ROAD_AVS
from cornerforge.errors import InputError, ReplayError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import check_new_folder, code_hash, config_hash, provenance, version, write_json
from cornerforge.ext.studies.options import SuiteBuild
from cornerforge.ext.studies.suite_choice import (
    LeftOut,
    cases_needed,
    choose,
    findings,
    leave_one_out,
    rank_agreement,
)  # fmt: skip
from cornerforge.foreign.spec import with_av
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.harvester import CaseRoom
from cornerforge.library.schema import ON_RAILS, SCRIPTED
from cornerforge.ndd.model import model_hash, save_model
from cornerforge.results.suite import LeftOutAll, LeftOutAv, SuiteAv, SuiteBuilt
from cornerforge.sim import scripted
from cornerforge.verbs.cases import SEVERAL, experiment_of
from cornerforge.verbs.stored_cases import StoredScripts, drive_as_recorded, run_with
from cornerforge.work.progress import Progress
from cornerforge.world_options import WorldOptions

__all__ = ["suite_build", "suite_text"]

SELECTION = "suite.json"
"""File in the suite's folder that says where each case comes from and which AVs it crashes."""
_RANDOM_SETS = 200
_SHARD_CASES = 1000


class _Source(NamedTuple):
    """A library, and the run that made it."""

    cases: CaseLibrary
    maker: Experiment


@dataclass(frozen=True)
class _Candidates:
    """The cases of all libraries, as the zoo drives them.

    Attributes:
        origin: Place of the library and case id of each, (S).
        impact: Relative speed at contact [m/s], (S, A); NaN where the AV does not crash.
        failed: Further cases in which an AV failed.
        not_again: Further ones in which the AV that made them does not crash again.
    """

    origin: list[tuple[int, str]]
    impact: NDArray[np.float64]
    failed: int
    not_again: int

    @property
    def crashes(self) -> NDArray[np.bool_]:
        """Did the AV crash in the case, (S, A)."""
        return ~np.isnan(self.impact)

    @property
    def severity(self) -> NDArray[np.float64]:
        """Mean relative speed at contact of a case over the AVs that crash in it [m/s], (S,); 0 if none does."""
        return np.asarray(np.nansum(self.impact, axis=1) / np.maximum(1, self.crashes.sum(axis=1)))


@verb(SuiteBuild)
def suite_build(options: SuiteBuild) -> SuiteBuilt:
    """Choose the fewest cases that find and rank the flaws of many AVs, and store them as a library of their own.

    Every stored case is driven as recorded by every AV of the zoo. The suite is chosen by what they show (see
    `ext.studies.suite_choice.choose`) and checked on AVs left out one at a time.

    Returns:
        What `cornerforge suite build --json` prints.

    Raises:
        CornerForgeError: Libraries do not fit together or cannot be read, no AV crashes, or the place cannot be used.
    """
    began = time.perf_counter()
    place = Path(options.out)
    opened = _opened([options.libraries] if isinstance(options.libraries, (str, Path)) else options.libraries)
    names = _zoo(options.zoo)
    world = options.world()
    sources = [
        _Source(cases, experiment_of(cases, with_av(world, str(cases.identity.get("av", ""))))) for cases in opened
    ]
    _check_fit(sources)
    check_new_folder(place)
    found = _driven(sources, names, world, options.threads, options.progress)
    chosen = choose(found.crashes, found.severity, options.size)
    identity = _identity(sources)
    suite = _stored(place, identity, sources, [found.origin[row] for row in chosen.cases], options.progress)
    ids = suite.scalars(["case_id"])["case_id"].to_pylist()
    runs = [run_with(suite, world, name) for name in names]
    again, _ = _impacts(_ends(suite, ids, runs, options.threads, options.progress, "the suite"))
    checked = leave_one_out(found.crashes, found.severity, options.size, seed=options.seed, random_sets=_RANDOM_SETS)
    selection = _selection(sources, found, names, chosen.cases, ids)
    write_json(place / SELECTION, {"zoo": names, "cases": selection})
    made_of = {str(cases.path): config_hash(cases.identity) for cases in opened}
    seconds = round(time.perf_counter() - began, 3)
    write_json(place / "provenance.json", provenance({**identity, "sources": made_of}, seconds))
    both = np.concatenate([found.crashes, ~np.isnan(again)])
    rows = np.arange(len(found.origin), len(both))
    finds = findings(found.crashes)
    rng = np.random.default_rng([options.seed, len(names)])
    needed = [cases_needed(finds[rng.permutation(len(finds))]) for _ in range(_RANDOM_SETS)]
    low, high = np.quantile(needed, [0.025, 0.975]).tolist()
    return SuiteBuilt(
        cases=len(suite),
        out=str(options.out),
        candidates=len(found.origin),
        left_out=found.failed,
        not_again=found.not_again,
        findings=chosen.wanted,
        findings_in_suite=chosen.found,
        cases_needed=cases_needed(finds[list(chosen.cases)]),
        random_cases_needed=float(np.mean(needed)),
        random_cases_needed_range95=(low, high),
        clear=chosen.clear,
        in_order=chosen.in_order,
        rank_agreement=rank_agreement(both, rows),
        avs=tuple(
            SuiteAv(av=name, crashes_in_all=float(whole), crashes_in_suite=float(part))
            for name, whole, part in zip(names, found.crashes.mean(axis=0), both[rows].mean(axis=0), strict=True)
        ),
        left_out_avs=tuple(_left_out(one, names) for one in checked),
        left_out_summary=_summary(checked),
        seconds=seconds,
    )


def _opened(libraries: Sequence[Path | str]) -> list[CaseLibrary]:
    """Open the libraries.

    Raises:
        CornerForgeError: No library is named, one is named twice, cannot be read, or holds no case.
    """
    if not libraries:
        raise InputError("There is no library to choose cases from; name one or more.")
    opened: list[CaseLibrary] = []
    for given in libraries:
        cases = CaseLibrary.open(Path(given))
        if len(cases) == 0:
            raise InputError(f"The library {given} holds no cases yet, so there is none to choose.")
        for other in opened:
            if other.path.resolve() == cases.path.resolve():
                raise InputError(f"The library {given} is named twice; name each once.")
            if (other.identity, other.odd, len(other)) == (cases.identity, cases.odd, len(cases)):
                raise InputError(
                    f"{other.path} and {given} are the same library: equal runs, equal cases; leave out one."
                )
        if cases.identity.get("av") == SEVERAL:
            raise InputError(f"{given} is a suite of several AVs; build from the libraries that it was chosen from.")
        opened.append(cases)
    return opened


def _zoo(zoo: Sequence[str] | None) -> list[str]:
    """Return the names of the AVs.

    Raises:
        InputError: No AV is named, or one is named twice.
    """
    names = list(ROAD_AVS) if zoo is None else list(zoo)
    twice = [name for index, name in enumerate(names) if name in names[:index]]
    if twice:
        raise InputError(f"The AV {twice[0]} is named twice; name each once.")
    if not names:
        raise InputError("There is no AV to drive the cases; name one or more with --zoo.")
    return names


def _check_fit(sources: Sequence[_Source]) -> None:
    """Refuse libraries of several ODDs or models."""
    first = sources[0]
    for one in sources[1:]:
        for what, ours, theirs in (
            ("ODD", first.maker.odd, one.maker.odd),
            ("naturalistic model", model_hash(first.maker.model), model_hash(one.maker.model)),
            ("others, which drive or are on rails", first.cases.on_rails, one.cases.on_rails),
        ):
            if ours != theirs:
                raise InputError(
                    f"{first.cases.path} and {one.cases.path} differ in their {what}, so they make no suite together; "
                    "build one of each."
                )


def _ends(
    cases: CaseLibrary,
    ids: Sequence[str],
    runs: Sequence[Experiment],
    threads: int | None,
    progress: Progress,
    what: str,
) -> list[list[scripted.Ending]]:
    """Drive cases with all AVs, and end their processes."""
    for run in runs:
        forecast(run, threads, f"{len(ids):,} cases", tests=len(ids))
    try:
        return drive_as_recorded(cases, ids, runs, check_threads(threads), progress, what)
    finally:
        for run in runs:
            run.rest()


def _impacts(ends: Sequence[Sequence[scripted.Ending]]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Relative speed at contact [m/s], NaN without a crash, of each case and AV, (S, A); did an AV fail in it, (S,)."""
    speeds = [[np.nan if end.pose is None else float(impact_speed(end.pose)) for end in of_case] for of_case in ends]
    failed = [any(end.failed for end in of_case) for of_case in ends]
    return np.array(speeds, np.float64), np.array(failed, np.bool_)


def _driven(
    sources: Sequence[_Source],
    names: Sequence[str],
    options: WorldOptions,
    threads: int | None,
    progress: Progress,
) -> _Candidates:
    """Drive all cases with all AVs of the zoo, and leave out cases without information.

    Raises:
        CornerForgeError: A case cannot be driven, an AV fails 20 times in a row, or no AV crashes.
    """
    origin: list[tuple[int, str]] = []
    kept: list[NDArray[np.float64]] = []
    failures = not_again = 0
    for place, (cases, maker) in enumerate(sources):
        ids = cases.scalars(["case_id"])["case_id"].to_pylist()
        if not ids:
            raise InputError(f"No shard of {cases.path} can be read; generate the library again.")
        runs = [run_with(cases, options, name) for name in names]
        # The AV that made the library drives last, unless the zoo has it.
        made_by = names.index(maker.av.name) if maker.av.name in names else len(names)
        ends = _ends(cases, ids, [*runs, maker][: max(len(names), made_by + 1)], threads, progress, cases.path.name)
        impact, failed = _impacts(ends)
        comes_again = ~np.isnan(impact[:, made_by])
        impact = impact[:, : len(names)]
        failures += int(failed.sum())
        not_again += int((~comes_again & ~failed).sum())
        use = np.flatnonzero(comes_again & ~failed)
        origin += [(place, ids[row]) for row in use]
        kept.append(impact[use])
    if not origin:
        raise InputError("No case can be used: in each an AV fails, or the AV that made it does not crash again.")
    return _Candidates(origin, np.concatenate(kept), failures, not_again)


def _identity(sources: Sequence[_Source]) -> dict[str, Any]:
    """Say what names the suite: natural traffic, since its scripts hold the actions, and the AV that made its cases."""
    natural = replace(sources[0].maker, bv="nde", bounded=False, policies=(), budget=None, acting="greedy")
    identity = {**natural.identity(0), SCRIPTED: True, "cornerforge": version(), "code": code_hash()}
    if sources[0].cases.on_rails:
        identity |= {ON_RAILS: True}
    if len({one.maker.av_hash for one in sources}) > 1:
        identity |= {"av": SEVERAL, "av_hash": None}
    return identity


def _stored(
    place: Path,
    identity: dict[str, Any],
    sources: Sequence[_Source],
    chosen: Sequence[tuple[int, str]],
    progress: Progress,
) -> CaseLibrary:
    """Write the suite: each case as a script, driven by the AV that made it; they are numbered from 0.

    Raises:
        CornerForgeError: An AV does not crash again, or the place cannot be written.
    """
    drivers = [(StoredScripts(cases, run), run.script_driver()) for cases, run in sources]
    first = sources[0].maker
    room = CaseRoom(first.slots, int(first.setting.road.max_decisions))
    for test, (source, case) in enumerate(chosen):
        scripts, driver = drivers[source]
        cases, maker = sources[source]
        script = replace(scripts.of(cases.scenario(case)), seed=0, test=test)
        if driver.record(script)[0].partner is None:
            raise ReplayError(f"Case {case} of {cases.path}: {maker.av.name} crashed in it and now does not.")
        extra = {"source": cases.path.name, "source_case": case, "source_av": maker.av.name}
        room.add(driver, extra, start=script.start, poses=script.poses)
        progress("writing the suite", test + 1, len(chosen))
    suite = CaseLibrary.create(place, identity, sources[0].cases.odd)
    n = len(room)
    suite.fill(*room.take(), next_test=n, tests=n, crashes=n, shard_cases=_SHARD_CASES)
    save_model(first.model, place / MODEL_FILE)
    suite.finish()
    for one in sources:
        one.maker.rest()
    return suite


def _selection(
    sources: Sequence[_Source], found: _Candidates, names: Sequence[str], rows: Sequence[int], ids: Sequence[str]
) -> list[dict[str, Any]]:
    """Say of each case of the suite where it comes from, and how fast which AVs crash in it."""
    return [
        {
            "case": case,
            "library": sources[found.origin[row][0]].cases.path.name,
            "source_case": found.origin[row][1],
            "impact_mps": {
                name: round(speed, 3)
                for name, speed in zip(names, found.impact[row].tolist(), strict=True)
                if speed == speed
            },
        }
        for row, case in zip(rows, ids, strict=True)
    ]


def _left_out(one: LeftOut, names: Sequence[str]) -> LeftOutAv:
    found, told_apart, share, off, in_order = one.known.tolist()
    return LeftOutAv(
        av=names[one.av],
        cases=one.cases,
        found=found > 0.0,
        told_apart=int(told_apart),
        pairs=one.pairs,
        share=share,
        share_of_all=one.share_of_all,
        off=off,
        clear=one.clear,
        in_order=int(in_order),
        apfd=one.early,
    )


def _summary(checked: Sequence[LeftOut]) -> LeftOutAll | None:
    """Sum up all AVs left out; None if there is none."""
    if not checked:
        return None

    def errors(known: NDArray[np.float64], one: LeftOut) -> NDArray[np.float64]:
        """Found, share told apart, distance of the share, places off, share in order; (..., 5)."""
        apart, ordered = (
            known[..., column] / most if most else np.ones_like(known[..., column])
            for column, most in ((1, one.pairs), (4, one.clear))
        )
        off = np.abs(known[..., 2] - one.share_of_all)
        return np.stack([known[..., 0], apart, off, known[..., 3], ordered], axis=-1)

    ours = np.mean([errors(one.known, one) for one in checked], axis=0).tolist()
    sets = np.mean([errors(one.random, one) for one in checked], axis=0)  # a random set of each AV, (R, 5)
    mean = sets.mean(axis=0).tolist()
    low, high = np.quantile(sets, [0.025, 0.975], axis=0).tolist()
    spread = list(zip(low, high, strict=True))
    early = [one for one in checked if one.early is not None]
    orders = np.mean([one.random_early for one in early], axis=0) if early else None
    return LeftOutAll(
        found=ours[0], told_apart=ours[1], share_off=ours[2], off=ours[3], in_order=ours[4], random_sets=len(sets),
        random_found=mean[0], random_found_range95=spread[0],
        random_told_apart=mean[1], random_told_apart_range95=spread[1],
        random_share_off=mean[2], random_share_off_range95=spread[2],
        random_off=mean[3], random_off_range95=spread[3],
        random_in_order=mean[4], random_in_order_range95=spread[4],
        apfd=None if orders is None else float(np.mean([one.early for one in early])),
        random_apfd=None if orders is None else float(orders.mean()),
        random_apfd_range95=None if orders is None else tuple(np.quantile(orders, [0.025, 0.975]).tolist()),
    )  # fmt: skip


def suite_text(r: SuiteBuilt) -> str:
    """Tell the result in text."""
    lines = [f"{r.cases:,} of {r.candidates:,} cases in {r.out}: they find {r.findings_in_suite:,} of {r.findings:,}"]
    lines[0] += " things that all cases find (an AV that crashes, or crashes where another one does not)"
    low, high = r.random_cases_needed_range95
    lines.append(
        f"The first {r.cases_needed:,} find all of these; of all cases in random order {r.random_cases_needed:,.0f} "
        f"(95 % of orders: {low:,.0f} to {high:,.0f})"
    )
    if r.rank_agreement is not None:
        lines.append(
            f"They have {r.in_order:,} of {r.clear:,} pairs of AVs in order, whose order is clear in all cases; of all "
            f"pairs Kendall's tau is {r.rank_agreement:.2f}"
        )
    if r.left_out or r.not_again:
        lines.append(f"Not used: {r.left_out:,} cases in which an AV failed, {r.not_again:,} that do not come again")
    wide = max(len(one.av) for one in r.avs)
    lines.append("Crashes per case, in all and in the suite:")
    lines += [f"  {one.av:<{wide}}  {one.crashes_in_all:.3f}  {one.crashes_in_suite:.3f}" for one in r.avs]
    if (s := r.left_out_summary) is not None:
        lines.append(
            f"AVs left out one at a time, against {s.random_sets} random sets of as many cases (mean, 95 % of them):"
        )
        rows: list[tuple[str, float, float, tuple[float, float]]] = [
            ("found", s.found, s.random_found, s.random_found_range95),
            ("told apart from others", s.told_apart, s.random_told_apart, s.random_told_apart_range95),
            ("crashes per case off by", s.share_off, s.random_share_off, s.random_share_off_range95),
            (
                "in the right order with clearly better or worse AVs",
                s.in_order,
                s.random_in_order,
                s.random_in_order_range95,
            ),
            ("places off", s.off, s.random_off, s.random_off_range95),
        ]
        if s.apfd is not None and s.random_apfd is not None and s.random_apfd_range95 is not None:
            rows.append(("how early in its order (APFD)", s.apfd, s.random_apfd, s.random_apfd_range95))
        lines += [f"  {what}: {ours:.3f}, random {mean:.3f} ({low:.3f} to {high:.3f})" for what, ours, mean, (low, high)
                  in rows]  # fmt: skip
    return "\n".join(lines)
