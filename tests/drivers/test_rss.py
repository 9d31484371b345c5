"""RSS distances and braking: by hand, and the order of the numbers; driven out in `metrics/test_driven_out.py`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cornerforge.drivers.rss import RssNumbers, RssParams, rss_braking, rss_distance
from cornerforge.errors import InputError

P = RssNumbers(0.3, 2.0, 6.0, 8.0, 1.0, 1.0, 6.0)


def ahead(speed: float, lead_speed: float) -> float:
    return rss_distance(speed, lead_speed, P.response_time, P.max_acceleration, P.min_braking, P.lead_braking)


@pytest.mark.parametrize(
    ("speed", "lead_speed", "metres"),
    [
        (30.0, 30.0, 9.0 + 0.09 + 30.6**2 / 12.0 - 900.0 / 16.0),  # 30.87
        (20.0, 20.0, 6.0 + 0.09 + 20.6**2 / 12.0 - 25.0),
        (30.0, 0.0, 9.0 + 0.09 + 30.6**2 / 12.0),
        (0.0, 0.0, 0.09 + 0.36 / 12.0),
        (20.0, 40.0, 0.0),
    ],
)
def test_distances_by_hand(speed: float, lead_speed: float, metres: float) -> None:
    assert ahead(speed, lead_speed) == pytest.approx(metres, rel=1e-12)


def test_faster_needs_more_and_a_faster_lead_less() -> None:
    speeds = np.linspace(0.0, 40.0, 41)
    own = [ahead(v, 20.0) for v in speeds]
    others = [ahead(30.0, v) for v in speeds]
    assert own == sorted(own)
    assert others == sorted(others, reverse=True)
    assert own[-1] > own[20] + 50.0
    assert others[0] > others[-1] + 50.0


@pytest.mark.parametrize(
    ("speed", "gap", "lead_speed", "braking"),
    [
        (30.0, 30.88, 30.0, 0.0),
        (30.0, 30.86, 30.0, 6.0),
        (20.0, 5.0, 20.0, 400.0 / (2.0 * (5.0 + 25.0))),
        (30.0, 20.0, 10.0, 8.0),
        (30.0, 0.0, 40.0, 0.0),
        (30.0, 0.0, 30.0, 8.0),
        (30.0, -1.0, 30.0, 8.0),
        (30.0, math.inf, 30.0, 0.0),
    ],
)
def test_braking_by_hand(speed: float, gap: float, lead_speed: float, braking: float) -> None:
    assert rss_braking(speed, gap, lead_speed, P) == pytest.approx(braking)


def test_braking_behind_a_lead_that_brakes_less() -> None:
    """At 20 and 18 m/s, 2 m apart, the lead at 2 m/s2: stopping behind it takes 2.4 m/s2, not touching it 3."""
    p = P._replace(lead_braking=2.0, min_braking=0.1)
    assert rss_braking(20.0, 2.0, 18.0, p) == pytest.approx(2.0 + 2.0**2 / (2.0 * 2.0))


def test_numbers_are_the_parameters_in_order() -> None:
    assert RssNumbers(*vars(RssParams()).values()) == P
    assert tuple(vars(RssParams())) == RssNumbers._fields


@pytest.mark.parametrize(
    ("name", "value"), [("response_time", -0.1), ("min_braking", 0.0), ("min_braking", 8.1), ("rear_braking", math.nan)]
)
def test_values_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"rss.{name}"):
        RssParams(**{name: value})
