"""Picture of the road around the AV from above, drawn with NumPy alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cornerforge.report.surface import MARKS, outline, strokes, surface_of
from cornerforge.road.straight import along
from cornerforge.sim import World
from cornerforge.types import Odd

__all__ = ["top_view"]

_Floats = NDArray[np.float64]
_Colour = tuple[int, int, int]
_BEHIND, _AHEAD = 50.0, 100.0
_VERGE, _PIXELS_PER_M = 2.0, 6
_GRASS, _ASPHALT, _PAINT, _BARRIER = (70, 100, 60), (60, 60, 64), (235, 235, 235), (200, 50, 45)
_OTHER, _AV, _CONTROLLED, _GLASS = (200, 200, 200), (70, 140, 255), (230, 70, 60), (25, 30, 40)


def top_view(worlds: World, b: int, odd: Odd) -> NDArray[np.uint8]:
    """Draw world b, uint8 (height, width, 3): x to the right, left lanes above, 6 pixels to the metre.

    From 50 m behind to 100 m ahead of the AV (blue); the controlled BV is red, others are grey; the dark stripe is the
    windscreen. Its size depends on the number and width of lanes only. Lines are twice as wide as on the road.
    """
    v = worlds.vehicles[b]
    state = worlds.state[b, 0]
    first = float(along(_BEHIND, v["x"][0]))
    top = odd.n_lanes * odd.lane_width + _VERGE
    width = round((_BEHIND + _AHEAD) * _PIXELS_PER_M)
    height = round((top + _VERGE) * _PIXELS_PER_M)
    x = first + (np.arange(width) + 0.5) / _PIXELS_PER_M
    y = top - (np.arange(height) + 0.5) / _PIXELS_PER_M
    image = np.full((height, width, 3), _GRASS, dtype=np.uint8)
    surface, last = surface_of(odd), first + _BEHIND + _AHEAD
    for area in surface.areas:
        _fill(image, x, y, outline(area, first, last, 0.0), _ASPHALT)
    for line in surface.lines:
        h, colour = MARKS[line.mark][0], _BARRIER if line.mark == "barrier" else _PAINT
        for (begin, y0), (end, y1) in strokes(line, first, last):
            across = [(begin - h, y0), (begin + h, y0), (begin + h, y1), (begin - h, y1)]
            along_it = [(begin, y0 - h), (end, y1 - h), (end, y1 + h), (begin, y0 + h)]
            _fill(image, x, y, np.array(across if begin == end else along_it), colour)
    for i in range(int(state["n_vehicles"]) - 1, -1, -1):
        length = v["length"][i]
        if v["present"][i] and -_BEHIND - length < along(v["x"][0], v["x"][i]) < _AHEAD + length:
            colour = _AV if i == 0 else _CONTROLLED if i == state["controlled"] else _OTHER
            _draw_box(image, x, y, v[i], colour)
    return image


def _fill(image: NDArray[np.uint8], x: _Floats, y: _Floats, corners: _Floats, colour: _Colour) -> None:
    """Paint what lies between two places along the road and two straight sides, as `surface.outline` gives it."""
    columns = slice(*np.searchsorted(x, corners[:2, 0]))
    rows = slice(*np.searchsorted(-y, (-corners[:, 1].max(), -corners[:, 1].min())))
    if corners[0, 1] == corners[1, 1] and corners[2, 1] == corners[3, 1]:
        image[rows, columns] = colour  # a rectangle, several times faster
        return
    right, left = np.interp(x[columns], *corners[:2].T), np.interp(x[columns], *corners[:1:-1].T)
    image[rows, columns][(y[rows, None] > right) & (y[rows, None] < left)] = colour


def _draw_box(image: NDArray[np.uint8], x: _Floats, y: _Floats, vehicle: np.void, colour: _Colour) -> None:
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
