"""The simulator: one AV and many background vehicles (BVs) on a straight highway, in compiled kernels.

One function moves everything: `advance(world, setting, scratch, keep, until)`. This file is the door: other packages
of cornerforge take its names and nothing else (`tests/test_rooms.py`). Programs of others may rely on those of
`FOR_PROGRAMS` (`tests/public_api.txt`); the others may change without a word. What the names are for:

- *State*. A `World` is all that the future of one test depends on. `reset_world` puts it at the start of a test, which
  (seed, test) and the setting determine; `RUNNING`, `AV_CRASH`, ... say how it stands. `copy_of`, `branch_of`, `packed`
  and `unpacked` copy, branch and store it at any moment.
- *Setting*. A `Setting` is constant in a run: road, AV, naturalistic model and controllers. The `Controllers` say what
  drives the AV (`BUILT_IN`, `OUTSIDE`, `STEERED`), the critical BV, which is the one nearest to the AV (`ADVERSARIES`,
  `TOLD`), and the other BVs (`NATURALISTIC`, `IDM_BVS`, `RAILS`: they move as they are told).
- *Advance*. `advance` is the one loop. It returns when the test is over (`OVER`), when `until` seconds have passed
  (`MILESTONE`), or when somebody outside must answer (`AV_MUST_ANSWER`, `BV_MUST_ANSWER`); the answer goes into the
  world, and the next `advance` goes on from there. `Scratch` is memory to work in; nothing in it outlives a call.
- *Drive*: thin callers of the loop. `simulate` drives ranges of tests in threads; `ScriptDriver` drives given starts
  and actions; `judge_crashes` drives crashes again; `lockstep` (a module) is for AVs in other processes, `agents` (a
  module) for environments.
- *Keep*. `Keep` is what stays of a drive besides its outcome: frames, decisions, counts (`statistics`, a module). A
  `Recorder` gives one test in full, `harvest_range` and `case_of` make cases.
- *Views*: sizes and versions of what is seen, by the adversary (`N_OBSERVATION`) and by an AV (`VIEW_ROWS`,
  `N_AV_FEATURES`).
- *Parts* of a second, for questions about a moment: the chance of each action, what the AV would do, motion.
- *Trees* (`Plan`, `Forest`; `trees`, `grove`, `lessons`, `danger`: modules): worlds are copied where something
  dangerous may happen, or drawn from proposals that favour it, and weighted, so that rare crashes are found without
  changing their rate.
- *Training*: rewards, and transitions of many worlds for learners of the adversary (`collect`; `drive_bv_outside`, a
  module, for AVs in other processes) and of the AV (`collect_av`).

Inside, in the order of reading: `world`, `traffic`, `snapshot`; `setting`; `scratch`; `keep`; `loop`. Within the loop:
`decide` (what BVs draw), `chances` (with which probability), `adversaries` (the critical BV), `av` and `av_kinds`
(built-in AVs), `actions`, `motion`, `bicycle` (an AV that steers), `step` and `reach` (contact), `neighbours`. Views:
`observe`, `av_view`, `av_scene`, `av_features`; `tracking` follows trajectories of AVs. Callers: `drive` (whole
tests), `runner`, `scripted` and `rails`, `lockstep`, `agents`, `drive_bv`, `drive_bv_outside`, `drive_av`; `harvest`,
`recorder`, `judge`. Trees: `steering` (words that are held to a part), `danger`, `acts`, `branches`, `lessons`,
`forest`, `tilt`, `trees`, `grove`. What the adversary is paid for: `rewards`, `braking`, `crash_cases`.

The package knows no file, no learner and no plot. The same seed, test and setting give the same bits on any machine,
for any number of threads, through any of the callers (docs/design.md, ADR 20 and 21).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.sim import agents, drive_bv_outside, lockstep, statistics, steering, tracking
    from cornerforge.sim.actions import HIGHEST_COMMAND, LOWEST_COMMAND, hold, ordered_lane, start_lane_change
    from cornerforge.sim.av_features import AV_FEATURES_VERSION, N_AV_FEATURES
    from cornerforge.sim.av_kinds import DECIDES_EVERY, built_in_av_decides
    from cornerforge.sim.av_scene import SCENE_COLUMNS, show_to_av
    from cornerforge.sim.av_view import AV_VIEW_VERSION, VIEW_COLUMNS, VIEW_ROWS
    from cornerforge.sim.bicycle import MOST_LATERAL_ACCELERATION
    from cornerforge.sim.braking import lateral_plan, manoeuvre_begin
    from cornerforge.sim.chances import action_probabilities, allocate_starter_scratch, lane_wishes, return_chance
    from cornerforge.sim.crash_cases import CrashCases, Verdict, recordings_of_harvest
    from cornerforge.sim.drive import drive_range
    from cornerforge.sim.drive_av import (
        AV_DECISIONS,
        HOSTILE,
        AvReward,
        allocate_av_actors,
        collect_av,
        start_av_worlds,
    )
    from cornerforge.sim.drive_bv import (
        FINISHED,
        Actors,
        Exploring,
        Transitions,
        allocate_actors,
        allocate_history,
        collect,
        start_worlds,
    )
    from cornerforge.sim.harvest import LIMITS, Buffers, Harvest, allocate_harvest, harvest_range, is_full
    from cornerforge.sim.judge import judge_crashes
    from cornerforge.sim.keep import (
        Keep,
        Outcomes,
        allocate_decisions,
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
    )
    from cornerforge.sim.motion import move_vehicle
    from cornerforge.sim.neighbours import SIGHT, sort_by_x
    from cornerforge.sim.observe import N_OBSERVATION, N_OWN, OBSERVATION_VERSION, budget_units
    from cornerforge.sim.rails import NO_RAILS, Rails, rails_of
    from cornerforge.sim.recorder import Recorder, case_of, scenario_digest
    from cornerforge.sim.rewards import (
        DRIVER,
        REWARDS,
        Reward,
        RewardNumbers,
        driver_of_reward,
        reward_named,
        reward_numbers,
    )
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
        Asked,
        Ending,
        Script,
        ScriptDriver,
        average_traits,
        scripted_start,
    )
    from cornerforge.sim.setting import (
        ADVERSARIES,
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
    from cornerforge.sim.snapshot import branch_of, copy_of, packed, unpacked
    from cornerforge.sim.step import SUBSTEPS, allocate_recording
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
        n_slots,
        path_of,
        world_of,
        world_row,
    )

__all__ = [
    "ADVERSARIES", "AV_CRASH", "AV_DECISIONS", "AV_FAULT", "AV_FEATURES_VERSION", "AV_MUST_ANSWER",
    "AV_VIEW_VERSION", "BUILT_IN", "BV_CRASH", "BV_MUST_ANSWER", "COMPLETED", "DECIDES_EVERY", "DRIVER", "FINISHED",
    "HIGHEST_COMMAND", "HOSTILE", "IDM_BVS", "LEARNED_WIDTH", "LIMITS", "LOWEST_COMMAND", "MAX_BRANCH", "MILESTONE",
    "MOST_LATERAL_ACCELERATION", "NATURAL", "NATURALISTIC", "NEVER", "NOBODY", "NO_CAST", "NO_RAILS",
    "N_AV_FEATURES", "N_OBSERVATION", "N_OWN", "OBSERVATION_VERSION", "OUTSIDE", "OVER", "POLICY", "RAILS",
    "RECORDED", "REWARDS", "RUNNING", "SCENE_COLUMNS", "SCRIPTED", "SIGHT", "START_FIELDS", "STEERED", "SUBSTEPS",
    "TIME_UP", "TOLD", "TRAITS", "VIEW_COLUMNS", "VIEW_ROWS", "Actors", "Asked", "AvReward", "Buffers",
    "Controllers", "CrashCases", "DriveChunk", "Ending", "Exploring", "Harvest", "Keep", "Outcomes", "Rails",
    "Recorder", "Reward", "RewardNumbers", "Scratch", "Script", "ScriptDriver", "Setting", "Tally", "Transitions",
    "Verdict", "World", "action_probabilities", "advance", "agents", "all_current", "allocate_actors",
    "allocate_av_actors", "allocate_decisions", "allocate_harvest", "allocate_history", "allocate_outcomes",
    "allocate_recording", "allocate_scratch", "allocate_starter_scratch", "allocate_windows", "allocate_worlds",
    "answer_as_av", "answer_as_bv", "answer_width", "arrays_of", "average_traits", "branch_of", "budget_units",
    "built_in_av_decides", "case_of", "cast_of", "collect", "collect_av", "copy_of", "crashed_tests",
    "drive_bv_outside", "drive_chunk", "drive_chunk_by_window", "drive_range", "driver_of_reward", "harvest_range",
    "hold", "is_full", "is_outside", "judge_crashes", "keep_nothing", "keep_whole_test", "lane_wishes",
    "lateral_plan", "lockstep", "manoeuvre_begin", "move_vehicle", "n_slots", "naming_tests", "ordered_lane",
    "packed", "path_of", "rails_of", "recordings_of_harvest", "reset_world", "return_chance", "reward_named",
    "reward_numbers", "scenario_digest", "scripted_start", "show_to_av", "simulate", "simulate_chunks", "sort_by_x",
    "start_av_worlds", "start_lane_change", "start_worlds", "statistics", "steering", "tracking", "unpacked",
    "warm_up", "warn_of_left_out", "world_of", "world_row", "write_outcome",
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
    "world": ("MAX_BRANCH", "world_row",
        "World", "allocate_worlds", "world_of", "n_slots", "arrays_of", "all_current", "path_of", "RUNNING",
        "COMPLETED", "TIME_UP", "AV_CRASH", "BV_CRASH", "AV_FAULT",
    ),
    "traffic": ("naming_tests", "reset_world"),
    "snapshot": ("copy_of", "branch_of", "packed", "unpacked"),
    # setting
    "setting": (
        "Setting", "Controllers", "BUILT_IN", "OUTSIDE", "ADVERSARIES", "NOBODY", "POLICY", "TOLD", "SCRIPTED",
        "NATURALISTIC", "IDM_BVS", "RAILS", "RECORDED", "NO_CAST", "STEERED", "answer_width", "cast_of", "is_outside",
    ),
    "av_kinds": ("DECIDES_EVERY", "built_in_av_decides"),
    # advance
    "loop": (
        "advance", "NEVER", "OVER", "MILESTONE", "AV_MUST_ANSWER", "BV_MUST_ANSWER", "answer_as_av", "answer_as_bv",
    ),
    "scratch": ("Scratch", "allocate_scratch", "warn_of_left_out", "LEARNED_WIDTH"),
    "step": ("SUBSTEPS", "allocate_recording"),
    "motion": ("move_vehicle",),
    "bicycle": ("MOST_LATERAL_ACCELERATION",),
    # drive
    "runner": (
        "simulate", "Tally", "simulate_chunks", "DriveChunk", "drive_chunk", "drive_chunk_by_window", "crashed_tests",
        "warm_up",
    ),
    "drive": ("drive_range",),
    "judge": ("judge_crashes",),
    "scripted": (
        "Asked", "Script", "ScriptDriver", "Ending", "NATURAL", "START_FIELDS", "TRAITS", "average_traits",
        "scripted_start",
    ),
    # keep
    "keep": (
        "Keep", "keep_nothing", "keep_whole_test", "Outcomes", "allocate_outcomes", "write_outcome",
        "allocate_decisions", "allocate_windows",
    ),
    "rails": ("NO_RAILS", "Rails", "rails_of"),
    "recorder": ("Recorder", "case_of", "scenario_digest"),
    "harvest": ("LIMITS", "Harvest", "Buffers", "allocate_harvest", "harvest_range", "is_full"),
    # views
    "observe": ("N_OBSERVATION", "N_OWN", "OBSERVATION_VERSION", "budget_units"),
    "av_view": ("AV_VIEW_VERSION", "VIEW_ROWS", "VIEW_COLUMNS"),
    "av_scene": ("show_to_av", "SCENE_COLUMNS",),
    "av_features": ("AV_FEATURES_VERSION", "N_AV_FEATURES"),
    "neighbours": ("sort_by_x", "SIGHT",),
    # parts
    "actions": ("LOWEST_COMMAND", "HIGHEST_COMMAND", "hold", "start_lane_change", "ordered_lane"),
    "chances": ("return_chance", "lane_wishes", "action_probabilities", "allocate_starter_scratch"),
    "braking": ("manoeuvre_begin", "lateral_plan"),
    # training
    "rewards": (
        "DRIVER", "REWARDS", "Reward", "RewardNumbers", "driver_of_reward", "reward_named", "reward_numbers",
    ),
    "crash_cases": ("CrashCases", "Verdict", "recordings_of_harvest"),
    "drive_bv": (
        "Actors", "Exploring", "FINISHED", "Transitions", "allocate_actors", "allocate_history", "collect",
        "start_worlds",
    ),
    "drive_av": ("AV_DECISIONS", "HOSTILE", "AvReward", "allocate_av_actors", "collect_av", "start_av_worlds"),
    # trees
    # modules
    "": ("steering", "lockstep", "tracking", "drive_bv_outside", "agents", "statistics", ),
}  # fmt: skip
"""By module, the names that it gives; modules that are given as a whole come last."""

__getattr__ = door("cornerforge.sim", {name: module for module, names in _PLACES.items() for name in names})
