"""Trajectory files of one made-up motorway, as each publisher would write them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FEET = 0.3048
LANES, LANE_WIDTH = 3, 3.6
US101 = Path(__file__).parents[2] / "shared" / "data" / "ngsim_us101_clips.csv.gz"


@dataclass(frozen=True)
class Track:
    """Where the centre of a vehicle is, at each tenth of a second: along the road, and from its right edge."""

    name: int
    length: float
    width: float
    kind: str
    began: int
    x: NDArray[np.float64]
    y: NDArray[np.float64]


def straight_on(name: int, lane: int, x: float, speed: float, seconds: float = 10.0, **more: object) -> Track:
    """A car that keeps its lane and speed."""
    time = np.arange(round(10 * seconds) + 1) / 10
    size = {"length": 4.5, "width": 1.8, "kind": "car", "began": 0, **more}
    return Track(name, x=x + speed * time, y=np.full(time.size, (lane + 0.5) * LANE_WIDTH), **size)  # type: ignore[arg-type]


def braking(name: int, lane: int, x: float, speed: float, rate: float, start: float, least: float) -> Track:
    """A car that brakes from a time on, to a speed."""
    time = np.arange(101) / 10
    slower = np.clip(speed - rate * np.maximum(time - start, 0.0), least, None)
    way = np.concatenate([[0.0], np.cumsum(0.05 * (slower[1:] + slower[:-1]))])
    return Track(name, 4.5, 1.8, "car", 0, x + way, np.full(time.size, (lane + 0.5) * LANE_WIDTH))


def motorway() -> list[Track]:
    """A car closes on one that brakes; a truck beside them, a motorcycle behind, a car that changes lanes far ahead."""
    time = np.arange(101) / 10
    aside = 0.5 - 0.5 * np.cos(np.pi * np.clip((time - 2.0) / 5.0, 0.0, 1.0))
    changer = Track(6, 4.2, 1.7, "car", 0, 160.0 + 24.0 * time, (1.5 + aside) * LANE_WIDTH)
    return [
        braking(1, 1, 40.0, 22.0, 2.0, 6.0, 14.0),
        braking(2, 1, 85.0, 22.0, 1.5, 3.0, 16.0),
        straight_on(3, 0, 60.0, 20.0, length=16.0, width=2.5, kind="truck"),
        straight_on(4, 0, 20.0, 21.0, length=2.2, width=0.8, kind="motorcycle"),
        straight_on(5, 2, 100.0, 26.0),
        changer,
    ]


def written(path: Path, header: str, rows: Sequence[str]) -> Path:
    """Write a file of comma-separated values."""
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def ngsim_file(path: Path, tracks: Sequence[Track], unit: float = FEET) -> Path:
    """The official CSV: feet, front bumper, `Local_X` from the left edge to the right, lane 1 leftmost."""
    kinds = {"motorcycle": 1, "car": 2, "truck": 3}
    rows = [
        f"{t.name},{i},{t.x.size},{1118846980200 + 100 * (t.began + i)},"
        f"{(LANES * LANE_WIDTH - t.y[i]) / unit:.4f},{(t.x[i] + t.length / 2) / unit:.4f},"
        f"{t.length / unit:.4f},{t.width / unit:.4f},{kinds[t.kind]},{LANES - int(t.y[i] / LANE_WIDTH)}"
        for t in tracks
        for i in range(t.x.size)
    ]
    header = "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,v_Length,v_Width,v_Class,Lane_ID"
    return written(path, header, rows)


def clips_file(path: Path, tracks: Sequence[Track], recording: str = "clip", every: int = 1) -> Path:
    """Clips as of US-101: metres, centres, `d_m` left of the left edge (so negative), lane 1 leftmost."""
    rows = [
        f"{recording},{t.name},{LANES - int(t.y[i] / LANE_WIDTH)},{(t.began + i) / 10:.1f},{t.x[i]:.4f},"
        f"{t.y[i] - LANES * LANE_WIDTH:.4f},{t.length},{t.width}"
        for t in tracks
        for i in range(0, t.x.size, every)
    ]
    return written(path, "scenario,veh_id,lane,t_s,s_m,d_m,length_m,width_m", rows)


def tgsim_file(path: Path, tracks: Sequence[Track], *, along_y: bool = False) -> Path:
    """TGSIM: metres, centres, in a picture whose y goes down; here the road runs towards falling x, or rising y."""
    kinds = {"car": "small-vehicle", "truck": "large-vehicle", "motorcycle": "motorcycle"}
    rows = []
    for t in tracks:
        for i in range(t.x.size):
            # Towards falling x, the left of a driver is where y of the picture grows; towards rising y, where x grows.
            place = (50.0 + t.y[i], 10.0 + t.x[i]) if along_y else (1500.0 - t.x[i], 30.0 + t.y[i])
            lane = LANES - int(t.y[i] / LANE_WIDTH)
            rows.append(
                f"{t.name},{(t.began + i) / 10:.1f},{place[0]:.4f},{place[1]:.4f},{lane},20.0,0.0,{t.length},"
                f"{t.width},{kinds[t.kind]},no,1"
            )
    header = (
        "id,time,xloc-kf,yloc-kf,lane-kf,speed-kf,acceleration-kf,length-smoothed,width-smoothed,type-most-common,"
        "av,run-index"
    )
    return written(path, header, rows)


def highd_files(folder: Path, forward: Sequence[Track], backward: Sequence[Track] = ()) -> Path:
    """highD at 25 rows a second: corners, y down; the lower lanes drive to the right, the upper ones to the left."""
    upper, median = 8.0, 24.0
    rows, meta = [], []
    for tracks, sign in ((forward, 1), (backward, -1)):
        for t in tracks:
            count = int((t.x.size - 1) * 2.5) + 1
            when = np.arange(count) / 2.5
            x, y = np.interp(when, np.arange(t.x.size), t.x), np.interp(when, np.arange(t.x.size), t.y)
            across = median + LANES * LANE_WIDTH - y if sign > 0 else upper + y
            centre = x if sign > 0 else 1000.0 - x
            lane = (5 if sign < 0 else 15) + (y / LANE_WIDTH).astype(int)
            rows += [
                f"{i + 1 + round(2.5 * t.began)},{t.name},{centre[i] - t.length / 2:.4f},{across[i] - t.width / 2:.4f},"
                f"{t.length},{t.width},{lane[i]}"
                for i in range(count)
            ]
            meta.append(f"{t.name},{'Truck' if t.kind == 'truck' else 'Car'}")
    marks = [";".join(f"{start + k * LANE_WIDTH:.2f}" for k in range(LANES + 1)) for start in (upper, median)]
    written(
        folder / "01_recordingMeta.csv",
        "id,frameRate,upperLaneMarkings,lowerLaneMarkings",
        [f"1,25,{marks[0]},{marks[1]}"],
    )
    written(folder / "01_tracksMeta.csv", "id,class", meta)
    return written(folder / "01_tracks.csv", "frame,id,x,y,width,height,laneId", rows)
