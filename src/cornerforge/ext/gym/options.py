"""Options of the environments, for one world and for many."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Annotated

from cornerforge._options import Options, Threaded
from cornerforge._schema import meant
from cornerforge.world_options import AdversaryEnvOptions, DrivingEnvOptions

__all__ = ["Adversary", "AdversaryVector", "Driving", "DrivingVector"]

if TYPE_CHECKING:
    from gymnasium.vector import AutoresetMode
else:  # classes are told by their names
    AutoresetMode = type("AutoresetMode", (), {})


class _Shown(Options):
    """How an environment is shown."""

    render_mode: Annotated[str | None, meant('None or "rgb_array".')] = None


class Adversary(AdversaryEnvOptions, _Shown):
    """Options of `AdversaryEnv`."""

    reward: Annotated[str, meant("One of `adversary.worlds.rewards.REWARDS`.")] = "crash"
    delay: Annotated[float, meant("For `avoidable`: the AV's time to react.", low=0.0, high=10.0, unit="s")] = 1.0


class Driving(DrivingEnvOptions, _Shown):
    """Options of `DrivingEnv`."""

    bv: Annotated[str, meant('"nde", "idm", one of `world_options.PLAIN_ADVERSARIES`, or a policy file.')] = "nde"
    actions: Annotated[str, meant('"discrete", one of 33, or "box", two numbers (`spaces.av_commands`).')] = "discrete"
    scaled: Annotated[
        bool, meant("Divide what is seen by its usual sizes; False: SI units, as an AV under test sees.")
    ] = True
    act_every: Annotated[
        int | None, meant("Tenths of a second between two decisions: 1, 2, 5 or 10; None: as the ODD says.")
    ] = None


class _Many(Threaded):
    """Many worlds."""

    num_envs: Annotated[int, meant("Number of worlds.", low=1, high=10**6)] = field(kw_only=False, default=1)
    autoreset_mode: Annotated[
        AutoresetMode | str,
        meant('When worlds whose test ended begin anew: "NextStep", "SameStep" or "Disabled".'),
    ] = "NextStep"


class AdversaryVector(Adversary, _Many):
    """Options of `AdversaryVectorEnv`."""


class DrivingVector(Driving, _Many):
    """Options of `DrivingVectorEnv`."""
