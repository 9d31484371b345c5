"""Trajectories in highD's form of drivers that we know, to try `cornerforge ndd fit` (docs/tutorial-your-own-data.md):

python examples/highd_like.py recordings --recordings 24

The drivers are those of the shipped model, but they change lanes twice as often, and accept half the gap behind.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from cornerforge.experiment.setting import experiment  # may move in a later version; all else here is promised
from cornerforge.ndd import default_model_path, load_model, save_model
from cornerforge.road.straight import road_numbers
from cornerforge.sim import Recorder
from cornerforge.types import Odd

# 3 km of traffic on three lanes for 62 s. The AV, which is no natural driver, starts behind all and is not recorded.
ROAD = Odd(name="free-running", n_lanes=3, test_length=1e5, time_limit=62.0, av_start=0.0, traffic_length=3000.0)


def known_drivers():
    model = load_model(default_model_path())
    twice = np.minimum(2 * np.arange(model.lc_accept_rear.shape[0]), model.lc_accept_rear.shape[0] - 1)
    return replace(model, lc_base=2 * model.lc_base, lc_accept_rear=np.ascontiguousarray(model.lc_accept_rear[twice]))


def write_folder(folder, model, recordings, seed=0):
    """Write `recordings` pairs of 01_tracks.csv and 01_recordingMeta.csv, at 5 frames a second; return the tracks."""
    folder.mkdir(parents=True, exist_ok=True)
    recorder = Recorder(experiment(model=model).setting._replace(road=road_numbers(ROAD)), ROAD)
    paths = []
    for number in range(1, recordings + 1):
        driven = recorder.record(seed, number)
        seen = driven.present & (driven.slot != 0)
        seen[1::2] = False
        frame, i = np.nonzero(seen)
        length, y = driven.length[i], driven.y[frame, i]
        lane = np.floor(y / ROAD.lane_width) + 2
        columns = (frame // 2, i, driven.x[frame, i] - length / 2, y, length, driven.width[i], lane)
        paths.append(folder / f"{number:02d}_tracks.csv")
        np.savetxt(
            paths[-1], np.stack(columns, axis=1), fmt="%d,%d,%.3f,%.3f,%.3f,%.3f,%d", comments="",
            header="frame,id,x,y,width,height,laneId",
        )  # fmt: skip
        (folder / f"{number:02d}_recordingMeta.csv").write_text("id,frameRate\n1,5\n", encoding="utf-8")
    return paths


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--recordings", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    drivers = known_drivers()
    written = write_folder(given.folder, drivers, given.recordings, given.seed)
    save_model(drivers, given.folder / "truth.npz")
    print(f"{len(written)} recordings in {given.folder}, and their drivers in {given.folder / 'truth.npz'}")
