"""The result of `cases from-data`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.stating import meant

__all__ = ["CasesFromData", "DataFileRead", "MomentOfData"]


@dataclass(frozen=True, kw_only=True)
class DataFileRead:
    """A trajectory file, and what became of its rows."""

    file: str = field(metadata=meant("Its name, without folders."))
    sha256: str = field(metadata=meant("Of its bytes."))
    layout: str = field(metadata=meant("What its columns were recognised as."))
    credit: str = field(
        metadata=meant("Who publishes such data, and what to heed before passing on what is made of it.")
    )
    rows_read: int = field(metadata=meant("All rows."))
    rows_left_out: int = field(metadata=meant("Rows that were not used."))
    reasons: dict[str, int] = field(metadata=meant("Rows left out, by reason."))
    recordings: int = field(metadata=meant("Recordings in it, each direction of travel counted for itself."))
    vehicles: int = field(metadata=meant("Vehicles in these."))
    notes: tuple[str, ...] = field(metadata=meant("What is odd about it, or had to be taken as given."))


@dataclass(frozen=True, kw_only=True)
class MomentOfData:
    """A critical moment, the case made of it, and what became of the AV in it."""

    case: str = field(metadata=meant("Name of the case."))
    file: str = field(metadata=meant("Its case file."))
    source: str = field(metadata=meant("Trajectory file."))
    recording: str | None = field(metadata=meant("Recording, or clip; null: the file names none."))
    ego: str = field(metadata=meant("Vehicle whose seat the AV takes, as the file calls it."))
    other: str = field(metadata=meant("Vehicle in its way, as the file calls it."))
    recording_time_s: float = field(metadata=meant("When the moment is, in the file's time.", "s"))
    moment_s: float = field(metadata=meant("When it is in the case.", "s"))
    drac_mps2: float = field(
        metadata=meant("Deceleration that the ego needs there if the other keeps its speed.", "m/s2")
    )
    ttc_s: float | None = field(metadata=meant("Time to collision there; null: the gap does not close.", "s"))
    thw_s: float | None = field(metadata=meant("Time headway there; null: the ego stands.", "s"))
    contact_s: float | None = field(
        metadata=meant("Time to contact in the plane there; null: both would pass each other.", "s")
    )
    outcome: str = field(metadata=meant('What became of the AV: "crash", "no crash" or "unknown" (it did not answer).'))
    striker: str | None = field(
        metadata=meant(
            "Who struck: av, bv (a vehicle on rails, which would not have braked) or mutual; null: no crash."
        )
    )
    words: str = field(metadata=meant("What happened, in words."))
    case_id: str | None = field(metadata=meant("Its case id in the library; null: no crash."))


@dataclass(frozen=True, kw_only=True)
class CasesFromData:
    """Critical moments of recorded traffic as cases."""

    files: tuple[DataFileRead, ...] = field(metadata=meant("The trajectory files."))
    measure: str = field(metadata=meant('What was ranked by: "drac", "ttc", "thw" or "contact".'))
    events: int = field(metadata=meant("Events in all files of which a moment could have become a case."))
    left_out: dict[str, int] = field(
        metadata=meant("Events as critical as those that became cases, but left out, by reason.")
    )
    cases: tuple[MomentOfData, ...] = field(metadata=meant("The cases, the most critical first."))
    av: str = field(metadata=meant('The AV in the ego\'s seat; "recorded": the recorded driver.'))
    crashes: int = field(metadata=meant("Cases in which the AV crashes."))
    strikers: dict[str, int] = field(
        metadata=meant("These by who struck: av, bv or mutual. What bv struck, a real driver might have braked for.")
    )
    libraries: tuple[str, ...] = field(
        metadata=meant("Libraries of the cases in which the AV crashes: one for each road; empty: it crashes in none.")
    )
    out: str = field(metadata=meant("Folder of case files and libraries."))
    seconds: float = field(metadata=meant("Wall-clock.", "s"))
