"""The yardstick in C: compiles `yardstick/drive.c` and drives tests with it on the simulator's own arrays.

Same loops, same memory layout, same elementary functions as the Numba kernels; `tests/benchmarks/test_yardstick.py`
holds both to the last bit. Naturalistic BVs, a built-in AV, nobody controlled, nothing recorded or counted.
"""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge.drivers.idm import IdmNumbers
from cornerforge.drivers.mobil import MobilNumbers
from cornerforge.sim.drive import Outcomes
from cornerforge.sim.reach import Pairs, allocate_pairs
from cornerforge.sim.runner import allocate_outcomes
from cornerforge.sim.world import INFO_FIELDS, VEHICLE, RoadNumbers, World, allocate_worlds
from cornerforge.types import ACCELERATIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.drive import Setting

__all__ = ["COMPILER", "FLAGS", "Yardstick", "compiler_version", "has_compiler", "same_outcomes"]

COMPILER = "gcc"
FLAGS = ("-std=c99", "-O3", "-march=native", "-ffp-contract=off", "-fno-tree-slp-vectorize")
"""No fused multiply-add, which rounds otherwise than the kernels. The last flag belongs to it: gcc 12 fuses in the
vectoriser of straight code all the same (the last bit of a lane change's path); it measured no slower without."""
SOURCE = Path(__file__).with_name("yardstick") / "drive.c"

_INT, _DOUBLE = ctypes.c_int64, ctypes.c_double
_INTEGERS = {"n_lanes", "max_decisions", "av_substeps"}


def _fields(names: tuple[str, ...], integers: set[str] | None = None) -> list[tuple[str, Any]]:
    return [(name, _INT if name in (integers or set()) else _DOUBLE) for name in names]


class _Road(ctypes.Structure):
    _fields_ = _fields(RoadNumbers._fields, _INTEGERS)


class _Av(ctypes.Structure):
    _fields_ = [*_fields(IdmNumbers._fields + MobilNumbers._fields), ("sees_intentions", _INT)]


_TABLES = ("cut", "lc_base", "lc_desire", "lc_accept")
_NUMBERS = ("lc_desire_free", "overlook", "overlook_conflict", "lc_most")


class _Tables(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_void_p) for name in _TABLES), *_fields(_NUMBERS), ("initial", ctypes.c_void_p)]


class _Setting(ctypes.Structure):
    _fields_ = [("road", _Road), ("av", _Av), ("tables", _Tables), ("accelerations", ctypes.c_void_p)]


class _World(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_void_p) for name in World._fields), ("slots", _INT)]


class _Pairs(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_void_p) for name in Pairs._fields[:-1]), ("capacity", _INT)]  # last: a learned AV's


class _Outcomes(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in Outcomes._fields]


def has_compiler() -> bool:
    """Is there a gcc?"""
    return shutil.which(COMPILER) is not None


def compiler_version() -> str:
    """What the compiler calls itself, one line."""
    return subprocess.run([COMPILER, "--version"], check=True, capture_output=True, text=True).stdout.splitlines()[0]


@functools.cache
def _compile() -> Callable[..., None]:
    """Compile `drive_range` and load it; the file is gone when it is loaded."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "yardstick.so"
        command = [
            COMPILER,
            *FLAGS,
            "-fPIC",
            "-shared",
            "-Wall",
            "-Wextra",
            "-Werror",
            str(SOURCE),
            "-o",
            str(library),
            "-lm",
        ]
        subprocess.run(command, check=True)
        drive: Callable[..., None] = ctypes.CDLL(str(library)).drive_range
    drive.argtypes = [_INT, _INT, _INT, *(ctypes.c_void_p,) * 4]  # type: ignore[attr-defined]
    drive.restype = None  # type: ignore[attr-defined]
    return drive


def _address(array: NDArray[Any]) -> int:
    if not array.flags.c_contiguous:
        raise ValueError("The yardstick takes C-contiguous arrays only.")
    return int(array.ctypes.data)


class Yardstick:
    """`drive_range` in C for one setting.

    Args:
        setting: With naturalistic BVs and no adversary.

    Raises:
        ValueError: The setting asks for something else.
    """

    def __init__(self, setting: Setting) -> None:
        if setting.bv_model != 0 or setting.adversary != 0:
            raise ValueError("The yardstick drives naturalistic BVs without an adversary.")
        if setting.av.kind != 0:
            raise ValueError("The yardstick drives a plain AV, IDM and MOBIL.")
        if VEHICLE.itemsize != 160 or INFO_FIELDS != 29 or setting.tables.cut.shape[1] != 32:
            raise ValueError("The layout of a world or of the tables changed; bring benchmarks/yardstick up to date.")
        self._drive = _compile()
        self._kept = (setting, ACCELERATIONS)  # what the pointers below point to
        tables = setting.tables
        self._setting = _Setting(
            _Road(*setting.road),
            _Av(*setting.av.idm, *setting.av.mobil, setting.av.sees_intentions),
            _Tables(
                *(_address(getattr(tables, name)) for name in _TABLES),
                *(getattr(tables, name) for name in _NUMBERS),
                _address(tables.initial),
            ),
            _address(ACCELERATIONS),
        )

    def drive_range(self, seed: int, first: int, count: int, world: World, pairs: Pairs, out: Outcomes) -> None:
        """As `sim.drive.drive_range`; `world` is one world, without a leading axis. Releases the GIL."""
        w = _World(*(_address(part) for part in world), world.vehicles.size)
        p = _Pairs(*(_address(part) for part in pairs[:-1]), pairs.a.size)
        o = _Outcomes(*(_address(part) for part in out))
        self._drive(seed, first, count, *(ctypes.byref(part) for part in (self._setting, w, p, o)))

    def drive_chunk(self, slots: int, seed: int, first: int, count: int) -> Outcomes:
        """As `sim.runner.drive_chunk`: with buffers of its own."""
        out = allocate_outcomes(count)
        world = World(*(part[0] for part in allocate_worlds(1, slots)))
        self.drive_range(seed, first, count, world, allocate_pairs(slots), out)
        return out


def same_outcomes(a: Outcomes, b: Outcomes) -> bool:
    """Equal to the last bit?"""
    return all(np.asarray(x).tobytes() == np.asarray(y).tobytes() for x, y in zip(a, b, strict=True))
