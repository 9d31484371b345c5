"""The machine on which the numbers were measured."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import time
from dataclasses import dataclass
from pathlib import Path

from cornerforge.experiment.output import code_hash
from cornerforge.work import default_threads

__all__ = ["BUSY_LOAD", "Machine", "describe", "this_machine"]

BUSY_LOAD = 0.5
"""Load average (1 min) at the start above which the machine counts as busy."""
_PACKAGES = ("cornerforge", "highway-env", "numba", "numpy", "torch", "scikit-learn", "pyarrow")


@dataclass(frozen=True)
class Machine:
    """The machine and its software, before anything runs; `load` is the load average over the last minute."""

    processor: str
    cores: int
    system: str
    load: float
    date: str
    python: str
    versions: dict[str, str]
    code: str

    @property
    def is_busy(self) -> bool:
        return self.load > BUSY_LOAD


def _processor() -> str:
    """The processor's name as Linux tells it, else what Python knows."""
    path = Path("/proc/cpuinfo")
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def this_machine() -> Machine:
    """Look at the machine that this runs on."""
    return Machine(
        processor=_processor(),
        cores=default_threads(),
        system=f"{platform.system()} {platform.machine()}",
        load=os.getloadavg()[0],
        date=time.strftime("%Y-%m-%d", time.gmtime()),
        python=platform.python_version(),
        versions={name: importlib.metadata.version(name) for name in _PACKAGES},
        code=code_hash(),
    )


def describe(machine: Machine) -> str:
    """The machine in a few lines of Markdown."""
    tools = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    busy = "\n**The machine had other work at the start: these numbers are a trial.**" if machine.is_busy else ""
    return (
        f"Machine: {machine.processor}, {machine.cores} cores, {machine.system}; load average at the start "
        f"{machine.load:.2f}; {machine.date}.\n"
        f"Versions: Python {machine.python}, {tools}; code `{machine.code}`.{busy}"
    )
