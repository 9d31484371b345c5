"""Train an AV with somebody else's learner, then test it: PPO of Stable-Baselines3 in cornerforge/Driving-v0.

    pip install "cornerforge[sb3,learn]"
    python examples/train_av_sb3.py 400000               # steps of 0.5 s; some minutes; writes out/ppo.zip
    cornerforge run --av train_av_sb3:policy --effort quick --out out/ppo        # from the folder examples

While it learns it meets the hostile `lane-changer`: in natural traffic it would hardly ever see danger. Its network has
a layer of its own, which scales what it sees, so its file is loaded by Stable-Baselines3 itself (`policy`).
"""

import os
import sys
from pathlib import Path

import gymnasium
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

import cornerforge.envs  # noqa: F401 - registers the worlds

PATH = Path(os.environ.get("PPO", "out/ppo.zip")).resolve()
SIZES = torch.tensor([1.0, 50.0, 4.0, 30.0, 2.0, 4.0, 2.0, 1.0])
"""Of the columns of a view (`cornerforge.sim.av_view`)."""


class Scaled(BaseFeaturesExtractor):
    def __init__(self, space):
        super().__init__(space, 104)

    def forward(self, view):
        return torch.flatten(view / SIZES, 1)


def policy():
    """Give the trained policy: with `predict`, it is an AV."""
    return PPO.load(PATH, device="cpu")


def world():
    return gymnasium.make("cornerforge/Driving-v0", bv="lane-changer", actions="box", act_every=5)


if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 400_000
    agent = PPO(
        "MlpPolicy",
        make_vec_env(world, n_envs=16, seed=0),
        n_steps=256,
        batch_size=1024,
        gamma=0.97,
        policy_kwargs={"net_arch": [128, 128], "features_extractor_class": Scaled},
        seed=0,
        device="cpu",
    )
    agent.learn(steps)
    PATH.parent.mkdir(parents=True, exist_ok=True)
    agent.save(PATH)
