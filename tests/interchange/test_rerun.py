"""Recordings for the Rerun viewer, read back with rerun's own reader."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash

from cornerforge.errors import MissingExtraError, OutputError
from cornerforge.ext.interchange.rerun_file import write_rerun
from cornerforge.library.out_case import OutCase
from cornerforge.types import Scenario

HAS_RERUN = importlib.util.find_spec("rerun") is not None
needs_rerun = pytest.mark.skipif(not HAS_RERUN, reason="rerun-sdk, half a gigabyte, is not installed")


def cut_in() -> Scenario:
    scenario = crash(
        Car(0.0, MIDDLE, 30.0),
        Car(35.0, LEFT, 27.0, ((1.0, -3.0),), (Turn(0.5, 3.0, MIDDLE),)),
        Car(-60.0, RIGHT, 25.0),
    )
    present = scenario.present.copy()
    present[12:, 2] = False
    return replace(scenario, present=present)


def series_of(path: Path) -> dict[str, dict[str, tuple[np.ndarray, list[Any]]]]:
    """Entity to component to its times [s] and values, of a recording's data over time."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[str, tuple[np.ndarray, list[Any]]]] = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if "time" not in batch.schema.names:
            continue
        times = batch.column("time").cast("int64").to_numpy() / 1e9
        for name in batch.schema.names:
            if ":" in name:
                found.setdefault(str(chunk.entity_path), {})[name] = times, batch.column(name).to_pylist()
    return found


@needs_rerun
def test_boxes_and_plots_are_those_of_the_case(tmp_path: Path) -> None:
    scenario = cut_in()
    path = tmp_path / "t.rrd"
    write_rerun(OutCase("case-1", scenario, {"av": "idm", "judge": None}), path)
    assert [file.name for file in tmp_path.iterdir()] == ["t.rrd"]
    found = series_of(path)
    for column, name in enumerate(("av", "other", "vehicle_2")):
        frames = np.flatnonzero(scenario.present[:, column])
        times, centers = found[f"/road/{name}"]["Boxes3D:centers"]
        np.testing.assert_allclose(times, 0.1 * frames, atol=1e-6)
        place = np.array(centers)[:, 0]
        np.testing.assert_allclose(place[:, 0], scenario.x[frames, column], atol=1e-4)
        np.testing.assert_allclose(place[:, 1], scenario.y[frames, column], atol=1e-5)
        turns = np.array(found[f"/road/{name}"]["Boxes3D:quaternions"][1])[:, 0]
        np.testing.assert_allclose(
            2.0 * np.arctan2(turns[:, 2], turns[:, 3]), scenario.heading[frames, column], atol=1e-6
        )
    gone = [times for name, (times, _) in found["/road/vehicle_2"].items() if name.startswith("Clear")]
    np.testing.assert_allclose(gone, [[1.2]])
    for plot, values in (
        ("speed_mps/av", scenario.speed[:, 0]), ("speed_mps/other", scenario.speed[:, 1]),
        ("acceleration_mps2/av", scenario.acceleration[:, 0]),
        ("gap_m", np.abs(scenario.x[:, 1] - scenario.x[:, 0]) - 5.0),
    ):  # fmt: skip
        np.testing.assert_allclose(np.array(found[f"/plots/{plot}"]["Scalars:scalars"][1])[:, 0], values, atol=1e-9)


@needs_rerun
def test_an_av_alone_is_written(tmp_path: Path) -> None:
    scenario = cut_in()
    parts = {
        name: getattr(scenario, name)[..., :1]
        for name in ("slot", "x", "y", "speed", "heading", "acceleration", "target_lane", "present", "action", "kind",
                     "length", "width", "change_time")
    }  # fmt: skip
    write_rerun(OutCase("alone", replace(scenario, crash=None, **parts), {}), tmp_path / "t.rrd")
    assert set(series_of(tmp_path / "t.rrd")) == {"/road/av", "/plots/speed_mps/av", "/plots/acceleration_mps2/av"}


@needs_rerun
def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="Cannot write the recording"):
        write_rerun(OutCase("case-1", cut_in(), {}), tmp_path / "file" / "t.rrd")


@pytest.mark.skipif(HAS_RERUN, reason="rerun-sdk is installed")
def test_without_rerun_the_extra_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingExtraError, match=r"cornerforge\[rerun\]"):
        write_rerun(OutCase("case-1", cut_in(), {}), tmp_path / "t.rrd")
    assert list(tmp_path.iterdir()) == []
