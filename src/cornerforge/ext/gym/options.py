"""Options of the environments, for one world and for many."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Annotated

from cornerforge._options import Option, Options, Threaded
from cornerforge.world_options import AdversaryEnvOptions, DrivingEnvOptions

if TYPE_CHECKING:
    from gymnasium.vector import AutoresetMode
else:  # classes are told by their names
    AutoresetMode = type("AutoresetMode", (), {})

__all__ = ["Adversary", "AdversaryVector", "Driving", "DrivingVector"]


class _Shown(Options):
    """How an environment is shown."""

    render_mode: Annotated[str | None, Option('None or "rgb_array".')] = None


class Adversary(AdversaryEnvOptions, _Shown):
    """Options of `AdversaryEnv`."""

    reward: Annotated[str, Option("One of `adversary.worlds.rewards.REWARDS`.")] = "crash"
    delay: Annotated[float, Option("For `avoidable`: the AV's time to react.", low=0.0, high=10.0, unit="s")] = 1.0


class Driving(DrivingEnvOptions, _Shown):
    """Options of `DrivingEnv`."""

    bv: Annotated[str, Option('"nde", "idm", one of `world_options.PLAIN_ADVERSARIES`, or a policy file.')] = "nde"
    actions: Annotated[str, Option('"discrete", one of 33, or "box", two numbers (`spaces.av_commands`).')] = "discrete"
    act_every: Annotated[
        int | None, Option("Tenths of a second between two decisions: 1, 2, 5 or 10; None: as the ODD says.")
    ] = None


class _Many(Threaded):
    """Many worlds."""

    num_envs: Annotated[int, Option("Number of worlds.", low=1, high=10**6)] = field(kw_only=False, default=1)
    autoreset_mode: Annotated[
        AutoresetMode | str,
        Option('When worlds whose test ended begin anew: "NextStep", "SameStep" or "Disabled".'),
    ] = "NextStep"


class AdversaryVector(Adversary, _Many):
    """Options of `AdversaryVectorEnv`."""


class DrivingVector(Driving, _Many):
    """Options of `DrivingVectorEnv`."""
