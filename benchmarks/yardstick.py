"""The yardstick in C: compiles `yardstick/drive.c` and drives tests with it in memory of its own.

Same loops, same layout of a vehicle, same elementary functions as the Numba kernels;
`tests/benchmarks/test_yardstick.py` holds both to the last bit. Naturalistic BVs, a built-in AV, nobody controlled,
nothing recorded or counted.
"""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.idm import IdmNumbers
from cornerforge.drivers.mobil import MobilNumbers
from cornerforge.drivers.naturalistic import InitialNumbers, MemoryNumbers
from cornerforge.drivers.sight import SightNumbers
from cornerforge.road.straight import RoadNumbers
from cornerforge.sim.controllers import NATURALISTIC, NOBODY
from cornerforge.sim.outcome import Outcomes, allocate_outcomes
from cornerforge.sim.world import VEHICLE
from cornerforge.types import ACCELERATIONS, MAX_LANES

if TYPE_CHECKING:
    from cornerforge.sim.setting import Setting

__all__ = [
    "COMPILER",
    "FLAGS",
    "INFO",
    "Memory",
    "Yardstick",
    "allocate_memory",
    "compiler_version",
    "has_compiler",
    "same_outcomes",
]

COMPILER = "gcc"
FLAGS = ("-std=c99", "-O3", "-march=native", "-ffp-contract=off", "-fno-tree-slp-vectorize")
"""No fused multiply-add, which rounds otherwise than the kernels. The last flag belongs to it: gcc 12 fuses in the
vectoriser of straight code all the same (the last bit of a lane change's path); it measured no slower without."""
SOURCE = Path(__file__).with_name("yardstick") / "drive.c"

_INT, _DOUBLE = ctypes.c_int64, ctypes.c_double
_INTEGERS = {"n_lanes", "max_decisions", "av_substeps", "one_size", "same_duration", "truck_lanes"}


def _fields(names: tuple[str, ...], integers: set[str] | None = None) -> list[tuple[str, Any]]:
    return [(name, _INT if name in (integers or set()) else _DOUBLE) for name in names]


_OF_ROAD = RoadNumbers._fields[: RoadNumbers._fields.index("lanes")]
"""Numbers of a road whose lanes go on: the yardstick knows no other."""


class _Road(ctypes.Structure):
    _fields_ = _fields(_OF_ROAD, _INTEGERS)


class _Av(ctypes.Structure):
    _fields_ = _fields(IdmNumbers._fields + MobilNumbers._fields + SightNumbers._fields, {"by", "indicators"})


_TABLES = ("cut", "lc_base", "lc_desire", "lc_accept", "lc_turn_back")
_TRAITS = ("noise", "inattention")
_NUMBERS = ("lc_desire_free", "overlook", "overlook_conflict", "lc_most")


class _Memory(ctypes.Structure):
    _fields_ = [*_fields(MemoryNumbers._fields[:-1]), (MemoryNumbers._fields[-1], _DOUBLE * 16)]


class _Initial(ctypes.Structure):
    _fields_ = _fields(InitialNumbers._fields)


class _Tables(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_void_p) for name in _TABLES),
        *_fields(_NUMBERS),
        ("memory", _Memory),
        ("initial", _Initial),
        *((name, ctypes.c_void_p) for name in _TRAITS),
    ]


class _Setting(ctypes.Structure):
    _fields_ = [("road", _Road), ("av", _Av), ("tables", _Tables), ("accelerations", ctypes.c_void_p)]


INFO = (
    "n_vehicles", "decisions", "controlled", "outcome", "frame", "slot_a", "slot_b", "bv_crashes", "n_current",
    "n_seen", "budget_left",
)  # fmt: skip
"""What the first numbers of `Memory.info` are, by their names in `sim.world.STATE`; then follow the AV's leads and
rears and the front of a walk, each MAX_LANES long."""
_PAIRS_PER_SLOT = 8


