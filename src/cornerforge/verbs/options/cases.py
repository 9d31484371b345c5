"""Options of cases: made, sorted, shrunk, driven again, compared, asked for, checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork, Options, Resumable, Watched
from cornerforge._schema import meant
from cornerforge.verbs.options.driving import ACTING
from cornerforge.world_options import PLAIN_ADVERSARIES, AvAloneOptions, AvProcessOptions, WorldOptions

__all__ = [
    "CASES", "COMMANDS", "DEFAULT_LOOKS", "LIBRARY", "LOOKS", "REACTION", "Analyse", "Generate", "Migrate", "Query",
    "Replay", "Retest", "Shrink", "Verify",
]  # fmt: skip

DEFAULT_LOOKS = 2000
"""Default number of cases drawn for the search for ways out: it takes a few seconds on two cores."""
LIBRARY = meant("A case library.", metavar="LIB")
CASES = meant('Case ids, or "all".', metavar="CASE...")
LOOKS = meant(
    "For how many cases, drawn at random, a way out is searched for; all or none.",
    more="Typical and rare cases are searched too, unless it is none.",
)
REACTION = meant(
    "Seconds that the AV needs to react.",
    more="A manoeuvre that avoids the crash begins at the earliest this long after the one that led to it.",
    low=0.0, high=5.0, unit="s",
)  # fmt: skip


class Generate(WorldOptions, Resumable, LongWork):
    """Fill a case library with crashes that an adversary makes."""

    policy: Annotated[
        Sequence[str | Path] | str | Path,
        meant(
            f"Policy file, or {', '.join(PLAIN_ADVERSARIES)}. Given again: each test draws one of the policies.",
            near=PLAIN_ADVERSARIES,
        ),
    ]
    out: Annotated[Path | str, meant("Library to fill.")]
    cases: Annotated[int, meant("How many cases.", low=1, high=10**8)] = 1_000
    acting: Annotated[str, ACTING] = "learned"


class Analyse(LongWork):
    """Cluster a library's cases; say which could have been avoided, whose fault they were, and which to look at."""

    library: Annotated[Path | str, LIBRARY] = field(kw_only=False)
    steps: Annotated[int, meant("Seconds before the crash that the features cover.", low=1, high=15)] = 1
    out: Annotated[
        Path | str | None, meant("Folder for analysis.json, cases.parquet, points.parquet and witnesses.parquet.")
    ] = None
    avoidability: Annotated[str | int, LOOKS] = DEFAULT_LOOKS
    reaction: Annotated[float, REACTION] = 0.0
    purpose: Annotated[
        str | None,
        meant(
            "What comes first: what happens most on the road, for natural cases; or what is of most value.",
            name="--for", metavar="road|attack", choices=("attack", "road"),
            default="road for natural cases, else attack",
        ),
    ] = None  # fmt: skip


class Shrink(AvProcessOptions, Resumable, Watched):
    """Make cases as small as they get: fewest vehicles, shortest window, most natural actions, the same crash."""

    library: Annotated[Path | str, LIBRARY] = field(kw_only=False)
    cases: Annotated[Sequence[str] | str, CASES] = field(kw_only=False)
    out: Annotated[
        Path | str | None, meant("Library of the shrunk cases; by default LIB-shrunk-CASE, for one case.")
    ] = None


class Replay(AvProcessOptions, Watched):
    """Drive a case again from its seed."""

    library: Annotated[Path | str, LIBRARY] = field(kw_only=False)
    case: Annotated[str, meant('Case id such as 0:12, or "all".')] = field(kw_only=False)
    check: Annotated[bool, meant("Compare with what is stored; exit status 1 if it differs.")] = False
    picture: Annotated[Path | str | None, meant("Draw the crash and the latest way out into this .png or .svg.")] = None
    video: Annotated[Path | str | None, meant("Film the case from above, to scale, into this .mp4, .webm or .gif.")] = (
        None
    )


