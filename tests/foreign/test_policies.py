"""Policies of Gymnasium as AVs: `predict` for observations and actions of `cornerforge/Driving-v0`."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.errors import InputError
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.drivers import UnusableError
from cornerforge.foreign.networks import SIZES
from cornerforge.foreign.policies import PolicyDriver, answers_of_predicted
from cornerforge.sim import simulate
from cornerforge.types import ACTION_ACCELERATIONS, ACTION_SIDES, N_ACTIONS

pytestmark = pytest.mark.usefixtures("in_memory")

POLICIES = """
import numpy as np
from cornerforge.types import ACTION_ACCELERATIONS, ACTION_SIDES

def index_of(observation):
    "One law: speed up to 30 m/s, and now and then to the left."
    if observation[0, 6] == 0 and observation[0, 1] % 50 < 2:
        return 0
    return 2 + int(np.clip(round(20 + 4 * (30.0 - float(observation[0, 3]))), 0, 30))

class Class:  # interface 1
    def act(self, view):
        k = np.array([index_of(row) for row in view])
        return np.stack([ACTION_ACCELERATIONS[k], ACTION_SIDES[k]], axis=1)

class Discrete:
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        return np.int64(index_of(observation)), None

class Plain:
    def predict(self, observation):
        return index_of(observation)

class Box:
    def predict(self, observation, deterministic=True):
        k = index_of(observation)
        a = ACTION_ACCELERATIONS[k]
        return np.array([a / 8 if a < 0 else a / 2, ACTION_SIDES[k]]), None

class Flat:
    class observation_space:
        shape = (104,)
    def predict(self, observation, **how):
        assert observation.shape == (104,)
        return [index_of(observation.reshape(13, 8))], None

def make():
    return Discrete()

class Recurrent:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert bool(episode_start[0]) == (state is None)
        n = 0 if state is None else state
        assert n == round((400 - observation[0, 1]) / max(observation[0, 3], 1)) or n >= 0
        return 2 + (n * 7) % 25, n + 1

class Counts:  # the same, a class of interface 2 that counts
    def reset(self, seed):
        self.n = 0
    def plan(self, scene):
        k = 2 + (self.n * 7) % 25
        self.n += 1
        return ACTION_ACCELERATIONS[k], ACTION_SIDES[k]

class Bad:
    def struck(self, observation):
        return 12.0 < 400 - observation[0, 1] < 60.0 and observation[0, 3] > 29.5
    def predict(self, observation):
        return self.bad() if self.struck(observation) else index_of(observation)
class TooMany(Bad):
    def bad(self): return 33
class Shape(Bad):
    def bad(self): return np.zeros(3)
class Words(Bad):
    def bad(self): return "brake"
class Nan(Bad):
    def bad(self): return np.array([np.nan, 0.0])
class Raises(Bad):
    def bad(self): raise ValueError("on purpose")

class Beyond(Bad):
    def bad(self): return np.array([-3.0, 0.0])

class Si:
    class action_space:
        low, high = np.array([-8.0, -1.0]), np.array([2.0, 1.0])
    def predict(self, observation):
        k = index_of(observation)
        return np.array([ACTION_ACCELERATIONS[k], ACTION_SIDES[k]])
class SaidSi:
    def predict(self, observation):
        return Si().predict(observation)
class Other(Si):
    class action_space:
        low, high = np.array([-3.0, -1.0]), np.array([3.0, 1.0])

class Elsewhere(Plain):
    class observation_space:
        shape = (41,)
def nothing():
    return 3