class Memory(NamedTuple):
    """A world and scratch as the C code has them, in its order; for their meaning see `sim.world` and `sim.scratch`.

    Attributes:
        vehicles: (N,) of `sim.world.VEHICLE`.
        order, current: int64 (N,).
        info: int64, see INFO.
        words: uint64 (4, N).
        pair_a, pair_b: int64 (8 N,).
        least, most: float64 (N,).
        is_watched: int64 (N,).
        ahead, behind: float64 (MAX_LANES,).
    """

    vehicles: NDArray[np.void]
    order: NDArray[np.int64]
    current: NDArray[np.int64]
    info: NDArray[np.int64]
    words: NDArray[np.uint64]
    pair_a: NDArray[np.int64]
    pair_b: NDArray[np.int64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]
    is_watched: NDArray[np.int64]
    ahead: NDArray[np.float64]
    behind: NDArray[np.float64]


_OF_WORLD = Memory._fields[:5]
_OF_PAIRS = Memory._fields[5:]


def allocate_memory(slots: int) -> Memory:
    """Memory for one world of so many vehicle slots."""
    return Memory(
        vehicles=np.zeros(slots, dtype=VEHICLE),
        order=np.zeros(slots, dtype=np.int64),
        current=np.zeros(slots, dtype=np.int64),
        info=np.zeros(len(INFO) + 3 * MAX_LANES, dtype=np.int64),
        words=np.zeros((4, slots), dtype=np.uint64),
        pair_a=np.zeros(_PAIRS_PER_SLOT * slots, dtype=np.int64),
        pair_b=np.zeros(_PAIRS_PER_SLOT * slots, dtype=np.int64),
        least=np.zeros(slots),
        most=np.zeros(slots),
        is_watched=np.zeros(slots, dtype=np.int64),
        ahead=np.zeros(MAX_LANES),
        behind=np.zeros(MAX_LANES),
    )


class _World(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_void_p) for name in _OF_WORLD), ("slots", _INT)]


class _Pairs(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_void_p) for name in _OF_PAIRS), ("capacity", _INT)]


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
        if setting.who.others != NATURALISTIC or setting.who.critical != NOBODY:
            raise ValueError("The yardstick drives naturalistic BVs without an adversary.")
        if setting.av.kind != 0:
            raise ValueError("The yardstick drives a plain AV, IDM and MOBIL.")
        if VEHICLE.itemsize != 256 or MAX_LANES != 6 or setting.tables.cut.shape[1] != 32:
            raise ValueError("The layout of a vehicle or of the tables changed; bring benchmarks/yardstick up to date.")
        self._drive = _compile()
        tables = setting.tables
        self._kept = (setting, ACCELERATIONS)  # what the pointers below point to
        self._setting = _Setting(
            _Road(*setting.road[: len(_OF_ROAD)]),
            _Av(*setting.av.idm, *setting.av.mobil, *setting.av.sight),
            _Tables(
                *(_address(getattr(tables, name)) for name in _TABLES),
                *(getattr(tables, name) for name in _NUMBERS),
                _Memory(*tables.memory[:-1], (_DOUBLE * 16)(*tables.memory.ways.flat)),
                _Initial(*tables.initial),
                *(_address(getattr(tables, name)) for name in _TRAITS),
            ),
            _address(ACCELERATIONS),
        )

    def drive_range(self, seed: int, first: int, memory: Memory, out: Outcomes) -> None:
        """As `sim.drive.drive_range`. Releases the GIL."""
        w = _World(*(_address(getattr(memory, name)) for name in _OF_WORLD), memory.vehicles.size)
        p = _Pairs(*(_address(getattr(memory, name)) for name in _OF_PAIRS), memory.pair_a.size)
        o = _Outcomes(*(_address(part) for part in out))
        self._drive(seed, first, out.code.size, *(ctypes.byref(part) for part in (self._setting, w, p, o)))

    def drive_chunk(self, slots: int, seed: int, first: int, count: int) -> Outcomes:
        """As `sim.runner.drive_chunk`: with buffers of its own."""
        out = allocate_outcomes(count)
        self.drive_range(seed, first, allocate_memory(slots), out)
        return out


def same_outcomes(a: Outcomes, b: Outcomes) -> bool:
    """Equal to the last bit?"""
    return all(np.asarray(x).tobytes() == np.asarray(y).tobytes() for x, y in zip(a, b, strict=True))
