"""The naturalistic driving model: probability tables P(action | state), and the file that holds them.

Tables stand on the grids of the published IVBSS arrays (Feng et al. 2021), so that arrays of that form can be imported:
subject speed 20..40 by 1 m/s, gap 0..115 by 1 m, range rate -10..8 by 1 m/s (lead minus subject; negative is closing),
31 accelerations -4.0..2.0 by 0.2 m/s2. Look-ups take the nearest grid point.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checksums import MIGRATE, read_arrays, write_arrays
from cornerforge._schema import Share, meant, parse
from cornerforge.errors import FileFormatError
from cornerforge.fields import Field
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID, SLOW_GRID, SPEED_GRID
from cornerforge.ndd.initial import InitialState, check_initial, check_numbers
from cornerforge.ndd.memory import Memory
from cornerforge.types import N_ACCELERATIONS

__all__ = [
    "GAPS",
    "OLD_SCHEMA",
    "RANGE_RATES",
    "SCHEMA_VERSION",
    "SLOW",
    "SPEEDS",
    "TABLES",
    "NddModel",
    "default_model_path",
    "load_model",
    "model_hash",
    "save_model",
]

SCHEMA_VERSION = 2
OLD_SCHEMA = 1
"""Version that `migrate` brings to the present one."""
_UNSAID = {
    "stream_sd": 0.0,
    "time_gap_shift": 0.0,
    "desire_share": 0.0,
    "habit_spread": 1.0,
    "change_median": 0.0,
    "signal_share": 1.0,
    "noise_spread": 0.0,
    "vigilance_sigma": 0.0,
}
"""Values for keys that a file lacks; files of version 1 have no `memory`, `free_pull` and `lc_turn_back` either."""
SPEEDS: NDArray[np.float64] = SPEED_GRID.points()
"""Subject speed grid [m/s], shape (21,)."""
GAPS: NDArray[np.float64] = GAP_GRID.points()
"""Bumper-to-bumper distance grid [m], shape (116,)."""
RANGE_RATES: NDArray[np.float64] = RANGE_RATE_GRID.points()
"""Range rate grid [m/s], lead minus subject, shape (19,)."""


@dataclass(frozen=True)
class NddModel:
    """P(action | state) of human drivers: lateral decision first, then acceleration (paper; Feng et al. 2021).

    P(left) = lc_base[v] * lc_desire[gap, rr] * accept(adjacent lead) * accept(adjacent rear), and P(right) in the same
    way. With no leader within the grid the desire is `lc_desire_free`; a neighbour beyond the grid, or none, is
    accepted with 1. With probability `overlook` a driver does not see an adjacent neighbour (accept = 1 for it); with
    chance `overlook_conflict` it does not see that another vehicle enters the same lane from the other side. Attentive
    acceptance may be exactly 0.

    Attributes:
        following: P(acceleration), float32 (21, 116, 19, 31); rows sum to 1; exact 0 is "impossible".
        free: The same with no leader within 115 m, over all drivers at a speed, float32 (21, 31).
        free_pull: Mean acceleration of a free driver, above the mean of all drivers at its speed, per m/s that it lacks
            to its own desired speed [1/s]; 0: drivers have no desired speed. Its row is the row of all drivers, tilted:
            p(a) exp(theta a), normalised, so impossible stays impossible.
        lc_base: Chance of starting a change to one given side in one 1 s decision, float32 (21,) over speed.
        lc_desire: Multiplier by state to the leader, float32 (116, 19) over (gap, range rate).
        lc_desire_free: Multiplier with no leader within the grid.
        lc_accept_lead: Chance that the gap to the adjacent vehicle ahead is accepted, float32 (116, 19).
        lc_accept_rear: The same for the one behind; range rate is subject minus rear, negative when the rear closes.
        lc_turn_back: Chance that a driver in a running lane change, its centre still in its old lane, turns back for
            one neighbour in the target lane, float32 (116, 19) over (gap, range rate).
        overlook: Chance to overlook an adjacent neighbour when deciding on a lane change.
        overlook_conflict: Chance to overlook that another vehicle enters the same lane at the same moment.
        memory: How a follower's acceleration depends on its own past.
        initial: Traffic at the start.
        provenance: Where it comes from: data files, fit settings, licence note; JSON-compatible.
        slow: `following` from 0 to 19 m/s, float32 (20, 116, 19, 31); None: the model knows no traffic that stops.
    """

    following: NDArray[np.float32]
    free: NDArray[np.float32]
    free_pull: Annotated[float, meant("Pull of the own desired speed.", "1/s", 0, 1)]
    lc_base: NDArray[np.float32]
    lc_desire: NDArray[np.float32]
    lc_desire_free: Annotated[float, meant("Multiplier with no leader.", "", 0, 100)]
    lc_accept_lead: NDArray[np.float32]
    lc_accept_rear: NDArray[np.float32]
    lc_turn_back: NDArray[np.float32]
    overlook: Share
    overlook_conflict: Share
    memory: Memory
    initial: InitialState
    provenance: Mapping[str, object]
    slow: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        for one in TABLES if self.slow is None else (*TABLES, SLOW):
            table, shape = getattr(self, one.name), _shape(one)
            if table.shape != shape:
                raise FileFormatError(f"Model table {one.name} has shape {table.shape}; expected {shape}.")
            low, high = one.within or (0.0, 0.0)
            if not np.isfinite(table).all() or (table < low).any() or (table > high).any():
                raise FileFormatError(f"Model table {one.name} holds NaN, or numbers that are not {one.allowed}.")
        for name in ("following", "free") if self.slow is None else ("following", "free", SLOW.name):
            off = float(np.abs(getattr(self, name).sum(axis=-1, dtype=np.float64) - 1.0).max())
            if off > 1e-4:
                raise FileFormatError(f"Model table {name}: a row of probabilities sums to 1 only within {off:.2g}.")
        for part in (self, self.memory, self.initial):
            check_numbers(part)
        remembered = self.memory.near + self.memory.far + self.memory.habit
        if remembered > 1.0:
            raise FileFormatError(
                f"The weights of the model's memory (near, far, habit) sum to {remembered:g}, above 1."
            )
        check_initial(self.initial)


_SHARE = (0.0, 1.0)
_STATE = f"{GAPS.size},{RANGE_RATES.size}"
TABLES: tuple[Field, ...] = (
    Field(
        "following", f"float32[{SPEEDS.size},{_STATE},{N_ACCELERATIONS}]", "",
        "P(acceleration) by speed, gap and range rate; rows sum to 1, exact 0 is impossible.", _SHARE,
    ),
    Field(
        "free", f"float32[{SPEEDS.size},{N_ACCELERATIONS}]", "",
        "P(acceleration) by speed without a leader within 115 m; rows sum to 1.", _SHARE,
    ),
    Field(
        "lc_base", f"float32[{SPEEDS.size}]", "per decision", "Chance to begin a change to one side, by speed.", _SHARE
    ),
    Field("lc_desire", f"float32[{_STATE}]", "", "Multiplier of it, by state to the leader.", (0.0, 1e4)),
    Field("lc_accept_lead", f"float32[{_STATE}]", "", "Chance that the gap to the adjacent lead is accepted.", _SHARE),
    Field("lc_accept_rear", f"float32[{_STATE}]", "", "The same of the adjacent rear.", _SHARE),
    Field("lc_turn_back", f"float32[{_STATE}]", "", "Chance to turn back from a change for a neighbour.", _SHARE),
)  # fmt: skip
"""The arrays of a model's file."""
SLOW = Field(
    "slow", f"float32[{SLOW_GRID.bins},{_STATE},{N_ACCELERATIONS}]", "",
    "The same as following below 20 m/s; files of models that know no traffic that stops lack it.", _SHARE,
)  # fmt: skip
"""The array that a model's file may have too. It is made by the law of `following`, so `model_hash` leaves it out."""


