"""Views in which AVs tend to fail; `check-av` tries them, or at a site those of `site_cases`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.foreign.interface import VIEW_SHAPE, AvContext
from cornerforge.foreign.scene import COLUMNS
from cornerforge.foreign.site_cases import SITE_CASES, ordinary_scenes, random_scenes, site_case

if TYPE_CHECKING:
    from cornerforge.types import Odd

__all__ = [
    "EDGE_CASES", "EdgeCase", "Trials", "edge_case", "ordinary_views", "random_views", "sample_views", "scenes_of",
    "trials_of",
]  # fmt: skip

_ROWS, _COLUMNS = VIEW_SHAPE
_SAMPLE = 64


@dataclass(frozen=True)
class Other:
    """A vehicle as the AV sees it: metres ahead, lanes to the left, speed, and speed to the left [m/s]."""

    ahead: float
    lanes_left: float
    speed: float
    to_left: float = 0.0


@dataclass(frozen=True)
class EdgeCase:
    """A moment on the road.

    Attributes:
        speed: Speed of the AV [m/s].
        others: The vehicles around it, nearest first.
        doubt: Takes the AV's acceleration [m/s2] and lane order, and says what is strange about this answer, or "".
        lane: Lane of the AV, negative from the left; None: the middle one.
        left_to_drive: Distance left in the test [m].
        between_lanes: How far the AV is left of its lane's centre [m], in a lane change to the left.
    """

    speed: float
    others: Sequence[Other] = ()
    doubt: Callable[[float, float], str] = lambda _a, _order: ""
    lane: int | None = None
    left_to_drive: float = 200.0
    between_lanes: float = 0.0


def _should_brake(acceleration: float, order: float) -> str:
    if acceleration >= 0.0 and order == 0.0:
        return "it does not brake; is the sign right?"
    return ""


def _should_brake_for_what_comes_in(acceleration: float, order: float) -> str:
    if acceleration > -1.0 and order == 0.0:
        return "it hardly brakes; is a vehicle that comes in seen only in mid-lane?"
    return ""


def _should_not_brake(acceleration: float, _order: float) -> str:
    return "it brakes on an empty road" if acceleration < -1.0 else ""


def _should_stay(_acceleration: float, order: float) -> str:
    return "it changes lanes into a vehicle beside it" if order != 0.0 else ""


_BOX = (Other(0.5, 1, 30.0), Other(-0.5, -1, 30.0), Other(9.0, 0, 30.0), Other(-9.0, 0, 30.0))
_FULL = tuple(Other(sign * 15.0 * k, lane, 40.0) for k in range(1, 5) for sign, lane in ((1, 0), (-1, 0), (1, 1)))

EDGE_CASES: dict[str, EdgeCase] = {
    "empty road": EdgeCase(30.0, doubt=_should_not_brake),
    "lead stands still": EdgeCase(30.0, [Other(60.0, 0, 0.0)], doubt=_should_brake),
    "all stand still": EdgeCase(0.0, [Other(7.0, 0, 0.0), Other(-7.0, 0, 0.0)]),
    "boxed in": EdgeCase(30.0, _BOX, doubt=_should_stay),
    "bumper to bumper": EdgeCase(35.0, [Other(5.01, 0, 35.0), Other(-5.01, 0, 35.0)]),
    "vehicle exactly beside": EdgeCase(30.0, [Other(0.0, 1, 30.0)]),
    "rightmost lane": EdgeCase(25.0, [Other(30.0, 0, 20.0)], lane=0),
    "leftmost lane": EdgeCase(25.0, [Other(30.0, 0, 20.0)], lane=-1),
    "between two lanes": EdgeCase(30.0, [Other(20.0, 0, 25.0)], between_lanes=2.0),
    "one comes in from the left, its side over the line": EdgeCase(
        30.0, [Other(15.0, 0.4, 22.0, -1.0)], doubt=_should_brake_for_what_comes_in
    ),
    "twelve vehicles at top speed": EdgeCase(40.0, _FULL),
    "standing alone": EdgeCase(0.0),
    "end of the test": EdgeCase(30.0, left_to_drive=-0.5),
}
"""The edge cases by name."""


def edge_case(name: str, odd: Odd | AvContext) -> NDArray[np.float32]:
    """Make the view (13, 8) of an edge case."""
    case = EDGE_CASES[name]
    view = np.zeros((_ROWS, _COLUMNS), dtype=np.float32)
    lane = odd.n_lanes // 2 if case.lane is None else case.lane % odd.n_lanes
    y = (lane + 0.5) * odd.lane_width + case.between_lanes
    sideways = case.between_lanes > 0.0
    view[0] = 1.0, case.left_to_drive, y, case.speed, float(sideways), 0.0, lane, float(sideways)
    shown = [other for other in case.others if 0 <= lane + other.lanes_left < odd.n_lanes]
    for row, other in enumerate(shown, start=1):
        side = other.lanes_left * odd.lane_width - case.between_lanes
        goes_to = lane + np.floor(other.lanes_left)
        view[row] = 1.0, other.ahead, side, other.speed, other.to_left, 0.0, goes_to, float(other.to_left != 0.0)
    return view


def random_views(rng: np.random.Generator, shape: tuple[int, int], odd: Odd | AvContext) -> NDArray[np.float32]:
    """Make views (*shape, 13, 8) of random traffic; there is no motion from one view to the next."""
    view = np.zeros((*shape, _ROWS, _COLUMNS), dtype=np.float32)
    lanes = rng.integers(0, odd.n_lanes, (*shape, _ROWS))
    view[..., 0] = rng.random((*shape, _ROWS)) < 0.8
    view[..., 0, 0] = 1.0
    ahead = rng.uniform(-150.0, 150.0, (*shape, _ROWS - 1))
    view[..., 1:, 1] = np.take_along_axis(ahead, np.argsort(np.abs(ahead), axis=-1), axis=-1)
    view[..., 0, 1] = rng.uniform(0.0, odd.test_length, shape)
    view[..., 2] = (lanes - lanes[..., :1]) * odd.lane_width
    view[..., 0, 2] = (lanes[..., 0] + 0.5) * odd.lane_width
    view[..., 3] = rng.uniform(10.0, odd.max_speed, (*shape, _ROWS))
    view[..., 5] = rng.uniform(-3.0, 2.0, (*shape, _ROWS))
    view[..., 6] = lanes
    # absent vehicles leave no gap between those present
    for step in range(shape[0]):
        for b in range(shape[1]):
            there = view[step, b, :, 0] == 1.0
            rows = view[step, b, there]
            view[step, b] = 0.0
            view[step, b, : len(rows)] = rows
    return view


def sample_views() -> NDArray[np.float32]:
    """Make the views (B, 13, 8) by which networks are judged: edge cases and random traffic, always the same."""
    road = AvContext(1, 3, 4.0, 5.0, 2.0, 40.0, 4.0, 0.1, 400.0, 1, 0)
    edges = [edge_case(name, road) for name in EDGE_CASES]
    return np.concatenate([edges, random_views(np.random.default_rng(0), (1, _SAMPLE), road)[0]]).astype(np.float32)


def ordinary_views(n: int, context: Odd | AvContext) -> NDArray[np.float32]:
    """Make n views (n, 13, 8) of ordinary traffic: the AV in the second lane, and one vehicle ahead of it."""
    view = np.zeros((n, _ROWS, _COLUMNS), dtype=np.float32)
    view[:, 0] = 1.0, context.test_length, 1.5 * context.lane_width, 30.0, 0.0, 0.0, 1.0, 0.0
    view[:, 1] = 1.0, 60.0, 0.0, 28.0, 0.0, 0.0, 1.0, 0.0
    return view


def scenes_of(views: NDArray[np.float32], rows: int, context: AvContext) -> NDArray[np.float64]:
    """Turn views (..., 13, 8) into what an AV of interface 2 sees, (..., rows, 18): all cars, named by their rows."""
    kept = min(rows, _ROWS)
    seen = views[..., :kept, :].astype(np.float64)
    there = seen[..., 0] == 1.0
    running = there[..., :1]
    own_x = np.where(there[..., 0], context.test_length - seen[..., 0, 1], 0.0)
    ahead, left = seen[..., 1].copy(), seen[..., 2].copy()
    ahead[..., 0] = 0.0
    left[..., 0] = 0.0
    y = seen[..., :1, 2] + left
    columns: dict[str, NDArray[np.float64]] = {
        "length": np.full(y.shape, context.vehicle_length),
        "width": np.full(y.shape, context.vehicle_width),
        "x": own_x[..., None] + ahead,
        "y": y,
        "heading": np.arctan2(seen[..., 4], np.maximum(seen[..., 3], 1e-9)),
        "vx": seen[..., 3],
        "vy": seen[..., 4],
        "ax": seen[..., 5],
        "lane": np.clip(np.floor(y / context.lane_width), 0, context.n_lanes - 1),
    }
    table = np.zeros((*views.shape[:-2], rows, len(COLUMNS)))
    for name, values in columns.items():
        table[..., :kept, COLUMNS.index(name)] = np.where(there, values, 0.0)
    table[..., COLUMNS.index("id")] = np.where(running, -1.0, 0.0)
    table[..., :kept, COLUMNS.index("id")] = np.where(
        there, np.arange(kept, dtype=np.float64), table[..., :kept, COLUMNS.index("id")]
    )
    table[..., 0, COLUMNS.index("left_to_drive")] = seen[..., 0, 1]
    table[..., 0, COLUMNS.index("target_lane")] = seen[..., 0, 6]
    return table


class Trials(NamedTuple):
    """Worlds that an AV is tried on: an array for each, as the simulator would show it (`AvSession.shown`).

    Attributes:
        names: Of the edge cases.
        case: Makes the array of an edge case.
        doubt: Takes a name, the AV's acceleration [m/s2] and lane order, and says what is strange, or "".
        random: Makes arrays (*shape, ...) of random traffic, with a generator and a shape.
        ordinary: Makes n arrays (n, ...) of ordinary traffic.
    """

    names: tuple[str, ...]
    case: Callable[[str], NDArray[Any]]
    doubt: Callable[[str, float, float], str]
    random: Callable[[np.random.Generator, tuple[int, int]], NDArray[Any]]
    ordinary: Callable[[int], NDArray[Any]]


def trials_of(odd: Odd | AvContext) -> Trials:
    """Choose what an AV is tried on: on a road, or at a site."""
    if odd.site:
        return Trials(
            tuple(SITE_CASES),
            site_case,
            lambda name, acceleration, _order: SITE_CASES[name].doubt(acceleration),
            random_scenes,
            ordinary_scenes,
        )
    return Trials(
        tuple(EDGE_CASES),
        lambda name: edge_case(name, odd),
        lambda name, acceleration, order: EDGE_CASES[name].doubt(acceleration, order),
        lambda rng, shape: random_views(rng, shape, odd),
        lambda n: ordinary_views(n, odd),
    )
