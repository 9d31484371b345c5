"""Answers of AVs made into controls of their vehicles: answers are checked, and trajectories are followed.

All is a function of what the AV saw and what it answered, so a question that is asked again gives the same again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cornerforge.foreign import tracking
from cornerforge.foreign.interface import AT_SITES
from cornerforge.foreign.scene import COLUMNS
from cornerforge.sim import controllers
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers

__all__ = ["SHOULDER", "UNUSABLE", "Carried", "carry_out", "controller_of"]

SHOULDER = 2.5
"""Width of the paved shoulders on both sides of the road [m]; the AV's body may be there, not beyond."""
UNUSABLE = "answered with NaN, infinity, or a lane order other than -1, 0 and 1"
"""What an AV did whose answer is not usable."""
_NOT_FINITE = "answered with NaN or infinity"
_TOO_STEEP = "answered with NaN, infinity, or front wheels turned by 1.4 rad or more"
_JUMP = 3.0
_BEYOND_TOP_SPEED = 10.0
_STEEPEST = 1.4
_X, _Y, _LENGTH, _WIDTH = (COLUMNS.index(name) for name in ("x", "y", "length", "width"))


class Carried(NamedTuple):
    """Answers in the form in which they are carried out.

    Attributes:
        answers: (B, W), `Setting.answer_width`; NaN where the AV's answer is not usable.
        failed: Of rows with NaN: what ("raised", "answer" or "left") and a sentence that begins with the AV's name.
    """

    answers: NDArray[np.float64]
    failed: dict[int, tuple[str, str]]


def controller_of(form: str) -> int:
    """Find the code of `sim.controllers` for an AV that answers in a form."""
    return controllers.OUTSIDE if form in ("view", "lane", AT_SITES) else controllers.STEERED


def carry_out(
    given: NDArray[np.float64], failed: dict[int, tuple[str, str]], form: str, views: NDArray[Any], road: RoadNumbers
) -> Carried:
    """Check answers, and turn them into what is carried out.

    Args:
        given: As the AV gave them: (B, 2), or poses (B, M, 5).
        failed: Rows in which it failed already.
        form: "view", or one of `interface.ANSWERS`.
        views: What it saw.
        road: Constants.
    """
    if form in ("view", "lane", AT_SITES):
        order = given[:, 1]
        fine = np.isin(order, (-1.0, 0.0, 1.0)) & np.isfinite(given[:, 0])
        return _with_faults(given.copy(), fine, _NOT_FINITE if form == AT_SITES else UNUSABLE, failed)
    steps = int(road.av_substeps)
    if form == "trajectory":
        answers, failed = _followed(given, failed, views, road, steps)
    else:
        pairs, how = given.copy(), _NOT_FINITE
        if form == "steering":
            tracking.bend(pairs, float(road.length))
            how = _TOO_STEEP
        answers = np.tile(pairs, (1, steps))
        answers, failed = _with_faults(answers, np.asarray(np.isfinite(answers).all(axis=1)), how, failed)
    return _on_the_road(answers, failed, views, road)


def _with_faults(
    answers: NDArray[np.float64], fine: NDArray[np.bool_], how: str, failed: dict[int, tuple[str, str]]
) -> Carried:
    answers[~fine] = np.nan
    return Carried(answers, {int(b): ("answer", how) for b in np.flatnonzero(~fine)} | failed)


def _on_the_road(
    answers: NDArray[np.float64], failed: dict[int, tuple[str, str]], views: NDArray[Any], road: RoadNumbers
) -> Carried:
    """Refuse answers of AVs that have left the road and its shoulders."""
    y, half = views[:, 0, _Y], 0.5 * views[:, 0, _WIDTH]
    beyond = np.maximum(half - SHOULDER - y, y + half - SHOULDER - road.n_lanes * road.lane_width)
    off = np.flatnonzero((beyond > 0.0) & (views[:, 0, _LENGTH] > 0.0))
    answers[off] = np.nan
    left = {int(b): ("left", f"left the road: it is {beyond[b]:.2f} m beyond the shoulder") for b in off}
    return Carried(answers, failed | left)


def _followed(
    plans: NDArray[np.float64], failed: dict[int, tuple[str, str]], views: NDArray[Any], road: RoadNumbers, steps: int
) -> Carried:
    """Check trajectories, and follow those that can be followed."""
    failed = dict(failed)
    poses = np.isfinite(plans[:, :, :3]).all(axis=2).cumprod(axis=1).sum(axis=1)
    for b in np.flatnonzero(views[:, 0, _LENGTH] > 0.0).tolist():
        if b in failed:
            poses[b] = 0
            continue
        wrong = _wrong_with(plans[b], int(poses[b]), views[b, 0], road, steps)
        if wrong:
            failed[b] = "answer", wrong
            poses[b] = 0
    poses[views[:, 0, _LENGTH] <= 0.0] = 0
    answers = np.full((len(plans), 2 * steps), np.nan)
    tracking.follow(np.ascontiguousarray(views), np.ascontiguousarray(plans), poses, road, answers)
    return Carried(answers, failed)


def _wrong_with(
    plan: NDArray[np.float64], n: int, own: NDArray[np.float64], road: RoadNumbers, steps: int
) -> str:  # fmt: skip
    """Say what is wrong with a trajectory, "" if nothing: a sentence that begins with the AV's name."""
    if n < 2 or np.isfinite(plan[n:, 0]).any():
        return f"planned a trajectory with NaN or infinity in pose {n} of {len(plan)}"
    t, x, y = plan[:n, 0], plan[:n, 1], plan[:n, 2]
    apart = np.diff(t)
    if (apart <= 0.0).any():
        k = int(np.argmax(apart <= 0.0))
        return f"planned a trajectory whose times do not rise: {t[k]:g} s, then {t[k + 1]:g} s"
    if t[-1] < steps * FRAME_S - 1e-6:
        return f"planned a trajectory of {t[-1]:g} s; it must reach to the next answer in {steps * FRAME_S:.1f} s"
    way = np.hypot(np.diff(x), np.diff(y))
    fast = way > (road.max_speed + _BEYOND_TOP_SPEED) * apart
    if fast.any():
        k = int(np.argmax(fast))
        return f"planned a trajectory that jumps by {way[k]:.1f} m between {t[k]:g} and {t[k + 1]:g} s"
    stated = plan[:n, 4][~np.isnan(plan[:n, 4])]
    top = road.max_speed + _BEYOND_TOP_SPEED
    if ((stated < 0.0) | (stated > top)).any():
        wrong = stated[(stated < 0.0) | (stated > top)][0]
        return f"planned a speed of {wrong:g} m/s; allowed: 0 to {top:g}"
    headings = plan[:n, 3][~np.isnan(plan[:n, 3])]
    if (np.abs(headings) > _STEEPEST).any():
        return f"planned a heading of {headings[np.abs(headings).argmax()]:.2f} rad to the road; at most {_STEEPEST}"
    now_x, now_y, *_ = tracking.place_at(plan, n, 0.0)
    off = float(np.hypot(now_x - own[_X], now_y - own[_Y]))
    if off > _JUMP:
        return f"planned a trajectory that jumps: it begins {off:.1f} m from where the vehicle is"
    return ""
