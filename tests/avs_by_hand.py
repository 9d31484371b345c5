"""A module with AVs for tests: one never reacts, one always brakes, one fails after a while."""

AVS = """
import numpy as np

class Heedless:
    def act(self, view):
        return np.zeros((len(view), 2))


class Coward:
    def act(self, view):
        return np.tile([-8.0, 0.0], (len(view), 1))


class Fails:
    def __init__(self):
        self.asked = 0

    def reset(self, worlds, seeds):
        self.asked = 0

    def act(self, view):
        self.asked += 1
        if self.asked > 5:
            raise RuntimeError("lost my way")
        return np.zeros((len(view), 2))
"""
