"""A model of drivers with habits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cornerforge.ndd.model import Memory, NddModel


@pytest.fixture(scope="session")
def mindful(model: NddModel) -> NddModel:
    """Drivers that keep to a habit, which suits their time gap, as well as to what they did in the second before.

    Each has a noise level and vigilance of its own, changes lanes in a time of its own, half of them announce it, and
    they often look away. The shipped drivers have no habit, so their `habit_spread` does nothing.
    """
    memory = Memory(
        near=0.25, near_width=0.1, far=0.2, far_width=0.45, habit=0.35, habit_width=0.2, away=0.1, away_again=0.6
    )
    initial = replace(
        model.initial, habit_spread=0.3, change_median=5.17, signal_share=0.5, noise_spread=1.0, vigilance_sigma=0.8
    )
    return replace(model, lc_base=np.full(21, 0.05, dtype=np.float32), memory=memory, initial=initial)
