"""Options of the whole job: `init`, `run`, `report`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork, Options, Resumable
from cornerforge._schema import meant
from cornerforge.verbs.options.cases import DEFAULT_LOOKS, LOOKS, REACTION
from cornerforge.verbs.options.learning import REWARD
from cornerforge.world_options import WorldOptions

__all__ = ["COMMANDS", "STAND_IN", "STAND_IN_AT_SITE", "Init", "MakeReport", "Run"]

STAND_IN, STAND_IN_AT_SITE = "idm-mobil", "idm-yield"
"""AVs that an adversary learns against when there is no time to learn against the AV under test: on roads, at sites."""


class Init(Options):
    """Write a folder to start from: an AV class, a config for `run --config`, and a README."""

    folder: Annotated[Path | str, meant("The folder; new, or without these files.", metavar="DIR")] = field(
        kw_only=False
    )


class Run(WorldOptions, Resumable, LongWork):
    """Do the whole job: natural traffic, natural crash rate, training, cases, analyses, report."""

    effort: Annotated[
        str | None,
        meant(
            "quick (4 minutes on 2 cores), standard (15) or paper. By default quick, or 10 minutes for a slow AV.",
            near=("quick", "standard", "paper"), default="quick",
        ),
    ] = None  # fmt: skip
    hours: Annotated[
        float | None,
        meant(
            "Time for all of it instead of an effort: does what fits, so results depend on speed. For slow AVs.",
            low=0.001, high=1000.0, unit="h",
        ),
    ] = None  # fmt: skip
    stand_in: Annotated[
        str,
        meant("Built-in AV to train against when the hours are too few to train against --av; at a site idm-yield."),
    ] = STAND_IN
    out: Annotated[Path | str, meant("Folder for everything; new or empty.")] = "cornerforge-out"
    reward: Annotated[str, REWARD] = "crash"


class MakeReport(LongWork):
    """Make the page of a run, of a natural rate or of any library, whichever AV made it."""

    place: Annotated[Path | str, meant("A library, or a folder of run or rate.", metavar="LIB|RUN")] = field(
        kw_only=False
    )
    out: Annotated[
        Path | str, meant("Of a library: folder for report.html and analysis/. The page of a run stays there.")
    ] = "cornerforge-report"
    avoidability: Annotated[str | int, LOOKS] = DEFAULT_LOOKS
    reaction: Annotated[float, REACTION] = 0.0
    evidence: Annotated[
        bool, meant("Answer an assessor's ten questions too: evidence.html and evidence.json beside the page.")
    ] = False
    beside: Annotated[
        Sequence[Path | str],
        meant(
            "Other results for --evidence: a folder of rate, ndd validate or suite run, a file of retest --out; may "
            "be given again."
        ),
    ] = ()


COMMANDS = (
    Command(Init, "verbs.init:init", "verbs.sentences.whole:init_text", ("cornerforge init my-av",)),
    Command(
        Run, "verbs.run:run", "verbs.sentences.whole:run_text",
        ("cornerforge run --effort quick --out out/demo", "cornerforge run --config cornerforge.toml --seed 1"),
        stages=True,
    ),
    Command(
        MakeReport, "verbs.make_report:make_report", "verbs.sentences.whole:report_text",
        ("cornerforge report out/demo/library --out out/page", "cornerforge report out/demo --evidence"), name="report",
        stages=True,
    ),
)  # fmt: skip
