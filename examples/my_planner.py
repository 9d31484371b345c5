"""A planner of your own that plans trajectories: keeps its lane and a time gap, and makes room for who comes too near.

cornerforge check-av my_planner:MyPlanner
cornerforge run --av my_planner:MyPlanner --effort quick --out out/my-planner
"""

import numpy as np


class MyPlanner:
    answers = "trajectory"
    memory = False  # what it plans depends on the present scene alone

    def plan(self, scene):
        own, road = scene.own, scene.context
        beside = [o for o in scene.others if abs(o.y - own.y) < 2.5 and o.x > own.x]
        lead = min(beside, key=lambda o: o.x, default=None)
        acceleration = 0.4 * (road.set_speed - own.vx)
        if lead is not None:
            gap = lead.x - own.x - 0.5 * (lead.length + own.length)
            closing = max(own.vx - lead.vx, 0.0)
            follow = 0.2 * (gap - 2.0 - 1.2 * own.vx) - 0.8 * closing - closing**2 / (2.0 * max(gap - 2.0, 0.5))
            acceleration = min(acceleration, follow)
        goal = (own.lane + 0.5) * road.lane_width
        for other in scene.others:  # who is level with it and moves towards it
            level = abs(other.x - own.x) < 0.5 * (other.length + own.length) + 2.0
            if level and (other.y - own.y) * other.vy < -0.1 and abs(other.y - own.y) < road.lane_width:
                goal -= np.sign(other.y - own.y) * 0.8
        t = np.arange(0.0, 3.01, 0.1)
        held = np.minimum(t, -own.vx / acceleration) if acceleration < 0.0 else t  # it does not drive backwards
        x = own.x + own.vx * held + 0.5 * np.clip(acceleration, -8.0, 2.0) * held**2
        y = goal + (own.y - goal + (own.vy + 1.5 * (own.y - goal)) * t) * np.exp(-1.5 * t)  # critically damped
        return np.stack([t, x, y], axis=1)
