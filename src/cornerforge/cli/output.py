"""Output for people: progress bars, the object or the text at the end, and sentences on rates."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from cornerforge._locks import claims
from cornerforge.cli.config import this_call

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

    from cornerforge.results import Analysed, Filled
    from cornerforge.results.analysis import Judges, NaturalKind, ShareAtReaction
    from cornerforge.results.rates import Rate, Yield

__all__ = [
    "EXIT_GATE",
    "Bars",
    "compiling_text",
    "fault_text",
    "judgement_text",
    "natural_text",
    "paid_text",
    "rate_text",
    "run_command",
    "speed_text",
    "training_fault_text",
    "wrong_text",
    "yield_text",
]

T = TypeVar("T")
EXIT_GATE = 1
"""Exit status when a gate or a comparison failed."""


class Bars:
    """Progress on standard error: on a terminal bars, one per stage, with rate and time left; else a line per stage.

    Args:
        quiet: Say nothing.
        lines: Where there is no terminal, say of each stage that has ended how long it took.
    """

    def __init__(self, quiet: bool, *, lines: bool = False) -> None:
        self.show = not quiet and sys.stderr.isatty()
        self._lines = lines and not quiet and not self.show
        self._bars: RichProgress | None = None
        self._stage = ""
        self._task: TaskID | None = None
        self._number, self._of = 0, 0
        self._begun = time.monotonic()

    def begin_part(self, number: int, of: int) -> None:
        """Take it that the present stage has ended, and that part `number` of `of` begins."""
        if self._lines:
            self._end_stage()
            self._number, self._of = number, of

    def _end_stage(self) -> None:
        """Say how long the present stage took, if there is one; the next begins now."""
        now = time.monotonic()
        took, self._begun = now - self._begun, now
        if not self._stage:
            return
        if not self._of:
            self._number += 1
        number = f"{self._number} of {self._of}" if self._of else f"{self._number}"
        typer.echo(f"stage {number}: {self._stage}, {took:.{0 if took >= 10.0 else 1}f} s", err=True)
        self._stage = ""

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Draw; a new stage gets a new bar, or ends the line of the one before."""
        name = stage.partition(" (")[0]  # what stands in brackets may change while a stage lasts
        if self._lines and name != self._stage:
            begun = self._stage == ""
            before = self._begun
            self._end_stage()
            if begun:  # what came before the first report belongs to it
                self._begun = before
            self._stage = name
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
        if name != self._stage or self._task is None:
            self._stage = name
            # Work of an earlier session does not count for the speed of this one.
            self._task = self._bars.add_task(stage, total=total, completed=int(done), rate="")
        speed = self._bars.tasks[self._task].speed
        text = f"{speed_text(speed)}/s" if speed else ""
        self._bars.update(self._task, description=stage, completed=done, total=total, rate=text)

    def stop(self, *, finished: bool = False) -> None:
        """Leave the bars as they are; `finished`: the last stage has ended."""
        if self._lines and finished:
            self._end_stage()
        if self._bars is not None:
            self._bars.stop()


@claims()
def run_command(
    work: Callable[[Bars], T],
    text: Callable[[T], str],
    *,
    as_json: bool,
    quiet: bool,
    out: Path | None = None,
    at: tuple[str, str | None, int | None] = ("threads", None, None),
    stages: bool = False,
) -> T:
    """Do the work with progress bars, then print its result as JSON or the text made of it.

    Args:
        work: Makes the result, a dataclass of `cornerforge.results`.
        text: Makes of it what people read.
        as_json: Print JSON.
        quiet: Print no text.
        out: New file that the JSON goes to as well; for commands without output of their own.
        at: Where it is done: engine, address and workers of `cornerforge.engine`.
        stages: It may take minutes; without a terminal, say on standard error what each of its stages took.
    """
    from cornerforge._jit import announce_compiling
    from cornerforge.execution import engine
    from cornerforge.experiment.output import called_with, check_new_file, write_json
    from cornerforge.foreign.pace import announced
    from cornerforge.results import as_json as result_as_json

    if out is not None:
        check_new_file(out)
    bars = Bars(quiet, lines=stages)
    try:
        compiling = announce_compiling(lambda: None if quiet else typer.echo(compiling_text(), err=True))
        told = announced(lambda text: None if quiet else typer.echo(text, err=True))
        call = this_call()
        with (
            engine(at[0], address=at[1], workers=at[2]), compiling, told, called_with(call.stated()),
            call.finding_modules(),
        ):  # fmt: skip
            result = work(bars)
        bars.stop(finished=True)
    finally:
        bars.stop()
    content = result_as_json(result)
    if out is not None:
        write_json(out, content, checksum=False)
    if as_json:
        typer.echo(json.dumps(content, allow_nan=False))
    elif not quiet:
        typer.echo(text(result))
    return result


