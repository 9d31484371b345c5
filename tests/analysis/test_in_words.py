"""Sentences on crashes driven by hand: who moved, from which side, how close, how hard; and how often."""

from __future__ import annotations

import math

import pytest
from driven_by_hand import Driver, mirrored, scenario_of

from cornerforge.analysis.in_words import case_in_words, miles_between, what_happened

CUT_IN = [Driver(0, 1, 35), Driver(46, 0, 25, ((1, 1),))]


@pytest.mark.parametrize(
    ("drivers", "text"),
    [
        (CUT_IN, "BV cuts in from the right at 31 m"),
        (
            [Driver(0, 1, 33), Driver(12, 0, 30, ((0, 1),), (1, 4, -4.0))],
            "BV cuts in from the right at 7 m with -4.0 m/s2",
        ),
        ([Driver(0, 1, 30), Driver(1, 0, 30, ((1, 1),))], "BV changes lanes from the right into the AV beside it"),
        ([Driver(0, 0, 30, ((1, 1),)), Driver(1, 1, 30)], "AV changes lanes from the right into the BV beside it"),
        ([Driver(0, 1, 25), Driver(-46, 0, 35, ((1, 1),))], "BV changes lanes from the right, 31 m behind the AV"),
        ([Driver(0, 1, 30), Driver(15, 1, 30, braking=(3, 6, -4.0))], "BV brakes with -4.0 m/s2 in front of the AV"),
        ([Driver(0, 1, 30, braking=(3, 6, -4.0)), Driver(-15, 1, 30)], "AV brakes with -4.0 m/s2 in front of the BV"),
        (
            [Driver(0, 1, 30), Driver(40, 1, 25)],
            "AV runs into the rear of a BV that neither brakes hard nor changed lanes into its path",
        ),
    ],
)  # fmt: skip
def test_what_happened(drivers: list[Driver], text: str) -> None:
    scenario = scenario_of(drivers)
    assert what_happened(scenario) == text
    swapped = text.replace("the right", "the LEFT").replace("the left", "the right").replace("the LEFT", "the left")
    assert what_happened(mirrored(scenario)) == swapped


def test_the_whole_sentence() -> None:
    scenario = scenario_of(CUT_IN)
    assert case_in_words(scenario, "avoidable by braking until 1.2 s before impact", -18.7) == (
        "BV cuts in from the right at 31 m; avoidable by braking until 1.2 s before impact; about once in 3e7 miles"
    )
    assert case_in_words(scenario, "", -27.0).endswith("about once in 1e11 miles")
    assert case_in_words(scenario, "", -40.0).endswith("at 31 m; less than once in 1e12 miles")
    assert case_in_words(scenario, "", -math.inf).endswith("at 31 m; natural drivers never do this")
    assert case_in_words(scenario, "", math.nan) == "BV cuts in from the right at 31 m"


def test_miles_between() -> None:
    """A likelihood of 1 in every test of 400 m is once in a quarter of a mile."""
    assert miles_between(0.0, 400.0) == pytest.approx(0.2485, abs=1e-4)
    assert miles_between(math.log(1e-8), 400.0) == pytest.approx(0.2485e8, rel=1e-3)
    assert math.isinf(miles_between(-math.inf, 400.0))