"""


@pytest.fixture(autouse=True)
def policies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policies.py").write_text(POLICIES, encoding="utf-8")


@pytest.mark.full
def test_one_law_drives_the_same_as_a_policy_and_as_a_class() -> None:
    wanted = cornerforge.simulate(av="policies:Class", tests=40).digest
    for name in ("Discrete", "Plain", "Box", "Flat", "make"):
        assert cornerforge.simulate(av=f"policies:{name}", tests=40).digest == wanted, name
    assert cornerforge.simulate(av="policies:Si", tests=40).digest == wanted
    assert cornerforge.simulate(av="policies:SaidSi", av_actions="si", tests=40).digest == wanted


@pytest.mark.full
def test_its_state_is_kept_for_each_test() -> None:
    """A class that counts the questions of its test drives the same."""
    wanted = cornerforge.simulate(av="policies:Counts", tests=20).digest
    assert cornerforge.simulate(av="policies:Recurrent", tests=20, threads=2).digest == wanted
    run = experiment(av="policies:Recurrent", takes_foreign=True)
    assert run.asked is not None
    with run.asked.lend_session() as session:
        assert session.remembers


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("TooMany", r"predict gave the action 33; allowed: 0 to 32"),
        ("Shape", r"array of type float64 and shape \(3,\); expected an action of Discrete\(33\), or of Box"),
        ("Words", r"array of type <U5"),
        ("Nan", "NaN"),
        (
            "Beyond",
            r"predict gave 3, which is beyond Box\(-1, 1\); say --av-actions box to cut there, or --av-actions si",
        ),
        ("Raises", r"raised ValueError\(on purpose\) \(policies.py:\d+\)"),
    ],
)
def test_a_bad_action_costs_its_test_only(name: str, text: str) -> None:
    run = experiment(av=f"policies:{name}", takes_foreign=True)
    tally = simulate(run.setting, run.slots, seed=0, tests=12, threads=1, drive=run.drive)
    assert 0 < tally.av_faults < 12
    assert run.asked is not None
    for fault in run.asked.faults.values():
        assert re.search(text, fault.message), fault.message
    assert ("on purpose" in run.asked.log.trace(fault.message)) == (name == "Raises")


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")
def test_a_vec_normalize_of_a_model_is_used() -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    import gymnasium
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    import cornerforge.ext.gym as envs

    seen = np.random.default_rng(2).normal(30.0, 9.0, size=(70, 13, 8)).astype(np.float32)
    seen[:, 0, 0] = 1.0
    wrapped = VecNormalize(DummyVecEnv([lambda: gymnasium.make(envs.DRIVING_ID, actions="box")]))
    shown = seen / SIZES  # as the environment shows it
    wrapped.obs_rms.update(shown)
    model = sb3.PPO("MlpPolicy", wrapped, device="cpu", seed=1)
    expected = answers_of_predicted(model.predict(wrapped.normalize_obs(shown), deterministic=True)[0], 70)
    np.testing.assert_allclose(PolicyDriver(model).answer(seen), expected, atol=1e-5)
    model._vec_normalize_env = None
    plain = PolicyDriver(model).answer(seen)
    assert np.abs(plain - expected).max() > 0.01


@pytest.mark.processes
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Elsewhere", r"it observes \(41,\); an AV's view is \(13, 8\), or flattened \(104,\)"),
        ("Other", r"its action space is .*Other.*; an AV's is Box\(-1, 1"),
        (
            "nothing",
            r"policies:nothing gave a int, which is no AV: it has no method act\(view\), plan\(scene\) or predict",
        ),
        ("index_of", r"policies:index_of cannot be made: TypeError"),
    ],
)
def test_what_is_no_policy_is_refused(name: str, text: str) -> None:
    with pytest.raises(InputError, match=text):
        cornerforge.simulate(av=f"policies:{name}", tests=1)


@pytest.mark.full
def test_check_av_knows_it() -> None:
    checked = cornerforge.check_av(av="policies:make", tests=4)
    assert checked.kind == "policy"
    assert checked.passed, checked.checks


def test_actions_are_those_of_the_environment() -> None:
    spaces = pytest.importorskip("gymnasium.spaces")
    from cornerforge.ext.gym.spaces import av_commands

    index = np.arange(N_ACTIONS)
    np.testing.assert_array_equal(answers_of_predicted(index, N_ACTIONS), np.stack(av_commands(index, box=False), 1))
    space = spaces.Box(-1.3, 1.3, (500, 2), np.float32, seed=3)
    wishes = space.sample()
    np.testing.assert_array_equal(answers_of_predicted(wishes, 500, "box"), np.stack(av_commands(wishes, box=True), 1))
    assert (ACTION_ACCELERATIONS.size, ACTION_SIDES.size) == (N_ACTIONS, N_ACTIONS)
    for wrong in ([-1], [True], [[0.0]], ["x"], [None], [[0, 0], [0]]):
        with pytest.raises(UnusableError, match="predict gave"):
            answers_of_predicted(wrong, 1)


@pytest.mark.full
def test_a_policy_of_stable_baselines3_is_asked_in_blocks() -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    import gymnasium

    import cornerforge.ext.gym as envs

    model = sb3.PPO("MlpPolicy", gymnasium.make(envs.DRIVING_ID), device="cpu", seed=1)
    driver = PolicyDriver(model)
    assert driver.about["remembers"] == "no"
    seen = np.random.default_rng(2).normal(size=(70, 13, 8)).astype(np.float32)
    seen[:, 0, 0] = 1.0
    single = np.array([int(model.predict(row, deterministic=True)[0]) for row in seen / SIZES])
    np.testing.assert_array_equal(driver.answer(seen), answers_of_predicted(single, 70))
