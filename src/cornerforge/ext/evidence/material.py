"""Everything that evidence is made of: a run or a library with its analysis, and results that lie beside it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

from cornerforge._schema import Declared
from cornerforge.errors import InputError
from cornerforge.ext.evidence.kinds import kinds_of_crash
from cornerforge.library import CaseLibrary
from cornerforge.report.artefacts import Artefacts, Summary
from cornerforge.report.front import Known
from cornerforge.report.road import RoadRate
from cornerforge.results import NaturalRate, Regulated, Retested
from cornerforge.results.evidence import KindOfCrash
from cornerforge.results.stating import from_file
from cornerforge.results.validation import FactFound
from cornerforge.results.whole import Verified
from cornerforge.types import Odd

__all__ = ["Beside", "Material", "gather", "read_beside"]


class Checks(Declared):
    """Checks of a traffic model: a part of `validation.json`."""

    model_hash: str
    facts: tuple[FactFound, ...]


_FILES: dict[str, tuple[type, str]] = {
    "validation.json": (Checks, "cornerforge ndd validate"),
    "rate.json": (NaturalRate, "cornerforge rate"),
    "suite.json": (Regulated, "cornerforge suite run"),
}
"""File of a result, its class, and what writes it; any other JSON file is taken for one of `retest --out`."""


@dataclass(frozen=True)
class Beside:
    """Results that lie beside the run, with the files that hold them."""

    validations: tuple[Checks, ...] = ()
    rates: tuple[NaturalRate, ...] = ()
    regulated: tuple[Regulated, ...] = ()
    retested: tuple[Retested, ...] = ()
    files: tuple[Path, ...] = ()


SHIPPED = resources.files("cornerforge.ext.evidence") / "validation.json"
"""Checks of the shipped traffic model; `make validation` makes them."""


@dataclass(frozen=True)
class Material:
    """All that the answers read.

    Attributes:
        artefacts, known: As the page of the run has them, so that both say the same.
        odd: The operational design domain.
        rate: The natural rate: of `beside` with model uncertainty if one is there, else the run's; None: not known.
        kinds: Natural crashes by kind.
        beside: Other results.
        verified: Whether the run's files are as they were written.
        files: SHA-256 of the files that the evidence rests on, by path.
    """

    artefacts: Artefacts
    known: Known
    odd: Odd
    rate: NaturalRate | None
    kinds: tuple[KindOfCrash, ...]
    beside: Beside
    verified: Verified
    files: dict[str, str]

    @property
    def summary(self) -> Summary:
        """Numbers of the page."""
        return self.artefacts.summary

    @property
    def command(self) -> str:
        """The command that made the results, as it was given."""
        return str(self.artefacts.provenance.get("command", self.artefacts.command))

    @property
    def road(self) -> RoadRate | None:
        """How often the AV crashes on the road, as the page says it."""
        return self.known.road


def read_beside(places: Sequence[Path]) -> Beside:
    """Read the results at some places, each a file or a folder of `rate`, `ndd validate`, `r157` or `retest`.

    Raises:
        InputError: There is no result that evidence can hold at a place.
        FileFormatError: A file is damaged.
    """
    found: dict[type, list[Any]] = {Checks: [], NaturalRate: [], Regulated: [], Retested: []}
    files = []
    for place in places:
        inside = [place] if place.is_file() else [place / name for name in _FILES if (place / name).is_file()]
        if not inside:
            raise InputError(
                f"{place} holds none of {', '.join(_FILES)}; name a folder of rate, ndd validate or suite run, or the "
                "file that retest --out wrote."
            )
        for file in inside:
            kind, command = _FILES.get(file.name, (Retested, "cornerforge retest"))
            found[kind].append(from_file(kind, file, command))
            files.append(file)
    return Beside(*map(tuple, found.values()), files=tuple(files))  # type: ignore[misc]


def gather(artefacts: Artefacts, known: Known, beside: Beside) -> Material:
    """Gather what the answers read.

    Raises:
        FileFormatError: A file is missing or damaged.
        InputError: A result beside is of another AV or another traffic model.
    """
    from cornerforge.verbs.verify import verify

    model_hash = str(artefacts.provenance.get("identity", {}).get("model_hash"))
    _check_same(beside, artefacts.summary.av, model_hash)
    if not beside.validations:
        shipped = from_file(Checks, Path(str(SHIPPED)), "make validation")
        beside = replace(beside, validations=(shipped,) if shipped.model_hash == model_hash else ())
    rates = [one for one in beside.rates if one.model_uncertainty is not None] or list(beside.rates)
    natural = artefacts.summary.natural
    kinds: tuple[KindOfCrash, ...] = ()
    place = artefacts.natural_library
    if place is not None and known.kinds is not None:
        mine = place == artefacts.library
        folder = artefacts.analysed_in if mine else place.parent / "analysis"
        kinds = kinds_of_crash(place, folder, known.kinds, artefacts.command)
    inside = [artefacts.out / "summary.json", artefacts.analysed_in / "analysis.json"]
    used = [file for file in inside if file.is_file()] + list(beside.files)
    return Material(
        artefacts=artefacts,
        known=known,
        odd=CaseLibrary.open(artefacts.library).odd,
        rate=rates[0] if rates else natural,
        kinds=kinds,
        beside=beside,
        verified=verify([artefacts.library, *used]),
        files={str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in used},
    )


def _check_same(beside: Beside, av: str, model_hash: str) -> None:
    for other in [one.av for one in beside.rates] + [one.av for one in beside.regulated]:
        if other != av:
            raise InputError(f"A result beside is of {other}, the run of {av}; evidence is of one AV.")
    for validation in beside.validations:
        if model_hash not in ("None", validation.model_hash):
            raise InputError(
                f"The validation is of the model {validation.model_hash}, the run drove with {model_hash}; validate "
                "the run's model."
            )
