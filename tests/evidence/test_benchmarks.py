"""The table of people's rates: each row says where it is from, and units are never mixed."""

from __future__ import annotations

import pytest

from cornerforge.errors import InputError
from cornerforge.ext.evidence.benchmarks import (
    CLAIMS,
    CRASHED,
    PERSONS,
    RATES,
    UNITS,
    Benchmark,
    as_crashed_vehicles,
    benchmarks,
    matching,
    unreported,
)  # fmt: skip
from cornerforge.rates.people import MOTORWAY
from cornerforge.types import METRES_PER_MILE

ROWS = {row.id: row for row in benchmarks()}
ROADS = {"freeway", "surface", "all"}


def test_names_are_unique_and_the_table_is_not_small() -> None:
    assert len(ROWS) == len(benchmarks()) > 40


@pytest.mark.parametrize("row", benchmarks(), ids=lambda row: row.id)
def test_a_row_says_what_it_counts_and_where_it_was_read(row: Benchmark) -> None:
    assert row.unit in UNITS
    assert row.road in ROADS
    assert row.corrected in ("yes", "no", "not said")
    assert all((row.place, row.year, row.outcome, row.source, row.where, row.read_in))
    assert row.doi or row.source == MOTORWAY.source
    assert not (row.checked and "GitHub" in row.read_in), "an account by others is no check"
    if row.unit in RATES:
        assert 1e-3 < row.rate < 20.0, "per million vehicle-miles"
    if row.interval is not None:
        assert row.interval[0] < row.rate < row.interval[1]
    if row.count is not None and row.miles is not None:
        assert row.count / row.miles == pytest.approx(row.rate, rel=1e-3)


def test_people_s_estimate_of_our_own_stands_once() -> None:
    ours = ROWS["cornerforge-motorway"]
    assert ours.rate == pytest.approx(1e6 * MOTORWAY.low)
    assert (ours.unit, ours.checked, ours.interval) == (MOTORWAY.unit, False, None)
    assert 0.2 < ours.rate / ROWS["nhtsa2023-police"].rate < 1.0, "motorways have fewer crashes than all roads"


def test_numbers_of_different_sources_agree() -> None:
    """Under-reporting turns the observed rate of Kusano et al. and of the hub into the corrected one."""
    hidden = unreported("any injury")
    assert ROWS["kusano2024-injury-observed"].rate / (1 - hidden) == pytest.approx(2.80, abs=0.01)
    areas = [ROWS[f"hub2026-injury-{area}"].rate / (1 - hidden) for area in ("phoenix", "san-francisco-bay-area")]
    assert areas == [pytest.approx(1.95, rel=0.02), pytest.approx(6.64, rel=0.02)], "the ends that the hub gives"
    crashed = as_crashed_vehicles(ROWS["nhtsa2024-injury"], ROWS["crss2024-vehicles-injury"].rate)
    assert crashed.rate == pytest.approx(0.92, abs=0.02), "injured involvements by CRSS, as crashla has them"
    for fewer, more in (("serious", "airbag"), ("airbag", "injury")):
        assert ROWS[f"kusano2025-{fewer}"].rate < ROWS[f"kusano2025-{more}"].rate


def test_motorways_of_several_countries_agree() -> None:
    """Germany 2017: counts of Destatis over kilometres of BASt; MAIS 3 or more by BASt's share of all roads."""
    germany = {what: ROWS[f"autobahn2017-{what}"] for what in ("fatal", "mais3", "serious", "injury")}
    killed, serious = germany["fatal"].count, germany["serious"].count
    assert killed is not None
    assert serious is not None
    miles = 246.4e3 / (METRES_PER_MILE / 1e3)
    mais3 = killed + ROWS["bast2015-mais3"].rate * (serious - killed)
    assert germany["mais3"].rate == pytest.approx(mais3 / miles, rel=1e-4)
    rates = [row.rate for row in germany.values()]
    assert rates == sorted(rates)
    assert germany["fatal"].rate == pytest.approx(1.66e-3 * METRES_PER_MILE / 1e3, rel=0.01), "1.66 per 1e9 km"
    for other in ("asfinag2017-fatal", "scotland2016-fatal", "scanlon2026-freeway-fatal", "bts2010-fatal"):
        assert 0.5 < ROWS[other].rate / germany["fatal"].rate < 4.0
    assert as_crashed_vehicles(ROWS["scotland2010-serious"]).rate < germany["serious"].rate
    with pytest.raises(InputError, match="counts persons hurt"):
        as_crashed_vehicles(germany["serious"])
    assert [row.id for row in matching("freeway", "MAIS 3 or more", unit=PERSONS)] == ["autobahn2017-mais3"]


def test_the_best_match_comes_first() -> None:
    assert [row.id for row in matching("freeway", "any injury")] == [
        "scanlon2025-freeway-atlanta", "scanlon2025-freeway-phoenix",
    ]  # fmt: skip
    surface = matching("surface", "any injury")
    assert surface[0].id == "kusano2024-injury", "checked and corrected"
    assert all(row.unit == CRASHED and row.road == "surface" for row in surface)
    assert [row.place for row in matching("freeway", "any injury", place="phoenix")] == ["Phoenix"]
    assert matching("all", "any injury", unit=CLAIMS)[0].checked


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ({"road": "freeway", "outcome": "airbag"}, r"Of freeway roads there are: .*any injury \(crashed vehicles\)"),
        ({"road": "street", "outcome": "fatal"}, "Roads are freeway, surface or all"),
        ({"road": "freeway", "outcome": "any injury", "place": "Boston"}, "roads in Boston"),
        ({"road": "surface", "outcome": "any injury", "crash_type": "rear-end"}, "rear-end kinds of crash"),
    ],
)
def test_what_is_not_in_the_table_is_refused_by_name(wanted: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        matching(**wanted)


def test_crashes_become_crashed_vehicles_only_when_asked() -> None:
    crashes = ROWS["nhtsa2023-police"]
    twice = as_crashed_vehicles(crashes, 2.0)
    assert (twice.rate, twice.unit) == (2.0 * crashes.rate, CRASHED)
    assert crashes.interval is not None
    assert twice.interval == tuple(2.0 * end for end in crashes.interval)
    assert as_crashed_vehicles(crashes).rate == pytest.approx(1.77 * crashes.rate)
    assert "1.77 vehicles per crash" in as_crashed_vehicles(crashes).where
    assert as_crashed_vehicles(twice) is twice
    with pytest.raises(InputError, match="counts claims"):
        as_crashed_vehicles(ROWS["swissre2023-damage"])
    with pytest.raises(InputError, match="at least 1 vehicle"):
        as_crashed_vehicles(crashes, 0.5)
    with pytest.raises(InputError, match="is not known; known: "):
        unreported("fatal")
