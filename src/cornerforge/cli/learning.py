"""Learning: `train` and `train-av`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import cornerforge
from cornerforge.cli.options import (
    Config,
    Debug,
    Json,
    Quiet,
    Resume,
    Reward,
    Seed,
    Threads,
    World,
    completing,
    flag,
    takes_world,
)
from cornerforge.cli.output import rate_text, run_command, training_fault_text, yield_text
from cornerforge.cli.program import command
from cornerforge.world_options import AV_ASKED

if TYPE_CHECKING:
    from cornerforge.results import Trained, TrainedAv

__all__ = ["train", "train_av"]


@command(
    "cornerforge train --av rl --decisions 1000000 --out out/rl.safetensors",
    "cornerforge train --budget 20 --out out/likely.safetensors",
)
@takes_world("av", "odd", "lanes", "model", "bounded", "budget", *AV_ASKED)
def train(
    out: Annotated[Path, typer.Option(help="Policy file to write, .safetensors.", show_default=False)],
    world: World = None,
    preset: Annotated[str, typer.Option(help="fast or paper.", autocompletion=completing("fast", "paper"))] = "fast",
    reward: Reward = "crash",
    delay: Annotated[float, typer.Option(help="Seconds that the AV has to react, in avoidable.")] = 1.0,
    decisions: Annotated[int | None, typer.Option(help="Length in decisions.", show_default=False)] = None,
    minutes: Annotated[
        float | None, typer.Option(help="Stop after this time; the result then depends on speed.", show_default=False)
    ] = None,
    resume: Annotated[bool, flag("--resume", "Go on with a stopped training; keep a finished one.")] = False,
    tests: Annotated[int, typer.Option(help="Evaluation tests for each yield.")] = 8192,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Train the adversary on an AV.

    On one machine the same command gives the same policy; on another processor the weights may differ.
    """

    def text(r: Trained) -> str:
        lines = [yield_text(r, "Adversary", r.reward)]
        lines += [yield_text(b, f"{b.name:>21}", r.reward) for b in r.baselines]
        lines += training_fault_text(r.av_faults)
        return "\n".join([*lines, f"{r.decisions:,} decisions in {r.seconds:.0f} s; policy: {r.out}"])

    run_command(
        lambda bars: cornerforge.train(
            out=out, preset=preset, reward=reward, delay=delay,
            decisions=decisions, minutes=minutes, resume=resume, tests=tests,
            seed=seed, threads=threads, progress=bars, **world,
        ),
        text, as_json=as_json, quiet=quiet, stages=True,
    )  # fmt: skip


@command("cornerforge train-av --decisions 1000000 --out out/av.safetensors", name="train-av")
@takes_world("odd", "lanes", "model")
def train_av(
    out: Annotated[Path, typer.Option(help="AV file to write, .safetensors; --av takes it.", show_default=False)],
    decisions: Annotated[int | None, typer.Option(help="Seconds of driving to learn from.", show_default=False)] = None,
    minutes: Annotated[
        float | None, typer.Option(help="Stop after this time; the result then depends on speed.", show_default=False)
    ] = None,
    tests: Annotated[int, typer.Option(help="Tests in natural traffic to measure it on.")] = 20_000,
    overwrite: Annotated[bool, flag("--overwrite", "Replace the file.")] = False,
    resume: Resume = False,
    world: World = None,
    config: Config = None,
    seed: Seed = 0,
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Train an AV to drive in natural and hostile traffic."""

    def text(r: TrainedAv) -> str:
        return "\n".join(
            [
                rate_text(r, "Natural traffic"),
                f"Mean speed {r.mean_speed:.1f} m/s",
                f"{r.decisions:,} s of driving in {r.seconds:.0f} s; AV: {r.out}",
            ]
        )

    run_command(
        lambda bars: cornerforge.train_av(
            out=out, decisions=decisions, minutes=minutes, tests=tests, overwrite=overwrite, resume=resume,
            seed=seed, threads=threads, progress=bars, **world,
        ),
        text, as_json=as_json, quiet=quiet,
    )  # fmt: skip
