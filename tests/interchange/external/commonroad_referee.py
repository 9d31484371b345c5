"""Reads CommonRoad files with commonroad-io and lets the drivability checker look for contacts.

Run with the Python of an environment that has commonroad-io and commonroad-drivability-checker; prints one JSON object:
for each file its faults against the schema that commonroad-io ships, what it holds, and all contacts of the obstacle
with the lowest id, the AV, as pairs (step, id), up to the last step. With --rewrite FOLDER N commonroad-io itself
writes the first N files again, into that folder.
"""

from __future__ import annotations

import importlib.resources
import json
import sys
import warnings
from pathlib import Path
from typing import Any

warnings.simplefilter("ignore")


def look(path: Path, schema: Any, again: Path | None) -> dict[str, Any]:
    import commonroad_dc.pycrcc as crcc
    from commonroad.common.file_reader import CommonRoadFileReader
    from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
    from commonroad_dc.collision.collision_detection.pycrcc_collision_dispatch import create_collision_object
    from lxml import etree

    schema.validate(etree.parse(str(path)))
    faults = [f"line {fault.line}: {fault.message}" for fault in schema.error_log]
    scenario, problems = CommonRoadFileReader(str(path)).open()
    obstacles = scenario.dynamic_obstacles
    shapes = {obstacle.obstacle_id: create_collision_object(obstacle) for obstacle in obstacles}
    last = max((obstacle.prediction.final_time_step for obstacle in obstacles if obstacle.prediction), default=0)
    ids = sorted(shapes)
    contacts = []
    for step in range(last + 1):
        av, *others = (shapes[name].obstacle_at_time(step) for name in ids)
        touched = zip(ids[1:], others, strict=True)
        contacts += [(step, name) for name, box in touched if box is not None and box.collide(av)]
    # The checker's own search over time: the AV against all others.
    checker = crcc.CollisionChecker()
    for name in ids[1:]:
        checker.add_collision_object(shapes[name])
    if again is not None:
        writer = CommonRoadFileWriter(scenario, problems, decimal_precision=6)
        writer.write_to_file(str(again / path.name), OverwriteExistingFile.ALWAYS)
    return {
        "faults": faults,
        "benchmark": str(scenario.scenario_id),
        "source": scenario.source,
        "lanelets": len(scenario.lanelet_network.lanelets),
        "obstacles": {obstacle.obstacle_id: obstacle.obstacle_type.value for obstacle in obstacles},
        "problems": [
            [problem.planning_problem_id, problem.initial_state.position.tolist(), problem.initial_state.velocity]
            for problem in problems.planning_problem_dict.values()
        ],
        "av_collides": bool(checker.collide(shapes[ids[0]])),
        "contacts": contacts,
        "last": last,
    }


def main() -> None:
    from lxml import etree

    folder = Path(sys.argv[1])
    again, most = (Path(sys.argv[3]), int(sys.argv[4])) if sys.argv[2:3] == ["--rewrite"] else (None, 0)
    definitions = importlib.resources.files("commonroad.scenario_definition") / "xml_definition_files"
    schema = etree.XMLSchema(etree.fromstring((definitions / "XML_commonRoad_XSD.xsd").read_bytes()))
    paths = sorted(folder.glob("*.xml"))
    print(json.dumps({path.name: look(path, schema, again if at < most else None) for at, path in enumerate(paths)}))


if __name__ == "__main__":
    main()
