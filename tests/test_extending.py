"""A stranger extends cornerforge: each recipe of CONTRIBUTING.md is followed in a copy, in the files that it names.

The copy lies outside `src/` and is started as a program of its own, with machine code of its own.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cornerforge.adversary.worlds.rewards import REWARDS
from cornerforge.sim.controllers import ADVERSARIES
from cornerforge.world_options import LEARNERS, PLAIN_ADVERSARIES, REWARD_NAMES

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "cornerforge"
Recipe = dict[str, list[tuple[str, str]]]
"""By file: each old text, which the file holds once, and the new text in its place; of a new file, all of it."""

METRIC: Recipe = {
    "metrics/mttc.py": [
        (
            "",
            '''"""Modified time to collision."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.metrics._inputs import matching_arrays

__all__ = ["mttc"]


def mttc(bbd: ArrayLike, range_rate: ArrayLike, acceleration: ArrayLike) -> NDArray[np.float64]:
    """Time until contact if both vehicles kept their accelerations [s]; `acceleration` is lead minus subject."""
    gap, rate, change = matching_arrays(bbd=bbd, range_rate=range_rate, acceleration=acceleration)
    root = np.sqrt(np.maximum(rate * rate - 2.0 * change * gap, 0.0))
    meets = (gap > 0.0) & (rate * rate >= 2.0 * change * gap) & (root - rate > 0.0)
    return np.where(gap <= 0.0, 0.0, np.divide(2.0 * gap, root - rate, out=np.full(gap.shape, np.inf), where=meets))
''',
        )
    ],
    "metrics/__init__.py": [
        (
            "from cornerforge.metrics.pet import",
            "from cornerforge.metrics.mttc import mttc\nfrom cornerforge.metrics.pet import",
        ),
        ('    "pet",\n', '    "mttc",\n    "pet",\n'),
    ],
}  # fmt: skip
AV_LAW: Recipe = {
    "drivers/avs.py": [
        ("AV_KINDS = {\n", 'AV_KINDS = {\n    "gentle": AvLaw(9, 0.5, None, sees_everybody=False, parameters=()),\n'),
        (
            '        AvModel(\n            "idm-mobil-d2rl"',
            '        AvModel("gentle", "brakes with 0.5 m/s2 at most", IdmParams(), MobilParams(), kind="gentle"),\n'
            '        AvModel(\n            "idm-mobil-d2rl"',
        ),
    ],
    "sim/av_kinds.py": [
        (
            '_DECISIONS = {\n    "watchful"',
            '''@kernel
def _gentle(w: World, _substep: int, road: RoadNumbers, av: AvNumbers, _scratch: AvScratch) -> tuple[float, int]:
    """The IDM with a weak foot."""
    return max(-0.5, lead_acceleration(w, 0, w.vehicles[0].lanes, av.sight, road, av)), w.vehicles[0].target_lane


