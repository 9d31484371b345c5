"""Batches of worlds made from the options of an environment, the same for single and vector environments."""

from __future__ import annotations

from dataclasses import replace

from cornerforge.adversary.verdicts import verdict_of
from cornerforge.adversary.worlds import reward_numbers
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import check_threads
from cornerforge.experiment.setting import experiment
from cornerforge.ext.gym.batch import AvBatch, BvBatch
from cornerforge.world_options import WorldOptions

__all__ = ["adversary_batch", "driving_batch"]

_ACT_EVERY = (1, 2, 5, 10)


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
