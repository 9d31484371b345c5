"""The shipped model on real drivers that its fit never saw: NGSIM I-80's test split, and the HOV lane's second half.

Needs the trajectory files, which are not in the repository: the folder `shared/data` beside it, or the one that the
environment variable CORNERFORGE_DATA names. Skipped without.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from cornerforge.ext.calibrate.validate import GATES, Validation, better, passed, validate_readings
from cornerforge.ndd import default_model_path, load_model, read_decisions

DATA = Path(os.environ.get("CORNERFORGE_DATA", Path(__file__).parents[2].parent / "shared" / "data"))
I80, HOV = "ngsim_i80_car_following_pairs.csv.gz", "ngsim_i80_hov_lane.csv.gz"
TARGETS = {I80: -2.09, HOV: -2.05}
"""Log-likelihood per decision over 31 bins that the issue asks for; uniform guessing has -3.43."""

pytestmark = pytest.mark.skipif(not (DATA / I80).is_file(), reason=f"no trajectory files in {DATA.name}")


@pytest.fixture(scope="module")
def found() -> Validation:
    with (  # rows of I-80 that stand after later ones, and names of one period that come again in another
        pytest.warns(UserWarning, match="2 row"),
        pytest.warns(UserWarning, match=r"tracks were cut at 3 place\(s\)"),
    ):
        readings = read_decisions([DATA / name for name in TARGETS], "ngsim")
    return validate_readings(load_model(default_model_path()), readings)


@pytest.mark.full
def test_what_is_scored_was_held_out(found: Validation) -> None:
    files: Any = load_model(default_model_path()).provenance["files"]
    held_out = {file["name"]: file["decisions_held_out"] for file in files}
    for name in TARGETS:
        assert found.files[name]["law"].decisions == held_out[name] > 3000
        assert not any("no evidence" in note for note in found.notes)


@pytest.mark.full
def test_held_out_decisions_are_as_likely_as_asked_for(found: Validation) -> None:
    for name, target in TARGETS.items():
        assert found.files[name]["law"].model >= target, name


@pytest.mark.parametrize("name", list(TARGETS))
def test_the_law_beats_the_fair_idms(found: Validation, name: str) -> None:
    law = found.files[name]["law"]
    assert passed(law)
    assert better(law.model_minus["idm_fast"])


def test_the_table_beats_the_fair_idm_where_it_is_used(found: Validation) -> None:
    table = found.files[HOV]["table"]
    assert all(better(table.model_minus[name]) for name in GATES)
