"""The page's charts for a paper: every one can be drawn, with the page's numbers, at the size of print."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from paper_figures import read_pdf

from cornerforge.ext.pictures.printed import CAPTIONS, print_chart
from cornerforge.ext.pictures.printing import print_of
from cornerforge.report.artefacts import read_artefacts
from cornerforge.report.figures import Figure
from cornerforge.report.page import charts_of

pytestmark = pytest.mark.full


@pytest.fixture
def charts(run_folder: Path) -> dict[str, Figure]:
    found = read_artefacts(run_folder)
    return charts_of(found, set(found.points.case_id))


def test_every_chart_of_the_page_can_be_printed(charts: dict[str, Figure]) -> None:
    assert set(charts) <= set(CAPTIONS), "a chart of the page needs a caption for the paper"
    assert len(charts) > 10
    for name, chart in charts.items():
        for width in (3.5, 7.16):
            drawing = print_chart(chart, width)
            pdf = read_pdf(print_of(drawing, ".pdf"))
            assert pdf.size[0] == pytest.approx(width), name
            assert 8.0 in pdf.points, name
            assert pdf.points <= {8.0, 5.6}, f"{name}: all text is of 8 pt, exponents of 0.7 of it"
            assert pdf.fonts == {"Type0", "CIDFontType2"}, name
            assert not pdf.says_when, name


def test_nothing_is_cut_off(charts: dict[str, Figure]) -> None:
    """All text lies within the figure."""
    for name, chart in charts.items():
        drawing = print_chart(chart, 3.5)
        canvas = FigureCanvasAgg(drawing)
        canvas.draw()  # lays it out
        whole = drawing.bbox
        tight = drawing.get_tightbbox(canvas.get_renderer())  # in inches
        assert tight.x0 >= -0.02, name
        assert tight.y0 >= -0.02, name
        assert tight.x1 <= whole.width / drawing.dpi + 0.02, name
        assert tight.y1 <= whole.height / drawing.dpi + 0.02, name


def test_the_numbers_are_those_of_the_page(charts: dict[str, Figure]) -> None:
    (axes,) = print_chart(charts["fault"], 3.5).axes
    assert [bar.get_width() for bar in axes.patches] == charts["fault"]["data"][0]["x"]
    (axes,) = print_chart(charts["discovery"], 3.5).axes
    np.testing.assert_allclose(axes.lines[0].get_xdata(), charts["discovery"]["data"][0]["x"])
    assert axes.get_xscale() == "log"
    (axes,) = print_chart(charts["map"], 3.5).axes
    drawn = sum(len(one.get_offsets()) for one in axes.collections)
    assert drawn == sum(len(trace["x"]) for trace in charts["map"]["data"])
    (axes,) = print_chart(charts["rates"], 3.5).axes
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels[0].startswith("adversary\nn =")
    assert labels[-1].startswith("natural traffic")
    assert axes.get_ylim()[0] > axes.get_ylim()[1], "the first is on top"


def test_the_same_bytes_again(charts: dict[str, Figure]) -> None:
    for suffix in (".pdf", ".svg"):
        first, second = (print_of(print_chart(charts["training"], 3.5), suffix) for _ in range(2))
        assert first == second
