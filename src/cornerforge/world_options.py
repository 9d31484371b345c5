"""The user's options for the world of a test: their types, defaults and explanations stand here and nowhere else.

Verbs of the Python interface take these options as keywords (`simulate(tests=1000, lanes=4)`) and hand them on as one
`WorldOptions`; commands take them as options of the same names. The module is light to import, because `--help` needs
it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

if TYPE_CHECKING:
    from cornerforge.ndd.model import NddModel

__all__ = [
    "AV_ASKED",
    "AV_PROCESS",
    "PLAIN_ADVERSARIES",
    "REWARD_NAMES",
    "AdversaryEnvKeywords",
    "AvAloneKeywords",
    "AvKeywords",
    "AvProcessKeywords",
    "DrivingEnvKeywords",
    "RoadKeywords",
    "WorldKeywords",
    "WorldOptions",
]

PLAIN_ADVERSARIES = ("uniform", "lane-changer", "swerve")
"""Adversaries that have not learned, as help names them; `sim.setting.ADVERSARIES` says what they do."""
REWARD_NAMES = ("crash", "striking", "avoidable", "preventable", "preventable-by-braking", "own-fault")
"""Names of `adversary.worlds.rewards.REWARDS`, which says what they pay for."""


@dataclass(frozen=True)
class WorldOptions:
    """The options for the world of a test, as the user gives them; `experiment.setting.experiment` checks them.

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
    """

    av: str = field(
        default="idm-mobil",
        metadata={
            "help": "AV under test: a name (`cornerforge avs` lists them), module:Class, file.py:Class, "
            '"cmd: ./program", or an .onnx or SB3 .zip file.'
        },
    )
    odd: str = field(
        default="default",
        metadata={"help": "default (4 s lane change), swift (2.5 s), paper (1 s) or mixed (4 s; trucks too)."},
    )  # fmt: skip
    lanes: int | None = field(default=None, metadata={"help": "Lanes, 2 to 6; 3 by default."})
    model: Path | str | NddModel | None = field(
        default=None, metadata={"help": "Naturalistic model; the shipped one by default."}
    )
    bounded: bool = field(
        default=False, metadata={"help": "Only actions that the naturalistic model calls possible."}
    )  # fmt: skip
    budget: float | None = field(
        default=None,
        metadata={
            "unit": "nats",
            "help": "Likelihood budget of a test in nats, such as 5: how far the actions may fall short of the "
            "likeliest ones. Implies --bounded.",
        },
    )
    av_timeout: float = field(
        default=5.0,
        metadata={
            "unit": "s",
            "help": "Seconds that an AV which is not built in may take for the answer in one world.",
        },
    )
    av_batch: int | None = field(
        default=None,
        metadata={"help": "Worlds that such an AV is asked about together; chosen by its speed by default."},
    )
    av_processes: int | None = field(
        default=None,
        metadata={"help": "Processes of such an AV at the same time; as many as threads by default."},
    )
    av_python: str | None = field(
        default=None,
        metadata={"help": "Python in which such an AV runs, such as env/bin/python; it needs NumPy only."},
    )
    av_memory: float | None = field(
        default=None,
        metadata={"unit": "GB", "help": "GB that a process of such an AV may take; half of the machine's by default."},
    )

    def without_mask(self) -> WorldOptions:
        """Copy the options without `bounded` and `budget`: for a policy, which brings its own."""
        return replace(self, bounded=False, budget=None)

    def av_keywords(self) -> AvKeywords:
        """Give the options as keywords of verbs without an adversary: all but `bounded` and `budget`."""
        found: Any = {name: getattr(self, name) for name in AvKeywords.__annotations__}
        keywords: AvKeywords = found
        return keywords

    def with_av(self, av: str, *, is_foreign: bool) -> WorldOptions:
        """Copy the options with another AV; Python and memory are for one from outside only."""
        if is_foreign:
            return replace(self, av=av)
        return replace(self, av=av, av_python=None, av_memory=None)


class RoadKeywords(TypedDict, total=False):
    """Keywords of verbs that know the AV, or need none: the options of `WorldOptions` for the road and its traffic."""

    odd: str
    lanes: int | None
    model: Path | str | NddModel | None


class AvProcessKeywords(TypedDict, total=False):
    """Keywords of verbs that are told their AVs and worlds otherwise: in what an AV from outside runs, and its time."""

    av_timeout: float
    av_python: str | None
    av_memory: float | None


class AvAskedKeywords(AvProcessKeywords, total=False):
    """Keywords of verbs that are told their AVs otherwise: how those from outside are asked."""

    av_batch: int | None
    av_processes: int | None


class AvAloneKeywords(AvAskedKeywords, total=False):
    """Keywords of verbs that drive an AV on a road that is known."""

    av: str


class AvKeywords(RoadKeywords, AvAloneKeywords, total=False):
    """Keywords of verbs that drive an AV."""


class WorldKeywords(AvKeywords, total=False):
    """Keywords of verbs in which there can be an adversary, too."""

    bounded: bool
    budget: float | None


class DrivingEnvKeywords(RoadKeywords, total=False):
    """Keywords of `cornerforge/Driving-v0`, whose AV is the agent."""

    bounded: bool


class AdversaryEnvKeywords(DrivingEnvKeywords, AvProcessKeywords, total=False):
    """Keywords of `cornerforge/Adversary-v0`, whose adversary is the agent."""

    av: str


AV_PROCESS = tuple(AvProcessKeywords.__annotations__)
"""Names of the options of `AvProcessKeywords`."""
AV_ASKED = tuple(AvAskedKeywords.__annotations__)
"""Names of the options of `AvAskedKeywords`."""
