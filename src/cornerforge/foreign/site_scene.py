"""View of an AV at a site: its path, its stop line and light, and the agents around it; named arrays and objects.

An AV's process needs this file, Python and NumPy only, so the columns of `cornerforge.sim.site.scene`, which says what
they mean, stand here again, and a test holds them together. All is in the AV's frame: x ahead of the middle of its
box, y to the left [m], angles counter-clockwise [rad].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.foreign.interface import AvContext

__all__ = [
    "AGENT", "AGENTS", "COLUMNS", "FIRST_AGENT", "KINDS", "LIGHTS", "MOMENT", "PATH", "PATH_POINTS", "Agent", "Named",
    "SiteScene", "SiteScenes",
]  # fmt: skip

AGENT = ("id", "kind", "length", "width", "x", "y", "heading", "vx", "vy", "priority")
MOMENT = ("time", "acceleration", "to_stop_line", "light", "left_to_drive")
PATH = ("x", "y", "heading", "limit", "curvature")
COLUMNS = len(AGENT)
PATH_POINTS, FIRST_AGENT = 20, 22
AGENTS = 24
"""So many of the nearest agents an AV at a site sees, unless it says otherwise in its attribute `objects`."""
KINDS = ("car", "truck", "motorcycle", "person")
LIGHTS = ("none", "red", "yellow", "green", "yielding green")
_WHOLE = ("id", "kind", "priority", "light")


class Named:
    """Columns of an array by their names: `agents.x`, `path.limit`; `id`, `kind`, `light`, `priority` are whole.

    Attributes:
        table: All of them, (..., columns).
        names: Their names.
    """

    def __init__(self, table: NDArray[np.float64], names: tuple[str, ...]) -> None:
        self.table, self.names = table, names

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name.startswith("__") or name not in self.names:
            raise AttributeError(f"There is no {name}; there are: {', '.join(self.names)}.")
        column = self.table[..., self.names.index(name)]
        return column.astype(np.int64) if name in _WHOLE else column

    @property
    def there(self) -> NDArray[np.bool_]:
        """Is there an agent?"""
        found: NDArray[np.bool_] = self.table[..., 0] >= 0.0
        return found


@dataclass(frozen=True)
class Agent:
    """One vehicle or person.

    Attributes:
        id: 0 the AV, else a number that stays with it as long as the test lasts.
        kind: "car", "truck", "motorcycle" or "person".
        length, width: Of its box [m].
        x, y: Box centre [m].
        heading: [rad].
        vx, vy: Velocity over the ground [m/s].
        priority: Where its route meets the AV's: 1 it goes first, -1 the AV does, 0 neither by rule.
    """

    id: int
    kind: str
    length: float
    width: float
    x: float
    y: float
    heading: float
    vx: float
    vy: float
    priority: int


def _agent(row: NDArray[np.float64]) -> Agent:
    values: dict[str, Any] = dict(zip(AGENT, row.tolist()))  # noqa: B905 - for Python 3.9
    values["id"], values["priority"] = int(values["id"]), int(values["priority"])
    values["kind"] = KINDS[int(values["kind"])]
    return Agent(**values)


@dataclass(frozen=True)
class SiteScene:
    """One world at one moment, for an AV that answers for one world at a time.

    Attributes:
        time: Since the start of the test [s].
        own: The AV, at x = y = 0; `own.vx` is its speed.
        acceleration: The AV's, now [m/s2].
        to_stop_line: From the AV's front [m]; negative behind it.
        light: At that line: "none", "red", "yellow", "green" or "yielding green".
        left_to_drive: To the end of the AV's route [m].
        path: The AV's path ahead, a point each 2 m: arrays (20,) `x`, `y`, `heading`, `limit`, `curvature`.
        agents: Vehicles and people around it, nearest first.
        context: What is constant.
        history: Scenes before this one, the latest first, as many as the AV asks for and there were; each in the AV's
            frame of then.
    """

    time: float
    own: Agent
    acceleration: float
    to_stop_line: float
    light: str
    left_to_drive: float
    path: Named
    agents: list[Agent]
    context: AvContext
    history: list[SiteScene] = field(default_factory=list)


@dataclass(frozen=True)
class SiteScenes:
    """B worlds at one moment, for an AV that answers for all of them at once.

    Attributes:
        table: All numbers, (B, 22 + N, 10), rows as `cornerforge.sim.site.scene` says.
        context: What is constant.
        history: What was seen before, the latest first; where there was nothing yet, none is running.
    """

    table: NDArray[np.float64]
    context: AvContext
    history: tuple[SiteScenes, ...] = ()

    @property
    def running(self) -> NDArray[np.bool_]:
        """Mask of the worlds that drive a test, (B,); the answers for others are not used."""
        found: NDArray[np.bool_] = self.table[:, 0, AGENT.index("length")] > 0.0
        return found

    @property
    def own(self) -> Named:
        """The AVs, arrays (B,), as of `Agent`."""
        return Named(self.table[:, 0], AGENT)

    @property
    def moment(self) -> Named:
        """Arrays (B,): `time`, `acceleration`, `to_stop_line`, `light` (an index of `LIGHTS`), `left_to_drive`."""
        return Named(self.table[:, 1, : len(MOMENT)], MOMENT)

    @property
    def path(self) -> Named:
        """The paths ahead, arrays (B, 20): `x`, `y`, `heading`, `limit`, `curvature`."""
        return Named(self.table[:, 2:FIRST_AGENT, : len(PATH)], PATH)

    @property
    def agents(self) -> Named:
        """The agents, nearest first, arrays (B, N) as of `Agent`, `kind` an index of `KINDS`; see `there`."""
        return Named(self.table[:, FIRST_AGENT:], AGENT)

    def scene(self, b: int) -> SiteScene:
        """Take one world that is running, as objects."""
        table = self.table[b]
        moment = dict(zip(MOMENT, table[1].tolist()))  # noqa: B905 - for Python 3.9
        light = LIGHTS[int(moment.pop("light"))]
        return SiteScene(
            **moment,
            own=_agent(table[0]),
            light=light,
            path=Named(table[2:FIRST_AGENT, : len(PATH)], PATH),
            agents=[_agent(row) for row in table[FIRST_AGENT:] if row[0] >= 0.0],
            context=self.context,
            history=[before.scene(b) for before in self.history if before.running[b]],
        )
