"""Train an AV with somebody else's learner, then test it: PPO of Stable-Baselines3 in cornerforge/Driving-v0.

    pip install "cornerforge[sb3,learn]"
    python examples/train_av_sb3.py 400000               # steps of 0.5 s; some minutes; writes out/ppo.zip
    cornerforge run --av out/ppo.zip --effort quick --out out/ppo

While it learns it meets the hostile `lane-changer`: in natural traffic it would hardly ever see danger.
"""

import sys
from pathlib import Path

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import cornerforge.envs  # noqa: F401 - registers the worlds


def world():
    return gymnasium.make("cornerforge/Driving-v0", bv="lane-changer", actions="box", act_every=5)


if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 400_000
    path = Path(sys.argv[2] if len(sys.argv) > 2 else "out/ppo.zip")
    agent = PPO(
        "MlpPolicy",
        make_vec_env(world, n_envs=16, seed=0),
        n_steps=256,
        batch_size=1024,
        gamma=0.97,
        policy_kwargs={"net_arch": [128, 128]},
        seed=0,
        device="cpu",
    )
    agent.learn(steps)
    path.parent.mkdir(parents=True, exist_ok=True)
    agent.save(path)
