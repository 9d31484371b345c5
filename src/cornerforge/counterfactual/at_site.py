"""Ways out of a recorded crash at a site, where the AV's path is fixed: only its speed along its route can differ.

The others, as recorded and, after the contact, as `carry_on` says, forbid places of the route at each tenth of a second
(`forbid`). `search_speeds` tries every sequence of the AV's accelerations, driven as the simulator drives them; what it
finds is a way out that touches nobody. `may_exist` bounds the states that the AV can reach at all, without jerk limit
and with any acceleration between the hardest and the strongest: where that set is empty, there is none.
docs/adr/0085-judges-at-sites.md says what is exact in it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.sim import motion
from cornerforge.site.tables import pose_at
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers

__all__ = [
    "SpeedSearch",
    "allocate_speed_search",
    "carry_on",
    "drive_profile",
    "first_touch",
    "forbid",
    "may_exist",
    "places_along",
    "rooms_to",
    "search_speeds",
]

GRID = 0.1
"""Places along the route are tried so far apart [m]."""
_DS, _DV, _DA = 0.1, 0.2, 1.0
"""States of the search that are so near to one another count as one [m, m/s, m/s2]."""
_PLACES, _SPEEDS, _RATES = 1400, 200, 16
_LOWEST_RATE = -10.0
_LONGEST = 36_100
"""Frames of the longest recording."""
_NODES = 200_000
_BOXES = 64
_FAR, _SLIVER = 80.0, 1e-9
"""Ways are looked along so far [m]."""


class SpeedSearch(NamedTuple):
    """Memory for a search; one serves one thread.

    Attributes:
        state: Place [m], speed [m/s] and acceleration [m/s2] of each state that was reached, (nodes, 3).
        parent, choice: The state before, and which acceleration led from there, (nodes,).
        seen: Number of the layer that saw a state, by its rounded values.
        counts: [number of the layer].
        boxes: Sets of places and speeds of two moments, (2, boxes, 4).
        found: Accelerations of a way's decisions [m/s2], at least as many as there are.
    """

    state: NDArray[np.float64]
    parent: NDArray[np.int64]
    choice: NDArray[np.int64]
    seen: NDArray[np.int32]
    counts: NDArray[np.int64]
    boxes: NDArray[np.float64]
    found: NDArray[np.float64]


def allocate_speed_search() -> SpeedSearch:
    """Allocate the memory of a search."""
    return SpeedSearch(
        np.empty((_NODES, 3)), np.empty(_NODES, np.int64), np.empty(_NODES, np.int64),
        np.zeros((_PLACES, _SPEEDS, _RATES), np.int32), np.zeros(1, np.int64),
        np.empty((2, _BOXES, 4)), np.empty(_LONGEST),
    )  # fmt: skip


@inlined_kernel
def _is_finite(x: float) -> bool:
    """Is x neither NaN nor infinite?"""
    return -np.inf < x < np.inf


@kernel
def places_along(
    site: NDArray[np.void], route: int, x: NDArray[np.float64], y: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """Find how far along its route an agent is in each frame [m], (T,); NaN where x is.

    The nearest place in its first frame, then the nearest from there on that is not farther than 8 m.
    """
    row = site[0].route[route]
    place = site[0].place[route]
    at = -1
    for t in range(x.size):
        out[t] = np.nan
        if not _is_finite(x[t]):
            continue
        first, last = (0, row.places - 1) if at < 0 else (max(0, at - 1), min(row.places - 1, at + 8))
        best = np.inf
        for k in range(first, last):
            dx, dy = place[k + 1].x - place[k].x, place[k + 1].y - place[k].y
            part = ((x[t] - place[k].x) * dx + (y[t] - place[k].y) * dy) / max(dx * dx + dy * dy, 1e-12)
            part = min(max(part, 0.0), 1.0)
            ox, oy = x[t] - place[k].x - part * dx, y[t] - place[k].y - part * dy
            away = ox * ox + oy * oy
            if away < best:
                best = away
                at = k
                out[t] = (k + part) * row.step


@kernel
def carry_on(
    site: NDArray[np.void], routes: NDArray[np.int64], last: int, behind: NDArray[np.bool_],
    s: NDArray[np.float64], speed: NDArray[np.float64], rate: NDArray[np.float64],
) -> None:  # fmt: skip
    """Write places of the others after the contact: each keeps its speed, or brakes on to a stop if it brakes.

    Those at the end of their routes are gone, and so are those `behind` the AV on its own way, who would react.

    Args:
        site: The site.
        routes: Of each agent, (N,).
        last: Frame of the contact.
        behind: Agents that are left out from then on, (N,).
        s: Places [m], (frames, N), NaN where absent; the frames after the contact are written.
        speed, rate: Speeds [m/s] and accelerations [m/s2] at the contact, (N,).
    """
    for j in range(routes.size):
        braking = min(rate[j], 0.0) if rate[j] < -0.2 else 0.0
        for t in range(last + 1, s.shape[0]):
            s[t, j] = np.nan
            if j == 0 or behind[j] or not _is_finite(s[last, j]):
                continue
            time = (t - last) * FRAME_S
            if braking < 0.0:
                time = min(time, speed[j] / -braking)
            place = s[last, j] + speed[j] * time + 0.5 * braking * time * time
            if place < site[0].route[routes[j]].length - 1e-9:
                s[t, j] = place


@kernel
def touched(
    site: NDArray[np.void], routes: NDArray[np.int64], sizes: NDArray[np.float64], s: NDArray[np.float64], t: int,
    place: float,
) -> int:  # fmt: skip
    """Say which agent the AV's box touches at a place of its route in frame t; -1: none, or it has arrived."""
    if place >= site[0].route[routes[0]].length - 1e-9:
        return -1
    x, y, heading = pose_at(site, routes[0], place)
    own = Box(x, y, heading, sizes[0, 0], sizes[0, 1])
    for j in range(1, routes.size):
        if not _is_finite(s[t, j]):
            continue
        ox, oy, other = pose_at(site, routes[j], s[t, j])
        reach = 0.5 * (sizes[0, 0] + sizes[0, 1] + sizes[j, 0] + sizes[j, 1])
        near = abs(ox - x) < reach and abs(oy - y) < reach
        if near and boxes_overlap(own, Box(ox, oy, other, sizes[j, 0], sizes[j, 1])):
            return j
    return -1


