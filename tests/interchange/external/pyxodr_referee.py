"""Write down where pyxodr sees the middles of all lanes of an OpenDRIVE file that are driven, as JSON."""

from __future__ import annotations

import json
import sys


def main() -> None:
    import numpy as np
    from pyxodr.road_objects.network import RoadNetwork

    found = [
        {"lane": int(lane.id), "points": np.asarray(lane.centre_line)[:, :2].tolist()}
        for road in RoadNetwork(sys.argv[1], resolution=0.5).get_roads()
        for section in road.lane_sections
        for lane in section.lanes
        if lane.type in ("driving", "entry", "exit")
    ]
    print(json.dumps(found))


if __name__ == "__main__":
    main()
