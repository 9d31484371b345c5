"""Traces that another program, esmini, played and others recorded: places, speeds and contacts are as in them.

They are of ika-rwth-aachen/omega-prime at 742aebd (`example_files/`; MPL-2.0), with roads of esmini's examples; they
lie beside the repository and are not part of it. Their places are read here byte by byte (`reference.osi`).
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from reference.osi import decoded, field

import cornerforge
from cornerforge.drivers.rails import HEADING, LATERAL_SPEED, SPEED, X, Y
from cornerforge.errors import DataError
from cornerforge.ext.interchange.read_osi import read_osi
from cornerforge.geometry import Box, boxes_overlap

pytest.importorskip("google.protobuf", reason="protobuf is not installed (the extra osi)")

TRACES = Path(__file__).parents[3] / "shared" / "data" / "osi"
ROAD = TRACES / "straight_500m.xodr"
"""Road of `alks_cut-in` and `acc-test`: their vehicles keep 1.535 m from x = y = 0, half of its lanes' 3.07 m."""

pytestmark = pytest.mark.skipif(not TRACES.is_dir(), reason="the traces of others are not beside the repository")

TIME, POSITION, YAW, VELOCITY = (2,), (2, 2), (2, 3, 3), (2, 4)


def frames_of(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s], and x, y, yaw, velocity (x, y), length and width of the two objects of each frame."""
    content, times, rows, at = path.read_bytes(), [], [], 0
    while at < len(content):
        (size,) = struct.unpack_from("<I", content, at)
        truth = content[at + 4 : at + 4 + size]
        at += 4 + size
        times.append(field(truth, *TIME, 1, default=0) + 1e-9 * field(truth, *TIME, 2, default=0))
        rows.append([row_of(one) for one in sorted(objects_of(truth), key=lambda one: field(one, 1, 1, default=0))])
    return np.array(times), np.array(rows)


def objects_of(truth: bytes) -> list[bytes]:
    return [value for number, value in decoded(truth) if number == 5]


def row_of(one: bytes) -> list[float]:
    return [
        field(one, *POSITION, 1), field(one, *POSITION, 2), field(one, *YAW), field(one, *VELOCITY, 1),
        field(one, *VELOCITY, 2), field(one, 2, 1, 1), field(one, 2, 1, 2),
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["alks_cut-in", "acc-test"])
@pytest.mark.parametrize("road", [ROAD, None], ids=["with its road", "without a road"])
def test_vehicles_are_where_they_were(name: str, road: Path | None) -> None:
    path = TRACES / f"{name}.osi"
    times, rows = frames_of(path)
    case = read_osi(path, ego="0", road=road)
    x0, y0, direction = (float(str(case.facts[f"world_{what}"])) for what in ("x_m", "y_m", "heading_rad"))
    cos, sin = math.cos(direction), math.sin(direction)
    at = 0.1 * np.arange(len(case.poses))
    assert times[-1] - 0.1 < at[-1] <= times[-1]
    assert (case.odd.n_lanes, case.odd.lane_width) == (2, pytest.approx(3.07, abs=1e-5))
    for k in range(2):
        x, y, yaw, vx, vy = (np.interp(at, times, rows[:, k, number]) for number in range(5))
        pose = case.poses[:, k]
        assert np.abs(x0 + pose[:, X] * cos - pose[:, Y] * sin - x).max() < 0.01
        assert np.abs(y0 + pose[:, X] * sin + pose[:, Y] * cos - y).max() < 0.01
        assert np.abs(pose[:, SPEED] * cos - pose[:, LATERAL_SPEED] * sin - vx).max() < 0.05
        assert np.abs(pose[:, SPEED] * sin + pose[:, LATERAL_SPEED] * cos - vy).max() < 0.05
        np.testing.assert_allclose(pose[:, HEADING] + direction, yaw, atol=1e-3)
    np.testing.assert_allclose(np.stack([case.length, case.width], axis=1), rows[0, :, 5:])


@pytest.mark.full
@pytest.mark.parametrize("name", ["alks_cut-in", "acc-test", "cut_in"])
def test_the_case_ends_as_the_trace(name: str, tmp_path: Path) -> None:
    """The first two without a contact; a trace of ours, the control, with one."""
    is_ours = name == "cut_in"
    path = (Path(__file__).parent / "data" if is_ours else TRACES) / f"{name}.osi"
    _, rows = frames_of(path)
    touched = any(boxes_overlap(*(Box(*row[:3], *row[5:]) for row in frame)) for frame in rows.tolist())
    done = cornerforge.import_cases(
        path, ego=None if is_ours else "0", road=None if is_ours else ROAD, out=tmp_path / "in"
    )
    assert touched is is_ours
    assert [case.outcome for case in done.cases] == ["crash" if touched else "no crash"]


def test_a_merge_from_a_ramp_is_refused_by_name() -> None:
    """The AV starts on a ramp of 40 m radius; vehicle 1, on the motorway, comes to where the road bends."""
    path, road = TRACES / "highway_merge.osi", TRACES / "soderleden.xodr"
    with pytest.raises(
        DataError, match=r"soderleden\.xodr: the AV starts in no lane of a straight road.*road 1 \(param"
    ):
        read_osi(path, ego="0", road=road)
    with pytest.raises(DataError, match=r"soderleden\.xodr: .* after 110 m .* by road 0 \(paramPoly3"):
        read_osi(path, ego="1", road=road)
    with pytest.raises(DataError, match=r"highway_merge\.osi, frame 0: the AV, object 0, is beside the lanes"):
        read_osi(path, ego="0")


def test_a_road_of_another_trace_is_refused() -> None:
    with pytest.raises(DataError, match=r"e6mini\.xodr: the AV starts in no lane .*, 21 m from its line"):
        read_osi(TRACES / "acc-test.osi", ego="0", road=TRACES / "e6mini.xodr")
