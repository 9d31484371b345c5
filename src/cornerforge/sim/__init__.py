"""The simulator: one AV and many background vehicles (BVs) on a straight highway, in compiled kernels.

One function moves everything: `advance.advance(world, setting, scratch, keep, until)`. Its arguments, then the modules
around it, in the order of reading:

- A *world* (`world.World`) is all that the future of one test depends on. `traffic.reset_world` puts it at the start of
  a test, which (seed, test) and the setting determine. `snapshot` copies, stores and branches it.
- A *setting* (`setting.Setting`) is constant in a run: road, AV, naturalistic model and controllers. The *controllers*
  (`Setting.who`) say what drives the AV, the critical BV (the one nearest to the AV) and the other BVs: a built-in law,
  the naturalistic model, an adversary, a script, or somebody outside the kernels.
- *Scratch* (`scratch.Scratch`) is memory to work in; nothing in it outlives a call.
- *Keep* (`keep.Keep`) is what stays of a drive besides its outcome: frames, decisions, counts (`statistics`).
- `advance` is the one loop. It returns when the test is over, when `until` seconds have passed (a milestone), or when
  somebody outside must answer; the answer goes into the world, and the next `advance` goes on from there.
- Within the loop: `decide` (what BVs draw), `chances` (with which probability), `adversaries` (the critical BV), `av`
  and `av_kinds` (built-in AVs), `actions`, `step` and `reach` (motion and contact), `neighbours`.
- Views: `observe` (the adversary's), `av_view` and `av_features` (an AV's).
- Thin callers of the loop: `drive` (whole tests), `scripted` (given starts and actions), `lockstep` (AVs in other
  processes), `agents` (environments), `drive_bv` and `drive_av` (training the adversary and the AV).
- Callers of `drive`: `runner` (ranges of tests in threads), `harvest` (cases), `recorder` (one test in full), `judge`
  (crashes driven again).
- About recorded crashes: `rewards` and `braking` (what the adversary is paid for).

The package gives the names that a user of the simulator needs (`__all__`); the other layers of cornerforge import from
the modules. It knows no file, no learner and no plot. The same seed, test and setting give the same bits on any
machine, for any number of threads, through any of the callers (docs/design.md, ADR 20 and 21).
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
    from cornerforge.sim.scratch import Scratch, allocate_scratch, warn_of_left_out
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
    "warn_of_left_out",
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
        "warn_of_left_out": "scratch",
        "world_of": "world",
    },
)
