"""The simulator: one AV and many background vehicles (BVs) on a straight highway, in compiled kernels.

What a newcomer should know, in the order of reading:

- `world`: all that the future of one test depends on; `snapshot` copies, stores and branches it.
- `setting`: what is constant in a run: road, AV, naturalistic model; who drives the AV, the critical BV, the others.
- `traffic`: puts a world at the start of a test, by (seed, test) alone.
- `advance`: the one loop. It moves a world until the test is over, a milestone is reached, or somebody outside the
  kernels must answer. Within it: `decide` (what BVs draw), `chances` (with which probability), `adversaries` (the
  hostile BV), `av`, `av_kinds` (built-in AVs), `step`, `actions`, `reach` (motion and contact), `neighbours`.
- `keep`: what stays of a drive (outcome, frames, decisions, counts: `statistics`); `scratch`: memory to work in.
- Callers of the loop: `drive`, `runner` (ranges of tests), `harvest` (cases), `recorder` (one test in full),
  `scripted` (given starts and actions), `lockstep` (AVs in other processes), `agents` (environments), `drive_bv` and
  `drive_av` (training, with `rewards`, `judge`, `braking`).
- Views: `observe` (of the adversary), `av_view` and `av_features` (of an AV).
- After a crash: `avoid`, `avoid_cases`, `avoid_check`, `avoid_motion` search for the ways out.

It knows no file, no learner and no plot. The same seed, test and setting give the same bits on any machine, for any
number of threads, through any of the callers (docs/design.md, ADR 20 and 21).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.sim.advance import (
        AV_MUST_ANSWER,
        BV_MUST_ANSWER,
        MILESTONE,
        NEVER,
        OVER,
        answer_as_av,
        answer_as_bv,
    )
    from cornerforge.sim.keep import Keep, keep_nothing, keep_whole_test
    from cornerforge.sim.recorder import Recorder
    from cornerforge.sim.rewards import REWARDS
    from cornerforge.sim.runner import Tally, simulate
    from cornerforge.sim.scratch import Scratch, allocate_scratch
    from cornerforge.sim.scripted import Script, ScriptDriver
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.snapshot import branch_of, copy_of, packed, unpacked
    from cornerforge.sim.traffic import reset_world
    from cornerforge.sim.world import World, allocate_worlds, world_of

__all__ = [
    "AV_MUST_ANSWER",
    "BV_MUST_ANSWER",
    "MILESTONE",
    "NEVER",
    "OVER",
    "REWARDS",
    "Keep",
    "Recorder",
    "Scratch",
    "Script",
    "ScriptDriver",
    "Setting",
    "Tally",
    "World",
    "allocate_scratch",
    "allocate_worlds",
    "answer_as_av",
    "answer_as_bv",
    "branch_of",
    "copy_of",
    "keep_nothing",
    "keep_whole_test",
    "packed",
    "reset_world",
    "simulate",
    "unpacked",
    "world_of",
]

__getattr__ = door(
    "cornerforge.sim",
    {
        "AV_MUST_ANSWER": "advance",
        "BV_MUST_ANSWER": "advance",
        "MILESTONE": "advance",
        "NEVER": "advance",
        "OVER": "advance",
        "REWARDS": "rewards",
        "Keep": "keep",
        "Recorder": "recorder",
        "Scratch": "scratch",
        "Script": "scripted",
        "ScriptDriver": "scripted",
        "Setting": "setting",
        "Tally": "runner",
        "World": "world",
        "allocate_scratch": "scratch",
        "allocate_worlds": "world",
        "answer_as_av": "advance",
        "answer_as_bv": "advance",
        "branch_of": "snapshot",
        "copy_of": "snapshot",
        "keep_nothing": "keep",
        "keep_whole_test": "keep",
        "packed": "snapshot",
        "reset_world": "traffic",
        "simulate": "runner",
        "unpacked": "snapshot",
        "world_of": "world",
    },
)
