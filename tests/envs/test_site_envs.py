"""The environments at a site: what agents see and may do there, single and vector, and what is refused."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import cornerforge.envs  # noqa: F401 - registers them
from cornerforge.errors import InputError
from cornerforge.ext.gym.spaces import N_SITE, SITE_SIZES

DRIVING, ADVERSARY = "cornerforge/Driving-v0", "cornerforge/Adversary-v0"


def made(name: str, **options: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(name, site="mcity-signal", **options)


def test_the_agent_drives_its_route_and_sees_itself_do_it() -> None:
    """Speeds follow from actions, the way left shrinks by the metres driven, and a whole route pays 1."""
    env = made(DRIVING, scaled=False)
    assert env.observation_space.shape == (N_SITE,) == (380,)
    assert env.action_space.n == 31  # type: ignore[attr-defined]
    paid, ends = [], set()
    for test in range(4):
        seen, _ = env.reset(seed=4, options={"test": test})
        total, over = 0.0, False
        while not over:
            before = seen.reshape(38, 10)
            assert env.observation_space.contains(seen)
            speed = before[0, 7]
            action = 20 + min(10, max(-20, round(5.0 * float(before[2, 3] - speed))))
            seen, reward, done, cut, info = env.step(action)
            now = seen.reshape(38, 10)
            assert abs(before[1, 4] - now[1, 4] - info["metres"]) < 1e-3
            total, over = total + float(reward), done or cut
        ends.add(info["outcome"])
        if info["outcome"] == "completed":
            paid.append(total)
    assert "completed" in ends
    assert all(1.0 <= one < 1.05 for one in paid)


def test_scaled_is_the_same_over_sizes_and_a_box_brakes_as_it_says() -> None:
    plain, scaled = made(DRIVING, scaled=False), made(DRIVING, actions="box")
    a, _ = plain.reset(seed=2)
    b, _ = scaled.reset(seed=2)
    for _ in range(10):
        np.testing.assert_array_equal((a.reshape(38, 10) / SITE_SIZES).ravel(), b)
        a, *_ = plain.step(10)  # -2.0 m/s2
        b, *_ = scaled.step(np.array([-0.25], dtype=np.float32))
    assert a.reshape(38, 10)[1, 1] == pytest.approx(-2.0, abs=1e-6)


def test_many_worlds_do_what_each_does_alone() -> None:
    many = gymnasium.make_vec(DRIVING, num_envs=3, site="mcity-signal", threads=2)
    seen, _ = many.reset(seed=6)
    alone = [made(DRIVING) for _ in range(3)]
    for b, env in enumerate(alone):
        np.testing.assert_array_equal(env.reset(seed=6 + b)[0], seen[b])
    for k in range(25):
        seen, paid, *_ = many.step(np.full(3, 15 + k % 10))
        for b, env in enumerate(alone):
            own, reward, *_ = env.step(15 + k % 10)
            np.testing.assert_array_equal(own, seen[b])
            assert reward == paid[b]


@pytest.mark.full
def test_the_adversary_sees_within_its_bounds_and_acts_as_the_mask_says() -> None:
    env = made(ADVERSARY, av="creep")
    ends = set()
    for test in range(12):
        seen, info = env.reset(seed=1, options={"test": test})
        over = False
        while not over:
            assert env.observation_space.contains(seen)
            action = env.action_space.sample(mask=info["action_mask"])
            seen, _, done, cut, info = env.step(action)
            assert info["action"] == action
            over = done or cut
        ends.add(info["outcome"])
    assert len(ends) > 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"render_mode": "rgb_array"}, "draws roads only"),
        ({"lanes": 3}, "lanes is for roads"),
        ({"bv": "swerve"}, "drives on roads only"),
        ({"actions": "steering"}, "is not known"),
    ],
)
def test_what_makes_no_sense_at_a_site_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        made(DRIVING, **options)
