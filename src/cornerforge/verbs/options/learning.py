"""Options of learning: `train` and `train-av`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork, Options, Resumable
from cornerforge._schema import meant
from cornerforge.world_options import LEARNERS, REWARD_NAMES, RoadOptions, WorldOptions

__all__ = ["COMMANDS", "REWARD", "Train", "TrainAv"]

REWARD = meant(
    f"Crashes of the AV that are paid for: {', '.join(REWARD_NAMES)}; crash: all. preventable:DRIVER and "
    "preventable-by-braking:DRIVER name the reference driver, cc-human by default.",
    near=REWARD_NAMES,
)


class _Length(Options):
    """How long a training lasts."""

    decisions: Annotated[
        int | None,
        meant(
            "Length in decisions: seconds of driving.",
            more="None: the usual length. The same seed and decisions give the same weights on one machine.",
            low=1,
            high=10**12,
        ),
    ] = None
    minutes: Annotated[
        float | None,
        meant(
            "Stop after this time; the result then depends on speed.",
            more="The learning rate falls over it. With `decisions` too, whichever comes first ends it.",
            low=0.01,
            high=1e5,
            unit="min",
        ),
    ] = None


class Train(WorldOptions, _Length, LongWork):
    """Train the adversary on an AV.

    On one machine the same command gives the same policy; on another processor the weights may differ.
    """

    out: Annotated[
        Path | str,
        meant(
            "Policy file to write, .safetensors.",
            more="Date and duration stand in `NAME.provenance.json` beside it, so the same training gives the same "
            "bytes.",
        ),
    ]
    learner: Annotated[str, meant(f"What learns: {', '.join(LEARNERS)}; dqn: the paper's.", choices=LEARNERS)] = "dqn"
    preset: Annotated[str, meant("fast, or of dqn paper.", near=("fast", "paper"))] = "fast"
    reward: Annotated[str, REWARD] = "crash"
    delay: Annotated[float, meant("Seconds that the AV has to react, in avoidable.")] = 1.0
    tests: Annotated[int, meant("Evaluation tests for each yield.", low=1, high=10**9)] = 8192
    resume: Annotated[
        bool,
        meant(
            "Go on with a stopped training; keep a finished one.",
            more="Its state is in `OUT.checkpoint`; the weights are the same as without the stop, unless "
            "`minutes` ends it.",
        ),
    ] = False


class TrainAv(RoadOptions, _Length, Resumable, LongWork):
    """Train an AV to drive in natural and hostile traffic."""

    out: Annotated[Path | str, meant("AV file to write, .safetensors; --av takes it.")]
    tests: Annotated[int, meant("Tests in natural traffic to measure it on.", low=1, high=10**9)] = 20_000
    overwrite: Annotated[bool, meant("Replace the file.")] = False


COMMANDS = (
    Command(
        Train, "verbs.train:train", "verbs.sentences.driving:train_text",
        (
            "cornerforge train --av rl --decisions 1000000 --out out/rl.safetensors",
            "cornerforge train --budget 20 --out out/likely.safetensors",
        ),
        stages=True,
    ),
    Command(
        TrainAv, "verbs.train_av:train_av", "verbs.sentences.driving:train_av_text",
        ("cornerforge train-av --decisions 1000000 --out out/av.safetensors",),
    ),
)  # fmt: skip
