"""Compile what commands need, once, on all cores: `make kernels`, before tests and in wheels.

Each job is a program of its own that calls verbs with small numbers; the kernels that they reach are then kept
(`cornerforge._kernel_cache`). A job that was done for the same sources, processor and Numba is not done again.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from cornerforge._kernel_cache import cache_folder, target
from cornerforge.execution import code_hash

JOBS = {
    "bulk": """
cornerforge.simulate(tests=20, stats=True)
cornerforge.simulate(tests=20, av="rl")
cornerforge.train(out="p.safetensors", decisions=1024, tests=20)
cornerforge.train(out="q.safetensors", decisions=1024, tests=20, reward="avoidable")
cornerforge.train_av(out="a.safetensors", decisions=1024, tests=20)
import gymnasium, cornerforge.envs
for name in ("Adversary-v0", "Driving-v0"):
    world = gymnasium.make(f"cornerforge/{name}")
    world.reset(seed=1)
    world.step(world.action_space.sample())
""",
    "cases": """
cornerforge.generate(policy="swerve", cases=12, out="lib")
case = str(cornerforge.query("lib", "select case_id from cases limit 1").rows[0][0])
cornerforge.replay("lib", case, check=True)
cornerforge.analyse("lib", out="found")
cornerforge.rate(method="mc", av="flawed-not-behind", max_tests=300, out="r")
cornerforge.retest("lib", av="rss-cautious")
cornerforge.shrink("lib", [case], out="less")
cornerforge.r157(families=["deceleration"], out="r157")
with small_trees():
    cornerforge.rate(method="splitting", av="flawed-not-behind", max_tests=6000)
    cornerforge.rate(method="is", av="flawed-not-behind", max_tests=6000)
cornerforge.import_cases([sys.argv[2] + "/interchange/data/cut_in.xosc"], out="imported")
""",
}  # fmt: skip
_HEAD = """
import os, sys
os.chdir(sys.argv[1])
sys.path.insert(0, sys.argv[2])
import cornerforge
from fuzz.seeds import small_trees
"""


def main() -> int:
    """Run the jobs beside each other; say how long it took."""
    folder = Path(cache_folder())
    told = f"{code_hash()} {target()} {JOBS}"
    stamp = folder / f"all-{hashlib.sha256(told.encode()).hexdigest()[:16]}.stamp"
    if stamp.exists():
        return 0
    print("Compiling the simulator (once for these sources)", file=sys.stderr)
    begin = time.monotonic()
    tests = Path(__file__).parents[1] / "tests"
    with tempfile.TemporaryDirectory() as work:
        running = []
        for name, job in JOBS.items():
            place = Path(work) / name
            place.mkdir()
            running.append(
                subprocess.Popen(
                    [sys.executable, "-c", _HEAD + job, str(place), str(tests)],
                    stdout=subprocess.DEVNULL,
                    env={**os.environ, "PYTHONWARNINGS": "ignore"},
                )
            )
        failed = [name for name, one in zip(JOBS, running, strict=True) if one.wait() != 0]
    if failed:
        print(f"Not all was compiled: {', '.join(failed)}; what needs it will compile it.", file=sys.stderr)
        return 1
    stamp.touch()
    print(f"Compiled in {time.monotonic() - begin:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
