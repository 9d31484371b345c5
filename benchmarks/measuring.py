"""Repeated, interleaved measurements and what is said of them: median, smallest, largest."""

from __future__ import annotations

import os
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass

__all__ = ["Series", "interleave", "on_one_core", "ratio", "table"]


@dataclass(frozen=True)
class Series:
    """One number measured several times.

    Attributes:
        unit: For people.
        values: In the order of measurement.
    """

    unit: str
    values: tuple[float, ...]

    @property
    def median(self) -> float:
        return statistics.median(self.values)

    def to_json(self) -> dict[str, object]:
        return {**asdict(self), "median": self.median, "min": min(self.values), "max": max(self.values)}

    def cells(self) -> tuple[str, str, str]:
        """Median, smallest, largest, to three figures or so."""
        return _figure(self.median), _figure(min(self.values)), _figure(max(self.values))


def _figure(value: float) -> str:
    """Three significant digits or more, thousands apart, never an exponent."""
    size = abs(value)
    if size >= 100.0:
        return f"{value:,.0f}"
    digits = 1 if size >= 10.0 else 2 if size >= 1.0 else 3
    return f"{value:.{digits}f}"


def ratio(numerator: Series, denominator: Series) -> Series:
    """Ratios of values measured one right after the other: what slows both at once cancels."""
    return Series("x", tuple(a / b for a, b in zip(numerator.values, denominator.values, strict=True)))


def interleave(repetitions: int, measurements: Mapping[str, Callable[[], float]], unit: str) -> dict[str, Series]:
    """Take all measurements by turns (first, second, ..., first, second, ...), so many rounds."""
    values: dict[str, list[float]] = {name: [] for name in measurements}
    for _ in range(repetitions):
        for name, measure in measurements.items():
            values[name].append(measure())
    return {name: Series(unit, tuple(taken)) for name, taken in values.items()}


@contextmanager
def on_one_core() -> Iterator[bool]:
    """Keep this thread, and the threads that it starts meanwhile, on one core; tells whether the system can do that."""
    if not hasattr(os, "sched_setaffinity"):
        yield False
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})  # the last one: interrupts mostly go to the first
    try:
        yield True
    finally:
        os.sched_setaffinity(0, allowed)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; all columns but the first are numbers."""
    rule = ["---"] + ["---:"] * (len(head) - 1)
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, rule, *rows))
