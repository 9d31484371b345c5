from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from followers import time_gap_behind

from cornerforge.experiment.setting import experiment


def test_the_nearest_one_behind_in_the_avs_lane_counts() -> None:
    scenario = experiment(av="idm-mobil", lanes=3).recorder().record(0, 0)
    n = scenario.slot.size
    assert n > 4
    x, y, speed = np.zeros((1, n)), np.full((1, n), 6.0), np.full((1, n), 30.0)
    present = np.zeros((1, n), dtype=np.bool_)
    present[0, :5] = True
    x[0, :5] = 400.0, 380.0, 389.0, 420.0, 398.0  # AV, far behind, near behind, ahead, beside
    y[0, 4] = 2.0
    hand_built = replace(scenario, x=x, y=y, speed=speed, present=present)
    assert time_gap_behind(hand_built, 0) == pytest.approx((11.0 - 5.0) / 30.0)
    present[0, 1:3] = False
    assert time_gap_behind(hand_built, 0) == float("inf")
