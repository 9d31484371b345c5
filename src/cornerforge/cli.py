"""The command line: parse arguments, call `pipeline`, print. Nothing is computed here, nothing heavy imported early."""

from __future__ import annotations

import json
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cornerforge.errors import CornerForgeError

if TYPE_CHECKING:
    from rich.progress import Progress as Bars
    from rich.progress import TaskID

__all__ = ["app", "main"]

EXIT_GATE, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 1, 2, 130

Seed = Annotated[int, typer.Option(help="Names the random numbers; same seed, same results.")]
Threads = Annotated[
    int | None, typer.Option(help="Threads; all cores by default. Does not change results.", show_default=False)
]
# Every command takes --seed and --threads, so that scripts need not know which ones draw or compute.
IdleSeed = Annotated[int, typer.Option("--seed", help="No effect here: nothing is drawn.")]
IdleThreads = Annotated[
    int | None, typer.Option("--threads", help="No effect here: one thread does it.", show_default=False)
]
Quiet = Annotated[bool, typer.Option("--quiet", help="No text and no progress bars.")]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
Av = Annotated[
    str,
    typer.Option(
        help="AV under test: a name (`cornerforge avs` lists them), module:Class, or an .onnx or SB3 .zip file."
    ),
]
AvTimeout = Annotated[float, typer.Option(help="Seconds that an AV which is not built in may take for an answer.")]
AV_TIMEOUT = 5.0
Lanes = Annotated[int | None, typer.Option(help="Lanes, 2 to 6; 3 by default.", show_default=False)]
OddName = Annotated[str, typer.Option("--odd", help="default (4 s lane change), swift (2.5 s) or paper (1 s).")]
Model = Annotated[Path | None, typer.Option(help="Naturalistic model; the shipped one by default.", show_default=False)]
Bounded = Annotated[bool, typer.Option("--bounded", help="Only actions that the naturalistic model calls possible.")]
Budget = Annotated[
    float | None,
    typer.Option(
        help="Likelihood budget of a test [nats], such as 5: how far the actions may fall short of the likeliest ones. "
        "Implies --bounded.",
        show_default=False,
    ),
]
Acting = Annotated[str, typer.Option(help="How a policy acts: greedy, or softmax:T to draw by exp(Q / T).")]
DataFormat = Annotated[
    str | None,
    typer.Option(
        "--format", help="ngsim, pairs, tracks, tgsim or highd; told from the columns by default.", show_default=False
    ),
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with what is there.")]
Library = Annotated[Path, typer.Argument(metavar="LIB", help="A case library.", show_default=False)]

app = typer.Typer(
    name="cornerforge",
    help="How an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
ndd = typer.Typer(no_args_is_help=True, help="The naturalistic driving model.")
app.add_typer(ndd, name="ndd")


class _Bars:
    """Progress bars on standard error, one per stage, with rate and time left; silent when that is no terminal."""

    def __init__(self, quiet: bool) -> None:
        self.show = not quiet and sys.stderr.isatty()
        self._bars: Bars | None = None
        self._stage = ""
        self._task: TaskID | None = None

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Draw; a new stage gets a new bar."""
        if not self.show:
            return
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        if self._bars is None:
            columns = (
                TextColumn("{task.description:>16}"),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[rate]}"),
            )
            self._bars = Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=Console(stderr=True))
            self._bars.start()
        name = stage.partition(" (")[0]  # what stands in brackets may change while a stage lasts
        if name != self._stage or self._task is None:
            self._stage = name
            # Work done by an earlier session is no speed of this one.
            self._task = self._bars.add_task(stage, total=total, completed=int(done), rate="")
        speed = self._bars.tasks[self._task].speed
        text = f"{speed:,.0f}/s" if speed else ""
        self._bars.update(self._task, description=stage, completed=done, total=total, rate=text)

    def stop(self) -> None:
        """Leave the bars as they are."""
        if self._bars is not None:
            self._bars.stop()


def _run(
    work: Callable[[_Bars], dict[str, Any]], text: Callable[[dict[str, Any]], str], *, as_json: bool, quiet: bool
) -> dict[str, Any]:
    """Do the work with progress bars, then print its object or the text made of it."""
    bars = _Bars(quiet)
    if bars.show:
        from cornerforge._jit import announce_compiling

        announce_compiling(
            lambda: typer.echo("Compiling the simulator, once per installation; about a minute.", err=True)
        )
    try:
        result = work(bars)
    finally:
        bars.stop()
    if as_json:
        typer.echo(json.dumps(result, allow_nan=False))
    elif not quiet:
        typer.echo(text(result))
    return result


def _rate_text(r: dict[str, Any], what: str) -> str:
    low, high = r["interval95"]
    interval = f"95 % interval {low:.3g} to {high:.3g}, {r['tests']:,} tests"
    line = f"{what}: {r['crashes_per_test']:.4g} crashes per test ({interval}"
    if r.get("crashes_per_mile") is not None:
        line += f"), {r['crashes_per_mile']:.4g} per mile ({r['miles']:,.0f} miles"
    return line + ")"


def _yield_text(r: dict[str, Any], what: str) -> str:
    low, high = r["avoidable_interval95"]
    line = f"{_rate_text(r, what)}, {r['avoidable_per_test']:.4g} avoidable by braking ({low:.3g} to {high:.3g})"
    share = r["striking_share"]
    return line if share is None else f"{line}; the AV strikes in {100.0 * share:.1f} %"


def _judgement_text(r: dict[str, Any]) -> list[str]:
    """Fault, avoidability, coverage and the most valuable cases of an analysis."""
    lines = ["At fault (RSS): " + ", ".join(f"{who} {n:,}" for who, n in r["fault"].items())]
    if r["avoidability"] is not None:
        seen = r["avoidability"]
        low, high = seen["interval95"]
        labels = ", ".join(f"{label} {n:,}" for label, n in seen["labels"].items() if n)
        lines.append(
            f"Avoidable: {100.0 * seen['avoidable_share']:.1f} % (95 % interval {100.0 * low:.1f} to "
            f"{100.0 * high:.1f} %, {seen['cases']:,} cases): {labels}"
        )
    cover = r["coverage"]
    low, high = cover["unseen_kind_interval95"]
    lines.append(
        f"Kinds: {len(cover['cells'])} seen, {len(cover['empty'])} cells empty; chance that the next case is of a new "
        f"kind {cover['unseen_kind_chance']:.2g} (95 % interval {low:.2g} to {high:.2g})"
    )
    if r["value"]["top"]:
        lines.append("Worth a look first (value: case: what happened):")
        lines += [f"  {one['value']:.2f}: {one['case_id']}: {one['text']}" for one in r["value"]["top"]]
    return lines


def _fault_text(r: dict[str, Any]) -> list[str]:
    """A line on tests that the AV spoiled, if it did."""
    n = r.get("av_faults", 0)
    if n == 0:
        return []
    return [f"{n:,} tests left out, because the AV raised, hung or gave no usable answer in them."]


@app.command()
def run(
    budget: Annotated[str, typer.Option(help="quick (3 minutes on 2 cores), standard (15) or paper.")] = "quick",
    out: Annotated[Path, typer.Option(help="Folder for everything.")] = Path("cornerforge-out"),
    av: Av = "idm-mobil",
    bounded: Bounded = False,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    resume: Resume = False,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Do the whole job: natural baseline, training, cases, analysis, report."""
    from cornerforge import pipeline

    def text(r: dict[str, Any]) -> str:
        return "\n".join(
            [
                _rate_text(r["nde"], "Natural traffic"),
                _rate_text(r["train"], "Adversary"),
                f"{r['generate']['cases']:,} cases in {r['generate']['library']}; "
                f"{len(r['analyse']['clusters'])} clusters, {len(r['analyse']['rare'])} rare cases; "
                f"{r['seconds']:.0f} s",
                f"Report: {r['report']}",
            ]
        )

    _run(
        lambda bars: pipeline.run(
            budget=budget, out=out, av=av, bounded=bounded, lanes=lanes, odd=odd, model=model, resume=resume,
            seed=seed, threads=threads, progress=bars,
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def simulate(
    tests: Annotated[int, typer.Option(help="Tests to drive (400 m each).")] = 10_000,
    av: Av = "idm-mobil",
    bv: Annotated[
        list[str] | None,
        typer.Option(
            help="Background vehicles: nde (default), idm, uniform, lane-changer, swerve, or a policy file; several "
            "policies: each test draws one.",
            show_default=False,
        ),
    ] = None,
    policy: Annotated[
        list[Path] | None, typer.Option(help="The same as --bv FILE; may be given again.", show_default=False)
    ] = None,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    bounded: Bounded = False,
    budget: Budget = None,
    acting: Acting = "greedy",
    stats: Annotated[bool, typer.Option("--stats", help="Add distributions over all background vehicles.")] = False,
    out: Annotated[Path | None, typer.Option(help="Store the crashes in this library.", show_default=False)] = None,
    resume: Resume = False,
    seed: Seed = 0,
    threads: Threads = None,
    av_timeout: AvTimeout = AV_TIMEOUT,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Drive tests and count crashes; they are stored only with --out."""
    from cornerforge import pipeline

    drivers = [*(bv or []), *map(str, policy or [])] or ["nde"]

    def text(r: dict[str, Any]) -> str:
        lines = [
            _rate_text(r, f"{av}, {' + '.join(drivers)}"),
            f"{r['av_crashes']:,} AV crashes, {r['bv_crashes']:,} crashes between BVs; "
            f"{r['tests_per_second']:,.0f} tests/s, {r['world_steps_per_second']:,.0f} world-steps/s; "
            f"digest {r['digest'][:16]}",
            *_fault_text(r),
        ]
        for name, d in r.get("distributions", {}).items():
            if isinstance(d, dict) and d.get("n"):
                q = "  ".join(f"{v:g}" for v in d["quantiles"].values())
                lines.append(
                    f"{name:>14} [{d['unit']}]: mean {d['mean']:.3f}, sd {d['sd']:.3f}; 1 5 25 50 75 95 99 %: {q}"
                )
            else:
                lines.append(f"{name:>14}: {d}")
        return "\n".join(lines)

    _run(
        lambda bars: pipeline.simulate(
            tests=tests, av=av, bv=drivers, lanes=lanes, odd=odd, model=model, bounded=bounded, budget=budget,
            acting=acting, stats=stats, out=out, resume=resume, seed=seed, threads=threads, av_timeout=av_timeout,
            progress=bars,
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def train(
    out: Annotated[Path, typer.Option(help="Policy file to write, .safetensors.", show_default=False)],
    av: Av = "idm-mobil",
    preset: Annotated[str, typer.Option(help="fast or paper.")] = "fast",
    bounded: Bounded = False,
    reward: Annotated[
        str, typer.Option(help="Crashes that are paid for: crash (all), striking or avoidable.")
    ] = "crash",
    delay: Annotated[float, typer.Option(help="Seconds that the AV has to react, in avoidable.")] = 1.0,
    budget: Budget = None,
    decisions: Annotated[int | None, typer.Option(help="Length in decisions.", show_default=False)] = None,
    minutes: Annotated[
        float | None, typer.Option(help="Stop after this time; the result then depends on speed.", show_default=False)
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Keep a finished policy of the same command.")] = False,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    tests: Annotated[int, typer.Option(help="Evaluation tests for each yield.")] = 8192,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Train the adversary on an AV."""
    from cornerforge import pipeline

    def text(r: dict[str, Any]) -> str:
        lines = [_yield_text(r, "Adversary")] + [_yield_text(b, f"{b['name']:>21}") for b in r["baselines"]]
        return "\n".join([*lines, f"{r['decisions']:,} decisions in {r['seconds']:.0f} s; policy: {r['out']}"])

    _run(
        lambda bars: pipeline.train(
            out=out, av=av, preset=preset, bounded=bounded, budget=budget, reward=reward, delay=delay,
            decisions=decisions, minutes=minutes, resume=resume, lanes=lanes, odd=odd, model=model, tests=tests,
            seed=seed, threads=threads, progress=bars,
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command("train-av")
def train_av(
    out: Annotated[Path, typer.Option(help="AV file to write, .safetensors; --av takes it.", show_default=False)],
    decisions: Annotated[int | None, typer.Option(help="Seconds of driving to learn from.", show_default=False)] = None,
    minutes: Annotated[
        float | None, typer.Option(help="Stop after this time; the result then depends on speed.", show_default=False)
    ] = None,
    tests: Annotated[int, typer.Option(help="Tests in natural traffic to measure it on.")] = 20_000,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    resume: Resume = False,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Train an AV to drive in natural and hostile traffic."""
    from cornerforge import pipeline

    def text(r: dict[str, Any]) -> str:
        return "\n".join(
            [
                _rate_text(r, "Natural traffic"),
                f"Mean speed {r['mean_speed']:.1f} m/s",
                f"{r['decisions']:,} s of driving in {r['seconds']:.0f} s; AV: {r['out']}",
            ]
        )

    _run(
        lambda bars: pipeline.train_av(
            out=out, decisions=decisions, minutes=minutes, tests=tests, overwrite=overwrite, resume=resume,
            lanes=lanes, odd=odd, model=model, seed=seed, threads=threads, progress=bars,
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def generate(
    policy: Annotated[
        list[str],
        typer.Option(
            help="Policy file, or uniform, lane-changer, swerve. Given again: each test draws one of the policies.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Library to fill.", show_default=False)],
    cases: Annotated[int, typer.Option(help="How many cases.")] = 1_000,
    av: Av = "idm-mobil",
    resume: Resume = False,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    bounded: Bounded = False,
    budget: Budget = None,
    acting: Acting = "greedy",
    seed: Seed = 0,
    threads: Threads = None,
    av_timeout: AvTimeout = AV_TIMEOUT,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Fill a case library with crashes that an adversary makes."""
    from cornerforge import pipeline

    _run(
        lambda bars: pipeline.generate(
            policy=policy, cases=cases, out=out, av=av, resume=resume, lanes=lanes, odd=odd, model=model,
            bounded=bounded, budget=budget, acting=acting, seed=seed, threads=threads, av_timeout=av_timeout,
            progress=bars,
        ),
        lambda r: "\n".join([_rate_text(r, f"{r['cases']:,} cases in {r['library']}"), *_fault_text(r)]),
        as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
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
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Cluster a library's cases; say which could have been avoided, whose fault they were, and which to look at."""
    from cornerforge import pipeline

    def text(r: dict[str, Any]) -> str:
        share = 100.0 * sum(r["explained_variance"])
        lines = [
            f"{r['cases']:,} cases, {len(r['features'])} features, {share:.0f} % of variance in two components; "
            f"majority {r['majority']:,}, minority {r['minority']:,}",
            "Crash types: " + ", ".join(f"{name} {n:,}" for name, n in r["crash_types"].items()),
        ]
        lines += [
            f"Cluster {c['id']} ({c['group']}, {c['size']:,} cases): typical {', '.join(c['typical'])}"
            for c in r["clusters"]
        ]
        lines.append("Rare: " + (", ".join(r["rare"]) or "none"))
        lines += _judgement_text(r)
        return "\n".join([*lines, *([r["note"]] if "note" in r else [])])

    _run(
        lambda bars: pipeline.analyse(
            library, steps=steps, out=out, avoidability=avoidability, reaction=reaction, seed=seed, threads=threads,
            progress=bars,
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def plausibility(
    out: Annotated[Path, typer.Option(help="Folder for policies, curve and figure.", show_default=False)],
    budget: Annotated[
        list[float] | None,
        typer.Option(help="Likelihood budget [nats]; may be given again. 2, 5, 10, 20, 40.", show_default=False),
    ] = None,
    seeds: Annotated[int, typer.Option(help="Training seeds per budget.")] = 3,
    decisions: Annotated[
        int | None, typer.Option(help="Length of a training; the fast preset's by default.", show_default=False)
    ] = None,
    tests: Annotated[int, typer.Option(help="Evaluation tests of each policy.")] = 8192,
    av: Av = "idm-mobil",
    resume: Resume = False,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Plot what an adversary reaches against how plausible it must stay: one training per budget and seed."""
    from cornerforge import pipeline
    from cornerforge.pipeline.plausibility import BUDGETS_NATS, plausibility_text

    _run(
        lambda bars: pipeline.plausibility(
            out=out, budgets=budget or BUDGETS_NATS, seeds=seeds, decisions=decisions, tests=tests, av=av,
            resume=resume, lanes=lanes, odd=odd, model=model, seed=seed, threads=threads, progress=bars,
        ),
        plausibility_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
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
    av: Av = "idm-mobil",
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    budget: Budget = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Count kinds of crash: in libraries, or as policies make them greedily, at random and mixed."""
    from cornerforge import pipeline
    from cornerforge.pipeline.variety import variety_text

    _run(
        lambda bars: pipeline.variety(
            libraries=libraries or (), policies=policy or (), tests=tests, acting=acting, av=av, lanes=lanes, odd=odd,
            model=model, budget=budget, seed=seed, threads=threads, progress=bars,
        ),
        variety_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def rate(
    method: Annotated[str, typer.Option(help="mc: plain Monte Carlo.")] = "mc",
    av: Av = "idm-mobil",
    target_rhw: Annotated[
        float, typer.Option(help="Stop when half the 95 % interval is at most this share of the rate.")
    ] = 0.3,
    max_tests: Annotated[int, typer.Option(help="Stop here at the latest.")] = 1_000_000,
    out: Annotated[
        Path | None, typer.Option(help="Folder that keeps the counts and all crashes.", show_default=False)
    ] = None,
    resume: Resume = False,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    seed: Seed = 0,
    threads: Threads = None,
    av_timeout: AvTimeout = AV_TIMEOUT,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Measure the AV's natural crash rate, without bias; stopped at any moment, it goes on with --resume."""
    from cornerforge import pipeline
    from cornerforge.pipeline.rate_text import rate_text

    if out is None and max_tests > 10_000_000 and not quiet:
        typer.echo(f"Note: nothing of up to {max_tests:,} tests survives a stop; --out FOLDER keeps them.", err=True)
    _run(
        lambda bars: pipeline.rate(
            method=method, av=av, target_rhw=target_rhw, max_tests=max_tests, out=out, resume=resume, lanes=lanes,
            odd=odd, model=model, seed=seed, threads=threads, av_timeout=av_timeout, progress=bars,
        ),
        lambda r: "\n".join([_rate_text(r, f"{av}, natural traffic"), *_fault_text(r), *rate_text(r)]),
        as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the page, figures, numbers and policies.", show_default=False)],
    figure: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID...",
            help="table1, figure2, figure3, figure5, matrix, timings; all by default.",
            show_default=False,
        ),
    ] = None,
    # An option takes one value: what follows `--figure A` in `--figure A B C` arrives here.
    more: Annotated[list[str] | None, typer.Argument(metavar="ID", hidden=True)] = None,
    budget: Annotated[str, typer.Option(help="quick (3 min), standard (an hour) or full (hours).")] = "standard",
    paper_policy: Annotated[
        Path | None, typer.Option(help="A policy of preset paper, for Figure 2.", show_default=False)
    ] = None,
    resume: Resume = False,
    lanes: Lanes = None,
    odd: OddName = "default",
    model: Model = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Make the paper's figures and tables again, ours beside theirs, on one page."""
    from cornerforge import pipeline
    from cornerforge.pipeline.reproduce import reproduction_text

    figures = [*(figure or []), *(more or [])] or None
    _run(
        lambda bars: pipeline.reproduce(
            out=out, figures=figures, budget=budget, paper_policy=paper_policy, resume=resume, lanes=lanes, odd=odd,
            model=model, seed=seed, threads=threads, progress=bars,
        ),
        reproduction_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def replay(
    library: Library,
    case: Annotated[str, typer.Argument(help='Case id such as 0:12, or "all".', show_default=False)],
    check: Annotated[
        bool, typer.Option("--check", help="Compare with what is stored; exit status 1 if it differs.")
    ] = False,
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    av_timeout: AvTimeout = AV_TIMEOUT,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Drive a case again from its seed."""
    from cornerforge import pipeline

    def text(r: dict[str, Any]) -> str:
        verdict = {None: "driven again", True: "identical", False: "NOT identical"}[r["identical"]]
        if "cases" in r:
            differ = f"; different: {', '.join(r['differ'][:10])}" if r["differ"] else ""
            return f"{r['cases']:,} cases: {verdict}{differ}"
        return f"Case {r['case']}: {verdict}; crash at {r['crash_time_s']} s"

    result = _run(
        lambda bars: pipeline.replay(library, case, check=check, av_timeout=av_timeout, progress=bars),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
    if result["identical"] is False:
        if "note" in result:
            typer.echo(result["note"], err=True)
        raise typer.Exit(EXIT_GATE)


@app.command()
def shrink(
    library: Library,
    cases: Annotated[list[str], typer.Argument(metavar="CASE...", help='Case ids, or "all".', show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(help="Library of the shrunk cases; by default LIB-shrunk-CASE, for one case.", show_default=False),
    ] = None,
    resume: Resume = False,
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Make cases as small as they get: fewest vehicles, shortest window, most natural actions, the same crash."""
    from cornerforge import pipeline
    from cornerforge.pipeline.shrink import shrink_text

    _run(
        lambda bars: pipeline.shrink(library, cases, out=out, resume=resume, progress=bars),
        shrink_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command()
def query(
    library: Library,
    sql: Annotated[
        str, typer.Argument(metavar="SQL", help="Such as: select crash_time_s from cases", show_default=False)
    ],
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Ask a library in SQL (table `cases`, key `case_id`)."""
    from cornerforge import pipeline

    def text(r: dict[str, Any]) -> str:
        return "\n".join("\t".join(map(str, row)) for row in [r["columns"], *r["rows"]])

    _run(lambda bars: pipeline.query(library, sql), text, as_json=as_json, quiet=quiet)  # noqa: ARG005


@app.command()
def avs(
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """List the built-in AVs."""
    from cornerforge.drivers.avs import AVS

    _run(
        lambda bars: {"avs": [{"name": m.name, "about": m.about} for m in AVS.values()]},  # noqa: ARG005
        lambda r: "\n".join(f"{a['name']:<20}{a['about']}" for a in r["avs"]), as_json=as_json, quiet=quiet,
    )  # fmt: skip


@app.command("check-av")
def check_av(
    av: Annotated[
        str, typer.Argument(metavar="AV", help="module:Class, or an .onnx or SB3 .zip file.", show_default=False)
    ],
    odd: OddName = "default",
    lanes: Lanes = None,
    tests: Annotated[int, typer.Option(help="Tests to drive at the end, in natural traffic.")] = 256,
    seed: Seed = 0,
    threads: IdleThreads = None,
    av_timeout: AvTimeout = AV_TIMEOUT,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Try an AV of your own on edge cases and measure its speed; exit status 1 if anything fails."""
    from cornerforge import pipeline

    def text(r: dict[str, Any]) -> str:
        lines = [f"{c['verdict']:<5}{c['name']}: {c['found']}" for c in r["checks"]]
        lines += [
            f"speed, {s['worlds']:>4} worlds: {s['calls_per_second']:,.0f} calls/s, "
            f"{s['decisions_per_second']:,.0f} decisions/s"
            for s in r["speed"]
        ]
        return "\n".join([f"{r['av']} ({r['kind']}, {r['hash']})", *lines])

    result = _run(
        lambda bars: pipeline.check_av(
            av=av, odd=odd, lanes=lanes, tests=tests, seed=seed, av_timeout=av_timeout, progress=bars
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
    if not result["passed"]:
        raise typer.Exit(EXIT_GATE)


@ndd.command("fit")
def ndd_fit(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Trajectory files.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Model file to write, .npz.", show_default=False)],
    data_format: DataFormat = None,
    prior_strength: Annotated[float, typer.Option(help="Pseudo-counts per state with which the prior enters.")] = 200.0,
    study: Annotated[
        bool, typer.Option("--study", help="Report what other choices of the fit change (6 fits).")
    ] = False,
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Fit a naturalistic model from trajectories; its report is written beside it."""
    from cornerforge import pipeline
    from cornerforge.pipeline.naturalistic import fit_text

    _run(
        lambda bars: pipeline.ndd_fit(
            files, data_format=data_format, out=out, prior_strength=prior_strength, study=study, progress=bars
        ),
        fit_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@ndd.command("import")
def ndd_import(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with the arrays.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Model file to write, .npz.", show_default=False)],
    model: Annotated[
        Path | None, typer.Option(help="Fills what is missing; the shipped model by default.", show_default=False)
    ] = None,
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Make a model of the published IVBSS arrays; what is missing is filled from ours and named."""
    from cornerforge import pipeline
    from cornerforge.pipeline.naturalistic import import_text

    _run(
        lambda bars: pipeline.ndd_import(folder, out=out, model=model, progress=bars),
        import_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@ndd.command("show")
def ndd_show(
    model: Annotated[
        Path | None, typer.Argument(metavar="M.npz", help="The model; the shipped one by default.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).", show_default=False)] = None,
    seed: IdleSeed = 0,
    threads: IdleThreads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Show a naturalistic model: its key numbers beside published facts; figures with --out."""
    from cornerforge import pipeline
    from cornerforge.pipeline.show import show_text

    _run(
        lambda bars: pipeline.ndd_show(model, out=out, progress=bars), show_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip


@ndd.command("validate")
def ndd_validate(
    model: Annotated[Path, typer.Argument(metavar="M.npz", help="The model.", show_default=False)],
    against: Annotated[
        list[Path], typer.Option(metavar="FILE...", help="Trajectory files, such as held-out ones.", show_default=False)
    ],
    data_format: DataFormat = None,
    # An option takes one value: what follows `--against A` in `--against A B C` arrives here.
    more: Annotated[list[Path] | None, typer.Argument(metavar="FILE", hidden=True)] = None,
    miles: Annotated[float, typer.Option(help="Vehicle-miles of traffic in each window; 2e4 for a quick look.")] = 2e6,
    out: Annotated[
        Path | None, typer.Option(help="Folder for validation.json, the page and its figures.", show_default=False)
    ] = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Compare a model with held-out trajectories and published facts; exit status 1 if it does not pass."""
    from cornerforge import pipeline
    from cornerforge.pipeline.validate import validation_text

    result = _run(
        lambda bars: pipeline.ndd_validate(
            model, against=[*against, *(more or [])], data_format=data_format, miles=miles, out=out, seed=seed,
            threads=threads, progress=bars,
        ),
        validation_text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
    if not result["passed"]:
        raise typer.Exit(EXIT_GATE)


def _usage_message(error: Any) -> str:
    """Typer's message (it suggests the nearest command) in one line, with where help is."""
    path = error.ctx.command_path if error.ctx is not None else "cornerforge"
    # Typer has no message, only the help, for a call without a command.
    message = " ".join(error.format_message().split()) or "A command is missing."
    return f"{message} (see: {path} --help)"


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    typer.echo(f"Warning: {message}", err=True)


def _complain(message: object, *, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    typer.echo(f"cornerforge: {message}", err=True)
    return EXIT_BAD_INPUT


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status (see the interface: 0, 1, 2 or 130)."""
    given = sys.argv[1:] if arguments is None else arguments
    debug = "--debug" in given
    usage_error: type[Exception] = typer.BadParameter.__mro__[1]  # Typer offers its base class under no name
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            status = app(args=given, prog_name="cornerforge", standalone_mode=False)
        except CornerForgeError as error:
            return _complain(error, debug=debug)
        except usage_error as error:
            return _complain(_usage_message(error), debug=debug)
        except OSError as error:  # a full disk, a file without permission: the text names the file
            return _complain(error, debug=debug)
        except (KeyboardInterrupt, typer.Abort):
            status = EXIT_INTERRUPTED
    if status == EXIT_INTERRUPTED:  # this is also how Typer reports Ctrl-C
        typer.echo("cornerforge: interrupted; what was finished is kept.", err=True)
    return status if isinstance(status, int) else 0
