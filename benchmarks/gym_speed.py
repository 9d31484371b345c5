"""How fast agents outside the kernels step: environments of `cornerforge.ext.gym` at 1, 64 and 1,024 worlds.

    python benchmarks/gym_speed.py

Prints decisions per second of the whole `step` (random actions drawn before, autoreset by SAME_STEP), and the share of
the time that the compiled kernels took.
"""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from cornerforge.ext.gym import ADVERSARY_ID, DRIVING_ID

SECONDS = 2.0


def measure(name: str, n: int, threads: int, **options: Any) -> tuple[float, float]:
    """Decisions per second, and the kernels' share of the time."""
    env: Any = gymnasium.make_vec(name, num_envs=n, threads=threads, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    batch = env._batch
    inside = 0.0
    share = batch._share

    def timed(work: Any) -> None:
        nonlocal inside
        start = time.perf_counter()
        share(work)
        inside += time.perf_counter() - start

    batch._share = timed
    actions = np.random.default_rng(0).integers(2, 33, size=(64, n))
    env.reset(seed=0)
    for k in range(20):
        env.step(actions[k])
    inside, steps, start = 0.0, 0, time.perf_counter()
    while time.perf_counter() - start < SECONDS:
        env.step(actions[steps % 64])
        steps += 1
    seconds = time.perf_counter() - start
    env.close()
    return steps * n / seconds, inside / seconds


def main() -> None:
    """Print the table."""
    print(f"{'environment':<28}{'worlds':>8}{'threads':>9}{'decisions/s':>14}{'in kernels':>12}")
    for label, name, options in (
        ("Adversary-v0", ADVERSARY_ID, {}),
        ("Adversary-v0, bounded", ADVERSARY_ID, {"bounded": True}),
        ("Driving-v0, every 0.1 s", DRIVING_ID, {}),
        ("Driving-v0, every 1 s", DRIVING_ID, {"act_every": 10}),
    ):
        for n, threads in ((1, 1), (64, 1), (1024, 1), (1024, 2)):
            rate, share = measure(name, n, threads, **options)
            print(f"{label:<28}{n:>8,}{threads:>9}{rate:>14,.0f}{share:>11.0%}")


if __name__ == "__main__":
    main()
