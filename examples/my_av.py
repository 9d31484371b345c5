"""A complete AV of your own: keeps a time gap of 1.5 s, and its lane. Try it, then test it:

cornerforge check-av my_av:MyAv
cornerforge simulate --av my_av:MyAv --tests 1000
"""

import numpy as np


class MyAv:
    def setup(self, context):
        self.length = context.vehicle_length

    def act(self, view):  # (B, 13, 8): row 0 is the AV, the others the vehicles around it, in metres and seconds
        av, others = view[:, :1], view[:, 1:]
        in_way = (others[..., 0] == 1) & (others[..., 1] > 0) & (np.abs(others[..., 2]) < 3.0)
        gap = np.where(in_way, others[..., 1] - self.length, np.inf)
        speed = av[:, 0, 3]
        lead = gap.argmin(axis=1)
        rows = np.arange(len(view))
        gap, closing = np.maximum(gap[rows, lead], 0.5), speed - others[rows, lead, 3]
        room = np.maximum(gap - 2.0 - 1.5 * speed, -20.0)
        follow = np.where(
            np.isfinite(gap), 0.1 * room - 0.6 * closing - np.maximum(closing, 0) ** 2 / (2 * gap), np.inf
        )
        return np.stack([np.minimum(follow, 0.4 * (33.0 - speed)), np.zeros(len(view))], axis=1)
