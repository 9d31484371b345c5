"""What an AV of interface 2 sees: columns on worlds placed by hand, and rates against the motion that follows."""

from __future__ import annotations

import numpy as np
from hand_built import WIDE, Car, change_lane, setting_of, world_of

from cornerforge.foreign.scene import COLUMNS
from cornerforge.ndd.model import NddModel
from cornerforge.sim import av_scene
from cornerforge.sim.actions import hold
from cornerforge.sim.av_scene import SCENE_COLUMNS, scene_of_av
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.world import World

ODD = WIDE


def scene(model: NddModel, world: World, rows: int = 13) -> np.ndarray:
    out = np.full((rows, SCENE_COLUMNS), np.nan)
    scene_of_av(world, setting_of(model, ODD).road, np.zeros(world.vehicles.size, dtype=np.int64), out)
    return out


def test_the_two_lists_of_columns_are_one() -> None:
    assert len(COLUMNS) == SCENE_COLUMNS
    for place, name in enumerate(COLUMNS):
        assert getattr(av_scene, {"x": "X", "y": "Y"}.get(name, name.upper())) == place


def test_columns_by_hand(model: NddModel) -> None:
    seen = scene(model, world_of([Car(250.0, 1, 32.0), Car(280.0, 2, 27.0), Car(240.0, 0, 35.0), Car(460.0, 0, 35.0)]))
    start = ODD.av_start
    size = [ODD.vehicle_length, ODD.vehicle_width]
    still = [0.0] * 5
    np.testing.assert_allclose(seen[0, :14], [0, 0, *size, 250.0 - start, 6.0, 0, 32.0, 0, *still[:3], 0, 1])
    np.testing.assert_allclose(seen[1, :14], [2, 0, *size, 240.0 - start, 2.0, 0, 35.0, 0, *still[:3], 0, 0])
    np.testing.assert_allclose(seen[2, :14], [1, 0, *size, 280.0 - start, 10.0, 0, 27.0, 0, *still[:3], 0, 2])
    assert seen[0, 14:].tolist() == [0.0, ODD.test_length - (250.0 - start), 0.0, 1.0]
    assert (seen[3:, 0] == -1.0).all()  # the fourth is out of sight
    assert not seen[3:, 1:].any()


def test_fewer_or_all(model: NddModel) -> None:
    world = world_of([Car(250.0, 1, 32.0)] + [Car(250.0 + 6.0 * k, k % 3, 30.0) for k in range(1, 31)])
    assert scene(model, world, 4)[1:, 0].tolist() == [1, 2, 3]
    assert scene(model, world, 31)[1:, 0].tolist() == list(range(1, 31))


def test_rates_are_those_of_the_motion(model: NddModel) -> None:
    """Lateral acceleration and yaw rate of a lane change against differences of what comes a moment later."""
    road = setting_of(model, ODD).road
    checked = 0
    for ago in np.arange(0.1, 3.7, 0.1):
        world = world_of([Car(250.0, 1, 32.0), Car(280.0, 2, 27.0)])
        change_lane(world, 1, 1, road, ago=float(ago))
        now = scene(model, world)[1]
        before = world.vehicles[1].copy()
        hold(world.vehicles, 1, 0.0, road)
        move_vehicle(world.vehicles, 1, 0.1, road)
        after = world.vehicles[1]
        mean = (after["lateral_speed"] - before["lateral_speed"]) / 0.1
        assert abs(now[COLUMNS.index("ay")] - mean) < 0.2  # half a step of its largest rate, 3.75 m/s3
        assert (
            abs(
                now[COLUMNS.index("yaw_rate")]
                - (after["heading"] - np.arctan2(before["lateral_speed"], before["speed"])) / 0.1
            )
            < 0.008
        )
        checked += abs(mean) > 0.3
    assert checked > 10


def test_an_indicator_says_where_to_and_only_of_drivers_that_use_it(model: NddModel) -> None:
    road = setting_of(model, ODD).road
    world = world_of(
        [Car(250.0, 1, 32.0), Car(280.0, 2, 27.0), Car(290.0, 0, 27.0), Car(300.0, 0, 27.0, signals=False)]
    )
    for slot in (1, 2, 3):
        change_lane(world, slot, 1, road, ago=0.1)
    assert scene(model, world)[1:4, COLUMNS.index("indicator")].tolist() == [-1.0, 1.0, 0.0]
