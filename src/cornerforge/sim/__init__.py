"""The simulator: one AV and many background vehicles (BVs) on a straight highway, in compiled kernels.

One function moves everything: `advance(world, setting, scratch, keep, until)`. This file is the door: other packages
of cornerforge take its names and nothing else (`tests/test_rooms.py`). Programs of others may rely on the names of
`FOR_PROGRAMS` (`tests/public_api.txt`); the rest may change at any time. What the names are for:

- *State*. A `World` is all that the future of one test depends on. `reset_world` puts it at the start of a test, which
  (seed, test) and the setting determine; `RUNNING`, `AV_CRASH`, ... say how it stands. `copy_of`, `branch_of`, `packed`
  and `unpacked` copy, branch and store it at any moment.
- *Setting*. A `Setting` is constant in a run: road, AV, naturalistic model and controllers. The `Controllers` say what
  drives the AV (`BUILT_IN`, `OUTSIDE`, `STEERED`), the critical BV, which is the one nearest to the AV (`ADVERSARIES`,
  `TOLD`), and the other BVs (`NATURALISTIC`, `IDM_BVS`, `RAILS`: they move as they are told).
- *Advance*. `advance` is the one loop. It returns when the test is over (`OVER`), when `until` seconds have passed
  (`MILESTONE`), or when a program outside must answer (`AV_MUST_ANSWER`, `BV_MUST_ANSWER`); the answer goes into the
  world, and the next `advance` goes on from there. `Scratch` is memory to work in; nothing in it outlives a call.
- *Drive*: thin callers of the loop. `simulate` drives ranges of tests in threads; `ScriptDriver` drives given starts
  and actions; `lockstep` (a module) is for AVs in other processes.
- *Keep*. `Keep` is what stays of a drive besides its outcome: frames, decisions, counts (`statistics`, a module). A
  `Recorder` gives one test in full, as a scenario or as a case; `harvest_range` makes cases in bulk.
- *Views*: sizes and versions of what is seen, by the adversary (`N_OBSERVATION`) and by an AV (`VIEW_ROWS`,
  `N_AV_FEATURES`; `av_scene`, a module).
- *Parts* of a second, for kernels of other rooms: the chance of each action, what the AV would do, neighbours, motion
  (`bicycle`, a module, of an AV that steers), and random words that are held to a part (`steering`, a module).

Worlds to learn in are in `adversary.worlds`, weighted tests in `rates.branching`, questions about recorded crashes in
`counterfactual`.

Inside, in the order of reading: `world`, `traffic`, `snapshot` (with `world_values`); `setting`; `scratch`; `keep`;
`loop`. Within the loop: `decide` (what BVs draw; `steering`), `chances` (with which probability; `trucks`),
`adversaries` (the critical BV), `av`, `av_kinds` and `av_flawed` (built-in AVs), `actions`, `motion`, `bicycle`,
`rails`, `step` and `reach` (contact), `neighbours`, `sight`, `statistics` and `crossings`. Views: `observe`, `av_view`,
`av_scene`, `av_features`. Callers: `drive` (whole tests), `runner`, `scripted`, `lockstep`, `recorder`, `harvest`.

The package knows no file, no learner and no plot. The same seed, test and setting give the same bits on any machine,
for any number of threads, through any of the callers (docs/design.md, ADR 20 and 21).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.sim import av_scene, bicycle, lockstep, statistics, steering
    from cornerforge.sim.actions import (
        HIGHEST_COMMAND,
        LOWEST_COMMAND,
        hold,
        nearest_action,
        ordered_lane,
        start_lane_change,
    )
    from cornerforge.sim.adversaries import choose_action
    from cornerforge.sim.av import av_decide
    from cornerforge.sim.av_features import AV_FEATURES_VERSION, N_AV_FEATURES, av_order, look_as_av
    from cornerforge.sim.av_kinds import DECIDES_EVERY, built_in_av_decides
    from cornerforge.sim.av_view import AV_VIEW_VERSION, VIEW_COLUMNS, VIEW_ROWS
    from cornerforge.sim.chances import action_probabilities, allocate_starter_scratch, lane_wishes, return_chance
    from cornerforge.sim.harvest import Buffers, Harvest, allocate_harvest, harvest_range, is_full, keep_driven
    from cornerforge.sim.keep import (
        Keep,
        Outcomes,
        allocate_outcomes,
        allocate_windows,
        keep_nothing,
        keep_whole_test,
        write_outcome,
    )
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
    from cornerforge.sim.motion import go_on, move_vehicle
    from cornerforge.sim.neighbours import SIGHT, neighbours_in_lane, sort_by_x
    from cornerforge.sim.observe import N_OBSERVATION, N_OWN, OBSERVATION_VERSION, budget_units
    from cornerforge.sim.rails import Rails, rails_of
    from cornerforge.sim.recorder import Recorder, Recording, scenario_digest
    from cornerforge.sim.runner import (
        DriveChunk,
        Tally,
        crashed_tests,
        drive_chunk,
        drive_chunk_by_window,
        simulate,
        simulate_chunks,
        warm_up,
    )
    from cornerforge.sim.scratch import LEARNED_WIDTH, Scratch, allocate_scratch, warn_of_left_out
    from cornerforge.sim.scripted import (
        NATURAL,
        START_FIELDS,
        TRAITS,
        Ending,
        Script,
        ScriptDriver,
        average_traits,
        scripted_start,
    )
    from cornerforge.sim.setting import (
        ADVERSARIES,
        AS_LEARNED,
        BUILT_IN,
        IDM_BVS,
        NATURALISTIC,
        NO_CAST,
        NOBODY,
        OUTSIDE,
        POLICY,
        RAILS,
        RECORDED,
        SCRIPTED,
        STEERED,
        TOLD,
        Controllers,
        Setting,
        answer_width,
        cast_of,
        is_outside,
    )
    from cornerforge.sim.sight import DECIDED
    from cornerforge.sim.snapshot import branch_of, copy_of, packed, unpacked
    from cornerforge.sim.step import SUBSTEPS, allocate_recording, bring_up_to_date, forget_frames
    from cornerforge.sim.traffic import naming_tests, reset_world
    from cornerforge.sim.world import (
        AV_CRASH,
        AV_FAULT,
        BV_CRASH,
        COMPLETED,
        MAX_BRANCH,
        RUNNING,
        TIME_UP,
        World,
        all_current,
        allocate_worlds,
        arrays_of,
        moment_of,
        n_slots,
        path_of,
        world_of,
        world_row,
    )

__all__ = [
    "ADVERSARIES", "AS_LEARNED", "AV_CRASH", "AV_FAULT", "AV_FEATURES_VERSION", "AV_MUST_ANSWER",
    "AV_VIEW_VERSION", "BUILT_IN", "BV_CRASH", "BV_MUST_ANSWER", "COMPLETED", "DECIDED", "DECIDES_EVERY",
    "HIGHEST_COMMAND", "IDM_BVS", "LEARNED_WIDTH", "LOWEST_COMMAND", "MAX_BRANCH", "MILESTONE", "NATURAL",
    "NATURALISTIC", "NEVER", "NOBODY", "NO_CAST", "N_AV_FEATURES", "N_OBSERVATION", "N_OWN",
    "OBSERVATION_VERSION", "OUTSIDE", "OVER", "POLICY", "RAILS", "RECORDED", "RUNNING", "SCRIPTED", "SIGHT",
    "START_FIELDS", "STEERED", "SUBSTEPS", "TIME_UP", "TOLD", "TRAITS", "VIEW_COLUMNS", "VIEW_ROWS", "Buffers",
    "Controllers", "DriveChunk", "Ending", "Harvest", "Keep", "Outcomes", "Rails", "Recorder", "Recording",
    "Scratch", "Script", "ScriptDriver", "Setting", "Tally", "World", "action_probabilities", "advance",
    "all_current", "allocate_harvest", "allocate_outcomes", "allocate_recording", "allocate_scratch",
    "allocate_starter_scratch", "allocate_windows", "allocate_worlds", "answer_as_av", "answer_as_bv",
    "answer_width", "arrays_of", "av_decide", "av_order", "av_scene", "average_traits", "bicycle", "branch_of",
    "bring_up_to_date", "budget_units", "built_in_av_decides", "cast_of", "choose_action", "copy_of",
    "crashed_tests", "drive_chunk", "drive_chunk_by_window", "forget_frames", "go_on", "harvest_range", "hold",
    "is_full", "is_outside", "keep_driven", "keep_nothing", "keep_whole_test", "lane_wishes", "lockstep",
    "look_as_av", "look_as_bv", "moment_of", "move_vehicle", "n_slots", "naming_tests", "nearest_action",
    "neighbours_in_lane", "ordered_lane", "packed", "path_of", "rails_of", "reset_world", "return_chance",
    "scenario_digest", "scripted_start", "simulate", "simulate_chunks", "sort_by_x", "start_lane_change",
    "statistics", "steering", "unpacked", "warm_up", "warn_of_left_out", "world_of", "world_row",
    "write_outcome",
]  # fmt: skip

FOR_PROGRAMS = (
    "AV_MUST_ANSWER", "BV_MUST_ANSWER", "MILESTONE", "NEVER", "OVER", "Keep", "Recorder", "Scratch", "Script",
    "ScriptDriver", "Setting", "Tally", "World", "advance", "allocate_scratch", "allocate_worlds", "answer_as_av",
    "answer_as_bv", "branch_of", "copy_of", "keep_nothing", "keep_whole_test", "packed", "reset_world", "simulate",
    "unpacked", "warn_of_left_out", "world_of",
)  # fmt: skip
"""The names that a program needs that drives the simulator by hand."""

_PLACES: dict[str, tuple[str, ...]] = {
    # state
    "world": ("moment_of", "MAX_BRANCH", "world_row",
        "World", "allocate_worlds", "world_of", "n_slots", "arrays_of", "all_current", "path_of", "RUNNING",
        "COMPLETED", "TIME_UP", "AV_CRASH", "BV_CRASH", "AV_FAULT",
    ),
    "traffic": ("naming_tests", "reset_world"),
    "snapshot": ("copy_of", "branch_of", "packed", "unpacked"),
    # setting
    "setting": (
        "Setting", "Controllers", "BUILT_IN", "OUTSIDE", "ADVERSARIES", "NOBODY", "POLICY", "TOLD", "SCRIPTED",
        "NATURALISTIC", "IDM_BVS", "RAILS", "RECORDED", "NO_CAST", "STEERED", "AS_LEARNED", "answer_width", "cast_of",
        "is_outside",
    ),
    "av_kinds": ("DECIDES_EVERY", "built_in_av_decides"),
    # advance
    "loop": ("look_as_bv",
        "advance", "NEVER", "OVER", "MILESTONE", "AV_MUST_ANSWER", "BV_MUST_ANSWER", "answer_as_av", "answer_as_bv",
    ),
    "scratch": ("Scratch", "allocate_scratch", "warn_of_left_out", "LEARNED_WIDTH"),
    "step": ("bring_up_to_date", "forget_frames", "SUBSTEPS", "allocate_recording"),
    "motion": ("go_on", "move_vehicle",),
    # drive
    "runner": (
        "simulate", "Tally", "simulate_chunks", "DriveChunk", "drive_chunk", "drive_chunk_by_window", "crashed_tests",
        "warm_up",
    ),
    "scripted": (
        "Script", "ScriptDriver", "Ending", "NATURAL", "START_FIELDS", "TRAITS", "average_traits",
        "scripted_start",
    ),
    # keep
    "keep": (
        "Keep", "keep_nothing", "keep_whole_test", "Outcomes", "allocate_outcomes", "write_outcome",
        "allocate_windows",
    ),
    "rails": ("Rails", "rails_of"),
    "recorder": ("Recorder", "Recording", "scenario_digest"),
    "harvest": ("keep_driven", "Harvest", "Buffers", "allocate_harvest", "harvest_range", "is_full"),
    # views
    "observe": ("N_OBSERVATION", "N_OWN", "OBSERVATION_VERSION", "budget_units"),
    "av_view": ("AV_VIEW_VERSION", "VIEW_ROWS", "VIEW_COLUMNS"),
    "av_features": ("look_as_av", "av_order", "AV_FEATURES_VERSION", "N_AV_FEATURES"),
    "neighbours": ("neighbours_in_lane", "sort_by_x", "SIGHT",),
    # parts
    "actions": ("nearest_action", "LOWEST_COMMAND", "HIGHEST_COMMAND", "hold", "start_lane_change", "ordered_lane"),
    "chances": ("return_chance", "lane_wishes", "action_probabilities", "allocate_starter_scratch"),
    # training
    # trees
    "adversaries": ("choose_action",),
    "av": ("av_decide",),
    "sight": ("DECIDED",),
    # modules
    "": ("av_scene", "bicycle", "lockstep", "statistics", "steering"),
}  # fmt: skip
"""Module -> the names that it gives; modules given as a whole come last."""

__getattr__ = door("cornerforge.sim", {name: module for module, names in _PLACES.items() for name in names})
