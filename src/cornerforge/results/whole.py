"""The result of `run`, and what its stages leave in files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from cornerforge.results.analysis import Analysed
from cornerforge.results.driving import Filled, NaturalRate, Simulated
from cornerforge.results.learning import BOUNDED, BUDGET, Baseline, LearnedPolicy
from cornerforge.results.rates import Yield
from cornerforge.results.stating import meant

__all__ = [
    "DamagedFile",
    "Exported",
    "Exposed",
    "ExposedTo",
    "Exposure",
    "ExposureMiles",
    "Figured",
    "FiguredOne",
    "Initialised",
    "Reported",
    "RunDone",
    "RunTrained",
    "Served",
    "Spending",
    "SpentOn",
    "Verified",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class RunTrained(Yield, LearnedPolicy):
    """The adversary of a run, measured on tests that no training uses."""


@dataclass(frozen=True, kw_only=True)
class Initialised:
    """A folder to start from."""

    files: tuple[str, ...] = field(metadata=meant("The files that were written: the AV, the config, the README."))


@dataclass(frozen=True, kw_only=True)
class Reported:
    """Where a page is."""

    report: str = field(metadata=meant("The page, one file of HTML."))
    library: str = field(metadata=meant("The library whose cases it shows."))


@dataclass(frozen=True, kw_only=True)
class FiguredOne:
    """A figure for a paper."""

    name: str = field(metadata=meant("Name of the chart, or the case id."))
    file: str | None = field(metadata=meant("Its file; null: nothing was drawn."))
    caption: str = field(metadata=meant("What it shows."))


@dataclass(frozen=True, kw_only=True)
class Figured:
    """Figures for a paper."""

    figures: tuple[FiguredOne, ...] = field(metadata=meant("The figures, in the order of `--list`."))


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Cases written for other tools."""

    cases: int = field(metadata=meant("How many."))
    to: str = field(metadata=meant("The format."))
    out: str = field(metadata=meant("Folder of the files."))
    files: tuple[str, ...] = field(metadata=meant("Names of the files in it; roads are shared by cases."))
    seconds: float = field(metadata=meant("Wall-clock.", "s"))


@dataclass(frozen=True, kw_only=True)
class SpentOn:
    """Cost and result of one part of a run for some hours."""

    what: str = field(metadata=meant("The part, in words."))
    seconds: float = field(metadata=meant("Wall-clock, over all sessions.", "s"))
    tests: int | None = field(metadata=meant("Tests of the AV; null: none."))
    came_of_it: str = field(metadata=meant("What came of it, in words."))


@dataclass(frozen=True, kw_only=True)
class Spending:
    """How a run for some hours spent its time; all counts were chosen by the clock, and stored when they were."""

    hours: float = field(metadata=meant("The time that was given.", "h"))
    stand_in: str | None = field(
        metadata=meant("The AV that the adversary learned against; null: the AV under test itself.")
    )
    decisions: int = field(metadata=meant("Length of the training that was chosen, in decisions."))
    answer_seconds: float | None = field(
        metadata=meant("Time of the AV's answer in one world at the start; null: it is built in.", "s")
    )
    batch: int | None = field(metadata=meant("Worlds that it was asked about together at the start; null: built in."))
    processes: int = field(metadata=meant("Tests, or AV processes, at the same time."))
    parts: tuple[SpentOn, ...] = field(metadata=meant("What the time was spent on."))
    not_found: tuple[str, ...] = field(metadata=meant("What it could not find out, in words."))


