"""Probability of a serious injury by change of velocity and direction of the impact.

The curves are logistic in delta-v, one per crash mode: P = 1 / (1 + exp(-(a + b delta-v))), delta-v in miles per hour.

Frontal and rear: a and b are from Wang (2022), "MAIS(05/08) injury probability curves as functions of delta V", NHTSA,
DOT HS 813 219, for MAIS 3+ in the crashes of NASS-CDS 2010-2015, as later users of the report give them (they name its
tables A-6 and A-9). We did not have the report itself: compare with it before you rely on them.

Near and far side: that report has no curve for side impacts. Ours begin where its frontal curve does, because an impact
of size 0 has no direction, and are steeper, so that the odds ratio between the modes at 30 mph is as in Augenstein et
al. (2003), "Characteristics of crashes that increase the risk of serious injuries", 47th AAAM conference (MAIS 3+ at a
delta-v of 30 mph: frontal 38.9 %, near side 83.8 %, far side 47.8 %, rear 19.9 %). They are derived, not published.
Only the ratios between the modes are taken from there, because the level belongs to an older fleet: the frontal 38.9 %
is 10.7 % in Wang. With that ratio at every speed, a contact with a delta-v of 1 m/s would injure one in a hundred.

People on foot: Tefft (2013), "Impact speed and a pedestrian's risk of severe injury or death", Accid. Anal. Prev. 50:
AIS 4+ with 10 % at 17.1 mph, 25 % at 24.9, 50 % at 33.0, 75 % at 40.8, 90 % at 48.1. Ours is the logistic curve through
the 50 % and the 10 %; it gives 24.6, 74.6 and 89.0 % at the others. MAIS 3 is likelier.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge._checks import check_finite
from cornerforge.errors import InputError
from cornerforge.metrics._inputs import matching_arrays

__all__ = ["CRASH_MODES", "crash_mode", "injury_probability", "person_injury_probability"]

CRASH_MODES = ("frontal", "near side", "far side", "rear")
"""Direction of the impact, seen by a driver on the left. Codes of modes are places in this tuple."""

_FRONTAL, _NEAR, _FAR, _REAR = range(4)
_MPS_PER_MPH = 0.44704
_AT_30_MPH = {_FRONTAL: 0.389, _NEAR: 0.838, _FAR: 0.478, _REAR: 0.199}
"""MAIS 3+ in Augenstein et al. (2003)."""


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _steeper(mode: int) -> float:
    """Give by how much a side's log-odds grow faster than the frontal ones [1/mph]."""
    return (_log_odds(_AT_30_MPH[mode]) - _log_odds(_AT_30_MPH[_FRONTAL])) / 30.0


_FRONTAL_A, _FRONTAL_B = -6.9774, 0.1620
_INTERCEPT = np.array([_FRONTAL_A, _FRONTAL_A, _FRONTAL_A, -8.0329])
_PER_MPH = np.array([_FRONTAL_B, _FRONTAL_B + _steeper(_NEAR), _FRONTAL_B + _steeper(_FAR), 0.1793])


def crash_mode(force_direction: ArrayLike) -> NDArray[np.int8]:
    """Find the crash mode by the direction that the force comes from.

    Args:
        force_direction: From the vehicle's heading, counter-clockwise [rad], shape (*d): 0 from ahead, pi/2 from the
            left, pi or -pi from behind; any multiple of 2 pi may be added.

    Returns:
        Indices into `CRASH_MODES`, int8, shape (*d). Up to 45 degrees from ahead (11 to 1 o'clock) is frontal, up to
        45 degrees from behind is rear, the left is the near side of a driver on the left seat.

    Raises:
        InputError: A value is NaN or infinite.

    >>> [CRASH_MODES[mode] for mode in crash_mode(np.radians([0.0, 44.0, 46.0, -90.0, 180.0, -136.0]))]
    ['frontal', 'frontal', 'near side', 'far side', 'rear', 'rear']
    """
    (direction,) = matching_arrays(force_direction=force_direction)
    check_finite("force_direction", direction)
    ahead, left = np.cos(direction), np.sin(direction)
    side = np.where(left > 0.0, _NEAR, _FAR)
    # A small tolerance, so that 45 degrees counts as frontal on both sides, for any last bit.
    lengthwise = np.abs(ahead) >= math.sqrt(0.5) - 1e-12
    return np.where(lengthwise, np.where(ahead > 0.0, _FRONTAL, _REAR), side).astype(np.int8)


def person_injury_probability(speed: ArrayLike) -> NDArray[np.float64]:
    """Give the probability that a person on foot is severely injured (AIS 4 or more) by a vehicle at a speed.

    Args:
        speed: Of the impact [m/s], shape (*d), finite.

    Raises:
        InputError: A value is NaN or infinite.

    >>> person_injury_probability(np.array([17.1, 33.0]) * 0.44704).round(3).tolist()
    [0.1, 0.5]
    """
    (speed,) = matching_arrays(speed=speed)
    check_finite("speed", speed)
    return np.asarray(1.0 / (1.0 + np.exp(_log_odds(0.1) * (speed / _MPS_PER_MPH - 33.0) / (33.0 - 17.1))))


def injury_probability(delta_v: ArrayLike, force_direction: ArrayLike) -> NDArray[np.float64]:
    """Give the probability that an occupant is seriously injured, MAIS 3 or more.

    Args:
        delta_v: Change of the vehicle's velocity [m/s], shape (*d), not negative.
        force_direction: Where the force comes from [rad]; see `crash_mode`.

    Returns:
        Shape (*d), in (0, 1]. Not 0 at a delta-v of 0 (0.0009; from behind 0.0003), because logistic curves have no
        zero; 1 within rounding from about 130 m/s on.

    Raises:
        InputError: A value is NaN, a delta-v negative, a direction infinite, or the shapes do not match.

    Source: see the module's text; which curve is published and which is derived stands there.
    >>> injury_probability(30.0 * 0.44704, np.radians([0.0, 90.0, -90.0, 180.0])).round(3)
    array([0.107, 0.494, 0.148, 0.066])
    """
    from scipy.special import expit

    change, direction = matching_arrays(delta_v=delta_v, force_direction=force_direction)
    if (change < 0.0).any():
        raise InputError(f"delta_v = {float(change.min())} m/s is negative; give its size.")
    mode = crash_mode(direction)
    return np.asarray(expit(_INTERCEPT[mode] + _PER_MPH[mode] * change / _MPS_PER_MPH))
