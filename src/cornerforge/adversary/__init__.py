"""The adversary: how the BV nearest to the AV learns to make it crash."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.adversary.config import PRESETS, TrainConfig
    from cornerforge.adversary.policy_file import Policy, load_policy, policy_hash, save_policy

__all__ = [
    "PRESETS",
    "Policy",
    "TrainConfig",
    "load_policy",
    "policy_hash",
    "save_policy",
]

__getattr__ = door(
    "cornerforge.adversary",
    {
        "PRESETS": "config",
        "Policy": "policy_file",
        "TrainConfig": "config",
        "load_policy": "policy_file",
        "policy_hash": "policy_file",
        "save_policy": "policy_file",
    },
)
