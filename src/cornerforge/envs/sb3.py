"""Conversion of a Stable-Baselines3 agent that learnt in `cornerforge/Adversary-v0`: see `cornerforge.ext.gym.sb3`."""

from __future__ import annotations

from cornerforge.ext.gym.sb3 import policy_of_sb3

__all__ = ["policy_of_sb3"]
