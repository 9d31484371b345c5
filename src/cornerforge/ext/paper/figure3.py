"""Figure 3: how near others come to the AV, in natural traffic and with the adversary."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.avs import av_hash
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.policy_file import policy_hash
from cornerforge.ext.paper.bench import BOUNDED, FREE, Adversary, Bench
from cornerforge.ext.paper.item import Finding, Item, Row
from cornerforge.intervals import poisson_interval
from cornerforge.sim import runner, statistics
from cornerforge.types import METRES_PER_MILE

__all__ = ["FIGURE3"]

EXPOSURE_TESTS = 1 << 42
"""Number of the first test that is counted here, in each world."""
BLOCKS = 20
"""Number of blocks for the jackknife; each test belongs to one block as a whole."""
_CHUNK = 32
_NEAR = {"bbd_front": 10.0, "bbd_rear": 10.0, "ttc_front": 5.0, "ttc_rear": 5.0}
"""Limits of "near"; edges of bins."""
LABELS = {
    "bbd_front": "BBD to the vehicle ahead",
    "bbd_rear": "BBD to the vehicle behind",
    "ttc_front": "TTC with the vehicle ahead",
    "ttc_rear": "TTC with the vehicle behind",
}
_NATURAL, _ADVERSARY, _BOUNDED = "natural", "adversary", "bounded adversary"
_DEFINITIONS = (
    "Counted is once a second, at the moments at which BVs decide, from the start of a test to the last such moment "
    "before its end. Vehicle ahead, behind: the nearest one in the lane that the AV keeps or changes to (one that is "
    "entering that lane is in it) that does not overlap the AV lengthwise, within 200 m centre to centre.",
    "BBD, bumper-to-bumper distance [m]: between the facing bumpers, along the road. TTC, time to collision [s]: BBD "
    "over closing speed, only when closing. Seconds without such a vehicle, or not closing, are in no histogram; the "
    "table says how many there are.",
    "Everything is per mile that the AV drove: a curve's height is the seconds per mile spent at each metre of BBD, or "
    "at each second of TTC. Intervals: jackknife over 20 blocks of whole tests.",
)


class _Exposure(NamedTuple):
    """Counts of one world by block: (BLOCKS, 4, bins) samples, and (BLOCKS,) AV seconds and miles."""

    samples: NDArray[np.int64]
    seconds: NDArray[np.int64]
    miles: NDArray[np.float64]
    tests: int


def _count(bench: Bench, run: Experiment, label: str) -> dict[str, Any]:
    """Drive until the AV has travelled the effort's miles and every block has a test."""
    runner.warm_up(run.setting, run.slots)
    widest = max(grid.bins for grid in statistics.EXPOSURE)
    samples = np.zeros((BLOCKS, len(statistics.EXPOSURE), widest), dtype=np.int64)
    seconds, miles, tests = np.zeros(BLOCKS, dtype=np.int64), np.zeros(BLOCKS), 0
    chunks = runner.simulate_chunks(
        run.setting, run.slots, seed=bench.seed, first=EXPOSURE_TESTS, tests=10**9, threads=bench.threads,
        counting=True, chunk=_CHUNK,
    )  # fmt: skip
    for number, (_, outcomes, counts) in enumerate(chunks):
        block = number % BLOCKS
        samples[block] += counts.histograms[
            len(statistics.TRAFFIC) : len(statistics.TRAFFIC) + len(statistics.EXPOSURE), :widest
        ]
        seconds[block] += counts.totals[statistics.AV_STATES]
        miles[block] += float(outcomes.distance.sum()) / METRES_PER_MILE
        tests += outcomes.code.size
        bench.progress(f"exposure ({label})", min(float(miles.sum()), bench.size.miles), bench.size.miles)
        if number + 1 >= BLOCKS and miles.sum() >= bench.size.miles:
            break
    chunks.close()
    return {"samples": samples.tolist(), "seconds": seconds.tolist(), "miles": miles.tolist(), "tests": tests}


def _exposure(bench: Bench, name: str, adversary: Adversary | None) -> _Exposure:
    run = bench.experiment("idm-mobil", adversary)
    made_of = {"av_hash": av_hash(run.av), "policy": None if run.policy is None else policy_hash(run.policy)}
    kept = bench.kept(f"exposure.{name}", made_of, lambda: _count(bench, run, name))
    samples, seconds, miles = (np.array(kept[part]) for part in ("samples", "seconds", "miles"))
    return _Exposure(samples, seconds, miles, kept["tests"])


