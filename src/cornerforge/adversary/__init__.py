"""The adversary: how the BV nearest to the AV learns to make it crash.

Programs take policies and presets here. `config` has the hyperparameters, `train` and `train_av` the loops,
`checkpoint` the files of an unfinished one, `verdicts` the judges of rewards given case by case; `worlds`, a room of
its own, is where a learner acts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.adversary.config import PRESETS, TrainConfig
    from cornerforge.experiment.policy_file import Policy, load_policy, policy_hash, save_policy

__all__ = [
    "PRESETS",
    "Policy",
    "TrainConfig",
    "load_policy",
    "policy_hash",
    "save_policy",
]

MODULES = ("checkpoint", "config", "train", "train_av", "verdicts", "worlds")
"""Modules from which other rooms import too."""

__getattr__ = door(
    "cornerforge",
    {
        "PRESETS": "adversary.config",
        "Policy": "experiment.policy_file",
        "TrainConfig": "adversary.config",
        "load_policy": "experiment.policy_file",
        "policy_hash": "experiment.policy_file",
        "save_policy": "experiment.policy_file",
    },
)
