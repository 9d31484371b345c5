"""`rate` at a site: per million entering vehicles and per kilometre, by kind, by counting and by trees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cornerforge
from cornerforge.analysis.site_case import KINDS_AT_SITES
from cornerforge.errors import InputError
from cornerforge.experiment.sites import laws_named
from cornerforge.results.stating import as_json
from cornerforge.verbs.sentences.rates import rated_text
from cornerforge.work.files import write_json

pytestmark = pytest.mark.filterwarnings("ignore")


def laws(place: Path, **errors: Any) -> str:
    """The shipped laws with other chances of errors, as a file."""
    write_json(place / "laws.json", as_json(replace(laws_named(None), **errors)))
    return str(place / "laws.json")


def test_a_rate_at_a_site_is_told_per_million_entering_vehicles_and_by_kind(tmp_path: Path) -> None:
    careless = laws(tmp_path, looks_away=0.5, looks_back=0.05, overlooks_vehicle=0.1)
    rate = cornerforge.rate(site="mcity-signal", av="idm-yield", site_laws=careless, max_tests=4096)
    assert rate.method == "mc"
    assert rate.crashes_per_test > 0.0
    assert rate.crashes_per_million_entering == pytest.approx(1e6 * rate.crashes_per_test)
    assert rate.interval95_per_million_entering == pytest.approx([1e6 * end for end in rate.interval95])
    assert rate.crashes_per_vehicle_km is not None
    # routes are 57 to 90 m long; a test that ends early drives less
    assert 0.03 < rate.crashes_per_test / rate.crashes_per_vehicle_km < 0.09
    assert rate.mechanisms.keys() == KINDS_AT_SITES.keys()
    text = rated_text(rate)
    for name in KINDS_AT_SITES:
        assert f"[{name}]" in text
    most = 1e6 * cornerforge.rates.binomial_interval(0, 4096)[1]
    assert f"each at most {most:.2g} per million entering" in text


@pytest.mark.full
@pytest.mark.usefixtures("small_trees")
@pytest.mark.parametrize("method", ["splitting", "is"])
def test_trees_are_driven_at_a_site_where_they_are_asked_for(tmp_path: Path, method: str) -> None:
    often = laws(tmp_path, overlooks_vehicle=0.01)
    rate = cornerforge.rate(site="mcity-signal", av="idm-yield", site_laws=often, method=method, max_tests=6000)
    assert (rate.method, rate.tests) == (method, 1500)
    assert rate.crashes_per_million_entering == pytest.approx(1e6 * rate.crashes_per_test)
    assert sum(kind.crashes_per_test for kind in rate.mechanism_rates.values()) == pytest.approx(rate.crashes_per_test)
    assert rate.mechanism_rates.keys() <= KINDS_AT_SITES.keys()


@pytest.mark.parametrize("method", ["splitting", "is"])
def test_trees_are_refused_where_people_err_so_often_that_they_would_not_end(tmp_path: Path, method: str) -> None:
    often = laws(tmp_path, overlooks_vehicle=0.02, looks_away=0.3)
    with pytest.raises(InputError, match=r"more than 1% .*\(overlooks_vehicle, looks_away\).*--method mc"):
        cornerforge.rate(site="mcity-signal", av="idm-yield", site_laws=often, method=method, max_tests=10**6)
