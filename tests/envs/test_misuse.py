"""What environments say to misuse: one sentence, in an error that clients of Gymnasium and of cornerforge catch."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import data_equivalence

from cornerforge.errors import CornerForgeError, InputError
from cornerforge.ext.gym import ADVERSARY_ID, DRIVING_ID
from cornerforge.ext.gym.single import AdversaryEnv, DrivingEnv
from cornerforge.ext.gym.vector import AdversaryVectorEnv, DrivingVectorEnv

MAKERS: dict[str, Callable[..., Any]] = {
    "adversary": AdversaryEnv,
    "driving": DrivingEnv,
    "adversary, made": lambda **own: gymnasium.make(ADVERSARY_ID, **own),
    "driving, made": lambda **own: gymnasium.make(DRIVING_ID, **own),
}
MANY: dict[str, Callable[..., Any]] = {
    "adversaries": lambda **own: AdversaryVectorEnv(3, **own),
    "driving ones": lambda **own: DrivingVectorEnv(3, **own),
    "adversaries, made": lambda **own: gymnasium.make_vec(ADVERSARY_ID, num_envs=3, **own),
}
ALL = MAKERS | MANY
ACTION = {name: [2, 2, 2] if name in MANY else 2 for name in ALL}
"""Full braking."""


def said(kind: type[BaseException], call: Callable[[], Any]) -> str:
    """What an error says; it is of Gymnasium's kind and of ours."""
    with pytest.raises(kind) as caught:
        call()
    assert isinstance(caught.value, CornerForgeError)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_before_reset_there_is_nothing() -> None:
    """A wrapper of `make` answers first, with an error of Gymnasium's that is not ours."""
    for name, make in ALL.items():
        env = make(render_mode="rgb_array").unwrapped
        calls = [lambda: env.step(ACTION[name]), env.render, getattr(env, "action_masks", env.render)]  # noqa: B023
        for call in calls:
            assert said(ResetNeeded, call) == "No test has begun; call reset() first."


@pytest.mark.full
def test_after_the_end_only_a_picture_is_left() -> None:
    for name, make in MAKERS.items():
        env = make(render_mode="rgb_array")
        env.reset(seed=0)
        while not any(env.step(ACTION[name])[2:4]):
            pass
        assert said(ResetNeeded, lambda: env.step(2)) == "The test has ended; call reset() first."  # noqa: B023
        assert env.render().shape[2] == 3
        env.reset()
        env.step(2)


def test_without_autoreset_an_ended_world_is_not_stepped() -> None:
    env: Any = AdversaryVectorEnv(3, autoreset_mode="Disabled")
    env.reset(seed=0)
    while True:
        ended = np.logical_or(*env.step([2, 2, 2])[2:4])
        if ended.any():
            break
    assert "have no running test; call reset() first." in said(ResetNeeded, lambda: env.step([2, 2, 2]))


def test_after_a_mask_worlds_that_never_began_are_not_stepped() -> None:
    env: Any = AdversaryVectorEnv(3, render_mode="rgb_array")
    env.reset(seed=0, options={"reset_mask": np.array([True, False, False])})
    for call in (lambda: env.step([2, 2, 2]), env.render, env.action_masks):
        said(ResetNeeded, call)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("begun", [True, False])
@pytest.mark.parametrize("name", ALL)
def test_after_close_there_is_nothing(name: str, begun: bool) -> None:
    env = ALL[name](render_mode="rgb_array")
    if begun:
        env.reset(seed=0)
    env.close()
    env.close()
    env = env.unwrapped
    for call in (lambda: env.step(ACTION[name]), env.reset, lambda: env.reset(seed=1), env.render):
        assert said(ClosedEnvironmentError, call) == "The environment is closed; make another one."
    if hasattr(env, "action_masks"):
        said(ClosedEnvironmentError, env.action_masks)


ODD_VALUES: list[Any] = [
    None, "x", "", b"x", 2.7, 1.0, np.nan, np.inf, -1, 33, 10**30, True, object(), [1], [[1], [1, 2]], {}, 1j,
    np.float32(3), np.zeros((2, 2)), "\udcff", len,
]  # fmt: skip


@pytest.mark.parametrize("name", MAKERS)
def test_an_action_is_one_of_33(name: str) -> None:
    env = MAKERS[name]()
    env.reset(seed=0)
    for value in ODD_VALUES:
        assert "give a whole number from 0 to 32." in said(InvalidAction, lambda: env.step(value))  # noqa: B023
    for value in (0, 32, np.uint8(2), np.array(2)):
        env.step(value)


@pytest.mark.parametrize("made", [False, True])
def test_an_action_is_two_finite_numbers(made: bool) -> None:
    env: Any = gymnasium.make(DRIVING_ID, actions="box") if made else DrivingEnv(actions="box")
    env.reset(seed=0)
    wrong = [[0.0, np.nan], [np.inf, 0.0], [0.0], [0.0] * 3, ["a", "b"], [True, False], [0j, 0j], [None, None]]
    for value in ODD_VALUES + wrong:
        assert "finite numbers from -1 to 1." in said(InvalidAction, lambda: env.step(value))  # noqa: B023
    for value in ([0, 1], (0.0, 0.0), np.zeros(2), np.array([1e9, -1e9], np.float32)):
        env.step(value)


