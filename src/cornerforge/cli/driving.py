"""Driving tests: `simulate`, `rate`, and the AVs that drive them."""

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
    Quiet,
    Resume,
    Seed,
    Threads,
    World,
    completing,
    flag,
    takes_world,
)
from cornerforge.cli.output import EXIT_GATE, fault_text, rate_text, run_command, speed_text
from cornerforge.cli.program import command
from cornerforge.world_options import AV_ASKED, PLAIN_ADVERSARIES

if TYPE_CHECKING:
    from cornerforge.results import AvChecked, Simulated

__all__ = ["avs", "check_av", "rate", "simulate"]


@command(
    "cornerforge simulate --av rl --tests 100000",
    "cornerforge simulate --bv out/demo/policy.safetensors --out out/crashes",
)
@takes_world("av", "odd", "lanes", "model", "bounded", "budget", *AV_ASKED)
def simulate(
    tests: Annotated[int, typer.Option(help="Tests to drive (400 m each).")] = 10_000,
    world: World = None,
    bv: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Background vehicles: nde (default), idm, {', '.join(PLAIN_ADVERSARIES)}, or a policy file; several "
            "policies: each test draws one.",
            show_default=False,
            autocompletion=completing("nde", "idm", *PLAIN_ADVERSARIES),
        ),
    ] = None,
    policy: Annotated[
        list[Path] | None, typer.Option(help="The same as --bv FILE; may be given again.", show_default=False)
    ] = None,
    acting: Acting = "greedy",
    stats: Annotated[bool, flag("--stats", "Add distributions over all background vehicles.")] = False,
    out: Annotated[Path | None, typer.Option(help="Store the crashes in this library.", show_default=False)] = None,
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
    """Drive tests and count crashes; they are stored only with --out."""
    from cornerforge.results.driving import Quantity

    drivers = [*(bv or []), *map(str, policy or [])] or ["nde"]

    def text(r: Simulated) -> str:
        lines = [
            rate_text(r, f"{world['av']}, {' + '.join(drivers)}"),
            f"{r.av_crashes:,} AV crashes, {r.bv_crashes:,} crashes between BVs; "
            f"{speed_text(r.tests_per_second)} tests/s, {speed_text(r.world_steps_per_second)} world-steps/s; "
            f"digest {r.digest[:16]}",
            *fault_text(r.av_faults),
        ]
        for name, d in () if r.distributions is None else vars(r.distributions).items():
            if isinstance(d, Quantity) and d.n:
                q = "  ".join(f"{v:g}" for v in d.quantiles.values())
                lines.append(f"{name:>14} [{d.unit}]: mean {d.mean:.3f}, sd {d.sd:.3f}; 1 5 25 50 75 95 99 %: {q}")
            else:
                lines.append(f"{name:>14}: {'none' if isinstance(d, Quantity) else d}")
        return "\n".join(lines)

    run_command(
        lambda bars: cornerforge.simulate(
            tests=tests, bv=drivers, acting=acting, stats=stats, out=out, resume=resume, seed=seed, threads=threads,
            progress=bars, **world,
        ),
        text, as_json=as_json, quiet=quiet, at=(engine, address, threads),
    )  # fmt: skip


