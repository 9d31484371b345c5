"""Strips of snapshots: to one scale, at the moments that matter, ready for print."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from paper_figures import read_pdf

from cornerforge.errors import InputError
from cornerforge.ext.pictures.printing import WIDTHS, print_of
from cornerforge.ext.pictures.strip import key_moments, strip_figure
from cornerforge.types import Scenario

MakeScenario = Callable[[int, str], Scenario]


@pytest.fixture
def scenario(make_scenario: MakeScenario) -> Scenario:
    return make_scenario(3, "cut-in")


@pytest.mark.parametrize("width", WIDTHS.values())
def test_a_metre_is_as_long_everywhere(scenario: Scenario, width: float) -> None:
    """Read off the bodies: every car is 5 m by 2 m, all snapshots on one scale, whatever the width."""
    drawing = strip_figure(scenario, [3.0, 2.0, 1.0, 0.0], width=width)
    assert drawing.get_size_inches()[0] == width
    drawing.canvas.draw()
    scales = []
    for axes in drawing.axes:
        bodies = max(axes.collections, key=lambda one: len(one.get_paths()) if one.zorder == 2 else -1)
        for body in bodies.get_paths():
            corners = axes.transData.transform(body.vertices[:4]) / drawing.dpi
            along, across = np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[0] - corners[3])
            scales += [along / 5.0, across / 2.0]
    assert len(drawing.axes) == 4
    assert len(scales) > 8
    np.testing.assert_allclose(scales, scales[0], rtol=1e-6)


def test_what_matters_is_shown(scenario: Scenario) -> None:
    assert scenario.crash is not None
    last = len(scenario.x) - 1
    braking = scenario.acceleration.copy()
    braking[last - 12 :, 0] = -4.0  # from 1.2 s before the contact on
    found = key_moments(replace(scenario, acceleration=braking), {2.0: "the manoeuvre begins", 1.1: "last way out"})
    assert list(found) == sorted(found, reverse=True)
    assert found[0.0] == "contact"
    assert found[2.0] == "the manoeuvre begins"
    assert found[1.1] == "the AV brakes; last way out", "two moments that look the same are one"
    assert len(found) == 4
    quiet = replace(scenario, acceleration=np.zeros_like(braking))
    assert list(key_moments(quiet, {3.0: "begins"}).values()) == ["begins", "", "", "contact"]


@pytest.mark.parametrize(
    ("times", "why"), [([99.0], "outside the recording"), ([], "0 moments"), ([float("nan")], "outside")]
)
def test_moments_that_cannot_be_shown(scenario: Scenario, times: list[float], why: str) -> None:
    with pytest.raises(InputError, match=why):
        strip_figure(scenario, times, width=3.5)
    with pytest.raises(InputError, match="holds no crash of the AV"):
        key_moments(replace(scenario, crash=None), {})


@pytest.mark.full
def test_a_pdf_for_print(scenario: Scenario) -> None:
    def drawn() -> Any:
        return print_of(strip_figure(scenario, [1.0, 0.0], width=3.5), ".pdf")

    pdf = read_pdf(drawn())
    assert pdf.size[0] == pytest.approx(3.5)
    assert pdf.points == {8.0}
    assert pdf.fonts == {"Type0", "CIDFontType2"}, "TrueType whose letters are text, no pictures of letters (Type 3)"
    assert pdf.embedded >= 1
    assert not pdf.says_when
    assert drawn() == drawn()


def test_an_svg_for_print(scenario: Scenario) -> None:
    drawn = [print_of(strip_figure(scenario, [1.0, 0.0], width=3.5), ".svg").decode() for _ in range(2)]
    assert drawn[0] == drawn[1]
    assert 'width="252pt"' in drawn[0]
    assert "<text" not in drawn[0], "letters are paths: the same everywhere"
    assert "<image" not in drawn[0]
    assert not re.search(r"<dc:date>|matplotlib\.org", drawn[0])
