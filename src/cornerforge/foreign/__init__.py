"""AVs that are not built in: a Python class, a Stable-Baselines3 file, an ONNX file, each in a process of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.foreign.interface import Av, AvContext, Planner, PlannerForAll
    from cornerforge.foreign.scene import Box, Boxes, Scene, Scenes

__all__ = ["Av", "AvContext", "Box", "Boxes", "Planner", "PlannerForAll", "Scene", "Scenes"]

__getattr__ = door(
    __name__,
    dict.fromkeys(("Av", "AvContext", "Planner", "PlannerForAll"), "interface")
    | dict.fromkeys(("Box", "Boxes", "Scene", "Scenes"), "scene"),
)