@command("cornerforge rate --av idm-mobil-blind --max-tests 20000", "cornerforge rate --av rl --out out/rate")
@takes_world("av", "odd", "lanes", "model", *AV_ASKED)
def rate(
    method: Annotated[
        str,
        typer.Option(
            help="mc: plain Monte Carlo; splitting: trees of tests, for small rates; is: importance sampling; auto: "
            "chooses.",
            autocompletion=completing("auto", "mc", "splitting", "is"),
        ),
    ] = "auto",
    world: World = None,
    target_rhw: Annotated[
        float, typer.Option(help="Stop when half the 95 % interval is at most this share of the rate.")
    ] = 0.3,
    max_tests: Annotated[int, typer.Option(help="Stop here at the latest.")] = 1_000_000,
    model_draws: Annotated[
        int,
        typer.Option(
            help="Drive so many models drawn about this one too: a second interval with the model's uncertainty."
        ),
    ] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder that keeps the counts and all crashes.", show_default=False)
    ] = None,
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
    """Measure the AV's natural crash rate, without bias; stopped at any moment, it goes on with --resume.

    Exit status 1 if the rate is in doubt.
    """
    from cornerforge.verbs.rate_text import doubt_text
    from cornerforge.verbs.rate_text import rate_text as crashes_text

    if out is None and max_tests > 10_000_000 and not quiet:
        typer.echo(f"Note: nothing of up to {max_tests:,} tests survives a stop; --out FOLDER keeps them.", err=True)
    found = run_command(
        lambda bars: cornerforge.rate(
            method=method, target_rhw=target_rhw, max_tests=max_tests, model_draws=model_draws, out=out, resume=resume,
            seed=seed, threads=threads, progress=bars, **world,
        ),
        lambda r: "\n".join(
            [rate_text(r, f"{world['av']}, natural traffic"), *fault_text(r.av_faults), *crashes_text(r, target_rhw)]
        ),
        as_json=as_json, quiet=quiet, stages=True, at=(engine, address, threads),
    )  # fmt: skip
    doubt = doubt_text(found)
    if doubt is not None:
        typer.echo(doubt, err=True)
        raise typer.Exit(EXIT_GATE)


@command("cornerforge avs")
def avs(
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """List the built-in AVs."""
    run_command(
        lambda bars: cornerforge.avs(),  # noqa: ARG005
        lambda r: "\n".join(f"{a.name:<20}{a.about}" for a in r.avs), as_json=as_json, quiet=quiet, out=out,
    )  # fmt: skip


@command("cornerforge check-av my_av:MyAv", name="check-av")
@takes_world("odd", "lanes", *AV_ASKED)
def check_av(
    av: Annotated[
        str,
        typer.Argument(
            metavar="AV",
            help='module:Class, file.py:Class, "cmd: ./program", or an .onnx or SB3 .zip file.',
            show_default=False,
        ),
    ],
    world: World = None,
    tests: Annotated[
        int | None,
        typer.Option(help="Tests to drive at the end, in natural traffic.", show_default="256; fewer of a slow AV"),
    ] = None,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    out: JsonFile = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Try an AV of your own on edge cases and measure its speed; exit status 1 if anything fails."""
    from cornerforge._words import spoken

    def text(r: AvChecked) -> str:
        lines, told = [], set[str]()
        for c in r.checks:
            lines.append(f"{c.verdict:<5}{c.name}: {c.found}")
            if c.trace and c.trace not in told:  # once, though many trials end in it
                lines += [f"       {line}" for line in c.trace.splitlines()]
                told.add(c.trace)
        lines += [
            f"speed, {s.worlds:>4} worlds: {speed_text(s.calls_per_second)} calls/s, "
            f"{speed_text(s.decisions_per_second)} decisions/s"
            for s in r.speed
        ]
        if r.does is not None:
            lines.append(
                f"about {spoken(r.does.answer_seconds)} for an answer, {r.does.batch} world(s) at a time, "
                f"{r.does.processes} process(es): {speed_text(r.does.tests_per_hour)} tests/h, "
                f"{speed_text(r.does.decisions_per_hour)} training decisions/h; {r.does.advice}"
            )
        lines += [f"what it printed, and its tracebacks: {r.log}"] if r.log else []
        may = f"it may do what you may; memory: {r.memory_gb:.3g} GB a process"
        return "\n".join([f"{r.av} ({r.kind}, {r.hash})", may, *lines])

    result = run_command(
        lambda bars: cornerforge.check_av(
            av=av, tests=tests, seed=seed, threads=threads, progress=bars, **world
        ),
        text, as_json=as_json, quiet=quiet, out=out,
    )  # fmt: skip
    if not result.passed:
        raise typer.Exit(EXIT_GATE)
