"""The user's options for the world of a test: their types, defaults and explanations stand here and nowhere else.

Options of verbs inherit from these classes, so `simulate(tests=1000, lanes=4)` and `--lanes 4` mean the same. The
module is light to import, because `--help` needs it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cornerforge._options import Option, Options

if TYPE_CHECKING:
    from cornerforge.ndd.model import NddModel
else:  # classes are told by their names, so that the module need not be imported
    NddModel = type("NddModel", (), {})

__all__ = [
    "LEARNERS",
    "PLAIN_ADVERSARIES",
    "REWARD_NAMES",
    "AdversaryEnvOptions",
    "AvAloneOptions",
    "AvAskedOptions",
    "AvOptions",
    "AvProcessOptions",
    "DrivingEnvOptions",
    "RoadOptions",
    "WorldOptions",
]

PLAIN_ADVERSARIES = ("uniform", "lane-changer", "swerve")
"""Adversaries that have not learned, as help names them; `sim.setting.ADVERSARIES` says what they do."""
REWARD_NAMES = ("crash", "striking", "avoidable", "preventable", "preventable-by-braking", "own-fault")
"""Names of `adversary.worlds.rewards.REWARDS`, which says what they pay for."""

LEARNERS = ("dqn", "ppo")
"""Names of learners, as help names them; each is the file of that name in `adversary/`."""


@dataclass(frozen=True, kw_only=True)
class _World(Options):
    """Some options of a world; the others are as by default."""

    def world(self) -> WorldOptions:
        """Give the options of the world alone; those that these lack have their defaults."""
        own = {one.name for one in fields(self)}
        return WorldOptions(**{one.name: getattr(self, one.name) for one in fields(WorldOptions) if one.name in own})


@dataclass(frozen=True, kw_only=True)
class RoadOptions(_World):
    """The road and its traffic."""

    odd: Annotated[
        str,
        Option("default (4 s lane change), swift (2.5 s), paper (1 s) or mixed (4 s; trucks too).", near=("odd",)),
    ] = "default"
    lanes: Annotated[int | None, Option("Lanes, 2 to 6; 3 by default.")] = None
    model: Annotated[Path | str | NddModel | None, Option("Naturalistic model; the shipped one by default.")] = None


@dataclass(frozen=True, kw_only=True)
class AvProcessOptions(_World):
    """The process in which an AV from outside runs, and its time."""

    av_timeout: Annotated[
        float,
        Option(
            "Seconds that an AV which is not built in may take for the answer in one world.",
            low=0.01, high=3600.0, unit="s",
        ),
    ] = 5.0  # fmt: skip
    av_python: Annotated[
        str | None, Option("Python in which such an AV runs, such as env/bin/python; it needs NumPy only.")
    ] = None
    av_memory: Annotated[
        float | None, Option("GB that a process of such an AV may take; half of the machine's by default.", unit="GB")
    ] = None
    av_actions: Annotated[
        str | None,
        Option(
            "What an .onnx file, or predict, answers by where that is not clear: box (two numbers of Box(-1, 1)), si "
            "(m/s2 and a lane wish) or number (of one of the 33 actions).",
            choices=("box", "si", "number"),
        ),
    ] = None
    av_statistics: Annotated[
        str | None,
        Option("File of VecNormalize, or of NumPy, for a network; or none. The one beside an SB3 .zip by default."),
    ] = None


@dataclass(frozen=True, kw_only=True)
class AvAskedOptions(AvProcessOptions):
    """How an AV from outside is asked."""

    av_batch: Annotated[
        int | None,
        Option("Worlds that such an AV is asked about together; chosen by its speed by default.", low=1, high=65_536),
    ] = None
    av_processes: Annotated[
        int | None,
        Option("Processes of such an AV at the same time; as many as threads by default.", low=1, high=1024),
    ] = None


@dataclass(frozen=True, kw_only=True)
class _Av(_World):
    """The AV."""

    av: Annotated[
        str,
        Option(
            "AV under test: a name (`cornerforge avs` lists them), module:Class, file.py:Class, "
            '"cmd: ./program", or an .onnx or SB3 .zip file.',
            near=("av",),
        ),
    ] = "idm-mobil"


@dataclass(frozen=True, kw_only=True)
class AvAloneOptions(_Av, AvAskedOptions):
    """The AV, on a road that is known."""


@dataclass(frozen=True, kw_only=True)
class AvOptions(_Av, RoadOptions, AvAskedOptions):
    """The AV, the road and its traffic."""


@dataclass(frozen=True, kw_only=True)
class _Mask(_World):
    """The mask of an adversary."""

    bounded: Annotated[bool, Option("Only actions that the naturalistic model calls possible.")] = False


@dataclass(frozen=True, kw_only=True)
class _Budget(_Mask):
    """The mask and the likelihood budget of an adversary."""

    budget: Annotated[
        float | None,
        Option(
            "Likelihood budget of a test in nats, such as 5: how far the actions may fall short of the likeliest "
            "ones. Implies --bounded.",
            unit="nats",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class DrivingEnvOptions(_Mask, RoadOptions):
    """The world of `cornerforge/Driving-v0`, whose AV is the agent."""


@dataclass(frozen=True, kw_only=True)
class AdversaryEnvOptions(_Av, DrivingEnvOptions, AvProcessOptions):
    """The world of `cornerforge/Adversary-v0`, whose adversary is the agent."""


@dataclass(frozen=True, kw_only=True)
class WorldOptions(_Av, RoadOptions, _Budget, AvAskedOptions):
    """The world of a test, with an adversary; `experiment.setting.experiment` checks names and files.

    Attributes:
        av: The AV under test: a built-in name, a file that `train-av` made, or an AV from outside: `module:Class`,
            `path/to/file.py:Class`, an `.onnx` or a Stable-Baselines3 `.zip` file, or `cmd: PROGRAM ARGUMENTS`.
        odd: "default", "swift", "paper" or "mixed".
        lanes: 2 to 6; None for the ODD's own.
        model: Naturalistic model, or its file; None for the one that ships with the package.
        bounded: Keep the adversary to actions that the naturalistic model calls possible; a policy brings its own
            answer.
        budget: Likelihood budget of a test [nats], 0 or more: the largest amount by which the log-probability of the
            adversary's actions, summed over the test, may fall short of the likeliest actions'. It implies `bounded`
            and overrides a policy's own budget. None: no limit, or the policy's own.
        av_timeout: Longest time that an AV from outside may take for the answer in one world [s], 0.01 to 3600.
        av_batch: Worlds that an AV from outside is asked about together, 1 to 65,536; None: as its speed advises.
        av_processes: Processes of an AV from outside that drive at the same time, 1 to 1024; None: as many as threads.
        av_python: Python interpreter in which such an AV runs; None: the one of cornerforge.
        av_memory: Memory that each process of such an AV may take with all that it starts [GB], 0.25 to 1e6; None: half
            of the machine's.
        av_actions: What an ONNX file or a policy's `predict` answers by: "box", "si" or "number"; None: as it says.
        av_statistics: File of the mean and variance by which a network's observations were normalised, or "none";
            None: what lies beside a Stable-Baselines3 file.
    """

    def without_mask(self) -> WorldOptions:
        """Copy the world without `bounded` and `budget`: for a policy, which brings its own."""
        return replace(self.world(), bounded=False, budget=None)

    def av_keywords(self) -> dict[str, Any]:
        """Give the options as keywords of verbs without an adversary: all but `bounded` and `budget`."""
        return {one.name: getattr(self, one.name) for one in fields(AvOptions)}
