"""The numbers behind every chart, as tables: for readers who cannot see charts or who want digits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.conduct import CONDUCTS
from cornerforge.intervals import binomial_interval
from cornerforge.report import text
from cornerforge.report.figures import density
from cornerforge.report.judged import FAULT_WORDS
from cornerforge.report.kinds import kind_in_words
from cornerforge.results import Analysed, NaturalRate, Simulated
from cornerforge.results.analysis import Coverage, Judges, Natural
from cornerforge.results.driving import CasesMade
from cornerforge.results.learning import TrainingCurve
from cornerforge.results.rates import Counted, Rate
from cornerforge.results.whole import Exposed

__all__ = [
    "HeatCell",
    "HeatRow",
    "Table",
    "agreement_table",
    "cluster_table",
    "coverage_rows",
    "crash_type_table",
    "discovery_table",
    "exposure_table",
    "loading_table",
    "natural_table",
    "provenance_table",
    "rate_table",
    "reaction_table",
    "severity_table",
    "share_table",
    "training_table",
]


@dataclass(frozen=True)
class Table:
    """A table of texts; the first column names the row."""

    caption: str
    head: list[str]
    rows: list[list[str]]


def rate_table(rates: Mapping[str, Counted]) -> Table:
    """Crash rates with their intervals, by what drives the others."""
    head = ["who drives the others", "drives", "crashes", "crashes per drive", "95 % interval", "crashes per mile"]
    rows = [
        [
            name,
            text.count(r.tests),
            text.count(r.av_crashes) if isinstance(r, CasesMade | Simulated | NaturalRate) else "–",
            f"below {text.rate(r.bound, 2)}" if r.is_bound else text.rate(r.crashes_per_test, r.digits),
            text.interval(*r.interval95, r.digits),
            _per_mile(r),
        ]
        for name, r in rates.items()
    ]
    return Table("Crashes of the AV; the unit is the drive", head, rows)


def _per_mile(rate: Counted) -> str:
    """Crashes per mile; where none was seen, what they are below."""
    if not isinstance(rate, Rate):
        return "–"
    if rate.is_bound:
        return "–" if not rate.miles else f"below {text.rate(rate.bound * rate.tests / rate.miles, 2)}"
    return "–" if rate.crashes_per_mile is None else text.rate(rate.crashes_per_mile)


def natural_table(found: Natural) -> Table:
    """How often each kind of natural crash happens, kind by kind."""
    kinds = {"all crashes": found.all}
    kinds |= {kind_in_words(name): kind for name, kind in found.mechanisms.items()}
    kinds |= {f"crash type: {text.plain(name)}": kind for name, kind in found.crash_types.items()}
    kinds |= {f"at fault (RSS): {_who(name)}": kind for name, kind in found.fault.items()}
    kinds |= {f"the AV's part: {CONDUCTS[name]}": kind for name, kind in (found.conducts or {}).items()}
    kinds |= {f"prevented by {name}": kind for name, kind in (found.prevented_by or {}).items()}
    if found.avoidable is not None:
        kinds[f"avoidable by the AV, {found.avoidable_after_s or 0.0:g} s after the manoeuvre began"] = found.avoidable
    kinds["a serious injury in the AV (MAIS 3 or more)"] = found.serious_injuries
    rows = [
        [
            name,
            text.count(kind.cases),
            text.share(kind.share),
            text.miles(kind.miles_between),
            text.miles_range(*kind.interval95_miles),
        ]
        for name, kind in kinds.items()
    ]
    return Table(
        "Crashes of the AV in natural traffic",
        ["what", "cases", "share", "once in", "95 % interval (chance only)"],
        rows,
    )


def _who(fault: str) -> str:
    return {str(key): word for key, word in FAULT_WORDS.items()}.get(fault, fault)


def training_table(training: TrainingCurve) -> Table:
    """Every recorded point of the training."""
    head = ["decisions", "time [s]", "crashes per drive", "drives", "random actions", "loss"]
    rows = [
        [
            text.count(point.decisions),
            _number(point.seconds, ".1f"),
            _number(point.crashes_per_test, ".4f"),
            str(point.tests),
            _number(point.epsilon, ".3f"),
            _number(point.loss, ".3g"),
        ]
        for point in training.points
    ]
    return Table("Training, one row per recorded point", head, rows)


def exposure_table(histogram: Exposed) -> Table:
    """Counts and densities of one quantity in both worlds."""
    unit = histogram.unit
    head = [
        f"from [{unit}]",
        f"to [{unit}]",
        "natural samples",
        f"natural [1/{unit}]",
        "adversary samples",
        f"adversary [1/{unit}]",
    ]
    nde, adversary = density(histogram, histogram.nde), density(histogram, histogram.adversary)
    rows = [
        [
            f"{histogram.edges[i]:g}",
            f"{histogram.edges[i + 1]:g}",
            text.count(histogram.nde[i]),
            f"{nde[i]:.4g}",
            text.count(histogram.adversary[i]),
            f"{adversary[i]:.4g}",
        ]
        for i in range(len(nde))
    ]
    return Table(f"{histogram.label}, sampled once a second", head, rows)


def crash_type_table(analysis: Analysed) -> Table:
    """Cases by crash type."""
    total = max(1, sum(analysis.crash_types.values()))
    ordered = sorted(analysis.crash_types.items(), key=lambda item: -item[1])
    rows = [[text.plain(name), text.count(n), f"{100 * n / total:.1f} %"] for name, n in ordered]
    return Table("Cases by crash type", ["crash type", "cases", "share"], rows)


def share_table(caption: str, kind: str, counts: dict[str, int], cases: int) -> Table:
    """Cases of each kind with their share of `cases` and its exact interval."""
    rows = []
    for name, n in counts.items():
        low, high = binomial_interval(n, cases)
        rows.append([name, text.count(n), text.share(n / cases), f"{text.share(low)} to {text.share(high)}"])
    return Table(f"{caption}, n = {text.count(cases)}", [kind, "cases", "share", "95 % interval"], rows)


def reaction_table(found: Judges) -> Table:
    """Share of cases that could have been prevented, by driver and reaction time."""
    head = ["who drives", *(f"{one.reaction_s:g} s" for one in found.avoidable)]
    each = {"the AV, on its last way out": found.avoidable, **found.prevented}
    rows = [
        [
            name,
            *(
                f"{text.share(one.share)} ({text.share(one.interval95[0])} to {text.share(one.interval95[1])})"
                for one in shares
            ),
        ]
        for name, shares in each.items()
    ]
    caption = (
        f"Cases that could have been prevented, by reaction time, with 95 % intervals, n = {text.count(found.cases)}"
    )
    return Table(caption, head, rows)


def agreement_table(found: Judges) -> Table:
    """Shares of cases of which two judges say the same; the last column says how many each calls preventable."""
    names = list(found.agreement)
    rows = [
        [
            a,
            *("–" if a == b else text.share(found.agreement[a][b]) for b in names),
            f"{text.count(found.both[a][a])} of {text.count(found.cases)}",
        ]
        for a in names
    ]
    return Table("Cases of which two judges say the same", ["judge", *names, "calls preventable"], rows)


_SEVERITIES = {
    "impact_speed_mps": "relative speed at contact [m/s]",
    "av_delta_v_mps": "change of the AV's velocity [m/s]",
    "av_injury_probability": "chance of a serious injury (MAIS 3 or more) in the AV",
}


def severity_table(analysis: Analysed) -> Table:
    """Quantiles of how bad the cases are."""
    levels = sorted({level for quantiles in analysis.severity.values() for level in quantiles}, key=float)
    rows = [
        [_SEVERITIES.get(name, name), *("–" if level not in of else text.rate(of[level]) for level in levels)]
        for name, of in analysis.severity.items()
    ]
    return Table("Severity: quantiles over all cases", ["quantity", *(f"{level} %" for level in levels)], rows)


def discovery_table(coverage: Coverage) -> Table:
    """The points of the discovery curve."""
    rows = [[text.count(m), f"{kinds:.2f}"] for m, kinds in coverage.discovery_curve]
    return Table("Kinds expected among cases in random order", ["cases", "kinds"], rows)


@dataclass(frozen=True)
class HeatCell:
    """Cases in a cell; `heat` in [0, 100] rises with the logarithm of their number, 0 for none."""

    cases: int
    heat: int
    name: str


@dataclass(frozen=True)
class HeatRow:
    """A row of the heat table: a crash type, and its cells by avoidability (one group if not searched for), speed."""

    name: str
    groups: list[list[HeatCell]]


def coverage_rows(axes: dict[str, tuple[str, ...]], counts: NDArray[np.int64]) -> list[HeatRow]:
    """The grid of kinds as rows of a table, the first axis down and the others across.

    Args:
        axes: Labels of each of the two or three axes.
        counts: Cases of each kind, one axis each.
    """
    first, *middle, last = axes.values()
    columns = middle[0] if middle else ("",)
    grid = counts.reshape(len(first), len(columns), len(last))
    top = math.log1p(int(grid.max()))

    def cell(i: int, j: int, k: int) -> HeatCell:
        n = int(grid[i, j, k])
        name = ", ".join(label for label in (first[i], columns[j], last[k]) if label)
        return HeatCell(n, round(100 * math.log1p(n) / top), name)

    return [
        HeatRow(row, [[cell(i, j, k) for k in range(len(last))] for j in range(len(columns))])
        for i, row in enumerate(first)
    ]


def cluster_table(analysis: Analysed) -> Table:
    """Clusters with their size, make-up and typical cases."""
    rows = [
        [
            str(cluster.id),
            cluster.group,
            text.count(cluster.size),
            ", ".join(f"{name}: {text.count(n)}" for name, n in cluster.crash_types.items() if n) or "–",
            ", ".join(cluster.typical),
        ]
        for cluster in analysis.clusters
    ]
    return Table(
        "Clusters", ["cluster", "group", "cases", "crash types", "typical cases, nearest to the centre first"], rows
    )


def loading_table(analysis: Analysed) -> Table:
    """Table of the features in the principal components."""
    rows = [[name, f"{pc1:+.3f}", f"{pc2:+.3f}"] for name, (pc1, pc2) in analysis.loadings.items()]
    return Table("Loadings of the standardised features", ["feature", "component 1", "component 2"], rows)


def provenance_table(provenance: Mapping[str, Any]) -> Table:
    """Where the numbers come from, nested keys joined by dots."""
    return Table("Provenance", ["key", "value"], [[key, value] for key, value in _flat(provenance, "")])


def _flat(values: Mapping[str, Any], prefix: str) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            rows.extend(_flat(value, f"{prefix}{key}."))
        else:
            shown = " ".join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((f"{prefix}{key}", shown))
    return rows


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)
