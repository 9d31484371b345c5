"""The whole job: `init`, `run`, and what makes it seen: `report`, `serve`, `figure`, `reproduce`."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import cornerforge
from cornerforge._locks import claims
from cornerforge.cli.options import (
    Config,
    Debug,
    Json,
    JsonFile,
    Quiet,
    Resume,
    Reward,
    Seed,
    Threads,
    World,
    complete_av,
    completing,
    flag,
    takes_world,
)
from cornerforge.cli.output import paid_text, rate_text, run_command, training_fault_text, wrong_text
from cornerforge.cli.program import command
from cornerforge.world_options import AV_ASKED

if TYPE_CHECKING:
    from cornerforge.results import Figured, RunDone, Served

__all__ = ["figure", "init", "report", "reproduce", "run", "serve"]

_ITEMS = ("table1", "figure2", "figure3", *(f"figure{number}" for number in range(5, 12)), "matrix", "timings")


@command("cornerforge init my-av")
def init(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="The folder; new, or without these files.", show_default=False)
    ],
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Write a folder to start from: an AV class, a config for `run --config`, and a README."""
    enter = "" if folder == Path() else f"cd {shlex.quote(str(folder))} && "
    run_command(
        lambda bars: cornerforge.init(folder),  # noqa: ARG005
        lambda r: f"Wrote {', '.join(r.files)}. Go on: {enter}cornerforge run --config cornerforge.toml",
        as_json=as_json, quiet=quiet, out=out,
    )  # fmt: skip


