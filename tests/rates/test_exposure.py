"""How far BVs drive, against recordings."""

from __future__ import annotations

import pytest
from hand_built import WIDE, setting_of

from cornerforge.errors import InputError
from cornerforge.ndd.model import default_model_path, load_model
from cornerforge.rates.exposure import bv_travel
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.world import n_slots
from cornerforge.types import METRES_PER_MILE

ODD = WIDE
SLOTS = n_slots(ODD)
MODEL = load_model(default_model_path())


def test_bvs_drive_as_far_as_recordings_say() -> None:
    """Counting takes speed times seconds, recordings hold the places; accelerations make them differ a little."""
    setting = setting_of(MODEL, ODD)
    recorder = Recorder(setting, ODD)
    metres = 0.0
    for test in range(64):
        scenario = recorder.record(9, test)
        assert scenario.present.all(), "no BV-BV crash among these, or the sum below is wrong"
        metres += float((scenario.x[-1, 1:] - scenario.x[0, 1:]).sum())
    found = bv_travel(setting, SLOTS, seed=9, tests=64)
    assert found.tests == 64
    assert found.relative_error is None
    assert found.miles_per_test == pytest.approx(metres / 64 / METRES_PER_MILE, rel=0.01)


def test_the_stated_error_is_that_between_samples() -> None:
    """16 samples of 256 tests: their spread agrees with what one of them states, within a factor that n allows."""
    setting = setting_of(MODEL, ODD)
    samples = [bv_travel(setting, SLOTS, seed=seed, tests=256) for seed in range(16)]
    mean = sum(sample.miles_per_test for sample in samples) / 16
    spread = (sum((sample.miles_per_test - mean) ** 2 for sample in samples) / 15) ** 0.5 / mean
    stated = sum((sample.relative_error or 0.0) ** 2 for sample in samples) ** 0.5 / 4
    assert 0.4 < spread / stated < 2.0  # chi-square with 15 and 48 degrees: beyond this with chance below 1e-3
    assert stated < 0.05


def test_threads_do_not_matter_and_bad_input_is_refused() -> None:
    setting = setting_of(MODEL, ODD)
    assert bv_travel(setting, SLOTS, seed=0, tests=200, threads=2) == bv_travel(setting, SLOTS, seed=0, tests=200)
    with pytest.raises(InputError, match="tests"):
        bv_travel(setting, SLOTS, seed=0, tests=0)
    with pytest.raises(InputError, match="adversary"):
        bv_travel(setting_of(MODEL, ODD, adversary="uniform"), SLOTS, seed=0, tests=1)
