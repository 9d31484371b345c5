"""Whole tests, one or a range, driven by `advance` in compiled kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.keep import Keep
from cornerforge.sim.loop import NEVER, advance, linked_advance
from cornerforge.sim.outcome import RUNNING, write_outcome
from cornerforge.sim.statistics import Census, Counts, count_travel
from cornerforge.sim.step import record_frame
from cornerforge.sim.traffic import linked_reset_world, reset_world

if TYPE_CHECKING:
    from cornerforge.sim.outcome import Outcomes
    from cornerforge.sim.runner import Windows
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
        linked_reset_world(w, seed, first + k, setting)
        linked_advance(w, setting, s, keep, NEVER)
        write_outcome(w, out, k, setting.road)


@kernel
def drive_windows(
    seed: int, first: int, setting: Setting, w: World, s: Scratch, keep: Keep, windows: Windows, out: Outcomes
) -> None:
    """Drive tests like `drive_range`, and count each window of time by itself.

    Args:
        seed, first: The tests.
        setting: The run.
        w, s: A world and scratch to drive in.
        keep: Neither frames nor decisions; its census says which BVs are counted, not when.
        windows: What is kept.
        out: How each ended.
    """
    census, counts, until = keep.census, windows.counts, windows.until
    for k in range(out.code.size):
        reset_world(w, seed, first + k, setting)
        noted = k < windows.states.shape[0]
        if noted:
            for i in range(w.vehicles.size):
                windows.lengths[k, i] = w.vehicles[i].length
        for window in range(until.size):
            begin = until[window - 1] if window > 0 else 0
            row = Counts(
                counts.histograms[window], counts.joint[window], counts.cut_ins[window], counts.pairs[window],
                counts.totals[window],
            )  # fmt: skip
            kept = Keep(
                keep.recording, keep.decisions, keep.chances, row,
                Census(True, begin, until[window], census.low, census.high, census.drift),
            )  # fmt: skip
            for second in range(begin, until[window]):
                if noted and w.state[0].outcome == RUNNING:
                    record_frame(w, second, windows.states[k])
                advance(w, setting, s, kept, second + 1)
            count_travel(w, row)
        write_outcome(w, out, k, setting.road)
