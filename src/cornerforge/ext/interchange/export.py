"""`export` writes cases of a library for other tools."""

from __future__ import annotations

import importlib.util
import itertools
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cornerforge._checks import check_in
from cornerforge._files import real_path
from cornerforge._options import verb
from cornerforge.errors import InputError, MissingExtraError
from cornerforge.experiment.output import config_hash, open_output, provenance, write_json
from cornerforge.ext.interchange.case_facts import CaseFacts
from cornerforge.ext.interchange.library_case_files import CaseFilesOf
from cornerforge.ext.interchange.opendrive_lanes import is_plain
from cornerforge.ext.interchange.openscenario import VERSIONS, write_openscenario
from cornerforge.ext.interchange.options import Export
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.library.case_file import write_case_file
from cornerforge.results.whole import Exported
from cornerforge.road.network import Road
from cornerforge.site.network import Site

__all__ = ["EXPORTS", "CaseWriter", "ExportOptions", "export", "export_text", "is_installed"]

_AFTER = 50
"""Number of cases between two reports of progress."""


@dataclass(frozen=True)
class ExportOptions:
    """How cases are written.

    Attributes:
        version: Version of OpenSCENARIO: 1.0, 1.1, 1.2 or 1.3.
        mode: recorded: all move as recorded. controller: the AV is left to the user, in OpenSCENARIO to a controller,
            in CommonRoad as a planning problem. relative, of OpenSCENARIO: see `ext.interchange.openscenario`.
    """

    version: str = "1.2"
    mode: str = "recorded"


def is_installed(to: str) -> bool:
    """Say whether the library that a format needs is installed."""
    try:
        return to not in _NEEDS or importlib.util.find_spec(_NEEDS[to][0]) is not None
    except ModuleNotFoundError:  # of the package that the library is part of
        return False


class CaseWriter:
    """Writes cases of a library in one format; one serves one thread.

    Args:
        cases: The library; its path must have a name.
        to: A name of `EXPORTS`.
        options: How; None: as recorded.

    Raises:
        UnknownNameError: The format is unknown.
        InputError: The format does not have the mode or version, or cannot hold the road.
        MissingExtraError: The format's library is not installed.
    """

    def __init__(self, cases: CaseLibrary, to: str, options: ExportOptions | None = None) -> None:
        check_in("format", to, tuple(EXPORTS))
        check_in("OpenSCENARIO version", (options or ExportOptions()).version, VERSIONS)
        self._to, self._options = to, options or ExportOptions()
        if self._options.mode not in _MODES.get(to, ("recorded",)):
            raise InputError(
                f"{to} has no mode {self._options.mode}; it has: {', '.join(_MODES.get(to, ('recorded',)))}."
            )
        if to != "openscenario" and self._options.version != ExportOptions().version:
            raise InputError(f"The version is that of openscenario; leave it out for {to}.")
        _check_road(cases.odd.road, to)
        _check_site(cases.odd.site, to)
        if not is_installed(to):
            raise MissingExtraError(*_NEEDS[to][1:])
        self._facts = CaseFacts(cases)
        self._files = CaseFilesOf(cases) if to == "json" else None

    def write(self, case_id: str, stored: StoredCase, folder: Path) -> Sequence[str]:
        """Write a case into a folder; returns the names of its files."""
        case = self._facts.out_case(case_id, stored)
        if self._to == "openscenario":
            return write_openscenario(case, folder, version=self._options.version, mode=self._options.mode)
        if self._to == "commonroad":
            from cornerforge.ext.interchange.commonroad import write_commonroad

            return write_commonroad(case, folder, av="planning" if self._options.mode == "controller" else "both")
        if self._to in ("osi", "mcap"):
            from cornerforge.ext.interchange.write_osi import write_osi

            return write_osi(case, folder / f"{case.name}.{self._to}")
        name = f"{case.name}.{_ENDINGS[self._to]}"
        if self._to == "rerun":
            from cornerforge.ext.interchange.rerun_file import write_rerun

            write_rerun(case, folder / name)
        elif self._files is not None:
            of = self._files.of(case_id, name=case.name, facts=case.facts)
            write_case_file(of, folder / name, overwrite=True)
        else:
            from cornerforge.ext.interchange.tables import write_table

            return write_table(case, folder / name)
        return (name,)


