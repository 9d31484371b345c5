"""Cases: made, sorted, shrunk, driven again, asked for, compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import cornerforge
from cornerforge.cli.options import (
    Acting,
    Address,
    Config,
    Debug,
    Engine,
    Json,
    JsonFile,
    Library,
    Quiet,
    Resume,
    Seed,
    Threads,
    World,
    complete_av,
    completing,
    flag,
    takes_world,
)
from cornerforge.cli.output import (
    EXIT_GATE,
    fault_text,
    judgement_text,
    natural_text,
    rate_text,
    run_command,
    wrong_text,
)
from cornerforge.cli.program import command, suite
from cornerforge.world_options import AV_ASKED, AV_PROCESS, PLAIN_ADVERSARIES

if TYPE_CHECKING:
    from cornerforge.results import Analysed, Queried, Replayed, Verified

__all__ = [
    "analyse", "generate", "migrate", "plausibility", "query", "r157", "replay", "retest", "shrink", "suite_build",
    "variety", "verify",
]  # fmt: skip


@command(
    "cornerforge generate --policy out/demo/policy.safetensors --out out/cases",
    "cornerforge generate --policy swerve --av rl --cases 100 --out out/rl-cases",
)
@takes_world("av", "odd", "lanes", "model", "bounded", "budget", *AV_ASKED)
def generate(
    policy: Annotated[
        list[str],
        typer.Option(
            help=f"Policy file, or {', '.join(PLAIN_ADVERSARIES)}. Given again: each test draws one of the policies.",
            show_default=False,
            autocompletion=completing(*PLAIN_ADVERSARIES),
        ),
    ],
    out: Annotated[Path, typer.Option(help="Library to fill.", show_default=False)],
    cases: Annotated[int, typer.Option(help="How many cases.")] = 1_000,
    world: World = None,
    resume: Resume = False,
    acting: Acting = "greedy",
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    engine: Engine = "threads",
    address: Address = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Fill a case library with crashes that an adversary makes."""
    run_command(
        lambda bars: cornerforge.generate(
            policy=policy, cases=cases, out=out, resume=resume, acting=acting, seed=seed, threads=threads,
            progress=bars, **world,
        ),
        lambda r: "\n".join([rate_text(r, f"{r.cases:,} cases in {r.library}"), *fault_text(r.av_faults)]),
        as_json=as_json, quiet=quiet, stages=True, at=(engine, address, threads),
    )  # fmt: skip


@command("cornerforge analyse out/demo/library --steps 2 --out out/sorted")
def analyse(
    library: Library,
    steps: Annotated[int, typer.Option(help="Seconds before the crash that the features cover, 1 to 15.")] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for analysis.json, cases.parquet, points.parquet and witnesses.parquet.", show_default=False
        ),
    ] = None,
    avoidability: Annotated[
        str, typer.Option(help="For how many cases, drawn at random, a way out is searched for; all or none.")
    ] = "2000",
    reaction: Annotated[float, typer.Option(help="Seconds that the AV needs to react, 0 to 5.")] = 0.0,
    purpose: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="road|attack",
            help="What comes first: what happens most on the road, for natural cases; or what is of most value.",
            show_default="road for natural cases, else attack",
            autocompletion=completing("road", "attack"),
        ),
    ] = None,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    engine: Engine = "threads",
    address: Address = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Cluster a library's cases; say which could have been avoided, whose fault they were, and which to look at."""

    def text(r: Analysed) -> str:
        share = 100.0 * sum(r.explained_variance)
        lines = [
            *wrong_text(None, r),
            f"{r.cases:,} cases, {len(r.features)} features, {share:.0f} % of variance in two components; "
            f"majority {r.majority:,}, minority {r.minority:,}",
            "Crash types: " + ", ".join(f"{name} {n:,}" for name, n in r.crash_types.items()),
        ]
        lines += natural_text(r)
        lines += [f"Cluster {c.id} ({c.group}, {c.size:,} cases): typical {', '.join(c.typical)}" for c in r.clusters]
        lines.append("Rare: " + (", ".join(r.rare) or "none"))
        lines += judgement_text(r)
        return "\n".join(lines if r.note is None else [*lines, r.note])

    run_command(
        lambda bars: cornerforge.analyse(
            library, steps=steps, out=out, avoidability=avoidability, reaction=reaction, purpose=purpose, seed=seed,
            threads=threads, progress=bars,
        ),
        text, as_json=as_json, quiet=quiet, stages=True, at=(engine, address, threads),
    )  # fmt: skip


