"""AVs that are not built in: a Python class, a Stable-Baselines3 file, an ONNX file, each in a process of its own.

Programs take the interfaces here: what an AV is told, sees and may answer. In the order of a test: `spec` describes an
AV, `interpreter` and `loaders` say where and how it is loaded, `driver` opens and lends its processes, `session` is
one of them with its worlds, `answers` makes controls of what it says, `process` has its failures, `recorder` drives its
tests once more. Beside them `pace` (how fast it is), `av_log` (what it printed), `named_avs` (what this user has
named), `edge_cases` (what `check-av` tries), `networks` (what numbers of a network mean).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.foreign.interface import Av, AvContext, Planner, PlannerForAll
    from cornerforge.foreign.scene import Box, Boxes, Scene, Scenes
    from cornerforge.foreign.site_scene import Agent, SiteScene, SiteScenes

__all__ = [
    "Agent", "Av", "AvContext", "Box", "Boxes", "Planner", "PlannerForAll", "Scene", "Scenes", "SiteScene", "SiteScenes",
]  # fmt: skip

MODULES = (
    "answers", "av_log", "driver", "edge_cases", "interpreter", "loaders", "named_avs", "networks", "pace", "process",
    "recorder", "session", "spec",
)  # fmt: skip
"""Modules from which other rooms import too."""

__getattr__ = door(
    __name__,
    dict.fromkeys(("Av", "AvContext", "Planner", "PlannerForAll"), "interface")
    | dict.fromkeys(("Box", "Boxes", "Scene", "Scenes"), "scene")
    | dict.fromkeys(("Agent", "SiteScene", "SiteScenes"), "site_scene"),
)
