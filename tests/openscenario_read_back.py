"""Real cases, and a reader of written OpenSCENARIO files that shares no line with the writer."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.experiment.setting import experiment
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.types import Scenario

__all__ = ["Entity", "contact_frame", "crash_of", "entities_of", "real_crashes", "times_over", "tracks_of"]


class Entity(NamedTuple):
    """A vehicle of a file: its class in the standard's words, its size, and its box's centre ahead of the rear axle."""

    category: str
    length: float
    width: float
    ahead: float


@lru_cache
def real_crashes(odd: str, tests: int = 40) -> tuple[Scenario, ...]:
    """Crashes of the AV among the first tests of an adversary."""
    recorder = experiment(bv="swerve", odd=odd).recorder()
    scenarios = (recorder.record(5, test) for test in range(tests))
    return tuple(s for s in scenarios if s.crash is not None and s.crash.slot_a == 0)


def entities_of(root: ET.Element) -> dict[str, Entity]:
    entities = {}
    for thing in root.iter("ScenarioObject"):
        vehicle = thing.find("Vehicle")
        assert vehicle is not None
        size, centre = vehicle.find("BoundingBox/Dimensions"), vehicle.find("BoundingBox/Center")
        rear = vehicle.find("Axles/RearAxle")
        assert size is not None
        assert centre is not None
        assert rear is not None
        assert float(rear.get("positionX", "")) == 0.0
        entities[thing.get("name", "")] = Entity(
            vehicle.get("vehicleCategory", ""),
            float(size.get("length", "")),
            float(size.get("width", "")),
            float(centre.get("x", "")),
        )
    return entities


def tracks_of(root: ET.Element) -> dict[str, NDArray[np.float64]]:
    """Time [s], x, y of the box's centre [m] and heading [rad] of each vehicle that follows a trajectory, (F, 4)."""
    entities, tracks = entities_of(root), {}
    for trajectory in root.iter("Trajectory"):
        name = trajectory.get("name", "").removesuffix("-trajectory")
        rows = []
        for vertex in trajectory.iter("Vertex"):
            place = vertex.find("Position/WorldPosition")
            assert place is not None
            x, y, h = (float(place.get(key, "")) for key in ("x", "y", "h"))
            ahead = entities[name].ahead
            rows.append((float(vertex.get("time", "")), x + ahead * math.cos(h), y + ahead * math.sin(h), h))
        tracks[name] = np.array(rows)
    return tracks


def contact_frame(root: ET.Element) -> tuple[int, str] | None:
    """First frame at which the AV's box overlaps another, and which."""
    entities, tracks = entities_of(root), tracks_of(root)
    av = {round(10 * row[0]): row for row in tracks["Ego"]}
    seen = []
    for name, track in tracks.items():
        for time, x, y, h in track if name != "Ego" else ():
            frame = round(10 * time)
            _, ax, ay, ah = av.get(frame, (0.0, np.inf, np.inf, 0.0))
            own, other = (Box(*pose, *entities[of][1:3]) for pose, of in (((ax, ay, ah), "Ego"), ((x, y, h), name)))
            if boxes_overlap(own, other):
                seen.append((frame, name))
                break
    return min(seen, default=None)


def crash_of(scenario: Scenario) -> tuple[int, str]:
    """Frame and name of the vehicle that the AV touches in a scenario."""
    assert scenario.crash is not None
    return round(10 * scenario.crash.time), f"BV{scenario.crash.slot_b}"


def times_over(element: ET.Element) -> Iterator[float]:
    """All times [s] that conditions below an element want to be over."""
    return (float(c.get("value", "")) for c in element.iter("SimulationTimeCondition"))
