"""Closing cut-ins at the lane crossing, compared with cut-ins that instrumented cars recorded."""

from __future__ import annotations

from cornerforge.ext.calibrate.facts import Fact, Measure
from cornerforge.ext.calibrate.free_running import miles_of
from cornerforge.sim import statistics

__all__ = ["CUT_IN_FACTS"]

SPMD = "Safety Pilot Model Deployment (D. Zhao's group): 44,373 closing cut-ins at 25-35 m/s"
_BAND = 2
"""Band of `statistics.CUT_IN_BANDS`: 25 to 35 m/s, where the default environment drives."""
_PERCENTS = (1.0, 5.0, 25.0, 50.0, 75.0)
QUANTILES = {
    "gap": (10.75, 16.4, 31.39, 46.4, 60.99),
    "time_gap": (0.350, 0.529, 0.989, 1.448, 1.890),
    "ttc": (8.62, 14.63, 36.8, 72.7, 161.0),
    "closing_speed": (0.011, 0.049, 0.248, 0.560, 1.167),
}
"""Published quantiles at _PERCENTS [m, s, s, m/s]."""
_SHARES = (
    ("gap below 10 m", "gap", 10.0, 0.00703),
    ("gap below 15 m", "gap", 15.0, 0.0369),
    ("time gap below 0.3 s", "time_gap", 0.3, 0.00437),
    ("time gap below 0.5 s", "time_gap", 0.5, 0.0416),
    ("TTC below 5 s", "ttc", 5.0, 0.00113),
    ("TTC below 10 s", "ttc", 10.0, 0.0172),
)
_PER_MILE = 157_757 / 2e6
_NAMES = {"gap": "gap", "time_gap": "follower's time gap", "ttc": "TTC", "closing_speed": "closing speed"}
_UNITS = {"gap": "m", "time_gap": "s", "ttc": "s", "closing_speed": "m/s"}
_ROWS = {"gap": 0, "time_gap": 1, "ttc": 2, "closing_speed": 3}
_NEAR, _FACTOR = 0.15, 1.5


def _size(counts: statistics.Counts) -> int:
    return int(counts.cut_ins[_BAND, 0].sum())


def _quantile(name: str, percent: float) -> Measure:
    """Return a measure: a quantile; of TTC from the other end, since 1/TTC is counted."""
    row = _ROWS[name]

    def measure(counts: statistics.Counts) -> float | None:
        end = 100.0 - percent if name == "ttc" else percent
        found = statistics.histogram_quantile(statistics.CUT_INS[row], counts.cut_ins[_BAND, row], end)
        if name == "ttc":
            return 1.0 / found if found else None
        return found

    return measure


def _share(name: str, below: float) -> Measure:
    """Return a measure: share of cut-ins with less of a quantity; its limit is an edge of the bins."""
    row = _ROWS[name]
    edge = round((1.0 / below if name == "ttc" else below) / statistics.CUT_INS[row].width)

    def measure(counts: statistics.Counts) -> float | None:
        found = counts.cut_ins[_BAND, row]
        n = int(found.sum())
        return int((found[edge:] if name == "ttc" else found[:edge]).sum()) / n if n else None

    return measure


def _per_mile(counts: statistics.Counts) -> float | None:
    miles = miles_of(counts)
    return int(counts.cut_ins[:, 0].sum()) / miles if miles else None


CUT_IN_FACTS = (
    *(
        Fact(
            f"{_NAMES[name]}, {percent:g} %", _UNITS[name], value, value * (1.0 - _NEAR), value * (1.0 + _NEAR),
            _quantile(name, percent), _size, SPMD, "cut-ins",
        )
        for name, values in QUANTILES.items()
        for percent, value in zip(_PERCENTS, values, strict=True)
    ),
    *(
        Fact(
            f"share with {words}", "", share, share / _FACTOR, share * _FACTOR,
            _share(name, below), _size, SPMD, "cut-ins",
        )
        for words, name, below, share in _SHARES
    ),
    Fact(
        "closing cut-ins at 5-35 m/s", "per vehicle-mile", round(_PER_MILE, 3), _PER_MILE / _FACTOR,
        _PER_MILE * _FACTOR, _per_mile, lambda counts: int(counts.cut_ins[:, 0].sum()),
        "the same: 157,757 in over 2 million miles", "cut-ins",
    ),
)  # fmt: skip
"""At the moment when the centre of the vehicle that cuts in crosses the marking, with a faster vehicle at most 75 m
behind; both BVs. Tolerances are ours: quantiles 15 %, shares and rate a factor of 1.5."""