@kernel
def rooms_to(
    site: NDArray[np.void], routes: NDArray[np.int64], sizes: NDArray[np.float64], s: NDArray[np.float64], i: int,
    j: int, out: NDArray[np.float64],
) -> None:  # fmt: skip
    """Find how far agent j is in each frame from touching agent i where that is then [m], along its route.

    0 where they touch, +inf where it passes, or has passed, or one is not there; to 0.1 m, and `_FAR` at most.
    """
    for t in range(s.shape[0]):
        out[t] = np.inf
        if not (_is_finite(s[t, i]) and _is_finite(s[t, j])):
            continue
        x, y, heading = pose_at(site, routes[i], s[t, i])
        box = Box(x, y, heading, sizes[i, 0], sizes[i, 1])
        reach = 0.5 * (sizes[i, 0] + sizes[i, 1] + sizes[j, 0] + sizes[j, 1])
        way = 0.0
        while way <= _FAR and s[t, j] + way <= site[0].route[routes[j]].length:
            ox, oy, other = pose_at(site, routes[j], s[t, j] + way)
            apart = math.sqrt((ox - x) * (ox - x) + (oy - y) * (oy - y)) - reach
            if apart < 0.0 and boxes_overlap(box, Box(ox, oy, other, sizes[j, 0], sizes[j, 1])):
                out[t] = way
                break
            way += max(GRID, 0.9 * apart)


@kernel
def first_touch(
    site: NDArray[np.void], routes: NDArray[np.int64], sizes: NDArray[np.float64], s: NDArray[np.float64], frame: int,
    track: NDArray[np.float64],
) -> int:  # fmt: skip
    """Find the first frame in which the AV touches another on a track, (W, 3), from a frame on; -1: none."""
    for k in range(track.shape[0]):
        if touched(site, routes, sizes, s, frame + k, track[k, 0]) >= 0:
            return frame + k
    return -1