def compiling_text() -> str:
    """Why the first start takes so long, in one line."""
    from cornerforge._kernel_cache import cache_folder

    if cache_folder():
        return (
            "Compiling a part of the simulator that was not used before: half a minute, more on a busy machine; "
            "then it is kept."
        )
    return (
        "Compiling the simulator for this run only, half a minute or more: no folder for its machine code can be "
        "written; name one in NUMBA_CACHE_DIR."
    )


def speed_text(per_second: float) -> str:
    """A speed with as many digits as say something.

    >>> speed_text(12345.6), speed_text(3.14159), speed_text(0.01234)
    ('12,346', '3.1', '0.012')
    """
    return f"{per_second:,.0f}" if per_second >= 10.0 else f"{per_second:.2g}"


def rate_text(r: Rate | Filled, what: str) -> str:
    """A rate with its interval and its tests (or trees of them), per test and, where it is known, per mile."""
    from cornerforge.results import NaturalRate
    from cornerforge.results.rates import Rate

    low, high = r.interval95
    unit = {"splitting": "trees of tests", "is": "weighted tests"}
    method = r.method if isinstance(r, NaturalRate) else ""
    tests = f"{r.tests:,} {unit.get(method, 'tests')}"
    line = f"{what}: {r.crashes_per_test:.4g} crashes per test (95 % interval {low:.3g} to {high:.3g}, {tests})"
    if isinstance(r, Rate) and r.crashes_per_mile is not None:
        line += f", {r.crashes_per_mile:.4g} per mile" + ("" if method in unit else f" ({r.miles:,.0f} miles)")
    return line


def paid_text(r: Yield, reward: str | None) -> str:
    """Write how many crashes a reward pays for that is judged by cases, after a yield; "" under any other."""
    if r.paid_per_test is None or r.paid_interval95 is None or r.strictly_paid_per_test is None:
        return ""
    low, high = r.paid_interval95
    strictly = "AV alone at fault" if reward == "own-fault" else "by braking"
    return f"; {reward}: {r.paid_per_test:.4g} ({low:.3g} to {high:.3g}; {strictly} {r.strictly_paid_per_test:.4g})"


def yield_text(r: Yield, what: str, reward: str) -> str:
    """Write an adversary's yield, how much of it braking would have avoided, and in how many crashes the AV struck."""
    low, high = r.avoidable_interval95
    line = f"{rate_text(r, what)}, {r.avoidable_per_test:.4g} avoidable by braking ({low:.3g} to {high:.3g})"
    line += paid_text(r, reward)
    share = r.striking_share
    return line if share is None else f"{line}; the AV strikes in {100.0 * share:.1f} %"


def natural_text(r: Analysed) -> list[str]:
    """How often natural cases happen, kind by kind; nothing for cases of an adversary."""
    if r.natural is None:
        return []
    found = r.natural
    lines = [f"In natural traffic a crash {_miles(found.all)}; from {found.effective_cases:,.0f} effective cases:"]
    for what, kinds in (("cluster", found.clusters), ("type", found.crash_types), ("mechanism", found.mechanisms)):
        lines += [
            f"  {100.0 * kind.share:5.1f} %  {what} {name}: {_miles(kind)}, {kind.cases:,} cases"
            for name, kind in kinds.items()
        ]
    if found.avoidable is not None:
        after = f"{found.avoidable_after_s or 0.0:g} s after the manoeuvre began"
        lines.append(
            f"  {100.0 * found.avoidable.share:5.1f} %  avoidable by the AV, {after}: {_miles(found.avoidable)}"
        )
    lines.append(f"  A serious injury in the AV (MAIS 3 or more) {_miles(found.serious_injuries)}")
    return lines