@command("cornerforge run --effort quick --out out/demo", "cornerforge run --config cornerforge.toml --seed 1")
@takes_world("av", "odd", "lanes", "model", "bounded", "budget", *AV_ASKED)
def run(
    effort: Annotated[
        str | None,
        typer.Option(
            help="quick (4 minutes on 2 cores), standard (15) or paper.",
            show_default="quick",
            autocompletion=completing("quick", "standard", "paper"),
        ),
    ] = None,
    hours: Annotated[
        float | None,
        typer.Option(
            help="Time for all of it instead of an effort: does what fits, so results depend on speed. For slow AVs.",
            show_default=False,
        ),
    ] = None,
    stand_in: Annotated[
        str, typer.Option(help="Built-in AV to train against when the hours are too few to train against --av.")
    ] = "idm-mobil",
    out: Annotated[Path, typer.Option(help="Folder for everything.")] = Path("cornerforge-out"),
    world: World = None,
    reward: Reward = "crash",
    resume: Resume = False,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Do the whole job: natural traffic, natural crash rate, training, cases, analyses, report."""
    from cornerforge.verbs.rate_text import doubt_text, miles_text

    def text(r: RunDone) -> str:
        doubt = doubt_text(r.natural, f"cornerforge rate --out {r.out}/natural --resume, in the same world, ")
        return "\n".join(
            [
                *wrong_text(r.natural_cases, r.analyse),
                rate_text(r.natural, "Natural traffic"),
                *miles_text(r.natural),
                *([] if doubt is None else [doubt]),
                rate_text(r.train, "Adversary") + paid_text(r.train, r.reward),
                *training_fault_text(r.train.av_faults),
                f"{r.generate.cases:,} cases in {r.generate.library}; "
                + (
                    ""
                    if r.analyse is None
                    else f"{len(r.analyse.clusters)} clusters, {len(r.analyse.rare)} rare cases; "
                )
                + f"{r.seconds:.0f} s",
                *(() if r.spending is None else (f"Not found: {text}" for text in r.spending.not_found)),
                f"Report: {r.report}",
            ]
        )

    run_command(
        lambda bars: cornerforge.run(
            effort=effort, hours=hours, stand_in=stand_in, out=out, reward=reward,
            resume=resume, seed=seed, threads=threads, progress=bars, **world,
        ),
        text, as_json=as_json, quiet=quiet, stages=True,
    )  # fmt: skip


@command("cornerforge report out/demo/library --out out/page")
def report(
    place: Annotated[
        Path, typer.Argument(metavar="LIB|RUN", help="A library, or a folder of run or rate.", show_default=False)
    ],
    out: Annotated[
        Path, typer.Option(help="Of a library: folder for report.html and analysis/. The page of a run stays there.")
    ] = Path("cornerforge-report"),
    avoidability: Annotated[
        str, typer.Option(help="For how many cases, drawn at random, a way out is searched for; all or none.")
    ] = "2000",
    reaction: Annotated[float, typer.Option(help="Seconds that the AV needs to react, 0 to 5.")] = 0.0,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Make the page of a run, of a natural rate or of any library, whichever AV made it."""
    run_command(
        lambda bars: cornerforge.make_report(
            place, out=out, avoidability=avoidability, reaction=reaction, seed=seed, threads=threads, progress=bars
        ),
        lambda r: f"Report: {r.report}", as_json=as_json, quiet=quiet, stages=True,
    )  # fmt: skip


@command("cornerforge serve out/demo", "cornerforge serve out/demo/library --with rss-cautious --open")
def serve(
    place: Annotated[
        Path, typer.Argument(metavar="LIB|RUN", help="A library, or a folder of run or rate.", show_default=False)
    ],
    port: Annotated[
        int | None,
        typer.Option(help="Port; 0 for any free one.", show_default="8157, or the next free one"),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Where it listens. Others than this machine need the token in the printed address.")
    ] = "127.0.0.1",
    more_av: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            help="AV to compare with, besides the built-in ones; may be given again.",
            show_default=False,
            autocompletion=complete_av,
        ),
    ] = None,
    open_browser: Annotated[bool, flag("--open", "Open it in the browser.")] = False,
    threads: Threads = None,
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Show all cases in the browser: a map of them, each to watch and to compare; Ctrl-C ends it."""
    from cornerforge.experiment.output import check_new_file, write_json
    from cornerforge.results import as_json as result_as_json

    def up(r: Served) -> None:
        from cornerforge.ext.explorer.server import PORT

        if out is not None:
            write_json(out, result_as_json(r), checksum=False)
        if not r.usual_port and not quiet:
            typer.echo(f"Port {PORT} is taken by another program, so it is port {r.port}.", err=True)
        if r.token:
            typer.echo(
                f"Warning: {r.host} can be reached by other machines. Whoever has the address below sees the "
                "cases; the connection is not encrypted.",
                err=True,
            )
        if as_json:
            typer.echo(json.dumps(result_as_json(r)))
        else:
            typer.echo(f"{r.cases:,} cases: {r.url} (Ctrl-C ends it)")
        sys.stdout.flush()

    with claims():
        if out is not None:
            check_new_file(out)
        run_command(
            lambda bars: cornerforge.serve(  # noqa: ARG005
                place, host=host, port=port, avs=more_av or (), open_browser=open_browser, threads=threads, up=up
            ),
            lambda r: "",  # noqa: ARG005
            as_json=False, quiet=True,
        )  # fmt: skip


@command(
    "cornerforge figure out/demo --out out/figures --format svg",
    "cornerforge figure out/demo/library 0:0 --times -3,-2,-1,0 --out out/crash.pdf",
)
def figure(
    place: Annotated[
        Path, typer.Argument(metavar="LIB|RUN", help="A library, or a folder of run or rate.", show_default=False)
    ],
    case: Annotated[
        str | None,
        typer.Argument(
            help="Draw this case as a strip of snapshots, instead of the charts of the page; natural/ID for a natural "
            "case of a run.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the charts; new file .pdf or .svg for a case.", show_default=False),
    ] = None,
    listing: Annotated[bool, flag("--list", "Only tell which charts there may be.")] = False,
    times: Annotated[
        str | None,
        typer.Option(
            help="Seconds of the snapshots, such as -3,-2,-1,0; 0 is the contact. By default what matters in the case.",
            show_default=False,
        ),
    ] = None,
    figure: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Chart; may be given again. All by default.", show_default=False),
    ] = None,
    file_format: Annotated[
        str, typer.Option("--format", help="Of charts: pdf or svg.", autocompletion=completing("pdf", "svg"))
    ] = "pdf",
    width: Annotated[
        str,
        typer.Option(help="column (3.5 in) or page (7.16 in).", autocompletion=completing("column", "page")),
    ] = "column",
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Draw for a paper: the charts of the page, or a case as a strip of snapshots."""
    from cornerforge.errors import InputError

    if out is None and not listing:
        raise InputError("Where to? Name a place by --out; --list tells which charts there may be.")

    def text(r: Figured) -> str:
        return "\n".join(f"{one.name if one.file is None else one.file}: {one.caption}" for one in r.figures)

    run_command(
        lambda bars: cornerforge.figure(
            place, None if listing else case, out=None if listing else out, times=_seconds(times), figures=figure,
            file_format=file_format, width=width, seed=seed, threads=threads, progress=bars,
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


def _seconds(given: str | None) -> list[float] | None:
    """Read times such as "-3,-2,-1,0".

    Raises:
        InputError: They are no numbers.
    """
    from cornerforge.errors import InputError

    if given is None:
        return None
    try:
        return [float(one) for one in given.split(",")]
    except ValueError:
        raise InputError(f'--times "{given}" are no numbers with commas between them, such as -3,-2,-1,0.') from None


@command("cornerforge reproduce --effort quick --figure table1 --out out/paper")
@takes_world("odd", "lanes", "model")
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the page, figures, numbers and policies.", show_default=False)],
    figure: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID...",
            help="table1, figure2, figure3, figure5 to figure11, matrix, timings; all by default.",
            show_default=False,
            autocompletion=completing(*_ITEMS),
        ),
    ] = None,
    # An option takes one value: what follows `--figure A` in `--figure A B C` arrives here.
    more: Annotated[list[str] | None, typer.Argument(metavar="ID", hidden=True)] = None,
    effort: Annotated[
        str | None,
        typer.Option(
            help="quick (ten minutes on 2 cores), standard (an hour or more) or full (hours).",
            show_default="standard",
            autocompletion=completing("quick", "standard", "full"),
        ),
    ] = None,
    paper_policy: Annotated[
        Path | None, typer.Option(help="A policy of preset paper, for Figure 2.", show_default=False)
    ] = None,
    more_av: Annotated[
        list[str] | None,
        typer.Option(help="AV for the matrix besides the built-in ones; give it again for more.", show_default=False),
    ] = None,
    resume: Resume = False,
    world: World = None,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Make the paper's figures and tables again, ours beside theirs, on one page."""
    from cornerforge.ext.paper.reproduce import reproduction_text

    figures = [*(figure or []), *(more or [])] or None
    run_command(
        lambda bars: cornerforge.reproduce(
            out=out, figures=figures, effort=effort, paper_policy=paper_policy, avs=more_av or (),
            resume=resume,
            seed=seed, threads=threads, progress=bars, **world,
        ),
        reproduction_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