def _median(grid: statistics.HistogramGrid, counts: NDArray[np.int64]) -> float:
    """Median of a histogram, linear within its bin; NaN without a sample, +inf beyond the grid (the last bin)."""
    cumulative = np.concatenate([[0], np.cumsum(counts[: grid.bins])])
    total = int(cumulative[-1])
    if total == 0:
        return math.nan
    if 2 * int(cumulative[-2]) < total:
        return math.inf
    return float(np.interp(0.5 * total, cumulative, statistics.grid_edges(grid)))


def _near_per_mile(grid: statistics.HistogramGrid, counts: NDArray[np.int64], miles: float) -> float:
    """Seconds per mile at values below the limit of `_NEAR`."""
    bins = round((_NEAR[grid.name] - grid.low) / grid.width)
    return float(counts[:bins].sum()) / miles


def _jackknifed(world: _Exposure, row: int, kind: str) -> tuple[float, float]:
    """A quantity of a world and its standard error by the delete-one jackknife over blocks; NaN or inf if unknown."""
    grid = statistics.EXPOSURE[row]

    def value(counts: NDArray[np.int64], miles: float) -> float:
        return _median(grid, counts) if kind == "median" else _near_per_mile(grid, counts, miles)

    total, miles = world.samples[:, row].sum(axis=0), float(world.miles.sum())
    without = np.array([value(total - world.samples[b, row], miles - float(world.miles[b])) for b in range(BLOCKS)])
    if not np.isfinite(without).all():
        return value(total, miles), math.nan
    spread = float(np.sqrt((BLOCKS - 1) / BLOCKS * ((without - without.mean()) ** 2).sum()))
    return value(total, miles), spread


def _row(what: str, found: tuple[float, float], grid: statistics.HistogramGrid, unit: str, miles: float) -> Row:
    value, spread = found
    if value == 0.0:  # blocks that all have none say nothing of how rare it is
        none = "none seen; the end of the interval takes each second for an event of its own (Poisson)"
        return Row(what, None, value, (0.0, poisson_interval(0)[1] / miles), unit, none)
    if not math.isfinite(value):
        beyond = f"beyond {statistics.grid_edges(grid)[-2]:g} {grid.unit}, where the grid ends"
        return Row(what, None, None, None, unit, beyond if math.isinf(value) else "no sample")
    ends = (max(0.0, value - 1.96 * spread), value + 1.96 * spread) if math.isfinite(spread) else None
    return Row(what, None, value, ends, unit)


def _ratio_row(what: str, paper: str | None, hostile: tuple[float, float], natural: tuple[float, float]) -> Row:
    """Adversary over natural, its interval from the log scale; no value where one of them is 0 or unknown."""
    (a, da), (b, db) = hostile, natural
    if a > 0.0 and b > 0.0 and math.isfinite(a) and math.isfinite(b):
        half = 1.96 * math.hypot(da / a, db / b)
        ends = (a / b * math.exp(-half), a / b * math.exp(half)) if math.isfinite(half) else None
        return Row(what, paper, a / b, ends)
    why = "natural traffic has none, so there is no ratio" if b == 0.0 else "one of the two is 0 or unknown"
    return Row(what, paper, None, None, "", why)


def _rows(worlds: dict[str, _Exposure]) -> list[Row]:
    rows = []
    for index, grid in enumerate(statistics.EXPOSURE):
        label, unit = LABELS[grid.name], grid.unit
        near = f"seconds per mile with {label} below {_NEAR[grid.name]:g} {unit}"
        for kind, what, of in (("median", f"median {label}", unit), ("near", near, "s per mile")):
            found = {name: _jackknifed(world, index, kind) for name, world in worlds.items()}
            rows += [
                _row(f"{what}, {name}", value, grid, of, float(worlds[name].miles.sum()))
                for name, value in found.items()
            ]
            paper = "below 1" if kind == "median" else "above 1"
            for name in [name for name in worlds if name != _NATURAL]:
                said = paper if name == _ADVERSARY else None
                rows.append(_ratio_row(f"{what}: {name} / natural", said, found[name], found[_NATURAL]))
    return rows