_DECISIONS = {
    "gentle": _gentle, "watchful"''',
        )
    ],
}  # fmt: skip
REWARD: Recipe = {
    "adversary/worlds/rewards.py": [
        ("REWARDS = {\n", 'REWARDS = {\n    "struck": Reward(9, "a crash in which the AV is struck"),\n'),
        (
            "_RULES: dict[str, Any] = {",
            """@inlined_kernel
def _that_is_struck(strikes: bool, _avoidable: bool) -> bool:
    return not strikes


_RULES: dict[str, Any] = {"struck": _that_is_struck, """,
        ),
    ],
    "world_options.py": [('REWARD_NAMES = ("crash",', 'REWARD_NAMES = ("crash", "struck",')],
}
ADVERSARY: Recipe = {
    "sim/controllers.py": [
        ("CUTS_IN, TOLD = range(10)", "CUTS_IN, TOLD, BRAKER = range(11)"),
        ('"swerve": SWERVE,', '"swerve": SWERVE, "braker": BRAKER,'),
    ],
    "sim/adversaries.py": [
        (
            '_RULES = {\n    "uniform": _uniform,',
            '''@inlined_kernel
def _braker(_w: World, _bv: int, _words: Words, s: ChoiceScratch) -> int:
    """The hardest braking that is allowed."""
    return _nearest_allowed(-9.0, s.allowed)


_RULES = {"braker": _braker, "uniform": _uniform,''',
        )
    ],
    "world_options.py": [('PLAIN_ADVERSARIES = ("uniform",', 'PLAIN_ADVERSARIES = ("uniform", "braker",')],
}
LEARNER: Recipe = {
    "adversary/reinforce.py": [
        (
            "",
            '''"""REINFORCE on the reward of each single decision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from cornerforge.adversary.config import TrainConfig
from cornerforge.adversary.network import TrainableNetwork
from cornerforge.adversary.worlds import Exploring
from cornerforge.drivers.policy import numbers_of_network
from cornerforge.sim import POLICY


@dataclass(frozen=True, kw_only=True)
class Config(TrainConfig):
    """Nothing besides what every learner has."""

    head: ClassVar[str] = "softmax"

    learner: str = "reinforce"


PRESETS = {
    "fast": Config(
        preset="fast", learning_rate=0.1, final_learning_rate=0.01, worlds=64, decisions=20_000, n_shared=1, n_stream=0,
        width=16,
    )
}


class Reinforce:
    """Raises the log-probability of what was paid."""

    def __init__(self, config, seed):
        self._config, self.updates, self._loss, self._batch = config, 0, None, None
        self._network = TrainableNetwork(config.network, seed, "sgd", 1.0)

    def exploring(self, decisions):
        numbers = numbers_of_network(self._network.weights(), self._config.network, self._config.head)
        return Exploring(POLICY, numbers, 0.0, 0, 0.0)

    def note(self, batch):
        parts = (batch.observation, batch.allowed, batch.action, batch.reward)
        self._batch = [torch.from_numpy(part.copy()) for part in parts]

    def learn(self, learning_rate):
        if self._batch is not None:
            observation, allowed, action, reward = self._batch
            log_probs = self._network(observation).masked_fill(~allowed, -1e9).log_softmax(dim=1)
            loss = -(log_probs.gather(1, action.unsqueeze(1)).squeeze(1) * reward).mean()
            self._network.descend(loss, learning_rate)
            self._loss, self._batch = loss.item(), None
            self.updates += 1

    def point(self, decisions):
        return {"loss": self._loss, "epsilon": None}

    def arrays(self):
        return self._network.arrays()

    def values(self):
        return {"updates": self.updates, "loss": self._loss}

    def restore(self, arrays, values):
        self._network.restore(arrays)
        self.updates, self._loss = values["updates"], values["loss"]


make_learner = Reinforce
''',
        )
    ],
    "world_options.py": [('LEARNERS = ("dqn", ', 'LEARNERS = ("dqn", "reinforce", ')],
}
RECIPES = {
    "Add a metric": METRIC, "Add an AV law": AV_LAW, "Add a reward": REWARD, "Add an adversary": ADVERSARY,
    "Add a learner": LEARNER,
}  # fmt: skip

USE = """
import contextlib, io, json
from dataclasses import replace
from cornerforge import avs, simulate
from cornerforge.adversary.config import preset_named
from cornerforge.cli import main
from cornerforge.metrics import mttc
from cornerforge.experiment.setting import experiment
from cornerforge.verbs.train import learn

def help_of(command):
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main([command, "--help"])
    return said.getvalue()

def driven(**world):
    result = simulate(tests=200, threads=1, **world)
    return {name: getattr(result, name) for name in ("av_crashes", "digest")}

def trained(reward):
    # It explores all the time, so all rewards see the same tests.
    config = replace(preset_named("fast"), reward=reward, decisions=6000, replay_start=5000, epsilon_end=1.0)
    result = learn(experiment(av="gentle"), config, seed=3, threads=1)[1]
    paid = sum(point.tests * point.paid_per_test for point in result.curve if point.tests)
    return {"updates": result.updates, "paid": paid}

def taught(learner):
    policy, result = learn(experiment(av="gentle"), preset_named("fast", learner), seed=3, threads=1)
    return {"updates": result.updates, "head": policy.head}

print(json.dumps({
    "mttc": mttc([20.0, 20.0, -1.0], [-5.0, 0.0, 5.0], [0.0, -1.0, 0.0]).tolist(),
    "avs": [av.name for av in avs().avs],
    "help": {command: help_of(command) for command in ("simulate", "generate", "train")},
    "idm-mobil": driven(bv="swerve"),
    "gentle": driven(bv="swerve", av="gentle"),
    "braker": driven(bv="braker", av="gentle"),
    "reinforce": taught("reinforce"),
    "trained": {reward: trained(reward) for reward in ("crash", "striking", "struck")},
}))
"""


def apply(recipe: Recipe, package: Path) -> None:
    for name, changes in recipe.items():
        path = package / name
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        for old, new in changes:
            assert text.count(old) == 1, f"{name} does not hold this once: {old}"
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")


def python(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run code with the package that lies in a folder, and with machine code kept there."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "machine-code")}
    return subprocess.run(
        [sys.executable, "-B", "-c", code], capture_output=True, text=True, check=False, env=environment,
        cwd=folder,
    )  # fmt: skip


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the package that holds all extensions."""
    folder = tmp_path_factory.mktemp("scratch")
    shutil.copytree(PACKAGE, folder / "cornerforge", ignore=shutil.ignore_patterns("__pycache__"))
    for recipe in RECIPES.values():
        apply(recipe, folder / "cornerforge")
    return folder


def section(title: str) -> str:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    found = re.search(rf"^## {title}\n(.*?)(?=^## )", text, re.M | re.S)
    assert found is not None, f"CONTRIBUTING.md has no section {title}"
    return found.group(1)


@pytest.mark.parametrize("title", RECIPES)
def test_contributing_names_the_files_that_an_extension_touches(title: str) -> None:
    said = re.match(r"\s*Files below `src/cornerforge/`: (.*?)\n\n", section(title), re.S)
    assert said is not None
    named = re.findall(r"`([\w/]+\.py)`", said.group(1))
    assert set(named) == set(RECIPES[title])
    assert 2 <= len(named) <= 3
    assert [name for name in named if not (PACKAGE / name).exists()] == re.findall(
        r"`([\w/]+\.py)` \(new\)", said.group(1)
    )
    for name in re.findall(r"`([\w/]+\.py)`", section(title)):
        assert name in named or (PACKAGE / name).exists() or (ROOT / name).exists(), f"{name} is not there"


def test_help_names_what_there_is() -> None:
    assert {"nobody", "policy", *PLAIN_ADVERSARIES} == set(ADVERSARIES)
    assert all((PACKAGE / "adversary" / f"{learner}.py").exists() for learner in LEARNERS)
    assert set(REWARD_NAMES) == set(REWARDS)


FORGOTTEN: dict[str, tuple[str, str, str, str]] = {
    "how hard a law brakes": (
        "drivers/avs.py", "AvLaw(9, 0.5, None,", "AvLaw(code=4, strongest_acceleration=None,", "hardest_braking",
    ),
    "how far a law looks": ("drivers/avs.py", "0.5, None, sees_everybody=False", "0.5, None", "sees_everybody"),
    "what a law drives by": (
        "drivers/avs.py", "0.5, None, sees_everybody=False, parameters=()", "0.5, None, sees_everybody=False",
        "parameters",
    ),
    "what a law does": ("sim/av_kinds.py", '"gentle": _gentle, ', "", "gentle: declared and without a kernel"),
    "a code of its own": ("drivers/avs.py", "AvLaw(9,", "AvLaw(2,", "Two have the same code: .*'gentle': 2"),
    "what a reward pays for": (
        "adversary/worlds/rewards.py", '"struck": _that_is_struck, ', "", "struck: declared and without a kernel",
    ),
    "where a reward is judged": (
        "adversary/worlds/rewards.py", "return not strikes", "return not _avoidable",
        '"struck" asks .* adversary/worlds/drive_bv.py',
    ),
    "what a head does": (
        "sim/adversaries.py", ', "softmax": _softmax', "", "softmax: declared and without a kernel",
    ),
    "what an adversary does": (
        "sim/adversaries.py", '"braker": _braker, ', "", "braker: declared and without a kernel",
    ),
}  # fmt: skip
"""What can be forgotten: file, text, the text without it, and what the error says."""


@pytest.mark.full
def test_what_is_forgotten_is_an_error_that_names_it(scratch: Path, tmp_path: Path) -> None:
    """At import, so whatever the stranger starts first tells it."""
    copy = tmp_path / "cornerforge"
    shutil.copytree(scratch / "cornerforge", copy)
    load = "import cornerforge.adversary.worlds.rewards, cornerforge.sim.av_kinds, cornerforge.sim.adversaries"
    done = python(tmp_path, load)
    assert done.returncode == 0, done.stderr
    for what, (name, text, without, error) in FORGOTTEN.items():
        whole = (copy / name).read_text(encoding="utf-8")
        apply({name: [(text, without)]}, tmp_path / "cornerforge")
        done = python(tmp_path, load)
        assert done.returncode == 1, what
        assert re.search(error, done.stderr.splitlines()[-1]), f"{what}: {done.stderr}"
        (copy / name).write_text(whole, encoding="utf-8")


@pytest.mark.slow
def test_the_extensions_work(scratch: Path) -> None:
    done = python(scratch, USE)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)

    assert found["mttc"] == [4.0, pytest.approx(40.0**0.5), 0.0]

    assert "gentle" in found["avs"]
    assert found["gentle"]["digest"] != found["idm-mobil"]["digest"]
    assert found["idm-mobil"]["av_crashes"] > 0

    assert found["braker"]["digest"] != found["gentle"]["digest"]
    assert found["braker"]["av_crashes"] > 0, "it brakes with 0.5 m/s2, whoever brakes before it"
    assert all("braker" in found["help"][command] for command in ("simulate", "generate"))

    assert "reinforce" in found["help"]["train"]
    assert found["reinforce"]["updates"] == 20_032 // 64 - 1
    assert found["reinforce"]["head"] == "softmax"

    assert "struck" in found["help"]["train"]
    assert found["trained"]["struck"]["updates"] > 0
    paid = {reward: result["paid"] for reward, result in found["trained"].items()}
    assert min(paid.values()) > 0.5
    assert paid["struck"] + paid["striking"] == pytest.approx(paid["crash"]), "a crash of either kind, never of both"
