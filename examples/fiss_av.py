"""FISS+, a Frenet trajectory planner that others wrote, as an AV (Sun et al., IROS 2023; pip install fiss-planner).

cornerforge check-av fiss_av:FissPlus
cornerforge run --av fiss_av:FissPlus --effort quick --out out/fiss
"""

import math

import fiss_planner as fp
import numpy as np

from cornerforge.errors import InputError


class FissPlus:
    answers = "trajectory"
    objects = None  # all vehicles within 200 m
    kind = "fiss_plus"

    def setup(self, context):
        if context.lanes:
            raise InputError("FISS+ plans on lanes without an end; give it a road along which all lanes go on.")
        vehicle = fp.VehicleParams()
        vehicle.length, vehicle.width = context.vehicle_length, context.vehicle_width
        vehicle.wheelbase, vehicle.rear_axle_to_center = context.wheelbase, 0.5 * context.wheelbase
        vehicle.max_accel, vehicle.max_decel, vehicle.max_lat_accel = 2.0, 8.0, 4.0
        vehicle.max_speed = context.max_speed
        config = fp.LocalPlannerConfig()
        config.planner.type = fp.planner_type_from_string(self.kind)
        config.desired_speed = context.set_speed
        # Its authors set this in traffic that reacts to the AV, as ours does.
        config.planner.collision.ignore_rear_in_lane = True
        config.route.lookahead = 300.0
        self.horizon = config.planner.sampling.max_t + 0.5
        self.road = self._road(context)
        self.planner = fp.LocalPlanner(config, vehicle)
        self.planner.set_map(self.road, [])

    def _road(self, context):
        road, ends = fp.RoadMap(), (-250.0, context.test_length + 600.0)
        for lane in range(context.n_lanes):
            piece = fp.MapLane()
            piece.id = lane + 1
            piece.centerline = context.centre_line(lane, *ends)
            piece.right, piece.left = context.edge(lane, *ends), context.edge(lane + 1, *ends)
            piece.speed_limit = context.speed_limit
            if lane > 0:
                piece.right_neighbor, piece.can_change_right = lane, True
            if lane + 1 < context.n_lanes:
                piece.left_neighbor, piece.can_change_left = lane + 2, True
            road.add_lane(piece)
        road.finalize()
        return road

    def reset(self, _seed):
        self.planner.reset()

    def plan(self, scene):
        own = scene.own
        others = [
            fp.predict_lane_following(
                self.road, o.id, o.x, o.y, math.atan2(o.vy, max(o.vx, 0.1)), o.speed, o.length, o.width,
                self.horizon, 0.1,
            )
            for o in scene.others
        ]  # fmt: skip
        ego = fp.EgoState(own.x, own.y, own.heading, own.speed, own.ax, scene.curvature)
        path = self.planner.step(scene.time, ego, others).trajectory
        if len(path) < 2:  # it has nothing to offer: brake on the spot
            t = np.arange(0.0, 3.01, 0.1)
            way = np.where(t < own.speed / 8.0, own.speed * t - 4.0 * t * t, own.speed**2 / 16.0)
            return np.stack([t, own.x + way * math.cos(own.heading), own.y + way * math.sin(own.heading)], axis=1)
        return np.stack([np.asarray(path.t), path.x, path.y, path.yaw, path.v], axis=1)
