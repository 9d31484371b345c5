"""`rate` at a site: counted, per million entering vehicles and per kilometre; trees are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import cornerforge
from cornerforge.errors import InputError
from cornerforge.experiment.sites import laws_named
from cornerforge.results.stating import as_json
from cornerforge.work.files import write_json

pytestmark = pytest.mark.filterwarnings("ignore")


def test_a_rate_at_a_site_is_counted_and_told_per_million_entering_vehicles(tmp_path: Path) -> None:
    laws = tmp_path / "laws.json"
    write_json(laws, as_json(replace(laws_named(None), looks_away=0.5, looks_back=0.05, overlooks_vehicle=0.1)))
    rate = cornerforge.rate(site="mcity-signal", av="idm-yield", site_laws=str(laws), max_tests=4096)
    assert rate.method == "mc"
    assert rate.crashes_per_test > 0.0
    assert rate.crashes_per_million_entering == pytest.approx(1e6 * rate.crashes_per_test)
    assert rate.interval95_per_million_entering == pytest.approx([1e6 * end for end in rate.interval95])
    assert rate.crashes_per_vehicle_km is not None
    # routes are 57 to 90 m long; a test that ends early drives less
    assert 0.03 < rate.crashes_per_test / rate.crashes_per_vehicle_km < 0.09


def test_trees_are_refused_at_a_site() -> None:
    for method in ("splitting", "is"):
        with pytest.raises(InputError, match="at a site trees"):
            cornerforge.rate(site="mcity-signal", av="idm-yield", method=method)
