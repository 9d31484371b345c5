"""Gymnasium environments, single and vector; importing the package registers them. Users import `cornerforge.envs`."""

from __future__ import annotations

from cornerforge.errors import MissingExtraError

try:
    from gymnasium.envs.registration import register, registry
except ImportError as error:
    raise MissingExtraError("gymnasium", "gym") from error

__all__ = ["ADVERSARY_ID", "DRIVING_ID"]

ADVERSARY_ID = "cornerforge/Adversary-v0"
DRIVING_ID = "cornerforge/Driving-v0"

for _id, _name in ((ADVERSARY_ID, "Adversary"), (DRIVING_ID, "Driving")):
    if _id not in registry:
        # Named, not imported: a program that only lists environments need not wait for the simulator.
        register(
            id=_id,
            entry_point=f"cornerforge.ext.gym.single:{_name}Env",
            vector_entry_point=f"cornerforge.ext.gym.vector:{_name}VectorEnv",
        )