@kernel
def forbid(
    site: NDArray[np.void], routes: NDArray[np.int64], sizes: NDArray[np.float64], s: NDArray[np.float64],
    first: int, begin: float, out: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Mark the places of the AV's route at which its box would touch another: `out`, (frames from `first` on, places).

    Places lie `GRID` apart from `begin` on [m].
    """
    for k in range(out.shape[0]):
        for m in range(out.shape[1]):
            out[k, m] = touched(site, routes, sizes, s, first + k, begin + m * GRID) >= 0


@kernel
def _is_free(forbidden: NDArray[np.bool_], k: int, place: float, begin: float) -> bool:
    """Is a place free in row k, and the grid's places on both sides of it?"""
    m = math.floor((place - begin) / GRID)
    if m < 0 or m + 1 >= forbidden.shape[1]:
        return m >= 0
    return not (forbidden[k, m] or forbidden[k, m + 1])


@kernel
def drive_profile(
    start: tuple[float, float, float], commands: NDArray[np.float64], road: RoadNumbers, out: NDArray[np.float64]
) -> None:
    """Drive the AV by accelerations, one each tenth of a second: rows of place, speed and acceleration, (K + 1, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = start
    for k in range(commands.size):
        gone, at_top, after, now = motion.go_on(out[k, 1], out[k, 2], commands[k], FRAME_S, road)
        out[k + 1, 0], out[k + 1, 1], out[k + 1, 2] = out[k, 0] + gone + at_top, after, now


@kernel
def search_speeds(
    forbidden: NDArray[np.bool_], row: int, start: tuple[float, float, float], begin: float,
    accelerations: NDArray[np.float64], every: int, road: RoadNumbers, scratch: SpeedSearch,
) -> int:  # fmt: skip
    """Look for accelerations, one each `every` frames, with which the AV touches nobody until the last row.

    Args:
        forbidden: (frames, places), from `forbid`.
        row: Row of the start.
        start: Place [m], speed [m/s] and acceleration [m/s2] of the AV then.
        begin: The first place of the table [m].
        accelerations: Those that it may command, (A,).
        every: Frames between two decisions.
        road: Constants.
        scratch: Memory; `found` holds the accelerations of the decisions, if there is a way.

    Returns:
        The number of decisions of a way; 0: none was found; -1: there were too many states.
    """
    state, parent, choice = scratch.state, scratch.parent, scratch.choice
    state[0, 0], state[0, 1], state[0, 2] = start
    parent[0] = -1
    first, after, row_now, depth = 0, 1, row, 0
    rows = forbidden.shape[0]
    while row_now < rows - 1:
        steps = min(every, rows - 1 - row_now)
        scratch.counts[0] += 1
        layer = scratch.counts[0]
        end = after
        for node in range(first, after):
            for a in range(accelerations.size):
                s, v, rate = state[node, 0], state[node, 1], state[node, 2]
                free = True
                for k in range(1, steps + 1):
                    gone, at_top, v, rate = motion.go_on(v, rate, accelerations[a], FRAME_S, road)
                    s += gone + at_top
                    if not _is_free(forbidden, row_now + k, s, begin):
                        free = False
                        break
                if not free:
                    continue
                i = min(int((s - begin) / _DS), _PLACES - 1)
                j = min(int(v / _DV), _SPEEDS - 1)
                h = min(max(int((rate - _LOWEST_RATE) / _DA), 0), _RATES - 1)
                if scratch.seen[i, j, h] == layer:
                    continue
                scratch.seen[i, j, h] = layer
                if end == state.shape[0]:
                    return -1
                state[end, 0], state[end, 1], state[end, 2] = s, v, rate
                parent[end] = node
                choice[end] = a
                end += 1
        if end == after:
            return 0
        first, after = after, end
        row_now += steps
        depth += 1
    node = first
    for k in range(depth):
        scratch.found[depth - 1 - k] = accelerations[choice[node]]
        node = parent[node]
    return depth


@kernel
def may_exist(
    forbidden: NDArray[np.bool_], row: int, start: tuple[float, float, float], begin: float, hardest: float,
    strongest: float, road: RoadNumbers, scratch: SpeedSearch,
) -> bool:  # fmt: skip
    """Say whether a way out may exist: a set of places and speeds that holds all that the AV can reach is not empty.

    In each gap between forbidden places it is a box of places and speeds; speeds change by at most `hardest` down and
    `strongest` up [m/s2], at once, but places and speeds stay between those of an AV that brakes, and one that
    accelerates, as hard as it may from the start on, with the limit of jerk. A gap of less than `GRID` counts as none.
    """
    boxes, made = scratch.boxes[0], scratch.boxes[1]
    near, slowest, near_rate = start
    far, fastest, far_rate = start
    boxes[0, 0], boxes[0, 1], boxes[0, 2], boxes[0, 3] = near, near, slowest, slowest
    n = 1
    places = forbidden.shape[1]
    for k in range(row + 1, forbidden.shape[0]):
        count, gap_begin = 0, -np.inf
        gone, at_top, slowest, near_rate = motion.go_on(slowest, near_rate, -hardest, FRAME_S, road)
        near += gone + at_top
        gone, at_top, fastest, far_rate = motion.go_on(fastest, far_rate, strongest, FRAME_S, road)
        far += gone + at_top
        for m in range(places + 1):
            if m < places and not forbidden[k, m]:
                continue
            gap_end = begin + m * GRID if m < places else np.inf
            low, high, slow, fast = np.inf, -np.inf, np.inf, -np.inf
            for b in range(n):
                least = max(slowest, boxes[b, 2] - hardest * FRAME_S)
                largest = min(fastest, boxes[b, 3] + max(strongest, far_rate) * FRAME_S)
                one, two = boxes[b, 0] + least * FRAME_S, boxes[b, 1] + largest * FRAME_S
                one, two = max(one, gap_begin, near - _SLIVER), min(two, gap_end, far + _SLIVER)
                if one <= two:
                    low, high, slow, fast = min(low, one), max(high, two), min(slow, least), max(fast, largest)
            if low <= high and gap_end - gap_begin > 1.5 * GRID:
                if count == _BOXES:
                    return True
                made[count, 0], made[count, 1], made[count, 2], made[count, 3] = low, high, slow, fast
                count += 1
            gap_begin = gap_end
        if count == 0:
            return False
        n = count
        for b in range(n):
            for q in range(4):
                boxes[b, q] = made[b, q]
    return True
