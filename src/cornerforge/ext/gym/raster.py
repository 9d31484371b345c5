"""Picture of the road around the AV from above, drawn with NumPy alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cornerforge.road.straight import RoadNumbers, along, lane_centre
from cornerforge.sim import World

__all__ = ["top_view"]

_BEHIND, _AHEAD = 50.0, 100.0
_VERGE = 2.0
_PIXELS_PER_M = 6
_GRASS, _ASPHALT, _PAINT = (70, 100, 60), (60, 60, 64), (235, 235, 235)
_OTHER, _AV, _CONTROLLED, _GLASS = (200, 200, 200), (70, 140, 255), (230, 70, 60), (25, 30, 40)
_DASH, _PERIOD = 3.0, 12.0
_LINE = 0.15


def top_view(worlds: World, b: int, road: RoadNumbers) -> NDArray[np.uint8]:
    """Draw world b, uint8 (height, width, 3): x to the right, left lanes above, 6 pixels to the metre.

    From 50 m behind to 100 m ahead of the AV (blue); the controlled BV is red, others are grey; the dark stripe is the
    windscreen. Its size depends on the number and width of lanes only.
    """
    v = worlds.vehicles[b]
    state = worlds.state[b, 0]
    first = float(along(_BEHIND, v["x"][0]))
    top = road.n_lanes * road.lane_width + _VERGE
    width = round((_BEHIND + _AHEAD) * _PIXELS_PER_M)
    height = round((top + _VERGE) * _PIXELS_PER_M)
    x = first + (np.arange(width) + 0.5) / _PIXELS_PER_M
    y = top - (np.arange(height) + 0.5) / _PIXELS_PER_M
    image = np.empty((height, width, 3), dtype=np.uint8)
    image[:] = _GRASS
    image[(y > 0.0) & (y < top - _VERGE)] = _ASPHALT
    dashed = (x % _PERIOD) < _DASH
    for lane in range(road.n_lanes + 1):
        edge = lane_centre(lane, road.lane_width) - 0.5 * road.lane_width
        inside = np.ones_like(dashed) if lane in (0, road.n_lanes) else dashed
        image[np.ix_(np.abs(y - edge) < _LINE, inside)] = _PAINT
    for i in range(int(state["n_vehicles"]) - 1, -1, -1):
        length = v["length"][i]
        if v["present"][i] and -_BEHIND - length < along(v["x"][0], v["x"][i]) < _AHEAD + length:
            colour = _AV if i == 0 else _CONTROLLED if i == state["controlled"] else _OTHER
            _draw_box(image, x, y, v[i], colour)
    return image


def _draw_box(
    image: NDArray[np.uint8],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    vehicle: np.void,
    colour: tuple[int, int, int],
) -> None:
    length, width = vehicle["length"], vehicle["width"]
    reach = 0.5 * (length + width)
    columns = np.flatnonzero(np.abs(along(vehicle["x"], x)) < reach)
    rows = np.flatnonzero(np.abs(y - vehicle["y"]) < reach)
    if columns.size == 0 or rows.size == 0:
        return
    dx, dy = np.meshgrid(along(vehicle["x"], x[columns]), y[rows] - vehicle["y"])
    cosine, sine = math.cos(vehicle["heading"]), math.sin(vehicle["heading"])
    forward, across = dx * cosine + dy * sine, dy * cosine - dx * sine
    body = (np.abs(forward) <= 0.5 * length) & (np.abs(across) <= 0.5 * width)
    glass = body & (forward > 0.1 * length) & (forward < 0.25 * length) & (np.abs(across) < 0.4 * width)
    part = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    part[body] = colour
    part[glass] = _GLASS