def _miles(kind: NaturalKind) -> str:
    low, high = kind.interval95_miles
    text = f"once in {kind.miles_between:.3g} miles ({low:.3g} to {high:.3g})"
    return text.replace("e+0", "e").replace("e+", "e")


def wrong_text(natural: Analysed | None, adversary: Analysed | None) -> list[str]:
    """Say what the AV does wrong, by natural cases and by those of an adversary; "" where no judge looked."""
    told = [None if one is None else one.own_doing for one in (natural, adversary)]
    if told == [None, None]:
        return []
    from cornerforge.analysis.flaw import headline

    return [headline(*told)]


def judgement_text(r: Analysed) -> list[str]:
    """Fault, avoidability, coverage and the most valuable cases of an analysis."""
    lines = ["At fault (RSS): " + ", ".join(f"{who} {n:,}" for who, n in r.fault.items())]
    if r.prevented is not None:
        told = r.prevented
        shares = ", ".join(f"{name} {one.cases:,} ({one.by_braking:,})" for name, one in told.by.items())
        lines.append(
            f"Of {told.cases:,} cases reference drivers in the AV's place would have prevented (by braking): {shares}; "
            f"holding the speed is enough in {told.held:,}"
        )
    if r.judges is not None:
        lines += _judges_text(r.judges)
    if r.avoidability is not None:
        seen = r.avoidability
        labels = ", ".join(f"{label} {n:,}" for label, n in seen.labels.items() if n)
        lines.append(
            f"Ways out of {seen.cases:,} cases, {seen.reaction_s:g} s after the manoeuvre began or later: {labels}"
        )
    cover = r.coverage
    low, high = cover.unseen_kind_interval95
    lines.append(
        f"Kinds: {len(cover.cells)} seen, {len(cover.empty)} cells empty; chance that the next case is of a new "
        f"kind {cover.unseen_kind_chance:.2g} (95 % interval {low:.2g} to {high:.2g})"
    )
    if r.value.top:
        frequent = "typical of what happens most, " if r.purpose == "road" else ""
        lines.append(f"Worth a look first ({frequent}value: case: what happened):")
        lines += [f"  {one.value:.2f}: {one.case_id}: {one.text}" for one in r.value.top]
    return lines


def _judges_text(found: Judges) -> list[str]:
    """Write the share of avoidable crashes, first with a time to react, then by reaction time, and what judges say."""

    def shares(each: Sequence[ShareAtReaction]) -> str:
        return ", ".join(f"{one.reaction_s:g} s {100.0 * one.share:.1f}" for one in each)

    low, high = found.lead.interval95
    names = list(found.agreement)
    table = [
        f"  {row} {name:<22}"
        + "".join(
            f"{100.0 * (found.both[a][a] / found.cases if a == name else found.agreement[name][a]):6.1f}" for a in names
        )
        for row, name in enumerate(names, 1)
    ]
    return [
        f"Avoidable: {100.0 * found.lead.share:.1f} % (95 % interval {100.0 * low:.1f} to {100.0 * high:.1f} %, "
        f"{found.cases:,} cases) by an AV that reacts {found.lead.reaction_s:g} s after the manoeuvre began",
        f"  by its reaction time [%]: {shares(found.avoidable)}",
        *(f"  {name} prevents, by its own [%]: {shares(each)}" for name, each in found.prevented.items()),
        "Judges: cases that each calls preventable (diagonal), and of which two say the same [%]",
        "    " + " " * 22 + "".join(f"{number:6d}" for number in range(1, len(names) + 1)),
        *table,
    ]


def fault_text(av_faults: int) -> list[str]:
    """A line on tests that the AV spoiled, if it did."""
    if av_faults == 0:
        return []
    return [f"{av_faults:,} tests left out, because the AV raised, hung or gave no usable answer in them{_log_text()}."]


def training_fault_text(av_faults: int) -> list[str]:
    """A line on tests of a training that the AV spoiled, if it did."""
    if av_faults == 0:
        return []
    return [
        f"{av_faults:,} training tests abandoned, because the AV raised, hung or gave no usable answer in "
        f"them{_log_text()}."
    ]


def _log_text() -> str:
    from cornerforge.foreign.av_log import latest_log

    path = latest_log()
    return "" if path is None else f"; what it printed, and its tracebacks: {path}"
