"""Whole tests, one or a range, driven by `advance` in compiled kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.advance import NEVER, advance
from cornerforge.sim.keep import Keep, write_outcome
from cornerforge.sim.statistics import Census, Counts, count_travel
from cornerforge.sim.step import record_frame
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import RUNNING

if TYPE_CHECKING:
    from numpy import float64, int64, void
    from numpy.typing import NDArray

    from cornerforge.sim.keep import Outcomes
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = ["drive_range", "drive_test", "drive_windows"]


@inlined_kernel
def drive_test(w: World, seed: int, test: int, setting: Setting, s: Scratch, keep: Keep) -> None:
    """Drive one test from its start to its end; all its controllers must be inside the kernels.

    Where decisions are kept the critical BV is noted in natural tests too; it is controlled only when the setting has
    an adversary.
    """
    reset_world(w, seed, test, setting)
    advance(w, setting, s, keep, NEVER)


@kernel
def drive_range(seed: int, first: int, setting: Setting, w: World, s: Scratch, keep: Keep, out: Outcomes) -> None:
    """Drive tests first, first + 1, ... of a seed one after the other, as many as `out` has entries.

    Args:
        seed, first: The tests.
        setting: The run.
        w, s: A world and scratch to drive in.
        keep: Counts of all of them; neither frames nor decisions.
        out: How each ended.
    """
    for k in range(out.code.size):
        drive_test(w, seed, first + k, setting, s, keep)
        write_outcome(w, out, k, setting.road)


@kernel
def drive_windows(
    seed: int, first: int, setting: Setting, w: World, s: Scratch, keep: Keep, until: NDArray[int64], counts: Counts,
    states: NDArray[void], lengths: NDArray[float64], out: Outcomes,
) -> None:  # fmt: skip
    """Drive tests like `drive_range`, and count each window of time by itself.

    Args:
        seed, first: The tests.
        setting: The run.
        w, s: A world and scratch to drive in.
        keep: Neither frames nor decisions; its census says which BVs are counted, not when.
        until: Ends of the windows, rising [s], (W,); the first begins at 0, each other one where the last ended.
        counts: Counts with a leading axis of W.
        states: The first tests after 0, 1, ... whole seconds, (tests, seconds, N) of `fields.FRAME_FIELDS`, all absent
            before; with 0 tests nothing is noted.
        lengths: Of the vehicles of the same tests [m], (tests, N).
        out: How each ended.
    """
    census = keep.census
    for k in range(out.code.size):
        reset_world(w, seed, first + k, setting)
        if k < states.shape[0]:
            for i in range(w.vehicles.size):
                lengths[k, i] = w.vehicles[i].length
        for window in range(until.size):
            begin = until[window - 1] if window > 0 else 0
            row = Counts(counts.histograms[window], counts.joint[window], counts.cut_ins[window], counts.totals[window])
            kept = Keep(
                keep.recording, keep.decisions, keep.chances, row,
                Census(True, begin, until[window], census.low, census.high, census.drift),
            )  # fmt: skip
            for second in range(begin, until[window]):
                if k < states.shape[0] and w.state[0].outcome == RUNNING:
                    record_frame(w, second, states[k])
                advance(w, setting, s, kept, second + 1)
            count_travel(w, row)
        write_outcome(w, out, k, setting.road)