EXPORTS: Mapping[str, str] = {
    "openscenario": "OpenSCENARIO with OpenDRIVE",
    "commonroad": "CommonRoad scenario",
    "osi": "ASAM OSI trace with OpenDRIVE",
    "mcap": "ASAM OSI trace (MCAP) with OpenDRIVE",
    "csv": "table (CSV)",
    "parquet": "table (Parquet)",
    "rerun": "recording for the Rerun viewer",
    "json": "case file (JSON), for retest and pytest",
}
"""The formats, each with what people read."""
_NEEDS = {
    "rerun": ("rerun", "rerun-sdk", "rerun"), "osi": ("google.protobuf", "protobuf", "osi"),
    "mcap": ("mcap", "mcap", "osi"),
}  # fmt: skip
"""Module that a format needs, its package, and the extra that installs it."""
_HOLD_ROADS = frozenset({"json", "mcap", "openscenario", "osi"})
"""Formats that hold roads with curves, and with lanes that begin and end."""
_HOLD_SITES = frozenset({"commonroad", "csv", "mcap", "osi", "parquet"})
"""Formats that hold cases at a junction."""
_MODES = {"openscenario": ("recorded", "controller", "relative"), "commonroad": ("recorded", "controller")}
_ENDINGS = {"csv": "csv", "parquet": "parquet", "rerun": "rrd", "json": "json"}


@verb(Export)
def export(options: Export) -> Exported:
    """Write cases for other tools.

    Returns:
        What `cornerforge export --json` prints.

    Raises:
        CornerForgeError: The case or format is unknown, the library cannot be read, an extra is missing, or the folder
            cannot be used.
    """
    began = time.perf_counter()
    given, place = Path(options.library), Path(options.out)
    source = CaseLibrary.open(real_path(given))
    ids = _ids(source, [options.cases] if isinstance(options.cases, str) else options.cases)
    identity = {
        "library": config_hash(source.identity), "to": options.to, "version": options.version, "mode": options.mode,
        "cases": config_hash({"": ids}),
    }  # fmt: skip
    writer = CaseWriter(source, options.to, ExportOptions(options.version, options.mode))
    found = source.scenarios(ids)
    first = next(found)  # a name that the library lacks is an error before the folder is claimed
    open_output(place, identity, resume=options.resume)
    files: dict[str, None] = {}
    for done, stored in enumerate(itertools.chain([first], found), 1):
        case_id = str(stored.scalars["case_id"])
        files.update(dict.fromkeys(writer.write(case_id, stored, place)))
        if done % _AFTER == 0 or done == len(ids):
            options.progress("export", done, len(ids))
    seconds = round(time.perf_counter() - began, 3)
    write_json(place / "provenance.json", provenance(identity, seconds))
    return Exported(cases=len(ids), to=options.to, out=str(place), files=tuple(files), seconds=seconds)


def _check_road(road: Road | None, to: str) -> None:
    """Refuse a road with curves, or lanes that begin, end or may not be left, where a format is written without it.

    Raises:
        InputError: The format cannot hold it.
    """
    if to not in _HOLD_ROADS and road is not None and not is_plain(road):
        raise InputError(
            f"{to} is written with straight lanes that all go on, and the road {road.name} has others; "
            f"export its cases to: {', '.join(sorted(_HOLD_ROADS))}."
        )


def _check_site(site: Site | None, to: str) -> None:
    """Refuse a junction where a format is written without it.

    Raises:
        InputError: The format cannot hold it.
    """
    if to not in _HOLD_SITES and site is not None:
        raise InputError(
            f"{to} is written with lanes beside each other on one road, and {site.name} is a junction; "
            f"export its cases to: {', '.join(sorted(_HOLD_SITES))}."
        )


def _ids(source: CaseLibrary, wanted: Sequence[str]) -> list[str]:
    """Return the wanted ids, each once.

    Raises:
        InputError: There is none.
    """
    every = list(wanted) == ["all"]
    ids = source.scalars(["case_id"])["case_id"].to_pylist() if every else list(dict.fromkeys(wanted))
    if not ids:
        raise InputError(f"There is no case to export; name some of the library {source.path}, or all.")
    if "all" in ids:
        raise InputError('"all" stands for every case; leave out the others, or leave it out.')
    return ids


def export_text(found: Exported) -> str:
    """Write how many cases were written, and where."""
    return f"{found.cases:,} cases as {len(found.files):,} files ({found.to}) in {found.out}"
