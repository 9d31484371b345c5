"""`cases from-data` makes cases of the most critical moments of recorded traffic."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cornerforge._options import verb
from cornerforge.analysis.crash_types import STRIKERS
from cornerforge.errors import DataError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import check_new_folder, open_output, provenance, whole_or_nothing, write_json
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.ext.interchange.moments import Moments, critical_moments
from cornerforge.ext.interchange.moving_cases import NO_CRASH, CaseOutcome, CasesDriven, library_of
from cornerforge.ext.interchange.options import FromData
from cornerforge.ext.interchange.recorded_traffic import Traffic, TrafficFile, read_traffic
from cornerforge.library.case_file import CaseFile, Happened, of_moving, write_case_file
from cornerforge.library.out_case import MovingCase, script_of
from cornerforge.results.imported import CasesFromData, DataFileRead, MomentOfData
from cornerforge.types import Odd

__all__ = ["cases_from_data", "from_data_text"]

_SHOWN = 10
_LEAST_SHOWN = 0.05
"""Less deceleration is nothing, in one decimal [m/s2]."""
_TOUCHES = "driven as recorded, the car touches another vehicle"


@verb(FromData)
def cases_from_data(options: FromData) -> CasesFromData:
    """Make cases of the most critical moments of recorded traffic, and drive an AV through them.

    Each case holds a recorded car (the ego) and all vehicles around it, some seconds before and after the moment. The
    AV takes the ego's place, with its speed; all others move as recorded, independent of it. So a vehicle behind runs
    into an AV that brakes harder than the recorded driver: the `striker` of that crash is "bv", and it says little
    about the AV. What moments are critical, `ext.interchange.moments` says.

    Returns:
        What `cornerforge cases from-data --json` prints.

    Raises:
        CornerForgeError: A file or an option cannot be used, nothing in the files is critical, or the AV cannot be had.
    """
    began = time.perf_counter()
    place = Path(options.out)
    check_new_folder(place)
    world = options.world()
    av = world.av
    experiment(world, takes_foreign=True, takes_recorded=True).identity(0)  # an unknown AV fails here, before long work
    paths = [Path(file) for file in ([options.files] if isinstance(options.files, (str, Path)) else options.files)]
    options.progress("files", 0, 1)
    traffic = read_traffic(paths, options.data_format)
    options.progress("files", 1, 1)
    found = _without_contact(
        critical_moments(
            traffic, most=options.cases, before_s=options.before, after_s=options.after, measure=options.measure
        )
    )
    if not found.cases:
        reasons = "; ".join(f"{reason} ({n})" for reason, n in found.left_out.items())
        raise DataError(f"No case could be made of {found.found:,} event(s): {reasons}.")
    stated = {
        "files": [one.sha256 for one in _files(traffic)], "format": options.data_format, "cases": options.cases,
        "measure": options.measure, "before": options.before, "after": options.after, "av": av, "seed": options.seed,
    }  # fmt: skip
    open_output(place, stated, resume=None)
    with whole_or_nothing(place, ("cases", "library")):
        written = _write(found.cases, place / "cases")
        driven = CasesDriven(av, (), tuple(CaseOutcome(case.name, NO_CRASH, "as recorded") for case in found.cases))
        if av != RECORDED_AV:
            driven = library_of(
                found.cases, place / "library", seed=options.seed, progress=options.progress, world=world
            )
        result = _result(traffic, found, written, driven, options.measure, place, time.perf_counter() - began)
        write_json(place / "provenance.json", provenance(stated, result.seconds))
    return result


def _without_contact(found: Moments) -> Moments:
    """Leave out the cases in which the recorded driver crashes: no real one did."""
    kept: list[MovingCase] = []
    runs: dict[Odd, Experiment] = {}
    for case in found.cases:
        if case.odd not in runs:
            runs[case.odd] = experiment(road=case.odd, av=RECORDED_AV, takes_recorded=True)
        if runs[case.odd].script_driver().drive(script_of(case)).pose is None:
            kept.append(case)
    left_out = dict(found.left_out)
    if touching := len(found.cases) - len(kept):
        left_out[_TOUCHES] = touching
    return Moments(kept, found.found, left_out)


def _write(cases: Sequence[MovingCase], folder: Path) -> list[Path]:
    """Write a case file of each, with the recorded driver in it."""
    folder.mkdir()
    return [write_case_file(_file_of(case), folder / f"{case.name}.json") for case in cases]


def _file_of(case: MovingCase) -> CaseFile:
    return replace(of_moving(case, licence=str(case.facts["source_credit"])), happened=Happened())


def _files(traffic: Sequence[Traffic]) -> list[TrafficFile]:
    return list({one.file.sha256: one.file for one in traffic}.values())


def _read(traffic: Sequence[Traffic]) -> tuple[DataFileRead, ...]:
    rows = []
    for file in _files(traffic):
        parts = [one for one in traffic if one.file.sha256 == file.sha256]
        reasons = {reason: count for reason, (count, _) in file.left_out.items()}
        rows.append(
            DataFileRead(
                file=file.name, sha256=file.sha256, layout=file.layout, credit=file.credit, rows_read=file.rows_read,
                rows_left_out=sum(reasons.values()), reasons=reasons, recordings=len(parts),
                vehicles=sum(len(one.names) for one in parts), notes=file.notes,
            )
        )  # fmt: skip
    return tuple(rows)


def _number(facts: Mapping[str, Any], name: str) -> float | None:
    value = facts[name]
    return None if value is None else float(value)


def _result(
    traffic: Sequence[Traffic], found: Moments, written: Sequence[Path], driven: CasesDriven, measure: str,
    place: Path, seconds: float,
) -> CasesFromData:  # fmt: skip
    rows = []
    for case, file, outcome in zip(found.cases, written, driven.cases, strict=True):
        facts = case.facts
        rows.append(
            MomentOfData(
                case=case.name,
                file=str(file),
                source=str(facts["source"]),
                recording=None if facts["recording"] is None else str(facts["recording"]),
                ego=str(facts["ego_vehicle"]),
                other=str(facts["other_vehicle"]),
                recording_time_s=float(facts["recording_time_s"] or 0.0),
                moment_s=float(facts["moment_s"] or 0.0),
                drac_mps2=float(facts["drac_mps2"] or 0.0),
                ttc_s=_number(facts, "ttc_s"),
                thw_s=_number(facts, "thw_s"),
                contact_s=_number(facts, "contact_s"),
                outcome=outcome.outcome,
                striker=outcome.striker,
                words=outcome.words,
                case_id=outcome.case_id,
            )
        )
    counted = Counter(one.striker for one in driven.cases)
    return CasesFromData(
        files=_read(traffic),
        measure=measure,
        events=found.found,
        left_out=dict(found.left_out),
        cases=tuple(rows),
        av=driven.av,
        crashes=driven.crashes,
        strikers={name: counted[name] for name in STRIKERS},
        libraries=tuple(str(library) for library in driven.libraries),
        out=str(place),
        seconds=round(seconds, 3),
    )


def from_data_text(r: CasesFromData) -> str:
    """Tell the result in text."""
    lines = [
        f"{file.file}: {file.rows_read:,} rows read, {file.rows_left_out:,} left out; {file.vehicles:,} vehicles. "
        f"{file.credit}"
        for file in r.files
    ]
    lines += [f"  {note}" for file in r.files for note in file.notes]
    lines += [f"  left out: {reason} ({n:,})" for reason, n in r.left_out.items()]
    lines.append(f"{r.events:,} events; the {len(r.cases):,} most critical by {r.measure} are cases in {r.out}/cases")
    for one in r.cases[:_SHOWN]:
        measured = {"TTC": one.ttc_s, "time headway": one.thw_s}
        told = ", ".join(f"{name} {value:.1f} s" for name, value in measured.items() if value is not None)
        is_asked = r.measure == "drac" or one.drac_mps2 >= _LEAST_SHOWN
        needed = f"needs {one.drac_mps2:.1f} m/s2" if is_asked else ""
        lines.append(f"  {one.case}: {', '.join(part for part in (needed, told) if part)}; {one.words}")
    if len(r.cases) > _SHOWN:
        lines.append(f"  and {len(r.cases) - _SHOWN:,} more (--json)")
    who = ", ".join(f"{name} {n:,}" for name, n in r.strikers.items() if n)
    lines.append(f"{r.av} crashes in {r.crashes:,}" + (f" (who struck: {who})" if who else ""))
    lines += [f"Library: {library}" for library in r.libraries]
    return "\n".join(lines)
