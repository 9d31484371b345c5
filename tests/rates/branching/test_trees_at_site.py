"""Steering at a site: held words give what they are held to, and the others stay."""

from __future__ import annotations

import numpy as np

from cornerforge.sim import steering
from cornerforge.sim.steering import allocate_steering, hold_to, steer_at_site


def test_held_words_give_what_they_are_held_to() -> None:
    words = np.random.Generator(np.random.Philox(3)).integers(0, 2**32, (4, 50), dtype=np.uint64)
    before, held = words.copy(), allocate_steering(50)
    hold_to(held, 7, steering.LANE, 0, 1000)
    hold_to(held, 9, steering.AWAY, 1000, steering.ALL_WORDS - 1000)
    steer_at_site(words, held, 50)
    assert words[1, 7] < 1000
    assert words[2, 9] >= 1000
    words[1, 7], words[2, 9] = before[1, 7], before[2, 9]
    np.testing.assert_array_equal(words, before)
