"""Options of studies: `suite build`, `suite run`, `r157`, `variety`, `plausibility`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork, Resumable
from cornerforge._schema import meant
from cornerforge.world_options import BUDGETS, AvAskedOptions, AvOptions, WorldOptions

__all__ = ["BUDGETS_NATS", "COMMANDS", "R157", "PlausibilityStudy", "SuiteBuild", "SuiteRun", "Variety"]

BUDGETS_NATS = (10.0, 20.0, 40.0, 60.0, 80.0)
"""Likelihood budgets that `plausibility` trains for."""


class SuiteBuild(AvAskedOptions, LongWork):
    """Choose the fewest cases that find and rank the flaws of many AVs; checked on AVs left out."""

    libraries: Annotated[
        Sequence[Path | str] | Path | str, meant("Case libraries of one model and ODD.", metavar="LIB...")
    ] = field(kw_only=False)
    out: Annotated[Path | str, meant("Folder of the suite, a library itself.")]
    size: Annotated[int, meant("Most cases.", low=1, high=1_000_000)] = 200
    zoo: Annotated[
        Sequence[str] | None,
        meant("AV that drives the cases; may be given again. By default all built-in ones.", near=("av",)),
    ] = None


class R157(AvOptions, LongWork):
    """Drive an AV through the scenarios of UN Regulation 157, beside the reference drivers."""

    families: Annotated[
        Sequence[str] | str,
        meant(
            "cut-in, cut-out or deceleration of r157; stationary, moving or braking of aeb; may be given again. All by "
            "default.",
            name="--family", near=("cut-in", "cut-out", "deceleration", "stationary", "moving", "braking", "all"),
        ),
    ] = "all"  # fmt: skip
    out: Annotated[Path | str | None, meant("Folder for the page, scenarios.csv and the library of failures.")] = None


class SuiteRun(R157):
    """Drive an AV through scenarios of a regulation; exit status 1 if it fails where careful drivers pass."""

    suite: Annotated[
        str, meant("aeb: rear tests of UN R152 and Euro NCAP; r157.", metavar="SUITE", choices=("aeb", "r157"))
    ] = field(kw_only=False)
    junit: Annotated[Path | str | None, meant("New file: JUnit XML.")] = None


class Variety(WorldOptions, LongWork):
    """Count kinds of crash: in libraries, or as policies make them greedily, at random and mixed."""

    libraries: Annotated[Sequence[Path | str], meant("Case libraries.", metavar="LIB...")] = field(
        kw_only=False, default=()
    )
    policies: Annotated[
        Sequence[Path | str], meant("Policy file instead of libraries; may be given again.", name="--policy")
    ] = ()
    tests: Annotated[int, meant("Tests for each way to generate.", low=1, high=10**8)] = 4096
    acting: Annotated[str, meant("How to act at random: softmax or softmax:T.")] = "softmax"


class PlausibilityStudy(AvOptions, Resumable, LongWork):
    """Plot what an adversary reaches against how plausible it must stay: one training per budget and seed."""

    out: Annotated[Path | str, meant("Folder for policies, curve and figure.")]
    budgets: Annotated[
        Sequence[float],
        meant("Likelihood budget in nats; may be given again. 10, 20, 40, 60, 80.", name="--budget", unit="nats"),
    ] = BUDGETS_NATS
    budget_of: Annotated[
        str, meant("What --budget limits: shortfall behind the likeliest, or excess over natural.", choices=BUDGETS)
    ] = BUDGETS[0]
    seeds: Annotated[int, meant("Training seeds per budget.", low=1, high=1000)] = 3
    decisions: Annotated[
        int | None, meant("Length of a training; the fast preset's by default.", low=1, high=10**12)
    ] = None
    tests: Annotated[int, meant("Evaluation tests of each policy.", low=1, high=10**8)] = 8192


COMMANDS = (
    Command(
        SuiteBuild, "ext.studies.suite:suite_build", "ext.studies.suite:suite_text",
        ("cornerforge suite build out/demo/library --size 20 --out out/suite",), name="suite build",
    ),
    Command(
        SuiteRun, "ext.studies.suite_run:suite_run", "ext.studies.suite_run:suite_run_text",
        ("cornerforge suite run aeb --av idm-mobil --out out/aeb",), name="suite run",
        fails="ext.studies.suite_run:fails_the_suite",
    ),
    Command(
        R157, "ext.studies.suite_run:r157", "ext.studies.suite_run:suite_run_text",
        ("cornerforge r157 --av idm-mobil --out out/r157", "cornerforge r157 --av my_av:MyAv --family cut-in"),
    ),
    Command(
        Variety, "ext.studies.variety:variety", "ext.studies.variety:variety_text",
        (
            "cornerforge variety out/demo/library",
            "cornerforge variety --policy out/demo/policy.safetensors --tests 1024",
        ),
    ),
    Command(
        PlausibilityStudy, "ext.studies.plausibility:plausibility", "ext.studies.plausibility:plausibility_text",
        ("cornerforge plausibility --budget 20 --budget 60 --out out/plausible",), spreads=True,
    ),
)  # fmt: skip
