"""Results of `import` and `cases from-data`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.html import Result

__all__ = [
    "CasesBrought",
    "CasesFromData",
    "DataFileRead",
    "ImportedCase",
    "ImportedCases",
    "MomentOfData",
    "Refused",
]


class ImportedCase(Result):
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


class Refused(Result):
    """A file that could not be read."""

    source: Annotated[str, meant("The file.")]
    why: Annotated[str, meant("What is wrong with it.")]


class CasesBrought(Result):
    """Facts on the AV in cases that were brought from elsewhere."""

    av: Annotated[str, meant('The AV that drove; "recorded": whatever was in its seat.')]
    crashes: Annotated[Whole, meant("Cases that end in a crash of the AV.")]
    libraries: Annotated[tuple[str, ...], meant("Libraries of these: one for each road; empty: there are none.")]
    out: Annotated[str, meant("Folder of case files and libraries.")]
    seconds: Annotated[float, meant("Wall-clock.", "s")]


class ImportedCases(CasesBrought):
    """Scenarios of other tools as cases."""

    cases: Annotated[tuple[ImportedCase, ...], meant("The cases, in the order of the files.")]
    refused: Annotated[tuple[Refused, ...], meant("Files that could not be read.")]


class DataFileRead(Result):
    """A trajectory file, and what became of its rows."""

    file: Annotated[str, meant("Its name, without folders.")]
    sha256: Annotated[str, meant("Of its bytes.")]
    layout: Annotated[str, meant("What its columns were recognised as.")]
    credit: Annotated[str, meant("Who publishes such data, and what to heed before passing on what is made of it.")]
    rows_read: Annotated[Whole, meant("All rows.")]
    rows_left_out: Annotated[Whole, meant("Rows that were not used.")]
    reasons: Annotated[dict[str, Whole], meant("Rows left out, by reason.")]
    recordings: Annotated[Whole, meant("Recordings in it, each direction of travel counted for itself.")]
    vehicles: Annotated[Whole, meant("Vehicles in these.")]
    notes: Annotated[tuple[str, ...], meant("What is odd about it, or had to be taken as given.")]


class MomentOfData(Result):
    """A critical moment, the case made of it, and what became of the AV in it."""

    case: Annotated[str, meant("Name of the case.")]
    file: Annotated[str, meant("Its case file.")]
    source: Annotated[str, meant("Trajectory file.")]
    recording: Annotated[str | None, meant("Recording, or clip; null: the file names none.")]
    ego: Annotated[str, meant("Vehicle whose seat the AV takes, as the file calls it.")]
    other: Annotated[str, meant("Vehicle in its way, as the file calls it.")]
    recording_time_s: Annotated[float, meant("When the moment is, in the file's time.", "s")]
    moment_s: Annotated[float, meant("When it is in the case.", "s")]
    drac_mps2: Annotated[float, meant("Deceleration that the ego needs there if the other keeps its speed.", "m/s2")]
    ttc_s: Annotated[float | None, meant("Time to collision there; null: the gap does not close.", "s")]
    thw_s: Annotated[float | None, meant("Time headway there; null: the ego stands.", "s")]
    contact_s: Annotated[
        float | None, meant("Time to contact in the plane there; null: both would pass each other.", "s")
    ]
    outcome: Annotated[str, meant('What became of the AV: "crash", "no crash" or "unknown" (it did not answer).')]
    striker: Annotated[
        str | None,
        meant("Who struck: av, bv (a vehicle on rails, which would not have braked) or mutual; null: no crash."),
    ]
    words: Annotated[str, meant("What happened, in words.")]
    case_id: Annotated[str | None, meant("Its case id in the library; null: no crash.")]


class CasesFromData(CasesBrought):
    """Critical moments of recorded traffic as cases."""

    files: Annotated[tuple[DataFileRead, ...], meant("The trajectory files.")]
    measure: Annotated[str, meant('What was ranked by: "drac", "ttc", "thw" or "contact".')]
    events: Annotated[Whole, meant("Events in all files of which a moment could have become a case.")]
    left_out: Annotated[
        dict[str, Whole], meant("Events as critical as those that became cases, but left out, by reason.")
    ]
    cases: Annotated[tuple[MomentOfData, ...], meant("The cases, the most critical first.")]
    strikers: Annotated[
        dict[str, Whole],
        meant("Crashes by who struck: av, bv or mutual. What bv struck, a real driver might have braked for."),
    ]
