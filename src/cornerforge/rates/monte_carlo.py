"""Natural crash rates by brute force: blocks of tests, and a count that can be resumed."""

from __future__ import annotations

import contextlib
import hashlib
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import pairwise
from typing import Annotated, Any, Self

from cornerforge._schema import Whole, meant, read
from cornerforge.errors import FileFormatError
from cornerforge.intervals import binomial_interval
from cornerforge.sim import Setting, Tally, outcome, runner, statistics
from cornerforge.types import METRES_PER_MILE
from cornerforge.work import cpu_seconds

__all__ = ["BLOCK", "CHUNK", "Block", "MonteCarlo", "drive_block", "drive_blocks", "relative_half_width"]

BLOCK = 65_536
"""Tests between two saved states. The digest is a chain over blocks of this size, so the size must not change."""
CHUNK = 2048
"""Tests that one thread drives in a row, unless the AV is slow."""


def relative_half_width(low: float, high: float, estimate: float) -> float | None:
    """Divide half the interval's width by the estimate; None where the estimate is 0.

    >>> relative_half_width(0.5, 1.5, 1.0)
    0.5
    """
    return None if estimate == 0.0 else 0.5 * (high - low) / estimate


@dataclass(frozen=True)
class Block:
    """Counts over consecutive tests.

    Attributes:
        tests, bv_crashes, decisions: Counts; `bv_crashes` counts contacts between two BVs.
        millimetres: Distance that the AV drove [mm].
        seconds, cpu_seconds: Wall-clock, and time on processors over all threads and workers [s].
        crashed: Numbers of the tests in which the AV crashed, rising.
        digest: SHA-256 over the outcomes.
        av_faults: Number of `tests` that a foreign AV spoiled.
    """

    tests: Whole
    bv_crashes: Whole
    decisions: Whole
    millimetres: Whole
    seconds: float
    cpu_seconds: float
    crashed: tuple[Whole, ...]
    digest: str
    av_faults: Whole = 0

    @classmethod
    def of(cls, tally: Tally, begun: tuple[float, float], now: float, crashed: Sequence[int], **more: Any) -> Self:
        """Make a block of the sums over its tests.

        Args:
            tally: The sums.
            begun: Clock and `cpu_seconds` at its begin [s].
            now: The clock [s].
            crashed: Numbers of the tests in which the AV crashed, rising.
            more: Further fields, of a subclass.
        """
        return cls(
            tests=tally.tests + tally.av_faults, bv_crashes=tally.bv_crashes, decisions=tally.decisions,
            millimetres=tally.millimetres, seconds=now - begun[0], cpu_seconds=cpu_seconds() - begun[1],
            crashed=tuple(crashed), digest=tally.digest.hexdigest(), av_faults=tally.av_faults, **more,
        )  # fmt: skip


def drive_blocks(
    setting: Setting,
    slots: int,
    *,
    seed: int,
    first: int,
    tests: int,
    threads: int,
    block: int = BLOCK,
    tell: Callable[[int, int], None] | None = None,
    drive: runner.DriveChunk = runner.drive_chunk,
    chunk: int = CHUNK,
) -> Generator[Block, None, None]:
    """Drive tests `first` .. `first` + `tests` - 1 of a seed, and yield them block by block; the last may be smaller.

    No thread waits at the end of a block: the next block's tests are driven while this block's are added up.

    Args:
        setting, slots: The run and its vehicle slots per world.
        seed, first, tests: Which tests.
        threads: Pool size; does not change the result.
        block: Tests in a block.
        tell: Called with the tests and the AV crashes of the present block so far, about ten times a second.
        drive: Function that drives a chunk (`sim.runner.simulate`).
        chunk: Tests that one thread drives in a row at most; does not change the result.
    """
    chunk = min(chunk, block)
    while block % chunk:  # a block ends where a chunk does
        chunk -= 1
    chunks = runner.simulate_chunks(
        setting, slots, seed=seed, first=first, tests=tests, threads=threads, chunk=chunk, drive=drive
    )
    with contextlib.closing(chunks):  # an interrupt between two chunks must not leave the pool at work
        for begun in range(first, first + tests, block):
            yield _block(chunks, begun, min(block, first + tests - begun), tell)


def _block(
    chunks: Iterator[tuple[int, outcome.Outcomes, statistics.Counts]],
    first: int,
    tests: int,
    tell: Callable[[int, int], None] | None,
) -> Block:
    """Add up the chunks of a block."""
    started, tally = (time.perf_counter(), cpu_seconds()), Tally()
    crashed: list[int] = []
    while (done := tally.tests + tally.av_faults) < tests:
        begin, outcomes, counts = next(chunks)
        assert begin == first + done
        tally.add(outcomes, counts)
        crashed += runner.crashed_tests(begin, outcomes)
        if tell is not None:
            tell(tally.tests + tally.av_faults, len(crashed))
    return Block.of(tally, started, time.perf_counter(), crashed)


