"""What the AV sees: columns, order, sight and absence, on worlds placed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hand_built import WIDE, Car, change_lane, setting_of, world_of

from cornerforge.drivers.sight import VISIBLE
from cornerforge.foreign.interface import VIEW_SHAPE
from cornerforge.ndd.model import NddModel
from cornerforge.sim.av_view import VIEW_COLUMNS, VIEW_ROWS, view_of_av
from cornerforge.sim.world import World

ODD = WIDE


def view(model: NddModel, cars: list[Car] | World) -> np.ndarray:
    world = cars if isinstance(cars, World) else world_of(cars)
    out = np.full((VIEW_ROWS, VIEW_COLUMNS), np.nan, dtype=np.float32)
    view_of_av(world, setting_of(model, ODD).road, VISIBLE, np.zeros(VIEW_ROWS - 1, dtype=np.int64), out)
    return out


def test_columns_by_hand(model: NddModel) -> None:
    seen = view(model, [Car(250.0, 1, 32.0), Car(280.0, 2, 27.0), Car(240.0, 0, 35.0)])
    np.testing.assert_allclose(seen[0], [1, 390.0, 6.0, 32.0, 0, 0, 1, 0])
    np.testing.assert_allclose(seen[1], [1, -10.0, -4.0, 35.0, 0, 0, 0, 0])
    np.testing.assert_allclose(seen[2], [1, 30.0, 4.0, 27.0, 0, 0, 2, 0])
    assert not seen[3:].any()


@pytest.mark.parametrize(
    ("ago", "lane", "changes"), [(0.0, 2, 0), (0.96, 2, 0), (0.97, 1, 1), (1.99, 1, 1), (2.01, 1, 1), (3.1, 1, 0)]
)
def test_a_lane_change_shows_by_its_motion(model: NddModel, ago: float, lane: int, changes: int) -> None:
    world = world_of([Car(250.0, 1, 32.0), Car(280.0, 2, 27.0)])
    for slot, to in ((0, 0), (1, 1)):
        change_lane(world, slot, to, setting_of(model, ODD).road, ago=ago if slot else 0.0)
    seen = view(model, world)
    assert seen[0, 6:].tolist() == [0, 1]  # its own decision the AV knows
    assert seen[1, 6:].tolist() == [lane, changes]
    assert seen[1, 4] == pytest.approx(world.vehicles["lateral_speed"][1])


def test_the_nearest_rows_nearest_first(model: NddModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    full = 0
    for _ in range(50):
        cars = [
            Car(float(rng.uniform(0, 600)), int(rng.integers(3)), float(rng.uniform(20, 40)), bool(rng.random() < 0.8))
            for _ in range(int(rng.integers(2, 40)))
        ]
        cars[0] = Car(300.0, 1, 30.0)
        near = sorted(abs(c.x - 300.0) for c in cars[1:] if c.present and abs(c.x - 300.0) < 200.0)[: VIEW_ROWS - 1]
        seen = view(model, cars)
        assert seen[1:, 0].sum() == len(near)
        np.testing.assert_allclose(np.abs(seen[1 : 1 + len(near), 1]), near, rtol=1e-5)
        assert np.isfinite(seen).all()
        full += len(near) == VIEW_ROWS - 1
    assert 5 < full < 50


@pytest.mark.parametrize(("distance", "rows"), [(199.9, 1), (200.0, 0), (-199.9, 1), (-200.0, 0)])
def test_sight_ends_at_200_metres(model: NddModel, distance: float, rows: int) -> None:
    assert view(model, [Car(250.0, 1, 30.0), Car(250.0 + distance, 1, 30.0)])[1:, 0].sum() == rows


def test_avs_from_outside_are_told_the_views_shape() -> None:
    assert VIEW_SHAPE == (VIEW_ROWS, VIEW_COLUMNS)
