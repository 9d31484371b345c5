"""Scenes of a site in which AVs tend to fail, and random ones; `check-av --site` tries them.

A table is what an AV sees of a world (`site_scene`), (22 + 24, 10), on a straight way but in the turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.foreign.site_scene import (
    AGENT,
    AGENTS,
    COLUMNS,
    FIRST_AGENT,
    KINDS,
    LIGHTS,
    MOMENT,
    PATH,
    PATH_POINTS,
)

__all__ = ["SITE_CASES", "SiteCase", "ordinary_scenes", "random_scenes", "site_case"]

_ROWS = FIRST_AGENT + AGENTS
_STEP = 2.0
_SIZES = {"car": (5.0, 2.0), "truck": (7.5, 2.3), "motorcycle": (2.2, 0.9), "person": (0.6, 0.6)}
_NO_LINE = -30.0
"""Of a stop line that the AV has passed [m]."""


@dataclass(frozen=True)
class Seen:
    """An agent as the AV sees it: metres ahead and to the left, speeds ahead and to the left [m/s]."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0
    kind: str = "car"
    priority: int = 0


@dataclass(frozen=True)
class SiteCase:
    """A moment at a site.

    Attributes:
        speed: Speed of the AV [m/s].
        agents: What is around it, nearest first.
        doubt: Takes the AV's acceleration [m/s2], and says what is strange about this answer, or "".
        light: At its stop line.
        to_stop_line: From its front [m]; negative behind it.
        turn: Curvature of its path [1/m].
        left_to_drive: [m].
    """

    speed: float
    agents: Sequence[Seen] = ()
    doubt: Callable[[float], str] = lambda _a: ""
    light: str = "none"
    to_stop_line: float = _NO_LINE
    turn: float = 0.0
    left_to_drive: float = 120.0


def _should_brake(acceleration: float) -> str:
    return "it does not brake; is the sign right?" if acceleration >= 0.0 else ""


def _should_stay(acceleration: float) -> str:
    return "it drives off" if acceleration > 0.0 else ""


def _should_go(acceleration: float) -> str:
    return "it does not drive off where nothing is in its way" if acceleration <= 0.0 else ""


def _should_not_brake(acceleration: float) -> str:
    return "it brakes on an empty road" if acceleration < -1.0 else ""


_CROWD = tuple(Seen(4.0 + 2.0 * k, (-1) ** k * (6.0 + k), kind="person") for k in range(AGENTS))

SITE_CASES: dict[str, SiteCase] = {
    "empty road": SiteCase(8.0, doubt=_should_not_brake),
    "standing at green": SiteCase(0.0, doubt=_should_go, light="green", to_stop_line=1.0),
    "red ahead": SiteCase(9.0, doubt=_should_brake, light="red", to_stop_line=15.0),
    "standing at red": SiteCase(0.0, doubt=_should_stay, light="red", to_stop_line=0.6),
    "yellow, too late to stop": SiteCase(10.0, light="yellow", to_stop_line=3.0),
    "lead stands still": SiteCase(9.0, [Seen(22.0, 0.0)], doubt=_should_brake),
    "bumper to bumper": SiteCase(0.0, [Seen(5.1, 0.0), Seen(-5.1, 0.0)], doubt=_should_stay),
    "person on the path": SiteCase(6.0, [Seen(14.0, 0.3, 0.0, 1.2, "person", 1)], doubt=_should_brake),
    "person about to cross": SiteCase(6.0, [Seen(14.0, -3.0, 0.0, 1.4, "person", 1)], doubt=_should_brake),
    "vehicle comes across with priority": SiteCase(
        0.0, [Seen(4.6, 16.0, 0.0, -9.0, "car", 1)], doubt=_should_stay, to_stop_line=1.0
    ),
    "person behind a truck that stands beside": SiteCase(
        6.0, [Seen(8.0, 3.2, kind="truck"), Seen(13.5, 2.6, 0.0, -1.4, "person", 1)], doubt=_should_brake
    ),
    "in a turn": SiteCase(5.0, light="yielding green", turn=0.1),
    "full of people beside the path": SiteCase(3.0, _CROWD),
    "end of the route": SiteCase(8.0, left_to_drive=0.4),
}
"""The edge cases by name."""


