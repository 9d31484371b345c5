"""`import` reads scenarios of other tools as cases."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cornerforge._files import reason
from cornerforge._options import verb
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError
from cornerforge.experiment.output import (
    check_new_folder,
    open_output,
    provenance,
    whole_or_nothing,
    write_json,
)
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.ext.calibrate.tables import file_sha256
from cornerforge.ext.interchange.moving_cases import UNKNOWN, CasesDriven, library_of
from cornerforge.ext.interchange.options import ImportCases
from cornerforge.library.case_file import CaseFile, case_text, of_moving, write_case_file
from cornerforge.library.out_case import Fact, MovingCase
from cornerforge.results.imported import ImportedCase, ImportedCases, Refused
from cornerforge.types import FRAME_S

__all__ = ["IMPORTS", "import_cases", "import_text"]

_ENTITY = re.compile(r"\d{1,18}")
_HASH_DIGITS = 16
_LICENCES = ("licence_of_the_model", "licence")
"""Facts in which files say what may be done with them."""
_NOT_STATED = "not stated; see the source file"


def _openscenario(path: Path, o: ImportCases) -> MovingCase:
    from cornerforge.ext.interchange.esmini import play_openscenario

    return play_openscenario(path, ego=o.ego, road=_road(o), seconds=o.play_seconds)


def _osi(path: Path, o: ImportCases) -> MovingCase:
    from cornerforge.ext.interchange.read_osi import read_osi

    return read_osi(path, ego=o.ego, road=_road(o))


def _road(o: ImportCases) -> Path | None:
    return None if o.road is None else Path(o.road)


def _commonroad(path: Path, o: ImportCases) -> MovingCase:
    from cornerforge.ext.interchange.read_commonroad import read_commonroad

    ego = o.ego
    if o.road is not None:
        raise InputError(f"{path} is a CommonRoad scenario and holds its road; leave out road.")
    if ego is not None and not _ENTITY.fullmatch(ego):
        raise InputError(f"The AV of a CommonRoad scenario is named by the number of its obstacle; {ego!r} is none.")
    return read_commonroad(path, ego=None if ego is None else int(ego))


def _table(path: Path, o: ImportCases) -> MovingCase:
    from cornerforge.ext.interchange.tables import read_table

    if o.ego is not None:
        raise InputError(f"{path} is a table, in which the AV is the vehicle in slot 0; leave out ego.")
    if o.road is not None:
        raise InputError(f"{path} is a table and holds its road; leave out road.")
    return read_table(path)


IMPORTS: dict[str, Callable[[Path, ImportCases], MovingCase]] = {
    ".osi": _osi, ".mcap": _osi, ".xosc": _openscenario, ".xml": _commonroad, ".csv": _table, ".parquet": _table,
}  # fmt: skip
"""End of a file's name -> its reader."""


@verb(ImportCases)
def import_cases(options: ImportCases) -> ImportedCases:
    """Read scenarios of other tools, write a case file of each, and drive the AV through them.

    A file that cannot be read is named in the result, and the others are read. All vehicles but the AV move as their
    file says, independent of the AV.

    Returns:
        What `cornerforge import --json` prints.

    Raises:
        CornerForgeError: No file can be read, the AV cannot be had, or the folder cannot be used.
    """
    began = time.perf_counter()
    place = Path(options.out)
    check_new_folder(place)
    world = replace(options, road=None).world()  # that road is the one of the files
    experiment(world, takes_foreign=True, takes_recorded=True).identity(0)  # an unknown AV fails here, before long work
    paths = [Path(file) for file in ([options.files] if isinstance(options.files, (str, Path)) else options.files)]
    if not paths:
        raise InputError("There is no file to import; name at least one.")
    sources: list[Path] = []
    cases: list[MovingCase] = []
    made: list[CaseFile] = []
    refused: list[Refused] = []
    for number, path in enumerate(paths):
        options.progress("files", number, len(paths))
        try:
            case, file = _read(path, options, {case.name for case in cases})
        except CornerForgeError as error:
            why = str(error) if path.name in str(error) else f"{path}: {error}"
            refused.append(Refused(source=str(path), why=why))
            continue
        sources.append(path)
        cases.append(case)
        made.append(file)
    options.progress("files", len(paths), len(paths))
    if not cases:
        if len(refused) == 1:
            raise DataError(refused[0].why)
        raise DataError(f"None of {len(paths):,} files can be read; the first: {refused[0].why}")
    hashes = [file_sha256(path)[:_HASH_DIGITS] for path in sources]
    road = None if options.road is None else file_sha256(Path(options.road))[:_HASH_DIGITS]
    stated = {"files": hashes, "ego": options.ego, "road": road, "av": world.av, "seed": options.seed}
    open_output(place, stated, resume=None)
    with whole_or_nothing(place, ("cases", "library")):
        driven = library_of(cases, place / "library", seed=options.seed, progress=options.progress, world=world)
        written = _write(made, place / "cases", driven)
        result = _result(sources, cases, written, refused, driven, place, began)
        write_json(place / "provenance.json", provenance(stated, result.seconds))
    return result


