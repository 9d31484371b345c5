"""Features of equation 10: values, names, short cases, scaling."""

from __future__ import annotations

import numpy as np
import pytest

from cornerforge.analysis import crash_features
from cornerforge.analysis.features import scaling_of
from cornerforge.errors import InputError


def history_of(durations: list[int]) -> np.ndarray:
    """Random histories of which the last `durations` seconds (and the contact) are recorded."""
    history = np.random.default_rng(3).normal(size=(len(durations), 16, 2, 4))
    for row, duration in enumerate(durations):
        history[row, duration + 1 :] = np.nan
    return history


def test_bv_minus_av_for_each_second() -> None:
    history = history_of([15])
    history[0, 2] = [[100.0, 6.0, 30.0, 0.01], [110.0, 2.0, 25.0, -0.02]]
    features = crash_features(history, 3)
    assert features.names[:6] == ("r_lon_1s", "r_lat_1s", "rr_1s", "h_CAV_1s", "h_BV_1s", "r_lon_2s")
    assert features.values.shape == (1, 15)
    assert features.values[0, 5:10].tolist() == [10.0, -4.0, -5.0, 0.01, -0.02]
    assert (features.padded, features.excluded) == (0, 0)


def test_short_cases_repeat_their_earliest_second() -> None:
    history = history_of([15, 2, 0])
    features = crash_features(history, 4)
    values = features.values.reshape(3, 4, 5)
    assert features.padded == 2
    assert (values[1, 2:] == values[1, 1]).all()
    assert not (values[1, 0] == values[1, 1]).any()
    contact = history[2, 0, 1, :3] - history[2, 0, 0, :3]
    assert (values[2, :, :3] == contact).all()


def test_seconds_before_a_gap_do_not_count() -> None:
    history = history_of([15])
    history[0, 2, 1, 0] = np.nan
    values = crash_features(history, 3).values.reshape(3, 5)
    assert (values == values[0]).all()


def test_short_cases_can_be_left_out() -> None:
    features = crash_features(history_of([15, 2, 4, 0]), 4, short="exclude")
    assert features.kept.tolist() == [0, 2]
    assert (features.padded, features.excluded) == (0, 2)


def test_single_precision_is_taken_as_it_is() -> None:
    history = history_of([15]).astype(np.float32)
    assert crash_features(history, 15).values.dtype == np.float64


def test_moving_the_road_moves_no_feature() -> None:
    history = history_of([15, 7])
    shifted = history + np.array([512.0, 8.0, 0.0, 0.0])
    assert crash_features(shifted, 5).values == pytest.approx(crash_features(history, 5).values, abs=1e-10)


def test_standard_scores_and_constant_columns() -> None:
    rng = np.random.default_rng(0)
    values = np.column_stack([rng.normal(50.0, 9.0, 200), np.full(200, 0.1), rng.normal(0.0, 1e-6, 200)])
    scaled = scaling_of(values).scaled(values)
    assert scaled.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert scaled.std(axis=0) == pytest.approx([1.0, 0.0, 1.0])
    assert not scaled[:, 1].any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: h[:, :15], r"history has shape \(2, 15, 2, 4\); allowed: \(cases, 16, 2, 4\)"),
        (lambda h: h[:0], "no cases to analyse"),
        (lambda h: np.where(np.arange(2)[:, None, None, None] == 1, np.nan, h), r"history\[1, 0\].*1 case\(s\) of 2"),
    ],
)
def test_bad_histories_are_named(change, message: str) -> None:
    with pytest.raises(InputError, match=message):
        crash_features(change(history_of([15, 15])))


def test_bad_options_are_named() -> None:
    with pytest.raises(InputError, match="steps = 16 is out of range; allowed: from 1 to 15"):
        crash_features(history_of([15]), 16)
    with pytest.raises(InputError, match='Did you mean "exclude"'):
        crash_features(history_of([15]), short="exlude")  # type: ignore[arg-type]
