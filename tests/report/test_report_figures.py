"""Figures: plotly accepts them, and they show what the artefacts say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from scipy.stats import binomtest

from cornerforge.report import figures
from cornerforge.report.artefacts import Artefacts, Rate, read_artefacts


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


def test_plotly_accepts_every_figure(artefacts: Artefacts) -> None:
    analysis = artefacts.analysis
    none_seen = Rate("nobody", 100, 0.0, 0.0, 0.04)
    made = [
        figures.rate_figure([artefacts.generate, *artefacts.baselines], artefacts.nde),
        figures.rate_figure([none_seen], none_seen),
        figures.crash_type_figure(analysis),
        figures.map_figure(artefacts.points, analysis, set(analysis.rare)),
        figures.training_figure(artefacts.training, artefacts.nde),
        *(figures.exposure_figure(h) for h in artefacts.exposure.values()),
    ]
    for figure in made:
        go.Figure(coloured(figure))
    with pytest.raises(ValueError, match="Invalid"):  # the check can fail
        go.Figure(coloured(made[0]) | {"layout": {"xaxis": {"type": "logarithm"}}})


def test_axes_carry_units(artefacts: Artefacts) -> None:
    for key, histogram in artefacts.exposure.items():
        layout = figures.exposure_figure(histogram)["layout"]
        unit = "m" if key.startswith("bbd") else "s"
        assert layout["xaxis"]["title"]["text"].endswith(f"[{unit}]")
        assert layout["yaxis"]["title"]["text"].endswith(f"[1/{unit}]")


def test_densities_have_area_one(artefacts: Artefacts) -> None:
    for histogram in artefacts.exposure.values():
        for counts in (histogram.nde, histogram.adversary):
            area = float((figures.density(histogram, counts) * np.diff(histogram.edges)).sum())
            assert area == pytest.approx(1.0)
        assert not figures.density(histogram, 0 * histogram.nde).any()


@pytest.mark.parametrize(("crashes", "tests"), [(0, 800), (1, 5), (200, 800), (7, 7)])
def test_the_training_band_is_the_score_interval(crashes: int, tests: int) -> None:
    ours = figures.wilson_interval(np.array([crashes / tests]), np.array([float(tests)]))[:, 0]
    theirs = binomtest(crashes, tests).proportion_ci(method="wilson")
    assert ours == pytest.approx([theirs.low, theirs.high], abs=1e-12)


def test_the_map_shows_every_case_once_and_marks_the_valuable(artefacts: Artefacts) -> None:
    analysis = artefacts.analysis
    typical = {case for cluster in analysis.clusters for case in cluster.typical}
    made = figures.map_figure(artefacts.points, analysis, typical | set(analysis.rare))["data"]
    *clusters, typical_trace, rare_trace = made
    shown = [case for trace in clusters for case in trace["customdata"]]
    assert sorted(shown) == sorted(artefacts.points.case_id)
    assert set(typical_trace["customdata"]) == typical
    assert set(rare_trace["customdata"]) == set(analysis.rare)


def test_a_large_cluster_is_thinned(artefacts: Artefacts, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "MAX_POINTS", 5)
    made = figures.map_figure(artefacts.points, artefacts.analysis, set())["data"]
    assert max(len(trace["x"]) for trace in made) == 5
    # The legend still says how many there are.
    assert f"({max(cluster.size for cluster in artefacts.analysis.clusters)})" in made[0]["name"]


def test_bars_are_sorted_and_hold_the_counts(artefacts: Artefacts) -> None:
    bars = figures.crash_type_figure(artefacts.analysis)["data"][0]
    assert bars["x"] == sorted(artefacts.analysis.crash_types.values(), reverse=True)
