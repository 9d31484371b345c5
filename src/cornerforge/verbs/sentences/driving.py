"""Results of driving and of learning as text: `simulate`, `avs`, `check-av`, `train`, `train-av`."""

from __future__ import annotations

from cornerforge._words import few_digits, spoken
from cornerforge.results import AvChecked, Avs, Simulated, Trained, TrainedAv
from cornerforge.results.driving import Quantity
from cornerforge.verbs.sentences.numbers import ABANDONED, fault_text, rate_text, yield_text

__all__ = ["avs_text", "check_av_failed", "check_av_text", "simulate_text", "train_av_text", "train_text"]


def simulate_text(found: Simulated) -> str:
    """Write the rate, the counts, the speed and, where they were asked for, the distributions of the traffic."""
    left = f"in {found.left_road:,} tests the AV left the road; " if found.left_road else ""
    lines = [
        rate_text(found, f"{found.av}, {' + '.join(found.bv or ())}"),
        f"{found.av_crashes:,} AV crashes, {found.bv_crashes:,} crashes between BVs; {left}"
        f"{few_digits(found.tests_per_second)} tests/s, {few_digits(found.world_steps_per_second)} world-steps/s; "
        f"digest {found.digest[:16]}",
        *fault_text(found.av_faults),
    ]
    for name, d in () if found.distributions is None else vars(found.distributions).items():
        if isinstance(d, Quantity) and d.n:
            q = "  ".join(f"{v:g}" for v in d.quantiles.values())
            lines.append(f"{name:>14} [{d.unit}]: mean {d.mean:.3f}, sd {d.sd:.3f}; 1 5 25 50 75 95 99 %: {q}")
        else:
            lines.append(f"{name:>14}: {'none' if isinstance(d, Quantity) else d}")
    return "\n".join(lines)


def avs_text(found: Avs) -> str:
    """Write a line for each AV."""
    return "\n".join(f"{one.name:<20}{one.about}" for one in found.avs)


def check_av_text(found: AvChecked) -> str:
    """Write what each trial found, how fast the AV answers, and what that means for jobs."""
    lines, told = [], set[str]()
    for check in found.checks:
        lines.append(f"{check.verdict:<5}{check.name}: {check.found}")
        if check.trace and check.trace not in told:  # once, though many trials end in it
            lines += [f"       {line}" for line in check.trace.splitlines()]
            told.add(check.trace)
    lines += [
        f"speed, {one.worlds:>4} worlds: {few_digits(one.calls_per_second)} calls/s, "
        f"{few_digits(one.decisions_per_second)} decisions/s"
        for one in found.speed
    ]
    if found.does is not None:
        lines.append(
            f"about {spoken(found.does.answer_seconds)} for an answer, {found.does.batch} world(s) at a time, "
            f"{found.does.processes} process(es): {few_digits(found.does.tests_per_hour)} tests/h, "
            f"{few_digits(found.does.decisions_per_hour)} training decisions/h; {found.does.advice}"
        )
    lines += [f"what it printed, and its tracebacks: {found.log}"] if found.log else []
    may = f"it may do what you may; memory: {found.memory_gb:.3g} GB a process"
    return "\n".join([f"{found.av} ({found.kind}, {found.hash})", may, *lines])


def check_av_failed(found: AvChecked) -> str | None:
    """Say that the command fails, which its text has told already; None if all trials passed."""
    return None if found.passed else ""


def train_text(found: Trained) -> str:
    """Write the yields of the adversary and of plain ones, and where the policy is."""
    lines = [yield_text(found, "Adversary", found.reward)]
    lines += [yield_text(one, f"{one.name:>21}", found.reward) for one in found.baselines]
    lines += fault_text(found.av_faults, ABANDONED)
    return "\n".join([*lines, f"{found.decisions:,} decisions in {found.seconds:.0f} s; policy: {found.out}"])


def train_av_text(found: TrainedAv) -> str:
    """Write how often the AV crashes in natural traffic, how fast it drives, and where it is."""
    return "\n".join(
        [
            rate_text(found, "Natural traffic"),
            f"Mean speed {found.mean_speed:.1f} m/s",
            f"{found.decisions:,} s of driving in {found.seconds:.0f} s; AV: {found.out}",
        ]
    )
