"""Figures: plotly accepts them, and they show what the artefacts say."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from scipy.stats import binomtest

from cornerforge.report import figures, page, tables, text
from cornerforge.report.artefacts import Artefacts, Points, read_artefacts
from cornerforge.report.judged import kind_counts
from cornerforge.results.rates import Counted
from cornerforge.results.whole import Exposed


@pytest.fixture
def artefacts(run_folder: Path) -> Artefacts:
    return read_artefacts(run_folder)


def coloured(node: Any) -> Any:
    """The figure as the browser draws it: style names replaced by a colour."""
    if isinstance(node, dict):
        return {key: coloured(value) for key, value in node.items()}
    if isinstance(node, list):
        return [coloured(value) for value in node]
    return "#000000" if isinstance(node, str) and node.startswith("css:") else node


def exposed(artefacts: Artefacts) -> Mapping[str, Exposed]:
    assert artefacts.exposure is not None
    return {str(name): one for name, one in artefacts.exposure.quantities.items()}


def test_plotly_accepts_every_figure(artefacts: Artefacts) -> None:
    analysis, summary = artefacts.analysis, artefacts.summary
    assert summary.generate is not None
    assert artefacts.training is not None
    assert summary.nde is not None
    none_seen = {"nobody": Counted(tests=100, crashes_per_test=0.0, interval95=(0.0, 0.04))}
    made = [
        figures.rate_figure(summary.rates),
        figures.rate_figure(none_seen),
        figures.map_figure(artefacts.points, analysis, list(analysis.rare[:1]), set(analysis.rare)),
        figures.share_figure(analysis.fault_rules, 60, "share of all cases"),
        figures.share_figure({"none at all": 0, "all": 3}, 3, "share"),
        figures.discovery_figure(analysis.coverage),
        figures.training_figure(artefacts.training, summary.nde),
        *(figures.exposure_figure(h) for h in exposed(artefacts).values()),
    ]
    for figure in made:
        go.Figure(coloured(figure))
    with pytest.raises(ValueError, match="Invalid"):  # the check can fail
        go.Figure(coloured(made[0]) | {"layout": {"xaxis": {"type": "logarithm"}}})


def test_axes_carry_units(artefacts: Artefacts) -> None:
    for key, histogram in exposed(artefacts).items():
        layout = figures.exposure_figure(histogram)["layout"]
        unit = "m" if key.startswith("bbd") else "s"
        assert layout["xaxis"]["title"]["text"].endswith(f"[{unit}]")
        assert layout["yaxis"]["title"]["text"].endswith(f"[1/{unit}]")


def test_densities_have_area_one(artefacts: Artefacts) -> None:
    for histogram in exposed(artefacts).values():
        for counts in (histogram.nde, histogram.adversary):
            area = float((figures.density(histogram, counts) * np.diff(histogram.edges)).sum())
            assert area == pytest.approx(1.0)
        assert not figures.density(histogram, [0] * len(histogram.nde)).any()


@pytest.mark.parametrize(("crashes", "tests"), [(0, 800), (1, 5), (200, 800), (7, 7)])
def test_the_training_band_is_the_exact_interval(artefacts: Artefacts, crashes: int, tests: int) -> None:
    assert artefacts.training is not None
    assert artefacts.summary.nde is not None
    point = dataclasses.replace(artefacts.training.points[-1], tests=tests, crashes_per_test=crashes / tests)
    curve = dataclasses.replace(artefacts.training, points=(point,))
    high, low = figures.training_figure(curve, artefacts.summary.nde)["data"][0]["y"]
    theirs = binomtest(crashes, tests).proportion_ci(method="exact")
    assert (low, high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_the_map_shows_every_case_once_and_marks_the_valuable(artefacts: Artefacts) -> None:
    analysis = artefacts.analysis
    typical = {case for cluster in analysis.clusters for case in cluster.typical}
    top = [case.case_id for case in analysis.value.top]
    made = figures.map_figure(artefacts.points, analysis, top, typical | set(analysis.rare) | set(top[1:]))["data"]
    *clusters, typical_trace, rare_trace, top_trace = made
    shown = [case for trace in clusters for case in trace["customdata"]]
    assert sorted(shown) == sorted(artefacts.points.case_id)
    assert set(typical_trace["customdata"]) == typical
    assert set(rare_trace["customdata"]) == set(analysis.rare)
    assert set(top_trace["customdata"]) == set(top) & (typical | set(analysis.rare) | set(top[1:]))


def test_a_large_cluster_is_thinned(artefacts: Artefacts, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "MAX_POINTS", 5)
    made = figures.map_figure(artefacts.points, artefacts.analysis, [], set())["data"]
    assert max(len(trace["x"]) for trace in made) == 5
    # The legend still says how many there are.
    assert f"({max(cluster.size for cluster in artefacts.analysis.clusters)})" in made[0]["name"]


def test_all_points_together_stay_small(artefacts: Artefacts) -> None:
    n = 100_000
    ids = [f"2918264622725855778:{i}" for i in range(n)]
    cluster = np.arange(n) % 16
    group = np.where(cluster < 8, "majority", "minority").tolist()
    zeros = np.zeros(n)
    many = Points(ids, zeros + 1.234, zeros - 2.345, group, cluster, ["rear-end by BV"] * n)
    figure = figures.map_figure(many, artefacts.analysis, [], set())
    assert len(figure["data"]) == 16 + 3
    assert sum(len(trace["x"]) for trace in figure["data"]) <= 12_000
    size = len(json.dumps(figure, separators=(",", ":")))
    assert 4_900_000 + page.CASE_BYTES + size < 9_500_000, "plotly, cases and points, of at most 10 MB"


def test_no_two_clusters_share_a_colour_or_a_symbol(artefacts: Artefacts) -> None:
    n = len(artefacts.points.case_id)
    many = dataclasses.replace(artefacts.points, cluster=np.arange(n) % 8, group=["majority"] * n)
    for points in (artefacts.points, many):
        markers = [trace["marker"] for trace in figures.map_figure(points, artefacts.analysis, [], set())["data"][:-3]]
        clusters = len(np.unique(points.cluster))
        assert len({marker["color"] for marker in markers}) == clusters > 2
        assert len({marker["symbol"] for marker in markers}) == clusters


def test_the_loss_has_few_ticks_within_its_range() -> None:
    for low, high in ((0.003, 0.02), (0.0021, 0.0029), (1e-5, 3.0), (0.5, 0.5)):
        ticks = figures._few_ticks([None, low, high])["tickvals"]
        assert len(ticks) <= 7
        assert all(0.9 * low <= tick <= 1.1 * high for tick in ticks)
    assert figures._few_ticks([0.003, 0.02]) == {"tickvals": [0.005, 0.01, 0.02], "ticktext": ["0.005", "0.01", "0.02"]}


def test_titles_of_axes_fit_a_phone(artefacts: Artefacts) -> None:
    """390 px less margins leave 34 letters of 13 px beside the ticks."""
    exposures = [figures.exposure_figure(h) for h in exposed(artefacts).values()]
    assert artefacts.training is not None
    assert artefacts.summary.nde is not None
    made = [*exposures, figures.training_figure(artefacts.training, artefacts.summary.nde)]
    made.append(figures.map_figure(artefacts.points, artefacts.analysis, [], set()))
    titles = [figure["layout"][axis]["title"]["text"] for figure in made for axis in ("xaxis", "yaxis")]
    assert any("<br>" in title for title in titles)
    assert max(len(line) for title in titles for line in title.split("<br>")) <= 34


@pytest.mark.parametrize(("n", "cases"), [(0, 40), (1, 1500), (735, 1500), (3, 3)])
def test_shares_have_exact_intervals(n: int, cases: int) -> None:
    bars = figures.share_figure({"kind": n}, cases, "share")["data"][0]
    theirs = binomtest(n, cases).proportion_ci(method="exact")
    drawn = [bars["x"][0] - bars["error_x"]["arrayminus"][0], bars["x"][0] + bars["error_x"]["array"][0]]
    assert drawn == pytest.approx([100 * theirs.low, 100 * theirs.high], abs=1e-9)
    (row,) = tables.share_table("cases", "kind", {"kind": n}, cases).rows
    assert row[1:] == [text.count(n), text.share(n / cases), f"{text.share(theirs.low)} to {text.share(theirs.high)}"]


def test_names_in_bars_cannot_be_markup() -> None:
    (label,) = figures.share_figure({"<b>no vehicle behind did brake": 1}, 2, "share")["data"][0]["y"]
    assert label == "&lt;b&gt;no vehicle behind did<br>brake<br>1 (50.0 %)"


def test_heat_is_there_where_cases_are(artefacts: Artefacts) -> None:
    counts = kind_counts(artefacts.analysis.coverage)
    cells = [
        cell
        for row in tables.coverage_rows(artefacts.analysis.coverage.axes, counts)
        for group in row.groups
        for cell in group
    ]
    assert [cell.cases for cell in cells] == counts.ravel().tolist()
    assert all((cell.heat > 0) == (cell.cases > 0) for cell in cells)
    assert max(cell.heat for cell in cells) == 100


def test_a_grid_without_avoidability_has_one_group(artefacts: Artefacts) -> None:
    axes = artefacts.analysis.coverage.axes
    kind, _, speed = axes
    counts = kind_counts(artefacts.analysis.coverage).sum(axis=1)
    rows = tables.coverage_rows({kind: axes[kind], speed: axes[speed]}, counts)
    assert [len(row.groups) for row in rows] == [1] * len(axes[kind])
    assert [cell.cases for row in rows for cell in row.groups[0]] == counts.ravel().tolist()
    assert rows[0].groups[0][0].name == f"{axes[kind][0]}, {axes[speed][0]}"
