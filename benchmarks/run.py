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

import end_to_end
import fine_integration
import kernel_times
import versus_functions
import versus_highway_env
from end_to_end import Sizes
from machine import BUSY_LOAD, describe, this_machine

from cornerforge.pipeline.setting import experiment

BEGIN = "<!-- begin: benchmarks/run.py writes this -->"
END = "<!-- end: benchmarks/run.py -->"


@dataclass(frozen=True)
class Scale:
    """Size of the whole run; `tests` and `episodes` are those of one round."""

    repetitions: int = 7
    tests: int = 20_000
    episodes: int = 5
    profile_tests: int = 5_000
    states: int = 10_000
    following_runs: int = 32
    sizes: Sizes = field(default_factory=Sizes)


QUICK = Scale(2, 1_000, 1, 300, 500, 4, Sizes(40_000, 1024, 300, 2))
"""Enough to see that everything works; its numbers mean nothing."""


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Measure the speed of cornerforge, beside highway-env's.")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write all measurements as JSON")
    parser.add_argument("--write", type=Path, metavar="PATH", help="replace the marked block of this document")
    parser.add_argument("--quick", action="store_true", help="a trial in under a minute; its numbers mean nothing")
    arguments = parser.parse_args()
    if arguments.write and arguments.quick:
        parser.error("--quick is a trial: its numbers are not for a document; leave --write out.")
    if arguments.write and not _has_block(arguments.write):
        parser.error(f"{arguments.write} has no lines {BEGIN} and {END}; put them where the numbers shall stand.")
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
    return arguments


def _has_block(path: Path) -> bool:
    text = path.read_text("utf-8") if path.is_file() else ""
    return 0 <= text.find(BEGIN) < text.find(END)


def replace_block(document: str, block: str) -> str:
    """The document with the text between the two marks replaced."""
    before, rest = document.split(BEGIN, 1)
    _, after = rest.split(END, 1)
    return f"{before}{BEGIN}\n{block.strip()}\n{END}{after}"


def _say(what: str) -> None:
    print(f"measuring: {what}", file=sys.stderr, flush=True)


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
    _say("agreement with highway-env's functions and with a fine integration")
    idm, mobil = versus_functions.compare_all(states=scale.states)
    following = fine_integration.compare_all(runs=scale.following_runs)
    _say("training, generating, analysing")
    whole = end_to_end.measure_end_to_end(repetitions=scale.repetitions, sizes=scale.sizes)
    _say("the parts of a world-step")
    run = experiment(policy=whole.policy)
    parts = kernel_times.profile(run, repetitions=scale.repetitions, tests=scale.profile_tests)
    _say("against highway-env")
    versus = versus_highway_env.compare(
        repetitions=scale.repetitions, tests=scale.tests, episodes=scale.episodes, reset_share=parts.reset_share
    )
    _say("by threads")
    scaling = end_to_end.measure_scaling(repetitions=scale.repetitions, tests=scale.tests)
    seconds = time.perf_counter() - start
    content: dict[str, object] = {
        "machine": asdict(machine),
        "repetitions": scale.repetitions,
        "seconds": round(seconds, 1),
        "versus_highway_env": versus.to_json(),
        "kernel_times": parts.to_json(),
        "end_to_end": whole.to_json(),
        "scaling": {str(n): series.to_json() for n, series in scaling.items()},
        "verified_from_outside": {
            "idm": [asdict(a) for a in idm],
            "mobil": [asdict(m) for m in mobil],
            "car_following": {name: [asdict(e) for e in errors] for name, errors in following.items()},
        },
    }
    head = (
        f"{describe(machine)}\n"
        f"One run of {seconds / 60.0:.1f} min; every number is the median of {scale.repetitions} rounds taken by turns "
        f"({scale.sizes.starts} for the starts of the command line)."
    )
    sections = {
        "Against highway-env": versus_highway_env.render(versus),
        "Where the time goes": kernel_times.render(parts),
        "End to end": end_to_end.render(whole),
        "By threads": end_to_end.render_scaling(scaling),
        "Verified from outside": (
            f"{versus_functions.render(idm, mobil)}\n\n{fine_integration.render(following, scale.following_runs)}"
        ),
    }
    return content, "\n\n".join([head, *(f"### {title}\n\n{text}" for title, text in sections.items())])


def main() -> None:
    arguments = _arguments()
    content, block = measure(QUICK if arguments.quick else Scale())
    print(block)
    if arguments.json:
        arguments.json.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8")
    if arguments.write:
        arguments.write.write_text(replace_block(arguments.write.read_text("utf-8"), block), "utf-8")


if __name__ == "__main__":
    main()