@dataclass(frozen=True, kw_only=True)
class RunDone:
    """The whole job: what each stage came to."""

    out: str = field(metadata=meant("Folder of everything."))
    version: str = field(metadata=meant("Version of cornerforge that did it."))
    effort: str = field(metadata=meant('quick, standard or paper; or the hours that were given, such as "1 h".'))
    seed: int = field(metadata=meant("Seed of everything."))
    av: str = field(metadata=meant("Name of the AV."))
    bounded: bool = field(metadata=BOUNDED)
    budget: float | None = field(metadata=BUDGET)
    reward: str | None = field(
        default=None,
        metadata=meant(
            "Which crashes the adversary was paid for, as for `train`; missing in files of earlier versions."
        ),
    )
    nde: Simulated = field(metadata=meant("Natural traffic."))
    natural: NaturalRate = field(metadata=meant("How often the AV crashes in it."))
    natural_cases: Analysed | None = field(
        metadata=meant("What its crashes in natural traffic are; null: none was seen.")
    )
    train: RunTrained = field(metadata=meant("The adversary."))
    baselines: tuple[Baseline, ...] = field(metadata=meant("Plain adversaries on the same tests as the adversary."))
    generate: Filled = field(metadata=meant("The case library."))
    analyse: Analysed | None = field(metadata=meant("What is in it; null: nothing, the AV did not crash."))
    spending: Spending | None = field(
        default=None, metadata=meant("How the time was spent; with `--hours`. Missing: counts of an effort.")
    )
    report: str = field(metadata=meant("File of the report."))
    seconds: float = field(metadata=meant("Wall-clock of this call; stages of earlier ones are not in it.", "s"))


@dataclass(frozen=True, kw_only=True)
class Served:
    """The explorer: where it can be opened, and what it shows."""

    url: str = field(metadata=meant("Address to open, with the token where one is needed."))
    host: str = field(metadata=meant("Name or address on which it listens."))
    port: int = field(metadata=meant("Port on which it listens."))
    usual_port: bool = field(metadata=meant("The port is the one asked for, or the usual one; false: that was taken."))
    token: bool = field(metadata=meant("Who opens it needs the token in the address: others can reach this host."))
    cases: int = field(metadata=meant("Cases shown."))
    sources: tuple[str, ...] = field(metadata=meant("Where they come from: natural, adversary or scripted."))


@dataclass(frozen=True, kw_only=True)
class ExposureMiles:
    """Distances over which exposure was counted."""

    nde: float = field(metadata=meant("In natural traffic.", "miles"))
    adversary: float = field(metadata=meant("With the adversary.", "miles"))


@dataclass(frozen=True, kw_only=True)
class Exposed:
    """One quantity that the AV was exposed to, once a second, in natural traffic and with the adversary."""

    label: str = field(metadata=meant("What it is, for an axis."))
    unit: str = field(metadata=meant("Of `edges`."))
    edges: tuple[float, ...] = field(metadata=meant("Edges of the bins, rising.", "`unit`"))
    nde: tuple[int, ...] = field(metadata=meant("Counts of each bin in natural traffic."))
    adversary: tuple[int, ...] = field(metadata=meant("Counts of each bin with the adversary."))


ExposedTo = Literal["bbd_front", "bbd_rear", "ttc_front", "ttc_rear"]
"""What exposure is counted of: the distance to the vehicle ahead and behind, and the time to collision with it."""


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """Exposure of the AV, the paper's Figure 3; `exposure.json` of a run."""

    miles: ExposureMiles = field(metadata=meant("Distances driven."))
    quantities: dict[ExposedTo, Exposed] = field(
        metadata=meant("By name, bumper-to-bumper distances and times to collision.")
    )


@dataclass(frozen=True, kw_only=True)
class Migrated:
    """A library, a run or a file of an earlier version, written anew."""

    library: str = field(metadata=meant("The new folder or file."))
    cases: int = field(metadata=meant("Its cases."))
    made_by: str = field(metadata=meant("Version of cornerforge that drove the cases."))


@dataclass(frozen=True, kw_only=True)
class DamagedFile:
    """A file that is not as it was written, or that holds what cannot be."""

    file: str = field(metadata=meant("The file."))
    fault: str = field(metadata=meant("What is wrong with it: the column and the row, where they can be told."))


@dataclass(frozen=True, kw_only=True)
class Verified:
    """Files at a place, and whether they are as they were written."""

    whole: int = field(metadata=meant("Files that are as they were written."))
    without_checksum: tuple[str, ...] = field(
        metadata=meant("Files that can be read, but carry no checksum: of earlier versions, or made by hand.")
    )
    damaged: tuple[DamagedFile, ...] = field(metadata=meant("Files that are not as they were written."))
    other: int = field(metadata=meant("Files of other kinds, such as pages and pictures; they are not read."))
