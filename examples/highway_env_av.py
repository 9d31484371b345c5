"""The IDM-and-MOBIL vehicle of highway-env, another simulator, as an AV (pip install highway-env).

cornerforge check-av highway_env_av:HighwayIdm
cornerforge run --av highway_env_av:HighwayIdm --effort quick --out out/highway-env
"""

import numpy as np
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

from cornerforge.errors import InputError


class HighwayIdm:
    answers = "curvature"
    objects = None  # all vehicles within 200 m

    def setup(self, context):
        if context.lanes:
            raise InputError("HighwayIdm plans on lanes without an end; give it a road along which all lanes go on.")
        self.context = context
        self.width = context.n_lanes * context.lane_width
        network = RoadNetwork()
        for lane in range(context.n_lanes):  # its y points to the right, so its lane 0 is the leftmost
            y = (lane + 0.5) * context.lane_width
            ends = (-500.0, y), (context.test_length + 900.0, y)
            network.add_lane("a", "b", StraightLane(*ends, context.lane_width, speed_limit=context.speed_limit))
        self.network = network
        self.car = None

    def _mirrored(self, box):
        return np.array([box.x, self.width - box.y]), -box.heading, box.speed

    def plan(self, scene):
        road = Road(network=self.network, np_random=np.random.RandomState(0))
        for other in scene.others:
            position, heading, speed = self._mirrored(other)
            road.vehicles.append(IDMVehicle(road, position, heading, speed, target_speed=speed, timer=0.5))
            road.vehicles[-1].LENGTH = other.length
        position, heading, speed = self._mirrored(scene.own)
        if self.car is None:
            self.car = IDMVehicle(road, position, heading, speed, target_speed=self.context.set_speed)
        car = self.car
        car.road, car.position, car.heading, car.speed = road, position, heading, speed
        car.on_state_update()  # finds its lane
        car.timer += self.context.interval
        road.vehicles.append(car)
        car.act()
        slip = np.arctan(0.5 * np.tan(car.action["steering"]))
        return car.action["acceleration"], -np.sin(slip) / (0.5 * car.LENGTH)
