"""What Gymnasium and its clients expect: its checker, seeds, options, vector environments, messages."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from cornerforge.errors import InputError, UnknownNameError
from cornerforge.ext.gym import ADVERSARY_ID, DRIVING_ID
from cornerforge.ext.gym.batch import FIRST_TEST
from cornerforge.ext.gym.single import AdversaryEnv, DrivingEnv
from cornerforge.ext.gym.vector import AdversaryVectorEnv, DrivingVectorEnv

KINDS: list[tuple[str, dict[str, Any]]] = [
    (ADVERSARY_ID, {}),
    (ADVERSARY_ID, {"bounded": True, "odd": "swift", "lanes": 2, "av": "idm-mobil-blind"}),
    (DRIVING_ID, {}),
    (DRIVING_ID, {"actions": "box", "act_every": 5, "bv": "swerve"}),
]
ON_RAMP: dict[str, Any] = {"road": "on-ramp", "task": "ramp"}


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("name", "options"), KINDS)
def test_gymnasiums_checker_has_no_complaint(name: str, options: dict[str, Any]) -> None:
    """Warnings are errors here."""
    env = gymnasium.make(name, **options)
    check_env(env.unwrapped)
    env.close()


@pytest.mark.sampled(1)
def test_an_agent_is_told_where_lanes_end() -> None:
    """On the ramp, 150 m before it meets the road: its own lane ends after 400 m, and there the drive too."""
    env: Any = gymnasium.make(DRIVING_ID, **ON_RAMP)
    check_env(env.unwrapped)
    _, info = env.reset(seed=2)
    assert info["lane_ends_in"].tolist() == [400.0, np.inf, np.inf, np.inf]
    metres, over = 0.0, False
    while not over:
        _, _, over, _, info = env.step(22)
        metres += info["metres"]
        left = info["lane_ends_in"][0]
        assert over or left == pytest.approx(400.0 - metres, abs=1e-2)
    assert (info["outcome"], left) == ("left-road", 0.0)
    env.close()
    worlds: Any = gymnasium.make_vec(DRIVING_ID, num_envs=3, **ON_RAMP)
    assert worlds.reset(seed=2)[1]["lane_ends_in"].shape == (3, 4)
    worlds.close()
    assert "lane_ends_in" not in gymnasium.make(DRIVING_ID).reset(seed=1)[1]


@pytest.mark.parametrize(("name", "options"), KINDS)
@pytest.mark.parametrize("odd", ["default", "paper"])
def test_what_is_seen_lies_in_the_space(name: str, options: dict[str, Any], odd: str, seed: int) -> None:
    """Actions that hardly make sense: lane changes begun and broken off all the time, full braking, full speed."""
    env: Any = gymnasium.make_vec(name, num_envs=16, **(options | {"odd": odd, "lanes": 6}))
    space = env.single_observation_space
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    ended = 0
    for _ in range(60):
        if "actions" in options:
            actions = rng.choice([-1.0, 0.0, 1.0], size=(16, 2)).astype(np.float32)
        else:
            actions = rng.choice([0, 1, 2, 32], size=16)
        seen, _, terminated, truncated, _ = env.step(actions)
        assert ((seen >= space.low) & (seen <= space.high)).all()
        ended += int((terminated | truncated).sum())
    assert ended > 0 or name == DRIVING_ID


# --- names of tests ---


def episode(env: Any, actions: np.random.Generator, **reset: Any) -> list[Any]:
    """Everything that a test shows under random actions."""
    observation, info = env.reset(**reset)
    told: list[Any] = [(observation, info)]
    while True:
        told.append(env.step(actions.integers(33)))
        if told[-1][2] or told[-1][3]:
            return told


@pytest.mark.parametrize("kind", [AdversaryEnv, DrivingEnv])
def test_seed_and_test_name_what_happens(kind: Any) -> None:
    env, other = kind(), kind()
    first = episode(env, np.random.default_rng(0), seed=7)
    second = episode(env, np.random.default_rng(1))
    assert first[0][1]["seed"] == second[0][1]["seed"] == 7
    assert (first[0][1]["test"], second[0][1]["test"]) == (FIRST_TEST, FIRST_TEST + 1)
    assert second[-1][4]["case"] == f"7:{FIRST_TEST + 1}"
    assert not data_equivalence(first, second)
    again = episode(other, np.random.default_rng(1), seed=7, options={"test": FIRST_TEST + 1})
    assert data_equivalence(second, again, exact=True)
    assert data_equivalence(first, episode(other, np.random.default_rng(0), seed=7), exact=True)
    assert other.reset(options={"test": 5})[1] | {"action_mask": 0} == other.reset(seed=7, options={"test": 5})[1] | {
        "action_mask": 0
    }


def test_without_a_seed_one_is_drawn() -> None:
    assert DrivingEnv().reset()[1]["seed"] != DrivingEnv().reset()[1]["seed"]
    env = DrivingVectorEnv(3)
    seeds = env.reset()[1]["seed"]
    np.testing.assert_array_equal(seeds, seeds[0] + np.arange(3))


class _LaneChanges(np.random.Generator):
    """Draws lane changes only: about one test in ten ends in a crash of the AV (0.0999 of 8,192 tests)."""

    def integers(self, *_: Any, **__: Any) -> Any:
        return super().integers(2)


def test_the_end_says_what_happened_and_when() -> None:
    """Sixty tests without a crash of the AV would be a chance of 0.002, and the seed is fixed."""
    env = AdversaryEnv()
    outcomes = set()
    rng = _LaneChanges(np.random.PCG64(2))
    for index in range(60):
        last = episode(env, rng, seed=0, options={"test": FIRST_TEST + index})[-1]
        info = last[4]
        outcomes.add(info["outcome"])
        assert last[1] == {"av-crash": 1.0, "bv-crash": -1.0}.get(info["outcome"], 0.0)
        assert 0.0 < info["time_s"] < 60.0
        assert (last[2], last[3]) == (True, False)
    assert {"completed", "av-crash"} <= outcomes


# --- masks ---


def test_what_the_mask_forbids_is_never_done() -> None:
    env = AdversaryEnv(bounded=True)
    _, info = env.reset(seed=1)
    rng = np.random.default_rng(0)
    replaced = forbidding = 0
    for _ in range(300):
        mask = env.action_masks()
        np.testing.assert_array_equal(mask, info["action_mask"])
        assert mask[env.action_space.sample(mask=info["action_mask"])]
        assert mask.any()
        forbidding += not mask.all()
        wished = int(rng.integers(33))
        _, _, terminated, truncated, info = env.step(wished)
        assert mask[info["action"]]
        assert info["action"] == wished or not mask[wished]
        replaced += info["action"] != wished
        if terminated or truncated:
            _, info = env.reset()
    assert replaced > 20
    assert forbidding > 250  # between free lanes, with nobody near, nothing is impossible


# --- vector environments ---


def batches(name: str, options: dict[str, Any], n: int, mode: AutoresetMode, **own: Any) -> tuple[Any, Any]:
    native = gymnasium.make_vec(name, num_envs=n, autoreset_mode=mode, **own, **options)
    singles = [lambda: gymnasium.make(name, **options).unwrapped for _ in range(n)]
    return native, SyncVectorEnv(singles, autoreset_mode=mode)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize(("name", "options"), KINDS)
def test_many_worlds_at_once_are_the_single_ones(name: str, options: dict[str, Any], mode: AutoresetMode) -> None:
    """Observations, rewards, ends and infos, all to the bit, with threads."""
    n = 5
    options = options | ({"act_every": 10} if name == DRIVING_ID else {})
    native, reference = batches(name, options, n, mode, threads=3)
    native.action_space.seed(0)
    assert native.observation_space == reference.observation_space
    assert native.action_space == reference.action_space
    assert native.metadata["autoreset_mode"] == mode
    assert data_equivalence(native.reset(seed=11), reference.reset(seed=11), exact=True)
    ended = 0
    for _ in range(80):
        actions = native.action_space.sample()
        ours, theirs = native.step(actions), reference.step(actions)
        assert data_equivalence(ours[:4], theirs[:4], exact=True)
        assert same_info(ours[4], theirs[4], mode)
        ended += int((ours[2] | ours[3]).sum())
    assert ended > 2 * n
    assert data_equivalence(native.reset(options={"test": 4}), reference.reset(options={"test": 4}), exact=True)
    native.close()
    reference.close()


def same_info(ours: dict[str, Any], theirs: dict[str, Any], mode: AutoresetMode) -> bool:
    """Gymnasium leaves a key out of `final_obs` where nobody has it, and so do we."""
    assert mode == AutoresetMode.SAME_STEP or "final_obs" not in ours
    assert ours.keys() == theirs.keys(), ours.keys() ^ theirs.keys()
    return all(
        same_info(ours[key], theirs[key], mode)
        if key == "final_info"
        else data_equivalence(ours[key].tolist(), theirs[key].tolist(), exact=True)
        if ours[key].dtype != object
        else all(data_equivalence(a, b, exact=True) for a, b in zip(ours[key], theirs[key], strict=True))
        for key in ours
    )


def test_without_autoreset_a_mask_says_who_begins_anew() -> None:
    native, reference = batches(ADVERSARY_ID, {}, 4, AutoresetMode.DISABLED)
    native.action_space.seed(0)
    native.reset(seed=0)
    reference.reset(seed=0)
    resets = 0
    for _ in range(40):
        actions = native.action_space.sample()
        ours, theirs = native.step(actions), reference.step(actions)
        assert data_equivalence(ours[:4], theirs[:4], exact=True)
        over = ours[2] | ours[3]
        if over.any():
            resets += 1
            with pytest.raises(InputError, match="call reset"):
                native.step(actions)
            a = native.reset(options={"reset_mask": over})
            b = reference.reset(options={"reset_mask": over.copy()})
            np.testing.assert_array_equal(a[0], b[0])
            assert same_info(a[1], b[1], AutoresetMode.DISABLED)
    assert resets > 3


def test_threads_change_nothing_and_gymnasiums_statistics_work() -> None:
    told = []
    for threads in (1, 4, None):
        env = RecordEpisodeStatistics(AdversaryVectorEnv(200, threads=threads))
        env.action_space.seed(3)
        steps: list[Any] = [env.reset(seed=5)]
        steps += [env.step(env.action_space.sample())[:4] for _ in range(20)]
        told.append(steps)
        assert len(env.return_queue) > 50
        assert {float(r) for r in env.return_queue} <= {-1.0, 0.0, 1.0}
        env.close()
    assert data_equivalence(told[0], told[1], exact=True)
    assert data_equivalence(told[0], told[2], exact=True)


def test_each_world_may_be_told_its_own_seed_and_test() -> None:
    env = AdversaryVectorEnv(3)
    seen, info = env.reset(seed=[4, 4, 9], options={"test": [1, 2, 1]})
    np.testing.assert_array_equal(info["seed"], [4, 4, 9])
    np.testing.assert_array_equal(info["test"], [1, 2, 1])
    single = AdversaryEnv()
    for b, (own_seed, test) in enumerate([(4, 1), (4, 2), (9, 1)]):
        np.testing.assert_array_equal(seen[b], single.reset(seed=own_seed, options={"test": test})[0])


# --- pictures ---


def test_a_picture_shows_who_is_where() -> None:
    env: Any = gymnasium.make(ADVERSARY_ID, render_mode="rgb_array").unwrapped
    env.reset(seed=3)
    picture, top = env.render(), 3 * 3.66 + 2.0
    assert picture.shape == (90, 900, 3)
    assert picture.dtype == np.uint8
    vehicles, state = env._batch.worlds.vehicles[0], env._batch.worlds.state[0, 0]
    blue, red = (70, 140, 255), (230, 70, 60)
    row = round((top - vehicles["y"][0]) * 6)
    assert tuple(picture[row, 300]) == blue, "the AV's centre is 50 m from the left edge"
    controlled = vehicles[state["controlled"]]
    column = round((controlled["x"] - vehicles["x"][0] + 50.0) * 6)
    assert tuple(picture[round((top - controlled["y"]) * 6), column]) == red
    area = (picture == blue).all(axis=2).sum() / 36.0
    assert area == pytest.approx(5.0 * 2.0 - 0.15 * 5.0 * 0.8 * 2.0, abs=0.7), "a car less its windscreen [m2]"
    many = DrivingVectorEnv(2, render_mode="rgb_array", lanes=2)
    many.reset(seed=0)
    frames = many.render()
    assert frames is not None
    assert [frame.shape for frame in frames] == [(68, 900, 3)] * 2


# --- mistakes ---


def call(make: Any, *steps: Any) -> None:
    env = make()
    for step in steps:
        step(env)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ([lambda: AdversaryEnv(av="idm-mobli")], 'Did you mean "idm-mobil"'),
        ([lambda: AdversaryEnv(reward="crush")], 'Did you mean "crash"'),
        ([lambda: DrivingEnv(actions="boxes")], '"discrete" or "box"'),
        ([lambda: DrivingEnv(act_every=3)], "one of 1, 2, 5 or 10"),
        ([lambda: DrivingEnv(bv="nde", bounded=True)], "bounded needs an adversary"),
        ([lambda: DrivingEnv(render_mode="human")], "rgb_array"),
        ([lambda: AdversaryVectorEnv(0)], "num_envs = 0"),
        ([lambda: AdversaryVectorEnv(2, threads=0)], "threads = 0"),
        ([lambda: AdversaryVectorEnv(2, autoreset_mode="sometimes")], '"NextStep", "SameStep", "Disabled"'),
        ([AdversaryEnv, lambda e: e.step(0)], "call reset"),
        ([AdversaryEnv, lambda e: e.reset(), lambda e: e.step(33)], "whole number from 0 to 32"),
        ([AdversaryEnv, lambda e: e.reset(), lambda e: e.step(1.0)], "whole number from 0 to 32"),
        ([lambda: DrivingEnv(actions="box"), lambda e: e.reset(), lambda e: e.step([0.0, np.nan])], "finite"),
        ([lambda: DrivingEnv(actions="box"), lambda e: e.reset(), lambda e: e.step([0.0])], "finite"),
        ([AdversaryEnv, lambda e: e.reset(seed=-1)], "seed = -1"),
        ([AdversaryEnv, lambda e: e.reset(seed=2**63)], "seed = 9223372036854775808"),
        ([AdversaryEnv, lambda e: e.reset(options={"test": -2})], "test = -2"),
        ([AdversaryEnv, lambda e: e.reset(options={"tset": 2})], 'Did you mean "test"'),
        ([lambda: AdversaryVectorEnv(2), lambda e: e.step(np.zeros(2, int))], "call reset"),
        ([lambda: AdversaryVectorEnv(2), lambda e: e.reset(), lambda e: e.step([0])], "give 2 whole numbers"),
        ([lambda: AdversaryVectorEnv(2), lambda e: e.reset(), lambda e: e.step([0, 40])], "from 0 to 32"),
        ([lambda: AdversaryVectorEnv(2), lambda e: e.reset(seed=[1])], "seed has 1 entries for 2"),
        ([lambda: AdversaryVectorEnv(2), lambda e: e.reset(options={"test": [1]})], "test has 1 entries"),
        ([lambda: AdversaryVectorEnv(2), lambda e: e.reset(options={"reset_mask": [True, True, True]})], "reset_mask"),
    ],
)
def test_mistakes_are_named(steps: list[Any], message: str) -> None:
    with pytest.raises((InputError, UnknownNameError), match=message):
        call(*steps)


@pytest.mark.parametrize("option", ["lane", "budget", "av_timeout", "av"])
@pytest.mark.parametrize("kind", [AdversaryEnv, DrivingEnv, AdversaryVectorEnv, DrivingVectorEnv])
def test_an_option_of_another_world_is_refused(kind: Any, option: str) -> None:
    """In Python's words; the AV is an option where it is not the agent."""
    if option in {"av", "av_timeout"} and kind in (AdversaryEnv, AdversaryVectorEnv):
        assert kind(av="rl", av_timeout=3.0)._batch.run.av.name == "rl"
        return
    words = rf"^{kind.__name__}\.__init__\(\) got an unexpected keyword argument '{option}'"
    with pytest.raises(TypeError, match=words):
        kind(**{option: 3})
    name = ADVERSARY_ID if "Adversary" in kind.__name__ else DRIVING_ID
    make: Any = gymnasium.make_vec if "Vector" in kind.__name__ else gymnasium.make
    with pytest.raises(TypeError, match=words):
        make(name, **{option: 3})


# --- registration ---


@pytest.mark.full
def test_registering_is_light_and_repeatable(tmp_path: Path) -> None:
    code = (
        "import importlib, sys, gymnasium, cornerforge.ext.gym as e; importlib.reload(e)\n"
        "assert gymnasium.spec(e.ADVERSARY_ID).vector_entry_point\n"
        "print('numba' in sys.modules)\n"
        "env = gymnasium.make('cornerforge.ext.gym:cornerforge/Driving-v0'); env.reset(seed=1)\n"
        "print(env.step(22)[0].shape)"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": str(Path(__file__).parents[2] / "src"), "HOME": str(tmp_path), "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split("\n")[:2] == ["False", "(13, 8)"]