def _way(turn: float) -> NDArray[np.float64]:
    """Make the path ahead, (20, 5), of constant curvature [1/m]."""
    s = _STEP * np.arange(1, PATH_POINTS + 1)
    heading = turn * s
    x, y = (s, 0.0 * s) if turn == 0.0 else (np.sin(heading) / turn, (1.0 - np.cos(heading)) / turn)
    limit = np.full(PATH_POINTS, 11.0 if turn == 0.0 else 5.0)
    return np.stack([x, y, heading, limit, np.full(PATH_POINTS, turn)], axis=1)


def _row_of(number: int, seen: Seen) -> list[float]:
    length, width = _SIZES[seen.kind]
    moves = np.hypot(seen.vx, seen.vy) > 0.0
    heading = float(np.arctan2(seen.vy, seen.vx)) if moves else 0.0
    kind = KINDS.index(seen.kind)
    return [number, kind, length, width, seen.x, seen.y, heading, seen.vx, seen.vy, seen.priority]


def _table(
    speed: float, moment: Sequence[float], way: NDArray[np.float64], agents: Sequence[Sequence[float]]
) -> NDArray[np.float64]:
    table = np.zeros((_ROWS, COLUMNS))
    table[0] = _row_of(0, Seen(0.0, 0.0, speed))
    table[1, : len(MOMENT)] = moment
    table[2:FIRST_AGENT, : len(PATH)] = way
    table[FIRST_AGENT:, AGENT.index("id")] = -1.0
    if agents:
        table[FIRST_AGENT : FIRST_AGENT + len(agents)] = agents
    return table


def site_case(name: str) -> NDArray[np.float64]:
    """Make the table (46, 10) of an edge case."""
    case = SITE_CASES[name]
    agents = [_row_of(k, seen) for k, seen in enumerate(case.agents, start=1)]
    moment = [5.0, 0.0, case.to_stop_line, LIGHTS.index(case.light), case.left_to_drive]
    return _table(case.speed, moment, _way(case.turn), agents)


def ordinary_scenes(n: int) -> NDArray[np.float64]:
    """Make n tables (n, 46, 10) of ordinary traffic."""
    return np.repeat(site_case("lead stands still")[None], n, axis=0)


def random_scenes(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Make tables (*shape, 46, 10) of random traffic; there is no motion from one to the next."""
    tables = [_random(rng) for _ in range(int(np.prod(shape)))]
    return np.stack(tables).reshape(*shape, _ROWS, COLUMNS)


def _drawn(place: NDArray[np.float64], speed: NDArray[np.float64], kind: str, priority: int) -> Seen:
    x, y = place.tolist()
    vx, vy = (speed / (4.0 if kind == "person" else 1.0)).tolist()
    return Seen(x, y, vx, vy, kind, priority)


def _random(rng: np.random.Generator) -> NDArray[np.float64]:
    count = int(rng.integers(0, AGENTS + 1))
    places = rng.uniform(-60.0, 60.0, (count, 2))
    places = places[np.argsort(np.hypot(*places.T))]
    speeds = rng.normal(0.0, 5.0, (count, 2))
    kinds = rng.choice(["car", "truck", "person"], count)
    agents = [
        _row_of(k + 1, _drawn(places[k], speeds[k], str(kinds[k]), int(first)))
        for k, first in enumerate(rng.integers(-1, 2, count))
    ]
    moment = [
        rng.uniform(0.0, 60.0), rng.uniform(-3.0, 2.0), rng.uniform(-20.0, 60.0), float(rng.integers(0, 5)), 80.0,
    ]  # fmt: skip
    return _table(float(rng.uniform(0.0, 12.0)), moment, _way(float(rng.choice([0.0, 0.08, -0.15]))), agents)
