"""`cornerforge/Adversary-v0` and `cornerforge/Driving-v0` as vector environments: many worlds, one compiled call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from cornerforge._options import made_of
from cornerforge._schema import is_several
from cornerforge._words import shown
from cornerforge.errors import InputError
from cornerforge.ext.gym.batch import (
    OUTCOMES,
    Batch,
    adversary_batch,
    check_render_mode,
    check_seed,
    driving_batch,
    read_options,
)
from cornerforge.ext.gym.options import AdversaryVector, DrivingVector
from cornerforge.ext.gym.spaces import (
    ResetNeededError,
    adversary_observations,
    checked,
    driving_actions,
    driving_observations,
    numbers_of,
    one_of_33,
)

__all__ = ["AdversaryVectorEnv", "DrivingVectorEnv"]

_Mask = NDArray[np.bool_]


class _BatchVectorEnv(VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """A batch of worlds as a Gymnasium vector environment, equal to `SyncVectorEnv` over single ones to the bit."""

    _batch: Batch

    def _finish(self, num_envs: int, autoreset_mode: AutoresetMode | str, render_mode: str | None, fps: int) -> None:
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError:
            allowed = ", ".join(f'"{mode.value}"' for mode in AutoresetMode)
            raise InputError(f"autoreset_mode = {autoreset_mode!r} is not known; allowed: {allowed}.") from None
        if render_mode is not None:
            check_render_mode(render_mode, self._batch)
        self.render_mode = render_mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": fps, "autoreset_mode": self._mode}
        self.num_envs = num_envs
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def _info(self, known: _Mask, stepped: _Mask) -> dict[str, Any]:
        """Give `info` of the chosen single environments, as arrays beside masks `_KEY` (Gymnasium's convention)."""
        batch = self._batch
        parts: list[tuple[str, NDArray[Any], _Mask]] = []
        if known.any():
            arrays = {"seed": batch.seeds, "test": batch.tests, **batch.extra()}
            parts += [(name, values, known) for name, values in arrays.items()]
        if stepped.any():
            parts += [(name, values, stepped) for name, values in batch.acted().items()]
        ended = stepped & batch.is_over
        if ended.any():
            outcome, case = (np.full(self.num_envs, None, dtype=object) for _ in range(2))
            for b in np.flatnonzero(ended):
                outcome[b], case[b] = OUTCOMES[int(batch.outcome[b])], batch.case(int(b))
            parts += [("outcome", outcome, ended), ("case", case, ended), ("time_s", batch.time(), ended)]
        info: dict[str, Any] = {}
        for name, values, mask in parts:
            info[name] = values.copy()
            if values.dtype != object:
                info[name][~mask] = 0
            info[f"_{name}"] = mask.copy()
        return info

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a test in every world.

        Args:
            seed: World b gets seed + b, or the b-th of a sequence; see `single.AdversaryEnv.reset`.
            options: "test": number of the test, one for all worlds or one each; "reset_mask": bool (num_envs,), the
                worlds that begin again; the others continue.

        Raises:
            ClosedError: The environment is closed.
            InputError: A seed, test or mask is not right, or there is no BV to control.
            UnknownNameError: An option is not known.
        """
        n = self.num_envs
        self._batch.check_open()
        wanted = read_options(options, ("test", "reset_mask"))
        chosen = numbers_of(wanted.get("reset_mask", np.ones(n, dtype=np.bool_)))
        if chosen.shape != (n,) or chosen.dtype != np.bool_ or not chosen.any():
            given = shown(wanted["reset_mask"])
            raise InputError(f"reset_mask must be bool of shape ({n},) with at least one True; it is {given}.")
        seeds = self._seeds(seed)
        super().reset(seed=seeds[0])
        tests = wanted.get("test")
        each: list[Any] = list(tests) if is_several(tests) else [tests] * n
        if len(each) != n:
            raise InputError(f"test has {len(each)} entries; one for all worlds, or {n}.")
        batch = self._batch
        drawn: list[int] = []
        for b in np.flatnonzero(chosen):

            def draw(b: int = int(b)) -> int:
                if not drawn:
                    drawn.append(int(self.np_random.integers(2**31)))
                return drawn[0] + b

            batch.name(int(b), seeds[b], each[b], draw)
        batch.begin(chosen)
        return batch.observation.copy(), self._info(chosen, np.zeros_like(chosen))

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if is_several(seed):
            if len(seed) != self.num_envs:
                raise InputError(
                    f"seed has {len(seed)} entries for {self.num_envs} worlds; give one each, or one number."
                )
            return [None if s is None else check_seed(s) for s in seed]
        first = check_seed(seed)
        check_seed(first + self.num_envs - 1)
        return [first + b for b in range(self.num_envs)]

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """One decision of every world (docs/gymnasium.md); worlds with an ended test begin again as the mode says.

        Raises:
            ClosedError: The environment is closed.
            ResetNeededError: A world has had no test, or (without autoreset) its test has ended.
            InvalidActionError: The actions are not of the action space.
        """
        batch = self._batch
        batch.check_begun()
        given = checked("actions", actions, self.single_action_space, (self.num_envs,))
        ended_before = batch.is_over.copy()
        if (ended_before.any() and self._mode != AutoresetMode.NEXT_STEP) or (batch.outcome == 0)[ended_before].any():
            raise ResetNeededError(
                f"{int(ended_before.sum())} of {self.num_envs} worlds have no running test; call reset() first."
            )
        stepped = ~ended_before
        batch.step(given, stepped)
        self._begin_next(ended_before)
        over = batch.is_over.copy()
        truncated = over & batch.truncated
        reward = batch.reward.copy()
        info = {}
        if self._mode == AutoresetMode.SAME_STEP and over.any():
            info = self._final(over)
            self._begin_next(over)
            stepped = ~over
        info |= self._info(np.ones_like(over), stepped)
        return batch.observation.copy(), reward, over & ~truncated, truncated, info

    def _begin_next(self, chosen: _Mask) -> None:
        if chosen.any():
            self._batch.tests[chosen] += 1
            self._batch.begin(chosen)

    def _final(self, ended: _Mask) -> dict[str, Any]:
        final = np.full(self.num_envs, None, dtype=object)
        for b in np.flatnonzero(ended):
            final[b] = self._batch.observation[b].copy()
        return {
            "final_obs": final,
            "_final_obs": ended.copy(),
            "final_info": self._info(ended, ended),
            "_final_info": ended.copy(),
        }

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Draw one picture for each world, see `raster.top_view`; None without render_mode "rgb_array".

        Raises:
            ClosedError: The environment is closed.
            ResetNeededError: A world has had no test.
        """
        pictures = self._batch.pictures(self.render_mode)
        return None if pictures is None else tuple(pictures)

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002
        """End the threads. Gymnasium before 1.2 calls this also for an object that could not be made."""
        if hasattr(self, "_batch"):
            self._batch.close()


class AdversaryVectorEnv(_BatchVectorEnv):
    """Many `AdversaryEnv` in one.

    Args:
        options: Those of `options.AdversaryVector`, by name.

    Raises:
        CornerForgeError: A name, number or file is not right.
        TypeError: The option is unknown.
    """

    @made_of(AdversaryVector)
    def __init__(self, options: AdversaryVector) -> None:
        self._batch = self._worlds = adversary_batch(
            options.num_envs, options.threads, options.world(), reward=options.reward, delay=options.delay
        )
        self.single_observation_space = adversary_observations(self._batch.run.odd)
        self.single_action_space = one_of_33()
        self._finish(options.num_envs, options.autoreset_mode, options.render_mode, 1)

    def action_masks(self) -> NDArray[np.bool_]:
        """Give the actions that are allowed now, bool (num_envs, 33); errors as for `AdversaryEnv`."""
        self._batch.check_begun()
        return self._worlds.allowed.copy()


class DrivingVectorEnv(_BatchVectorEnv):
    """Many `DrivingEnv` in one.

    Args:
        options: Those of `options.DrivingVector`, by name.

    Raises:
        CornerForgeError: A name, number or file is not right.
        TypeError: The option is unknown.
    """

    @made_of(DrivingVector)
    def __init__(self, options: DrivingVector) -> None:
        self.single_action_space = driving_actions(options.actions, at_site=options.site is not None)
        self._batch = driving_batch(
            options.num_envs, options.threads, options.world(), bv=options.bv, box=options.actions == "box",
            act_every=options.act_every, scaled=options.scaled,
        )  # fmt: skip
        self.single_observation_space = driving_observations(self._batch.run.odd, scaled=options.scaled)
        self._finish(
            options.num_envs, options.autoreset_mode, options.render_mode, round(10 / self._batch.run.odd.av_substeps)
        )