class Retest(AvAloneOptions, LongWork):
    """Drive another AV through stored cases, and compare; exit status 1 if it got worse."""

    library: Annotated[Path | str, meant("A library, a case file, or a folder of such.", metavar="LIB|CASES")] = field(
        kw_only=False
    )
    av: Annotated[
        str,
        meant(
            "AV under test, which must be named: a built-in one (`cornerforge avs` lists them), module:Class, "
            'file.py:Class, "cmd: ./program", or an .onnx or SB3 .zip file.',
            near=("av",),
        ),
    ] = field()
    baseline: Annotated[
        str | None, meant("AV to compare with; by default the one that made the library.", near=("av",))
    ] = None
    natural_tests: Annotated[
        int | None, meant("Natural tests of both, at most; 10,000 with a baseline, else none.")
    ] = None
    junit: Annotated[Path | str | None, meant("New file: JUnit XML.")] = None
    page: Annotated[Path | str | None, meant("New file, .html: both versions side by side in the same cases.")] = None
    count: Annotated[
        str,
        meant("Crashes that count in case files: any, or av: those in which the AV strikes.", choices=("any", "av")),
    ] = "any"


class Query(Options):
    """Ask a library, or an analysis, in SQL (table `cases`, key `case_id`)."""

    library: Annotated[Path | str, meant("A case library, or the folder of an analysis.", metavar="LIB")] = field(
        kw_only=False
    )
    sql: Annotated[str, meant("Such as: select crash_time_s from cases", metavar="SQL")] = field(kw_only=False)
    seconds: Annotated[float, meant("Longest time that the answer may take.")] = 10.0
    megabytes: Annotated[int, meant("Most memory that the answer may take.")] = 512


class Verify(Watched):
    """Check that files are as they were written; exit status 1 if one is not."""

    paths: Annotated[
        Sequence[Path | str] | Path | str, meant("Files, or folders, which are searched.", metavar="PATH...")
    ] = field(kw_only=False)


class Migrate(Watched):
    """Write a library, a run or a file of an earlier version anew, with the present columns and checksums."""

    library: Annotated[Path | str, meant("A library, the folder of a run, or a file.", metavar="OLD")] = field(
        kw_only=False
    )
    out: Annotated[Path | str, meant("A new folder, or a new file.")]


COMMANDS = (
    Command(
        Generate, "verbs.generate:generate", "verbs.sentences.cases:generate_text",
        (
            "cornerforge generate --policy out/demo/policy.safetensors --out out/cases",
            "cornerforge generate --policy swerve --av rl --cases 100 --out out/rl-cases",
        ),
        stages=True, spreads=True,
    ),
    Command(
        Analyse, "verbs.analyse:analyse", "verbs.sentences.analysis:analyse_text",
        ("cornerforge analyse out/demo/library --steps 2 --out out/sorted",), stages=True, spreads=True,
    ),
    Command(
        Shrink, "verbs.shrink:shrink", "verbs.sentences.cases:shrink_text",
        ("cornerforge shrink out/demo/library 0:0 --out out/small",),
    ),
    Command(
        Replay, "verbs.cases:replay", "verbs.sentences.cases:replay_text",
        (
            "cornerforge replay out/demo/library all --check",
            "cornerforge replay out/demo/library 0:0 --video out/crash.mp4",
        ),
        fails="verbs.sentences.cases:replay_differs",
    ),
    Command(
        Retest, "verbs.retest:retest", "verbs.sentences.retest:retest_text",
        (
            "cornerforge retest out/demo/library --av rss-cautious",
            "cornerforge retest out/cases --av my_av:New --baseline my_av:Old",
        ),
        fails="verbs.sentences.retest:got_worse",
    ),
    Command(
        Query, "verbs.cases:query", "verbs.sentences.cases:query_text",
        (
            'cornerforge query out/demo/library "select case_id, crash_time_s from cases"',
            'cornerforge query out/demo/analysis "select case_id from cases order by value"',
        ),
    ),
    Command(
        Verify, "verbs.verify:verify", "verbs.sentences.cases:verify_text",
        ("cornerforge verify out/demo", "cornerforge verify model.npz policy.safetensors"),
        fails="verbs.sentences.cases:is_damaged",
    ),
    Command(
        Migrate, "verbs.migrate:migrate", "verbs.sentences.cases:migrate_text",
        ("cornerforge migrate old/library --out out/library",),
    ),
)  # fmt: skip
