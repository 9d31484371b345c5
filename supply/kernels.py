"""Compile what commands need, once, on all cores: `make kernels`, before tests; with a folder, for a wheel.

Each job is a program of its own that calls verbs with small numbers; the kernels that they reach, and the parts of
these, are then kept (`cornerforge._kernel_cache`), so that a job does not compile what another one has. A job that was
done for the same sources, processor and Numba is not done again.

python supply/kernels.py [--run | FOLDER PROCESSOR...]: with --run, only what `cornerforge run` needs; with FOLDER, for
processors of `SHIPPED`, and copied there.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from cornerforge._kernel_cache import SHIPPED, cache_folder, target
from cornerforge.work import code_hash

ROOT = Path(__file__).parents[1]
JOBS = {
    "learning": """
cornerforge.simulate(tests=20, stats=True)
cornerforge.train(out="p.safetensors", decisions=1024, tests=20)
""",
    "branches": """
begin_elsewhere()
cornerforge.generate(policy="swerve", cases=12, out="lib")
cornerforge.analyse("lib", out="found")
with small_trees():
    cornerforge.rate(method="splitting", av="flawed-not-behind", max_tests=6000)
""",
    "worlds": """
cornerforge.simulate(tests=20, av="rl")
cornerforge.train(out="q.safetensors", decisions=1024, tests=20, reward="avoidable")
cornerforge.train_av(out="a.safetensors", decisions=1024, tests=20)
import gymnasium, cornerforge.ext.gym
for name in ("Adversary-v0", "Driving-v0"):
    world = gymnasium.make(f"cornerforge/{name}")
    world.reset(seed=1)
    world.step(world.action_space.sample())
""",
    "cases": """
cornerforge.generate(policy="swerve", cases=12, out="lib")
case = str(cornerforge.query("lib", "select case_id from cases limit 1").rows[0][0])
cornerforge.replay("lib", case, check=True)
cornerforge.rate(method="mc", av="flawed-not-behind", max_tests=300, out="r")
with small_trees():
    cornerforge.rate(method="is", av="flawed-not-behind", max_tests=6000)
cornerforge.retest("lib", av="rss-cautious")
cornerforge.shrink("lib", [case], out="less")
cornerforge.r157(families=["deceleration"], out="r157")
cornerforge.suite_run("aeb", families=["braking"], out="aeb")
cornerforge.import_cases([sys.argv[2] + "/interchange/data/cut_in.osi"], out="imported")
""",
}  # fmt: skip
RUN = ("learning", "branches")
"""What `cornerforge run` and `rate` need of it, with what is installed for `make demo`."""
_TAIL = """
open("used.txt", "w").write("\\n".join(sorted(used)))
"""
_HEAD = """
import os, sys
from cornerforge._kernel_cache import KernelCache, target
used = set()
name_of = KernelCache._name
def noted(self, sig, made_for):
    name = name_of(self, sig, made_for)
    if made_for == target():
        used.add(name)
    return name
KernelCache._name = noted
os.chdir(sys.argv[1])
sys.path.insert(0, sys.argv[2])
import cornerforge
from small_trees import small_trees

def begin_elsewhere():
    # The other job compiles a second of driving from its start; this one begins with what comes later in that second.
    import numba
    from cornerforge.experiment.setting import experiment
    from cornerforge.sim import allocate_scratch, allocate_worlds, keep_nothing, loop, world_of
    run = experiment()
    setting, slots = run.setting, run.slots
    world, keep = world_of(allocate_worlds(1, slots)), keep_nothing(slots)
    scratch = allocate_scratch(slots, setting.who.policy)
    for part, words in (
        (loop._begin_second, (world, 0.0, 0, setting, scratch, keep)),
        (loop.move_on, (world, 0, setting, keep.recording)),
    ):
        part._part.compile(tuple(map(numba.typeof, words)))
"""


def compiled(processor: str | None, names: Sequence[str] = tuple(JOBS)) -> list[Path]:
    """Do jobs for a processor, this one by default, if that was not done yet; return the files of machine code."""
    if not cache_folder():
        sys.exit("No folder for machine code can be written; name one in NUMBA_CACHE_DIR.")
    named = processor or os.environ.get("NUMBA_CPU_NAME")
    told = f"{code_hash()} {target()} {named} {[(name, JOBS[name]) for name in names]}"
    stamp = Path(cache_folder()) / f"all-{hashlib.sha256(told.encode()).hexdigest()[:16]}.stamp"
    if not stamp.exists():
        print(f"Compiling the simulator{f' for {processor}' if processor else ''} (once)", file=sys.stderr)
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as work:
            used = _run(Path(work), processor, names)
        stamp.write_text("\n".join(sorted(used)), encoding="utf-8")
        print(f"Compiled in {time.monotonic() - begin:.0f} s", file=sys.stderr)
    return [stamp.parent / name for name in stamp.read_text(encoding="utf-8").split()]


def _run(work: Path, processor: str | None, names: Sequence[str]) -> set[str]:
    """Run the jobs in order, two at once (more would compile the same parts); return the names of the files used."""
    surroundings = {**os.environ, "PYTHONWARNINGS": "ignore"}
    if processor:
        surroundings |= {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": ""}

    def done(name: str) -> bool:
        (work / name).mkdir()
        words = [sys.executable, "-c", _HEAD + JOBS[name] + _TAIL, str(work / name), str(ROOT / "tests")]
        return subprocess.run(words, stdout=subprocess.DEVNULL, env=surroundings, check=False).returncode == 0

    with ThreadPoolExecutor(max_workers=2) as pool:
        failed = [name for name, right in zip(names, pool.map(done, names), strict=True) if not right]
    if failed:
        sys.exit(f"Not all was compiled: {', '.join(failed)}")
    return {line for name in names for line in (work / name / "used.txt").read_text(encoding="utf-8").split()}


def main() -> None:
    """Compile for this processor or, with a folder, for those of wheels."""
    if sys.argv[1:] in ([], ["--run"]):
        compiled(None, RUN if sys.argv[1:] else tuple(JOBS))
        return
    place = Path(sys.argv[1])
    place.mkdir(parents=True)
    for processor in sys.argv[2:]:
        if processor not in SHIPPED:
            sys.exit(f"No wheel has machine code for {processor}; known: {', '.join(SHIPPED)}")
        for file in compiled(processor):
            shutil.copy(file, place)


if __name__ == "__main__":
    main()
