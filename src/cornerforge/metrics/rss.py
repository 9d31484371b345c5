"""Safe distances of responsibility-sensitive safety, RSS, for vehicles that drive in the same direction.

Definitions and lemmas follow Shalev-Shwartz, Shammah and Shashua, "On a formal model of safe and scalable self-driving
cars", arXiv:1708.06374. The paper looks at where two vehicles are at the end of the worst case; the distances here hold
at every moment of it, and each function says where that is more. Koopman, Osyk and Weast, arXiv:1911.01207, saw it for
the longitudinal one. `drivers.rss.rss_distance` is that one as a compiled kernel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge._checks import check_finite
from cornerforge.metrics._inputs import check_sizes, matching_arrays

__all__ = ["rss_lateral", "rss_longitudinal", "rss_margin"]


def rss_longitudinal(
    rear_speed: ArrayLike, lead_speed: ArrayLike, response_time: ArrayLike, acceleration: ArrayLike,
    rear_braking: ArrayLike, lead_braking: ArrayLike,
) -> NDArray[np.float64]:  # fmt: skip
    """Give the least bumper-to-bumper distance at which the vehicle behind cannot hit the one ahead [m].

    The one ahead brakes with `lead_braking` from now on; the one behind accelerates with `acceleration` during its
    response time and brakes with `rear_braking` after it, both until they stand.

    The paper's lemma 2 compares where the two stand at the end. That is too little where the one behind brakes harder
    than the one ahead, is the faster one when it begins to brake, and stops first: they are nearest before, when they
    are equally fast. The second example needs 8.5 m; the lemma gives 0.

    Args:
        rear_speed, lead_speed: [m/s], shape (*d), not negative.
        response_time: Response time of the vehicle behind [s], not negative.
        acceleration: Largest acceleration of the vehicle behind meanwhile [m/s2], not negative.
        rear_braking: Least braking of the vehicle behind [m/s2], positive.
        lead_braking: Hardest braking of the vehicle ahead [m/s2], positive.

    Returns:
        Shape (*d), in [0, inf), never NaN: 0 where the vehicle ahead is so much faster that no distance is needed.

    Raises:
        InputError: A value is NaN, infinite or out of range, or the shapes do not match.

    Source: Shalev-Shwartz et al. (2017), definition 1 and, for all else, lemma 2.
    >>> rss_longitudinal([20.0, 20.0], [20.0, 40.0], 0.5, 2.0, 4.0, 4.0)
    array([15.375,  0.   ])
    >>> rss_longitudinal(30.0, 28.0, 1.0, 0.0, 8.0, 4.0).item()
    8.5
    """
    rear, lead, response, gain, brakes, braked = matching_arrays(
        rear_speed=rear_speed, lead_speed=lead_speed, response_time=response_time, acceleration=acceleration,
        rear_braking=rear_braking, lead_braking=lead_braking,
    )  # fmt: skip
    check_sizes(rear_speed=rear, lead_speed=lead, response_time=response, acceleration=gain)
    check_sizes(zero=False, rear_braking=brakes, lead_braking=braked)
    # Term for term as in the kernel, so that both give the same bits.
    faster = rear + response * gain
    slower = np.maximum(0.0, lead - response * braked)
    while_responding = rear * response + 0.5 * gain * response * response
    at_rest = while_responding + faster * faster / (2.0 * brakes) - lead * lead / (2.0 * braked)
    stops_first = (slower < faster) & (faster * braked < slower * brakes)
    closing = (faster - slower) * (faster - slower) / (2.0 * np.where(stops_first, brakes - braked, 1.0))
    equally_fast = while_responding - 0.5 * (lead + slower) * response + closing
    return np.maximum(0.0, np.where(stops_first, equally_fast, at_rest))


def rss_lateral(
    towards_a: ArrayLike, towards_b: ArrayLike, response_time_a: ArrayLike, response_time_b: ArrayLike,
    acceleration: ArrayLike, braking: ArrayLike, margin: ArrayLike = 0.0,
) -> NDArray[np.float64]:  # fmt: skip
    """Give the least free space between the sides of two vehicles with which `margin` is left at every moment [m].

    Each accelerates towards the other with `acceleration` during its own response time and brakes laterally with
    `braking` after it, until it has no lateral speed.

    The paper's definition 6 asks for the margin at the end only. That is too little where one follows the other, is
    faster at first and responds sooner: they are nearest when they are equally fast, and part again. The second example
    needs 0.25 m; the definition gives 0. It cannot happen where the response times are equal, as in the paper.

    Args:
        towards_a: Lateral speed of one vehicle towards the other [m/s], shape (*d); negative: away from it.
        towards_b: Lateral speed of the other towards the first [m/s], shape (*d); negative: away from it.
        response_time_a, response_time_b: [s], not negative.
        acceleration: Lateral [m/s2], not negative.
        braking: Lateral [m/s2], positive.
        margin: Space that must be left [m], not negative; absorbs what vehicles sway within their lanes.

    Returns:
        Shape (*d), in [margin, inf), never NaN.

    Raises:
        InputError: A value is NaN, infinite or out of range, or the shapes do not match.

    Source: Shalev-Shwartz et al. (2017), definition 6 and lemma 4; the response times of the two may differ here, and
    a vehicle that still moves away after its response time is credited with the way until it has stopped, as the
    definition has it (the lemma writes out the case of two that move towards each other). The open library ad-rss-lib
    expects the same in its own tests, but gives no credit.
    >>> rss_lateral([0.0, 1.0, -3.0], 0.0, 1.0, 1.0, 0.2, 0.8, 0.1)
    array([0.35 , 2.225, 0.1  ])
    >>> rss_lateral(2.0, -1.5, 0.0, 2.0, 0.0, 0.5).item()
    0.25
    """
    a, b, response_a, response_b, gain, brakes, least = matching_arrays(
        towards_a=towards_a, towards_b=towards_b, response_time_a=response_time_a, response_time_b=response_time_b,
        acceleration=acceleration, braking=braking, margin=margin,
    )  # fmt: skip
    check_finite("towards_a", a)
    check_finite("towards_b", b)
    check_sizes(response_time_a=response_a, response_time_b=response_b, acceleration=gain, margin=least)
    check_sizes(zero=False, braking=brakes)
    # They can be nearest at the start, at the end, or between: after one responded, when both are equally fast.
    first = np.minimum(response_a, response_b)
    closing, slows = a + b + 2.0 * gain * first, brakes - gain
    with np.errstate(over="ignore"):  # hardly slower: at the end, as for +inf
        between = first + np.divide(closing, slows, out=np.zeros(a.shape), where=closing * slows > 0.0)
    ways = [_way(a, response_a, gain, brakes, t) + _way(b, response_b, gain, brakes, t) for t in (between, np.inf)]
    return np.asarray(least + np.maximum(0.0, np.maximum(*ways)))


def rss_margin(distance: ArrayLike, safe_distance: ArrayLike) -> NDArray[np.float64]:
    """Give by how much a distance exceeds the safe one [m].

    Args:
        distance: Bumper to bumper, or side to side [m], shape (*d); negative means overlap, +inf no vehicle.
        safe_distance: From `rss_longitudinal` or `rss_lateral` [m], shape (*d), at least 0.

    Returns:
        Shape (*d), in [-inf, inf], never NaN. Negative: unsafe. A pair is in danger where both the longitudinal and the
        lateral margin are negative, so the larger of the two is the pair's margin.

    Raises:
        InputError: A value is NaN or a safe distance negative or infinite, or the shapes do not match.

    Source: Shalev-Shwartz et al. (2017), definition 9.
    >>> rss_margin([20.0, 10.0, np.inf], 15.375)
    array([ 4.625, -5.375,    inf])
    """
    is_distance, needed = matching_arrays(distance=distance, safe_distance=safe_distance)
    check_sizes(safe_distance=needed)
    return np.asarray(is_distance - needed)


def _way(
    speed: NDArray[np.float64], response: NDArray[np.float64], gain: NDArray[np.float64], brakes: NDArray[np.float64],
    until: ArrayLike,
) -> NDArray[np.float64]:  # fmt: skip
    """Give how far a vehicle comes towards the other until a time [s]; negative: away."""
    responds = np.minimum(until, response)
    after = speed + responds * gain
    stops = np.minimum(until - responds, np.abs(after) / brakes)
    return np.asarray(0.5 * (speed + after) * responds + (after - 0.5 * np.copysign(brakes, after) * stops) * stops)