@command("cornerforge shrink out/demo/library 0:0 --out out/small")
@takes_world(*AV_PROCESS)
def shrink(
    library: Library,
    cases: Annotated[list[str], typer.Argument(metavar="CASE...", help='Case ids, or "all".', show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(help="Library of the shrunk cases; by default LIB-shrunk-CASE, for one case.", show_default=False),
    ] = None,
    resume: Resume = False,
    world: World = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Make cases as small as they get: fewest vehicles, shortest window, most natural actions, the same crash."""
    from cornerforge.verbs.shrink import shrink_text

    run_command(
        lambda bars: cornerforge.shrink(library, cases, out=out, resume=resume, progress=bars, **world),
        shrink_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@command(
    "cornerforge replay out/demo/library all --check",
    "cornerforge replay out/demo/library 0:0 --video out/crash.mp4",
)
@takes_world(*AV_PROCESS)
def replay(
    library: Library,
    case: Annotated[str, typer.Argument(help='Case id such as 0:12, or "all".', show_default=False)],
    check: Annotated[bool, flag("--check", "Compare with what is stored; exit status 1 if it differs.")] = False,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw the crash and the latest way out into this .png or .svg.", show_default=False),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(help="Film the case from above, to scale, into this .mp4, .webm or .gif.", show_default=False),
    ] = None,
    world: World = None,
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Drive a case again from its seed."""

    def text(r: Replayed) -> str:
        verdict = {None: "driven again", True: "identical", False: "NOT identical"}[r.identical]
        if r.cases is not None:
            differ = f"; different: {', '.join(r.differ[:10])}" if r.differ else ""
            return f"{r.cases:,} cases: {verdict}{differ}"
        files = {"picture": r.picture, "film": r.video}
        drawn = "".join(f"; {what}: {file}" for what, file in files.items() if file is not None)
        return f"Case {r.case}: {verdict}; crash at {r.crash_time_s} s{drawn}"

    result = run_command(
        lambda bars: cornerforge.replay(
            library, case, check=check, picture=picture, video=video, progress=bars, **world
        ),
        text, as_json=as_json, quiet=quiet, out=out,
    )  # fmt: skip
    if result.identical is False:
        if result.note is not None:
            typer.echo(result.note, err=True)
        raise typer.Exit(EXIT_GATE)


@command(
    "cornerforge retest out/demo/library --av rss-cautious",
    "cornerforge retest out/cases --av my_av:New --baseline my_av:Old",
)
@takes_world("av", *AV_ASKED)
def retest(
    library: Annotated[
        Path,
        typer.Argument(metavar="LIB|CASES", help="A library, a case file, or a folder of such.", show_default=False),
    ],
    world: World = None,
    baseline: Annotated[
        str | None,
        typer.Option(
            help="AV to compare with; by default the one that made the library.",
            show_default=False,
            autocompletion=complete_av,
        ),
    ] = None,
    natural_tests: Annotated[
        int | None,
        typer.Option(help="Natural tests of both, at most; 10,000 with a baseline, else none.", show_default=False),
    ] = None,
    junit: Annotated[Path | None, typer.Option(help="New file: JUnit XML.", show_default=False)] = None,
    page: Annotated[
        Path | None,
        typer.Option(help="New file, .html: both versions side by side in the same cases.", show_default=False),
    ] = None,
    count: Annotated[
        str,
        typer.Option(
            help="Crashes that count in case files: any, or av: those in which the AV strikes.",
            autocompletion=completing("any", "av"),
        ),
    ] = "any",
    seed: Seed = 0,
    threads: Threads = None,
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Drive another AV through stored cases, and compare; exit status 1 if it got worse."""
    from cornerforge.verbs.retest import retest_text

    result = run_command(
        lambda bars: cornerforge.retest(
            library, baseline=baseline, natural_tests=natural_tests, junit=junit, page=page,
            count=count, seed=seed, threads=threads, progress=bars, **world,
        ),
        retest_text, as_json=as_json, quiet=quiet, out=out,
    )  # fmt: skip
    if result.got_worse:
        raise typer.Exit(EXIT_GATE)


@command("cornerforge suite build out/demo/library --size 20 --out out/suite", name="build", of=suite)
@takes_world(*AV_ASKED)
def suite_build(
    libraries: Annotated[
        list[Path], typer.Argument(metavar="LIB...", help="Case libraries of one model and ODD.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Folder of the suite, a library itself.", show_default=False)],
    size: Annotated[int, typer.Option(help="Most cases.")] = 200,
    zoo: Annotated[
        list[str] | None,
        typer.Option(
            help="AV that drives the cases; may be given again. By default all built-in ones.",
            show_default=False,
            autocompletion=complete_av,
        ),
    ] = None,
    world: World = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Choose the fewest cases that find and rank the flaws of many AVs; checked on AVs left out."""
    from cornerforge.ext.studies.suite import suite_text

    run_command(
        lambda bars: cornerforge.suite_build(
            libraries, out=out, size=size, zoo=zoo, seed=seed, threads=threads, progress=bars, **world
        ),
        suite_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@command("cornerforge r157 --av idm-mobil --out out/r157", "cornerforge r157 --av my_av:MyAv --family cut-in")
@takes_world("av", "odd", "lanes", *AV_ASKED)
def r157(
    world: World = None,
    family: Annotated[
        list[str] | None,
        typer.Option(
            help="cut-in, cut-out or deceleration; may be given again. All by default.",
            show_default=False,
            autocompletion=completing("cut-in", "cut-out", "deceleration", "all"),
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the page, scenarios.csv and the library of failures.", show_default=False),
    ] = None,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Drive an AV through the scenarios of UN Regulation 157, beside the reference drivers."""
    from cornerforge.ext.studies.r157 import r157_text

    given = family or ["all"]
    run_command(
        lambda bars: cornerforge.r157(
            families="all" if given == ["all"] else given, out=out, seed=seed, threads=threads, progress=bars, **world
        ),
        r157_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@command(
    'cornerforge query out/demo/library "select case_id, crash_time_s from cases"',
    'cornerforge query out/demo/analysis "select case_id from cases order by value"',
)
def query(
    library: Annotated[Path, typer.Argument(metavar="LIB", help="A case library, or the folder of an analysis.")],
    sql: Annotated[
        str, typer.Argument(metavar="SQL", help="Such as: select crash_time_s from cases", show_default=False)
    ],
    seconds: Annotated[float, typer.Option(help="Longest time that the answer may take.")] = 10.0,
    megabytes: Annotated[int, typer.Option(help="Most memory that the answer may take.")] = 512,
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Ask a library, or an analysis, in SQL (table `cases`, key `case_id`)."""

    def text(r: Queried) -> str:
        return "\n".join("\t".join(map(str, row)) for row in [r.columns, *r.rows])

    run_command(
        lambda bars: cornerforge.query(library, sql, seconds=seconds, megabytes=megabytes),  # noqa: ARG005
        text, as_json=as_json, quiet=quiet, out=out,
    )  # fmt: skip


@command("cornerforge verify out/demo", "cornerforge verify model.npz policy.safetensors")
def verify(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Files, or folders, which are searched.", show_default=False)
    ],
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Check that files are as they were written; exit status 1 if one is not."""

    def text(r: Verified) -> str:
        lines = [one.fault if one.file in one.fault else f"{one.file}: {one.fault}" for one in r.damaged]
        lines.append(f"{r.whole:,} whole, {len(r.damaged):,} damaged")
        if r.without_checksum:
            lines[-1] += f", {len(r.without_checksum):,} without a checksum (such as {r.without_checksum[0]})"
        return "\n".join([*lines[:-1], f"{lines[-1]}; {r.other:,} of other kinds, not read"])

    result = run_command(
        lambda bars: cornerforge.verify(paths, progress=bars), text, as_json=as_json, quiet=quiet, out=out
    )
    if result.damaged:
        raise typer.Exit(EXIT_GATE)


@command("cornerforge migrate old/library --out out/library")
def migrate(
    library: Annotated[
        Path, typer.Argument(metavar="OLD", help="A library, the folder of a run, or a file.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="A new folder, or a new file.", show_default=False)],
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Write a library, a run or a file of an earlier version anew, with the present columns and checksums."""
    run_command(
        lambda bars: cornerforge.migrate(library, out=out, progress=bars),
        lambda r: f"{r.cases:,} cases of version {r.made_by}: {r.library}",
        as_json=as_json, quiet=quiet,
    )  # fmt: skip


@command(
    "cornerforge variety out/demo/library", "cornerforge variety --policy out/demo/policy.safetensors --tests 1024"
)
@takes_world("av", "odd", "lanes", "model", "budget", *AV_ASKED)
def variety(
    libraries: Annotated[
        list[Path] | None, typer.Argument(metavar="LIB...", help="Case libraries.", show_default=False)
    ] = None,
    policy: Annotated[
        list[Path] | None,
        typer.Option(help="Policy file instead of libraries; may be given again.", show_default=False),
    ] = None,
    tests: Annotated[int, typer.Option(help="Tests for each way to generate.")] = 4096,
    acting: Annotated[str, typer.Option(help="How to act at random: softmax or softmax:T.")] = "softmax",
    world: World = None,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Count kinds of crash: in libraries, or as policies make them greedily, at random and mixed."""
    from cornerforge.ext.studies.variety import variety_text

    run_command(
        lambda bars: cornerforge.variety(
            libraries=libraries or (), policies=policy or (), tests=tests, acting=acting, seed=seed, threads=threads,
            progress=bars, **world,
        ),
        variety_text, as_json=as_json, quiet=quiet, out=out,
    )  # fmt: skip


@command("cornerforge plausibility --budget 20 --budget 60 --out out/plausible")
@takes_world("av", "odd", "lanes", "model", *AV_ASKED)
def plausibility(
    out: Annotated[Path, typer.Option(help="Folder for policies, curve and figure.", show_default=False)],
    budget: Annotated[
        list[float] | None,
        typer.Option(help="Likelihood budget in nats; may be given again. 10, 20, 40, 60, 80.", show_default=False),
    ] = None,
    seeds: Annotated[int, typer.Option(help="Training seeds per budget.")] = 3,
    decisions: Annotated[
        int | None, typer.Option(help="Length of a training; the fast preset's by default.", show_default=False)
    ] = None,
    tests: Annotated[int, typer.Option(help="Evaluation tests of each policy.")] = 8192,
    world: World = None,
    resume: Resume = False,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    engine: Engine = "threads",
    address: Address = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Plot what an adversary reaches against how plausible it must stay: one training per budget and seed."""
    from cornerforge.ext.studies.plausibility import BUDGETS_NATS, plausibility_text

    run_command(
        lambda bars: cornerforge.plausibility(
            out=out, budgets=budget or BUDGETS_NATS, seeds=seeds, decisions=decisions, tests=tests, resume=resume,
            seed=seed, threads=threads, progress=bars, **world,
        ),
        plausibility_text, as_json=as_json, quiet=quiet, at=(engine, address, threads),
    )  # fmt: skip
