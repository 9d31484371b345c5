"""The result of `run`, and what its stages leave in files."""

from __future__ import annotations

from typing import Annotated, Literal

from cornerforge._schema import Whole, meant
from cornerforge.results.analysis import Analysed
from cornerforge.results.driving import Filled, NaturalRate, Simulated
from cornerforge.results.html import Result
from cornerforge.results.learning import BOUNDED, BUDGET, Baseline, LearnedPolicy
from cornerforge.results.rates import Yield

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


class RunTrained(Yield, LearnedPolicy):
    """The adversary of a run, measured on tests that no training uses."""


class Initialised(Result):
    """A folder to start from."""

    files: Annotated[tuple[str, ...], meant("The files that were written: the AV, the config, the README.")]


class Reported(Result):
    """Where a page is."""

    report: Annotated[str, meant("The page, one file of HTML.")]
    library: Annotated[str, meant("The library whose cases it shows.")]
    evidence: Annotated[str | None, meant("The page of evidence; with `--evidence`.")] = None
    evidence_data: Annotated[str | None, meant("The same as JSON; with `--evidence`.")] = None


class FiguredOne(Result):
    """A figure for a paper."""

    name: Annotated[str, meant("Name of the chart, or the case id.")]
    file: Annotated[str | None, meant("Its file; null: nothing was drawn.")]
    caption: Annotated[str, meant("What it shows.")]


class Figured(Result):
    """Figures for a paper."""

    figures: Annotated[tuple[FiguredOne, ...], meant("The figures, in the order of `--list`.")]


class Exported(Result):
    """Cases written for other tools."""

    cases: Annotated[Whole, meant("How many.")]
    to: Annotated[str, meant("The format.")]
    out: Annotated[str, meant("Folder of the files.")]
    files: Annotated[tuple[str, ...], meant("Names of the files in it; roads are shared by cases.")]
    seconds: Annotated[float, meant("Wall-clock.", "s")]


class SpentOn(Result):
    """Cost and result of one part of a run for some hours."""

    what: Annotated[str, meant("The part, in words.")]
    seconds: Annotated[float, meant("Wall-clock, over all sessions.", "s")]
    tests: Annotated[Whole | None, meant("Tests of the AV; null: none.")]
    came_of_it: Annotated[str, meant("What came of it, in words.")]


class Spending(Result):
    """How a run for some hours spent its time; all counts were chosen by the clock, and stored when they were."""

    hours: Annotated[float, meant("The time that was given.", "h")]
    stand_in: Annotated[str | None, meant("The AV that the adversary learned against; null: the AV under test itself.")]
    decisions: Annotated[Whole, meant("Length of the training that was chosen, in decisions.")]
    answer_seconds: Annotated[
        float | None, meant("Time of the AV's answer in one world at the start; null: it is built in.", "s")
    ]
    batch: Annotated[Whole | None, meant("Worlds that it was asked about together at the start; null: built in.")]
    processes: Annotated[Whole, meant("Tests, or AV processes, at the same time.")]
    parts: Annotated[tuple[SpentOn, ...], meant("What the time was spent on.")]
    not_found: Annotated[tuple[str, ...], meant("What it could not find out, in words.")]


class RunDone(Result):
    """The whole job: what each stage came to."""

    out: Annotated[str, meant("Folder of everything.")]
    version: Annotated[str, meant("Version of cornerforge that did it.")]
    effort: Annotated[str, meant('quick, standard or paper; or the hours that were given, such as "1 h".')]
    seed: Annotated[Whole, meant("Seed of everything.")]
    av: Annotated[str, meant("Name of the AV.")]
    bounded: Annotated[bool, BOUNDED]
    budget: Annotated[float | None, BUDGET]
    reward: Annotated[
        str | None,
        meant("Which crashes the adversary was paid for, as for `train`; missing in files of earlier versions."),
    ] = None
    nde: Annotated[Simulated, meant("Natural traffic.")]
    natural: Annotated[NaturalRate, meant("How often the AV crashes in it.")]
    natural_cases: Annotated[Analysed | None, meant("What its crashes in natural traffic are; null: none was seen.")]
    train: Annotated[RunTrained, meant("The adversary.")]
    baselines: Annotated[tuple[Baseline, ...], meant("Plain adversaries on the same tests as the adversary.")]
    generate: Annotated[Filled, meant("The case library.")]
    analyse: Annotated[Analysed | None, meant("What is in it; null: nothing, the AV did not crash.")]
    spending: Annotated[
        Spending | None, meant("How the time was spent; with `--hours`. Missing: counts of an effort.")
    ] = None
    report: Annotated[str, meant("File of the report.")]
    seconds: Annotated[float, meant("Wall-clock of this call; stages of earlier ones are not in it.", "s")]


class Served(Result):
    """The explorer: where it can be opened, and what it shows."""

    url: Annotated[str, meant("Address to open, with the token where one is needed.")]
    host: Annotated[str, meant("Name or address on which it listens.")]
    port: Annotated[Whole, meant("Port on which it listens.")]
    usual_port: Annotated[bool, meant("The port is the one asked for, or the usual one; false: that was taken.")]
    token: Annotated[bool, meant("Who opens it needs the token in the address: others can reach this host.")]
    cases: Annotated[Whole, meant("Cases shown.")]
    sources: Annotated[tuple[str, ...], meant("Where they come from: natural, adversary or scripted.")]


class ExposureMiles(Result):
    """Distances over which exposure was counted."""

    nde: Annotated[float, meant("In natural traffic.", "miles")]
    adversary: Annotated[float, meant("With the adversary.", "miles")]


class Exposed(Result):
    """One quantity that the AV was exposed to, once a second, in natural traffic and with the adversary."""

    label: Annotated[str, meant("What it is, for an axis.")]
    unit: Annotated[str, meant("Of `edges`.")]
    edges: Annotated[tuple[float, ...], meant("Edges of the bins, rising.", "`unit`")]
    nde: Annotated[tuple[Whole, ...], meant("Counts of each bin in natural traffic.")]
    adversary: Annotated[tuple[Whole, ...], meant("Counts of each bin with the adversary.")]


ExposedTo = Literal["bbd_front", "bbd_rear", "ttc_front", "ttc_rear"]
"""What exposure is counted of: the distance to the vehicle ahead and behind, and the time to collision with it."""


class Exposure(Result):
    """Exposure of the AV, the paper's Figure 3; `exposure.json` of a run."""

    miles: Annotated[ExposureMiles, meant("Distances driven.")]
    quantities: Annotated[
        dict[ExposedTo, Exposed], meant("By name, bumper-to-bumper distances and times to collision.")
    ]


class Migrated(Result):
    """A library, a run or a file of an earlier version, written anew."""

    library: Annotated[str, meant("The new folder or file.")]
    cases: Annotated[Whole, meant("Its cases.")]
    made_by: Annotated[str, meant("Version of cornerforge that drove the cases.")]


class DamagedFile(Result):
    """A file that is not as it was written, or that holds what cannot be."""

    file: Annotated[str, meant("The file.")]
    fault: Annotated[str, meant("What is wrong with it: the column and the row, where they can be told.")]


class Verified(Result):
    """Files at a place, and whether they are as they were written."""

    whole: Annotated[Whole, meant("Files that are as they were written.")]
    without_checksum: Annotated[
        tuple[str, ...], meant("Files that can be read, but carry no checksum: of earlier versions, or made by hand.")
    ]
    damaged: Annotated[tuple[DamagedFile, ...], meant("Files that are not as they were written.")]
    other: Annotated[Whole, meant("Files of other kinds, such as pages and pictures; they are not read.")]
