"""Bulk simulation: ranges of tests in a thread pool, the same outcome for any number of threads and any chunk size."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._checks import check_integer
from cornerforge.fields import FRAME_FIELDS
from cornerforge.sim.drive import drive_range, drive_windows
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.outcome import AV_CRASH, AV_FAULT, LEFT_ROAD, Outcomes, allocate_outcomes
from cornerforge.sim.scratch import allocate_scratch, warn_of_left_out
from cornerforge.sim.setting import Setting
from cornerforge.sim.statistics import Census, Counts, allocate_counts, census_of
from cornerforge.sim.traffic import naming_tests
from cornerforge.sim.world import allocate_worlds, world_of
from cornerforge.types import METRES_PER_MILE
from cornerforge.work import in_order

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "DriveChunk",
    "Tally",
    "Windows",
    "allocate_windows",
    "crashed_tests",
    "drive_chunk",
    "drive_chunk_by_window",
    "simulate",
    "simulate_chunks",
    "warm_up",
]

DriveChunk = Callable[[Setting, int, int, int, int, "bool | Census"], tuple[Outcomes, Counts]]
"""A function that drives a range of tests, called as `drive_chunk` is, from several threads at once."""

_CHUNK = 512
_DIGESTED = np.dtype(
    [
        ("code", "u1"),
        ("frame", "<i4"),
        ("slot_a", "<i2"),
        ("slot_b", "<i2"),
        ("bv_crashes", "<i2"),
        ("distance", "<f8"),
    ]
)
"""One test in the digest of a `Tally`; because it covers test by test, the digest does not depend on chunks."""


@dataclass
class Tally:
    """Sums over tests, in test order.

    Attributes:
        tests, av_crashes, bv_crashes, decisions: Counts; `bv_crashes` counts contacts between two BVs.
        av_faults: Tests with the outcome AV_FAULT; they are not among `tests`.
        left_road: Tests that ended because the AV drove on where its lane had ended.
        millimetres: Distance that the AV drove, rounded for each test so that the sum does not depend on the order.
        digest: SHA-256 over all outcomes, fed in test order.
        counts: Histograms, if counting was asked for.
    """

    tests: int = 0
    av_crashes: int = 0
    bv_crashes: int = 0
    av_faults: int = 0
    left_road: int = 0
    decisions: int = 0
    millimetres: int = 0
    digest: hashlib._Hash = field(default_factory=hashlib.sha256)
    counts: Counts = field(default_factory=allocate_counts)

    @property
    def miles(self) -> float:
        """Distance that the AV drove [miles]."""
        return self.millimetres / 1000.0 / METRES_PER_MILE

    def add(self, out: Outcomes, counts: Counts) -> None:
        """Add one chunk; chunks must come in test order for the digest."""
        faults = int((out.code == AV_FAULT).sum())
        self.tests += out.code.size - faults
        self.av_faults += faults
        self.av_crashes += int((out.code == AV_CRASH).sum())
        self.left_road += int((out.code == LEFT_ROAD).sum())
        self.bv_crashes += int(out.bv_crashes.sum())
        self.decisions += int(out.decisions.sum())
        millimetres = np.rint(out.distance * 1000.0).astype(np.int64)
        self.millimetres += int(millimetres.sum())
        rows = np.zeros(out.code.size, dtype=_DIGESTED)
        for name in _DIGESTED.names or ():
            rows[name] = getattr(out, name)
        self.digest.update(rows.tobytes())
        self.counts.add(counts)


class Windows(NamedTuple):
    """Records of tests with windows of time that are counted apart.

    Attributes:
        until: Ends of the windows, rising [s], (W,); the first begins at 0, each other one where the last ended.
        counts: Counts with a leading axis of W.
        states: The first tests after 0, 1, ... whole seconds, (tests, seconds, N) of `fields.FRAME_FIELDS`, all absent
            before; with 0 tests nothing is noted.
        lengths: Lengths of the vehicles of the same tests [m], (tests, N).
    """

    until: NDArray[np.int64]
    counts: Counts
    states: NDArray[np.void]
    lengths: NDArray[np.float64]


def allocate_windows(until: NDArray[np.int64], noted: int, slots: int) -> Windows:
    """Allocate windows with these ends, and the states of `noted` tests of `slots` vehicles."""
    states = np.zeros((noted, int(until[-1]), slots), dtype=FRAME_FIELDS)
    return Windows(until, allocate_counts(until.size), states, np.zeros((noted, slots)))


def drive_chunk(
    setting: Setting, slots: int, seed: int, first: int, count: int, counting: bool | Census
) -> tuple[Outcomes, Counts]:
    """Drive `count` tests from `first` on, with the GIL released.

    `counting`: True for all BVs at all times, False for none, or a census.
    """
    out, counts = allocate_outcomes(count), allocate_counts()
    scratch = allocate_scratch(slots, setting.who.policy)
    world, keep = (
        world_of(allocate_worlds(1, slots, setting.road)),
        keep_nothing(slots, counts=counts, census=census_of(counting)),
    )
    with naming_tests(world):
        drive_range(seed, first, setting, world, scratch, keep, out)
    warn_of_left_out(scratch)
    return out, counts


def drive_chunk_by_window(
    setting: Setting, slots: int, seed: int, first: int, count: int, census: Census, windows: Windows
) -> Outcomes:
    """Drive like `drive_chunk`, and count windows of time apart.

    `census`: which BVs are counted; its times are not used. `windows`: what is kept is added to it.
    """
    out = allocate_outcomes(count)
    world, scratch = (
        world_of(allocate_worlds(1, slots, setting.road)),
        allocate_scratch(slots, setting.who.policy),
    )
    with naming_tests(world):
        drive_windows(seed, first, setting, world, scratch, keep_nothing(slots, census=census), windows, out)
    return out


def warm_up(setting: Setting, slots: int) -> None:
    """Load the compiled kernels, or compile them (once per installation), so that timings do not count it."""
    drive_chunk(setting, slots, 0, 0, 0, False)


def simulate_chunks(
    setting: Setting,
    slots: int,
    *,
    seed: int,
    first: int,
    tests: int,
    threads: int,
    counting: bool | Census = False,
    chunk: int = _CHUNK,
    drive: DriveChunk = drive_chunk,
) -> Generator[tuple[int, Outcomes, Counts], None, None]:
    """Drive tests in a thread pool and yield (first test, outcomes, counts) per chunk, in test order.

    Results do not depend on `threads` or `chunk`. `counting` and `drive` are as in `simulate`. Closing the iterator
    early drops the chunks not yet yielded.
    """

    def work(start: int, count: int) -> tuple[int, Outcomes, Counts]:
        return start, *drive(setting, slots, seed, start, count, counting)

    return in_order(work, first, tests, chunk=chunk, threads=threads)


def simulate(
    setting: Setting,
    slots: int,
    *,
    seed: int,
    tests: int,
    first: int = 0,
    threads: int = 1,
    counting: bool | Census = False,
    progress: Callable[[int], None] | None = None,
    drive: DriveChunk = drive_chunk,
) -> Tally:
    """Drive tests and sum them up.

    Args:
        setting: The run.
        slots: Vehicle slots per world (`world.n_slots`).
        seed: 0 to 2^63 - 1.
        tests: How many, at least 1.
        first: Number of the first test.
        threads: Pool size; does not change the result.
        counting: Fill the histograms too (slower): True for all BVs at all times, or a census.
        progress: Called with the number of tests done after each chunk.
        drive: Drives a chunk; `drive_chunk`, unless the AV decides outside the kernels.

    Raises:
        InputError: A number is out of range.
    """
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("tests", tests, low=1, high=10**12)
    check_integer("first", first, low=0, high=2**62)
    tally = Tally()
    for _, out, counts in simulate_chunks(
        setting, slots, seed=seed, first=first, tests=tests, threads=threads, counting=counting, drive=drive
    ):
        tally.add(out, counts)
        if progress is not None:
            progress(tally.tests + tally.av_faults)
    return tally


def crashed_tests(first: int, out: Outcomes) -> list[int]:
    """Numbers of the tests of a chunk in which the AV crashed, in order."""
    return [first + int(k) for k in np.flatnonzero(out.code == AV_CRASH)]
