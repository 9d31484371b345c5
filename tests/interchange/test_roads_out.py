"""Cases on roads whose lanes begin and end, or with curves, as files for other tools."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.errors import InputError
from cornerforge.experiment.roads import road_named
from cornerforge.ext.interchange.plain_roads import is_plain
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import case_text, read_case_file
from cornerforge.verbs.drive_case import drive_case

AV = "flawed-not-behind"


@pytest.fixture(scope="module")
def on_ramp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few crashes where a ramp meets the road."""
    path = tmp_path_factory.mktemp("on-ramp") / "library"
    cornerforge.simulate(av=AV, road="on-ramp", tests=60, out=path)
    return path


def test_only_the_straight_road_is_plain() -> None:
    names = ("straight", "curves", "on-ramp", "exit", "weaving", "lane-drop", "work-zone")
    assert [name for name in names if is_plain(road_named(name))] == ["straight"]


@pytest.mark.full
@pytest.mark.parametrize("to", ["openscenario", "commonroad", "osi", "mcap", "csv", "parquet", "rerun"])
def test_a_format_that_cannot_hold_the_road_is_refused(on_ramp: Path, tmp_path: Path, to: str) -> None:
    with pytest.raises(InputError, match=rf"^{to} is written .* road on-ramp has others; .* to: json"):
        cornerforge.export(on_ramp, "all", to=to, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.full
def test_a_case_file_holds_the_road_and_drives_to_the_same_contact(on_ramp: Path, tmp_path: Path) -> None:
    library = CaseLibrary.open(on_ramp)
    files = cornerforge.export(on_ramp, "all", to="json", out=tmp_path / "out").files
    assert files
    for file in files:
        path = tmp_path / "out" / file
        case = read_case_file(path)
        assert case.odd == library.odd
        assert case_text(case) == path.read_text(encoding="utf-8")
        driven = drive_case(path, av=AV)
        assert case.happened is not None
        assert driven.happened.frame == case.happened.frame
        np.testing.assert_array_equal(driven.happened.pose, case.happened.pose)
    with_road = library.odd.road
    assert with_road is not None
    assert with_road.name == "on-ramp"