@pytest.mark.parametrize("name", MANY)
def test_actions_are_one_for_each_world(name: str) -> None:
    env = MANY[name]()
    env.reset(seed=0)
    wrong = [[0, 0], [0, 33, 0], [0, -1, 0], [0.0, 0.0, 0.0], [True] * 3, [[0], [0], [0]], [None] * 3, ["a"] * 3]
    for value in [*ODD_VALUES, *wrong, [10**30] * 3, [[0], [1, 2], 0], 2]:
        assert said(InvalidAction, lambda: env.step(value)).startswith("actions = ")  # noqa: B023
    for value in ([0, 1, 2], (0, 1, 2), np.zeros(3, np.uint8)):
        env.step(value)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("argument", ["seed", "test", "options", "reset_mask"])
def test_what_reset_takes(name: str, argument: str) -> None:
    env = ALL[name]()
    right: list[Any] = {"seed": [None, 33], "test": [None, 33], "options": [None, {}], "reset_mask": []}[argument]  # type: ignore[assignment]
    if name not in MANY and argument == "reset_mask":
        return
    for value in [*ODD_VALUES, [2.7] * 3, [[1]] * 3, ["a"] * 3]:
        given = {argument: value} if argument in ("seed", "options") else {"options": {argument: value}}
        if any(value is one or (isinstance(value, (int, dict)) and value == one) for one in right):
            env.reset(**given)
        else:
            assert argument in said(InputError, lambda: env.reset(**given))  # noqa: B023
    if argument != "options" and argument != "reset_mask":
        for number in (np.int64(3), np.uint8(3)):
            given = {"seed": number} if argument == "seed" else {"options": {"test": number}}
            assert (np.ravel(env.reset(**given)[1][argument])[0]) == 3


@pytest.mark.parametrize("kind", [AdversaryEnv, DrivingEnv, AdversaryVectorEnv, DrivingVectorEnv])
def test_options_are_of_their_type(kind: Any) -> None:
    """What no option can be; which values of the right type are allowed stands elsewhere."""
    shared = ["odd", "lanes", "model", "bounded", "render_mode"]
    own = ["reward", "delay", "av", "av_timeout"] if "Adversary" in kind.__name__ else ["bv", "actions", "act_every"]
    for option in [*shared, *own, *(["num_envs", "threads", "autoreset_mode"] if "Vector" in kind.__name__ else [])]:
        for value in (object(), 1j, b"x", {}, [[1]], np.zeros((2, 2)), len, np.nan, -1):
            assert option in said(InputError, lambda: kind(**{option: value}))  # noqa: B023


def test_without_a_render_mode_a_warning_says_why_there_is_no_picture() -> None:
    for name in MAKERS | MANY:
        env = ALL[name]()
        env.reset(seed=0)
        with pytest.warns(UserWarning, match="no picture without a render mode"):
            assert env.unwrapped.render() is None


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", [*MAKERS, *MANY])
def test_a_copy_goes_its_own_way(name: str) -> None:
    """In the middle of a test: a copy does what the first one does, and neither disturbs the other."""
    env = ALL[name]()
    env.reset(seed=5)
    env.step(ACTION[name])
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        own = copy.deepcopy(env)
        one = [own.step(ACTION[name]) for _ in range(3)]
        assert data_equivalence(one, [other.step(ACTION[name]) for _ in range(3)], exact=True)


def test_threads_and_processes_cannot_be_copied() -> None:
    example = Path(__file__).parents[2] / "examples" / "my_av.py"
    for env in (AdversaryVectorEnv(2, threads=2), AdversaryEnv(av=f"{example}:MyAv")):
        for way in (copy.deepcopy, pickle.dumps):
            assert "cannot be copied; make another one." in said(InputError, lambda: way(env))  # noqa: B023
        env.close()


@pytest.mark.parametrize("name", ["adversary", "adversaries"])
def test_a_second_thread_is_kept_out_while_the_first_is_in_a_kernel(name: str) -> None:
    env = ALL[name]()
    env.reset(seed=0)
    for inside in ("_start", "_advance"):
        work, answers = getattr(env._batch, inside), list[str]()

        def meanwhile(*given: Any, work: Any = work, answers: list[str] = answers) -> None:
            before = env._batch.tests.copy()
            calls = (env.reset, lambda: env.step(ACTION[name]), env.render, env.action_masks)
            answers.extend(said(InputError, call) for call in calls)
            assert (env._batch.tests == before).all()
            work(*given)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(env._batch, inside, meanwhile)
            _ = env.reset(seed=0) if inside == "_start" else env.step(ACTION[name])
        assert answers == ["Another thread is using this environment now; give each thread one of its own."] * 4
    env.step(ACTION[name])