def drive_block(
    setting: Setting,
    slots: int,
    *,
    seed: int,
    first: int,
    tests: int,
    threads: int,
    tell: Callable[[int, int], None] | None = None,
    drive: runner.DriveChunk = runner.drive_chunk,
) -> Block:
    """Drive tests `first` .. `first` + `tests` - 1 of a seed as one block; arguments as of `drive_blocks`."""
    (only,) = drive_blocks(
        setting, slots, seed=seed, first=first, tests=tests, threads=threads, block=tests, tell=tell, drive=drive
    )
    return only


@dataclass(frozen=True)
class MonteCarlo:
    """Counts of a brute-force run so far, over tests 0 .. `tests` - 1 of its seed; `counts.json` holds them."""

    tests: Annotated[Whole, meant("Tests driven, from number 0 on.")] = 0
    av_crashes: Annotated[Whole, meant("Tests in which the AV crashed; as many as `crashed` holds.")] = 0
    bv_crashes: Annotated[Whole, meant("Contacts between two BVs.")] = 0
    world_steps: Annotated[Whole, meant("Steps of 0.1 s that worlds were moved.")] = 0
    millimetres: Annotated[Whole, meant("Distance that the AV drove.", "mm")] = 0
    seconds: Annotated[float, meant("Wall-clock time, over all sessions.", "s", 0.0, 1e12)] = 0.0
    cpu_seconds: Annotated[float, meant("Time on processors, over all sessions.", "s", 0.0, 1e12)] = 0.0
    crashed: Annotated[
        tuple[Whole, ...], meant("Numbers of the tests in which the AV crashed, rising, below `tests`.")
    ] = ()
    digest: Annotated[str, meant("Chain of SHA-256: each block's digest hashed onto the chain before it.")] = ""
    av_faults: Annotated[Whole, meant("Tests that an AV from outside spoiled: driven, but they do not count.")] = 0

    def plus(self, block: Block) -> MonteCarlo:
        """Add one more block, which must begin at test number `tests`."""
        return replace(
            self,
            tests=self.tests + block.tests,
            av_crashes=self.av_crashes + len(block.crashed),
            bv_crashes=self.bv_crashes + block.bv_crashes,
            world_steps=self.world_steps + block.decisions,
            millimetres=self.millimetres + block.millimetres,
            seconds=self.seconds + block.seconds,
            cpu_seconds=self.cpu_seconds + block.cpu_seconds,
            crashed=self.crashed + block.crashed,
            digest=hashlib.sha256((self.digest + block.digest).encode()).hexdigest(),
            av_faults=self.av_faults + block.av_faults,
        )

    @property
    def valid_tests(self) -> int:
        """Number of tests that count: the AV did not spoil them."""
        return self.tests - self.av_faults

    @property
    def miles(self) -> float:
        """Distance that the AV drove [miles]."""
        return self.millimetres / 1000.0 / METRES_PER_MILE

    def half_width(self) -> float | None:
        """Relative half-width of the exact 95 % interval; None without tests or crashes."""
        if self.av_crashes == 0 or self.valid_tests == 0:
            return None
        low, high = binomial_interval(self.av_crashes, self.valid_tests)
        return relative_half_width(low, high, self.av_crashes / self.valid_tests)

    def is_enough(self, target: float) -> bool:
        """Say whether the relative half-width of the exact 95 % interval is at most `target`."""
        width = self.half_width()
        return width is not None and width <= target

    def to_json(self) -> dict[str, Any]:
        """All counts, JSON-compatible."""
        return {**asdict(self), "crashed": list(self.crashed)}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> MonteCarlo:
        """The inverse of `to_json`.

        Raises:
            FileFormatError: Keys are missing or unknown, a value is out of its range, or counts contradict each other.
        """
        place = "These are not the counts of a rate estimate"
        if odd := set(content) ^ {one.name for one in fields(cls)}:
            raise FileFormatError(f'{place}: "{min(odd)}" is {"unknown" if min(odd) in content else "missing"}.')
        counts = read(cls, content, place)
        rising = all(a < b for a, b in pairwise((-1, *counts.crashed, counts.tests)))
        too_many = counts.av_faults + counts.av_crashes > counts.tests
        if counts.av_crashes != len(counts.crashed) or not rising or too_many:
            raise FileFormatError(f"{place}: they contradict each other.")
        return counts
