"""Batches of worlds made from the options of an environment, the same for single and vector environments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from cornerforge.envs.batch import AvBatch, BvBatch
from cornerforge.errors import InputError
from cornerforge.pipeline.setting import check_threads, experiment
from cornerforge.pipeline.verdicts import verdict_of
from cornerforge.sim import reward_numbers
from cornerforge.world_options import WorldOptions

__all__ = ["adversary_batch", "driving_batch", "options_of"]

_ACT_EVERY = (1, 2, 5, 10)


def options_of(env: object, known: type, given: Mapping[str, Any]) -> WorldOptions:
    """Take the keywords of an environment that are options of the world.

    Gymnasium hands keywords on unseen by a type checker, and an option that changes nothing would be taken in silence.

    Args:
        env: The environment.
        known: Its keywords, a `TypedDict`.
        given: Those given.

    Raises:
        TypeError: One is not known; in Python's words.
    """
    for name in given:
        if name not in known.__annotations__:
            raise TypeError(f"{type(env).__init__.__qualname__}() got an unexpected keyword argument {name!r}")
    return WorldOptions(**given)


def adversary_batch(n: int, threads: int | None, world: WorldOptions, *, reward: str, delay: float = 1.0) -> BvBatch:
    """Make the worlds for `Adversary-v0`; arguments as for `AdversaryEnv`."""
    pays = reward_numbers(reward, delay)
    # The agent chooses the actions of the controlled BV; an adversary is named so that the mask may be bounded.
    run = experiment(world, bv="uniform", takes_foreign=True)
    return BvBatch(run, n, threads, check_threads(None), pays, verdict_of(reward, run))


def driving_batch(
    n: int, threads: int | None, world: WorldOptions, *, bv: str, box: bool, act_every: int | None
) -> AvBatch:
    """Make the worlds for `Driving-v0`; arguments as for `DrivingEnv`."""
    run = experiment(world, bv=bv)
    if act_every is not None:
        if act_every not in _ACT_EVERY:
            raise InputError(f"act_every = {act_every!r} is not allowed; one of 1, 2, 5 or 10 tenths of a second.")
        road = run.setting.road._replace(av_substeps=act_every)
        run = replace(run, odd=replace(run.odd, av_substeps=act_every), setting=run.setting._replace(road=road))
    return AvBatch(run, n, threads, check_threads(None), box=box)
