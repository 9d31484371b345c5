"""What the learned AV makes of its view: entries by hand, mirror images, absence."""

from __future__ import annotations

import numpy as np
from hand_built import WIDE, Car, change_lane, setting_of, world_of

from cornerforge.drivers.sight import VISIBLE
from cornerforge.ndd.model import NddModel
from cornerforge.sim.actions import start_lane_change
from cornerforge.sim.av_features import N_AV_FEATURES, av_features
from cornerforge.sim.av_view import VIEW_COLUMNS, VIEW_ROWS, view_of_av
from cornerforge.sim.world import World

ODD = WIDE
OWN, PER = 9, 8
AHEAD, BEHIND, LEFT_AHEAD, LEFT_BEHIND, RIGHT_AHEAD, RIGHT_BEHIND = (
    slice(OWN + PER * k, OWN + PER * (k + 1)) for k in range(6)
)


def features(model: NddModel, world: World) -> np.ndarray:
    road = setting_of(model, ODD).road
    view = np.zeros((VIEW_ROWS, VIEW_COLUMNS), dtype=np.float32)
    view_of_av(world, road, VISIBLE, np.zeros(VIEW_ROWS - 1, dtype=np.int64), view)
    out = np.full(N_AV_FEATURES, np.nan, dtype=np.float32)
    av_features(view, road, out)
    return out


def test_an_empty_road(model: NddModel) -> None:
    out = features(model, world_of([Car(340.0, 0, 32.0)]))
    np.testing.assert_allclose(out[:OWN], [0.75, 0.2, 0, 0, 0, 1, 0, 0, 1], atol=1e-6)
    assert not out[OWN:].any()


def test_entries_by_hand(model: NddModel) -> None:
    cars = [Car(340.0, 1, 32.0), Car(365.0, 1, 27.0), Car(385.0, 1, 20.0), Car(330.0, 2, 37.0), Car(340.0, 0, 32.0)]
    out = features(model, world_of(cars))
    np.testing.assert_allclose(out[AHEAD], [1, 0.4, 1 / 3, -0.5, 0.25, 0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(out[LEFT_BEHIND], [1, 0.1, 2 / 3, 0.5, 1.0, 1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(out[RIGHT_AHEAD], [1, -0.1, 1, 0, 0, -1, 0, 0], atol=1e-6)
    for part in (BEHIND, LEFT_AHEAD, RIGHT_BEHIND):
        assert not out[part].any()


def test_who_is_seen_to_change_lanes_stands_in_both(model: NddModel) -> None:
    world = world_of([Car(340.0, 1, 30.0), Car(365.0, 2, 30.0)])
    change_lane(world, 1, 1, setting_of(model, ODD).road)
    out = features(model, world)
    assert (out[AHEAD][0], out[LEFT_AHEAD][0]) == (0.0, 1.0)
    change_lane(world, 1, 1, setting_of(model, ODD).road, ago=1.0)
    out = features(model, world)
    np.testing.assert_array_equal(out[AHEAD], out[LEFT_AHEAD])
    assert out[AHEAD][0] == 1.0


def test_lanes_count_from_the_one_that_the_av_changes_to(model: NddModel) -> None:
    world = world_of([Car(340.0, 1, 30.0), Car(365.0, 1, 30.0)])
    start_lane_change(world, 0, 2, setting_of(model, ODD).road)
    out = features(model, world)
    assert out[2] == -1.0
    assert out[5:8].tolist() == [0.0, 1.0, 1.0]
    assert out[RIGHT_AHEAD][0] == 1.0
    assert out[AHEAD][0] == 0.0


def test_the_mirror_image(model: NddModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sign = np.ones(PER)
    sign[[5, 6]] = -1.0
    for _ in range(30):
        cars = [Car(float(rng.uniform(240, 440)), int(rng.integers(3)), float(rng.uniform(20, 40))) for _ in range(9)]
        here = features(model, world_of(cars))
        there = features(model, world_of([car._replace(lane=2 - car.lane) for car in cars]))
        np.testing.assert_allclose(here[AHEAD], there[AHEAD] * sign, atol=1e-6)
        np.testing.assert_allclose(here[LEFT_AHEAD], there[RIGHT_AHEAD] * sign, atol=1e-6)
        np.testing.assert_allclose(here[RIGHT_BEHIND], there[LEFT_BEHIND] * sign, atol=1e-6)
        assert np.abs(here).max() <= 5.0