def compute(bench: Bench) -> Finding:
    """Natural traffic, the adversary, and the bounded one; at least the wished miles of the AV in each."""
    worlds = {
        _NATURAL: _exposure(bench, "natural", None),
        _ADVERSARY: _exposure(bench, "adversary", FREE),
        _BOUNDED: _exposure(bench, "bounded", BOUNDED),
    }
    rows = [
        Row(
            f"miles of the AV, {name}", None if name == _BOUNDED else 50, miles, None, "miles", f"{world.tests:,} tests"
        )
        for name, world in worlds.items()
        for miles in (float(world.miles.sum()),)
    ]
    rows += _rows(worlds)
    rows += _shares(worlds)
    headline = next(row for row in rows if row.what == _ratio_of("bbd_front"))
    return Finding(headline, rows, _drawn(worlds), [*_DEFINITIONS, *_compared(rows), *_WHY])


def _ratio_of(quantity: str) -> str:
    """Name of the row that compares the medians of a quantity."""
    return f"median {LABELS[quantity]}: {_ADVERSARY} / natural"


def _shares(worlds: dict[str, _Exposure]) -> list[Row]:
    """How many of the AV's seconds have a vehicle ahead or behind at all, or a closing one."""
    rows = []
    for index, grid in enumerate(statistics.EXPOSURE):
        kind = "one" if grid.name.startswith("bbd") else "a closing one"
        side = "ahead" if grid.name.endswith("front") else "behind"
        for name, world in worlds.items():
            share = float(world.samples[:, index].sum() / max(1, world.seconds.sum()))
            rows.append(Row(f"share of seconds with {kind} {side}, {name}", None, share))
    return rows


def _drawn(worlds: dict[str, _Exposure]) -> dict[str, Any]:
    """Histograms without their last bin, which holds all beyond the grid."""
    quantities = {}
    for index, grid in enumerate(statistics.EXPOSURE):
        counted = {
            name: world.samples[:, index, : grid.bins - 1].sum(axis=0).tolist() for name, world in worlds.items()
        }
        quantities[grid.name] = {
            "label": LABELS[grid.name],
            "unit": grid.unit,
            "edges": statistics.grid_edges(grid)[:-1].tolist(),
            "counts": counted,
        }
    return {"quantities": quantities, "miles": {name: float(world.miles.sum()) for name, world in worlds.items()}}


def _compared(rows: list[Row]) -> list[str]:
    """Say which quantities are smaller with the adversary, as the paper says, and which are not; from the intervals."""
    found = {row.what: row for row in rows}
    groups: dict[str, list[str]] = {"smaller": [], "not smaller": [], "not told apart": []}
    for grid in statistics.EXPOSURE:
        near = next(row for what, row in found.items() if what.endswith(f": {_ADVERSARY} / natural") and "below" in what
                    and LABELS[grid.name] in what)  # fmt: skip
        median = found[_ratio_of(grid.name)]
        for row, sign in ((median, 1), (near, -1)):
            if row.interval is None:
                continue
            low, high = row.interval
            is_smaller, is_larger = (high < 1.0, low > 1.0) if sign > 0 else (low > 1.0, high < 1.0)
            kind = "smaller" if is_smaller else "not smaller" if is_larger else "not told apart"
            groups[kind].append(f"{row.what.partition(':')[0]} ({row.ours:.3g} times)")
    texts = {
        "smaller": "As in the paper, the adversary's world is the nearer and more urgent one by: ",
        "not smaller": "Against the paper, it is the farther one by: ",
        "not told apart": "Too few miles to tell: ",
    }
    return [f"{texts[kind]}{'; '.join(names)}." for kind, names in groups.items() if names]


_WHY = (
    "The paper shows the histograms only and states neither numbers nor definitions (same lane or any, which moments, "
    "what counts while not closing), so only the direction can be compared.",
    "Where ours differ. In natural traffic our AV keeps the gap that it wants (IDM: 5 m and 1.5 s), so hardly any BBD "
    "ahead is short; who comes near is behind, for BVs follow more closely than it does. Our adversary attacks from "
    "beside: while it is level with the AV it is neither ahead nor behind, so it shows only in the seconds before and "
    "after, and a test that ends in a crash adds no more seconds. The bounded adversary may only do what natural "
    "drivers do; how far that moves the histograms is what its line shows.",
)


FIGURE3 = Item(
    id="figure3",
    title="Figure 3: distances and times to collision",
    place="Figure 3; section Corner Case Generation",
    says=(
        "Over about 50 miles each, the tested vehicle has much smaller bumper-to-bumper distance and TTC, with the "
        "front and the rear car, in the generation environment than in the NDE."
    ),
    compute=compute,
)
