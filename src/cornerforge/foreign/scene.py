"""View of an AV of interface 2: boxes with identities, its own state, and what came before; named arrays and objects.

An AV's process needs this file, Python and NumPy only, so the columns of `cornerforge.sim.av_scene` stand here again,
and a test holds them together. Coordinates are the road's: x along it from where the AV started, y to the left from its
right edge [m]; headings and yaw rates are counter-clockwise [rad], [rad/s].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cornerforge.foreign.interface import AvContext

__all__ = ["COLUMNS", "KINDS", "Box", "Boxes", "Scene", "Scenes"]

COLUMNS = (
    "id", "kind", "length", "width", "x", "y", "heading", "vx", "vy", "ax", "ay", "yaw_rate", "indicator", "lane",
    "time", "left_to_drive", "curvature", "target_lane",
)  # fmt: skip
_OF_BOXES = COLUMNS[:14]
_WHOLE = ("id", "kind", "indicator", "lane")
_PLACE = {name: k for k, name in enumerate(COLUMNS)}
KINDS = ("car", "truck", "motorcycle")


@dataclass(frozen=True)
class Box:
    """One vehicle.

    Attributes:
        id: 0 the AV, else a number that stays with the vehicle as long as the test lasts.
        kind: "car", "truck" or "motorcycle".
        length, width: Of its box [m].
        x, y: Box centre [m].
        heading: [rad].
        vx, vy: Velocity of the centre along and across the road [m/s].
        ax, ay: Acceleration along and across the road [m/s2].
        yaw_rate: [rad/s].
        indicator: 1 left, -1 right, 0 none; some drivers use none.
        lane: That holds its centre, 0 the rightmost.
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
    ax: float
    ay: float
    yaw_rate: float
    indicator: int
    lane: int

    @property
    def speed(self) -> float:
        """How fast its centre moves [m/s]."""
        return float(np.hypot(self.vx, self.vy))


def _box(row: NDArray[np.float64]) -> Box:
    values: dict[str, Any] = dict(zip(_OF_BOXES, row.tolist()))  # noqa: B905 - for Python 3.9
    for name in _WHOLE:
        values[name] = int(values[name])
    values["kind"] = KINDS[values["kind"]]
    return Box(**values)


class Boxes:
    """Vehicles as arrays: `boxes.x`, `boxes.vx`, ... have one number a vehicle; the names are those of `Box`.

    `kind` is an index of `KINDS`; `id` is -1 and all else 0 where there is no vehicle.

    Attributes:
        table: All columns, (..., 18), as `COLUMNS` names them.
    """

    def __init__(self, table: NDArray[np.float64]) -> None:
        self.table = table

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name not in _OF_BOXES:
            raise AttributeError(f"Boxes have no {name}; they have: {', '.join(_OF_BOXES)}, there, speed.")
        column = self.table[..., _PLACE[name]]
        return column.astype(np.int64) if name in _WHOLE else column

    @property
    def there(self) -> NDArray[np.bool_]:
        """Is there a vehicle?"""
        found: NDArray[np.bool_] = self.table[..., 0] >= 0.0
        return found

    @property
    def speed(self) -> NDArray[np.float64]:
        """How fast the centres move [m/s]."""
        found: NDArray[np.float64] = np.hypot(self.table[..., _PLACE["vx"]], self.table[..., _PLACE["vy"]])
        return found


@dataclass(frozen=True)
class Scene:
    """One world at one moment, for an AV that plans for one world at a time.

    Attributes:
        time: Since the start of the test [s].
        own: The AV's box.
        others: The vehicles within 200 m, nearest along the road first.
        curvature: Of the AV's way now, to the left positive [1/m]; 0 for an AV that orders lanes.
        target_lane: Lane that the AV keeps or changes to.
        left_to_drive: Distance left in this test [m].
        boxes: The same vehicles as arrays, row 0 the AV.
        history: Scenes before this one, the latest first, as many as the AV asks for (attribute `history`) and there
            were.
        context: What is constant: lanes, set speed, sizes, time between two answers.
    """

    time: float
    own: Box
    others: list[Box]
    curvature: float
    target_lane: int
    left_to_drive: float
    boxes: Boxes
    context: AvContext
    history: list[Scene] = field(default_factory=list)

    def lane_ends_in(self, lane: int) -> float:
        """Compute how far ahead of its box's centre the AV must have left a lane [m] (`AvContext.lane_ends_in`)."""
        return float(self.context.lane_ends_in(lane, self.own.x))


@dataclass(frozen=True)
class Scenes:
    """B worlds at one moment, for an AV that answers for all of them at once.

    Attributes:
        running: Which worlds drive a test, (B,); the answers for others are not used.
        time, curvature, left_to_drive: As in `Scene`, (B,).
        target_lane: Likewise, int (B,).
        own: The AVs' boxes, arrays (B,).
        others: The vehicles around them, arrays (B, N), nearest first; see `Boxes.there`.
        history: What was seen before, the latest first, as many as the AV asks for; where there was nothing yet,
            nobody is running.
        context: What is constant.
    """

    table: NDArray[np.float64]
    context: AvContext
    history: tuple[Scenes, ...] = ()

    @property
    def running(self) -> NDArray[np.bool_]:
        """Mask of the worlds that drive a test, (B,)."""
        found: NDArray[np.bool_] = self.table[:, 0, _PLACE["length"]] > 0.0
        return found

    def _own(self, name: str) -> NDArray[np.float64]:
        column: NDArray[np.float64] = self.table[:, 0, _PLACE[name]]
        return column

    @property
    def time(self) -> NDArray[np.float64]:
        """Since the start of the test [s], (B,)."""
        return self._own("time")

    @property
    def curvature(self) -> NDArray[np.float64]:
        """Curvature of the AVs' ways now [1/m], (B,)."""
        return self._own("curvature")

    @property
    def left_to_drive(self) -> NDArray[np.float64]:
        """Distance left in the tests [m], (B,)."""
        return self._own("left_to_drive")

    @property
    def target_lane(self) -> NDArray[np.int64]:
        """Lanes that the AVs keep or change to, (B,)."""
        return self._own("target_lane").astype(np.int64)

    @property
    def own(self) -> Boxes:
        """The AVs."""
        return Boxes(self.table[:, 0])

    @property
    def others(self) -> Boxes:
        """The vehicles around them."""
        return Boxes(self.table[:, 1:])

    def lane_ends_in(self, lane: ArrayLike) -> NDArray[np.float64]:
        """Compute how far ahead the AVs must have left a lane, the same or one for each (B,) [m], (B,)."""
        return self.context.lane_ends_in(lane, self.own.x)

    def scene(self, b: int) -> Scene:
        """Take one world that is running, as objects."""
        table = self.table[b]
        there = table[:, 0] >= 0.0
        own = table[0]
        return Scene(
            time=float(own[_PLACE["time"]]),
            own=_box(own),
            others=[_box(row) for row in table[1:][there[1:]]],
            curvature=float(own[_PLACE["curvature"]]),
            target_lane=int(own[_PLACE["target_lane"]]),
            left_to_drive=float(own[_PLACE["left_to_drive"]]),
            boxes=Boxes(table[there]),
            context=self.context,
            history=[before.scene(b) for before in self.history if before.running[b]],
        )
