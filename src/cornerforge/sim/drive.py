"""Whole tests, one or a range, driven by `advance` in compiled kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.advance import NEVER, advance
from cornerforge.sim.keep import write_outcome
from cornerforge.sim.traffic import reset_world

if TYPE_CHECKING:
    from cornerforge.sim.keep import Keep, Outcomes
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = ["drive_range", "drive_test"]


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
