"""A complete AV that merges: keeps a time gap, leaves a lane that ends where the gap beside it will do, else stops.

cornerforge check-av merging_av:MergingAv
cornerforge simulate --road on-ramp --task ramp --av merging_av:MergingAv --tests 300
"""

import math


class MergingAv:
    objects = None  # all vehicles within 200 m
    memory = False  # what it does depends on the present scene alone

    def plan(self, scene):
        own, lane = scene.own, scene.target_lane
        wish, ends = scene.context.set_speed, scene.lane_ends_in(lane)
        acceleration = min(self._follow(own, self._around(scene, k)[0], wish) for k in {lane, own.lane})
        beside = max(lane + 1, lane - 1, key=scene.lane_ends_in)
        if scene.lane_ends_in(beside) > ends and own.lane == lane:
            lead, rear = self._around(scene, beside)
            way = 5.0 + 0.5 * scene.context.lane_change_duration * own.vx  # until its centre is over the line
            if ends > way and max(self._braking(own, lead), self._braking(rear, own)) < 2.0:
                return acceleration, beside - lane
            acceleration = min(acceleration, max(self._follow(own, lead, wish), -1.5))
        room = max(ends - 20.0, 0.1)  # it stops where it still has a way to start from
        needed = own.vx**2 / (2.0 * room)
        return min(acceleration, -max(needed, 2.0)) if needed > 2.0 or room < 1.0 else acceleration, 0

    def _around(self, scene, lane):  # the vehicles ahead and behind whose bodies reach into a lane
        wide, x = scene.context.lane_width, scene.own.x
        there = [o for o in scene.others if abs(o.y - (lane + 0.5) * wide) < 0.5 * (wide + o.width)]
        ahead, behind = [o for o in there if o.x >= x], [o for o in there if o.x < x]
        return min(ahead, key=lambda o: o.x, default=None), max(behind, key=lambda o: o.x, default=None)

    def _room(self, rear, lead):
        return lead.x - rear.x - 0.5 * (lead.length + rear.length) - 2.0 if rear and lead else math.inf

    def _braking(self, rear, lead):  # that the rear one needs to keep 0.3 s behind the other [m/s2]
        if not rear or not lead:
            return 0.0
        room = self._room(rear, lead) - 0.3 * rear.vx
        return max(rear.vx - lead.vx, 0.0) ** 2 / (2.0 * room) if room > 0.0 else math.inf

    def _follow(self, own, lead, wish):  # IDM [m/s2]
        closing = own.vx - lead.vx if lead else 0.0
        wanted = max(0.0, 1.2 * own.vx + own.vx * closing / 4.0)
        return 1.5 * (1.0 - (own.vx / wish) ** 4 - (wanted / max(self._room(own, lead), 0.1)) ** 2)