def _shape(table: Field) -> tuple[int, ...]:
    return tuple(map(int, table.type.partition("[")[2].rstrip("]").split(",")))


_SHAPES = {table.name: _shape(table) for table in TABLES}
_NUMBERS = ("free_pull", "lc_desire_free", "overlook", "overlook_conflict")


def default_model_path() -> Path:
    """The fitted model that ships with the package."""
    return Path(__file__).parent / "default_model.npz"


def save_model(model: NddModel, path: Path) -> None:
    """Write a model as a compressed `.npz`; the same model gives the same bytes.

    Raises:
        OutputError: It cannot be written; nothing is left of it then.
    """
    header = {
        "schema_version": SCHEMA_VERSION,
        **{name: getattr(model, name) for name in _NUMBERS},
        "memory": asdict(model.memory),
        "initial": asdict(model.initial),
        "provenance": dict(model.provenance),
    }
    text = json.dumps(header, sort_keys=True, indent=1)
    names = [*_SHAPES, *([] if model.slow is None else [SLOW.name])]
    tables = {name: getattr(model, name).astype(np.float32) for name in names}
    write_arrays(path, {"header": np.array(text), **tables}, "the model")


def load_model(path: Path) -> NddModel:
    """Read a model file; never loads a pickle.

    Raises:
        FileFormatError: Missing, damaged, not a model, or written by another schema.
        NoChecksumError: It carries no checksums.
    """
    if not path.is_file():
        raise FileFormatError(
            f"No model file {path}; make one with: cornerforge ndd fit FILE... --format F --out {path}"
        )
    arrays = read_arrays(path, "model")
    try:
        header = parse(str(arrays["header"]), finite=False)
        if not isinstance(header, dict):
            raise FileFormatError("its header is no object.")
        version = header.get("schema_version")
        if version != SCHEMA_VERSION:
            raise FileFormatError(
                f"it has schema version {version}; this cornerforge reads {SCHEMA_VERSION}: "
                + ("install the version that made it." if version != OLD_SCHEMA else f"{MIGRATE}.")
            )
        if not isinstance(header.get("provenance"), dict):
            raise FileFormatError("its provenance is no object.")
        names = [*_SHAPES, *([SLOW.name] if SLOW.name in arrays else [])]
        for name in names:
            if arrays[name].dtype != np.float32:
                raise FileFormatError(f"table {name} is of type {arrays[name].dtype}; it must be float32.")
        tables: dict[str, Any] = {name: np.ascontiguousarray(arrays[name], dtype=np.float32) for name in names}
        numbers: dict[str, Any] = {name: header[name] for name in _NUMBERS}
        return NddModel(
            **tables,
            **numbers,
            memory=Memory(**header["memory"]),
            initial=InitialState(**(_UNSAID | header["initial"])),
            provenance=header["provenance"],
        )
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise FileFormatError(
            f"Model file {path} is damaged or no cornerforge model ({type(error).__name__}: {error})."
        ) from error


def model_hash(model: NddModel) -> str:
    """SHA-256 (first 16 hex digits) over everything that decides how vehicles drive; provenance and `slow` left out."""
    digest = hashlib.sha256()
    for name in _SHAPES:
        digest.update(np.ascontiguousarray(getattr(model, name), dtype="<f4").tobytes())
    numbers = [getattr(model, name) for name in _NUMBERS]
    numbers += [*astuple(model.memory), *astuple(model.initial)]
    if numbers[-2:] == [0.0, 0.0]:  # models of before drivers had noise levels and vigilance keep their names
        del numbers[-2:]
    digest.update(np.array(numbers, dtype="<f8").tobytes())
    return digest.hexdigest()[:16]
