"""Begin of the manoeuvre that led to a crash: where AV or partner first left what it was doing towards this contact.

Sideways motion is found by positions alone, so that turning back belongs to it, and AVs that steer and recordings of
others are read like vehicles of this simulator (docs/adr/0072-the-moment-it-began.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.road.straight import lane_centre, lane_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers

__all__ = ["APPROACH", "AV_BRAKES", "AV_MOVES", "MANOEUVRES", "OWN_MANOEUVRES", "manoeuvre_begin"]

MANOEUVRES: dict[str, str] = {
    "other-moves": "the other vehicle moves sideways, turning back included",
    "other-brakes": "the other vehicle brakes ahead of the AV",
    "av-moves": "the AV moves sideways, turning back included",
    "av-brakes": "the AV brakes ahead of the other",
    "approach": "the one behind is faster",
    "other-crosses": "the other comes into the AV's way, at a site",
    "av-crosses": "the AV comes into the other's way, at a site",
}
"""What led to a crash, and its meaning, by code."""
OWN_MANOEUVRES = ("av-moves", "av-brakes", "av-crosses")
"""What the AV itself began, and can leave out without time to react."""
OTHER_MOVES, OTHER_BRAKES, AV_MOVES, AV_BRAKES, APPROACH, OTHER_CROSSES, AV_CROSSES = range(len(MANOEUVRES))

_RECENT = 10
"""Frames before the contact up to which a manoeuvre that has ended led to it; pauses below do not end one."""
_LONG = 30
_STILL_M, _WANDER_M, _REST_M, _SAME_M = 0.1, 0.3, 0.01, 1e-5
_BRAKING = -1.0


@inlined_kernel
def _is_settled(frames: NDArray[np.void], slot: int, f: int, road: RoadNumbers) -> bool:
    """Has a vehicle come to rest on a lane's centre, or stayed within 0.1 m for 1 s near it, or for 3 s anywhere?"""
    y = frames[f, slot].y
    off = abs(y - lane_centre(lane_of(y, road.lane_width), road.lane_width))
    is_central = bool(off <= _WANDER_M)
    if f > 0 and frames[f - 1, slot].present and off <= _REST_M and abs(y - frames[f - 1, slot].y) <= _REST_M:
        return True
    low = high = y
    for t in range(f - 1, f - 1 - (_RECENT if is_central else _LONG), -1):
        if t < 0 or frames[t, slot].present == 0:
            return is_central
        low, high = min(low, frames[t, slot].y), max(high, frames[t, slot].y)
        if high - low > _STILL_M:
            return False
    return True


@inlined_kernel
def _moves_since(frames: NDArray[np.void], slot: int, other: int, last: int, road: RoadNumbers) -> int:
    """Find the frame at which a vehicle left its place across the road towards the contact; -1: it kept it.

    Motion of less than 0.3 m is wander, and so is motion that brought it no nearer to where the other is at the
    contact.
    """
    f = last
    while f > max(0, last - _RECENT) and frames[f - 1, slot].present and _is_settled(frames, slot, f, road):
        f -= 1
    if _is_settled(frames, slot, f, road):
        return -1
    while f > 0 and frames[f - 1, slot].present and not _is_settled(frames, slot, f, road):
        f -= 1
    step = frames[min(f + 1, last), slot].y - frames[f, slot].y
    for _ in range(_RECENT):
        if f == 0 or frames[f - 1, slot].present == 0:
            break
        before = frames[f, slot].y - frames[f - 1, slot].y
        if abs(before) <= _SAME_M or before * step < 0.0 or abs(before) > abs(step):
            break
        f, step = f - 1, before
    meets = frames[last, other].y
    farthest = 0.0
    for t in range(f, last):
        farthest = max(farthest, abs(frames[t, slot].y - meets))
    return f if farthest >= abs(frames[last, slot].y - meets) + _WANDER_M else -1


@inlined_kernel
def _brakes_since(frames: NDArray[np.void], slot: int, last: int) -> int:
    """Find the begin of a vehicle's last uninterrupted braking of at least 1 m/s2, up to 1 s before; -1: none."""
    for f in range(last - 1, max(-1, last - 1 - _RECENT), -1):
        if frames[f, slot].present and frames[f, slot].acceleration <= _BRAKING:
            while f > 0 and frames[f - 1, slot].present and frames[f - 1, slot].acceleration <= _BRAKING:
                f -= 1
            return f
    return -1


@inlined_kernel
def _closes_since(frames: NDArray[np.void], partner: int, last: int) -> int:
    """Find the first frame from which the rear one of AV and partner was faster until the contact.

    Pauses below 1 s do not count. 0, the start of the test, if it was not faster within the last second.
    """
    behind, ahead = partner, 0
    if frames[last, partner].x > frames[last, 0].x:
        behind, ahead = 0, partner
    begin, paused = 0, 0
    for f in range(last - 1, -1, -1):
        if frames[f, partner].present == 0 or paused >= _RECENT:
            break
        if frames[f, behind].speed > frames[f, ahead].speed:
            begin, paused = f, 0
        else:
            paused += 1
    return begin


@kernel
def manoeuvre_begin(frames: NDArray[np.void], partner: int, last: int, road: RoadNumbers) -> tuple[int, int]:
    """Find the frame at which the manoeuvre began that led to the AV's crash with `partner` at frame `last`.

    The first of these that exists: sideways motion of the partner or the AV that brought the two together, the earlier
    one of both; braking of the one ahead; the time in which the one behind was faster. What ended more than 1 s before
    the contact is none of the first two. A manoeuvre of the AV itself is given with the frame before it, so that a
    driver in its place can leave it out.

    Args:
        frames: Recording, (frames, slots) of `fields.FRAME_FIELDS`.
        partner: Slot that the AV touched.
        last: Frame of the contact.
        road: Constants.

    Returns:
        The frame, and the place in `MANOEUVRES`.
    """
    other = _moves_since(frames, partner, 0, last, road)
    own = _moves_since(frames, 0, partner, last, road)
    if own >= 0 and (other < 0 or own < other):
        for _ in range(_RECENT):
            if own == 0 or frames[own, 0].target_lane == lane_of(frames[own, 0].y, road.lane_width):
                break
            own -= 1
        return own, AV_MOVES
    if other >= 0:
        return other, OTHER_MOVES
    closes = _closes_since(frames, partner, last)
    if frames[last, partner].x > frames[last, 0].x:
        brakes = _brakes_since(frames, partner, last)
        return (brakes, OTHER_BRAKES) if brakes >= 0 else (closes, APPROACH)
    brakes = _brakes_since(frames, 0, last)
    return (min(max(brakes - 1, 0), closes), AV_BRAKES) if brakes >= 0 else (closes, APPROACH)
