"""Worlds that learners act in: what a step is, and what is paid for it.

`rewards` says which crashes the adversary is paid for, `judge` and `crash_cases` judge those that kernels cannot alone.
`drive_bv` is a second of driving as a step of the adversary, `drive_av` the same for an AV that learns; `agents` is for
environments, whose agents decide outside. With AVs in other processes, `drive_bv_outside` has the same steps in pieces,
and `collector` takes turns with the AVs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.adversary.worlds import agents
    from cornerforge.adversary.worlds.collector import ForeignCollector, Group
    from cornerforge.adversary.worlds.crash_cases import CrashCases, Verdict
    from cornerforge.adversary.worlds.drive_av import (
        AV_DECISIONS,
        HOSTILE,
        AvReward,
        allocate_av_actors,
        collect_av,
        start_av_worlds,
    )
    from cornerforge.adversary.worlds.drive_bv import (
        FINISHED,
        Actors,
        Exploring,
        Transitions,
        allocate_actors,
        allocate_history,
        collect,
        start_worlds,
    )
    from cornerforge.adversary.worlds.judge import judge_crashes
    from cornerforge.adversary.worlds.rewards import (
        REWARDS,
        SITE_REWARDS,
        RewardNumbers,
        driver_of_reward,
        reward_named,
        reward_numbers,
    )

__all__ = [
    "AV_DECISIONS", "FINISHED", "HOSTILE", "REWARDS", "SITE_REWARDS", "Actors", "AvReward", "CrashCases",
    "Exploring", "ForeignCollector", "Group", "RewardNumbers", "Transitions", "Verdict", "agents", "allocate_actors",
    "allocate_av_actors", "allocate_history", "collect", "collect_av", "driver_of_reward", "judge_crashes",
    "reward_named", "reward_numbers", "start_av_worlds", "start_worlds",
]  # fmt: skip

_PLACES: dict[str, tuple[str, ...]] = {
    "": ("agents",),
    "collector": ("ForeignCollector", "Group"),
    "crash_cases": ("CrashCases", "Verdict"),
    "drive_av": ("AV_DECISIONS", "HOSTILE", "AvReward", "allocate_av_actors", "collect_av", "start_av_worlds"),
    "drive_bv": (
        "FINISHED", "Actors", "Exploring", "Transitions", "allocate_actors", "allocate_history", "collect",
        "start_worlds",
    ),
    "judge": ("judge_crashes",),
    "rewards": ("REWARDS", "SITE_REWARDS", "RewardNumbers", "driver_of_reward", "reward_named", "reward_numbers"),
}  # fmt: skip
"""By module, the names that it gives; modules that are given as a whole stand under the empty name."""

__getattr__ = door(__name__, {name: module for module, names in _PLACES.items() for name in names})
