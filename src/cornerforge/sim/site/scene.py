"""View of a site for an AV from outside: its path, its stop line and light, and the agents around it, in its own frame.

The frame's origin is the middle of the AV's box, x ahead, y to the left [m], angles counter-clockwise [rad]. float32 or
float64, (22 + how many agents to show at most, 10):

| row | columns |
| --- | --- |
| 0, the AV | as of an agent; ID 0, VX its speed |
| 1, the moment | TIME since the start of the test [s]; ACCELERATION now [m/s2]; TO_STOP_LINE from the AV's front [m], negative behind it; LIGHT of it: 0 none, 1 red, 2 yellow, 3 green, 4 green that yields; LEFT_TO_DRIVE to the end of its route [m] |
| 2 to 21, its path | each 2 m farther along its route, the first 2 m ahead: PATH_X, PATH_Y [m], PATH_HEADING [rad], LIMIT [m/s], CURVATURE, to the left positive [1/m]; straight on behind the route's end |
| 22 on, agents | nearest first, within 200 m: ID, a number that stays with it, -1: none, all else 0; KIND, index of `types.CLASSES`; LENGTH, WIDTH [m]; X, Y, HEADING; VX, VY velocity over the ground in the AV's frame [m/s]; PRIORITY where its route meets the AV's: 1 it goes first, -1 the AV does, 0 neither by rule (a light decides, or their routes meet nowhere ahead) |

LIMIT is the speed that the limit and the turns there and ahead allow, as the laws of drivers have it. Lights of others
are not seen.
"""  # noqa: E501 - a table

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.neighbours import SIGHT
from cornerforge.site.tables import MEETINGS, NO_ZONE, letter_at, longer, place_of, pose_at, speed_at
from cornerforge.types import FRAME_S, PERSON

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.sim.world import World

__all__ = ["FIRST_AGENT", "PATH_POINTS", "PATH_STEP", "SITE_COLUMNS", "seconds_within", "site_scene_of_av"]

PATH_POINTS, PATH_STEP = 20, 2.0
"""Points of the path ahead, and their distance [m]."""
FIRST_AGENT = 2 + PATH_POINTS
"""Row of the nearest agent."""
ID, KIND, LENGTH, WIDTH, X, Y, HEADING, VX, VY, PRIORITY = range(10)
TIME, ACCELERATION, TO_STOP_LINE, LIGHT, LEFT_TO_DRIVE = range(5)
PATH_X, PATH_Y, PATH_HEADING, LIMIT, CURVATURE = range(5)
SITE_COLUMNS = PRIORITY + 1


@inlined_kernel
def seconds_within(w: World) -> float:
    """Compute the time since the start of the test [s], in tenths of a second."""
    state = w.state[0]
    second: int = state.decisions if state.substep == 0 else state.decisions - 1
    seconds: float = second + FRAME_S * state.substep
    return seconds


@kernel
def _priority(w: World, j: int, site: NDArray[np.void]) -> float:
    """Say who goes first by rule where the route of slot j meets the AV's: 1 slot j, -1 the AV, 0 neither."""
    own, other = w.agents[0], w.agents[j]
    first = 0.0
    for meeting in range(MEETINGS):
        zone = site[0].zone[own.route, other.route, meeting]
        if zone.kind == NO_ZONE:
            break
        theirs = longer(w.vehicles[j].length, w.vehicles[j].kind == PERSON)
        if own.s > zone.end + longer(w.vehicles[0].length, False) or other.s > zone.other_end + theirs:
            continue
        if zone.yields:
            return 1.0
        if zone.goes_first:
            first = -1.0
    return first


@inlined_kernel
def _nearest(w: World, found: NDArray[np.int64], most: int) -> int:
    """List the slots of at most `most` agents nearest to the AV in `found`; return how many."""
    v = w.vehicles
    count = 0
    for j in range(1, w.state[0].n_vehicles):
        dx, dy = v[j].x - v[0].x, v[j].y - v[0].y
        away = dx * dx + dy * dy
        if v[j].present == 0 or away >= SIGHT * SIGHT:
            continue
        place = count
        while place > 0:
            k = found[place - 1]
            dx, dy = v[k].x - v[0].x, v[k].y - v[0].y
            if dx * dx + dy * dy <= away:
                break
            if place < most:
                found[place] = k
            place -= 1
        if place < most:
            found[place] = j
            count = min(count + 1, most)
    return count


@inlined_kernel
def _turned(angle: float) -> float:
    """Bring an angle into -pi to pi."""
    while angle > 3.141592653589793:
        angle -= 6.283185307179586
    while angle < -3.141592653589793:
        angle += 6.283185307179586
    return angle


@kernel
def _show_path(w: World, site: NDArray[np.void], sine: float, cosine: float, out: NDArray[Any]) -> None:
    me, own = w.vehicles[0], w.agents[0]
    end = site[0].route[own.route].length
    for k in range(PATH_POINTS):
        s = own.s + PATH_STEP * (k + 1)
        x, y, heading = pose_at(site, own.route, s)
        if s > end:
            up, along = sin_cos(heading)
            x, y = x + (s - end) * along, y + (s - end) * up
        place, _ = place_of(site, own.route, s)
        row = out[2 + k]
        row[PATH_X] = (x - me.x) * cosine + (y - me.y) * sine
        row[PATH_Y] = (y - me.y) * cosine - (x - me.x) * sine
        row[PATH_HEADING] = _turned(heading - me.heading)
        row[LIMIT] = speed_at(site, own.route, s)
        row[CURVATURE] = site[0].place[own.route, place].curvature if s <= end else 0.0


@kernel
def site_scene_of_av(w: World, site: NDArray[np.void], found: NDArray[np.int64], out: NDArray[Any]) -> None:
    """Write what the AV sees into `out`.

    Args:
        w: The world, as the AV perceives it (`perception.show_as_seen`).
        site: The site.
        found: Scratch, int64 (slots,).
        out: Floats (FIRST_AGENT + how many agents to show at most, SITE_COLUMNS), as the head of this module says.
    """
    v, own = w.vehicles, w.agents[0]
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            out[row, column] = 0.0
    sine, cosine = sin_cos(v[0].heading)
    route = site[0].route[own.route]
    out[0, LENGTH], out[0, WIDTH], out[0, VX] = v[0].length, v[0].width, v[0].speed
    out[0, KIND] = v[0].kind
    out[1, TIME] = seconds_within(w)
    out[1, ACCELERATION] = v[0].acceleration
    out[1, TO_STOP_LINE] = route.stop - own.s - 0.5 * v[0].length
    if route.signal >= 0:
        out[1, LIGHT] = 1.0 + letter_at(site, own.route, w.state[0].clock + seconds_within(w))
    out[1, LEFT_TO_DRIVE] = route.length - own.s
    _show_path(w, site, sine, cosine, out)
    count = _nearest(w, found, out.shape[0] - FIRST_AGENT)
    for k in range(out.shape[0] - FIRST_AGENT):
        row = out[FIRST_AGENT + k]
        if k >= count:
            row[ID] = -1.0
            continue
        j = found[k]
        dx, dy = v[j].x - v[0].x, v[j].y - v[0].y
        turned = _turned(v[j].heading - v[0].heading)
        up, along = sin_cos(turned)
        row[ID], row[KIND], row[LENGTH], row[WIDTH] = j, v[j].kind, v[j].length, v[j].width
        row[X], row[Y] = dx * cosine + dy * sine, dy * cosine - dx * sine
        row[HEADING] = turned
        row[VX], row[VY] = v[j].speed * along, v[j].speed * up
        row[PRIORITY] = _priority(w, j, site)
