"""The simulator: one AV and many background vehicles (BVs) on a highway or at a site, in compiled kernels.

One function moves everything: `advance(world, setting, scratch, keep, until)`. This file is the door: other packages
of cornerforge take its names and nothing else (`tests/test_rooms.py`). Programs of others may rely on the names of
`FOR_PROGRAMS` (`tests/public_api.txt`); the rest may change at any time. In the order in which a reader needs them:

- *World*, all that the future of one test depends on. `World`; `allocate_worlds` makes idle ones, `world_of` and, for
  kernels, `world_row` take one of them, `n_slots` says how many vehicles have room. `reset_world` puts it at the start
  of a test, which (seed, test) and the setting determine; `naming_tests` names the test that cannot be drawn. `outcome`
  (a module) has the codes of how it stands and ended; `ALL_OF_THEM`, where a slot would be, says that a driver at a
  site overlooks all, `NO_VEHICLE` that there is none. `copy_of`, `branch_of` (up to `MAX_BRANCH`), `packed` and
  `unpacked` copy, branch and store it at any moment; `moment_of` numbers the moment for random words.
- *Setting*, constant in a run. `Setting`: road, AV, naturalistic model and controllers; `controllers` (a module) says
  what drives the AV, the critical BV (the BV nearest to the AV) and the other BVs.
- *Advance*. `advance` is the one loop. It returns when the test is over (`OVER`), after `until` seconds of the test
  (`MILESTONE`; `NEVER` for none), or when a program outside must answer (`AV_MUST_ANSWER`, `BV_MUST_ANSWER`): it looks
  (`look_as_bv`), it answers (`answer_as_av`, `answer_as_bv`), and the next `advance` goes on from there. `Scratch` of
  `allocate_scratch` is working memory, worthless between calls; `warn_of_left_out` warns if it had too little room.
- *Keep*, what stays of a drive besides its outcome. `Keep`: `keep_nothing`, `keep_whole_test`; `allocate_recording`
  and `forget_frames` are for frames alone, `statistics` (a module) counts. `all_current` and `bring_up_to_date`
  serve callers that look at vehicles which the loop moves only once a second.
- *Drive*: thin callers of the loop. `simulate` sums tests up in a `Tally`, `runner` has its parts; `Recorder` records
  one test in full, `recorder` makes cases of it, `harvest` collects cases in bulk; `ScriptDriver` drives a `Script`
  (`scripted`, `rails`); `lockstep` is for AVs in other processes. `perceived` says where an AV saw others in a
  recording, `hidden_by` which vehicle hid them from it at a site.
- *Views*: sizes and versions of what is seen by the adversary (`observe`), by an AV (`av_view`, `av_scene`), and by
  the learned AV (`av_features`).
- *Parts* of a second, for kernels of other packages: `perception` shows a world as the AV sees it; then
  `built_in_av_decides` is asked, and `av_decide` for the plain AV; `choose_action` for plain adversaries and policies;
  `chances` of each action, `steering` of the words that draw it; `neighbours`; `actions` as they begin, `motion`, and
  `bicycle` of an AV that steers. At sites `look_around` lets an agent look, `away_chance` says how likely a driver
  looks away in the coming second, and `meeting_with_av` where and when an agent's way meets the AV's.

Worlds to learn in are in `adversary.worlds`, weighted tests in `rates.branching`, questions about recorded crashes in
`counterfactual`.

Inside, in the order of reading: `world`, `outcome`, `traffic`, `snapshot` (with `world_values`); `controllers`,
`setting`; `scratch`; `keep`; `loop`. Within the loop: `decide` (what BVs draw; `steering`), `chances` (with which
probability; `trucks`, `braking`, `merging`), `adversaries` (the critical BV), `av`, `av_kinds` and `av_flawed`
(built-in AVs), `actions`, `motion`, `bicycle`, `rails`, `step` and `reach` (contact), `neighbours`, `sight`,
`perception`, `statistics` and `crossings`. Views: `observe`, `av_view`, `av_scene`, `av_features`. Callers: `drive`
(whole tests), `runner`, `scripted`, `lockstep`, `recorder`, `harvest`.

The package knows no file, no learner and no plot. The same seed, test and setting give the same bits on any machine,
for any number of threads, through any of the callers (docs/design.md, ADR 20 and 21).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.sim import (
        actions,
        av_features,
        av_scene,
        av_view,
        bicycle,
        braking,
        chances,
        controllers,
        harvest,
        lockstep,
        motion,
        neighbours,
        observe,
        outcome,
        perception,
        rails,
        recorder,
        runner,
        scripted,
        statistics,
        steering,
    )
    from cornerforge.sim.adversaries import choose_action
    from cornerforge.sim.av import av_decide
    from cornerforge.sim.av_kinds import built_in_av_decides
    from cornerforge.sim.keep import Keep, keep_nothing, keep_whole_test
    from cornerforge.sim.loop import (
        AV_MUST_ANSWER,
        BV_MUST_ANSWER,
        MILESTONE,
        NEVER,
        OVER,
        advance,
        answer_as_av,
        answer_as_bv,
        look_as_bv,
    )
    from cornerforge.sim.perception import hidden_by, perceived
    from cornerforge.sim.recorder import Recorder
    from cornerforge.sim.runner import Tally, simulate
    from cornerforge.sim.scratch import Scratch, allocate_scratch, warn_of_left_out
    from cornerforge.sim.scripted import Script, ScriptDriver
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.site.choice import away_chance
    from cornerforge.sim.site.second import look_around
    from cornerforge.sim.site.views import meeting_with_av
    from cornerforge.sim.snapshot import branch_of, copy_of, packed, unpacked
    from cornerforge.sim.step import allocate_recording, bring_up_to_date, forget_frames
    from cornerforge.sim.traffic import naming_tests, reset_world
    from cornerforge.sim.world import (
        ALL_OF_THEM,
        MAX_BRANCH,
        NO_VEHICLE,
        World,
        all_current,
        allocate_worlds,
        moment_of,
        n_slots,
        world_of,
        world_row,
    )

__all__ = [
    "ALL_OF_THEM", "AV_MUST_ANSWER", "BV_MUST_ANSWER", "MAX_BRANCH", "MILESTONE", "NEVER", "NO_VEHICLE", "OVER", "Keep",
    "Recorder", "Scratch", "Script", "ScriptDriver", "Setting", "Tally", "World", "actions", "advance", "all_current",
    "allocate_recording", "allocate_scratch", "allocate_worlds", "answer_as_av", "answer_as_bv", "av_decide",
    "av_features", "av_scene", "av_view", "away_chance", "bicycle", "braking", "branch_of", "bring_up_to_date",
    "built_in_av_decides", "chances", "choose_action", "controllers", "copy_of", "forget_frames", "harvest",
    "hidden_by", "keep_nothing", "keep_whole_test", "lockstep", "look_around", "look_as_bv", "meeting_with_av",
    "moment_of", "motion", "n_slots", "naming_tests", "neighbours", "observe", "outcome", "packed", "perceived",
    "perception", "rails", "recorder", "reset_world", "runner", "scripted", "simulate", "statistics", "steering",
    "unpacked", "warn_of_left_out", "world_of", "world_row",
]  # fmt: skip

FOR_PROGRAMS = (
    "AV_MUST_ANSWER", "BV_MUST_ANSWER", "MILESTONE", "NEVER", "OVER", "Keep", "Recorder", "Scratch", "Script",
    "ScriptDriver", "Setting", "Tally", "World", "advance", "allocate_scratch", "allocate_worlds", "answer_as_av",
    "answer_as_bv", "branch_of", "copy_of", "keep_nothing", "keep_whole_test", "packed", "reset_world", "simulate",
    "unpacked", "warn_of_left_out", "world_of",
)  # fmt: skip
"""The names that a program needs that drives the simulator by hand."""

_PLACES: dict[str, tuple[str, ...]] = {
    "world": (
        "ALL_OF_THEM", "MAX_BRANCH", "NO_VEHICLE", "World", "all_current", "allocate_worlds", "moment_of", "n_slots",
        "world_of", "world_row",
    ),
    "site.choice": ("away_chance",),
    "site.second": ("look_around",),
    "site.views": ("meeting_with_av",),
    "traffic": ("naming_tests", "reset_world"),
    "snapshot": ("branch_of", "copy_of", "packed", "unpacked"),
    "setting": ("Setting",),
    "loop": (
        "AV_MUST_ANSWER", "BV_MUST_ANSWER", "MILESTONE", "NEVER", "OVER", "advance", "answer_as_av", "answer_as_bv",
        "look_as_bv",
    ),
    "scratch": ("Scratch", "allocate_scratch", "warn_of_left_out"),
    "keep": ("Keep", "keep_nothing", "keep_whole_test"),
    "step": ("allocate_recording", "bring_up_to_date", "forget_frames"),
    "runner": ("Tally", "simulate"),
    "recorder": ("Recorder",),
    "scripted": ("Script", "ScriptDriver"),
    "av": ("av_decide",),
    "perception": ("hidden_by", "perceived"),
    "av_kinds": ("built_in_av_decides",),
    "adversaries": ("choose_action",),
    "": (
        "actions", "av_features", "av_scene", "av_view", "bicycle", "braking", "chances", "controllers", "harvest",
        "lockstep", "motion", "neighbours", "observe", "outcome", "perception", "rails", "recorder", "runner",
        "scripted", "statistics", "steering",
    ),
}  # fmt: skip
"""Module -> the names that it gives; modules given as a whole come last."""

__getattr__ = door(__name__, {name: module for module, names in _PLACES.items() for name in names})
