"""`make bench`: measure the speeds that docs/results.md speaks of, all in one run.

    .venv-bench/bin/python benchmarks/run.py --write docs/results.md

Prints Markdown; `--write` puts it into a document between two marks, `--json` keeps every single measurement. Wants a
machine that does nothing else; a full run takes some minutes.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import aims
import end_to_end
import fine_integration
import kernel_times
import scaling
import versus_c
import versus_functions
import versus_highway_env
from document import MarkedBlock
from end_to_end import Sizes
from machine import BUSY_LOAD, describe, this_machine

from cornerforge.experiment.setting import experiment

IN_DOCUMENT = MarkedBlock("benchmarks/run.py")


@dataclass(frozen=True)
class Scale:
    """Size of the whole run; `tests` and `episodes` are those of one round."""

    repetitions: int = 7
    tests: int = 20_000
    episodes: int = 5
    profile_tests: int = 5_000
    scaling_tests: int = 3_000
    states: int = 10_000
    following_runs: int = 16
    sizes: Sizes = field(default_factory=Sizes)

    @property
    def scaling_repetitions(self) -> int:
        """Rounds of the many small measurements of growth."""
        return max(2, self.repetitions - 2)


QUICK = Scale(2, 1_000, 1, 300, 500, 500, 4, Sizes(40_000, 1024, 300, 2))
"""Enough to see that everything works; its numbers mean nothing."""


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Measure the speed of cornerforge, beside highway-env's.")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write all measurements as JSON")
    parser.add_argument("--write", type=Path, metavar="PATH", help="replace the marked block of this document")
    parser.add_argument("--quick", action="store_true", help="a trial in under a minute; its numbers mean nothing")
    arguments = parser.parse_args()
    if arguments.write and arguments.quick:
        parser.error("--quick is a trial: its numbers are not for a document; leave --write out.")
    if arguments.write and (fault := IN_DOCUMENT.missing_in(arguments.write)):
        parser.error(fault)
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
    return arguments


def _say(what: str) -> None:
    print(f"measuring: {what}", file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Section:
    """One part of the result: what JSON holds under `key`, and Markdown under a title."""

    key: str
    title: str
    content: object
    text: str


def _verified(scale: Scale) -> Section:
    _say("agreement with highway-env's functions and with a fine integration")
    idm, mobil = versus_functions.compare_all(states=scale.states)
    following = fine_integration.compare_all(runs=scale.following_runs)
    content = {
        "idm": [asdict(a) for a in idm],
        "mobil": [asdict(m) for m in mobil],
        "car_following": {name: [asdict(e) for e in errors] for name, errors in following.items()},
    }
    text = f"{versus_functions.render(idm, mobil)}\n\n{fine_integration.render(following, scale.following_runs)}"
    return Section("verified_from_outside", "Verified from outside", content, text)


def _used(scale: Scale) -> tuple[list[Section], float]:
    """What users wait for, the parts of a world-step (timed with the policy trained on the way), and resets' share."""
    _say("training, generating, analysing")
    whole = end_to_end.measure_end_to_end(repetitions=scale.repetitions, sizes=scale.sizes)
    _say("the parts of a world-step")
    run = experiment(policy=whole.policy)
    parts = kernel_times.profile(run, repetitions=scale.repetitions, tests=scale.profile_tests)
    sections = [
        Section("kernel_times", "Where the time goes", parts.to_json(), kernel_times.render(parts)),
        Section("end_to_end", "End to end", whole.to_json(), end_to_end.render(whole)),
    ]
    return sections, parts.reset_share


def _compared(scale: Scale, reset_share: float) -> list[Section]:
    """The ratios, the growth, and in front of them how they stand to their aims."""
    _say("against highway-env")
    repetitions, tests, episodes = scale.repetitions, scale.tests, scale.episodes
    versus = versus_highway_env.compare(
        repetitions=repetitions, tests=tests, episodes=episodes, reset_share=reset_share
    )
    small = versus_highway_env.compare_small(repetitions=repetitions, tests=tests, episodes=episodes)
    _say("against the same loops in C")
    in_c = versus_c.compare(repetitions=repetitions, tests=scale.scaling_tests)
    _say("by BVs, lanes, threads and batch; memory")
    growth = scaling.measure_scaling(repetitions=scale.scaling_repetitions, tests=scale.scaling_tests)
    text = f"{versus_highway_env.render(versus)}\n\n{versus_highway_env.render_small(small)}"
    content = {**versus.to_json(), "twenty_bvs": small.to_json()}
    return [
        Section("aims", "Against the aims", aims.to_json(small, in_c, growth), aims.render(small, in_c, growth)),
        Section("versus_highway_env", "Against highway-env", content, text),
        Section("versus_c", "Against the same loops in C", {c.world: c.to_json() for c in in_c}, versus_c.render(in_c)),
        Section("scaling", "By size, threads and batch", growth.to_json(), scaling.render(growth)),
    ]


def measure(scale: Scale) -> tuple[dict[str, object], str]:
    """Run everything; returns the JSON object and the Markdown."""
    start = time.perf_counter()
    machine = this_machine()
    if machine.is_busy:
        print(
            f"warning: load average {machine.load:.2f} > {BUSY_LOAD}: this machine has other work, "
            "and the numbers suffer; stop it and start again.",
            file=sys.stderr,
        )
    verified = _verified(scale)
    used, reset_share = _used(scale)
    sections = [*_compared(scale, reset_share), *used, verified]
    seconds = time.perf_counter() - start
    content: dict[str, object] = {
        "machine": asdict(machine),
        "repetitions": scale.repetitions,
        "seconds": round(seconds, 1),
        **{section.key: section.content for section in sections},
    }
    head = (
        f"{describe(machine)}\n"
        f"One run of {seconds / 60.0:.1f} min; every number is the median of {scale.repetitions} rounds taken by turns "
        f"({scale.scaling_repetitions} by size, threads and batch, {scale.sizes.starts} for the starts of the command "
        "line)."
    )
    return content, "\n\n".join([head, *(f"### {section.title}\n\n{section.text}" for section in sections)])


def main() -> None:
    arguments = _arguments()
    content, block = measure(QUICK if arguments.quick else Scale())
    print(block)
    if arguments.json:
        arguments.json.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8")
    if arguments.write:
        arguments.write.write_text(IN_DOCUMENT.replace_in(arguments.write.read_text("utf-8"), block), "utf-8")


if __name__ == "__main__":
    main()
