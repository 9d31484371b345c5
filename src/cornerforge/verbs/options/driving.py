"""Options of the commands that drive tests: `simulate`, `rate`, `check-av`; and `avs`, which lists the AVs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork, Options, Resumable
from cornerforge._schema import meant
from cornerforge.world_options import PLAIN_ADVERSARIES, AvOptions, WorldOptions

__all__ = ["ACTING", "COMMANDS", "CheckAv", "ListAvs", "Rate", "Simulate"]

ACTING = meant(
    "How a policy acts: learned (a DQN's greedily, PPO's by its probabilities), greedy, or softmax:T to draw by "
    "exp(Q / T).",
    near=("learned", "greedy", "softmax"),
)


class Simulate(WorldOptions, Resumable, LongWork):
    """Drive tests and count crashes; they are stored only with --out."""

    tests: Annotated[int, meant("Tests to drive (400 m each).", low=1, high=10**12)] = 10_000
    bv: Annotated[
        Sequence[str | Path] | str | Path,
        meant(
            f"Background vehicles: nde (default), idm, {', '.join(PLAIN_ADVERSARIES)}, or a policy file; several "
            "policies: each test draws one.",
            near=("nde", "idm", *PLAIN_ADVERSARIES), also="--policy",
        ),
    ] = "nde"  # fmt: skip
    acting: Annotated[str, ACTING] = "learned"
    stats: Annotated[bool, meant("Add distributions over all background vehicles.")] = False
    out: Annotated[Path | str | None, meant("Store the crashes in this library.")] = None


class Rate(AvOptions, Resumable, LongWork):
    """Measure the AV's natural crash rate, without bias; stopped at any moment, it goes on with --resume.

    Exit status 1 if the rate is in doubt.
    """

    method: Annotated[
        str,
        meant(
            "mc: plain Monte Carlo; splitting: trees of tests, for small rates; is: importance sampling; auto: "
            "chooses.",
            more="Splitting is for rates below 1e-5; importance sampling makes no copies of worlds; auto begins with "
            "plain tests, and goes on with trees if more of them would take longer.",
            choices=("auto", "mc", "splitting", "is"),
        ),
    ] = "auto"
    target_rhw: Annotated[
        float,
        meant(
            "Stop when half the 95 % interval is at most this share of the rate.",
            more="The interval is exact for mc; for the two others it holds however often one looks, and they stop "
            "only without doubts.",
            low=1e-3,
            high=10.0,
        ),
    ] = 0.3
    max_tests: Annotated[
        int,
        meant("Stop here at the latest.", more="Trees, those of teaching too, count as one each.", low=1, high=10**12),
    ] = 1_000_000
    model_draws: Annotated[
        int,
        meant(
            "Drive so many models drawn about this one too: a second interval with the model's uncertainty.",
            more="5 or more; 0: the interval is of sampling alone.",
        ),
    ] = 0
    out: Annotated[
        Path | str | None,
        meant(
            "Folder that keeps the counts and all crashes.",
            more="`rate.json`, and a library: `library/` if crashes are counted, else `weighted/`.",
        ),
    ] = None


class ListAvs(Options):
    """List the built-in AVs."""


class CheckAv(AvOptions, LongWork):
    """Try an AV of your own on edge cases and measure its speed; exit status 1 if anything fails."""

    av: Annotated[
        str, meant('module:Class, file.py:Class, "cmd: ./program", or an .onnx or SB3 .zip file.', metavar="AV")
    ] = field(kw_only=False)
    tests: Annotated[
        int | None,
        meant("Tests to drive at the end, in natural traffic.", low=1, high=10**6, default="256; fewer of a slow AV"),
    ] = None


COMMANDS = (
    Command(
        Simulate, "verbs.simulate:simulate", "verbs.sentences.driving:simulate_text",
        (
            "cornerforge simulate --av rl --tests 100000",
            "cornerforge simulate --bv out/demo/policy.safetensors --out out/crashes",
        ),
        spreads=True,
    ),
    Command(
        Rate, "verbs.rate:rate", "verbs.sentences.rates:rated_text",
        ("cornerforge rate --av idm-mobil-blind --max-tests 20000", "cornerforge rate --av rl --out out/rate"),
        fails="verbs.sentences.rates:doubt_text", stages=True, spreads=True,
    ),
    Command(ListAvs, "verbs.avs:avs", "verbs.sentences.driving:avs_text", ("cornerforge avs",)),
    Command(
        CheckAv, "verbs.check_av:check_av", "verbs.sentences.driving:check_av_text",
        ("cornerforge check-av my_av:MyAv",),
        fails="verbs.sentences.driving:check_av_failed",
    ),
)  # fmt: skip
