"""Gymnasium environments: `cornerforge/Adversary-v0` (drive a background vehicle), `cornerforge/Driving-v0` (the AV).

Importing this package registers both, single and vector, with Gymnasium; docs/gymnasium.md describes them. They are
made in `cornerforge.ext.gym`.

>>> import gymnasium
>>> import cornerforge.envs
>>> gymnasium.spec("cornerforge/Adversary-v0").id
'cornerforge/Adversary-v0'
"""

from __future__ import annotations

from cornerforge.ext.gym import ADVERSARY_ID, DRIVING_ID

__all__ = ["ADVERSARY_ID", "DRIVING_ID"]
