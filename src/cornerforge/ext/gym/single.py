"""`cornerforge/Adversary-v0` and `cornerforge/Driving-v0` as single environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from cornerforge._options import made_of
from cornerforge.ext.gym.batch import OUTCOMES, Batch, adversary_batch, check_render_mode, check_seed, driving_batch, read_options
from cornerforge.ext.gym.options import Adversary, Driving
from cornerforge.ext.gym.spaces import (
    ResetNeededError,
    adversary_observations,
    checked,
    driving_actions,
    driving_observations,
    one_of_33,
)

__all__ = ["AdversaryEnv", "DrivingEnv"]

_ONE = np.ones(1, dtype=np.bool_)


class _SingleEnv(gymnasium.Env[Any, Any]):
    """A batch of one world as a Gymnasium environment."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012  Gymnasium's own form
    _batch: Batch

    def _finish(self, render_mode: str | None, fps: int) -> None:
        if render_mode is not None:
            check_render_mode(render_mode, self._batch)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": fps}

    def _info(self, *, stepped: bool) -> dict[str, Any]:
        batch = self._batch
        info: dict[str, Any] = {"seed": int(batch.seeds[0]), "test": int(batch.tests[0])}
        arrays = batch.extra() | (batch.acted() if stepped else {})
        info |= {name: value[0] if value.ndim > 1 else value[0].item() for name, value in arrays.items()}
        if stepped and batch.is_over[0]:
            info |= {
                "outcome": OUTCOMES[int(batch.outcome[0])],
                "case": batch.case(0),
                "time_s": float(batch.time()[0]),
            }
        return info

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a test.

        Args:
            seed: Seed of the random numbers of this test and the following ones. None: the seed given before; one drawn
                from the operating system's randomness if there was none.
            options: {"test": k} begins test k of the seed, else the test after the last one; the first after a seed is
                `batch.FIRST_TEST`.

        Returns:
            Observation, and info with `seed` and `test`, which together name the test.

        Raises:
            ClosedError: The environment is closed.
            InputError: Seed or test is out of range, or there is no BV to control.
            UnknownNameError: An option is not known.
        """
        batch = self._batch
        batch.check_open()
        wanted = read_options(options, ("test",))
        if seed is not None:
            seed = check_seed(seed)
        super().reset(seed=seed)
        batch.name(0, seed, wanted.get("test"), lambda: int(self.np_random.integers(2**31)))
        batch.begin(_ONE)
        return batch.observation[0].copy(), self._info(stepped=False)

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One decision; observation, reward, terminated, truncated and info (docs/gymnasium.md).

        Raises:
            ClosedError: The environment is closed.
            ResetNeededError: No test runs: none has begun, or it has ended.
            InvalidActionError: The action is not one of the action space.
        """
        batch = self._batch
        batch.check_begun()
        if batch.is_over[0]:
            raise ResetNeededError("The test has ended; call reset() first.")
        batch.step(checked("action", action, self.action_space)[None], _ONE)
        over, cut = bool(batch.is_over[0]), bool(batch.truncated[0])
        observation = batch.observation[0].copy()
        return observation, float(batch.reward[0]), over and not cut, over and cut, self._info(stepped=True)

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the road around the AV from above, uint8 (height, width, 3); None without render_mode "rgb_array".

        Raises:
            ClosedError: The environment is closed.
            ResetNeededError: No test has begun.
        """
        pictures = self._batch.pictures(self.render_mode)
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Release the environment's threads and memory; a second call does nothing."""
        self._batch.close()


class AdversaryEnv(_SingleEnv):
    """The agent drives, second by second, the background vehicle that is nearest to the AV (paper, equations 5 to 9).

    Observation: float32 (41,), `sim.observe.observe`. Action: one of 33, see `info["action_mask"]`.

    Args:
        options: Those of `options.Adversary`, by name; with `bounded` the mask forbids what the naturalistic model
            calls impossible (paper, equation 12).

    Raises:
        CornerForgeError: A name, number or file is not right.
        TypeError: The option is unknown.
    """

    @made_of(Adversary)
    def __init__(self, options: Adversary) -> None:
        self._batch = self._worlds = adversary_batch(1, 1, options.world(), reward=options.reward, delay=options.delay)
        self.observation_space = adversary_observations(self._batch.run.odd)
        self.action_space = one_of_33()
        self._finish(options.render_mode, 1)

    def action_masks(self) -> NDArray[np.bool_]:
        """Give the actions that are allowed now, bool (33,); learners with masks look for this name.

        Raises:
            ClosedError: The environment is closed.
            ResetNeededError: No test has begun.
        """
        self._batch.check_begun()
        return np.asarray(self._worlds.allowed[0].copy())


class DrivingEnv(_SingleEnv):
    """The agent is the AV.

    Observation: float32 (13, 8), `sim.av_view`, over usual sizes (`networks.SIZES`) or in SI units; at a site float32
    (380,), `spaces.flat_scene`. Reward: the share of the test's length that it drove in this step, minus 1 for a crash.

    Args:
        options: Those of `options.Driving`, by name; `bounded` is for plain adversaries, a policy file says it itself.

    Raises:
        CornerForgeError: A name, number or file is not right.
        TypeError: The option is unknown.
    """

    @made_of(Driving)
    def __init__(self, options: Driving) -> None:
        self.action_space = driving_actions(options.actions, at_site=options.site is not None)
        self._batch = driving_batch(
            1, 1, options.world(), bv=options.bv, box=options.actions == "box", act_every=options.act_every,
            scaled=options.scaled,
        )  # fmt: skip
        self.observation_space = driving_observations(self._batch.run.odd, scaled=options.scaled)
        self._finish(options.render_mode, round(10 / self._batch.run.odd.av_substeps))
