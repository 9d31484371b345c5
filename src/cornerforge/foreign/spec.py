"""Description of an AV as a user gives it: its name, and how it is asked if it is from outside; nothing is started."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cornerforge.foreign.interpreter import USUAL, Confines
from cornerforge.foreign.loaders import FILE_KINDS
from cornerforge.foreign.networks import Reading
from cornerforge.foreign.process import DEFAULT_TIMEOUT

if TYPE_CHECKING:
    from cornerforge.world_options import WorldOptions

__all__ = ["AvSpec", "spec_of", "with_av"]


@dataclass(frozen=True)
class AvSpec:
    """An AV by its name, and how it is asked if it is from outside; none of it is started or read.

    Attributes:
        name: Name of a built-in AV, or `module:Class`, `file.py:Class`, `cmd: PROGRAM`, an `.onnx` or a
            Stable-Baselines3 `.zip` file.
        timeout: Time for the answer in one world [s], 0.01 to 3600; the first answer of a process has 60 s or more.
        batch: Worlds side by side, 1 to 65,536; None: as many as it answers well together (`choose_batch`).
        processes: AV processes that drive at the same time, 1 to 1024; None: as many as there are threads.
        confines: In what its processes run.
        reading: What is said of a network that its file does not say.
    """

    name: str
    timeout: float = DEFAULT_TIMEOUT
    batch: int | None = None
    processes: int | None = None
    confines: Confines = USUAL
    reading: Reading = Reading()  # noqa: RUF009 - it is frozen

    @property
    def is_outside(self) -> bool:
        """True if the AV is code or a file of the user's, and not built in.

        >>> [AvSpec(name).is_outside for name in ("my_av:MyAv", "cmd: ./planner", "net.onnx", "idm-mobil")]
        [True, True, True, False]
        """
        return ":" in self.name or self.name.lower().endswith(FILE_KINDS)


def spec_of(world: WorldOptions) -> AvSpec:
    """Describe the AV of a world."""
    confines = Confines(world.av_python, world.av_memory)
    reading = Reading(world.av_actions, world.av_statistics)
    return AvSpec(world.av, world.av_timeout, world.av_batch, world.av_processes, confines, reading)


def with_av(world: WorldOptions, av: str) -> WorldOptions:
    """Copy options with another AV; a built-in one is spared those that are for others only."""
    if AvSpec(av).is_outside:
        return replace(world, av=av)
    return replace(world, av=av, av_python=None, av_memory=None, av_actions=None, av_statistics=None)
