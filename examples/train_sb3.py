"""Train an adversary with somebody else's learner, then use it as one of cornerforge's own.

    pip install "cornerforge[sb3,learn]"
    python examples/train_sb3.py 60000        # decisions; some minutes

Stable-Baselines3's DQN drives the background vehicle nearest to the AV. Its network becomes a policy file, which acts
inside the compiled kernels: measured here on 2,000 tests beside the plain adversaries, and any crash replays by name.
PPO and sb3-contrib's MaskablePPO go the same way, with policy_kwargs={"activation_fn": torch.nn.ReLU}.
"""

import sys
from pathlib import Path

from stable_baselines3 import DQN
from stable_baselines3.common.env_util import make_vec_env

import cornerforge
from cornerforge.adversary import save_policy
from cornerforge.envs import ADVERSARY_ID
from cornerforge.envs.sb3 import policy_of_sb3

decisions = int(sys.argv[1]) if len(sys.argv) > 1 else 60_000
path = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("out/sb3-adversary.safetensors")

worlds = make_vec_env(ADVERSARY_ID, n_envs=16, seed=0)
agent = DQN(
    "MlpPolicy",
    worlds,
    learning_rate=1e-3,
    gamma=1.0,  # a test has an end, and a crash is worth as much late as early
    batch_size=256,
    learning_starts=1000,
    train_freq=1,  # 16 decisions
    gradient_steps=4,
    target_update_interval=200,
    exploration_fraction=0.5,
    seed=0,
)
agent.learn(decisions)
save_policy(policy_of_sb3(agent), path)

for driver in (str(path), "uniform", "swerve"):
    rate = cornerforge.simulate(bv=driver, tests=2000)
    low, high = rate.interval95
    print(f"{Path(driver).stem}: {rate.crashes_per_test:.3f} crashes per test ({low:.3f} to {high:.3f})")
