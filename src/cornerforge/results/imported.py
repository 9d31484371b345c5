"""The result of `import`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Declared, Whole, meant

__all__ = ["CasesBrought", "ImportedCase", "ImportedCases", "Refused"]


class ImportedCase(Declared):
    """A file of another tool, the case made of it, and what became of the AV in it."""

    source: Annotated[str, meant("The file that was read.")]
    case: Annotated[str, meant("Name of the case.")]
    file: Annotated[str, meant("Its case file.")]
    vehicles: Annotated[Whole, meant("Vehicles in it, the AV among them.")]
    seconds: Annotated[float, meant("How long it is.", "s")]
    notes: Annotated[tuple[str, ...], meant("What could not be carried over, with its place in the source.")]
    outcome: Annotated[
        str,
        meant(
            'What became of the AV: "crash", "no crash" or "unknown" (what it did is not recorded, or '
            "it did not answer)."
        ),
    ]
    words: Annotated[str, meant("What happened, in words.")]
    library: Annotated[str | None, meant("Library that holds it; null: no crash.")]
    case_id: Annotated[str | None, meant("Its case id there; null: no crash.")]


class Refused(Declared):
    """A file that could not be read."""

    source: Annotated[str, meant("The file.")]
    why: Annotated[str, meant("What is wrong with it.")]


class CasesBrought(Declared):
    """What became of the AV in cases that were brought from elsewhere."""

    av: Annotated[str, meant('The AV that drove; "recorded": whatever was in its seat.')]
    crashes: Annotated[Whole, meant("Cases that end in a crash of the AV.")]
    libraries: Annotated[tuple[str, ...], meant("Libraries of these: one for each road; empty: there are none.")]
    out: Annotated[str, meant("Folder of case files and libraries.")]
    seconds: Annotated[float, meant("Wall-clock.", "s")]


class ImportedCases(CasesBrought):
    """Scenarios of other tools as cases."""

    cases: Annotated[tuple[ImportedCase, ...], meant("The cases, in the order of the files.")]
    refused: Annotated[tuple[Refused, ...], meant("Files that could not be read.")]
