"""The result of `import`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.stating import meant

__all__ = ["ImportedCase", "ImportedCases", "Refused"]


@dataclass(frozen=True, kw_only=True)
class ImportedCase:
    """A file of another tool, the case made of it, and what became of the AV in it."""

    source: str = field(metadata=meant("The file that was read."))
    case: str = field(metadata=meant("Name of the case."))
    file: str = field(metadata=meant("Its case file."))
    vehicles: int = field(metadata=meant("Vehicles in it, the AV among them."))
    seconds: float = field(metadata=meant("How long it is.", "s"))
    notes: tuple[str, ...] = field(metadata=meant("What could not be carried over, with its place in the source."))
    outcome: str = field(
        metadata=meant('What became of the AV: "crash", "no crash" or "unknown" (what it did is not recorded, or it '
                       "did not answer).")
    )  # fmt: skip
    words: str = field(metadata=meant("What happened, in words."))
    library: str | None = field(metadata=meant("Library that holds it; null: no crash."))
    case_id: str | None = field(metadata=meant("Its case id there; null: no crash."))


@dataclass(frozen=True, kw_only=True)
class Refused:
    """A file that could not be read."""

    source: str = field(metadata=meant("The file."))
    why: str = field(metadata=meant("What is wrong with it."))


@dataclass(frozen=True, kw_only=True)
class ImportedCases:
    """Scenarios of other tools as cases."""

    cases: tuple[ImportedCase, ...] = field(metadata=meant("The cases, in the order of the files."))
    refused: tuple[Refused, ...] = field(metadata=meant("Files that could not be read."))
    av: str = field(metadata=meant('The AV that drove; "recorded": whatever was in its seat.'))
    crashes: int = field(metadata=meant("Cases that end in a crash of the AV."))
    libraries: tuple[str, ...] = field(metadata=meant("Libraries of these: one for each road."))
    out: str = field(metadata=meant("Folder of everything."))
    seconds: float = field(metadata=meant("Wall-clock.", "s"))
