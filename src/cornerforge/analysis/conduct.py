"""The AV's own mistakes before a crash, read from the recorded motion and from reference drivers, so for any AV.

RSS says which vehicle broke a rule last, a way out what could have helped. An engineer asks what the AV does. The rules
look at the AV and the vehicle that it touched, rules 5 and 6 at the reference drivers in the AV's place (`prevented`);
in this order, the first that fits names the case, else "none" (docs/adr/0069-one-judgement.md):

1. `hesitates`: within 8 s before, it had left its lane and turned back, or turned three times, and it moved sideways in
   the last 3 s; or it was astride a line for 3.5 s of them, and at the contact.
2. It moved into the other's path, and the other did not move into its own. When that lane change began, the other was
   beside it or would have had to brake with more than 3 m/s2 from 0.4 s on (UN Regulation 79's critical situation):
   `not-behind` if the other's centre was behind its own, `not-beside` if it was ahead. Else `cuts-in` if it left less
   than 0.3 s to the one behind, or was itself that near behind the other.
3. It ran into the rear of one that had been in its path for at least 1 s: they overlapped sideways, or the other's body
   was in the AV's lane, by 0.375 m at least. It had to act when the time to collision fell below 4 s, or when 1.5 m/s2
   of braking were needed, the other's own braking included. Only if 0.8 s later no more than 6 m/s2 were needed:
   `brakes-late` if it began to brake (1 m/s2) more than 0.8 s after; if it never did, `stops-heeding` where its
   acceleration had risen by 0.5 m/s2 within 0.5 s behind the other, else `does-not-brake`. `brakes-weakly` if it braked
   for the last 0.8 s or longer, never with more than 3 m/s2, and 6 m/s2 from when it began would have been enough.
4. It ran into the rear of one behind which it had followed for 2 s with a time gap of less than 0.8 s, without closing
   in (1 m/s): `too-close`.
5. `brakes-hard`: struck by one behind it, before which it had braked with 3 m/s2 or more within 3 s, where at least
   three of the four reference drivers saw no danger, none braked so hard, and to keep its speed would have been enough.
6. `reacts-late`: at least three of the four reference drivers would have prevented it by braking, and its rear was not
   struck: a driver that had braked had been somewhere else then, but not because braking helps there.

On a road where lanes end three more (`lane_ends`), where the lane that ends is one that drivers leave within 20 s:

7. `merges-blind` for `not-behind` and `not-beside`, where the AV's own lane ended. `cuts-in` and `brakes-hard` are none
   there: drivers take shorter gaps where they must, and an end is something to brake for.
8. `blocks-mergers`: the other, ahead of the AV, came over from a lane beside it that ended; the AV had become faster by
   0.5 m/s in the 3 s before, and did not brake (1 m/s2) for 0.8 s from when that could be seen; some reference driver
   would have prevented it.
9. `stops-at-end`: within 10 s before, it drove with less than 8 m/s in a lane that ended, although for 1 s there had
   been a gap in the next lane, which it did not try to take (0.2 m): 1 s to both neighbours, and less than 0.5 m/s2
   of braking for the rear one.

The last two stand in for rules 5 and 6 where both fit.

At a site the rules are those of `site_conduct`: what the AV did by the light, right of way, crosswalk or RSS
(`runs-red`, `does-not-yield`, `does-not-yield-to-people`, `enters-blocked`, `drives-on`, `brakes-late`,
`does-not-brake`), else rule 6 with the one careful driver that there is; `overlooks-hidden-people` and
`overlooks-hidden` instead where the other came out from behind a vehicle within 3 s before.

Cut in by another vehicle too near for most of them, struck from behind or from the side while it kept its lane and
speed, an AV has done nothing wrong by these rules.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.analysis.lane_ends import blocks_since, ends_soon, stops_since
from cornerforge.analysis.pair import AV, BV, PairMotion, pair_motion
from cornerforge.analysis.prevented import Prevention
from cornerforge.analysis.site_conduct import conduct_at_site
from cornerforge.fields import BEFORE_CONTACT, Field
from cornerforge.recordings import Recordings
from cornerforge.road.straight import lane_centre, lane_of
from cornerforge.types import FRAME_S, Odd

__all__ = ["CONDUCTS", "CONDUCT_COLUMNS", "IN_SHORT", "NO_CONDUCT", "Conduct", "conduct_of"]

CONDUCTS: dict[str, str] = {
    "none": "nothing that is the AV's own doing",
    "hesitates": "it leaves a lane and turns back, or changes its mind again and again",
    "not-behind": "it changes lanes too near in front of another vehicle, or into one beside it that is further back",
    "not-beside": "it changes lanes into a vehicle beside it, or close behind a slower one",
    "brakes-late": "it brakes for a vehicle ahead more than 0.8 s after it had to",
    "brakes-weakly": "it brakes for a vehicle ahead in time, but with 3 m/s2 at most, all the way into it",
    "stops-heeding": "it runs into a vehicle ahead that it had heeded, without braking",
    "does-not-brake": "it runs into a vehicle ahead without braking",
    "too-close": "it runs into a vehicle that it had followed with a time gap of less than 0.8 s",
    "cuts-in": "it changes lanes with a time gap of less than 0.3 s",
    "brakes-hard": "it brakes hard for nothing, and is struck from behind",
    "reacts-late": "it brakes later or less than most models of a careful driver, which would have prevented the crash",
    "merges-blind": "it leaves a lane that ends too near in front of another vehicle, behind a slower one, or into one",
    "blocks-mergers": "it closes the gap to a vehicle whose lane ends, and does not brake when that one comes over",
    "stops-at-end": "it stops where its lane ends, although there had been a gap in the next lane",
    "runs-red": "it passes the stop line on red",
    "does-not-yield": "it does not give way to a vehicle that goes first",
    "does-not-yield-to-people": "it does not give way to a person on a crosswalk",
    "enters-blocked": "it drives into a junction that another has not left",
    "drives-on": "it goes first, and does not brake for one that is in its way",
    "overlooks-hidden-people": "it does not reckon with a person that comes out from behind a vehicle",
    "overlooks-hidden": "it does not reckon with a vehicle that comes out from behind another",
}
"""Name and meaning of each conduct, by code."""
IN_SHORT: dict[str, str] = {
    "none": "nothing",
    "hesitates": "hesitates",
    "not-behind": "does not look behind",
    "not-beside": "does not look beside",
    "brakes-late": "brakes late",
    "brakes-weakly": "brakes too weakly",
    "stops-heeding": "forgets",
    "does-not-brake": "does not brake",
    "too-close": "keeps too close",
    "cuts-in": "cuts in",
    "brakes-hard": "brakes hard for nothing",
    "reacts-late": "reacts late",
    "merges-blind": "merges without a look",
    "blocks-mergers": "lets none in",
    "stops-at-end": "stops where its lane ends",
    "runs-red": "runs a red light",
    "does-not-yield": "does not give way to vehicles",
    "does-not-yield-to-people": "does not give way to people",
    "enters-blocked": "enters before others have left",
    "drives-on": "does not brake for what is in its way",
    "overlooks-hidden-people": "overlooks people that a vehicle had hidden",
    "overlooks-hidden": "overlooks vehicles that another had hidden",
}
"""Each conduct in a few words, after "it"."""
NO_CONDUCT = "none"
(
    _NONE, _HESITATES, _NOT_BEHIND, _NOT_BESIDE, _LATE, _WEAK, _STOPS, _NEVER, _CLOSE, _CUTS_IN, _HARD, _REACTS,
    _MERGES, _BLOCKS, _AT_END, _RED, _NOT_YIELDS, _NOT_YIELDS_TO_PEOPLE, _ENTERS, _DRIVES_ON,
    _HIDDEN_PEOPLE, _HIDDEN,
) = range(len(CONDUCTS))  # fmt: skip

CONDUCT_COLUMNS: tuple[Field, ...] = (
    Field("conduct", "string", "", f"What the AV did wrong: {', '.join(CONDUCTS)} (`analysis.conduct`)."),
    Field("conduct_side", "string", "", "Side on which the other was when their paths met: left, right; none: ahead."),
    Field("conduct_s", "float64", "s", "When it began, before contact; null: it did nothing wrong.", BEFORE_CONTACT,
          nullable=True),
)  # fmt: skip
"""Columns that `Conduct.columns` makes, in its order."""
_SIDES = ("none", "left", "right")

_LOOKS_BACK = 80
"""Frames before the contact in which a change of mind counts."""
_RECENT = 30
"""Frames before the contact, or before their paths met, in which sideways motion counts."""
_TURN, _BEYOND = 0.3, 0.2
"""A vehicle has turned when it came back this far [m]; it has left a lane when its centre was so far over the line."""
_TURNS = 3
_ASTRIDE = 35
"""Frames of the 8 s before the contact for which it is astride a line, before it counts as hesitating."""
_SETTLED, _STAYS = 0.1, 20
"""A vehicle that stays so many frames this near to its farthest point [m] has changed lanes twice, not turned back."""
_ENTERED = 0.4
"""A vehicle moved in if it went at least this far towards the other in the 3 s before their paths met [m]."""
_STILL = 0.005
"""Less than this in a frame is no sideways motion [m]."""
_AFTER_CHANGE = 40
"""Frames from the begin of the overlap sideways to the contact up to which the lane change is what led to it."""
_CRITICAL_BRAKING, _CRITICAL_DELAY = 3.0, 0.4
_IN_PATH, _IN_LANE = 10, 0.375
"""Frames for which the other is in its path, and how far its body is over the line then [m] (UN R157's cut-in)."""
_TTC, _NEEDED = 4.0, 1.5
_READY = 8
"""Frames after it had to act within which it must begin to brake."""
_POSSIBLE = 6.0
_BRAKES = -1.0
_RISE, _RISE_FRAMES = 0.5, 5
_FOLLOWS, _STEADY, _TIME_GAP = 20, 1.0, 0.8
_HARD_BRAKING, _WEAK_BRAKING = -3.0, -3.01
_CUT_IN = 0.3
"""Time gap that a lane change must leave to the vehicle behind [s]."""
_NEAR = 0.1
"""No gap is taken as smaller where braking is computed [m]."""
_BLOCK = 256
_AV, _BV = AV, BV


class _Motion(NamedTuple):
    """`PairMotion` as the kernel takes it."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    speed: NDArray[np.float64]
    free_along: NDArray[np.float64]
    free_across: NDArray[np.float64]
    width: NDArray[np.float64]


class _Pair(NamedTuple):
    """One case of it, the contact last: the AV and the other, shape (T,) each, and their widths [m]."""

    av_x: NDArray[np.float64]
    av_y: NDArray[np.float64]
    av_speed: NDArray[np.float64]
    bv_x: NDArray[np.float64]
    bv_y: NDArray[np.float64]
    bv_speed: NDArray[np.float64]
    free_along: NDArray[np.float64]
    free_across: NDArray[np.float64]
    av_width: float
    bv_width: float


@inlined_kernel
def _is_astride(y: float, width: float, lane_width: float) -> bool:
    """Is a vehicle over a line between two lanes, or over the road's edge?"""
    return lane_of(y - 0.5 * width, lane_width) != lane_of(y + 0.5 * width, lane_width)


@inlined_kernel
def _hesitates(p: _Pair, first: int, last: int, lane_width: float) -> bool:
    """Did the AV change its mind, or drive astride a line (rule 1)?"""
    if _changes_mind(p.av_y, first, last, lane_width):
        return True
    astride = 0
    for t in range(max(first, last - _LOOKS_BACK), last + 1):
        astride += _is_astride(p.av_y[t], p.av_width, lane_width)
    return astride >= _ASTRIDE and _is_astride(p.av_y[last], p.av_width, lane_width)


@inlined_kernel
def _in_lane_since(p: _Pair, first: int, last: int, lane_width: float) -> int:
    """Find the frame since which the other has been in the AV's lane, and the AV too; `last` if it is not."""
    lane = lane_of(p.av_y[last], lane_width)
    reach = 0.5 * (lane_width + p.bv_width) - _IN_LANE
    since = last
    while since > first and lane_of(p.av_y[since - 1], lane_width) == lane:
        if abs(p.bv_y[since - 1] - lane_centre(lane, lane_width)) > reach:
            break
        since -= 1
    return since


@inlined_kernel
def _changes_mind(y: NDArray[np.float64], first: int, last: int, lane_width: float) -> bool:
    """Did the AV leave a lane and turn back at once, or turn three times, and move sideways at the end?"""
    moved = 0.0
    for t in range(max(first, last - _RECENT), last):
        moved = max(moved, abs(y[t] - y[last]))
    if moved < _TURN:
        return False
    begin = max(first, last - _LOOKS_BACK)
    before = farthest = y[begin]  # the last turn, and the farthest point since
    low = high = y[begin]  # the range before the first turn
    direction, turns, stayed = 0, 0, 0
    for t in range(begin, last + 1):
        if direction == 0:
            low, high = min(low, y[t]), max(high, y[t])
            if high - low >= _TURN:
                direction = 1 if y[t] == high else -1
                farthest = y[t]
            continue
        if direction * (y[t] - farthest) > _STILL:
            if direction * (y[t] - farthest) > _SETTLED:
                stayed = 0
            farthest = y[t]
        stayed += 1
        if direction * (farthest - y[t]) >= _TURN:
            beyond = lane_of(farthest - direction * _BEYOND, lane_width)
            turns += 1
            if turns >= _TURNS or (beyond != lane_of(before, lane_width) and stayed < _STAYS):
                return True
            before, farthest, direction, stayed = farthest, y[t], -direction, 0
    return False


@inlined_kernel
def _farthest_moved(y: NDArray[np.float64], since: int, meeting: int, side: float) -> float:
    """How far a vehicle moved to one side before their paths met [m]."""
    moved = 0.0
    for t in range(since, meeting):
        moved = max(moved, side * (y[meeting] - y[t]))
    return moved


@inlined_kernel
def _change_of_lanes(p: _Pair, meeting: int, first: int, side: float) -> tuple[int, int]:
    """Judge a lane change of the AV into the other's path: conduct and frame of its begin (rule 2)."""
    begin = meeting
    while begin > first and side * (p.av_y[begin] - p.av_y[begin - 1]) > _STILL:
        begin -= 1
    ahead = p.bv_x[begin] > p.av_x[begin]
    closing = p.av_speed[begin] - p.bv_speed[begin]
    if not ahead:
        closing = -closing
    room = p.free_along[begin] - _CRITICAL_DELAY * closing
    critical = p.free_along[begin] <= 0.0
    if closing > 0.0:
        critical = critical or room <= 0.0 or closing * closing > 2.0 * room * _CRITICAL_BRAKING
    if critical:
        return (_NOT_BESIDE if ahead else _NOT_BEHIND), begin
    behind = p.av_speed[begin] if ahead else p.bv_speed[begin]
    return (_CUTS_IN if p.free_along[begin] < _CUT_IN * behind else _NONE), begin


@inlined_kernel
def _needed(p: _Pair, t: int) -> tuple[float, bool]:
    """How hard the AV must brake behind the other [m/s2], and whether it is time to act."""
    closing = p.av_speed[t] - p.bv_speed[t]
    if closing <= 0.0:
        return 0.0, False
    room = max(p.free_along[t], _NEAR)
    other = (p.bv_speed[t - 1] - p.bv_speed[t]) / FRAME_S if t > 0 else 0.0
    needed = closing * closing / (2.0 * room) + max(other, 0.0)
    return needed, needed >= _NEEDED or room < _TTC * closing


@inlined_kernel
def _brakes_weakly(p: _Pair, first: int) -> int:
    """Find when braking began that was too weak, where 6 m/s2 would have been enough; -1: it did not."""
    last = p.av_x.size - 1
    begin = last
    while begin > first:
        change = (p.av_speed[begin] - p.av_speed[begin - 1]) / FRAME_S
        if change > _BRAKES or change < _WEAK_BRAKING:
            break
        begin -= 1
    braked_harder = begin > first and p.av_speed[begin] - p.av_speed[begin - 1] < _WEAK_BRAKING * FRAME_S
    if last - begin < _READY or braked_harder or p.free_along[last - 1] <= 0.0:
        return -1
    x, speed = p.av_x[begin], p.av_speed[begin]
    for t in range(begin + 1, last + 1):
        slower = max(0.0, speed - _POSSIBLE * FRAME_S)
        x, speed = x + 0.5 * (speed + slower) * FRAME_S, slower
        room = p.free_along[t] + p.av_x[t] - x
        if room <= 0.0:
            return -1
    closing = max(0.0, speed - p.bv_speed[last])
    return begin if closing * closing <= 2.0 * _POSSIBLE * room else -1


@inlined_kernel
def _into_the_rear(p: _Pair, in_path: int, meeting: int, first: int) -> tuple[int, int]:
    """Judge a crash into the rear of one that was in the AV's path: conduct and frame of its begin (rules 3 and 4).

    `in_path`, `meeting`: frames since which the other was in its path, and since which the two overlapped sideways.
    """
    last = p.av_x.size - 1
    must = in_path
    while must < last and not _needed(p, must)[1]:
        must += 1
    if last - must >= _READY and _needed(p, must + _READY)[0] <= _POSSIBLE:
        brakes = must
        while brakes < last and p.av_speed[brakes + 1] - p.av_speed[brakes] > _BRAKES * FRAME_S:
            brakes += 1
        if brakes == last:
            for t in range(max(in_path, first + 1), last - _RISE_FRAMES):
                rise = p.av_speed[t + _RISE_FRAMES + 1] - p.av_speed[t + _RISE_FRAMES]
                if rise - (p.av_speed[t + 1] - p.av_speed[t]) >= _RISE * FRAME_S:
                    return _STOPS, t
            return _NEVER, must
        if brakes - must > _READY:
            return _LATE, must
    weakly = _brakes_weakly(p, first)
    if weakly >= 0:
        return _WEAK, weakly
    if must - meeting >= _FOLLOWS:
        close, steady = 0.0, 0.0
        for t in range(must - _FOLLOWS, must):
            close = max(close, p.free_along[t] - _TIME_GAP * p.av_speed[t])
            steady = max(steady, p.av_speed[t] - p.bv_speed[t])
        if close <= 0.0 and steady <= _STEADY:
            return _CLOSE, must - _FOLLOWS
    return _NONE, last


@kernel
def _judge(p: _Pair, first: int, lane_width: float) -> tuple[int, int, int]:
    """Judge one case: code of the conduct, code of the side, frame of its begin."""
    last = p.av_x.size - 1
    meeting = last
    while meeting > first and p.free_across[meeting - 1] < 0.0:
        meeting -= 1
    side, by_av, by_bv = 0, False, False
    if meeting > first:
        side = 1 if p.bv_y[meeting - 1] > p.av_y[meeting - 1] else -1
        since = max(first, meeting - _RECENT)
        by_av = _farthest_moved(p.av_y, since, meeting, float(side)) > _ENTERED
        by_bv = _farthest_moved(p.bv_y, since, meeting, -float(side)) > _ENTERED
    side_code = 0 if side == 0 else 1 if side > 0 else 2
    if _hesitates(p, first, last, lane_width):
        return _HESITATES, side_code, max(first, last - _LOOKS_BACK)
    if by_av and not by_bv and last - meeting <= _AFTER_CHANGE:
        found, begin = _change_of_lanes(p, meeting, first, float(side))
        if found != _NONE:
            return found, side_code, begin
    in_path = min(meeting, _in_lane_since(p, first, last, lane_width))
    if p.bv_x[last] > p.av_x[last] and p.free_across[last] < 0.0 and last - in_path >= _IN_PATH:
        found, begin = _into_the_rear(p, in_path, meeting, first)
        if found != _NONE:
            return found, side_code, begin
    return _NONE, side_code, last


@inlined_kernel
def _brakes_hard(p: _Pair, first: int) -> int:
    """Find when the AV began to brake hard before the other behind it, within the last 3 s (rule 5); -1: it did not."""
    last = p.av_x.size - 1
    for t in range(max(first, last - _RECENT), last):
        is_behind = p.bv_x[t] < p.av_x[t] and p.free_along[t] > 0.0
        if is_behind and p.av_speed[t + 1] - p.av_speed[t] <= _HARD_BRAKING * FRAME_S:
            return t
    return -1


@inlined_kernel
def _rear_is_struck(p: _Pair) -> bool:
    """Did the other run into the AV's rear: is it behind, and overlaps less along the road than across?"""
    last = p.av_x.size - 1
    return bool(p.bv_x[last] < p.av_x[last] and p.free_along[last] > p.free_across[last])


@kernel
def _judge_all(
    m: _Motion, first: NDArray[np.int64], judges: NDArray[np.int64], lane_width: float, out: NDArray[np.int64]
) -> None:
    """Judge all cases of `_Motion`; rows of `out`: codes of conduct and side, and the frame of its begin, (S, 3).

    `judges`, (S, 2), of `Prevention`: `needless` and `reacts`.
    """
    for c in range(first.size):
        p = _Pair(
            m.x[_AV, c], m.y[_AV, c], m.speed[_AV, c], m.x[_BV, c], m.y[_BV, c], m.speed[_BV, c],
            m.free_along[c], m.free_across[c], m.width[_AV, c], m.width[_BV, c],
        )  # fmt: skip
        out[c, 0], out[c, 1], out[c, 2] = _judge(p, first[c], lane_width)
        if out[c, 0] != _NONE:
            continue
        brakes = _brakes_hard(p, first[c]) if judges[c, 0] != 0 else -1
        if brakes >= 0:
            out[c, 0], out[c, 2] = _HARD, brakes
        elif judges[c, 1] >= 0 and not _rear_is_struck(p):
            out[c, 0], out[c, 2] = _REACTS, max(first[c], p.av_x.size - 1 - judges[c, 1])


@dataclass(frozen=True)
class Conduct:
    """The AV's mistakes in each of S cases.

    Attributes:
        code: Place in `CONDUCTS`, int64, shape (S,).
        side: Side on which the other was when their paths met: 0 ahead or behind, 1 left, 2 right, int64, shape (S,).
        begin_s: When the conduct began, before contact [s], shape (S,); NaN for none.
    """

    code: NDArray[np.int64]
    side: NDArray[np.int64]
    begin_s: NDArray[np.float64]

    @classmethod
    def of_columns(cls, conduct: list[str | None], side: list[str | None], begin_s: NDArray[np.float64]) -> Conduct:
        """Make it from the columns of `CONDUCT_COLUMNS`."""
        codes, sides = {name: k for k, name in enumerate(CONDUCTS)}, {name: k for k, name in enumerate(_SIDES)}
        return cls(
            np.array([codes[str(name)] for name in conduct], np.int64),
            np.array([sides[str(name)] for name in side], np.int64),
            begin_s,
        )

    @property
    def slow(self) -> NDArray[np.bool_]:
        """Mark the cases in which it braked too late, too weakly or not at all (rules 3 and 6), bool (S,)."""
        return np.isin(self.code, (_LATE, _WEAK, _STOPS, _NEVER, _REACTS, _DRIVES_ON))

    @property
    def begun(self) -> NDArray[np.bool_]:
        """Mark the cases in which it did what it could have left out (rules 1, 2, 4, 5 and 7 to 9), bool (S,)."""
        left_out = (
            _HESITATES, _NOT_BEHIND, _NOT_BESIDE, _CUTS_IN, _CLOSE, _HARD, _MERGES, _BLOCKS, _AT_END, _RED, _NOT_YIELDS,
            _NOT_YIELDS_TO_PEOPLE, _ENTERS, _HIDDEN_PEOPLE, _HIDDEN,
        )  # fmt: skip
        return np.isin(self.code, left_out)

    def columns(self) -> dict[str, Any]:
        """Make the columns of `CONDUCT_COLUMNS`."""
        names, sides = np.array(list(CONDUCTS)), np.array(_SIDES)
        return {"conduct": names[self.code], "conduct_side": sides[self.side], "conduct_s": self.begin_s}


def conduct_of(recordings: Recordings, odd: Odd, prevention: Prevention) -> Conduct:
    """Say what the AV did wrong in recorded crashes of the AV.

    Args:
        recordings: S cases; vehicles other than the AV and its partner are looked at only where lanes end.
        odd: Road and rules of the cases.
        prevention: What reference drivers make of the same cases.

    Raises:
        InputError: As `pair.pair_motion`.
    """
    if odd.site is not None:
        of_cases = conduct_at_site(recordings, odd, prevention.reacts)
        codes = list(CONDUCTS)
        told = np.array([(codes.index(name), *rest) for name, *rest in of_cases], np.int64).reshape(-1, 3)
        return Conduct(told[:, 0], told[:, 1], np.where(told[:, 0] == _NONE, np.nan, told[:, 2] * FRAME_S))
    judges = np.stack([prevention.needless, prevention.reacts], axis=-1)
    some = np.asarray(prevention.prevented.any(axis=1))
    parts = []
    for at, block in zip(range(0, recordings.n_cases, _BLOCK), recordings.blocks(_BLOCK), strict=True):
        motion, rows = pair_motion(block), slice(at, at + _BLOCK)
        parts.append(_of_motion(motion, judges[rows], odd.lane_width))
        if odd.road is not None:
            _look_at_ends(parts[-1], block, motion, some[rows], odd)
    found = np.concatenate(parts) if parts else np.zeros((0, 3), np.int64)
    begin = np.where(found[:, 0] == _NONE, np.nan, found[:, 2] * FRAME_S)
    return Conduct(found[:, 0], found[:, 1], begin)


def _look_at_ends(
    out: NDArray[np.int64], block: Recordings, motion: PairMotion, some: NDArray[np.bool_], odd: Odd
) -> None:
    """Put the mistakes of rules 7 to 9 into what `_of_motion` returned; `some`: a reference driver prevents it."""
    last = motion.x.shape[2] - 1
    soon = ends_soon(motion.x, motion.y, motion.speed, odd)
    must_merge = soon[AV, np.arange(len(out)), last - out[:, 2]]
    out[must_merge & np.isin(out[:, 0], (_NOT_BEHIND, _NOT_BESIDE)), 0] = _MERGES
    out[must_merge & np.isin(out[:, 0], (_CUTS_IN, _HARD)), 0] = _NONE
    for code, since in (
        (_BLOCKS, blocks_since(motion, soon, some, odd)), (_AT_END, stops_since(block, motion, soon, odd)),
    ):  # fmt: skip
        found = np.isin(out[:, 0], (_NONE, _HARD, _REACTS)) & (since >= 0)
        out[found, 0], out[found, 2] = code, last - since[found]


def _of_motion(motion: PairMotion, judges: NDArray[np.int64], lane_width: float) -> NDArray[np.int64]:
    """Return the codes of conduct and side, and how many frames before the contact it began, (S, 3)."""
    first = np.argmax(motion.recorded, axis=1).astype(np.int64)
    out = np.zeros((first.size, 3), np.int64)
    m = _Motion(motion.x, motion.y, motion.speed, motion.free_along, motion.free_across, motion.width)
    _judge_all(m, first, judges, lane_width, out)
    out[:, 2] = motion.recorded.shape[1] - 1 - out[:, 2]
    return out