def _read(path: Path, options: ImportCases, taken: set[str]) -> tuple[MovingCase, CaseFile]:
    """Read a file, give its case a name that no other has, and make sure that a case file can hold it.

    Raises:
        CornerForgeError: It cannot be read, or no case file can hold what it says.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder; name the files in it.")
        if path.suffix.lower() not in IMPORTS:
            raise InputError(f"{path} is no {', '.join(IMPORTS)} file; name such files.")
        if not path.is_file():
            raise FileFormatError(f"{path} is no file; name a file that is there.")
    except OSError as error:
        raise FileFormatError(f"{path} cannot be read: {reason(error)}.") from error
    case = IMPORTS[path.suffix.lower()](path, options)
    name, number = case.name, 2
    while name in taken:
        name, number = f"{case.name}-{number}", number + 1
    licence = next((str(case.facts[fact]) for fact in _LICENCES if case.facts.get(fact)), _NOT_STATED)
    case = replace(case, name=name, facts=_facts_of_source(path.name, case.facts))
    file = of_moving(case, licence=licence)
    case_text(file)
    return case, file


def _facts_of_source(source: str, facts: Mapping[str, Fact]) -> dict[str, Fact]:
    """Name facts as the source's own: driver and prevention there concern another AV."""
    stated = {name: fact for name, fact in facts.items() if (name, fact) != ("source", source)}
    return {"source": source, **{f"source_{name}": fact for name, fact in stated.items()}}


def _write(files: Sequence[CaseFile], folder: Path, driven: CasesDriven) -> list[Path]:
    """Write the case files; where the AV drove as recorded, they say what happened."""
    folder.mkdir()
    written = []
    for case, outcome in zip(files, driven.cases, strict=True):
        file = case
        if driven.av == RECORDED_AV:
            file = replace(file, happened=outcome.happened)
        written.append(write_case_file(file, folder / f"{case.name}.json"))
    return written


def _result(
    sources: Sequence[Path], cases: Sequence[MovingCase], files: Sequence[Path], refused: Sequence[Refused],
    driven: CasesDriven, place: Path, began: float,
) -> ImportedCases:  # fmt: skip
    return ImportedCases(
        cases=tuple(
            ImportedCase(
                source=str(source), case=case.name, file=str(file), vehicles=len(case.kind),
                seconds=round(FRAME_S * (len(case.poses) - 1), 1), notes=case.notes, outcome=outcome.outcome,
                words=outcome.words, library=None if outcome.library is None else str(outcome.library),
                case_id=outcome.case_id,
            )
            for source, case, file, outcome in zip(sources, cases, files, driven.cases, strict=True)
        ),
        refused=tuple(refused),
        av=driven.av,
        crashes=driven.crashes,
        libraries=tuple(str(library) for library in driven.libraries),
        out=str(place),
        seconds=round(time.perf_counter() - began, 3),
    )  # fmt: skip


def import_text(r: ImportedCases) -> str:
    """Tell the result in text."""
    lines = []
    for case in r.cases:
        vehicles = f"{case.vehicles} vehicle{'' if case.vehicles == 1 else 's'}"
        lines.append(f"{case.source}: {vehicles}, {case.seconds} s; {case.words}")
        lines += [f"  note: {note}" for note in case.notes]
    lines += [f"Not read: {one.source}: {one.why}" for one in r.refused]
    unknown = sum(case.outcome == UNKNOWN for case in r.cases)
    said = f"{len(r.cases):,} cases in {r.out}/cases; {r.av} crashes in {r.crashes:,}"
    lines.append(said + (f"; in {unknown:,} what it does is not known" if unknown else ""))
    lines += [f"Library: {library}" for library in r.libraries]
    return "\n".join(lines)
